//! How many bits of the samples of an event sensor's frames count.
//!
//! AEDAT 4 tells that samples have 16 bits, and not how many of them count: DV scales the sensor's 10 to 16, jAER leaves them
//! as they are. All frames of the recording decide together; where all are nearly black, the user says.

use erfgs_events::{ApsFrame, CdEvent, EventBatch, EventEncoding, Sink};
use erfgs_scene::image::FEW_BITS;

use super::ExportError;
use crate::{container::Recording, source::Encoding};

/// The largest sample of 16 bits.
struct Largest(u16);

impl Sink for Largest {
    fn event(&mut self, _event: CdEvent) {}

    fn events(&mut self, _batch: EventBatch<'_>) {}

    fn frame(&mut self, frame: ApsFrame) {
        if frame.bits == 16 {
            self.0 = frame.pixels.into_iter().max().unwrap_or(0).max(self.0);
        }
    }
}

/// The bits that count of samples of 16 bits: those that the user says, else all.
///
/// # Errors
/// If nothing is said and the samples are so small that fewer may count, or if there are larger ones than the user says.
pub fn of(recording: &mut Recording, stream: usize, given: Option<u8>) -> Result<u8, ExportError> {
    let description = &recording.summary().streams[stream].description;
    if description.encoding != Encoding::Events(EventEncoding::Aedat4) {
        return Ok(16);
    }
    let id = description.id.clone();
    let mut largest = Largest(0);
    recording.decode_events(stream, &mut largest, |_| {})?;
    match (given, largest.0) {
        (None, largest @ 1..FEW_BITS) => Err(ExportError::FewBits { id, largest }),
        (Some(bits), largest) if u32::from(largest) >> bits.min(16) != 0 => {
            Err(ExportError::MoreBits { id, largest, bits })
        }
        (given, _) => Ok(given.unwrap_or(16)),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use erfgs_events::{Aedat4Compression, Aedat4Encoder, SensorSize};
    use erfgs_scene::video::Video;

    use super::super::{FramesChoice, FramesFormat, write_frames};
    use super::*;

    /// An AEDAT 4 file with frames of samples of 16 bits, a ramp up to `white` in every second.
    fn file(path: &Path, white: u16) {
        let size = SensorSize { width: 64, height: 2 };
        let mut encoder = Aedat4Encoder::new(size, "DAVIS346_1", Aedat4Compression::None);
        for n in 0..4_u64 {
            let most = if n % 2 == 1 { white } else { white / 2 };
            let pixels = (0..128_u32).map(|at| (u32::from(most) * (at % 64) / 63) as u16).collect();
            let (exposure_start_us, exposure_end_us) = (1000 + n * 40_000, 2000 + n * 40_000);
            let (width, height, channels, bits) = (64, 2, 1, 16);
            encoder.frame(ApsFrame { exposure_start_us, exposure_end_us, width, height, channels, pixels, bits });
        }
        std::fs::write(path, encoder.finish()).unwrap();
    }

    /// The red of the first row of an EXR file.
    #[cfg(feature = "exr")]
    fn first_row(path: &Path) -> Vec<f32> {
        let read = exr::prelude::read_first_rgba_layer_from_file(
            path,
            |size, _| vec![0.0; size.x()],
            |row: &mut Vec<f32>, at, (red, _, _, _): (f32, f32, f32, f32)| {
                if at.y() == 0 {
                    row[at.x()] = red;
                }
            },
        );
        read.unwrap().layer_data.channel_data.pixels
    }

    #[test]
    fn frames_of_any_depth_are_a_ramp_to_white_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f.aedat4");
        for depth in [8, 9, 10, 11, 12, 14, 16_u8] {
            let white = ((1_u32 << depth) - 1) as u16;
            file(&path, white);
            let mut recording = Recording::open(&path, None).unwrap();
            let mut write = |bits: Option<u8>| {
                let out = folder.path().join(format!("{depth}-{bits:?}"));
                let choice = FramesChoice { format: FramesFormat::Png, exposures: None, bits };
                write_frames(&mut recording, "f", choice, &out, &mut Vec::new(), |_| {}).map(|_| out)
            };
            let unsaid = write(None);
            assert_eq!(unsaid.is_err(), depth <= 12, "{depth}: {unsaid:?}");
            if let Err(error) = unsaid {
                let message = error.to_string();
                assert!(
                    message.contains(&format!("the largest is {white}")) && message.contains("--bits"),
                    "{message}"
                );
                assert!(!folder.path().join(format!("{depth}-None")).exists());
            }
            let few = write(Some(depth - 1).filter(|bits| *bits >= 8));
            assert!(few.is_err() || depth > 12, "{depth}");
            let out = write(Some(depth)).unwrap().join("000001.png");
            let reading = erfgs_scene::image::Reading { bits: Some(16), ..Default::default() };
            let (image, _) = erfgs_scene::ImageRgb8::read_as(&out, reading).unwrap();
            for x in 0..64 {
                assert!(
                    u32::from(image.pixel(x, 0)[0]).abs_diff(255 * x / 63) <= 2,
                    "{depth} bits, {x}: {:?}",
                    image.pixel(x, 0)
                );
            }
            // A video has no other samples, and its levels are those of the pictures.
            let film = folder.path().join(format!("{depth}.mp4"));
            let choice = FramesChoice { format: FramesFormat::Mp4, exposures: None, bits: Some(depth) };
            write_frames(&mut recording, "f", choice, &film, &mut Vec::new(), |_| {}).unwrap();
            let mut video = Video::open(&film).unwrap();
            let picture = (0..2).map(|_| video.next_frame().unwrap().unwrap()).last().unwrap();
            for x in 0..64 {
                let level = u32::from(picture.pixel(x, 0)[1]);
                assert!(level.abs_diff(255 * x / 63) <= 4, "{depth} bits, {x}: {level}");
            }
            #[cfg(feature = "exr")]
            {
                let choice = FramesChoice { format: FramesFormat::Exr, exposures: None, bits: Some(depth) };
                let out = folder.path().join(format!("{depth}-exr"));
                write_frames(&mut recording, "f", choice, &out, &mut Vec::new(), |_| {}).unwrap();
                let file = out.join("000001.exr");
                for (x, light) in first_row(&file).into_iter().enumerate() {
                    let level = erfgs_scene::srgb::encode(light);
                    assert!((level - x as f32 / 63.0).abs() < 0.01, "{depth} bits, {x}: {level}");
                }
            }
        }
    }
}
