//! A range of a recording as a session of its own.

use std::{io::Write, path::Path};

use super::{SessionWriter, Settings, StreamId};
use crate::{
    container::{ContainerError, Entry, Recording, SessionStart, Totals, whole::write_whole},
    source::{Incident, Packet},
};

/// Writes what arrived within `span_ns` (session nanoseconds, the last one included) as the session `out`, which must not
/// exist and appears whole or not at all: packets byte for byte, of the streams in `chosen` or of all, with what was said of
/// them in that time. The zero of its clock is the start of the span; sequence numbers, kernel stamps and the rig's
/// configuration stay. What was lost to damage of the recording is added to `damage`; `progress` is called with the bytes
/// of payload so far.
///
/// # Errors
/// If the recording cannot be read or has nothing within the span, or if `out` exists or cannot be written.
pub fn write_excerpt(
    recording: &mut Recording,
    span_ns: [i64; 2],
    chosen: Option<&[usize]>,
    out: &Path,
    damage: &mut Vec<String>,
    mut progress: impl FnMut(u64),
) -> Result<Totals, ContainerError> {
    if out.exists() {
        return Err(ContainerError::Exists { path: out.to_owned() });
    }
    recording.restrict(Some(span_ns));
    let written = write_whole(out, |sink| {
        Excerpt::begin(recording, span_ns, chosen, sink, out)?.fill(recording, span_ns, damage, &mut progress)
    });
    recording.restrict(None);
    written
}

/// The excerpt that is being written.
struct Excerpt<W: Write> {
    writer: SessionWriter<W>,
    /// Where the streams of the recording go.
    streams: Vec<Option<StreamId>>,
    ids: Vec<String>,
    bytes: u64,
    packets: u64,
}

impl<W: Write> Excerpt<W> {
    fn begin(
        recording: &Recording,
        [from, to]: [i64; 2],
        chosen: Option<&[usize]>,
        sink: W,
        out: &Path,
    ) -> Result<Self, ContainerError> {
        let summary = recording.summary();
        let whole = &summary.start;
        let name = recording.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut machine = whole.machine.clone();
        let seconds = |ns: i64| ns as f64 * 1e-9;
        machine.insert("excerpt".into(), format!("{:.6} s to {:.6} s of {name}", seconds(from), seconds(to)));
        let start = SessionStart {
            host_ns: whole.host_ns.saturating_add(from),
            // What no clock told stays unknown.
            epoch_ns: if whole.epoch_ns > 0 { whole.epoch_ns.saturating_add(from) } else { 0 },
            program: whole.program.clone(),
            machine,
        };
        let rig = summary.rig.clone().unwrap_or_default();
        let mut writer = SessionWriter::new(sink, out, start, &rig, Settings::default())?;
        let mut streams = Vec::new();
        for (index, stream) in summary.streams.iter().enumerate() {
            let wanted = chosen.is_none_or(|chosen| chosen.contains(&index));
            streams.push(if wanted { Some(writer.add_stream(&stream.description)?) } else { None });
        }
        let ids = summary.streams.iter().map(|stream| stream.description.id.clone()).collect();
        Ok(Self { writer, streams, ids, bytes: 0, packets: 0 })
    }

    fn fill(
        mut self,
        recording: &mut Recording,
        [from, to]: [i64; 2],
        damage: &mut Vec<String>,
        progress: &mut impl FnMut(u64),
    ) -> Result<Totals, ContainerError> {
        let (path, start_ns) = (recording.path().to_owned(), recording.summary().start.host_ns);
        // What was changed before holds in the range, too.
        let (begin_ns, known) = (start_ns.saturating_add(from), &recording.summary().totals.incidents);
        for entry in known.iter().filter(|entry| entry.host_ns < begin_ns) {
            let id = self.ids.iter().position(|id| *id == entry.stream).and_then(|stream| self.streams[stream]);
            if let (Some(id), Incident::Adjusted { .. }) = (id, &entry.incident) {
                self.writer.incident(Some(id), begin_ns, &entry.incident)?;
            }
        }
        for entry in recording.messages(None) {
            match entry {
                Ok(Entry::Packet { stream, packet }) => self.packet(stream, &packet, progress)?,
                Ok(Entry::Incident(entry)) => {
                    let stream = self.ids.iter().position(|id| *id == entry.stream);
                    let id = stream.and_then(|stream| self.streams[stream]);
                    // Of a stream that was left out nothing is said, and the end comes below.
                    let of_another = !entry.stream.is_empty() && id.is_none();
                    if !of_another && !matches!(entry.incident, Incident::Ended { .. }) {
                        self.writer.incident(id, entry.host_ns, &entry.incident)?;
                    }
                }
                Ok(Entry::Status(mut status)) => {
                    let kept = |id: &String| {
                        self.ids.iter().zip(&self.streams).any(|(of, stream)| of == id && stream.is_some())
                    };
                    status.streams.retain(|id, _| kept(id));
                    self.writer.status(&status)?;
                }
                // Both are about the recording's own clock and beginning; the writer makes its own.
                Ok(Entry::Clock { .. } | Entry::DecoderState(_)) => {}
                Err(error @ ContainerError::Damaged { .. }) => damage.push(error.to_string()),
                Err(error) => return Err(error),
            }
        }
        if self.packets == 0 {
            let [from_s, to_s] = [from, to].map(|ns| ns as f64 * 1e-9);
            return Err(ContainerError::NothingWithin { path, from_s, to_s });
        }
        let reason = format!("the range of {} was over", path.file_name().unwrap_or_default().to_string_lossy());
        self.writer.incident(None, start_ns.saturating_add(to), &Incident::Ended { reason })?;
        Ok(self.writer.finish()?.totals)
    }

    fn packet(&mut self, stream: usize, packet: &Packet, progress: &mut impl FnMut(u64)) -> Result<(), ContainerError> {
        let Some(&Some(id)) = self.streams.get(stream) else { return Ok(()) };
        self.writer.packet(id, packet)?;
        self.packets += 1;
        self.bytes += packet.payload.len() as u64;
        progress(self.bytes);
        Ok(())
    }
}
