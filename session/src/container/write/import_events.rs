//! An event file as a session file.

use std::{io::Write, path::Path};

use super::{SessionWriter, Settings};
use crate::container::{ContainerError, Entry, EventFileRecording, SessionStart, Totals, whole::write_whole};

/// Writes the session `out`, which must not exist, from an event file: `out` appears whole or not at all. `progress` is
/// called with the nanoseconds of the recording so far.
///
/// # Errors
/// If the file cannot be read, or `out` exists or cannot be written.
pub fn import_events(
    file: &EventFileRecording,
    out: &Path,
    mut progress: impl FnMut(i64),
) -> Result<Totals, ContainerError> {
    if out.exists() {
        return Err(ContainerError::Exists { path: out.to_owned() });
    }
    write_whole(out, |sink| write(file, sink, out, &mut progress))
}

fn write(
    file: &EventFileRecording,
    sink: impl Write,
    out: &Path,
    progress: &mut impl FnMut(i64),
) -> Result<Totals, ContainerError> {
    let summary = file.summary();
    let name = file.path().file_name().unwrap_or_default().to_string_lossy();
    let program = format!("{}, imported from {name}", concat!("erfgs ", env!("CARGO_PKG_VERSION")));
    let start = SessionStart { program, ..summary.start.clone() };
    let mut writer = SessionWriter::new(sink, out, start, "", Settings::default())?;
    let mut streams = Vec::new();
    for stream in &summary.streams {
        streams.push(writer.add_stream(&stream.description)?);
    }
    for entry in file.messages(None) {
        if let Entry::Packet { stream, packet } = entry? {
            writer.packet(streams[stream], &packet)?;
            progress(packet.host_ns);
        }
    }
    Ok(writer.finish()?.totals)
}
