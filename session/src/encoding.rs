//! How the payloads of a stream are encoded, and the names by which recordings and rigs know that.

use std::{fmt, str::FromStr};

use erfgs_events::EventEncoding;
use erfgs_scene::pixel::PixelFormat;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How the payloads of a stream are to be read. Written as its [`Encoding::name`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// Pieces of a stream of events.
    Events(EventEncoding),
    /// Frames, each a packet.
    Frames(PixelFormat),
    /// Lines of the trigger board's protocol (`rig/firmware/PROTOCOL.md`), as received.
    TriggerLines,
}

/// A name that no encoding has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no encoding '{name}'; there are {}", names(Encoding::all()))]
pub struct UnknownEncoding {
    /// What was given.
    pub name: String,
}

/// The names of encodings in a sentence: `mjpeg, yuyv, uyvy`.
pub fn names(encodings: impl Iterator<Item = Encoding>) -> String {
    encodings.map(Encoding::name).collect::<Vec<_>>().join(", ")
}

impl Encoding {
    /// All encodings.
    pub fn all() -> impl Iterator<Item = Self> {
        let events = EventEncoding::ALL.iter().copied().map(Self::Events);
        events.chain([Self::TriggerLines]).chain(PixelFormat::all().map(Self::Frames))
    }

    /// The name in recordings, topics and `RIG.toml`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Events(encoding) => encoding.name(),
            Self::Frames(format) => format.name(),
            Self::TriggerLines => "trigger-lines",
        }
    }

    /// How events are encoded, where a packet is a piece of a stream of them.
    #[must_use]
    pub fn events(self) -> Option<EventEncoding> {
        if let Self::Events(encoding) = self { Some(encoding) } else { None }
    }

    /// How the pixels lie, where a packet is one frame.
    #[must_use]
    pub fn frames(self) -> Option<PixelFormat> {
        if let Self::Frames(format) = self { Some(format) } else { None }
    }

    /// Whether a packet is a piece of a stream of events (and not one frame, or lines of a trigger board).
    #[must_use]
    pub fn is_events(self) -> bool {
        self.events().is_some()
    }

    /// Whether a stream of events may hold frames of the same pixels.
    #[must_use]
    pub fn has_sensor_frames(self) -> bool {
        self.events().is_some_and(EventEncoding::has_sensor_frames)
    }

    /// Whether a packet is one frame.
    #[must_use]
    pub fn is_frames(self) -> bool {
        self.frames().is_some()
    }

    /// Whether a packet is one frame without colour.
    #[must_use]
    pub fn is_grey(self) -> bool {
        self.frames().is_some_and(PixelFormat::is_grey)
    }
}

impl From<EventEncoding> for Encoding {
    fn from(encoding: EventEncoding) -> Self {
        Self::Events(encoding)
    }
}

impl From<PixelFormat> for Encoding {
    fn from(format: PixelFormat) -> Self {
        Self::Frames(format)
    }
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Encoding {
    type Err = UnknownEncoding;

    fn from_str(name: &str) -> Result<Self, UnknownEncoding> {
        Self::all().find(|encoding| encoding.name() == name).ok_or_else(|| UnknownEncoding { name: name.to_owned() })
    }
}

impl Serialize for Encoding {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for Encoding {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_encoding_is_found_again_by_its_name() {
        let all: Vec<_> = Encoding::all().collect();
        let names: BTreeSet<_> = all.iter().map(|encoding| encoding.name()).collect();
        assert_eq!((all.len(), names.len()), (58, 58), "no name is given twice");
        for encoding in all {
            let text = serde_json::to_string(&encoding).unwrap();
            assert_eq!(text, format!("\"{encoding}\""));
            assert_eq!(serde_json::from_str::<Encoding>(&text).unwrap(), encoding);
        }
        let error = "rggb9".parse::<Encoding>().unwrap_err().to_string();
        assert!(error.contains("no encoding 'rggb9'") && error.contains("gbrg12p"), "{error}");
    }

    #[test]
    fn the_names_of_earlier_recordings_stay() {
        let names = ["evt2", "evt21", "evt21-legacy", "evt3", "davis", "mjpeg", "yuyv", "nv12", "grey8", "grey10"];
        for name in names.into_iter().chain(["grey12", "rgb8", "trigger-lines"]) {
            assert_eq!(name.parse::<Encoding>().unwrap().name(), name);
        }
    }
}
