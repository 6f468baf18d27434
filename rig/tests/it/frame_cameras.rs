//! The V4L2 driver against cameras in user space: every call of the driver is the real one, its other end is emulated.
//! Each test runs itself again with the cameras' library preloaded.
#![cfg(target_os = "linux")]

use std::{collections::BTreeSet, env, path::Path, process::Command, sync::Arc};

use crate::kept::Kept;
use erfgs_hardware_mocks::v4l2::Cameras;
use erfgs_rig::{
    frame::{FoundCamera, FrameConfig, FrameError, Lock, NamedLock, PreciseCamera, list_in},
    host_time::host_ns,
};
use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::pixel::{self, BayerOrder, RawLook, Samples};
use erfgs_session::source::{Encoding, Incident, Packet, Source, StampClock, StampPoint};

const FOLDER: &str = "ERFGS_TEST_CAMERAS";

/// Runs `body` in a process of its own that sees the cameras.
fn among_cameras(test: &str, body: impl FnOnce(&Cameras)) {
    if let Some(folder) = env::var_os(FOLDER) {
        return body(&Cameras::at(Path::new(&folder)));
    }
    let folder = tempfile::tempdir().unwrap();
    let cameras = Cameras::build(folder.path()).unwrap();
    let mut command = Command::new(env::current_exe().unwrap());
    let test = format!("frame_cameras::{test}");
    command.args([&test, "--exact", "--nocapture"]).env(FOLDER, folder.path());
    cameras.preload(&mut command);
    let output = command.output().unwrap();
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert!(output.status.success() && text.contains("1 passed"), "{text}");
}

fn config(format: PixelFormat) -> FrameConfig {
    FrameConfig { format, width: 64, height: 48, rate_hz: 100.0, ..Default::default() }
}

fn open(cameras: &Cameras, config: &FrameConfig) -> Result<PreciseCamera, FrameError> {
    let (nodes, class) = (cameras.nodes().to_owned(), cameras.class().to_owned());
    PreciseCamera::open_among(config, move || list_in(&nodes, &class))
}

/// Takes frames of a camera that is alone and needs no more than its description.
fn film(cameras: &Cameras, description: &str, config: &FrameConfig, count: usize) -> (Vec<Packet>, PreciseCamera) {
    cameras.plug(0, "A1", description).unwrap();
    let mut camera = open(cameras, config).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    kept.wait_packets(count);
    camera.stop().unwrap();
    let packets = std::mem::take(&mut *kept.packets());
    assert!(kept.incidents().is_empty(), "{:?}", kept.incidents());
    (packets, camera)
}

#[test]
fn metadata_nodes_are_no_cameras() {
    among_cameras("metadata_nodes_are_no_cameras", |cameras| {
        cameras.plug(0, "A1", "card Left\nbus usb-1\n").unwrap();
        cameras.plug(1, "A1", "card Left\nbus usb-1\nmetadata 1\n").unwrap();
        cameras.plug(10, "", "card R\u{e9}ar\nbus usb-2\nformat MJPG 64 48\n").unwrap();
        let found = list_in(cameras.nodes(), cameras.class()).unwrap();
        let identities: Vec<_> = found.iter().map(|c| (c.name.as_str(), c.serial.as_str(), c.bus.as_str())).collect();
        assert_eq!(identities, [("Left", "A1", "usb-1"), ("R\u{e9}ar", "", "usb-2")]);
        assert_eq!(found[0].formats, ["YUYV"]);
        assert!(matches!(&found[1], FoundCamera { driver, problem: None, .. } if driver == "uvcvideo"));
    });
}

#[test]
fn frames_carry_the_kernels_stamps_and_counts() {
    among_cameras("frames_carry_the_kernels_stamps_and_counts", |cameras| {
        let before = host_ns();
        let (packets, camera) = film(cameras, "card Left\nbus usb-1\n", &config(PixelFormat::Yuyv), 20);
        for (at, packet) in packets.iter().enumerate() {
            assert_eq!(packet.sequence, at as u64);
            assert_eq!(packet.payload, vec![at as u8; 64 * 48 * 2]);
            let stamp = packet.stamp.unwrap();
            assert_eq!(stamp.sequence, at as u32);
            assert_eq!((stamp.clock, stamp.point), (StampClock::Monotonic, StampPoint::StartOfExposure));
            assert!(before < stamp.kernel_ns && stamp.kernel_ns <= packet.host_ns);
            assert!(!packet.damaged && !packet.discontinuity);
            pixel::decode(PixelFormat::Yuyv, 64, 48, &packet.payload).unwrap();
        }
        let description = camera.description();
        assert_eq!((description.width, description.height, description.encoding), (64, 48, PixelFormat::Yuyv.into()));
        assert_eq!((description.model.as_str(), description.serial.as_str()), ("Left", "A1"));
        let counters = camera.counters();
        assert_eq!((counters.packets, counters.lost, counters.errors), (packets.len() as u64, 0, 0));
        assert_eq!(counters.bytes, packets.len() as u64 * 64 * 48 * 2);
    });
}

