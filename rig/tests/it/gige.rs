//! The GigE Vision driver against an emulated camera, over sockets of the loopback interface.
#![cfg(target_os = "linux")]

use std::{
    collections::BTreeSet,
    net::{Ipv4Addr, SocketAddrV4},
    sync::Arc,
};

use erfgs_hardware_mocks::{
    gige::{GigeFaults, GigeFront, GigeOptions},
    usb::{
        TriggerLine,
        clock::ClockError,
        scene::PatternFrames,
        uvc::{Format, FrameTruth},
    },
};
use erfgs_rig::{
    frame::{self, Backend, FrameConfig, Lock, NamedLock},
    genicam::{
        GenicamConfig,
        gige::{self, Reach, Target},
    },
    host_time::host_ns,
};
use erfgs_scene::pixel::{BayerOrder, PixelFormat, Samples};
use erfgs_session::source::{Incident, Packet, Source, StampClock};

use crate::kept::{Kept, wait_for};

fn plug(options: GigeOptions) -> GigeFront {
    GigeFront::plug(options, Box::new(PatternFrames::default())).unwrap()
}

/// Small frames, many of them, and a heartbeat that is soon missed.
fn config(front: &GigeFront) -> FrameConfig {
    FrameConfig {
        id: "cam".into(),
        camera: front.address().to_string(),
        backend: Backend::Gige,
        format: PixelFormat::Grey8,
        width: 64,
        height: 48,
        rate_hz: 100.0,
        exposure_us: Lock::At(2000.0),
        genicam: Some(GenicamConfig { heartbeat_ms: 500, packet_bytes: Some(576), ..GenicamConfig::default() }),
        ..FrameConfig::default()
    }
}

fn refused(config: &FrameConfig) -> String {
    frame::open(config).err().map(|error| error.to_string()).expect("it is refused")
}

