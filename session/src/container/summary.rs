//! What a recording holds as a whole.

use super::{
    Stream,
    record::{SessionStart, Totals},
};

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
    /// Length of the file, bytes.
    pub file_bytes: u64,
    /// Up to here the file is whole, bytes: what lies behind is half a chunk, or the index.
    pub whole_bytes: u64,
    /// What is damaged in between, one message for each place.
    pub damage: Vec<String>,
    /// Encodings of events in the file that erfgs does not decode.
    pub unknown_encodings: Vec<String>,
    /// How many chunks the file has.
    pub chunks: usize,
}

impl Summary {
    /// The stream of this name.
    #[must_use]
    pub fn stream(&self, id: &str) -> Option<(usize, &Stream)> {
        self.streams.iter().enumerate().find(|(_, stream)| stream.description.id == id)
    }

    /// What is known to lack in the file since it was opened: places that are damaged, packets that are not there, its end.
    #[must_use]
    pub fn faults(&self) -> Vec<String> {
        let cut = (!self.complete).then(|| {
            format!(
                "it was not ended: intact up to byte {} of {}; `erfgs recover` completes it",
                self.whole_bytes, self.file_bytes
            )
        });
        cut.into_iter().chain(self.damage.iter().cloned()).collect()
    }

    /// Host times of the first and the last packet, nanoseconds.
    #[must_use]
    pub fn span_ns(&self) -> Option<[i64; 2]> {
        let first = self.streams.iter().filter_map(|stream| stream.totals.first_host_ns).min()?;
        let last = self.streams.iter().filter_map(|stream| stream.totals.last_host_ns).max()?;
        Some([first, last])
    }
}
