//! How the pixels of a frame lie in memory.

use std::fmt;

use serde::{Serialize, Serializer};

/// How the bytes of a frame are to be read. Written as its [`PixelFormat::name`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// One JPEG image for each frame.
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
    /// 10-bit grey, four pixels in five bytes ([`Samples::Lsb10`]).
    Grey10Lsb,
    /// 12-bit grey, two pixels in three bytes ([`Samples::Lsb12`]).
    Grey12Lsb,
    /// 10-bit grey, two pixels in three bytes ([`Samples::Gev10`]).
    Grey10Gev,
    /// 12-bit grey, two pixels in three bytes ([`Samples::Gev12`]).
    Grey12Gev,
    /// One colour a pixel, as it comes from behind the filters of a colour sensor.
    Bayer(BayerOrder, Samples),
    /// 8-bit RGB, three bytes a pixel.
    Rgb8,
    /// 8-bit BGR, three bytes a pixel.
    Bgr8,
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
    /// PFNC's `10p`: the bits of one value after the other, from the lowest of the first byte on; four values in five bytes.
    Lsb10,
    /// PFNC's `12p`: the same with two values in three bytes.
    Lsb12,
    /// GigE Vision's `10Packed`: of two pixels the upper 8 bits of the first, a byte with the lower 2 bits of the first (bits 1
    /// and 0) and of the second (5 and 4), the upper 8 bits of the second.
    Gev10,
    /// GigE Vision's `12Packed`: the same with the lower 4 bits of both in the byte between (3 to 0, 7 to 4).
    Gev12,
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
    pub const ALL: [Self; 9] = [
        Self::Bits8,
        Self::Bits10,
        Self::Bits12,
        Self::Packed10,
        Self::Packed12,
        Self::Lsb10,
        Self::Lsb12,
        Self::Gev10,
        Self::Gev12,
    ];
}

impl PixelFormat {
    /// All formats.
    pub fn all() -> impl Iterator<Item = Self> {
        const PLAIN: [PixelFormat; 15] = [
            PixelFormat::Mjpeg,
            PixelFormat::Yuyv,
            PixelFormat::Uyvy,
            PixelFormat::Nv12,
            PixelFormat::Rgb8,
            PixelFormat::Bgr8,
            PixelFormat::Grey8,
            PixelFormat::Grey10,
            PixelFormat::Grey12,
            PixelFormat::Grey10Packed,
            PixelFormat::Grey12Packed,
            PixelFormat::Grey10Lsb,
            PixelFormat::Grey12Lsb,
            PixelFormat::Grey10Gev,
            PixelFormat::Grey12Gev,
        ];
        let bayer = |samples| BayerOrder::ALL.map(|order| PixelFormat::Bayer(order, samples));
        PLAIN.into_iter().chain(Samples::ALL.into_iter().flat_map(bayer))
    }

    /// The name in recordings, topics and `RIG.toml`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Mjpeg => "mjpeg",
            Self::Yuyv => "yuyv",
            Self::Uyvy => "uyvy",
            Self::Nv12 => "nv12",
            Self::Grey8 => "grey8",
            Self::Grey10 => "grey10",
            Self::Grey12 => "grey12",
            Self::Grey10Packed => "grey10p",
            Self::Grey12Packed => "grey12p",
            Self::Grey10Lsb => "grey10lsb",
            Self::Grey12Lsb => "grey12lsb",
            Self::Grey10Gev => "grey10gev",
            Self::Grey12Gev => "grey12gev",
            Self::Bayer(order, samples) => {
                let names = match samples {
                    Samples::Bits8 => ["rggb8", "bggr8", "grbg8", "gbrg8"],
                    Samples::Bits10 => ["rggb10", "bggr10", "grbg10", "gbrg10"],
                    Samples::Bits12 => ["rggb12", "bggr12", "grbg12", "gbrg12"],
                    Samples::Packed10 => ["rggb10p", "bggr10p", "grbg10p", "gbrg10p"],
                    Samples::Packed12 => ["rggb12p", "bggr12p", "grbg12p", "gbrg12p"],
                    Samples::Lsb10 => ["rggb10lsb", "bggr10lsb", "grbg10lsb", "gbrg10lsb"],
                    Samples::Lsb12 => ["rggb12lsb", "bggr12lsb", "grbg12lsb", "gbrg12lsb"],
                    Samples::Gev10 => ["rggb10gev", "bggr10gev", "grbg10gev", "gbrg10gev"],
                    Samples::Gev12 => ["rggb12gev", "bggr12gev", "grbg12gev", "gbrg12gev"],
                };
                names[order as usize]
            }
            Self::Rgb8 => "rgb8",
            Self::Bgr8 => "bgr8",
        }
    }

    /// Whether frames have no colour.
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
            Self::Grey10Lsb => Some(Samples::Lsb10),
            Self::Grey12Lsb => Some(Samples::Lsb12),
            Self::Grey10Gev => Some(Samples::Gev10),
            Self::Grey12Gev => Some(Samples::Gev12),
            Self::Bayer(_, samples) => Some(samples),
            _ => None,
        }
    }
}

impl Serialize for PixelFormat {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orders_name_spells_its_colours() {
        for order in BayerOrder::ALL {
            let spelled: String = [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(x, y)| ['r', 'g', 'b'][order.colour(x + 4, y + 2)])
                .iter()
                .collect();
            assert_eq!(PixelFormat::Bayer(order, Samples::Bits8).name(), format!("{spelled}8"));
        }
    }
}
