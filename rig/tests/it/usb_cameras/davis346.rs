//! The DAVIS346's driver against the emulated camera, in this process.

use std::sync::{Arc, Mutex};

use crate::usb_cameras::support::{
    Bucket, EmulatedBus,
    davis346::{Camera, events_only, model, one, open},
};
use erfgs_hardware_mocks::usb::{
    Davis346 as Model, Davis346Options, Fault, FaultKind, Reply, Speed, Urb, UsbDevice, davis346::STREAM,
};
use erfgs_rig::event::{
    Davis346Config, EventError, Kind,
    davis346::{BiasCurrents, Events, ExternalInput, Frames, Imu, OnStall, Shutter, Timestamps},
    list_on,
};
use erfgs_session::source::{Incident, Source};

fn parameter(camera: &Camera, module: u8, parameter: u8) -> u32 {
    camera.lock().unwrap().device().parameter(module, parameter)
}

#[test]
fn settings_are_written_and_read_back() {
    let (bus, camera) = one(Davis346Options::default(), Vec::new());
    let config = Davis346Config {
        biases: BiasCurrents { on: Some(200_000), off: Some(400), ..BiasCurrents::default() },
        events: Events {
            on_stall: OnStall::Wait,
            background_activity_us: 5000,
            refractory_us: 500,
            masked_pixels: vec![[3, 4]],
            ..Events::default()
        },
        frames: Frames { exposure_us: 2000, interval_us: 50_000, shutter: Shutter::Rolling, ..Frames::default() },
        imu: Imu { accelerometer_g: 8, gyroscope_dps: 1000, divider: 2, ..Imu::default() },
        external_input: ExternalInput { rising: true, falling: false },
        ..Davis346Config::default()
    };
    let source = open(&bus, config).unwrap();
    let word = |coarse: u32, fine: u32, kind: u32| kind | fine << 4 | coarse << 12;
    // 200 nA of 387.5 nA: 132/255; 400 pA of 756 pA: 135/255; the others are the maker's.
    assert_eq!(parameter(&camera, 5, 11), word(5, 132, 15));
    assert_eq!(parameter(&camera, 5, 12), word(2, 135, 15));
    assert_eq!(parameter(&camera, 5, 14), word(2, 58, 13));
    assert_eq!(parameter(&camera, 5, 9), word(7, 215, 14));
    assert_eq!(parameter(&camera, 5, 35), 1 << 4 | 33 << 10);
    assert_eq!([parameter(&camera, 0, 4), parameter(&camera, 0, 5), parameter(&camera, 1, 4)], [0, 0, 1]);
    assert_eq!([parameter(&camera, 1, 31), parameter(&camera, 1, 32)], [1, 20]);
    assert_eq!([parameter(&camera, 1, 33), parameter(&camera, 1, 34)], [1, 2]);
    assert_eq!([parameter(&camera, 1, 11), parameter(&camera, 1, 12), parameter(&camera, 1, 13)], [4, 3, 260]);
    assert_eq!([parameter(&camera, 2, 7), parameter(&camera, 5, 142)], [0, 0]);
    assert_eq!([parameter(&camera, 3, 5), parameter(&camera, 3, 7), parameter(&camera, 3, 10)], [1, 2, 2]);
    assert_eq!([parameter(&camera, 4, 1), parameter(&camera, 4, 2)], [1, 0]);
    let settings = &source.description().settings;
    assert_eq!(settings["frames"]["exposure_us"], 2000.0);
    assert_eq!(settings["frames"]["interval_us"], 50_000.0);
    assert_eq!(settings["imu"]["gyroscope_dps"], 1000);
    assert_eq!(settings["biases"]["on"]["wanted_pa"], 200_000);
    assert_eq!(settings["logic"], 18);
    assert_eq!(source.description().serial, "00000336");
}

