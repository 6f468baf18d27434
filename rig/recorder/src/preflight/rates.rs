//! How much the streams of a rig send.

use erfgs_events::EventEncoding;
use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::pixel::frame_bytes;
use erfgs_session::source::{Description, Encoding};

/// Bytes a second of an EVK4 whose sensor saturates, as measured on USB (ROS metavision_driver's sample log).
const EVK4_PEAK: f64 = 106e6;
/// 12 million events a second of a DAVIS346, 4 bytes each, and its frames.
const DAVIS_PEAK: f64 = 56e6;
/// Bytes of a pixel of an MJPEG frame: typical, and of a scene with much detail.
const MJPEG_BYTES: [f64; 2] = [0.08, 0.2];
/// Frames a second where a camera does not say.
const FRAMES_HZ: f64 = 30.0;

/// Bytes a second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    /// What comes in any case: raw frames, and typical MJPEG.
    pub steady: f64,
    /// What can come while the scene is busy everywhere.
    pub peak: f64,
}

/// What the streams send together.
#[must_use]
pub fn rates(streams: &[Description]) -> Rates {
    let mut sum = Rates::default();
    for stream in streams {
        let of = rates_of(stream);
        sum = Rates { steady: sum.steady + of.steady, peak: sum.peak + of.peak };
    }
    sum
}

/// What one stream sends.
pub(super) fn rates_of(stream: &Description) -> Rates {
    let pixels = f64::from(stream.width) * f64::from(stream.height);
    let hz = ["frame_rate", "fps", "frame_rate_hz", "rate_hz"]
        .iter()
        .find_map(|name| stream.settings.get(*name)?.as_f64())
        .filter(|hz| (0.01..=10_000.0).contains(hz))
        .unwrap_or(FRAMES_HZ);
    match stream.encoding {
        Encoding::Events(EventEncoding::Evt2)
        | Encoding::Events(EventEncoding::Evt21)
        | Encoding::Events(EventEncoding::Evt21Legacy)
        | Encoding::Events(EventEncoding::Evt3) => {
            // What a moving scene gives is a small part of what the sensor can.
            Rates { steady: 0.1 * EVK4_PEAK, peak: EVK4_PEAK }
        }
        Encoding::Events(EventEncoding::Davis) | Encoding::Events(EventEncoding::Aedat4) => {
            Rates { steady: 0.1 * DAVIS_PEAK, peak: DAVIS_PEAK }
        }
        Encoding::Frames(PixelFormat::Mjpeg) => {
            Rates { steady: MJPEG_BYTES[0] * pixels * hz, peak: MJPEG_BYTES[1] * pixels * hz }
        }
        Encoding::TriggerLines => Rates { steady: 10e3, peak: 100e3 },
        Encoding::Frames(format) => {
            let bytes = frame_bytes(format, stream.width, stream.height).unwrap_or_default() as f64;
            Rates { steady: bytes * hz, peak: bytes * hz }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_fixed_size_send_what_their_layout_takes() {
        let sends = |name: &str| {
            let settings = serde_json::json!({"rate_hz": 60.0}).as_object().cloned().unwrap_or_default();
            let (id, model, serial, encoding) = ("a".into(), String::new(), String::new(), name.parse().unwrap());
            let of = Description { id, model, serial, encoding, width: 1920, height: 1080, start_order: 0, settings };
            rates_of(&of).steady / 60.0 / (1920.0 * 1080.0)
        };
        let formats = ["rggb8", "gbrg10p", "grey12p", "nv12", "bggr12", "uyvy", "bgr8"];
        assert_eq!(formats.map(sends), [1.0, 1.25, 1.5, 1.5, 2.0, 2.0, 3.0]);
    }
}
