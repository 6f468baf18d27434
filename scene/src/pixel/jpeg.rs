//! Motion JPEG frames: JPEG images, often without their Huffman tables.

use std::{borrow::Cow, io::Cursor, sync::OnceLock};

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::PixelError;
use crate::image::ImageRgb8;

pub(super) fn decode(payload: &[u8]) -> Result<ImageRgb8, PixelError> {
    let payload = with_huffman_tables(payload);
    let mut reader = ImageReader::with_format(Cursor::new(&payload[..]), ImageFormat::Jpeg);
    // Larger than any camera: a damaged header must not ask for all memory.
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(1 << 14);
    limits.max_image_height = Some(1 << 14);
    reader.limits(limits);
    let decoder = reader.into_decoder()?;
    let (width, height) = decoder.dimensions();
    if width as usize * height as usize > MOST_PIXELS_PER_BYTE * payload.len() {
        return Err(PixelError::Short { width, height, found: payload.len() });
    }
    let image = DynamicImage::from_decoder(decoder)?.into_rgb8();
    Ok(ImageRgb8 { width: image.width(), height: image.height(), data: image.into_raw() })
}

/// A block of 8 x 8 pixels takes a bit at least: the shortest code of its mean.
const MOST_PIXELS_PER_BYTE: usize = 8 * 64;

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

/// A Motion JPEG frame as a JPEG file. Many cameras leave the Huffman tables out and mean the standard ones (ITU-T T.81, annex K.3),
/// which few other decoders know: puts them in.
#[must_use]
pub fn with_huffman_tables(jpeg: &[u8]) -> Cow<'_, [u8]> {
    if !jpeg.starts_with(&SOI) || segments(jpeg).any(|(marker, ..)| marker == DHT) {
        return Cow::Borrowed(jpeg);
    }
    Cow::Owned([&SOI, standard_tables(), &jpeg[SOI.len()..]].concat())
}

/// The standard tables as DHT segments, as every plain encoder writes them.
fn standard_tables() -> &'static [u8] {
    static TABLES: OnceLock<Vec<u8>> = OnceLock::new();
    TABLES.get_or_init(|| {
        let plain = crate::image::jpeg(&[0; 3], 1, 1, 75).unwrap_or_default();
        segments(&plain)
            .filter(|(marker, ..)| *marker == DHT)
            .flat_map(|(_, start, end)| plain[start..end].to_vec())
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn jpeg(image: &ImageRgb8) -> Vec<u8> {
        crate::image::jpeg(&image.data, image.width, image.height, 95).unwrap()
    }

    fn gradient() -> ImageRgb8 {
        let data = (0..16 * 48).flat_map(|i| [(i % 48 * 5) as u8, (i / 48 * 15) as u8, 128]).collect();
        ImageRgb8 { width: 48, height: 16, data }
    }

    #[test]
    fn motion_jpeg_is_decoded_with_and_without_its_huffman_tables() {
        let image = gradient();
        let whole = jpeg(&image);
        let decoded = decode(&whole).unwrap();
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
        assert_eq!(decode(&bare).unwrap(), decoded);
    }

    #[test]
    fn a_size_that_the_bytes_cannot_fill_is_refused() {
        let mut bytes = jpeg(&gradient());
        let (_, start, _) = segments(&bytes).find(|(marker, ..)| *marker == 0xc0).unwrap();
        // Behind marker, length and precision: rows, then columns.
        bytes[start + 5..start + 9].copy_from_slice(&[0x3f, 0xff, 0x3f, 0xff]);
        let error = decode(&bytes).unwrap_err();
        assert!(matches!(error, PixelError::Short { width: 0x3fff, height: 0x3fff, .. }), "{error}");
        // One colour, most of a frame of it: the fewest bytes that a camera's picture takes.
        let plain = ImageRgb8 { width: 2048, height: 2048, data: vec![90; 2048 * 2048 * 3] };
        assert_eq!(decode(&jpeg(&plain)).unwrap().width, 2048);
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
            let _ = decode(&bytes);
        }
    }
}
