//! The formats of frames: their names in `RIG.toml`, and V4L2's four-character codes.

use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::pixel::{BayerOrder, Samples};
use erfgs_session::source::{Encoding, names};
use serde::{Deserialize, Deserializer, de::Error};

/// The four-character codes by which V4L2 knows an encoding, the usual one first (`linux/videodev2.h`); none where machine-vision
/// cameras alone have it.
#[must_use]
pub fn fourccs(encoding: PixelFormat) -> &'static [&'static [u8; 4]] {
    match encoding {
        PixelFormat::Mjpeg => &[b"MJPG", b"JPEG"],
        PixelFormat::Yuyv => &[b"YUYV"],
        PixelFormat::Uyvy => &[b"UYVY"],
        PixelFormat::Nv12 => &[b"NV12"],
        PixelFormat::Grey8 => &[b"GREY"],
        PixelFormat::Grey10 => &[b"Y10 "],
        PixelFormat::Grey12 => &[b"Y12 "],
        PixelFormat::Grey10Packed => &[b"Y10P"],
        PixelFormat::Grey12Packed => &[b"Y12P"],
        PixelFormat::Grey10Lsb | PixelFormat::Grey12Lsb | PixelFormat::Grey10Gev | PixelFormat::Grey12Gev => &[],
        PixelFormat::Rgb8 => &[b"RGB3"],
        PixelFormat::Bgr8 => &[b"BGR3"],
        PixelFormat::Bayer(order, samples) => match (samples, order) {
            (Samples::Bits8, BayerOrder::Rggb) => &[b"RGGB"],
            (Samples::Bits8, BayerOrder::Bggr) => &[b"BA81"],
            (Samples::Bits8, BayerOrder::Grbg) => &[b"GRBG"],
            (Samples::Bits8, BayerOrder::Gbrg) => &[b"GBRG"],
            (Samples::Bits10, BayerOrder::Rggb) => &[b"RG10"],
            (Samples::Bits10, BayerOrder::Bggr) => &[b"BG10"],
            (Samples::Bits10, BayerOrder::Grbg) => &[b"BA10"],
            (Samples::Bits10, BayerOrder::Gbrg) => &[b"GB10"],
            (Samples::Bits12, BayerOrder::Rggb) => &[b"RG12"],
            (Samples::Bits12, BayerOrder::Bggr) => &[b"BG12"],
            (Samples::Bits12, BayerOrder::Grbg) => &[b"BA12"],
            (Samples::Bits12, BayerOrder::Gbrg) => &[b"GB12"],
            (Samples::Packed10, BayerOrder::Rggb) => &[b"pRAA"],
            (Samples::Packed10, BayerOrder::Bggr) => &[b"pBAA"],
            (Samples::Packed10, BayerOrder::Grbg) => &[b"pgAA"],
            (Samples::Packed10, BayerOrder::Gbrg) => &[b"pGAA"],
            (Samples::Packed12, BayerOrder::Rggb) => &[b"pRCC"],
            (Samples::Packed12, BayerOrder::Bggr) => &[b"pBCC"],
            (Samples::Packed12, BayerOrder::Grbg) => &[b"pgCC"],
            (Samples::Packed12, BayerOrder::Gbrg) => &[b"pGCC"],
            (Samples::Lsb10 | Samples::Lsb12 | Samples::Gev10 | Samples::Gev12, _) => &[],
        },
    }
}

/// The encoding that a four-character code means.
#[must_use]
pub fn encoding_of(fourcc: u32) -> Option<PixelFormat> {
    PixelFormat::all().find(|&encoding| fourccs(encoding).iter().any(|code| u32::from_le_bytes(**code) == fourcc))
}

/// Reads the name of an encoding that a camera can send.
pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<PixelFormat, D::Error> {
    let name = String::deserialize(deserializer)?;
    let frames = || PixelFormat::all();
    let found = frames().find(|encoding| encoding.name() == name);
    found.ok_or_else(|| {
        D::Error::custom(format!("there is no format {name:?}; there are {}", names(frames().map(Encoding::from))))
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_frame_has_codes_of_its_own() {
        let codes: Vec<_> = PixelFormat::all().flat_map(fourccs).collect();
        assert_eq!((codes.len(), codes.iter().collect::<BTreeSet<_>>().len()), (32, 32));
        for encoding in PixelFormat::all() {
            let machine_vision = encoding.name().ends_with("lsb") || encoding.name().ends_with("gev");
            assert_eq!(fourccs(encoding).is_empty(), machine_vision, "{encoding}");
            for code in fourccs(encoding) {
                assert_eq!(encoding_of(u32::from_le_bytes(**code)), Some(encoding));
            }
        }
        assert_eq!(encoding_of(u32::from_le_bytes(*b"H264")), None);
    }
}
