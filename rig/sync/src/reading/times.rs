//! From the times of devices to the session's.

use std::collections::HashMap;

use erfgs_session::{
    clock::{EpochCursor, Exposure},
    container::HostClock,
};

use crate::Synchronisation;

/// The clocks of a recording.
pub(super) enum Clocks {
    /// The file of one event camera.
    OfFile(HostClock),
    /// A session.
    Fitted(Synchronisation),
}

impl Clocks {
    /// Follows the clock of an event camera from the beginning of its stream.
    pub fn dater(&self, id: &str) -> Dater {
        match self {
            Self::OfFile(clock) => Dater(At::File(*clock)),
            Self::Fitted(sync) => {
                let epochs = sync.stream(id).map(|stream| stream.epochs.clone()).unwrap_or_default();
                Dater(At::Epochs(epochs.into_cursor()))
            }
        }
    }

    /// The exposure of each frame of a camera, by the number of its packet.
    pub fn exposures(&self, id: &str) -> HashMap<u64, Exposure> {
        match self {
            Self::OfFile(_) => HashMap::new(),
            Self::Fitted(sync) => sync.stream(id).map(|stream| stream.frames()).unwrap_or_default(),
        }
    }
}

/// Where a decoder is on the clock of its stream. A sink passes on what it is told: packets and breaks.
pub struct Dater(At);

enum At {
    File(HostClock),
    Epochs(EpochCursor<'static>),
}

impl Dater {
    /// What is decoded next came in the packet of this number.
    pub fn packet(&mut self, sequence: u64) {
        if let At::Epochs(cursor) = &mut self.0 {
            cursor.packet(sequence);
        }
    }

    /// The decoder told a break; the device's time goes on from `t_us`.
    pub fn discontinuity(&mut self, t_us: u64) {
        match &mut self.0 {
            At::File(clock) => clock.discontinuity(t_us),
            At::Epochs(cursor) => cursor.discontinuity(),
        }
    }

    /// Session time, nanoseconds; `None` where nothing dates the stream.
    pub fn session_ns(&mut self, t_us: u64) -> Option<i64> {
        match &mut self.0 {
            At::File(clock) => Some(clock.host_ns(t_us)),
            At::Epochs(cursor) => cursor.session_ns(t_us),
        }
    }
}
