//! Pictures inside a page, as data URIs.

use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};

/// [`jpeg_file`] in a data URI.
#[must_use]
pub fn jpeg(data: &[u8], width: u32, height: u32, quality: u8) -> Option<String> {
    jpeg_file(data, width, height, quality).map(|bytes| data_uri("image/jpeg", &bytes))
}

/// A picture of `width * height` pixels of red, green and blue as a JPEG file of `quality` (1 to 100); `None` where it has no
/// pixels, or more than the format holds.
#[must_use]
pub fn jpeg_file(data: &[u8], width: u32, height: u32, quality: u8) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let expected = width as usize * height as usize * 3;
    if expected == 0 || data.len() != expected {
        return None;
    }
    let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    encoder.write_image(data, width, height, ExtendedColorType::Rgb8).ok()?;
    Some(bytes)
}

/// Bytes of a media type (`image/png`) as a data URI.
#[must_use]
pub fn data_uri(media_type: &str, bytes: &[u8]) -> String {
    format!("data:{media_type};base64,{}", base64(bytes))
}

/// RFC 4648, with padding.
#[must_use]
pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let word = group.iter().enumerate().fold(0u32, |word, (at, &byte)| word | u32::from(byte) << (16 - 8 * at));
        for digit in 0..4 {
            let value = (word >> (18 - 6 * digit)) & 63;
            text.push(if digit <= group.len() { char::from(DIGITS[value as usize]) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        let texts = ["", "f", "fo", "foo", "foob", "fooba", "foobar"];
        let expected = ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"];
        assert_eq!(texts.map(|text| base64(text.as_bytes())), expected);
        assert_eq!(base64(&[0xff, 0xfe, 0xfd]), "//79");
    }

    #[test]
    fn a_picture_becomes_a_jpeg_and_one_that_is_none_nothing() {
        // The file begins ff d8 ff.
        assert!(jpeg(&[0; 60], 5, 4, 80).unwrap().starts_with("data:image/jpeg;base64,/9j/"));
        assert_eq!(jpeg(&[], 0, 4, 80), None);
        assert_eq!(jpeg(&[0; 7], 5, 4, 80), None);
        assert_eq!(jpeg(&[0; 210_000], 70_000, 1, 80), None);
    }
}
