//! Frames as cameras send them to RGB: YUYV, NV12, grey of 8, 10 and 12 bits, RGB, Motion JPEG.
//!
//! YUV is taken as BT.601 with Y from 16 to 235, the default of the USB Video Class (UVC 1.5, section 3.9.2.6). Chroma
//! is repeated, not interpolated: these pictures are for looking, and for exports that keep the camera's resolution.

use std::{borrow::Cow, io::Cursor, sync::OnceLock};

use image::{ImageFormat, ImageReader};

use crate::{image::ImageRgb8, source::Encoding};

/// Why a frame cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum PixelError {
    /// The stream has no frames.
    #[error("a stream of {0:?} has no frames to decode")]
    NoFrame(Encoding),
    /// Columns or rows are zero, odd where colour is shared by two pixels, or too many.
    #[error("a frame of {width} x {height} pixels cannot be {encoding:?}; check the recorded size of the stream")]
    Size {
        /// How the frame is said to be encoded.
        encoding: Encoding,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The frame is cut, or of another size than the stream says.
    #[error(
        "a frame of {width} x {height} pixels in {encoding:?} has {expected} bytes, this one {found}: it is cut, or damaged"
    )]
    Length {
        /// How the frame is said to be encoded.
        encoding: Encoding,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes that it should have.
        expected: usize,
        /// Bytes that it has.
        found: usize,
    },
    /// The JPEG image is damaged.
    #[error("a Motion JPEG frame cannot be decoded: {0}")]
    Jpeg(#[from] image::ImageError),
}

/// Bytes of a frame; `None` for Motion JPEG, whose frames have no fixed size, and for streams without frames.
#[must_use]
pub fn frame_bytes(encoding: Encoding, width: u32, height: u32) -> Option<usize> {
    let pixels = width as usize * height as usize;
    match encoding {
        Encoding::Yuyv | Encoding::Grey10 | Encoding::Grey12 => Some(2 * pixels),
        Encoding::Nv12 => Some(pixels + pixels / 2),
        Encoding::Grey8 => Some(pixels),
        Encoding::Rgb8 => Some(3 * pixels),
        Encoding::Mjpeg
        | Encoding::Evt2
        | Encoding::Evt21
        | Encoding::Evt21Legacy
        | Encoding::Evt3
        | Encoding::Davis
        | Encoding::TriggerLines => None,
    }
}

/// Decodes one frame. A JPEG image may have another size than the stream: its own is taken.
///
/// # Errors
/// If the frame is cut or damaged, or the stream has no frames.
pub fn decode(encoding: Encoding, width: u32, height: u32, payload: &[u8]) -> Result<ImageRgb8, PixelError> {
    if encoding == Encoding::Mjpeg {
        return decode_jpeg(payload);
    }
    if !encoding.is_frames() {
        return Err(PixelError::NoFrame(encoding));
    }
    let odd = match encoding {
        Encoding::Yuyv => !width.is_multiple_of(2),
        Encoding::Nv12 => !width.is_multiple_of(2) || !height.is_multiple_of(2),
        _ => false,
    };
    if width == 0 || height == 0 || odd || width > 1 << 16 || height > 1 << 16 {
        return Err(PixelError::Size { encoding, width, height });
    }
    let expected = frame_bytes(encoding, width, height).ok_or(PixelError::NoFrame(encoding))?;
    if payload.len() != expected {
        return Err(PixelError::Length { encoding, width, height, expected, found: payload.len() });
    }
    let data = match encoding {
        Encoding::Yuyv => payload.chunks_exact(4).flat_map(|p| two_pixels(p[0], p[2], p[1], p[3])).collect(),
        Encoding::Nv12 => nv12(width as usize, height as usize, payload),
        Encoding::Grey10 => payload.chunks_exact(2).flat_map(|p| grey(p, 2)).collect(),
        Encoding::Grey12 => payload.chunks_exact(2).flat_map(|p| grey(p, 4)).collect(),
        Encoding::Grey8 => payload.iter().flat_map(|&y| [y; 3]).collect(),
        _ => payload.to_vec(),
    };
    Ok(ImageRgb8 { width, height, data })
}

/// Two neighbours that share their chroma.
fn two_pixels(y0: u8, y1: u8, u: u8, v: u8) -> [u8; 6] {
    let ([r0, g0, b0], [r1, g1, b1]) = (rgb(y0, u, v), rgb(y1, u, v));
    [r0, g0, b0, r1, g1, b1]
}

/// BT.601, Y from 16 to 235, in 1/65536.
fn rgb(y: u8, u: u8, v: u8) -> [u8; 3] {
    let y = 76_309 * (i32::from(y) - 16);
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    let byte = |value: i32| ((value + 32_768) >> 16).clamp(0, 255) as u8;
    [byte(y + 104_597 * v), byte(y - 25_675 * u - 53_279 * v), byte(y + 132_201 * u)]
}

