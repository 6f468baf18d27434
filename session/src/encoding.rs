//! How the payloads of a stream are encoded, and the names by which recordings and rigs know that.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How the payloads of a stream are to be read. Written as its [`Encoding::name`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
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
    /// (triggers), without the header of a file: how event files without the words of a device lie in a session.
    Aedat4,
    /// One JPEG image for each packet.
    Mjpeg,
    /// Packed 4:2:2, bytes Y0 U Y1 V.
    Yuyv,
    /// Packed 4:2:2, bytes U Y0 V Y1.
    Uyvy,
    /// A plane of Y, then a plane of interleaved UV at half resolution.
    Nv12,
    /// 8-bit grey, one byte a pixel.
    Grey8,
    /// 10-bit grey in the low bits of 16-bit little-endian words.
    Grey10,
    /// 12-bit grey in the low bits of 16-bit little-endian words.
    Grey12,
    /// 10-bit grey, four pixels in five bytes ([`Samples::Packed10`]).
    Grey10Packed,
    /// 12-bit grey, two pixels in three bytes ([`Samples::Packed12`]).
    Grey12Packed,
    /// One colour a pixel, as it comes from behind the filters of a colour sensor.
    Bayer(BayerOrder, Samples),
    /// 8-bit RGB, three bytes a pixel.
    Rgb8,
    /// 8-bit BGR, three bytes a pixel.
    Bgr8,
    /// Lines of the trigger board's protocol (`rig/firmware/PROTOCOL.md`), as received.
    TriggerLines,
}

/// Which colours the filters of a sensor pass: those of the first two pixels of the first row, then of the second row.
/// They repeat every two columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BayerOrder {
    /// Red, green; green, blue.
    Rggb,
    /// Blue, green; green, red.
    Bggr,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
}

/// How one value a pixel lies in memory. Rows begin at whole bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Samples {
    /// 8 bits, one byte each.
    Bits8,
    /// 10 bits in the low bits of 16-bit little-endian words.
    Bits10,
    /// 12 bits in the low bits of 16-bit little-endian words.
    Bits12,
    /// MIPI RAW10: of four pixels the upper 8 bits in a byte each, then a byte with the lower 2 bits of all, those of the
    /// first pixel lowest.
    Packed10,
    /// MIPI RAW12: of two pixels the upper 8 bits in a byte each, then a byte with the lower 4 bits of both, those of the
    /// first pixel lowest.
    Packed12,
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

impl BayerOrder {
    /// All orders.
    pub const ALL: [Self; 4] = [Self::Rggb, Self::Bggr, Self::Grbg, Self::Gbrg];

    /// The colour in a column and a row: 0 red, 1 green, 2 blue.
    #[must_use]
    pub fn colour(self, x: usize, y: usize) -> usize {
        let colours = match self {
            Self::Rggb => [0, 1, 1, 2],
            Self::Bggr => [2, 1, 1, 0],
            Self::Grbg => [1, 0, 2, 1],
            Self::Gbrg => [1, 2, 0, 1],
        };
        colours[2 * (y % 2) + x % 2]
    }
}

impl Samples {
    /// All layouts.
    pub const ALL: [Self; 5] = [Self::Bits8, Self::Bits10, Self::Bits12, Self::Packed10, Self::Packed12];
}

impl Encoding {
    /// All encodings.
    pub fn all() -> impl Iterator<Item = Self> {
        const PLAIN: [Encoding; 18] = [
            Encoding::Evt2,
            Encoding::Evt21,
            Encoding::Evt21Legacy,
            Encoding::Evt3,
            Encoding::Davis,
            Encoding::Aedat4,
            Encoding::TriggerLines,
            Encoding::Mjpeg,
            Encoding::Yuyv,
            Encoding::Uyvy,
            Encoding::Nv12,
            Encoding::Rgb8,
            Encoding::Bgr8,
            Encoding::Grey8,
            Encoding::Grey10,
            Encoding::Grey12,
            Encoding::Grey10Packed,
            Encoding::Grey12Packed,
        ];
        let bayer = |samples| BayerOrder::ALL.map(|order| Encoding::Bayer(order, samples));
        PLAIN.into_iter().chain(Samples::ALL.into_iter().flat_map(bayer))
    }

    /// The name in recordings, topics and `RIG.toml`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Evt2 => "evt2",
            Self::Evt21 => "evt21",
            Self::Evt21Legacy => "evt21-legacy",
            Self::Evt3 => "evt3",
            Self::Davis => "davis",
            Self::Aedat4 => "aedat4",
            Self::Mjpeg => "mjpeg",
            Self::Yuyv => "yuyv",
            Self::Uyvy => "uyvy",
            Self::Nv12 => "nv12",
            Self::Grey8 => "grey8",
            Self::Grey10 => "grey10",
            Self::Grey12 => "grey12",
            Self::Grey10Packed => "grey10p",
            Self::Grey12Packed => "grey12p",
            Self::Bayer(order, samples) => {
                let names = match samples {
                    Samples::Bits8 => ["rggb8", "bggr8", "grbg8", "gbrg8"],
                    Samples::Bits10 => ["rggb10", "bggr10", "grbg10", "gbrg10"],
                    Samples::Bits12 => ["rggb12", "bggr12", "grbg12", "gbrg12"],
                    Samples::Packed10 => ["rggb10p", "bggr10p", "grbg10p", "gbrg10p"],
                    Samples::Packed12 => ["rggb12p", "bggr12p", "grbg12p", "gbrg12p"],
                };
                names[order as usize]
            }
            Self::Rgb8 => "rgb8",
            Self::Bgr8 => "bgr8",
            Self::TriggerLines => "trigger-lines",
        }
    }

    /// Whether a packet is a piece of a stream of events (and not one frame, or lines of a trigger board).
    #[must_use]
    pub fn is_events(self) -> bool {
        matches!(self, Self::Evt2 | Self::Evt21 | Self::Evt21Legacy | Self::Evt3 | Self::Davis | Self::Aedat4)
    }

    /// Whether a stream of events may hold frames of the same pixels.
    #[must_use]
    pub fn has_sensor_frames(self) -> bool {
        matches!(self, Self::Davis | Self::Aedat4)
    }

    /// Whether a packet is one frame.
    #[must_use]
    pub fn is_frames(self) -> bool {
        !self.is_events() && self != Self::TriggerLines
    }

    /// Whether a packet is one frame without colour.
    #[must_use]
    pub fn is_grey(self) -> bool {
        self.samples().is_some() && !matches!(self, Self::Bayer(..))
    }

    /// How the values of a frame lie in memory, if it has one value a pixel (grey and Bayer).
    #[must_use]
    pub fn samples(self) -> Option<Samples> {
        match self {
            Self::Grey8 => Some(Samples::Bits8),
            Self::Grey10 => Some(Samples::Bits10),
            Self::Grey12 => Some(Samples::Bits12),
            Self::Grey10Packed => Some(Samples::Packed10),
            Self::Grey12Packed => Some(Samples::Packed12),
            Self::Bayer(_, samples) => Some(samples),
            _ => None,
        }
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
        assert_eq!((all.len(), names.len()), (38, 38), "no name is given twice");
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

    #[test]
    fn an_orders_name_spells_its_colours() {
        for order in BayerOrder::ALL {
            let spelled: String = [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(x, y)| ['r', 'g', 'b'][order.colour(x + 4, y + 2)])
                .iter()
                .collect();
            assert_eq!(Encoding::Bayer(order, Samples::Bits8).name(), format!("{spelled}8"));
        }
    }
}
