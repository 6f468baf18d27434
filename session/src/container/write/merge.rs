//! Sessions of several hosts as one.

use std::{
    collections::{BTreeMap, BTreeSet},
    io::{Read, Seek, Write},
    path::{Path, PathBuf},
};

use super::{SessionWriter, Settings, StreamId};
use crate::{
    container::{
        ContainerError, Entry, IncidentEntry, Session, SessionStart, Status, record::plain_id, whole::write_whole,
    },
    source::{Incident, Packet, StampClock},
};

/// A session, and how the times of its host become those of the first one's.
pub struct Part<'a, R> {
    /// The session.
    pub session: &'a mut Session<R>,
    /// From its host's time to that of the first host, nanoseconds.
    pub host_ns: &'a dyn Fn(i64) -> i64,
}

/// A stream of a merged session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MergedStream {
    /// The session that it comes from.
    pub from: PathBuf,
    /// Its name there.
    pub id: String,
    /// Its name now, which is another where two sessions have a stream of one name.
    pub merged_id: String,
    /// Its packets.
    pub packets: u64,
}

/// What was merged.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Merged {
    /// The streams.
    pub streams: Vec<MergedStream>,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// Sessions whose recording was cut off.
    pub cut_off: Vec<PathBuf>,
    /// What could not be read of them, a message for each place.
    pub damaged: Vec<String>,
}