fn nv12(width: usize, height: usize, payload: &[u8]) -> Vec<u8> {
    let (luma, chroma) = payload.split_at(width * height);
    let rows = luma.chunks_exact(width).enumerate();
    rows.flat_map(|(row, luma)| {
        let chroma = &chroma[row / 2 * width..][..width];
        luma.chunks_exact(2).zip(chroma.chunks_exact(2)).flat_map(|(y, uv)| two_pixels(y[0], y[1], uv[0], uv[1]))
    })
    .collect()
}

/// A little-endian word of which the `shift` lowest bits are dropped; more than white is white.
fn grey(word: &[u8], shift: u32) -> [u8; 3] {
    [(u16::from_le_bytes([word[0], word[1]]) >> shift).min(255) as u8; 3]
}

fn decode_jpeg(payload: &[u8]) -> Result<ImageRgb8, PixelError> {
    let payload = with_huffman_tables(payload);
    let mut reader = ImageReader::with_format(Cursor::new(&payload[..]), ImageFormat::Jpeg);
    // Larger than any camera: a damaged header must not ask for all memory.
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(1 << 14);
    limits.max_image_height = Some(1 << 14);
    reader.limits(limits);
    let image = reader.decode()?.into_rgb8();
    Ok(ImageRgb8 { width: image.width(), height: image.height(), data: image.into_raw() })
}

const SOI: [u8; 2] = [0xff, 0xd8];
const DHT: u8 = 0xc4;
const SOS: u8 = 0xda;

/// The segments of a JPEG header as (marker, start, end), up to the start of the scan.
fn segments(jpeg: &[u8]) -> impl Iterator<Item = (u8, usize, usize)> + '_ {
    let mut at = SOI.len();
    std::iter::from_fn(move || {
        let &[0xff, marker, high, low] = jpeg.get(at..at + 4)? else { return None };
        let end = at + 2 + usize::from(u16::from_be_bytes([high, low]));
        let segment = (marker, at, end);
        at = if marker == SOS { jpeg.len() } else { end };
        (end <= jpeg.len()).then_some(segment)
    })
}

/// Many cameras leave the Huffman tables out and mean the standard ones (ITU-T T.81, annex K.3): puts them in.
fn with_huffman_tables(jpeg: &[u8]) -> Cow<'_, [u8]> {
    if !jpeg.starts_with(&SOI) || segments(jpeg).any(|(marker, ..)| marker == DHT) {
        return Cow::Borrowed(jpeg);
    }
    Cow::Owned([&SOI, standard_tables(), &jpeg[SOI.len()..]].concat())
}

