//! The camera drivers against the kernel's own virtual cameras (vivid), in the QEMU guest:
//! `scripts/emulation.sh cameras` loads the module and runs these tests, which have no camera elsewhere.
#![cfg(target_os = "linux")]

#[path = "it/kept/mod.rs"]
mod kept;

use std::sync::Arc;

use erfgs_rig::{
    frame::{self, Backend, FrameConfig, Lock},
    host_time::host_ns,
};
use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::{
    ImageRgb8,
    pixel::{self, BayerOrder, RawLook, Response, Samples},
};
use erfgs_session::source::{Description, Packet, StampClock, StampPoint};
use kept::Kept;

fn film(config: &FrameConfig, count: usize) -> (Description, Vec<Packet>) {
    let mut camera = frame::open(config).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    kept.wait_packets(count);
    camera.stop().unwrap();
    assert_eq!(camera.counters().packets, kept.packets().len() as u64);
    println!("{}", serde_json::to_string(camera.description()).unwrap());
    let packets = std::mem::take(&mut *kept.packets());
    (camera.description().clone(), packets)
}

/// Small and slow, because of how vivid counts: it waits for the next frame from when it began to fill the last, as long
/// as is left when it has filled it, and numbers frames by the time since the start, rounded. What filling takes is so
/// taken off twice; where that is more than half a period, two frames get one number. These take a tenth of that.
const WIDTH: u32 = 320;
const HEIGHT: u32 = 180;
const PERIOD_NS: i64 = 100_000_000;

fn vivid(number: u32) -> FrameConfig {
    FrameConfig {
        camera: format!("/dev/video{number}"),
        format: PixelFormat::Yuyv,
        width: WIDTH,
        height: HEIGHT,
        rate_hz: 1e9 / PERIOD_NS as f64,
        ..Default::default()
    }
}

#[test]
#[ignore = "needs the guest: scripts/emulation.sh cameras"]
fn vivid_cameras_are_listed_without_their_other_nodes() {
    let nodes: Vec<_> = frame::list().unwrap().into_iter().map(|camera| camera.node).collect();
    assert_eq!(nodes, ["/dev/video0", "/dev/video10"].map(std::path::PathBuf::from));
}

#[test]
#[ignore = "needs the guest: scripts/emulation.sh cameras"]
fn the_kernels_frames_come_with_its_stamps() {
    for format in [PixelFormat::Yuyv, PixelFormat::Nv12, PixelFormat::Grey8, PixelFormat::Rgb8] {
        let config = FrameConfig { format, ..vivid(0) };
        let before_ns = host_ns();
        let (_, packets) = film(&config, 15);
        let stamps: Vec<_> = packets.iter().map(|packet| packet.stamp.unwrap()).collect();
        for pair in stamps.windows(2) {
            assert!(pair[1].kernel_ns > pair[0].kernel_ns && pair[1].sequence > pair[0].sequence, "{pair:?}");
        }
        for (stamp, packet) in stamps.iter().zip(&packets) {
            assert_eq!((stamp.clock, stamp.point), (StampClock::Monotonic, StampPoint::EndOfFrame));
            // vivid hands a frame over at its start and stamps its end, 0.9 periods later. How soon after that we take it
            // says nothing: an emulated processor may be far behind.
            let earliest = before_ns + PERIOD_NS * 9 / 10;
            let latest = packet.host_ns + PERIOD_NS * 9 / 10;
            assert!((earliest..=latest).contains(&stamp.kernel_ns), "{stamp:?} is not in {earliest}..={latest}");
        }
        let image = pixel::decode(format, WIDTH, HEIGHT, &packets[14].payload).unwrap();
        assert!(image.data.iter().any(|&byte| byte != image.data[0]), "{format:?} shows nothing");
    }
}

/// The mean colours of the eight bars of vivid's picture, away from their borders.
fn bars(image: &ImageRgb8) -> Vec<[f64; 3]> {
    let bar = WIDTH / 8;
    let mean = |from: u32, channel: usize| {
        let places = (HEIGHT * 3 / 4..HEIGHT).flat_map(|y| (from + bar / 4..from + bar * 3 / 4).map(move |x| (x, y)));
        let levels: Vec<f64> = places.map(|(x, y)| image.pixel(x, y)[channel].into()).collect();
        levels.iter().sum::<f64>() / levels.len() as f64
    };
    (0..8).map(|at| [0, 1, 2].map(|channel| mean(at * bar, channel))).collect()
}

#[test]
#[ignore = "needs the guest: scripts/emulation.sh cameras"]
fn the_same_bars_have_the_same_colours_in_every_format() {
    // vivid's mosaics hold codes of pictures, not light.
    let coded = Some(RawLook { response: Some(Response::Srgb), ..RawLook::default() });
    let seen = |format: PixelFormat| {
        let raw = coded.filter(|_| matches!(format, PixelFormat::Bayer(..)));
        let (description, packets) = film(&FrameConfig { format, raw, ..vivid(0) }, 2);
        assert!(!packets[1].damaged, "{format}");
        bars(&description.frame_format().unwrap().picture(&packets[1].payload).unwrap())
    };
    let reference = seen(PixelFormat::Rgb8);
    let spread = |channel: usize| reference.iter().map(|bar| bar[channel]).fold(0.0, f64::max);
    assert!((0..3).all(|channel| spread(channel) > 150.0), "{reference:?} are no colours");
    let words = [Samples::Bits8, Samples::Bits10, Samples::Bits12];
    let bayer = words.into_iter().flat_map(|samples| BayerOrder::ALL.map(|order| PixelFormat::Bayer(order, samples)));
    for format in [PixelFormat::Bgr8, PixelFormat::Yuyv, PixelFormat::Uyvy, PixelFormat::Nv12].into_iter().chain(bayer)
    {
        for (bar, expected) in std::iter::zip(seen(format), &reference) {
            let off = std::iter::zip(bar, expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 4.0, "{format}: {bar:?} is not {expected:?}");
        }
    }
}

#[test]
#[ignore = "needs the guest: scripts/emulation.sh cameras"]
fn gain_is_set_and_read_back_by_the_kernel() {
    let config = FrameConfig { gain: Lock::At(77.0), ..vivid(10) };
    let camera = frame::open(&config).unwrap();
    let settings = &camera.description().settings;
    assert_eq!((&settings["gain"], &settings["gain_locked"]), (&77.0.into(), &true.into()));
}

#[test]
#[ignore = "needs the guest: scripts/emulation.sh cameras"]
fn the_portable_driver_reads_the_same_camera() {
    let config = FrameConfig { backend: Backend::Portable, ..vivid(10) };
    let (_, packets) = film(&config, 10);
    assert!(packets.iter().all(|packet| packet.stamp.is_none() && !packet.damaged));
    assert!(packets.windows(2).all(|pair| pair[1].host_ns > pair[0].host_ns));
}