#[test]
fn what_the_camera_drops_is_counted() {
    // The camera's own buffer overflows while its endpoint is silent.
    let pause = Fault { at_ms: 1000, kind: FaultKind::Nak { endpoint: STREAM, for_ms: 1500 } };
    let (bus, camera) = one(Davis346Options { queue_bytes: 100_000, ..Davis346Options::default() }, vec![pause]);
    let mut source = open(&bus, events_only()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_until("the pause", |_| camera.lock().unwrap().ledger().lock().faults == 1);
    bucket.wait_for_bytes(300_000);
    let readings: std::collections::BTreeMap<_, _> = source.readings().into_iter().collect();
    assert!(readings["dropped_events"] > 0.0, "{readings:?}");
    assert_eq!(readings["dropped_edges"], 0.0);
    let counted = camera.lock().unwrap().device().counts().get().lost;
    assert!(source.counters().lost > 0 && source.counters().lost <= counted);
}

#[test]
fn a_halted_endpoint_is_cleared_and_the_gap_marked() {
    let stall = Fault { at_ms: 1000, kind: FaultKind::Stall { endpoint: STREAM } };
    let (bus, _camera) = one(Davis346Options::default(), vec![stall]);
    let mut source = open(&bus, Davis346Config { timestamps: Timestamps::Keep, ..events_only() }).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_until("a warning", |bucket| !bucket.incidents().is_empty());
    bucket.wait_for_bytes(100_000);
    source.stop().unwrap();
    assert!(matches!(&bucket.incidents()[..], [Incident::Warning { message }] if message.contains("halted")));
    assert_eq!(bucket.packets.lock().unwrap().iter().filter(|packet| packet.discontinuity).count(), 1);
}

#[test]
fn a_camera_that_is_plugged_in_again_gets_its_configuration_back() {
    let (bus, camera) = one(Davis346Options::default(), Vec::new());
    let biases = BiasCurrents { on: Some(200_000), ..BiasCurrents::default() };
    let mut source = open(&bus, Davis346Config { biases, ..events_only() }).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(20_000);
    camera.lock().unwrap().unplug();
    bucket.wait_until("the loss", |bucket| !bucket.incidents().is_empty());
    camera.lock().unwrap().plug();
    bucket.wait_until("the return", |bucket| bucket.incidents().contains(&Incident::Back));
    bucket.wait_for_bytes(20_000);
    source.stop().unwrap();
    assert_eq!(parameter(&camera, 5, 11), 15 | 132 << 4 | 5 << 12);
    assert_eq!(source.counters().reconnections, 1);
    assert!(matches!(&bucket.incidents()[..], [Incident::Lost { .. }, Incident::Back]), "{:?}", bucket.incidents());
    assert_eq!(bucket.packets.lock().unwrap().iter().filter(|packet| packet.discontinuity).count(), 1);
}

#[test]
fn other_logic_and_old_firmware_are_refused_with_their_versions() {
    for (options, named) in [
        (Davis346Options { logic_version: 17, ..Davis346Options::default() }, "logic version 17"),
        (Davis346Options { logic_patch: 0, ..Davis346Options::default() }, "18 patch 0"),
        (Davis346Options { firmware: 5, ..Davis346Options::default() }, "firmware version 5"),
    ] {
        let (bus, _camera) = one(options, Vec::new());
        let error = open(&bus, Davis346Config::default()).err().unwrap().to_string();
        assert!(error.contains(named), "{error}");
    }
}

/// Another unit: some of its registers (module, parameter) say something else.
struct Altered(Model, &'static [(u16, u16, u32)]);

impl UsbDevice for Altered {
    fn speed(&self) -> Speed {
        self.0.speed()
    }

    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        let read = urb.setup.filter(|setup| (setup.request_type, setup.request) == (0xC0, 0xBF));
        let altered = read.and_then(|setup| self.1.iter().find(|it| (it.0, it.1) == (setup.value, setup.index)));
        match altered {
            Some((_, _, value)) => Reply::Data(value.to_be_bytes().to_vec()),
            None => self.0.submit(urb, now_ns),
        }
    }

    fn reset(&mut self) {
        self.0.reset();
    }
}

fn one_altered(registers: &'static [(u16, u16, u32)]) -> Arc<EmulatedBus> {
    let bus = Arc::new(EmulatedBus::default());
    bus.add(Arc::new(Mutex::new(Altered(model(Davis346Options::default()), registers))));
    bus
}

#[test]
fn a_davis_of_another_size_is_refused() {
    let bus = one_altered(&[(1, 0, 240), (1, 1, 180)]);
    let error = open(&bus, Davis346Config::default()).err().unwrap();
    assert!(matches!(&error, EventError::WrongDevice { found, .. } if found.contains("240 by 180")), "{error}");
    assert_eq!(list_on(bus.as_ref()).unwrap()[0].kind, Kind::Unknown);
}

#[test]
fn what_a_camera_has_not_is_told_in_its_settings() {
    // Neither background-activity filter nor global shutter nor inertial unit.
    let bus = one_altered(&[(1, 30, 0), (2, 6, 0), (3, 0, 0)]);
    let source = open(&bus, Davis346Config::default()).unwrap();
    let missed = serde_json::to_string(&source.description().settings["not_applied"]).unwrap();
    for what in ["background_activity_us", "rolls", "no inertial unit"] {
        assert!(missed.contains(what), "{missed}");
    }
    let whole = one(Davis346Options::default(), Vec::new()).0;
    assert!(!open(&whole, Davis346Config::default()).unwrap().description().settings.contains_key("not_applied"));
}

#[test]
fn a_camera_at_high_speed_is_listed_and_started_with_advice() {
    let (bus, _camera) = one(Davis346Options { speed: Speed::High, ..Davis346Options::default() }, Vec::new());
    let listed = list_on(bus.as_ref()).unwrap();
    assert_eq!((listed[0].kind, listed[0].serial.as_str()), (Kind::Davis346, "00000336"));
    assert!(listed[0].problem.as_ref().unwrap().contains("USB 3"));
    let mut source = open(&bus, events_only()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    assert!(matches!(&bucket.incidents()[..], [Incident::Warning { message }] if message.contains("480 Mbit/s")));
}

#[test]
fn settings_are_changed_while_it_sends() {
    let (bus, camera) = one(Davis346Options::default(), Vec::new());
    let mut source = open(&bus, events_only()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(50_000);
    let changed = serde_json::json!({
        "biases": { "on": 200_000 },
        "events": {
            "refractory_us": 500,
            "region": { "x": 10, "y": 20, "width": 100, "height": 50 },
        },
        "frames": { "exposure_us": 1500 },
    });
    source.adjust(changed.as_object().unwrap()).unwrap();
    let word = |coarse: u32, fine: u32, kind: u32| kind | fine << 4 | coarse << 12;
    assert_eq!(parameter(&camera, 5, 11), word(5, 132, 15));
    assert_eq!([parameter(&camera, 1, 33), parameter(&camera, 1, 34)], [1, 2]);
    assert_eq!(source.description().settings["frames"]["exposure_us"], 1500.0);
    assert_eq!(source.description().settings["events"]["region"]["width"], 100);
    // It sends on.
    bucket.wait_for_bytes(50_000);
    let knobs = source.knobs();
    let value = |path: &str| knobs.iter().find(|knob| knob.path == path).unwrap().value.clone();
    assert_eq!((value("biases.on"), value("events.region")["height"].clone()), (200_000.into(), 50.into()));
    let off = serde_json::json!({ "biases": { "on": null }, "events": { "region": null, "refractory_us": 0 } });
    source.adjust(off.as_object().unwrap()).unwrap();
    assert_eq!(parameter(&camera, 5, 11), word(5, 255, 15), "the maker's");
    assert_eq!(parameter(&camera, 1, 33), 0);
    for (wrong, says) in [
        (serde_json::json!({ "events": { "region": { "x": 300, "y": 0, "width": 100, "height": 50 } } }), "region.x"),
        (serde_json::json!({ "timestamps": "keep" }), "while the camera runs"),
    ] {
        let error = source.adjust(wrong.as_object().unwrap()).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
    source.stop().unwrap();
}
