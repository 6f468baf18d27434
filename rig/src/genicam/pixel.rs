//! Pixel formats by their names and codes in PFNC, and ours.

use erfgs_scene::pixel::{BayerOrder, PixelFormat, Samples};

/// Formats of PFNC: name, code, ours.
pub const FORMATS: [(&str, u32, PixelFormat); 22] = {
    use BayerOrder::{Bggr, Gbrg, Grbg, Rggb};
    use PixelFormat::Bayer;
    use Samples::{Bits8, Bits10, Bits12};
    [
        ("Mono8", 0x0108_0001, PixelFormat::Grey8),
        ("Mono10", 0x0110_0003, PixelFormat::Grey10),
        ("Mono12", 0x0110_0005, PixelFormat::Grey12),
        ("BayerGR8", 0x0108_0008, Bayer(Grbg, Bits8)),
        ("BayerRG8", 0x0108_0009, Bayer(Rggb, Bits8)),
        ("BayerGB8", 0x0108_000a, Bayer(Gbrg, Bits8)),
        ("BayerBG8", 0x0108_000b, Bayer(Bggr, Bits8)),
        ("BayerGR10", 0x0110_000c, Bayer(Grbg, Bits10)),
        ("BayerRG10", 0x0110_000d, Bayer(Rggb, Bits10)),
        ("BayerGB10", 0x0110_000e, Bayer(Gbrg, Bits10)),
        ("BayerBG10", 0x0110_000f, Bayer(Bggr, Bits10)),
        ("BayerGR12", 0x0110_0010, Bayer(Grbg, Bits12)),
        ("BayerRG12", 0x0110_0011, Bayer(Rggb, Bits12)),
        ("BayerGB12", 0x0110_0012, Bayer(Gbrg, Bits12)),
        ("BayerBG12", 0x0110_0013, Bayer(Bggr, Bits12)),
        ("RGB8", 0x0218_0014, PixelFormat::Rgb8),
        ("BGR8", 0x0218_0015, PixelFormat::Bgr8),
        ("YUV422_8_UYVY", 0x0210_001f, PixelFormat::Uyvy),
        ("YUV422_8", 0x0210_0032, PixelFormat::Yuyv),
        // As cameras named them before PFNC.
        ("RGB8Packed", 0x0218_0014, PixelFormat::Rgb8),
        ("BGR8Packed", 0x0218_0015, PixelFormat::Bgr8),
        ("YUV422Packed", 0x0210_001f, PixelFormat::Uyvy),
    ]
};

/// The names by which cameras may know a format; none where PFNC has it not, or we have not.
pub fn names_of(format: PixelFormat) -> impl Iterator<Item = &'static str> {
    FORMATS.iter().filter(move |(_, _, ours)| *ours == format).map(|(name, _, _)| *name)
}

/// The code of a format in the leader of a block.
#[must_use]
pub fn code_of(format: PixelFormat) -> Option<u32> {
    FORMATS.iter().find(|(_, _, ours)| *ours == format).map(|(_, code, _)| *code)
}

/// A camera's name of a format, and ours if there is one.
#[must_use]
pub fn told(name: &str) -> String {
    match FORMATS.iter().find(|(known, _, _)| *known == name) {
        Some((_, _, ours)) => format!("{name} (format = \"{ours}\")"),
        None => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_tell_how_many_bits_a_pixel_takes() {
        for (name, code, ours) in FORMATS {
            let bits = erfgs_scene::pixel::frame_bytes(ours, 8, 8).unwrap() / 8;
            assert_eq!((code >> 16 & 0xff) as usize, bits, "{name}");
            assert!(names_of(ours).any(|known| known == name) && code_of(ours) == Some(code));
        }
        assert_eq!(names_of(PixelFormat::Mjpeg).count(), 0);
        assert_eq!((told("BayerRG8").as_str(), told("Coord3D")), ("BayerRG8 (format = \"rggb8\")", "Coord3D".into()));
    }
}
