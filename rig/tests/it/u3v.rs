//! The USB3 Vision driver against an emulated camera, in this process and in real time.

use std::{
    sync::{Arc, Mutex},
    thread::sleep,
    time::Duration,
};

use erfgs_hardware_mocks::usb::{
    Davis346, Davis346Options, Evk4, Evk4Options, Fault, FaultKind, Faults, Plug, Speed, TriggerLine, U3v, U3vFaults,
    U3vOptions, Uvc, UvcOptions,
    clock::ClockError,
    evk4::Stimulus,
    scene::{FrameScene, Pattern, PatternFrames},
    u3v::STREAM,
    uvc::{Format, FrameTruth},
};
use erfgs_rig::{
    frame::{Backend, FrameConfig, FrameError, GenicamCamera, Lock, NamedLock, U3vLink, list_u3v_on},
    genicam::GenicamConfig,
    host_time::host_ns,
    usb::Budget,
};
use erfgs_scene::pixel::{BayerOrder, PixelFormat, Samples};
use erfgs_session::source::{Counters, Incident, Packet, Source, StampClock};
use serde_json::json;

use crate::{
    kept::Kept,
    usb_cameras::support::{EmulatedBus, HostClock},
};

type Camera = GenicamCamera<U3vLink>;
type Model = Arc<Mutex<Plug<U3v>>>;

fn bus() -> Arc<EmulatedBus> {
    Arc::new(EmulatedBus::new(Arc::new(HostClock)))
}

fn plug(bus: &EmulatedBus, options: U3vOptions, schedule: Vec<Fault>) -> Model {
    let device = U3v::new(options, Box::new(PatternFrames::default()));
    let plug = Arc::new(Mutex::new(Plug::new(device, &Faults { schedule, ..Faults::default() })));
    bus.add(plug.clone());
    plug
}

/// A bus with one camera, in which something goes wrong.
fn one(faults: U3vFaults) -> Arc<EmulatedBus> {
    let bus = bus();
    plug(&bus, U3vOptions { faults, ..U3vOptions::default() }, Vec::new());
    bus
}

/// Small frames, many of them: a payload of three packets.
fn config() -> FrameConfig {
    FrameConfig {
        id: "cam".into(),
        backend: Backend::U3v,
        format: PixelFormat::Grey8,
        width: 64,
        height: 48,
        rate_hz: 100.0,
        exposure_us: Lock::At(2000.0),
        ..FrameConfig::default()
    }
}

fn open(bus: &Arc<EmulatedBus>, config: &FrameConfig) -> Result<Camera, FrameError> {
    GenicamCamera::open(U3vLink(bus.clone()), config)
}

fn refused(bus: &Arc<EmulatedBus>, config: &FrameConfig) -> String {
    open(bus, config).err().map(|error| error.to_string()).expect("it is refused")
}

/// Records so many frames.
fn film(bus: &Arc<EmulatedBus>, config: &FrameConfig, count: usize) -> (Vec<Packet>, Vec<Incident>, Camera) {
    let mut camera = open(bus, config).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    kept.wait_packets(count);
    camera.stop().unwrap();
    let packets = std::mem::take(&mut *kept.packets());
    let incidents = kept.incidents().clone();
    (packets, incidents, camera)
}

fn truth(packet: &Packet) -> FrameTruth {
    FrameTruth::of(Format::Grey, &packet.payload).unwrap()
}

/// The bytes that the camera sent in grey: the pattern at its time, with the truth in its first pixels.
fn sent(truth: FrameTruth, width: u32, height: u32) -> Vec<u8> {
    let (_, picture) = PatternFrames::default().frame(truth.number, truth.exposure_ns, width, height);
    let mut bytes = picture.luma();
    bytes[..8].copy_from_slice(&truth.number.to_le_bytes());
    bytes[8..16].copy_from_slice(&truth.exposure_ns[0].to_le_bytes());
    bytes[16..24].copy_from_slice(&truth.exposure_ns[1].to_le_bytes());
    bytes
}

fn numbers(packets: &[Packet], which: fn(&Packet) -> bool) -> Vec<u32> {
    packets.iter().filter(|packet| which(packet)).map(|packet| packet.stamp.unwrap().sequence).collect()
}

fn reading(camera: &mut Camera, name: &str) -> Option<f64> {
    camera.readings().iter().find(|(known, _)| known == name).map(|(_, value)| *value)
}

