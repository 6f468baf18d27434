//! A USB3 Vision camera: listed, recorded, told of, synchronised and exported. No kernel is at hand through which the program could open
//! an emulated USB device (`scripts/emulation.sh` has one), so the recorder runs in this process, on an emulated bus; the program reads
//! what it wrote.

use std::{
    fs,
    ops::Range,
    path::Path,
    sync::{Arc, Mutex},
    thread::sleep,
    time::{Duration, Instant},
};

use erfgs_hardware_mocks::usb::{
    Fault, FaultKind, Faults, Plug, SharedCounts, U3v, U3vFaults, U3vOptions,
    scene::{FrameScene, PatternFrames},
    uvc::{Format, FrameTruth},
};
use erfgs_recorder::{
    Options, Recorder, RigConfig, SessionFiles, SessionInfo, StreamStatus, Summary, open_on,
    preflight::{self, Finding, Plan, Verdict},
};
use erfgs_rig::{frame::list_u3v_on, usb::Bus};
use erfgs_session::{Session, container::Entry, source::Packet};

use super::{bus::EmulatedBus, host_clock::HostClock};
use crate::recording::files::{erfgs, json};

const SIZE: [u32; 2] = [64, 48];
/// Slow enough for a machine that is busy.
const RATE_HZ: f64 = 40.0;
const HALF_PERIOD_NS: i64 = 12_500_000;

/// A bus with a camera, in which and on whose cable something goes wrong; and what the camera counts.
fn bus(blocks: U3vFaults, schedule: Vec<Fault>) -> (Arc<dyn Bus>, SharedCounts) {
    let options =
        U3vOptions { serial: "U3V00042".into(), name: "left".into(), faults: blocks, ..U3vOptions::default() };
    let camera = U3v::new(options, Box::new(PatternFrames::default()));
    let counts = camera.counts();
    let bus = EmulatedBus::new(Arc::new(HostClock));
    bus.add(Arc::new(Mutex::new(Plug::new(camera, &Faults { schedule, ..Faults::default() }))));
    (Arc::new(bus), counts)
}

fn rig(serial: &str, [width, height]: [u32; 2], rate_hz: f64, more: &str) -> RigConfig {
    let text = format!(
        "[[camera]]\nid = \"mono\"\ncamera = \"{serial}\"\nbackend = \"u3v\"\nformat = \"grey8\"\nwidth = {width}\nheight = {height}\n\
         rate_hz = {rate_hz:.1}\nexposure_us = 2000\n{more}"
    );
    parsed(&text)
}

fn parsed(text: &str) -> RigConfig {
    RigConfig::parse(text, Path::new("rig.toml")).expect("a rig")
}

/// Records into `take.mcap` until `enough` of what the stream has come to.
fn record(folder: &Path, bus: &Arc<dyn Bus>, rig: &RigConfig, enough: impl Fn(&StreamStatus) -> bool) -> Summary {
    let options = Options {
        info: SessionInfo { rig: "test".into(), ..SessionInfo::default() },
        flush_every: Duration::from_millis(50),
        reserve_bytes: 0,
        folder: folder.to_owned(),
        opener: Box::new(SessionFiles::default()),
        subscriber: None,
        before: None,
        after: None,
        rig_file: None,
    };
    let recorder = Recorder::new(open_on(rig, bus).expect("a camera"), options).expect("a recorder");
    recorder.start_recording(&folder.join("take.mcap")).expect("a session");
    recorder.start_sources().expect("a stream");
    let begun = Instant::now();
    while !enough(&recorder.status().streams[0]) {
        assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", recorder.status().streams);
        sleep(Duration::from_millis(5));
    }
    recorder.stop_sources();
    recorder.stop_recording("enough").expect("a whole session")
}

fn packets(folder: &Path) -> Vec<Packet> {
    let mut session = Session::open(&folder.join("take.mcap")).expect("a session");
    let entries = session.messages(None).map(|entry| entry.expect("an intact session"));
    entries.filter_map(|entry| if let Entry::Packet { packet, .. } = entry { Some(packet) } else { None }).collect()
}

fn number(packet: &Packet) -> u32 {
    packet.stamp.expect("the camera's stamp").sequence
}