/// Writes the session `out`, which must not exist, from the packets of several in the order of their arrival: it appears whole
/// or not at all. Host times are those of the first one's host; ticks stay as they are, and clock fits are left out, which were
/// made for other times. `progress` is called with the bytes of payload so far.
///
/// # Errors
/// If a session cannot be read, or `out` exists or cannot be written. What is damaged within a session is passed over and told.
pub fn merge<R: Read + Seek>(
    parts: &mut [Part<'_, R>],
    out: &Path,
    mut progress: impl FnMut(u64),
) -> Result<Merged, ContainerError> {
    if out.exists() {
        return Err(ContainerError::Exists { path: out.to_owned() });
    }
    write_whole(out, |sink| write(parts, sink, out, &mut progress))
}

fn write<R: Read + Seek>(
    parts: &mut [Part<'_, R>],
    sink: impl Write,
    out: &Path,
    progress: &mut impl FnMut(u64),
) -> Result<Merged, ContainerError> {
    let mut writer = SessionWriter::new(sink, out, start(parts), &rig(parts), Settings::default())?;
    let mut merged = Merged::default();
    let mut streams = Streams::declare(parts, &mut writer, &mut merged)?;
    let names: Vec<String> = parts.iter().map(|part| name(part.session.path())).collect();
    let hosts: Vec<&dyn Fn(i64) -> i64> = parts.iter().map(|part| part.host_ns).collect();
    let cut_off: Vec<bool> = parts.iter().map(|part| !part.session.summary().complete).collect();
    let paths: Vec<PathBuf> = parts.iter().map(|part| part.session.path().to_owned()).collect();
    let mut messages: Vec<_> = parts.iter_mut().map(|part| part.session.messages(None)).collect();
    // The next entry of each session, with its time.
    let mut heads = Vec::new();
    for (at, messages) in messages.iter_mut().enumerate() {
        heads.push(next(messages, hosts[at], &mut merged.damaged)?);
    }
    let (mut bytes, mut last_ns) = (0, i64::MIN);
    while let Some(at) = earliest(&heads) {
        let following = next(&mut messages[at], hosts[at], &mut merged.damaged)?;
        let Some((host_ns, entry)) = std::mem::replace(&mut heads[at], following) else { continue };
        last_ns = last_ns.max(host_ns);
        match entry {
            Entry::Packet { stream, packet } => {
                let Some((id, merged_at)) = streams.of(at, stream) else { continue };
                bytes += packet.payload.len() as u64;
                merged.streams[merged_at].packets += 1;
                writer.packet(id, &moved(packet, hosts[at]))?;
                progress(bytes);
            }
            Entry::Status(status) => writer.status(&streams.status(at, host_ns, status))?,
            Entry::Incident(incident) => {
                let (stream, incident) = streams.incident(at, &names[at], incident);
                writer.incident(stream, host_ns, &incident)?;
            }
            Entry::DecoderState(_) | Entry::Clock { .. } => {}
        }
        if heads[at].is_none() && cut_off[at] {
            merged.cut_off.push(paths[at].clone());
            let reason = format!("the recording of {} was cut off here", names[at]);
            for id in streams.all(at) {
                writer.incident(Some(id), host_ns, &Incident::Lost { reason: reason.clone() })?;
            }
        }
    }
    let reason = format!("merged from {}", names.join(", "));
    writer.incident(None, last_ns.max(writer.start().host_ns), &Incident::Ended { reason })?;
    merged.bytes = writer.finish()?.bytes;
    Ok(merged)
}

/// The next entry and its time on the first host; what is damaged is told and passed over.
fn next(
    messages: &mut impl Iterator<Item = Result<Entry, ContainerError>>,
    host_ns: &dyn Fn(i64) -> i64,
    damaged: &mut Vec<String>,
) -> Result<Option<(i64, Entry)>, ContainerError> {
    for entry in messages {
        let at = match &entry {
            Ok(Entry::Packet { packet, .. }) => packet.host_ns,
            Ok(Entry::Status(status)) => status.host_ns,
            Ok(Entry::Incident(incident)) => incident.host_ns,
            Ok(_) => continue,
            Err(ContainerError::Read { .. } | ContainerError::Compression { .. }) => return entry.map(|_| None),
            Err(error) => {
                damaged.push(error.to_string());
                continue;
            }
        };
        return entry.map(|entry| Some((host_ns(at), entry)));
    }
    Ok(None)
}

fn earliest(heads: &[Option<(i64, Entry)>]) -> Option<usize> {
    let times = heads.iter().enumerate().filter_map(|(at, head)| Some((head.as_ref()?.0, at)));
    times.min().map(|(_, at)| at)
}

/// As it arrived by the first host's clock.
fn moved(mut packet: Packet, host_ns: &dyn Fn(i64) -> i64) -> Packet {
    packet.host_ns = host_ns(packet.host_ns);
    if let Some(stamp) = packet.stamp.as_mut().filter(|stamp| stamp.clock == StampClock::Monotonic) {
        stamp.kernel_ns = host_ns(stamp.kernel_ns);
    }
    packet
}

/// That of the recording that began first, by the first host's clocks.
fn start<R: Read + Seek>(parts: &[Part<'_, R>]) -> SessionStart {
    let Some(first) = parts.first() else { return SessionStart::default() };
    let mut start = first.session.summary().start.clone();
    let begun = parts.iter().map(|part| (part.host_ns)(part.session.summary().start.host_ns)).min();
    let earlier = start.host_ns.saturating_sub(begun.unwrap_or(start.host_ns));
    start.host_ns = start.host_ns.saturating_sub(earlier);
    start.epoch_ns = start.epoch_ns.saturating_sub(earlier);
    start.program = format!("{}, merged from {} sessions", concat!("erfgs ", env!("CARGO_PKG_VERSION")), parts.len());
    for (at, part) in parts.iter().enumerate().skip(1) {
        let machine = &part.session.summary().start.machine;
        start.machine.extend(machine.iter().map(|(key, value)| (format!("{key}.{}", at + 1), value.clone())));
    }
    start
}

/// The first one's configuration as it is, and those of the others behind it as comments: names in them may be the same.
fn rig<R: Read + Seek>(parts: &[Part<'_, R>]) -> String {
    let mut text = String::new();
    for (at, part) in parts.iter().enumerate() {
        let Some(rig) = &part.session.summary().rig else { continue };
        if at == 0 {
            text += rig;
            continue;
        }
        text += &format!("\n# The configuration of {}:\n", name(part.session.path()));
        rig.lines().for_each(|line| text += &format!("# {line}\n"));
    }
    text
}

fn name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// The streams of all parts in the merged file.
struct Streams {
    /// For each part and each of its streams: its name there and in the file, its handle, its place in [`Merged::streams`].
    parts: Vec<Vec<(String, String, StreamId, usize)>>,
    /// The last status of each part, its streams named as in the file.
    status: BTreeMap<usize, Status>,
}

impl Streams {
    fn declare<R: Read + Seek, W: Write>(
        parts: &[Part<'_, R>],
        writer: &mut SessionWriter<W>,
        merged: &mut Merged,
    ) -> Result<Self, ContainerError> {
        let all = parts.iter().flat_map(|part| &part.session.summary().streams);
        let own: BTreeSet<&str> = all.map(|stream| stream.description.id.as_str()).collect();
        let mut taken: BTreeSet<String> = BTreeSet::new();
        let mut declared = Vec::new();
        for part in parts {
            let path = part.session.path();
            let host = plain_id(&path.file_stem().unwrap_or_default().to_string_lossy());
            let mut of_part = Vec::new();
            for stream in &part.session.summary().streams {
                let mut description = stream.description.clone();
                let id = description.id.clone();
                let mut number = 1;
                while !taken.insert(description.id.clone()) {
                    number += 1;
                    let candidate = match number {
                        2 => format!("{host}-{id}"),
                        _ => format!("{host}-{id}-{number}"),
                    };
                    // A name that another stream has of its own is left to it.
                    if !own.contains(candidate.as_str()) {
                        description.id = candidate;
                    }
                }
                let merged_id = description.id.clone();
                let handle = writer.add_stream(&description)?;
                of_part.push((id.clone(), merged_id.clone(), handle, merged.streams.len()));
                merged.streams.push(MergedStream { from: path.to_owned(), id, merged_id, packets: 0 });
            }
            declared.push(of_part);
        }
        Ok(Self { parts: declared, status: BTreeMap::new() })
    }

    fn of(&self, part: usize, stream: usize) -> Option<(StreamId, usize)> {
        self.parts.get(part)?.get(stream).map(|(_, _, id, at)| (*id, *at))
    }

    fn all(&self, part: usize) -> Vec<StreamId> {
        self.parts[part].iter().map(|(_, _, id, _)| *id).collect()
    }

    /// What all recorders said last.
    fn status(&mut self, part: usize, host_ns: i64, mut status: Status) -> Status {
        let of_part = &self.parts[part];
        status.streams = std::mem::take(&mut status.streams)
            .into_iter()
            .filter_map(|(id, stream)| {
                let (_, merged_id, ..) = of_part.iter().find(|(own, ..)| *own == id)?;
                Some((merged_id.clone(), stream))
            })
            .collect();
        self.status.insert(part, status);
        let all = || self.status.values();
        Status {
            host_ns,
            written_bytes: all().map(|status| status.written_bytes).fold(0, u64::saturating_add),
            disk_free_bytes: all().filter_map(|status| status.disk_free_bytes).min(),
            streams: all().flat_map(|status| status.streams.clone()).collect(),
        }
    }

    /// An incident as it is told in the file: what was said of a recorder itself says now of which.
    fn incident(&self, part: usize, name: &str, entry: IncidentEntry) -> (Option<StreamId>, Incident) {
        let stream = self.parts[part].iter().find(|(id, ..)| *id == entry.stream).map(|(_, _, id, _)| *id);
        let incident = match (stream, entry.incident) {
            (Some(_), incident) => incident,
            (None, Incident::Ended { reason }) => {
                Incident::Warning { message: format!("{name}: the recording ended: {reason}") }
            }
            (None, Incident::Warning { message }) => Incident::Warning { message: format!("{name}: {message}") },
            (None, Incident::Lost { reason }) => Incident::Warning { message: format!("{name}: {reason}") },
            (None, Incident::Back) => Incident::Warning { message: format!("{name}: back") },
            (None, Incident::Adjusted { changed }) => {
                let keys = changed.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                Incident::Warning { message: format!("{name}: {keys} changed") }
            }
        };
        (stream, incident)
    }
}
