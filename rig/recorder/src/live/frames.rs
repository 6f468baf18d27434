//! Frames of every encoding to small pictures.

use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::pixel::{self, BayerOrder, FrameFormat, Samples, frame_bytes, yuv_to_rgb};
use erfgs_session::source::Description;

use super::picture::Picture;

/// Widest and highest image that is decoded.
const LARGEST: u32 = 8192;

/// A picture of a frame, at most `widest` wide; `None` if the payload is shorter than its encoding asks for, or damaged.
pub(super) fn picture(description: &Description, payload: &[u8], widest: u32) -> Option<Picture> {
    let format = description.frame_format()?;
    let FrameFormat { pixels, width, height, ref look } = format;
    if pixels == PixelFormat::Mjpeg {
        let image = pixel::decode(pixels, width, height, payload).ok()?;
        return Some(Picture::shrunk(image.width, image.height, widest, |x, y| image.pixel(x, y)));
    }
    if width > LARGEST || height > LARGEST || pixel::check_size(pixels, width, height).is_err() {
        return None;
    }
    let payload = payload.get(..frame_bytes(pixels, width, height)?)?;
    let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
    let index = |x: u32, y: u32| y as usize * width as usize + x as usize;
    Some(match (pixels, pixels.samples()) {
        (PixelFormat::Bayer(order, samples), _) => binned(&format, order, samples, payload, widest),
        (_, Some(samples)) => {
            let levels = look.levels(pixels, 1);
            Picture::shrunk(width, height, widest, |x, y| [levels[usize::from(samples.at(payload, index(x, y)))]; 3])
        }
        (PixelFormat::Rgb8, _) => {
            Picture::shrunk(width, height, widest, |x, y| std::array::from_fn(|c| byte(3 * index(x, y) + c)))
        }
        (PixelFormat::Bgr8, _) => {
            Picture::shrunk(width, height, widest, |x, y| std::array::from_fn(|c| byte(3 * index(x, y) + 2 - c)))
        }
        (PixelFormat::Yuyv, _) => Picture::shrunk(width, height, widest, |x, y| {
            let pair = 2 * index(x & !1, y);
            yuv_to_rgb(byte(2 * index(x, y)), byte(pair + 1), byte(pair + 3))
        }),
        (PixelFormat::Uyvy, _) => Picture::shrunk(width, height, widest, |x, y| {
            let pair = 2 * index(x & !1, y);
            yuv_to_rgb(byte(2 * index(x, y) + 1), byte(pair), byte(pair + 2))
        }),
        _ => Picture::shrunk(width, height, widest, |x, y| {
            let pair = width as usize * (height + y / 2) as usize + (x & !1) as usize;
            yuv_to_rgb(byte(index(x, y)), byte(pair), byte(pair + 1))
        }),
    })
}

/// A Bayer frame at half its size: two by two pixels hold a red, a blue and two greens.
fn binned(format: &FrameFormat, order: BayerOrder, samples: Samples, payload: &[u8], widest: u32) -> Picture {
    let FrameFormat { pixels, width, height, ref look } = *format;
    let levels: [Vec<u8>; 3] = std::array::from_fn(|colour| look.levels(pixels, colour));
    Picture::shrunk(width / 2, height / 2, widest, |x, y| {
        let mut sums = [0; 3];
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let at = (2 * y as usize + dy) * width as usize + 2 * x as usize + dx;
            sums[order.colour(dx, dy)] += samples.at(payload, at);
        }
        let values = [sums[0], sums[1] / 2, sums[2]];
        std::array::from_fn(|colour| levels[colour][usize::from(values[colour])])
    })
}

#[cfg(test)]
mod tests {
    use super::super::picture::WIDEST;
    use super::*;

    fn description(encoding: PixelFormat, width: u32, height: u32) -> Description {
        let (id, model, serial, settings) = ("cam".into(), String::new(), String::new(), serde_json::Map::new());
        let encoding = encoding.into();
        Description { id, model, serial, encoding, width, height, start_order: 0, settings }
    }

    fn first(encoding: PixelFormat, payload: Vec<u8>) -> Option<Vec<u8>> {
        picture(&description(encoding, 4, 2), &payload, WIDEST).map(|picture| picture.rgb[..3].to_vec())
    }

    #[test]
    fn every_encoding_shows_white_as_white_and_black_as_black() {
        let yuv = [
            (PixelFormat::Yuyv, [235, 128].repeat(8)),
            (PixelFormat::Uyvy, [128, 235].repeat(8)),
            (PixelFormat::Nv12, [[235; 8].to_vec(), vec![128; 4]].concat()),
        ];
        let plain = PixelFormat::all().filter(|&encoding| encoding != PixelFormat::Mjpeg);
        let plain = plain.filter(|encoding| yuv.iter().all(|(other, _)| other != encoding));
        let full = |encoding: PixelFormat| match encoding.samples() {
            Some(samples) => samples.pack(&[u16::MAX; 8]),
            None => vec![255; 24],
        };
        let white = yuv.clone().into_iter().chain(plain.map(|encoding| (encoding, full(encoding))));
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
        for (encoding, payload) in [
            (PixelFormat::Yuyv, [81, 90, 81, 240].repeat(4)),
            (PixelFormat::Uyvy, [90, 81, 240, 81].repeat(4)),
            (PixelFormat::Nv12, [[81; 8].to_vec(), [90, 240].repeat(2)].concat()),
            (PixelFormat::Rgb8, [255, 0, 0].repeat(8)),
            (PixelFormat::Bgr8, [0, 0, 255].repeat(8)),
        ] {
            let pixel = first(encoding, payload).unwrap();
            assert!(pixel[0] > 240 && pixel[1] < 15 && pixel[2] < 15, "{encoding:?}: {pixel:?}");
        }
    }

    #[test]
    fn two_by_two_pixels_of_a_mosaic_make_one_of_the_preview() {
        for (encoding, samples) in PixelFormat::all().filter_map(|encoding| Some((encoding, encoding.samples()?))) {
            let PixelFormat::Bayer(order, _) = encoding else { continue };
            // Red at half of white, green at a quarter, blue at none.
            let light = [0.5, 0.25, 0.0].map(|light| (light * f64::from(samples.white())) as u16);
            let values: Vec<u16> = (0..32).map(|at| light[order.colour(at % 8, at / 8)]).collect();
            let picture = picture(&description(encoding, 8, 4), &samples.pack(&values), WIDEST).unwrap();
            assert_eq!((picture.width, picture.height), (4, 2));
            let near = |pixel: &[u8]| pixel[0].abs_diff(188) <= 1 && pixel[1].abs_diff(137) <= 1 && pixel[2] == 0;
            assert!(picture.rgb.chunks(3).all(near), "{encoding}: {:?}", picture.rgb);
        }
    }

    #[test]
    fn short_and_damaged_frames_give_no_picture() {
        for encoding in PixelFormat::all() {
            assert_eq!(first(encoding, vec![1; 3]), None, "{encoding:?}");
            assert!(picture(&description(encoding, 0, 0), &[], WIDEST).is_none(), "{encoding:?}");
            assert!(picture(&description(encoding, u32::MAX, u32::MAX), &[0; 64], WIDEST).is_none(), "{encoding:?}");
        }
    }
}
