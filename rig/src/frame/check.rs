//! Whether a frame came whole.

use erfgs_scene::pixel::{PixelFormat, frame_bytes};

/// Whether a frame is cut: too short, or a JPEG image without beginning or end.
pub fn is_cut(encoding: PixelFormat, width: u32, height: u32, payload: &[u8]) -> bool {
    match frame_bytes(encoding, width, height) {
        Some(bytes) => payload.len() != bytes,
        None => {
            // Some cameras fill up with zeros after the end.
            let end = payload.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
            !payload.starts_with(&[0xff, 0xd8]) || !payload[..end].ends_with(&[0xff, 0xd9])
        }
    }
}

/// The rows of a frame without the padding that V4L2 drivers put between them; `None` if there is none.
#[cfg(any(target_os = "linux", test))]
pub fn without_padding(encoding: PixelFormat, width: u32, stride: u32, payload: &[u8]) -> Option<Vec<u8>> {
    let row = erfgs_scene::pixel::row_bytes(encoding, width)?;
    let stride = stride as usize;
    if stride <= row {
        return None;
    }
    let rows = payload.chunks(stride).filter(|chunk| chunk.len() >= row);
    Some(rows.flat_map(|chunk| &chunk[..row]).copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jpeg_image_needs_beginning_and_end() {
        let cut = |payload: &[u8]| is_cut(PixelFormat::Mjpeg, 640, 480, payload);
        assert!(!cut(&[0xff, 0xd8, 1, 2, 0xff, 0xd9]));
        assert!(!cut(&[0xff, 0xd8, 1, 2, 0xff, 0xd9, 0, 0]));
        assert!(cut(&[0xff, 0xd8, 1, 2, 0xff]));
        assert!(cut(&[1, 2, 0xff, 0xd9]));
        assert!(cut(&[]));
        assert!(is_cut(PixelFormat::Yuyv, 2, 1, &[0; 3]));
        assert!(!is_cut(PixelFormat::Yuyv, 2, 1, &[0; 4]));
    }

    #[test]
    fn every_other_frame_has_one_length() {
        let bytes = |encoding: PixelFormat| match encoding.name().trim_start_matches(char::is_alphabetic) {
            _ if [PixelFormat::Yuyv, PixelFormat::Uyvy].contains(&encoding) => 128,
            _ if [PixelFormat::Rgb8, PixelFormat::Bgr8].contains(&encoding) => 192,
            _ if encoding == PixelFormat::Nv12 => 96,
            "8" => 64,
            "10" | "12" => 128,
            "10p" | "10lsb" => 80,
            _ => 96,
        };
        for encoding in PixelFormat::all().filter(|&encoding| encoding != PixelFormat::Mjpeg) {
            let whole = vec![0; bytes(encoding)];
            assert!(!is_cut(encoding, 8, 8, &whole), "{encoding}");
            assert!(
                is_cut(encoding, 8, 8, &whole[1..]) && is_cut(encoding, 8, 8, &[&whole[..], &[0]].concat()),
                "{encoding}"
            );
        }
    }

    #[test]
    fn padding_between_rows_is_taken_out() {
        let padded = [1, 2, 3, 4, 0, 0, 5, 6, 7, 8, 0, 0];
        assert_eq!(without_padding(PixelFormat::Yuyv, 2, 6, &padded), Some(vec![1, 2, 3, 4, 5, 6, 7, 8]));
        assert_eq!(without_padding(PixelFormat::Grey8, 4, 6, &padded[..10]), Some(vec![1, 2, 3, 4, 5, 6, 7, 8]));
        assert_eq!(without_padding(PixelFormat::Grey8, 6, 6, &padded), None);
        assert_eq!(without_padding(PixelFormat::Mjpeg, 6, 0, &padded), None);
        assert_eq!(without_padding(PixelFormat::Grey10Packed, 4, 6, &padded), Some(vec![1, 2, 3, 4, 0, 5, 6, 7, 8, 0]));
        // Two rows of luma, one of chroma.
        assert_eq!(
            without_padding(PixelFormat::Nv12, 2, 3, &[1, 2, 0, 3, 4, 0, 5, 6, 0]),
            Some(vec![1, 2, 3, 4, 5, 6])
        );
    }
}
