//! Pixel formats by their names and codes in PFNC, and ours.

use erfgs_scene::pixel::{BayerOrder, PixelFormat, Samples};

/// Formats of PFNC: name, code, ours.
pub const FORMATS: [(&str, u32, PixelFormat); 42] = {
    use BayerOrder::{Bggr, Gbrg, Grbg, Rggb};
    use PixelFormat::Bayer;
    use Samples::{Bits8, Bits10, Bits12, Gev10, Gev12, Lsb10, Lsb12};
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
        ("Mono10p", 0x010a_0046, PixelFormat::Grey10Lsb),
        ("Mono12p", 0x010c_0047, PixelFormat::Grey12Lsb),
        ("BayerGR10p", 0x010a_0056, Bayer(Grbg, Lsb10)),
        ("BayerGR12p", 0x010c_0057, Bayer(Grbg, Lsb12)),
        ("BayerRG10p", 0x010a_0058, Bayer(Rggb, Lsb10)),
        ("BayerRG12p", 0x010c_0059, Bayer(Rggb, Lsb12)),
        ("BayerGB10p", 0x010a_0054, Bayer(Gbrg, Lsb10)),
        ("BayerGB12p", 0x010c_0055, Bayer(Gbrg, Lsb12)),
        ("BayerBG10p", 0x010a_0052, Bayer(Bggr, Lsb10)),
        ("BayerBG12p", 0x010c_0053, Bayer(Bggr, Lsb12)),
        ("Mono10Packed", 0x010c_0004, PixelFormat::Grey10Gev),
        ("Mono12Packed", 0x010c_0006, PixelFormat::Grey12Gev),
        ("BayerGR10Packed", 0x010c_0026, Bayer(Grbg, Gev10)),
        ("BayerGR12Packed", 0x010c_002a, Bayer(Grbg, Gev12)),
        ("BayerRG10Packed", 0x010c_0027, Bayer(Rggb, Gev10)),
        ("BayerRG12Packed", 0x010c_002b, Bayer(Rggb, Gev12)),
        ("BayerGB10Packed", 0x010c_0028, Bayer(Gbrg, Gev10)),
        ("BayerGB12Packed", 0x010c_002c, Bayer(Gbrg, Gev12)),
        ("BayerBG10Packed", 0x010c_0029, Bayer(Bggr, Gev10)),
        ("BayerBG12Packed", 0x010c_002d, Bayer(Bggr, Gev12)),
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
pub fn both_names(name: &str) -> String {
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
        assert_eq!(
            (both_names("BayerRG8").as_str(), both_names("Coord3D")),
            ("BayerRG8 (format = \"rggb8\")", "Coord3D".into())
        );
    }
}
