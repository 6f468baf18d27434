//! An emulated DAVIS346 that films the pattern.

use std::sync::{Arc, Mutex};

use erfgs_hardware_mocks::usb::{
    Davis346 as Model, Davis346Options, Fault, Faults, Plug,
    scene::{Pattern, PatternFrames},
};
use erfgs_rig::event::{
    Davis346Config, Davis346Source, EventError,
    davis346::{Events, Frames, Imu},
};

use super::EmulatedBus;

/// Events a second.
const RATE: u64 = 100_000;

pub type Camera = Arc<Mutex<Plug<Model>>>;

pub fn pattern() -> Pattern {
    Pattern::new(346, 260, RATE)
}

pub fn model(options: Davis346Options) -> Model {
    Model::new(options, Box::new(pattern()), Box::new(PatternFrames::new()))
}

/// A bus with one camera.
pub fn one(options: Davis346Options, faults: Vec<Fault>) -> (Arc<EmulatedBus>, Camera) {
    let bus = Arc::new(EmulatedBus::default());
    let camera = Arc::new(Mutex::new(Plug::new(model(options), &Faults { schedule: faults, ..Faults::default() })));
    bus.add(camera.clone());
    (bus, camera)
}

pub fn open(bus: &Arc<EmulatedBus>, config: Davis346Config) -> Result<Davis346Source, EventError> {
    Davis346Source::open(bus.clone(), "top", config)
}

/// Events only: no filter that drops, no frames, no inertial samples.
pub fn events_only() -> Davis346Config {
    Davis346Config {
        events: Events { background_activity_us: 0, ..Events::default() },
        frames: Frames { enabled: false, ..Frames::default() },
        imu: Imu { enabled: false, ..Imu::default() },
        ..Davis346Config::default()
    }
}