/// The bytes that the camera sent: the pattern, with the truth in its first pixels.
fn sent(packet: &Packet) -> Vec<u8> {
    let truth = FrameTruth::of(Format::Grey, &packet.payload).expect("the truth");
    assert_eq!(truth.number, u64::from(number(packet)));
    let (_, picture) = PatternFrames::default().frame(truth.number, truth.exposure_ns, SIZE[0], SIZE[1]);
    let mut bytes = picture.luma();
    bytes[..8].copy_from_slice(&truth.number.to_le_bytes());
    bytes[8..16].copy_from_slice(&truth.exposure_ns[0].to_le_bytes());
    bytes[16..24].copy_from_slice(&truth.exposure_ns[1].to_le_bytes());
    bytes
}

/// By how much the times of whole frames, as exported, differ from those of their exposures: all by the same, but for this.
fn spread_ns(folder: &Path, found: &[Packet], which: Range<usize>) -> i64 {
    let table = fs::read_to_string(folder.join("pictures/mono/frames.csv")).expect("times");
    let mids = table.lines().skip(1).map(|line| line.rsplit(',').next().expect("a field").parse().expect("a time"));
    let mids: Vec<i64> = mids.collect();
    assert_eq!(mids.len(), found.len());
    let offsets = which.filter(|&at| !found[at].damaged).map(|at| {
        let truth = FrameTruth::of(Format::Grey, &found[at].payload).expect("the truth");
        mids[at] - (truth.exposure_ns[0] + truth.exposure_ns[1]) / 2
    });
    let offsets: Vec<i64> = offsets.collect();
    offsets.iter().max().expect("frames") - offsets.iter().min().expect("frames")
}

#[test]
fn a_usb_camera_is_listed_recorded_synchronised_and_exported() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    // A packet is lost, one block ends early, one has no trailer, two do not come, and one has no leader.
    let faults = U3vFaults {
        lost_packets: [(3, 1)].into(),
        truncated: [(5, 1500)].into(),
        without_trailer: [7].into(),
        lost_blocks: [9, 10].into(),
        without_leader: [12].into(),
        ..U3vFaults::default()
    };
    let (bus, counts) = bus(faults, Vec::new());
    let listed = list_u3v_on(&*bus).expect("a list");
    let [camera] = &listed[..] else { panic!("{listed:?}") };
    assert_eq!((camera.name.as_str(), camera.serial.as_str()), ("erfgs Emulated U3V \"left\"", "U3V00042"));
    assert_eq!((camera.bus.as_str(), &camera.problem), ("1-1", &None));

    let more =
        "gain = 6\n[camera.genicam]\noffset = [16, 8]\nblack_level = 12.0\nchunks = [\"ExposureTime\", \"FrameID\"]\n";
    let has = |stream: &StreamStatus, name: &str| stream.readings.get(name).is_some_and(|value| *value > 0.0);
    let summary = record(folder, &bus, &rig("left", SIZE, RATE_HZ, more), |stream| {
        stream.written >= 40 && has(stream, "frames_without_end") && has(stream, "chunk ExposureTime")
    });
    let stream = &summary.streams[0];
    assert!(summary.failure.is_none(), "{summary:?}");
    // Each loss once, at the driver, which is where it showed.
    assert_eq!((stream.drops.driver, stream.drops.total(), stream.counters.errors), (3, 3, 3), "{stream:?}");
    assert_eq!((stream.readings["missing_packets"], stream.readings["frames_without_end"]), (2.0, 1.0));
    assert_eq!(stream.readings["chunk ExposureTime"], 2000.0);

    let found = packets(folder);
    let numbers: Vec<u32> = found.iter().map(number).collect();
    assert_eq!(numbers[..12], [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 14]);
    let newest = *numbers.last().expect("frames");
    assert_eq!(u64::from(newest) + 1, stream.written + stream.drops.driver, "what is not written is lost, and counted");
    // The camera itself lost nothing for want of a host that reads.
    let exposed = counts.get();
    assert!(exposed.seen > newest.into() && (exposed.frames, exposed.lost) == (exposed.seen, 0), "{exposed:?}");
    let damaged: Vec<u32> = found.iter().filter(|packet| packet.damaged).map(number).collect();
    assert_eq!(damaged, [3, 5, 7]);
    for packet in found.iter().filter(|packet| !packet.damaged) {
        assert!(packet.payload == sent(packet), "frame {}", number(packet));
    }

    let info = json(folder, &["info", "take.mcap", "--json"]);
    let (recorded, settings) = (&info["streams"][0], &info["streams"][0]["settings"]);
    assert_eq!((&recorded["packets"], &recorded["damaged"]), (&stream.written.into(), &3.into()));
    assert_eq!(
        (&settings["backend"], &settings["port"], &settings["user_name"]),
        (&"u3v".into(), &"1-1".into(), &"left".into())
    );
    for (name, value) in
        [("exposure_us", 2000.0), ("gain", 6.0), ("black_level", 12.0), ("region_x", 16.0), ("rate_hz", RATE_HZ)]
    {
        assert_eq!(settings[name], value, "{name}");
    }
    assert_eq!((settings.get("not_applied"), &settings["stream"]["transfers"]), (None, &8.into()));

    let sync = json(folder, &["sync", "take.mcap", "--json"]);
    assert_eq!(sync["streams"][0]["tier"], "free-running", "{sync}");
    let exported = json(folder, &["export", "take.mcap", "--to", "png", "--out", "pictures", "--json"]);
    assert_eq!((&exported[0]["frames"], &exported[0]["damaged"]), (&stream.written.into(), &0.into()));
    assert!(spread_ns(folder, &found, 0..found.len()) < HALF_PERIOD_NS);
    for (index, packet) in found.iter().enumerate() {
        let picture = image::open(folder.join(format!("pictures/mono/{index:06}.png"))).expect("a picture").into_rgb8();
        let [red, green, blue] =
            [0, 1, 2].map(|channel| picture.pixels().map(move |pixel| pixel.0[channel]).collect::<Vec<_>>());
        assert!(red == packet.payload && green == red && blue == red, "picture {index}");
    }
}

