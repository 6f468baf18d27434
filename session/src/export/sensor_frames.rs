//! Frames of the pixels of an event sensor: a DAVIS's, and those of AEDAT 4.

use erfgs_events::{ApsFrame, CdEvent, EventBatch, Sink};
use erfgs_scene::pixel::PixelFormat;

use super::{
    ExportError,
    frames::{UNKNOWN_RATE_HZ, Writing},
};
use crate::{clock::EpochCursor, container::Recording, source::Encoding};

/// Frames from which the rate of a video is taken.
const RATED: usize = 32;

/// Decodes a stream of events and writes the frames in it; of samples of 16 bits so many low ones count.
pub(super) fn decode(
    recording: &mut Recording,
    stream: usize,
    (writing, bits): (&mut Writing<'_>, u8),
    damage: &mut Vec<String>,
    progress: impl FnMut(u64),
) -> Result<(), ExportError> {
    let clocks = writing.clocks();
    let mut sink = Frames { writing, bits, clocks, waiting: Vec::new(), begun: false, error: None };
    let decoded = recording.decode_events(stream, &mut sink, progress)?;
    sink.flush();
    damage.extend(decoded.into_iter().flat_map(|decoded| decoded.damage));
    sink.error.map_or(Ok(()), Err)
}

/// Writes frames as they are decoded; the first error ends the writing.
struct Frames<'a, 'b> {
    writing: &'a mut Writing<'b>,
    /// How many bits of 16 count.
    bits: u8,
    clocks: Option<EpochCursor<'b>>,
    /// The first frames, which wait until their rate is known, and the middles of their exposures in session time.
    waiting: Vec<(ApsFrame, Option<i64>)>,
    begun: bool,
    error: Option<ExportError>,
}

impl Sink for Frames<'_, '_> {
    fn event(&mut self, _event: CdEvent) {}

    fn events(&mut self, _batch: EventBatch<'_>) {}

    fn packet(&mut self, sequence: u64) {
        self.clocks.iter_mut().for_each(|clocks| clocks.packet(sequence));
    }

    fn discontinuity(&mut self, _t_us: u64) {
        self.clocks.iter_mut().for_each(EpochCursor::discontinuity);
    }

    fn frame(&mut self, mut frame: ApsFrame) {
        frame.bits = if frame.bits == 16 { self.bits } else { frame.bits };
        let mid_us = frame.exposure_start_us.midpoint(frame.exposure_end_us);
        let mid_ns = self.clocks.as_ref().and_then(|clocks| clocks.session_ns(mid_us));
        self.waiting.push((frame, mid_ns));
        if self.begun || self.waiting.len() == RATED {
            self.flush();
        }
    }
}

impl Frames<'_, '_> {
    fn flush(&mut self) {
        let frames = std::mem::take(&mut self.waiting);
        if !self.begun
            && let [(first, _), .., (last, _)] = &frames[..]
        {
            let span_us = last.exposure_start_us.saturating_sub(first.exposure_start_us);
            let rate = if span_us > 0 { (frames.len() - 1) as f64 / (span_us as f64 * 1e-6) } else { UNKNOWN_RATE_HZ };
            self.writing.set_rate(rate);
        }
        self.begun |= !frames.is_empty();
        for (frame, mid_ns) in frames {
            let written = self.error.is_none().then(|| self.write(&frame, mid_ns));
            if let Some(Err(error)) = written {
                self.error = Some(error);
            }
        }
    }

    fn write(&mut self, frame: &ApsFrame, mid_ns: Option<i64>) -> Result<(), ExportError> {
        let (encoding, payload) = samples(frame);
        let exposure_us = [frame.exposure_start_us, frame.exposure_end_us];
        self.writing.push_exposed(encoding, [frame.width, frame.height], exposure_us, mid_ns, &payload)
    }
}

/// A frame as the cameras' encodings have it: of more than 12 bits the upper 12, of colour the upper 8, alpha left out.
#[must_use]
pub fn samples(frame: &ApsFrame) -> (Encoding, Vec<u8>) {
    let words = |bits: u8, wanted: u8| {
        let scaled = |pixel: &u16| if bits > wanted { pixel >> (bits - wanted) } else { pixel << (wanted - bits) };
        frame.pixels.iter().flat_map(|pixel| scaled(pixel).to_le_bytes()).collect()
    };
    match (frame.channels, frame.bits) {
        (1, ..=8) => (Encoding::Frames(PixelFormat::Grey8), frame.pixels.iter().map(|&pixel| pixel as u8).collect()),
        (1, bits @ ..=10) => (Encoding::Frames(PixelFormat::Grey10), words(bits, 10)),
        (1, bits) => (Encoding::Frames(PixelFormat::Grey12), words(bits, 12)),
        (channels, bits) => {
            let shift = bits.saturating_sub(8);
            let pixels = frame.pixels.chunks_exact(channels.max(1).into());
            let colours = pixels.flat_map(|pixel| pixel.iter().take(3).map(|&level| (level >> shift) as u8));
            (Encoding::Frames(PixelFormat::Bgr8), colours.collect())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(channels: u8, bits: u8, pixels: &[u16]) -> ApsFrame {
        let width = (pixels.len() / usize::from(channels)) as u16;
        let (exposure_start_us, exposure_end_us) = (1, 2);
        ApsFrame { exposure_start_us, exposure_end_us, width, height: 1, channels, pixels: pixels.to_vec(), bits }
    }

    #[test]
    fn samples_keep_the_bits_that_cameras_have() {
        assert_eq!(samples(&frame(1, 8, &[7, 255])), (Encoding::Frames(PixelFormat::Grey8), vec![7, 255]));
        assert_eq!(samples(&frame(1, 10, &[1023])), (Encoding::Frames(PixelFormat::Grey10), vec![0xFF, 3]));
        assert_eq!(samples(&frame(1, 16, &[0xFFC0])), (Encoding::Frames(PixelFormat::Grey12), vec![0xFC, 0xF]));
        assert_eq!(samples(&frame(4, 8, &[1, 2, 3, 4])), (Encoding::Frames(PixelFormat::Bgr8), vec![1, 2, 3]));
        assert_eq!(samples(&frame(3, 16, &[256, 512, 768])), (Encoding::Frames(PixelFormat::Bgr8), vec![1, 2, 3]));
    }
}
