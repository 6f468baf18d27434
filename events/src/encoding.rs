//! How devices encode a stream of events.

use std::fmt;

/// How the bytes of a stream of events are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(not(feature = "aedat4"), non_exhaustive)]
pub enum EventEncoding {
    /// Prophesee EVT 2.0: 32-bit little-endian words.
    Evt2,
    /// Prophesee EVT 2.1: 64-bit little-endian words.
    Evt21,
    /// EVT 2.1 with the 32-bit halves of every word swapped, as the IMX636 sends it.
    Evt21Legacy,
    /// Prophesee EVT 3.0: 16-bit little-endian words.
    Evt3,
    /// iniVation DAVIS: 16-bit little-endian words of events, frames, inertial samples and external edges.
    Davis,
    /// Whole packets of AEDAT 4, each an LZ4 frame, of the streams 0 (events), 1 (frames), 2 (inertial samples) and 3
    /// (triggers), without the header of a file: how event files without the words of a device lie in a session. There with
    /// the feature `aedat4`.
    #[cfg(feature = "aedat4")]
    Aedat4,
}

impl EventEncoding {
    /// All encodings.
    pub const ALL: &'static [Self] = &[
        Self::Evt2,
        Self::Evt21,
        Self::Evt21Legacy,
        Self::Evt3,
        Self::Davis,
        #[cfg(feature = "aedat4")]
        Self::Aedat4,
    ];

    /// The name in recordings, topics and `RIG.toml`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Evt2 => "evt2",
            Self::Evt21 => "evt21",
            Self::Evt21Legacy => "evt21-legacy",
            Self::Evt3 => "evt3",
            Self::Davis => "davis",
            #[cfg(feature = "aedat4")]
            Self::Aedat4 => "aedat4",
        }
    }

    /// Whether a stream may hold frames of the same pixels.
    #[must_use]
    pub fn has_sensor_frames(self) -> bool {
        match self {
            Self::Davis => true,
            #[cfg(feature = "aedat4")]
            Self::Aedat4 => true,
            _ => false,
        }
    }
}

impl fmt::Display for EventEncoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