/// The standard tables as DHT segments, as every plain encoder writes them.
fn standard_tables() -> &'static [u8] {
    static TABLES: OnceLock<Vec<u8>> = OnceLock::new();
    TABLES.get_or_init(|| {
        let mut plain = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new(&mut plain);
        match image::ImageEncoder::write_image(encoder, &[0; 3], 1, 1, image::ExtendedColorType::Rgb8) {
            Ok(()) => segments(&plain)
                .filter(|(marker, ..)| *marker == DHT)
                .flat_map(|(_, start, end)| plain[start..end].to_vec())
                .collect(),
            Err(_) => Vec::new(),
        }
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FIXED: [Encoding; 6] =
        [Encoding::Yuyv, Encoding::Nv12, Encoding::Grey8, Encoding::Grey10, Encoding::Grey12, Encoding::Rgb8];

    fn pixels(encoding: Encoding, width: u32, height: u32, payload: &[u8]) -> Vec<u8> {
        decode(encoding, width, height, payload).unwrap().data
    }

    fn jpeg(image: &ImageRgb8) -> Vec<u8> {
        let mut bytes = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
        image::ImageEncoder::write_image(
            encoder,
            &image.data,
            image.width,
            image.height,
            image::ExtendedColorType::Rgb8,
        )
        .unwrap();
        bytes
    }

    fn gradient() -> ImageRgb8 {
        let data = (0..16 * 48).flat_map(|i| [(i % 48 * 5) as u8, (i / 48 * 15) as u8, 128]).collect();
        ImageRgb8 { width: 48, height: 16, data }
    }

    #[test]
    fn the_colour_bars_of_bt_601_come_out_as_rgb() {
        // 100 % bars: Y, Cb, Cr as in ITU-R BT.601, table of the 8-bit values.
        let bars = [
            ([235, 128, 128], [255, 255, 255]),
            ([210, 16, 146], [255, 255, 0]),
            ([170, 166, 16], [0, 255, 255]),
            ([145, 54, 34], [0, 255, 0]),
            ([106, 202, 222], [255, 0, 255]),
            ([81, 90, 240], [255, 0, 0]),
            ([41, 240, 110], [0, 0, 255]),
            ([16, 128, 128], [0, 0, 0]),
        ];
        for ([y, u, v], expected) in bars {
            let close = |found: &[u8]| found.iter().zip(expected).all(|(a, b): (&u8, u8)| a.abs_diff(b) <= 2);
            let yuyv = pixels(Encoding::Yuyv, 2, 1, &[y, u, y, v]);
            assert!(yuyv.chunks(3).all(close), "{yuyv:?} is not {expected:?}");
            let nv12 = pixels(Encoding::Nv12, 2, 2, &[y, y, y, y, u, v]);
            assert!(nv12.chunks(3).all(close), "{nv12:?} is not {expected:?}");
        }
    }

    #[test]
    fn chroma_of_nv12_belongs_to_its_two_by_two_pixels() {
        let luma = [81; 16];
        // Red at the left, blue-ish elsewhere, in the lower half only.
        let chroma = [128, 128, 128, 128, 90, 240, 240, 110];
        let data = pixels(Encoding::Nv12, 4, 4, &[&luma[..], &chroma].concat());
        let pixel = |x: usize, y: usize| &data[3 * (4 * y + x)..][..3];
        assert_eq!(pixel(0, 0), pixel(3, 1));
        assert!(pixel(0, 2)[0] > 250 && pixel(1, 3)[0] > 250);
        assert!(pixel(2, 2)[2] > 250 && pixel(3, 3)[2] > 250);
    }

    #[test]
    fn deep_grey_keeps_its_upper_bits() {
        assert_eq!(pixels(Encoding::Grey10, 2, 1, &[0xff, 0x03, 0x04, 0x00]), [255, 255, 255, 1, 1, 1]);
        assert_eq!(pixels(Encoding::Grey12, 2, 1, &[0xff, 0x0f, 0x10, 0x00]), [255, 255, 255, 1, 1, 1]);
        assert_eq!(pixels(Encoding::Grey10, 1, 1, &[0xff, 0xff]), [255; 3], "stray upper bits are no wrap");
    }

    #[test]
    fn motion_jpeg_is_decoded_with_and_without_its_huffman_tables() {
        let image = gradient();
        let whole = jpeg(&image);
        let decoded = decode(Encoding::Mjpeg, 48, 16, &whole).unwrap();
        assert_eq!((decoded.width, decoded.height), (48, 16));
        let worst = decoded.data.iter().zip(&image.data).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst <= Some(12), "{worst:?}");

        let mut bare = SOI.to_vec();
        let mut scan = 0;
        for (marker, start, end) in segments(&whole) {
            if marker == SOS {
                scan = start;
            } else if marker != DHT {
                bare.extend(&whole[start..end]);
            }
        }
        bare.extend(&whole[scan..]);
        assert!(bare.len() + 400 < whole.len(), "the tables are left out");
        assert_eq!(decode(Encoding::Mjpeg, 48, 16, &bare).unwrap(), decoded);
    }

    #[test]
    fn cut_frames_are_refused_with_both_lengths() {
        for encoding in FIXED {
            let whole = vec![0; frame_bytes(encoding, 4, 2).unwrap()];
            assert!(decode(encoding, 4, 2, &whole).is_ok());
            let error = decode(encoding, 4, 2, &whole[1..]).unwrap_err().to_string();
            assert!(error.contains(&format!("has {} bytes, this one {}", whole.len(), whole.len() - 1)), "{error}");
        }
        assert!(matches!(decode(Encoding::Yuyv, 3, 1, &[0; 6]), Err(PixelError::Size { .. })));
        assert!(matches!(decode(Encoding::Nv12, 2, 1, &[0; 3]), Err(PixelError::Size { .. })));
        assert!(matches!(decode(Encoding::Evt3, 2, 1, &[0; 3]), Err(PixelError::NoFrame(_))));
        assert!(decode(Encoding::Mjpeg, 2, 1, b"").is_err());
    }

    proptest! {
        #[test]
        fn damaged_jpeg_is_an_error_or_a_picture(
            place in any::<prop::sample::Index>(),
            wrong in any::<u8>(),
            cut in any::<prop::sample::Index>(),
        ) {
            let mut bytes = jpeg(&gradient());
            let place = place.index(bytes.len());
            bytes[place] = wrong;
            bytes.truncate(cut.index(bytes.len()) + 1);
            let _ = decode(Encoding::Mjpeg, 48, 16, &bytes);
        }

        #[test]
        fn every_frame_of_the_right_length_is_decoded(
            encoding in prop::sample::select(&FIXED[..]),
            (width, height) in (1..6u32, 1..6u32),
            byte in any::<u8>(),
        ) {
            let payload = vec![byte; frame_bytes(encoding, 2 * width, 2 * height).unwrap()];
            let image = decode(encoding, 2 * width, 2 * height, &payload).unwrap();
            prop_assert_eq!(image.data.len(), 3 * 4 * (width * height) as usize);
        }
    }
}