#[test]
fn frames_come_with_the_cameras_time_and_its_settings_are_read_back() {
    let bus = bus();
    let clock = ClockError { offset_ppm: 200.0, ..ClockError::default() };
    plug(&bus, U3vOptions { clock, name: "left".into(), ..U3vOptions::default() }, Vec::new());
    let more = GenicamConfig {
        offset: [8, 4],
        black_level: Some(12.0),
        strobe_line: "Line1".into(),
        features: [("DeviceLinkThroughputLimit".to_owned(), 50_000_000.into())].into_iter().collect(),
        ..GenicamConfig::default()
    };
    let config = FrameConfig { gain: Lock::At(6.5), genicam: Some(more), ..config() };
    let (packets, incidents, camera) = film(&bus, &config, 20);
    assert!(incidents.is_empty(), "{incidents:?}");
    let stamps: Vec<_> = packets.iter().map(|packet| packet.stamp.unwrap()).collect();
    for (packet, stamp) in packets.iter().zip(&stamps) {
        assert!(packet.payload == sent(truth(packet), 64, 48) && !packet.damaged);
        assert_eq!((truth(packet).number, stamp.clock), (u64::from(stamp.sequence), StampClock::Camera));
        // It arrives after its exposure.
        assert!(packet.host_ns > truth(packet).exposure_ns[1]);
    }
    // The camera's clock is fast by 200 ppm, and counts nanoseconds.
    let (first, last) = (truth(&packets[0]).exposure_ns[0], truth(packets.last().unwrap()).exposure_ns[0]);
    let counted = stamps.last().unwrap().kernel_ns - stamps[0].kernel_ns;
    let expected = (last - first) as f64 * 1.0002;
    assert!((counted as f64 - expected).abs() < 5.0, "{counted} ns, and {expected} ns passed");

    let description = camera.description();
    let settings = &description.settings;
    assert_eq!((description.model.as_str(), description.serial.as_str()), ("erfgs Emulated U3V", "U3V00001"));
    assert_eq!(description.exposure_ns(), Some(2_000_000));
    for (name, value) in [("gain", 6.5), ("black_level", 12.0), ("region_x", 8.0), ("rate_hz", 100.0)] {
        assert_eq!(settings[name].as_f64(), Some(value), "{name}");
    }
    for (name, value) in [("backend", "u3v"), ("user_name", "left"), ("port", "1-1")] {
        assert_eq!(settings[name], value);
    }
    assert_eq!(settings["usb"]["link"], "5 Gbit/s");
    assert_eq!(settings["stream"], json!({ "transfers": 8, "transfer_bytes": 3072, "wanted_transfers": 8 }));
    assert_eq!(
        (&settings["genicam"]["GainAuto"], &settings["genicam"]["LineSource"]),
        (&"Off".into(), &"ExposureActive".into())
    );
    assert_eq!((&settings["exposure_us_locked"], settings.get("not_applied")), (&true.into(), None));
    let Counters { lost, errors, packets: counted, .. } = camera.counters();
    assert_eq!((lost, errors, counted), (0, 0, packets.len() as u64));
}

#[test]
fn payloads_come_whole_wherever_they_end() {
    // On a packet's end, beside it, on the end of a transfer, and with chunks behind the image.
    for (width, height, transfer_bytes, chunks) in
        [(64, 48, None, false), (68, 50, None, false), (64, 64, Some(1024), false), (64, 48, Some(2048), true)]
    {
        for zipped in [true, false] {
            let bus = bus();
            plug(&bus, U3vOptions { zipped, ..U3vOptions::default() }, Vec::new());
            let chunks = if chunks { vec!["FrameID".to_owned(), "Timestamp".into()] } else { Vec::new() };
            let more = GenicamConfig { chunks, transfer_bytes, ..GenicamConfig::default() };
            let config = FrameConfig { width, height, genicam: Some(more), ..config() };
            let (packets, incidents, mut camera) = film(&bus, &config, 4);
            assert!(incidents.is_empty() && packets.iter().all(|packet| !packet.damaged), "{incidents:?}");
            for packet in &packets {
                assert!(packet.payload == sent(truth(packet), width, height), "{width} x {height}");
                assert_eq!(truth(packet).number, u64::from(packet.stamp.unwrap().sequence));
            }
            let last = packets.last().unwrap().stamp.unwrap();
            let has_chunks = transfer_bytes == Some(2048);
            let chunks = reading(&mut camera, "chunk FrameID").zip(reading(&mut camera, "chunk Timestamp"));
            assert_eq!(chunks, has_chunks.then_some((f64::from(last.sequence), last.kernel_ns as f64)));
            assert_eq!(reading(&mut camera, "strange_transfers"), Some(0.0));
        }
    }
}