#[test]
fn a_cable_that_is_out_and_in_again_costs_what_was_exposed_meanwhile() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (bus, _) = bus(U3vFaults::default(), vec![Fault { at_ms: 2500, kind: FaultKind::Unplug { for_ms: 500 } }]);
    let at_return = Mutex::new(None);
    let summary = record(folder, &bus, &rig("U3V00042", SIZE, RATE_HZ, ""), |stream| {
        let mut at_return = at_return.lock().expect("no panic");
        if at_return.is_none() && stream.counters.reconnections == 1 {
            *at_return = Some(stream.written);
        }
        at_return.is_some_and(|before| stream.written >= before + 20)
    });
    let stream = &summary.streams[0];
    assert_eq!((stream.counters.reconnections, stream.drops.queue, stream.drops.writer), (1, 0, 0), "{stream:?}");

    let found = packets(folder);
    assert_eq!(found.len() as u64, stream.written);
    let cuts: Vec<usize> = (0..found.len()).filter(|&at| found[at].discontinuity).collect();
    let [cut] = cuts[..] else { panic!("{cuts:?}") };
    // On both sides every frame that the camera exposed; the one that was under way when the cable went may be there in part.
    for (side, part) in [&found[..cut], &found[cut..]].into_iter().enumerate() {
        let numbers: Vec<u32> = part.iter().map(number).collect();
        assert_eq!(numbers, (0..part.len() as u32).collect::<Vec<_>>());
        let whole = part.iter().filter(|packet| !packet.damaged);
        assert!(whole.clone().count() + usize::from(side == 0) >= part.len());
        assert!(whole.clone().count() > 10 && whole.clone().all(|packet| packet.payload == sent(packet)));
    }
    let times: Vec<i64> = found.iter().map(|packet| packet.host_ns).collect();
    assert!(times[cut] - times[cut - 1] > 450_000_000, "{} ns without a camera", times[cut] - times[cut - 1]);

    let info = json(folder, &["info", "take.mcap", "--json"]);
    let incidents = info["incidents"].to_string();
    assert!(incidents.contains("its stream broke: the device is disconnected. Check the cable"), "{incidents}");
    assert_eq!(info["streams"][0]["discontinuities"], 1);
    let sync = json(folder, &["sync", "take.mcap", "--json"]);
    assert_eq!(sync["streams"][0]["tier"], "free-running", "{sync}");
    json(folder, &["export", "take.mcap", "--to", "png", "--out", "pictures", "--json"]);
    // A clock for each time that it was powered up.
    for side in [0..cut, cut..found.len()] {
        assert!(spread_ns(folder, &found, side) < HALF_PERIOD_NS);
    }
}

