//! The sensor and its settings: what is exposed, and when.

use std::{collections::VecDeque, sync::Arc};

use super::{
    CameraOptions, Order, frame,
    registers::{FEATURES_BYTES, FORMATS, Features, feature},
};
use crate::usb::{
    TriggerLine,
    clock::Crystal,
    line::LineTap,
    scene::{FrameScene, Picture},
    uvc::FrameTruth,
};

const WRITE_PROTECTED: u16 = 0x8004;
const ACCESS_DENIED: u16 = 0x8006;
const NO_ADDRESS: u16 = 0x8003;
/// Trigger source of a pulse that a command gives.
const SOFTWARE: u32 = 0;

struct Acquisition {
    began_ns: i64,
    number: u64,
    next_ns: Option<i64>,
    tap: Option<LineTap>,
    /// Starts that were commanded.
    commanded: VecDeque<i64>,
}

/// A frame that was exposed.
pub(crate) struct Exposed {
    /// The camera's clock when its exposure began, nanoseconds.
    pub clock_ns: u64,
    /// What it shows.
    pub picture: Arc<Picture>,
    /// What it tells of itself.
    pub truth: FrameTruth,
}

/// The camera behind its transport.
pub(crate) struct Camera {
    options: CameraOptions,
    /// Its settings.
    pub features: Features,
    scene: Box<dyn FrameScene>,
    crystal: Option<Crystal>,
    acquisition: Option<Acquisition>,
}

impl Camera {
    /// A camera before a scene, as it is when it is powered up.
    pub fn new(options: CameraOptions, order: Order, scene: Box<dyn FrameScene>) -> Self {
        let features = Features::new(order);
        let mut camera = Self { options, features, scene, crystal: None, acquisition: None };
        camera.power_up();
        camera
    }

    /// The maker's settings, a clock that begins anew, and nothing acquired.
    pub fn power_up(&mut self) {
        self.features = Features::new(self.features.order());
        self.crystal = None;
        self.acquisition = None;
        let [columns, rows] = self.options.sensor;
        for (at, value) in [
            (feature::WIDTH, columns),
            (feature::HEIGHT, rows),
            (feature::PIXEL_FORMAT, FORMATS[0].1),
            (feature::EXPOSURE_US, 5000),
            (feature::RATE_HZ, 30_f32.to_bits()),
            (feature::RATE_ENABLE, 1),
            (feature::EXPOSURE_AUTO, 2),
            (feature::GAIN_AUTO, 2),
            (feature::GAMMA_ENABLE, 1),
            (feature::TEMPERATURE, 41.5_f32.to_bits()),
            (feature::THROUGHPUT, self.options.link_bytes_s / 5 * 4),
        ] {
            self.features.put(at, value);
        }
        self.settle();
    }

    /// What follows from the settings.
    fn settle(&mut self) {
        let payload = frame::payload_bytes(&self.features);
        self.features.put(feature::PAYLOAD, payload);
        let most_hz = frame::most_rate_hz(&self.features) as f32;
        self.features.put(feature::MOST_RATE_HZ, most_hz.to_bits());
    }

    /// A host writes a register: the status that it is answered, 0 where it is done.
    pub fn write(&mut self, at: u32, value: u32, now_ns: i64) -> u16 {
        let locked = self.features.get(feature::LOCKED) != 0;
        match at {
            FEATURES_BYTES.. => return NO_ADDRESS,
            feature::PAYLOAD | feature::MOST_RATE_HZ | feature::TEMPERATURE => return WRITE_PROTECTED,
            feature::WIDTH..=feature::PIXEL_FORMAT if locked => return ACCESS_DENIED,
            _ => {}
        }
        self.features.put(at, value);
        match at {
            feature::ACQUIRE => self.acquire(value != 0, now_ns),
            feature::TRIGGER_SOFTWARE => {
                let waits = self.acquisition.as_mut().filter(|acquisition| acquisition.next_ns.is_none());
                if let Some(acquisition) = waits {
                    acquisition.commanded.push_back(now_ns);
                }
            }
            _ => {}
        }
        self.settle();
        0
    }

    /// Ends the acquisition, as when the transport is gone.
    pub fn stop(&mut self) {
        self.acquisition = None;
    }

    fn acquire(&mut self, on: bool, now_ns: i64) {
        let triggered = self.features.get(feature::TRIGGER_MODE) != 0;
        let by_line = triggered && self.features.get(feature::TRIGGER_SOURCE) != SOFTWARE;
        self.acquisition = on.then(|| {
            let tap = self.options.trigger.as_ref().filter(|_| by_line).map(|line: &TriggerLine| {
                let mut tap = line.tap();
                tap.skip(now_ns);
                tap
            });
            let next_ns = (!triggered).then_some(now_ns);
            Acquisition { began_ns: now_ns, number: 0, next_ns, tap, commanded: VecDeque::new() }
        });
    }

    /// What the camera's clock shows, nanoseconds. It begins when it is first asked.
    pub fn clock_ns(&mut self, now_ns: i64) -> u64 {
        let crystal = self.crystal.get_or_insert_with(|| Crystal::new(self.options.clock, now_ns));
        crystal.elapsed_ns(now_ns).max(0).unsigned_abs()
    }

    fn next_exposure(&mut self, now_ns: i64) -> Option<i64> {
        let exposure_ns = i64::from(self.features.get(feature::EXPOSURE_US)) * 1000;
        let acquisition = self.acquisition.as_mut()?;
        // A frame is sent when its exposure is over.
        let over_ns = now_ns - exposure_ns;
        if let Some(start_ns) = acquisition.commanded.pop_front_if(|start_ns| *start_ns <= over_ns) {
            return Some(start_ns);
        }
        if let Some(tap) = &mut acquisition.tap {
            return tap.next_rise(over_ns, &Default::default());
        }
        let start_ns = acquisition.next_ns.filter(|&next| next <= over_ns)?;
        let crystal = self.crystal?;
        let rate_hz = f64::from(f32::from_bits(self.features.get(feature::RATE_HZ)));
        let interval_ns = (1e9 / rate_hz.max(0.1)) as i64;
        // The crystal says when the next one begins: its error per interval, carried in true time.
        let target = interval_ns * (acquisition.number as i64 + 1);
        let device = |at_ns: i64| crystal.elapsed_ns(at_ns) - crystal.elapsed_ns(acquisition.began_ns);
        let next = start_ns + interval_ns;
        acquisition.next_ns = Some(next + target - device(next));
        Some(start_ns)
    }

    /// The next frame whose exposure is over.
    pub fn exposed(&mut self, now_ns: i64) -> Option<Exposed> {
        // It runs from the first moment on.
        self.clock_ns(now_ns);
        let start_ns = self.next_exposure(now_ns)?;
        let exposure_ns = [start_ns, start_ns + i64::from(self.features.get(feature::EXPOSURE_US)) * 1000];
        let clock_ns = self.clock_ns(start_ns);
        let acquisition = self.acquisition.as_mut()?;
        let number = acquisition.number;
        acquisition.number += 1;
        if let Some(strobe) = self.options.strobe.as_ref().filter(|_| self.features.get(feature::LINE_SOURCE) == 1) {
            strobe.push(exposure_ns[0], true);
            strobe.push(exposure_ns[1], false);
        }
        let [width, height] = [feature::WIDTH, feature::HEIGHT].map(|at| self.features.get(at));
        let (_, picture) = self.scene.frame(number, exposure_ns, width, height);
        Some(Exposed { clock_ns, picture, truth: FrameTruth { number, exposure_ns } })
    }
}
