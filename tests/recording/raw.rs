//! Sessions of industrial cameras: described, and exported with all the bits that the sensor gave.

use std::{fs, path::Path};

use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::{image::size, srgb};
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Encoding, Packet},
};

use super::files::{self, json};

const SIZE: [u32; 2] = [32, 16];
const PIXELS: usize = 32 * 16;
/// Light of a sheet, as fractions of white.
const LIGHT: [f64; 3] = [0.5, 0.25, 0.125];

/// A session of one frame a camera. Those behind a mosaic see a sheet of [`LIGHT`], with little red and blue, on a black of
/// 240; the others one level.
fn write_session(folder: &Path) {
    let start = SessionStart { host_ns: 1, ..SessionStart::default() };
    let mut writer = SessionWriter::create(&folder.join("s.mcap"), start, "", Settings::default()).unwrap();
    let raw = serde_json::json!({"raw": {"black_level": 240, "white_balance": [2.0, 1.0, 4.0]}});
    let plain = serde_json::json!({});
    for (id, name, settings) in [
        ("words", "gbrg12", &raw),
        ("packed", "rggb12p", &raw),
        ("grey", "grey10p", &plain),
        ("webcam", "uyvy", &plain),
    ] {
        let encoding: Encoding = name.parse().unwrap();
        let payload = match (encoding.frames().unwrap(), encoding.frames().unwrap().samples()) {
            (PixelFormat::Bayer(order, _), Some(samples)) => {
                let sensor = [0.5, 1.0, 0.25].map(|sensitivity| sensitivity * (4095.0 - 240.0));
                let value = |at: usize| {
                    let colour = order.colour(at % 32, at / 32);
                    (240.0 + LIGHT[colour] * sensor[colour]).round() as u16
                };
                samples.pack(&(0..PIXELS).map(value).collect::<Vec<_>>())
            }
            (_, Some(samples)) => samples.pack(&[513; PIXELS]),
            _ => [90, 81, 240, 81].repeat(PIXELS / 2),
        };
        let stream = writer.add_stream(&files::description(id, encoding, SIZE, settings.clone())).unwrap();
        let (damaged, discontinuity, stamp) = (false, false, None);
        for sequence in 0..2 {
            let payload = if sequence == 0 { payload.clone() } else { payload[1..].to_vec() };
            let packet = Packet { sequence, host_ns: 2, discontinuity, damaged, stamp, payload: payload.into() };
            writer.packet(stream, &packet).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn raw_frames_are_exported_with_all_their_bits() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(folder);
    let info = json(folder, &["info", "s.mcap", "--json"]);
    let encodings: Vec<_> =
        info["streams"].as_array().unwrap().iter().map(|s| s["encoding"].as_str().unwrap()).collect();
    assert_eq!(encodings, ["gbrg12", "rggb12p", "grey10p", "uyvy"]);
    for format in ["png", "exr", "mp4"] {
        let exported = json(folder, &["export", "s.mcap", "--to", format, "--out", format, "--json"]);
        for stream in exported.as_array().unwrap() {
            assert_eq!((&stream["frames"], &stream["damaged"]), (&1.into(), &1.into()), "{stream}");
        }
    }

    let pixels = |id: &str| image_of(&folder.join("png").join(id).join("000000.png"));
    for id in ["words", "packed"] {
        let (colour, data) = pixels(id);
        assert_eq!(colour, image::ColorType::Rgb16, "{id}");
        for (at, &level) in data.iter().enumerate() {
            let expected = srgb::encode(LIGHT[at % 3] as f32) * 65_535.0;
            // A step of 12 bits, as the white balance stretches it.
            assert!((f32::from(level) - expected).abs() < 70.0, "{id} at {at}: {level} is not {expected}");
        }
    }
    // 513 of 1023 is half: no level of 8 bits is as near.
    assert_eq!(pixels("grey"), (image::ColorType::Rgb16, vec![32_864; 3 * PIXELS]));
    let (colour, red) = pixels("webcam");
    assert_eq!(colour, image::ColorType::Rgb8);
    assert!(red.chunks(3).all(|pixel| pixel[0] > 64_000 && pixel[1] < 600 && pixel[2] < 600), "{red:?}");
    let light = fs::metadata(folder.join("exr/words/000000.exr")).unwrap().len();
    let webcam = fs::metadata(folder.join("exr/webcam/000000.exr")).unwrap().len();
    assert!(light > webcam, "floats, and halves for 8 bits: {light} and {webcam} bytes");
    assert_eq!(size(&folder.join("png/packed/000000.png")).unwrap(), SIZE);
}

/// The colour type of an image file, and its levels, 0 to 65535.
fn image_of(path: &Path) -> (image::ColorType, Vec<u16>) {
    let image = image::open(path).unwrap();
    (image.color(), image.into_rgb16().into_raw())
}