#[test]
fn packed_pixels_come_as_the_camera_packs_them() {
    let bus = one(U3vFaults::default());
    let bayer = |samples| PixelFormat::Bayer(BayerOrder::Rggb, samples);
    for (format, samples) in [
        (PixelFormat::Grey12, Samples::Bits12),
        (PixelFormat::Grey12Lsb, Samples::Lsb12),
        (bayer(Samples::Lsb12), Samples::Lsb12),
    ] {
        let (packets, incidents, _) = film(&bus, &FrameConfig { format, ..config() }, 3);
        assert!(incidents.is_empty(), "{incidents:?}");
        for packet in &packets {
            // The upper 8 of the 12 bits tell the frame.
            let upper: Vec<u8> = samples.unpack(&packet.payload).iter().map(|value| (value >> 4) as u8).collect();
            assert_eq!((upper.len(), packet.damaged), (64 * 48, false), "{format}");
            let truth = FrameTruth::of(Format::Grey, &upper).unwrap();
            assert_eq!(truth.number, u64::from(packet.stamp.unwrap().sequence), "{format}");
        }
    }
}

#[test]
fn what_the_camera_loses_is_counted_once_and_kept_as_damaged() {
    let faults = U3vFaults {
        lost_packets: [(2, 1), (3, 0), (3, 2)].into(),
        truncated: [(5, 1500)].into(),
        without_trailer: [7].into(),
        lost_blocks: [9, 10].into(),
        without_leader: [12].into(),
        ..U3vFaults::default()
    };
    let bus = one(faults);
    let (packets, incidents, mut camera) = film(&bus, &config(), 16);
    assert!(incidents.is_empty(), "{incidents:?}");
    assert_eq!(numbers(&packets, |_| true)[..13], [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 14, 15]);
    assert_eq!(numbers(&packets, |packet| packet.damaged), [2, 3, 5, 7]);
    assert!(packets.iter().all(|packet| packet.payload.len() == 64 * 48));
    // What came is kept: of 2 the other packets, of 5 what the trailer vouches for.
    let was = |index: usize| sent(truth(&packets[index]), 64, 48);
    assert!(packets[2].payload == [&was(2)[..1024], &was(2)[2048..], &[0; 1024]].concat());
    assert!(packets[5].payload == [&was(5)[..1500], &[0; 3072 - 1500]].concat());
    for packet in packets.iter().filter(|packet| !packet.damaged) {
        assert!(packet.payload == sent(truth(packet), 64, 48));
    }
    let Counters { lost, errors, .. } = camera.counters();
    assert_eq!((lost, errors), (3, 4));
    // A packet of block 2, two of block 3, and the trailer of 7; what 5 has not, the camera says itself.
    assert_eq!(reading(&mut camera, "missing_packets"), Some(4.0));
    assert_eq!(reading(&mut camera, "frames_without_end"), Some(1.0));
    assert_eq!(reading(&mut camera, "temperature_c"), Some(41.5));
}

#[test]
fn a_camera_that_is_stuck_is_told_of_and_opened_anew() {
    let bus = one(U3vFaults { stuck_from: Some(5), ..U3vFaults::default() });
    let mut camera = open(&bus, &FrameConfig { timeout_ms: 300, ..config() }).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    kept.wait_back();
    kept.wait_packets(8);
    camera.stop().unwrap();
    let incidents = kept.incidents();
    let [Incident::Lost { reason }, Incident::Back, ..] = &incidents[..] else { panic!("{incidents:?}") };
    assert!(reason.contains("camera cam answers and has given no frame for 300 ms"), "{reason}");
    assert!(reason.contains("hub has no power of its own"), "{reason}");
    assert_eq!(numbers(&kept.packets(), |packet| packet.discontinuity), [0]);
    assert!(camera.counters().reconnections >= 1);
}

/// Records across a fault of the cable, and gives the reason that was told.
fn across(kind: FaultKind) -> String {
    let bus = bus();
    plug(&bus, U3vOptions::default(), vec![Fault { at_ms: 800, kind }]);
    let mut camera = open(&bus, &config()).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    kept.wait_back();
    let before = kept.packets().len();
    kept.wait_packets(before + 5);
    camera.stop().unwrap();
    let incidents = kept.incidents();
    let [Incident::Lost { reason }, Incident::Back] = &incidents[..] else { panic!("{incidents:?}") };
    let packets = kept.packets();
    assert_eq!(packets.iter().filter(|packet| packet.discontinuity).count(), 1);
    assert!(packets.iter().all(|packet| packet.payload.len() == 64 * 48));
    assert_eq!(camera.counters().reconnections, 1);
    assert_eq!(camera.description().settings["exposure_us"], 2000.0);
    reason.clone()
}

