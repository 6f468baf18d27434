//! Any bytes as a frame in any pixel format. A frame that can be shown has its size, in 8 and 16 bits and in linear light, which
//! agree with one another; what cannot is an error.
//!
//! The first bytes say the pixel format, the size, and what the recording says of the camera ([`look`]); the rest is the frame.

use std::sync::LazyLock;

use erfgs_scene::pixel::{self, FrameFormat, PixelFormat};
use erfgs_session::source::{Description, Encoding};

use crate::memory;

static FORMATS: LazyLock<Vec<PixelFormat>> = LazyLock::new(|| PixelFormat::all().collect());

/// Bytes before the frame.
const HEAD: usize = 6;

/// Sizes that cameras have, and ones that none has.
fn length(byte: u8) -> u32 {
    match byte {
        250.. => [0, u16::MAX.into(), 1 << 16, 1 << 17, 1 << 31, u32::MAX][usize::from(byte - 250)],
        _ => byte.into(),
    }
}

/// Bits 0 to 5 of `byte`: the black level; bit 6: the white balance; bit 7: nothing is said.
fn look(byte: u8) -> serde_json::Map<String, serde_json::Value> {
    let mut settings = serde_json::Map::new();
    if byte >> 7 == 0 {
        let balance = if byte >> 6 == 1 { [1.9, 1.0, 1.4] } else { [1.0; 3] };
        settings.insert("raw".into(), serde_json::json!({ "black_level": byte & 63, "white_balance": balance }));
    }
    settings
}

fn show(format: &FrameFormat, frame: &[u8]) {
    let [picture, deep, light] = [
        format.picture(frame).map(|image| (image.width, image.height, image.data.len())),
        format.deep_picture(frame).map(|image| (image.width, image.height, image.data.len())),
        format.light(frame).map(|image| {
            assert!(image.data.iter().all(|light| light.is_finite()));
            (image.width, image.height, image.data.len())
        }),
    ];
    let size = match (picture, deep, light) {
        (Ok(picture), Ok(deep), Ok(light)) => {
            assert_eq!((picture, picture), (deep, light));
            picture
        }
        (Err(error), Err(_), Err(_)) => {
            assert!(!error.to_string().is_empty());
            return;
        }
        other => panic!("a frame that can be shown in one way only: {other:?}"),
    };
    assert_eq!(size.2, 3 * size.0 as usize * size.1 as usize);
    if format.pixels != PixelFormat::Mjpeg {
        assert_eq!((size.0, size.1), (format.width, format.height));
    }
}

/// Checks one input.
pub fn frames(input: &[u8]) {
    let Some((&[pixels, width, height, raw_look, fit, _], frame)) = input.split_first_chunk::<HEAD>() else { return };
    let pixels = FORMATS[usize::from(pixels) % FORMATS.len()];
    let (width, height) = (length(width), length(height));
    let description = Description {
        id: "camera".into(),
        model: String::new(),
        serial: String::new(),
        encoding: Encoding::Frames(pixels),
        width,
        height,
        start_order: 0,
        settings: look(raw_look),
    };
    let format = description.frame_format().expect("a stream of frames");
    let mut frame = frame.to_vec();
    // Mostly as long as it should be.
    if let (true, Some(bytes)) = (fit != 0, pixel::frame_bytes(pixels, width % 250, height % 250)) {
        frame.resize(bytes, fit);
    }
    let peak = memory::peak(|| show(&format, &frame));
    // A byte of a JPEG image can be 512 pixels, of several planes and pictures.
    let limit = (8 << 20) + if pixels == PixelFormat::Mjpeg { 512 * 32 } else { 64 } * frame.len();
    assert!(peak <= limit, "{peak} bytes of memory for a frame of {} bytes", frame.len());
}
