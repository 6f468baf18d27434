//! Frames of every encoding to small pictures.

use bytes::Bytes;
use erfgs_session::source::Encoding;
use image::{ImageFormat, ImageReader, Limits};

use super::picture::Picture;

/// Widest and highest image that is decoded.
const LARGEST: u32 = 8192;

/// A small picture of a frame; `None` if the payload is shorter than its encoding asks for, or damaged.
pub(super) fn picture(encoding: Encoding, width: u32, height: u32, payload: &Bytes) -> Option<Picture> {
    if encoding == Encoding::Mjpeg {
        return jpeg(payload);
    }
    if !(1..=LARGEST).contains(&width) || !(1..=LARGEST).contains(&height) {
        return None;
    }
    let pixels = width as usize * height as usize;
    let needs = match encoding {
        Encoding::Yuyv | Encoding::Grey10 | Encoding::Grey12 => 2 * pixels,
        Encoding::Nv12 => pixels + pixels / 2,
        Encoding::Grey8 => pixels,
        Encoding::Rgb8 => 3 * pixels,
        _ => return None,
    };
    if payload.len() < needs {
        return None;
    }
    let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
    let index = |x: u32, y: u32| y as usize * width as usize + x as usize;
    let deep = |at: usize, shift: u32| (u16::from_le_bytes([byte(2 * at), byte(2 * at + 1)]) >> shift).min(255) as u8;
    let grey = |value: u8| [value; 3];
    Some(match encoding {
        Encoding::Grey8 => Picture::shrunk(width, height, |x, y| grey(byte(index(x, y)))),
        Encoding::Grey10 => Picture::shrunk(width, height, |x, y| grey(deep(index(x, y), 2))),
        Encoding::Grey12 => Picture::shrunk(width, height, |x, y| grey(deep(index(x, y), 4))),
        Encoding::Rgb8 => Picture::shrunk(width, height, |x, y| std::array::from_fn(|c| byte(3 * index(x, y) + c))),
        Encoding::Yuyv => Picture::shrunk(width, height, |x, y| {
            let pair = 2 * index(x & !1, y);
            rgb(byte(2 * index(x, y)), byte(pair + 1), byte(pair + 3))
        }),
        _ => Picture::shrunk(width, height, |x, y| {
            let pair = pixels + (y / 2) as usize * width as usize + (x & !1) as usize;
            rgb(byte(index(x, y)), byte(pair), byte(pair + 1))
        }),
    })
}

fn jpeg(payload: &Bytes) -> Option<Picture> {
    let mut reader = ImageReader::with_format(std::io::Cursor::new(payload), ImageFormat::Jpeg);
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(LARGEST), Some(LARGEST));
    reader.limits(limits);
    let image = reader.decode().ok()?.into_rgb8();
    Some(Picture::shrunk(image.width(), image.height(), |x, y| image.get_pixel(x, y).0))
}

/// BT.601, studio range: what UVC cameras send.
fn rgb(y: u8, u: u8, v: u8) -> [u8; 3] {
    let (y, u, v) = (1.164 * (f32::from(y) - 16.0), f32::from(u) - 128.0, f32::from(v) - 128.0);
    [y + 1.596 * v, y - 0.392 * u - 0.813 * v, y + 2.017 * u].map(|value| value.clamp(0.0, 255.0) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(encoding: Encoding, payload: Vec<u8>) -> Option<Vec<u8>> {
        picture(encoding, 2, 2, &Bytes::from(payload)).map(|picture| picture.rgb[..3].to_vec())
    }

    #[test]
    fn every_encoding_shows_white_as_white_and_black_as_black() {
        let white = [
            (Encoding::Grey8, vec![255; 4]),
            (Encoding::Grey10, [0xff, 0x03].repeat(4)),
            (Encoding::Grey12, [0xff, 0x0f].repeat(4)),
            (Encoding::Rgb8, vec![255; 12]),
            (Encoding::Yuyv, [235, 128].repeat(4)),
            (Encoding::Nv12, [[235; 4].to_vec(), vec![128; 2]].concat()),
        ];
        for (encoding, payload) in white {
            let pixel = first(encoding, payload.clone()).unwrap();
            assert!(pixel.iter().all(|&value| value >= 253), "{encoding:?}: {pixel:?}");
            let black = payload
                .iter()
                .map(|&byte| {
                    if byte == 235 {
                        16
                    } else if byte == 128 {
                        128
                    } else {
                        0
                    }
                })
                .collect();
            let pixel = first(encoding, black).unwrap();
            assert!(pixel.iter().all(|&value| value <= 2), "{encoding:?}: {pixel:?}");
        }
    }

    #[test]
    fn red_is_red_in_both_orders_of_chroma() {
        // BT.601: red is Y 81, U 90, V 240.
        for (encoding, payload) in
            [(Encoding::Yuyv, [81, 90, 81, 240].repeat(2)), (Encoding::Nv12, vec![81, 81, 81, 81, 90, 240])]
        {
            let pixel = first(encoding, payload).unwrap();
            assert!(pixel[0] > 240 && pixel[1] < 15 && pixel[2] < 15, "{encoding:?}: {pixel:?}");
        }
    }

    #[test]
    fn short_and_damaged_frames_give_no_picture() {
        for encoding in
            [Encoding::Grey8, Encoding::Grey10, Encoding::Yuyv, Encoding::Nv12, Encoding::Rgb8, Encoding::Mjpeg]
        {
            assert_eq!(first(encoding, vec![1; 3]), None, "{encoding:?}");
            assert!(picture(encoding, 0, 0, &Bytes::new()).is_none(), "{encoding:?}");
            assert!(picture(encoding, u32::MAX, u32::MAX, &Bytes::from_static(&[0; 64])).is_none(), "{encoding:?}");
        }
    }
}