#[test]
fn other_clocks_and_points_are_told() {
    among_cameras("other_clocks_and_points_are_told", |cameras| {
        let (packets, _) = film(cameras, "card L\nclock other\npoint eof\n", &config(PixelFormat::Yuyv), 2);
        let stamp = packets[0].stamp.unwrap();
        assert_eq!((stamp.clock, stamp.point), (StampClock::Unknown, StampPoint::EndOfFrame));
    });
}

#[test]
fn every_format_arrives_as_its_encoding_says() {
    among_cameras("every_format_arrives_as_its_encoding_says", |cameras| {
        let pixels = 64 * 48;
        let plain = [
            ("mjpeg", "MJPG", 1000),
            ("uyvy", "UYVY", 2 * pixels),
            ("nv12", "NV12", pixels * 3 / 2),
            ("rgb8", "RGB3", 3 * pixels),
            ("bgr8", "BGR3", 3 * pixels),
            ("grey8", "GREY", pixels),
            ("grey10", "Y10 ", 2 * pixels),
            ("grey12", "Y12 ", 2 * pixels),
            ("grey10p", "Y10P", pixels * 5 / 4),
            ("grey12p", "Y12P", pixels * 3 / 2),
        ];
        // The codes of linux/videodev2.h, in its order: 8 bits, words of 10 and 12, packed ones.
        let bayer = [
            ("bggr8", "BA81", pixels),
            ("gbrg8", "GBRG", pixels),
            ("grbg8", "GRBG", pixels),
            ("rggb8", "RGGB", pixels),
            ("bggr10", "BG10", 2 * pixels),
            ("gbrg10", "GB10", 2 * pixels),
            ("grbg10", "BA10", 2 * pixels),
            ("rggb10", "RG10", 2 * pixels),
            ("bggr10p", "pBAA", pixels * 5 / 4),
            ("gbrg10p", "pGAA", pixels * 5 / 4),
            ("grbg10p", "pgAA", pixels * 5 / 4),
            ("rggb10p", "pRAA", pixels * 5 / 4),
            ("bggr12", "BG12", 2 * pixels),
            ("gbrg12", "GB12", 2 * pixels),
            ("grbg12", "BA12", 2 * pixels),
            ("rggb12", "RG12", 2 * pixels),
            ("bggr12p", "pBCC", pixels * 3 / 2),
            ("gbrg12p", "pGCC", pixels * 3 / 2),
            ("grbg12p", "pgCC", pixels * 3 / 2),
            ("rggb12p", "pRCC", pixels * 3 / 2),
        ];
        for (name, code, bytes) in plain.into_iter().chain(bayer) {
            let format = name.parse::<Encoding>().unwrap().frames().unwrap();
            for padding in [0, 32] {
                let description = format!("card L\nfps 500\nformat {code} 64 48 {padding}\n");
                let (packets, camera) =
                    film(cameras, &description, &FrameConfig { rate_hz: 500.0, ..config(format) }, 3);
                assert_eq!(packets[2].payload.len(), bytes, "{code} with {padding}");
                assert!(!packets[2].damaged, "{code} with {padding}");
                assert_eq!(camera.description().encoding, format.into());
                if format != PixelFormat::Mjpeg {
                    camera.description().frame_format().unwrap().picture(&packets[2].payload).unwrap();
                }
            }
        }
    });
}

#[test]
fn how_raw_frames_look_is_recorded_with_them() {
    among_cameras("how_raw_frames_look_is_recorded_with_them", |cameras| {
        let raw = RawLook { black_level: 4.0, white_balance: [1.5, 1.0, 2.0], response: None };
        let config = FrameConfig { raw: Some(raw), ..config(PixelFormat::Bayer(BayerOrder::Rggb, Samples::Bits8)) };
        let (packets, camera) = film(cameras, "card L\nformat RGGB 64 48\n", &config, 5);
        assert_eq!(camera.description().frame_format().unwrap().look, raw);
        // Frame 4 is filled with the value of black.
        assert_eq!(packets[4].payload, vec![4; 64 * 48]);
        assert!(
            camera
                .description()
                .frame_format()
                .unwrap()
                .picture(&packets[4].payload)
                .unwrap()
                .data
                .iter()
                .all(|&level| level == 0)
        );
    });
}

