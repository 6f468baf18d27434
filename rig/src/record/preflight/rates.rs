//! How much the streams of a rig send.

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
    let raw = |bytes: f64| Rates { steady: pixels * bytes * hz, peak: pixels * bytes * hz };
    match stream.encoding {
        Encoding::Evt2 | Encoding::Evt21 | Encoding::Evt21Legacy | Encoding::Evt3 => {
            // What a moving scene gives is a small part of what the sensor can.
            Rates { steady: 0.1 * EVK4_PEAK, peak: EVK4_PEAK }
        }
        Encoding::Davis => Rates { steady: 0.1 * DAVIS_PEAK, peak: DAVIS_PEAK },
        Encoding::Mjpeg => Rates { steady: MJPEG_BYTES[0] * pixels * hz, peak: MJPEG_BYTES[1] * pixels * hz },
        Encoding::Yuyv | Encoding::Grey10 | Encoding::Grey12 => raw(2.0),
        Encoding::Nv12 => raw(1.5),
        Encoding::Grey8 => raw(1.0),
        Encoding::Rgb8 => raw(3.0),
        Encoding::TriggerLines => Rates { steady: 10e3, peak: 100e3 },
    }
}