/// The findings of the checks before a recording, on a machine whose bus has this speed and whose kernel has this much memory for
/// transfers.
fn findings(bus: &Arc<dyn Bus>, rig: &RigConfig, mbit: u32, memory_mib: u32) -> Vec<Finding> {
    let root = tempfile::tempdir().expect("a folder");
    let write = |path: &str, text: String| {
        let path = root.path().join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(path, text).expect("written");
    };
    for device in ["usb1", "1-1"] {
        write(&format!("sys/bus/usb/devices/{device}/busnum"), "1".into());
        write(&format!("sys/bus/usb/devices/{device}/speed"), mbit.to_string());
    }
    write("sys/module/usbcore/parameters/usbfs_memory_mb", memory_mib.to_string());
    let inputs = open_on(rig, bus).expect("a camera");
    let streams: Vec<_> = inputs.iter().map(|input| input.source.description().clone()).collect();
    let plan = Plan {
        streams: &streams,
        folder: root.path(),
        duration: None,
        reserve_bytes: 0,
        queue_bytes: 0,
        disk_test: Duration::ZERO,
    };
    preflight::check_under(&plan, root.path())
}

#[test]
fn what_would_be_lost_is_refused_before_a_recording() {
    let (bus, _) = bus(U3vFaults::default(), Vec::new());
    let of = |findings: &[Finding], check: &str| -> Vec<(Verdict, String)> {
        let these = findings.iter().filter(|finding| finding.check == check);
        these.map(|finding| (finding.verdict, format!("{}: {}", finding.says, finding.remedy))).collect()
    };
    let small = rig("U3V00042", SIZE, RATE_HZ, "");
    let good = findings(&bus, &small, 5000, 16);
    assert_eq!(preflight::worst(&good), Verdict::Good, "{good:?}");
    // 61 MB/s over a link that carries 48.
    let large = parsed(&rig("U3V00042", [640, 480], 100.0, "").text.replace("grey8", "grey12"));
    let slow = findings(&bus, &large, 480, 16);
    let [(Verdict::Refusal, says), ..] = &of(&slow, "usb")[..] else { panic!("{slow:?}") };
    assert!(says.contains("'mono' at 1-1 is linked at 480 Mbit/s") && says.contains("use a USB 3 port"), "{says}");
    // Its transfers are counted, 10 of 256 KiB.
    let [(Verdict::Warning, says)] = &of(&findings(&bus, &large, 5000, 1), "usbfs memory")[..] else {
        panic!("{slow:?}")
    };
    assert!(says.contains("keep 3 MiB of USB transfers in flight; the kernel allows 1 MiB"), "{says}");

    let refused =
        |text: &str| open_on(&parsed(text), &bus).err().map(|error| error.to_string()).expect("it is refused");
    for (text, says) in [
        (small.text.replace("U3V00042", "U3V00043"), "no USB3 Vision camera is \"U3V00043\""),
        (small.text.replace("grey8", "rgb8"), "the camera has Mono8 (format = \"grey8\")"),
        (small.text.replace("= 2000", "= 30000"), "there is time for 25000 µs"),
    ] {
        let message = refused(&text);
        assert!(message.starts_with("cannot open 'mono'") && message.contains(says), "{message}");
    }
}

/// Where no such camera is, the program says so.
#[test]
fn a_camera_that_is_not_there_is_missed_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("rig.toml"), rig("U3V00042", SIZE, RATE_HZ, "").text).expect("written");
    let output = erfgs(folder.path(), &["record", "rig.toml", "--out", "take.mcap", "--no-preflight"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && stderr.contains("USB3 Vision camera"), "{stderr}");
}