#[test]
fn lost_damaged_cut_and_empty_frames_are_told_apart() {
    among_cameras("lost_damaged_cut_and_empty_frames_are_told_apart", |cameras| {
        let description = "card L\nformat MJPG 64 48\nskip 3\ndamage 5\ncut 7\nempty 9\n";
        let (packets, camera) = film(cameras, description, &config(PixelFormat::Mjpeg), 12);
        let counts: Vec<_> = packets.iter().map(|packet| packet.stamp.unwrap().sequence).collect();
        assert_eq!(counts[..10], [0, 1, 2, 4, 5, 6, 7, 8, 10, 11]);
        let damaged: Vec<_> =
            packets.iter().filter(|packet| packet.damaged).map(|p| p.stamp.unwrap().sequence).collect();
        assert_eq!(damaged, [5, 7]);
        let counters = camera.counters();
        assert_eq!((counters.lost, counters.errors), (1, 3));
    });
}

#[test]
fn a_camera_that_is_unplugged_comes_back_under_another_node() {
    among_cameras("a_camera_that_is_unplugged_comes_back_under_another_node", |cameras| {
        cameras.plug(0, "A1", "card Left\nbus usb-1\nunplug 10\n").unwrap();
        let mut camera = open(cameras, &config(PixelFormat::Yuyv)).unwrap();
        let kept = Arc::new(Kept::default());
        camera.start(kept.clone()).unwrap();
        kept.wait("the loss", |kept| !kept.incidents().is_empty());
        assert!(!cameras.nodes().join("video0").exists());
        // Another camera takes its node; it comes back elsewhere.
        cameras.plug(0, "B2", "card Right\nbus usb-2\n").unwrap();
        cameras.plug(4, "A1", "card Left\nbus usb-3\n").unwrap();
        kept.wait_back();
        kept.wait_packets(20);
        camera.stop().unwrap();
        let incidents = kept.incidents();
        assert!(matches!(&incidents[..], [Incident::Lost { reason }, Incident::Back] if reason.contains("unplugged")));
        let packets = kept.packets();
        assert!(packets.iter().enumerate().all(|(at, packet)| packet.sequence == at as u64));
        let breaks: Vec<_> = packets.iter().filter(|p| p.discontinuity).map(|p| p.sequence).collect();
        assert_eq!(breaks, [10]);
        assert_eq!((camera.counters().reconnections, camera.counters().lost), (1, 0));
    });
}

#[test]
fn a_dead_camera_blocks_nothing_and_is_opened_anew() {
    among_cameras("a_dead_camera_blocks_nothing_and_is_opened_anew", |cameras| {
        cameras.plug(0, "A1", "card Left\nbus usb-1\ndie 5\n").unwrap();
        let config = FrameConfig { timeout_ms: 200, ..config(PixelFormat::Yuyv) };
        let mut camera = open(cameras, &config).unwrap();
        let kept = Arc::new(Kept::default());
        camera.start(kept.clone()).unwrap();
        kept.wait_back();
        kept.wait_packets(10);
        camera.stop().unwrap();
        let incidents = kept.incidents();
        assert!(matches!(&incidents[0], Incident::Lost { reason } if reason.contains("no frame for 200 ms")));
    });
}

#[test]
fn a_triggered_camera_may_wait_as_long_as_it_likes() {
    among_cameras("a_triggered_camera_may_wait_as_long_as_it_likes", |cameras| {
        cameras.plug(0, "A1", "card Left\nbus usb-1\nfps 2\n").unwrap();
        let waiting = |triggered| {
            let config = FrameConfig { rate_hz: 2.0, timeout_ms: 20, triggered, ..config(PixelFormat::Yuyv) };
            let mut camera = open(cameras, &config).unwrap();
            let kept = Arc::new(Kept::default());
            camera.start(kept.clone()).unwrap();
            (camera, kept)
        };
        let (mut camera, kept) = waiting(true);
        kept.wait_packets(2);
        camera.stop().unwrap();
        assert_eq!(*kept.incidents(), []);
        assert_eq!(camera.description().settings["triggered"], true);
        // One that is not triggered counts as lost in the same time.
        let (mut camera, kept) = waiting(false);
        kept.wait("the loss", |kept| !kept.incidents().is_empty());
        camera.stop().unwrap();
    });
}

