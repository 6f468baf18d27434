//! What a recording holds as a whole.

use std::path::PathBuf;

use super::{
    PartOf, Stream,
    record::{IncidentEntry, SessionStart, Totals},
};
use crate::source::Incident;

/// What a session holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// When and with what it was recorded. For a ROS 2 recording: when its first packet came.
    pub start: SessionStart,
    /// The rig's configuration.
    pub rig: Option<String>,
    /// The streams, in the order in which the file declares them.
    pub streams: Vec<Stream>,
    /// Totals, the last status and clock fits, incidents.
    pub totals: Totals,
    /// Whether erfgs recorded it. Otherwise it is a ROS 2 recording with packets of events.
    pub is_session: bool,
    /// Whether the recording was ended properly. Otherwise it was read through to the end of what is whole.
    pub complete: bool,
    /// Length of the file, or of all files, bytes.
    pub file_bytes: u64,
    /// Up to here the file is whole, bytes: what lies behind is half a chunk, or the index. Of several files the sum.
    pub whole_bytes: u64,
    /// The files of a session in parts, in their order; empty for any other recording.
    pub files: Vec<FileSummary>,
    /// Of a part of a session that was opened by itself, and of a session in parts its first file: which it is.
    pub part: Option<PartOf>,
    /// What is damaged in between, one message for each place.
    pub damage: Vec<String>,
    /// Encodings of events in the file that erfgs does not decode.
    pub unknown_encodings: Vec<String>,
    /// How many chunks the file has.
    pub chunks: usize,
}

/// One file of a session in parts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileSummary {
    /// The file. The last one may be missing, where the one before says that the session goes on.
    pub path: PathBuf,
    /// Its length, bytes.
    pub bytes: u64,
    /// Up to here it is whole, bytes.
    pub whole_bytes: u64,
    /// Whether it was ended properly.
    pub complete: bool,
}

impl FileSummary {
    /// What is wrong with its end.
    fn fault(&self) -> Option<String> {
        let path = self.path.display();
        match (self.complete, self.whole_bytes) {
            (true, _) => None,
            (false, 0) if self.bytes == 0 => Some(format!(
                "{path} is missing or empty: the recording was cut off before it, or the file lies elsewhere; if so, \
                 move it beside the others"
            )),
            (false, 0) => {
                Some(format!("{path} was cut off before its first packet: it holds nothing, and may be deleted"))
            }
            (false, whole) => Some(format!(
                "{path} was not ended: intact up to byte {whole} of {}; `erfgs recover {path} --in-place` \
                 completes it",
                self.bytes
            )),
        }
    }
}

impl Summary {
    /// The stream of this name.
    #[must_use]
    pub fn stream(&self, id: &str) -> Option<(usize, &Stream)> {
        self.streams.iter().enumerate().find(|(_, stream)| stream.description.id == id)
    }

    /// What was changed in earlier parts is said at the beginning of one that is read by itself.
    pub(super) fn begin_with(&mut self, part: &PartOf) {
        let host_ns = self.span_ns().map_or(self.start.host_ns, |[first, _]| first);
        let entry = |(stream, changed): (&String, &serde_json::Map<String, serde_json::Value>)| IncidentEntry {
            stream: stream.clone(),
            host_ns,
            incident: Incident::Adjusted { changed: changed.clone() },
        };
        let incidents = std::mem::take(&mut self.totals.incidents);
        let count = self.totals.incident_count.saturating_add(part.adjusted.len() as u64);
        for entry in part.adjusted.iter().map(entry).chain(incidents) {
            self.totals.note(entry);
        }
        self.totals.incident_count = count;
    }

    /// What is known to lack in the file since it was opened: places that are damaged, packets that are not there, its end.
    #[must_use]
    pub fn faults(&self) -> Vec<String> {
        let cut = (!self.complete && self.files.is_empty()).then(|| {
            format!(
                "it was not ended: intact up to byte {} of {}; `erfgs recover` completes it",
                self.whole_bytes, self.file_bytes
            )
        });
        let parts = self.files.iter().filter_map(FileSummary::fault);
        cut.into_iter().chain(parts).chain(self.damage.iter().cloned()).collect()
    }

    /// Host times of the first and the last packet, nanoseconds.
    #[must_use]
    pub fn span_ns(&self) -> Option<[i64; 2]> {
        let first = self.streams.iter().filter_map(|stream| stream.totals.first_host_ns).min()?;
        let last = self.streams.iter().filter_map(|stream| stream.totals.last_host_ns).max()?;
        Some([first, last])
    }
}