#[test]
fn a_camera_that_is_unplugged_comes_back_with_its_settings() {
    let reason = across(FaultKind::Unplug { for_ms: 700 });
    assert!(reason.contains("camera cam: its stream broke: the device is disconnected. Check the cable"), "{reason}");
}

#[test]
fn a_halted_endpoint_is_told_of_and_reset() {
    let reason = across(FaultKind::Stall { endpoint: STREAM });
    assert!(reason.contains("its stream broke: the endpoint is halted"), "{reason}");
}

#[test]
fn transfers_that_are_lost_or_cut_on_the_cable_damage_their_frame_alone() {
    let at = |at_ms, kind| Fault { at_ms, kind };
    let schedule = vec![
        at(700, FaultKind::LostTransfer { endpoint: STREAM }),
        at(800, FaultKind::ShortRead { endpoint: STREAM, bytes: 700, lost: true }),
        at(900, FaultKind::CorruptWord { endpoint: STREAM, word: 1, bits: 0xffff }),
        at(1000, FaultKind::Nak { endpoint: STREAM, for_ms: 30 }),
    ];
    let bus = bus();
    plug(&bus, U3vOptions::default(), schedule);
    let mut camera = open(&bus, &config()).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    sleep(Duration::from_millis(1200));
    camera.stop().unwrap();
    assert!(kept.incidents().is_empty(), "{:?}", kept.incidents());
    let packets = kept.packets();
    let Counters { lost, errors, .. } = camera.counters();
    let numbers = numbers(&packets, |_| true);
    let missing = u64::from(numbers.last().unwrap() - numbers[0] + 1) - numbers.len() as u64;
    assert_eq!(lost, missing);
    // What is hit is a leader, a payload or a trailer: each costs one frame, or is a frame that is damaged.
    assert!((1..=4).contains(&(lost + errors)), "{lost} lost, {errors} damaged");
    for packet in packets.iter().filter(|packet| !packet.damaged) {
        assert!(packet.payload == sent(truth(packet), 64, 48));
    }
}

#[test]
fn answers_that_come_late_or_never_are_waited_for_and_asked_for_again() {
    let faults = U3vFaults {
        late_answers: (0..400).step_by(9).collect(),
        lost_answers: (0..400).step_by(61).collect(),
        ..U3vFaults::default()
    };
    let (packets, incidents, _) = film(&one(faults), &config(), 3);
    assert!(incidents.is_empty() && packets.iter().all(|packet| !packet.damaged), "{incidents:?}");
    let message = refused(&one(U3vFaults { lost_answers: (30..60).collect(), ..U3vFaults::default() }), &config());
    assert!(message.contains("does not answer when it is to read") && message.contains("unplug it"), "{message}");
}

#[test]
fn each_pulse_gives_a_frame_with_what_was_measured_of_it() {
    let (line, strobe) = (TriggerLine::new(), TriggerLine::new());
    let bus = bus();
    let options = U3vOptions { trigger: Some(line.clone()), strobe: Some(strobe.clone()), ..U3vOptions::default() };
    plug(&bus, options, Vec::new());
    let chunks = ["Timestamp", "ExposureTime", "FrameID"].map(str::to_owned).to_vec();
    let more =
        GenicamConfig { trigger_line: "Line0".into(), strobe_line: "Line1".into(), chunks, ..GenicamConfig::default() };
    let format = PixelFormat::Bayer(BayerOrder::Rggb, Samples::Bits8);
    let config = FrameConfig { triggered: true, format, genicam: Some(more), ..config() };
    let mut camera = open(&bus, &config).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    let mut pulses = Vec::new();
    let mut flashes = strobe.tap();
    for count in 1..=5 {
        let at_ns = host_ns();
        line.push(at_ns, true);
        line.push(at_ns + 1_000_000, false);
        pulses.push(at_ns);
        kept.wait_packets(count);
    }
    // Silence is no fault of a camera that waits: it answers.
    sleep(Duration::from_millis(2300));
    assert_eq!(reading(&mut camera, "chunk ExposureTime"), Some(2000.0));
    camera.stop().unwrap();
    assert!(kept.incidents().is_empty(), "{:?}", kept.incidents());
    let packets = kept.packets();
    assert_eq!(packets.iter().map(|packet| truth(packet).exposure_ns[0]).collect::<Vec<_>>(), pulses);
    assert!(packets.iter().all(|packet| packet.payload.len() == 64 * 48 && !packet.damaged));
    let ends = flashes.until(host_ns()).iter().map(|edge| edge.at_ns).collect::<Vec<_>>();
    assert_eq!(ends, packets.iter().flat_map(|packet| truth(packet).exposure_ns).collect::<Vec<_>>());
    assert!(camera.description().is_triggered());
    assert_eq!(camera.description().settings["genicam"]["TriggerMode"], "On");
}

