//! Files of others as one session: event files of several cameras, folders of pictures and videos, on one clock.
//!
//! ```text
//! plan.toml ──► event files ──► when each begins, the pulses at its trigger input ─┐
//!          └──► pictures, videos ──► when each frame was exposed ◄─────────────────┘──► session
//! ```
//!
//! Nothing that was recorded is changed: words of RAW files and JPEG files go into the session as they are. Times come from the plan:
//! a stream's own, those of another stream with the same clock, or pulses that two streams saw. What they are worth is for
//! [`erfgs_sync`] to say, which reads the session as it reads any other.

mod draft;
mod error;
mod events;
mod frames;
mod plan;
mod times;

use std::{io::Write, path::Path};

use erfgs_base::{FileError, Progress, atomic, plausible::SPAN};
use erfgs_session::{
    container::{ContainerError, SessionStart, SessionWriter, Settings, StreamTotals, Totals},
    source::{Description, Packet},
};

use self::{events::EventStream, frames::FrameStream};

pub use self::{
    draft::{Draft, draft},
    error::PlanError,
    plan::Plan,
};

/// A stream of the session.
#[derive(Clone, Debug)]
pub struct ImportedStream {
    /// What it is.
    pub description: Description,
    /// Its packets.
    pub totals: StreamTotals,
    /// When it begins, nanoseconds of session time.
    pub starts_ns: i64,
}

/// What became of a plan.
#[derive(Clone, Debug)]
pub struct ImportedSession {
    /// Its streams, in the order of the plan.
    pub streams: Vec<ImportedStream>,
    /// What of the files was passed over, a sentence each.
    pub damage: Vec<String>,
}

/// A stream, its packets in order of time, of which the next one is held.
struct Source {
    description: Description,
    starts_ns: i64,
    packets: Box<dyn Iterator<Item = Result<Packet, PlanError>>>,
    next: Option<Packet>,
}

impl Source {
    fn new(
        description: Description,
        starts_ns: i64,
        packets: impl Iterator<Item = Result<Packet, PlanError>> + 'static,
    ) -> Result<Self, PlanError> {
        let mut source = Self { description, starts_ns, packets: Box::new(packets), next: None };
        source.take()?;
        Ok(source)
    }

    fn take(&mut self) -> Result<Option<Packet>, PlanError> {
        let next = self.packets.next().transpose()?;
        Ok(std::mem::replace(&mut self.next, next))
    }
}

/// Writes the session `out`, which must not exist, from the files of a plan: `out` appears whole or not at all.
///
/// # Errors
/// [`PlanError`].
pub fn import(plan: &Plan, out: &Path, progress: &mut dyn FnMut(Progress)) -> Result<ImportedSession, PlanError> {
    if out.exists() {
        return Err(ContainerError::Exists { path: out.to_owned() }.into());
    }
    let total = (plan.events.len() + plan.frames.len()) as u64;
    let mut opened = |done: usize| progress(Progress { what: "files read through", done: done as u64, total });
    let mut events = EventStream::open_all(plan, &mut opened)?;
    let mut sources = Vec::new();
    let mut all_frames = Some(0);
    for (at, frames) in plan.frames.iter().enumerate() {
        opened(events.len() + at);
        let mut stream = FrameStream::open(plan, frames, &mut events)?;
        all_frames = all_frames.zip(stream.count()).map(|(sum, frames)| sum + frames);
        let (description, starts_ns) = (stream.description.clone(), stream.starts_ns);
        sources.push(Source::new(description, starts_ns, std::iter::from_fn(move || stream.packet().transpose()))?);
    }
    let damage =
        events.iter().flat_map(|stream| stream.damage().map(|what| format!("{}: {what}", stream.path.display())));
    let damage = damage.collect();
    let last_ns = events.iter().map(|stream| stream.starts_ns.saturating_add(stream.length_ns())).max();
    for (at, stream) in events.iter().enumerate() {
        let packets = stream.packets().map(|packet| packet.map_err(PlanError::from));
        sources.insert(at, Source::new(stream.description.clone(), stream.starts_ns, packets)?);
    }
    let zero_ns = begin(&sources)?;
    let mut frames = 0;
    let mut done = |packet: &Packet| {
        frames += u64::from(packet.stamp.is_some());
        let passed = |ns: i64| ns.saturating_sub(zero_ns).max(0).unsigned_abs();
        progress(match last_ns {
            Some(last_ns) => {
                Progress { what: "ns", done: passed(packet.host_ns.min(last_ns)), total: passed(last_ns).max(1) }
            }
            None => Progress { what: "frames", done: frames, total: all_frames.unwrap_or(0) },
        });
    };
    let failed = |source| PlanError::Io(FileError::when("write", out)(source));
    let totals = atomic::try_write_with(out, |sink| write(&mut sources, zero_ns, sink, out, &mut done), failed)?;
    let streams = sources.into_iter().map(|source| ImportedStream {
        totals: totals.streams.get(&source.description.id).copied().unwrap_or_default(),
        starts_ns: source.starts_ns.saturating_sub(zero_ns),
        description: source.description,
    });
    Ok(ImportedSession { streams: streams.collect(), damage })
}

/// When the session begins: with what comes first.
fn begin(sources: &[Source]) -> Result<i64, PlanError> {
    let first = sources.iter().min_by_key(|source| source.starts_ns);
    let last = sources.iter().max_by_key(|source| source.starts_ns);
    let (Some(first), Some(last)) = (first, last) else { return Ok(0) };
    let apart_ns = last.starts_ns.saturating_sub(first.starts_ns);
    if SPAN.check_ns(apart_ns).is_err() {
        let [first, last] = [first, last].map(|source| source.description.id.clone());
        return Err(PlanError::Apart { first, last, seconds: apart_ns as f64 * 1e-9 });
    }
    Ok(first.starts_ns)
}

/// Writes all packets in order of their times, counted from `zero_ns` on.
fn write(
    sources: &mut [Source],
    zero_ns: i64,
    sink: impl Write,
    out: &Path,
    done: &mut impl FnMut(&Packet),
) -> Result<Totals, PlanError> {
    let program = concat!("erfgs ", env!("CARGO_PKG_VERSION"), ", imported by a plan").to_owned();
    let start = SessionStart { program, ..SessionStart::default() };
    let mut writer = SessionWriter::new(sink, out, start, "", Settings::default())?;
    let mut streams = Vec::new();
    for source in &*sources {
        streams.push(writer.add_stream(&source.description)?);
    }
    loop {
        let waiting = sources.iter().enumerate().filter_map(|(at, source)| Some((source.next.as_ref()?.host_ns, at)));
        let Some((_, at)) = waiting.min() else { break };
        let Some(mut packet) = sources[at].take()? else { break };
        done(&packet);
        packet.host_ns = packet.host_ns.saturating_sub(zero_ns);
        if let Some(stamp) = &mut packet.stamp {
            stamp.kernel_ns = stamp.kernel_ns.saturating_sub(zero_ns);
        }
        writer.packet(streams[at], &packet)?;
    }
    Ok(writer.finish()?.totals)
}