/// Records so many frames.
fn film(config: &FrameConfig, count: usize) -> (Vec<Packet>, Vec<Incident>, Box<dyn Source>) {
    let mut camera = frame::open(config).unwrap();
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

fn blocks(blocks: impl IntoIterator<Item = u64>, packet: u32) -> BTreeSet<(u64, u32)> {
    blocks.into_iter().map(|block| (block, packet)).collect()
}

#[test]
fn frames_come_with_the_cameras_time_and_its_settings_are_read_back() {
    let front = plug(GigeOptions {
        clock: ClockError { offset_ppm: 200.0, ..ClockError::default() },
        ..GigeOptions::default()
    });
    let more = GenicamConfig {
        offset: [8, 4],
        black_level: Some(12.0),
        strobe_line: "Line1".into(),
        features: [("DeviceLinkThroughputLimit".to_owned(), 50_000_000.into())].into_iter().collect(),
        ..config(&front).genicam.unwrap()
    };
    let config = FrameConfig { gain: Lock::At(6.5), genicam: Some(more), ..config(&front) };
    let (packets, incidents, camera) = film(&config, 20);
    assert!(incidents.is_empty(), "{incidents:?}");
    let stamps: Vec<_> = packets.iter().map(|packet| packet.stamp.unwrap()).collect();
    for (packet, stamp) in packets.iter().zip(&stamps) {
        assert_eq!((packet.payload.len(), packet.damaged), (64 * 48, false));
        assert_eq!(truth(packet).number, u64::from(stamp.sequence));
        assert_eq!(stamp.clock, StampClock::Camera);
        // It arrives after its exposure.
        assert!(packet.host_ns > truth(packet).exposure_ns[1]);
    }
    // The camera's clock is fast by 200 ppm; a tick has 8 ns.
    let (first, last) = (truth(&packets[0]).exposure_ns[0], truth(packets.last().unwrap()).exposure_ns[0]);
    let counted = stamps.last().unwrap().kernel_ns - stamps[0].kernel_ns;
    let expected = (last - first) as f64 * 1.0002;
    assert!((counted as f64 - expected).abs() < 20.0, "{counted} ns, and {expected} ns passed");

    let description = camera.description();
    let settings = &description.settings;
    assert_eq!((description.model.as_str(), description.serial.as_str()), ("erfgs Emulated GigE", "GEV00001"));
    assert_eq!(description.exposure_ns(), Some(2_000_000));
    for (name, value) in
        [("gain", 6.5), ("black_level", 12.0), ("region_x", 8.0), ("rate_hz", 100.0), ("packet_bytes", 576.0)]
    {
        assert_eq!(settings[name].as_f64(), Some(value), "{name}");
    }
    assert_eq!(settings["genicam"]["GainAuto"], "Off");
    assert_eq!(settings["genicam"]["DeviceLinkThroughputLimit"], 50_000_000);
    assert_eq!(settings["genicam"]["LineSource"], "ExposureActive");
    assert_eq!((&settings["exposure_us_locked"], settings.get("not_applied")), (&true.into(), None));
    let counters = camera.counters();
    assert_eq!((counters.lost, counters.errors, counters.packets), (0, 0, packets.len() as u64));
}

#[test]
fn lost_doubled_and_overtaken_packets_make_no_frame_worse() {
    // A frame has a leader, six packets and a trailer.
    let faults = GigeFaults {
        lost: [blocks(2..6, 3), blocks(6..8, 0), blocks([8], 7), blocks([9], 1), blocks([9], 2)].concat_sets(),
        doubled: blocks(1..12, 4),
        overtaken: blocks(1..12, 2),
        ..GigeFaults::default()
    };
    let front = plug(GigeOptions { faults, ..GigeOptions::default() });
    let (packets, incidents, mut camera) = film(&config(&front), 15);
    assert!(incidents.is_empty() && packets.iter().all(|packet| !packet.damaged), "{incidents:?}");
    assert_eq!(
        packets.iter().map(|packet| truth(packet).number).collect::<Vec<_>>(),
        (0..packets.len() as u64).collect::<Vec<_>>()
    );
    let readings = camera.readings();
    let reading = |name: &str| readings.iter().find(|(known, _)| known == name).map(|(_, value)| *value);
    assert_eq!((reading("missing_packets"), reading("temperature_c")), (Some(0.0), Some(41.5)));
    assert!(reading("asked_packets") >= Some(9.0) && reading("doubled_packets") >= Some(10.0), "{readings:?}");
    assert!(front.camera().counts().resent >= 9);
}

#[test]
fn packed_pixels_come_as_the_camera_packs_them() {
    let front = plug(GigeOptions::default());
    let bayer = |samples| PixelFormat::Bayer(BayerOrder::Rggb, samples);
    for (format, samples) in [
        (PixelFormat::Grey12, Samples::Bits12),
        (PixelFormat::Grey12Lsb, Samples::Lsb12),
        (PixelFormat::Grey12Gev, Samples::Gev12),
        (bayer(Samples::Lsb12), Samples::Lsb12),
    ] {
        let (packets, incidents, _) = film(&FrameConfig { format, ..config(&front) }, 3);
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

trait ConcatSets {
    fn concat_sets(self) -> BTreeSet<(u64, u32)>;
}

impl<const N: usize> ConcatSets for [BTreeSet<(u64, u32)>; N] {
    fn concat_sets(self) -> BTreeSet<(u64, u32)> {
        self.into_iter().flatten().collect()
    }
}

#[test]
fn what_is_lost_for_good_is_counted_once_and_kept_as_damaged() {
    let faults = GigeFaults {
        lost_for_good: blocks([3], 2),
        without_trailer: [5].into(),
        lost_blocks: [7, 8].into(),
        ..GigeFaults::default()
    };
    let front = plug(GigeOptions { faults, zipped: false, resends: false, ..GigeOptions::default() });
    let (packets, incidents, camera) = film(&config(&front), 15);
    assert!(incidents.is_empty(), "{incidents:?}");
    let numbers: Vec<u32> = packets.iter().map(|packet| packet.stamp.unwrap().sequence).collect();
    assert_eq!(numbers[..8], [0, 1, 2, 3, 4, 5, 8, 9]);
    let damaged: Vec<u32> =
        packets.iter().filter(|packet| packet.damaged).map(|packet| packet.stamp.unwrap().sequence).collect();
    assert_eq!(damaged, [2, 4]);
    assert!(packets.iter().all(|packet| packet.payload.len() == 64 * 48));
    let counters = camera.counters();
    assert_eq!((counters.lost, counters.errors), (2, 2));
    let not_applied = camera.description().settings["not_applied"].to_string();
    assert!(not_applied.contains("keeps no packets"), "{not_applied}");
}

#[test]
fn each_pulse_gives_a_frame_with_what_was_measured_of_it() {
    let (line, strobe) = (TriggerLine::new(), TriggerLine::new());
    let options = GigeOptions { trigger: Some(line.clone()), strobe: Some(strobe.clone()), ..GigeOptions::default() };
    let front = plug(options);
    let chunks = ["Timestamp", "ExposureTime", "FrameID"].map(str::to_owned).to_vec();
    let more = GenicamConfig {
        trigger_line: "Line0".into(),
        strobe_line: "Line1".into(),
        chunks,
        ..config(&front).genicam.unwrap()
    };
    let format = PixelFormat::Bayer(BayerOrder::Rggb, Samples::Bits8);
    let config = FrameConfig { triggered: true, format, genicam: Some(more), ..config(&front) };
    let mut camera = frame::open(&config).unwrap();
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
    // Silence is no fault of a camera that waits.
    std::thread::sleep(std::time::Duration::from_millis(2300));
    let readings = camera.readings();
    camera.stop().unwrap();
    assert!(kept.incidents().is_empty(), "{:?}", kept.incidents());
    let packets = kept.packets();
    assert_eq!(packets.iter().map(|packet| truth(packet).exposure_ns[0]).collect::<Vec<_>>(), pulses);
    assert!(packets.iter().all(|packet| packet.payload.len() == 64 * 48 && !packet.damaged));
    let ends = flashes.until(host_ns()).iter().map(|edge| edge.at_ns).collect::<Vec<_>>();
    assert_eq!(ends, packets.iter().flat_map(|packet| truth(packet).exposure_ns).collect::<Vec<_>>());
    let reading = |name: &str| readings.iter().find(|(known, _)| known == name).map(|(_, value)| *value);
    assert_eq!((reading("chunk ExposureTime"), reading("chunk FrameID")), (Some(2000.0), Some(4.0)));
    let stamp_ns = packets.last().unwrap().stamp.unwrap().kernel_ns as f64;
    assert!(reading("chunk Timestamp").is_some_and(|ns| (ns - stamp_ns).abs() <= 8.0), "{readings:?}");
    assert!(camera.description().is_triggered());
    assert_eq!(camera.description().settings["rate_hz"], 100.0);
    assert_eq!(camera.description().settings["genicam"]["TriggerMode"], "On");
}

#[test]
fn a_camera_that_restarts_comes_back_with_its_settings() {
    let front = plug(GigeOptions::default());
    let config = config(&front);
    let mut camera = frame::open(&config).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    kept.wait_packets(5);
    front.camera().restart(host_ns(), 300_000_000);
    kept.wait_back();
    let before = kept.packets().len();
    kept.wait_packets(before + 5);
    camera.stop().unwrap();
    let incidents = kept.incidents();
    let [Incident::Lost { reason }, Incident::Back] = &incidents[..] else { panic!("{incidents:?}") };
    assert!(reason.contains("camera cam") && reason.contains("opened anew"), "{reason}");
    let packets = kept.packets();
    assert_eq!(packets.iter().filter(|packet| packet.discontinuity).count(), 1);
    assert!(packets.iter().all(|packet| packet.payload.len() == 64 * 48));
    assert_eq!(camera.counters().reconnections, 1);
}

#[test]
fn control_that_another_program_takes_is_told_and_taken_back_when_it_is_free() {
    let front = plug(GigeOptions::default());
    let other = SocketAddrV4::new(Ipv4Addr::new(127, 0, 0, 9), 1);
    front.camera().give_to(Some(other), host_ns());
    let cameras = frame::list_gige(&[front.address()]).unwrap();
    let listed = cameras.iter().find(|camera| camera.bus == front.address().to_string()).unwrap();
    assert!(listed.problem.is_none(), "only the privilege tells: {listed:?}");
    // A host that has crashed keeps it for the heartbeat's time; one that lives keeps it.
    let mut channel = Holder::new(&front);
    channel.take();
    let listed = frame::list_gige(&[front.address()]).unwrap();
    let listed = listed.iter().find(|camera| camera.bus == front.address().to_string()).unwrap();
    assert!(listed.problem.as_ref().unwrap().contains("another program at 127."), "{listed:?}");
    let message = refused(&config(&front));
    assert!(message.contains("another program at 127.") && message.contains("close that program"), "{message}");
    channel.release();
    let config = config(&front);
    let mut camera = frame::open(&config).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    kept.wait_packets(3);
    front.camera().give_to(Some(other), host_ns());
    kept.wait("the loss", |kept| kept.incidents().iter().any(|incident| matches!(incident, Incident::Lost { .. })));
    front.camera().give_to(None, host_ns());
    kept.wait_back();
    camera.stop().unwrap();
    let incidents = kept.incidents();
    let Incident::Lost { reason } = &incidents[0] else { panic!("{incidents:?}") };
    assert!(reason.contains("another program took it"), "{reason}");
}

/// Another program that controls the camera, and lives.
struct Holder {
    channel: Arc<gige::Channel>,
    ending: Arc<std::sync::atomic::AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Holder {
    fn new(front: &GigeFront) -> Self {
        front.camera().give_to(None, host_ns());
        let channel = Arc::new(gige::Channel::open(front.address(), Ipv4Addr::UNSPECIFIED).unwrap());
        Self { channel, ending: Arc::default(), thread: None }
    }

    fn take(&mut self) {
        self.channel.set_register(0xa00, 2).unwrap();
        self.channel.set_register(0x938, 600).unwrap();
        let (channel, ending) = (self.channel.clone(), self.ending.clone());
        self.thread = Some(std::thread::spawn(move || {
            while !ending.load(std::sync::atomic::Ordering::Relaxed) {
                channel.register(0xa00).unwrap();
                std::thread::sleep(std::time::Duration::from_millis(50));
            }
        }));
    }

    fn release(&mut self) {
        self.ending.store(true, std::sync::atomic::Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
        self.channel.set_register(0xa00, 0).unwrap();
    }
}

#[test]
fn packets_that_do_not_pass_are_found_out_before_the_recording() {
    let faults = GigeFaults { mtu: Some(1500), ..GigeFaults::default() };
    let front = plug(GigeOptions { faults, ..GigeOptions::default() });
    let with = |packet_bytes| {
        let more = GenicamConfig { packet_bytes, ..config(&front).genicam.unwrap() };
        FrameConfig { genicam: Some(more), ..config(&front) }
    };
    let message = refused(&with(Some(9000)));
    assert!(
        message.contains("packets of 9000 bytes do not come through and those of 1500 do") && message.contains("MTU"),
        "{message}"
    );
    let camera = frame::open(&with(None)).unwrap();
    assert_eq!(camera.description().settings["packet_bytes"], 1500);
}

#[test]
fn what_the_camera_cannot_is_refused_with_what_it_can() {
    let front = plug(GigeOptions::default());
    let with = |change: fn(&mut FrameConfig)| {
        let mut config = config(&front);
        change(&mut config);
        refused(&config)
    };
    for (message, says) in [
        (with(|c| c.format = PixelFormat::Rgb8), "the camera has Mono8 (format = \"grey8\"), Mono12 (format"),
        (with(|c| c.width = 66), "the camera takes 16 to 640 in steps of 4 (Width)"),
        (with(|c| c.height = 1000), "height = 1000: the camera takes 2 to 480"),
        (with(|c| c.exposure_us = Lock::At(5.0)), "exposure_us = 5: the camera takes 10 to 1000000"),
        (with(|c| c.exposure_us = Lock::At(20_000.0)), "there is time for 10000 µs"),
        (
            with(|c| (c.height, c.rate_hz, c.exposure_us) = (480, 900.0, Lock::At(500.0))),
            "gives 416.67 frames a second at most",
        ),
        (with(|c| c.triggered = true), "genicam.trigger_line = \"\": name the input"),
        (with(|c| more(c).chunks = vec!["Gain".into()]), "the camera has Timestamp, ExposureTime, FrameID"),
        (with(|c| more(c).strobe_line = "Line7".into()), "it has Line0, Line1"),
        (with(|c| more(c).strobe_to = vec!["eye".into()]), "without strobe_line"),
        (with(|c| _ = more(c).features.insert("Sharpness".into(), 3.into())), "genicam.features.Sharpness = 3"),
        (with(|c| more(c).offset = [600, 0]), "the camera takes 0 to 576"),
        (with(|c| c.camera = "127.0.0.1".into()), "no GigE Vision camera is \"127.0.0.1\""),
    ] {
        assert!(message.contains(says) && message.contains("\"cam\""), "{says}: {message}");
    }
    // Nothing of that keeps the camera.
    assert!(frame::open(&FrameConfig { gain: Lock::Named(NamedLock::Auto), ..config(&front) }).is_ok());
}

fn more(config: &mut FrameConfig) -> &mut GenicamConfig {
    config.genicam.get_or_insert_with(GenicamConfig::default)
}

#[test]
fn commands_that_are_lost_are_repeated() {
    let faults = GigeFaults { lost_commands: (0..400).step_by(7).collect(), ..GigeFaults::default() };
    let front = plug(GigeOptions { faults, ..GigeOptions::default() });
    let (packets, _, _) = film(&config(&front), 3);
    assert!(packets.iter().all(|packet| !packet.damaged));
}

#[test]
fn cameras_are_chosen_by_serial_number_and_found_by_a_broadcast() {
    let one = plug(GigeOptions { serial: "GEV00007".into(), name: "left".into(), ..GigeOptions::default() });
    let two = plug(GigeOptions { serial: "GEV00008".into(), ..GigeOptions::default() });
    let addresses = vec![one.address(), two.address()];
    for (wanted, serial) in [("GEV00008", "GEV00008"), ("left", "GEV00007")] {
        let more = GenicamConfig { addresses: addresses.clone(), ..config(&one).genicam.unwrap() };
        let camera = frame::open(&FrameConfig { camera: wanted.into(), genicam: Some(more), ..config(&one) }).unwrap();
        assert_eq!(camera.description().serial, serial);
    }
    let (at, broadcast) = ([127, 0, 53, 1].into(), [127, 255, 255, 255].into());
    let scene = Box::new(PatternFrames::default());
    let third = GigeOptions { serial: "GEV00009".into(), ..GigeOptions::default() };
    let _front = GigeFront::plug_at(third, scene, at, broadcast).unwrap();
    let found = std::cell::RefCell::new(Vec::new());
    wait_for(
        || format!("an answer to a broadcast, of {found:?}"),
        || {
            found.replace(gige::ask(&[Target::Address(broadcast)]).unwrap());
            found.borrow().iter().any(|found| found.identity.serial == "GEV00009")
        },
    );
    let found = found.into_inner();
    assert!(found.iter().all(|found| found.reach == Reach::From(Ipv4Addr::UNSPECIFIED)));
}