#[test]
fn what_the_camera_cannot_is_refused_with_what_it_can() {
    let bus = one(U3vFaults::default());
    let with = |change: fn(&mut FrameConfig)| {
        let mut config = config();
        change(&mut config);
        refused(&bus, &config)
    };
    for (message, says) in [
        (with(|c| c.format = PixelFormat::Rgb8), "the camera has Mono8 (format = \"grey8\"), Mono12 (format"),
        (with(|c| c.width = 66), "the camera takes 16 to 640 in steps of 4 (Width)"),
        (with(|c| c.exposure_us = Lock::At(20_000.0)), "there is time for 10000 µs"),
        (with(|c| c.triggered = true), "genicam.trigger_line = \"\": name the input"),
        (with(|c| c.camera = "U3V00009".into()), "no USB3 Vision camera is \"U3V00009\""),
    ] {
        assert!(message.contains(says) && message.contains("\"cam\""), "{says}: {message}");
    }
    // Nothing of that keeps the camera.
    assert!(open(&bus, &FrameConfig { gain: Lock::Named(NamedLock::Auto), ..config() }).is_ok());
}

#[test]
fn cameras_are_listed_and_chosen_and_one_program_has_each() {
    let bus = bus();
    assert!(refused(&bus, &config()).contains("no USB3 Vision camera is plugged in"));
    for (serial, name, speed) in [("U3V00007", "left", Speed::Super), ("U3V00008", "", Speed::High)] {
        let options = U3vOptions { serial: serial.into(), name: name.into(), speed, ..U3vOptions::default() };
        plug(&bus, options, Vec::new());
    }
    let listed = list_u3v_on(&*bus).unwrap();
    let [left, right] = &listed[..] else { panic!("{listed:?}") };
    assert_eq!((left.name.as_str(), left.serial.as_str()), ("erfgs Emulated U3V \"left\"", "U3V00007"));
    assert_eq!((left.bus.as_str(), left.link.as_deref(), &left.problem), ("1-1", Some("5 Gbit/s"), &None));
    assert!(right.problem.as_ref().unwrap().contains("480 Mbit/s only: use a USB 3 port"), "{right:?}");
    for (wanted, serial) in [("U3V00008", "U3V00008"), ("left", "U3V00007"), ("1-2", "U3V00008")] {
        let camera = open(&bus, &FrameConfig { camera: wanted.into(), ..config() }).unwrap();
        assert_eq!(camera.description().serial, serial);
    }
    let message = refused(&bus, &config());
    assert!(
        message.contains("several USB3 Vision cameras are there") && message.contains("serial U3V00008, at 1-2"),
        "{message}"
    );

    let _held = open(&bus, &FrameConfig { camera: "left".into(), ..config() }).unwrap();
    let listed = list_u3v_on(&*bus).unwrap();
    assert!(listed[0].problem.as_ref().unwrap().contains("another program uses it"), "{listed:?}");
    // What the system tells of it is there all the same.
    assert_eq!((listed[0].name.as_str(), listed[0].serial.as_str()), ("erfgs Emulated U3V", "U3V00007"));
    let message = refused(&bus, &FrameConfig { camera: "U3V00007".into(), ..config() });
    assert!(message.contains("another program uses it. Close other viewers"), "{message}");
}

#[test]
fn all_cameras_that_keep_transfers_in_flight_share_the_memory_for_them() {
    let bus = bus();
    assert_eq!(Budget::on(&*bus).cameras, 1);
    let frames = || Box::new(PatternFrames::default());
    plug(&bus, U3vOptions::default(), Vec::new());
    bus.add(Arc::new(Mutex::new(U3v::new(U3vOptions::default(), frames()))));
    let events = |width, height| Box::new(Pattern::new(width, height, 1000));
    let evk4 = Evk4::new(Evk4Options::default(), Stimulus::Scene(events(1280, 720)));
    bus.add(Arc::new(Mutex::new(evk4)));
    bus.add(Arc::new(Mutex::new(Davis346::new(Davis346Options::default(), events(346, 260), frames()))));
    // One that the kernel's own driver serves takes none of it.
    bus.add(Arc::new(Mutex::new(Uvc::new(UvcOptions::default(), frames()))));
    assert_eq!(Budget::on(&*bus).cameras, 4);
}