#[test]
fn exposure_gain_and_white_balance_are_locked_and_read_back() {
    among_cameras("exposure_gain_and_white_balance_are_locked_and_read_back", |cameras| {
        cameras.plug(0, "A1", "card Left\nbus usb-1\n").unwrap();
        let held = open(cameras, &config(PixelFormat::Yuyv)).unwrap();
        let settings = &held.description().settings;
        assert_eq!((&settings["exposure_us"], &settings["exposure_us_locked"]), (&25_000.0.into(), &true.into()));
        assert_eq!((&settings["white_balance_k"], &settings["white_balance_k_locked"]), (&4600.0.into(), &true.into()));
        assert_eq!(settings["focus_locked"], true);
        assert!(!settings.contains_key("not_applied"));

        let wanted = FrameConfig {
            exposure_us: Lock::At(5020.0),
            gain: Lock::At(10.0),
            white_balance_k: Lock::Named(NamedLock::Auto),
            ..config(PixelFormat::Yuyv)
        };
        let set = open(cameras, &wanted).unwrap();
        let settings = &set.description().settings;
        assert_eq!(settings["exposure_us"], 5000.0, "what the camera took, not what was asked for");
        assert_eq!((&settings["gain"], &settings["white_balance_k_locked"]), (&10.0.into(), &false.into()));

        let refused = |config: FrameConfig| open(cameras, &config).map(|_| ()).unwrap_err().to_string();
        let too_long = refused(FrameConfig { exposure_us: Lock::At(1e6), ..wanted.clone() });
        assert!(too_long.contains("exposure_us to 1000000") && too_long.contains("300 to 204700"), "{too_long}");
        let absent = refused(FrameConfig { focus: Lock::At(10.0), ..wanted });
        assert!(absent.contains("no such control"), "{absent}");
    });
}

#[test]
fn what_a_camera_cannot_do_is_said_with_what_it_can() {
    among_cameras("what_a_camera_cannot_do_is_said_with_what_it_can", |cameras| {
        cameras.plug(0, "A1", "card Left\nbus usb-1\nbusy 1\n").unwrap();
        let refused = |config: &FrameConfig| open(cameras, config).map(|_| ()).unwrap_err().to_string();
        let format = refused(&config(PixelFormat::Mjpeg));
        assert!(format.contains("no MJPG of 64 x 48") && format.contains("Its formats: YUYV"), "{format}");
        // A format that it has, by both of its names.
        let raw = refused(&config(PixelFormat::Bayer(BayerOrder::Grbg, Samples::Packed10)));
        assert!(raw.contains("no pgAA of 64 x 48") && raw.contains("YUYV (format = \"yuyv\")"), "{raw}");
        let size = refused(&FrameConfig { width: 640, ..config(PixelFormat::Yuyv) });
        assert!(size.contains("it offers YUYV of 64 x 48"), "{size}");
        let absent = refused(&FrameConfig { camera: "B2".into(), ..config(PixelFormat::Yuyv) });
        assert!(absent.contains("none is \"B2\"") && absent.contains("Left"), "{absent}");

        let mut camera = open(cameras, &config(PixelFormat::Yuyv)).unwrap();
        let busy = camera.start(Arc::new(Kept::default())).unwrap_err().to_string();
        assert!(busy.contains("Another program uses it"), "{busy}");

        cameras.plug(0, "A1", "card Left\nbus usb-1\nfps 25\n").unwrap();
        let wanted = FrameConfig { gain: Lock::Named(NamedLock::Auto), ..config(PixelFormat::Yuyv) };
        let mut slow = open(cameras, &wanted).unwrap();
        assert_eq!(slow.description().settings["rate_hz"], 25.0);
        // The checks before a recording tell it.
        let missed = ["gain = \"auto\" (the camera has no automatic mode for it)", "rate_hz = 100 (it has 25)"];
        assert_eq!(slow.description().settings["not_applied"], serde_json::json!(missed));
        let kept = Arc::new(Kept::default());
        slow.start(kept.clone()).unwrap();
        slow.stop().unwrap();
        let incidents = kept.incidents();
        assert!(
            matches!(&incidents[..], [Incident::Warning { message }] if message.contains("25.00 frames a second, not 100"))
        );
    });
}

#[test]
fn four_cameras_stream_at_once_and_again_after_a_stop() {
    among_cameras("four_cameras_stream_at_once_and_again_after_a_stop", |cameras| {
        let mut sources: Vec<_> = (0..4)
            .map(|number| {
                cameras.plug(number, &format!("S{number}"), &format!("card L\nbus usb-{number}\n")).unwrap();
                let config = FrameConfig { camera: format!("S{number}"), ..config(PixelFormat::Yuyv) };
                (open(cameras, &config), Arc::new(Kept::default()))
            })
            .map(|(camera, kept)| (camera.unwrap(), kept))
            .collect();
        for round in 1..=2 {
            for (camera, kept) in &mut sources {
                camera.start(kept.clone()).unwrap();
            }
            for (camera, kept) in &mut sources {
                kept.wait_packets(10 * round);
                camera.stop().unwrap();
            }
        }
        let serials: BTreeSet<_> = sources.iter().map(|(camera, _)| camera.description().serial.clone()).collect();
        assert_eq!(serials.len(), 4);
        assert!(sources.iter().all(|(camera, _)| camera.counters().lost == 0));
    });
}
