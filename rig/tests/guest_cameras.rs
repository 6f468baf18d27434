//! The camera drivers against the kernel's own virtual cameras (vivid), in the QEMU guest:
//! `scripts/guest/run.sh cameras` loads the module and runs these tests, which have no camera elsewhere.
#![cfg(target_os = "linux")]

use std::{
    sync::{Arc, Mutex},
    thread::sleep,
    time::{Duration, Instant},
};

use erfgs_rig::{
    frame::{self, Backend, FrameConfig, Lock, PixelEncoding},
    host_time::host_ns,
};
use erfgs_session::{
    pixel,
    source::{Incident, Outlet, Packet, StampClock},
};

#[derive(Default)]
struct Kept(Mutex<Vec<Packet>>, Mutex<Vec<Incident>>);

impl Outlet for Kept {
    fn send(&self, packet: Packet) -> bool {
        self.0.lock().unwrap().push(packet);
        true
    }

    fn report(&self, incident: Incident) {
        self.1.lock().unwrap().push(incident);
    }
}

fn film(config: &FrameConfig, count: usize) -> Vec<Packet> {
    let mut camera = frame::open(config).unwrap();
    let kept = Arc::new(Kept::default());
    camera.start(kept.clone()).unwrap();
    let began = Instant::now();
    while kept.0.lock().unwrap().len() < count {
        assert!(began.elapsed() < Duration::from_secs(60), "{:?}", kept.1.lock().unwrap());
        sleep(Duration::from_millis(20));
    }
    camera.stop().unwrap();
    assert_eq!(camera.counters().packets, kept.0.lock().unwrap().len() as u64);
    println!("{}", serde_json::to_string(camera.description()).unwrap());
    std::mem::take(&mut *kept.0.lock().unwrap())
}

fn vivid(number: u32) -> FrameConfig {
    FrameConfig {
        camera: format!("/dev/video{number}"),
        format: PixelEncoding::Yuyv,
        width: 640,
        height: 480,
        rate_hz: 25.0,
        ..Default::default()
    }
}

#[test]
#[ignore = "needs the guest: scripts/guest/run.sh cameras"]
fn vivid_cameras_are_listed_without_their_other_nodes() {
    let nodes: Vec<_> = frame::list().unwrap().into_iter().map(|camera| camera.node).collect();
    assert_eq!(nodes, ["/dev/video0", "/dev/video10"].map(std::path::PathBuf::from));
}

#[test]
#[ignore = "needs the guest: scripts/guest/run.sh cameras"]
fn the_kernels_frames_come_with_its_stamps() {
    for format in [PixelEncoding::Yuyv, PixelEncoding::Nv12, PixelEncoding::Grey8, PixelEncoding::Rgb8] {
        let config = FrameConfig { format, ..vivid(0) };
        let before_ns = host_ns();
        let packets = film(&config, 15);
        let after_ns = host_ns();
        let stamps: Vec<_> = packets.iter().map(|packet| packet.stamp.unwrap()).collect();
        for pair in stamps.windows(2) {
            // vivid counts by jiffies, and gives a number twice when those lag behind.
            assert!(pair[1].kernel_ns > pair[0].kernel_ns && pair[1].sequence >= pair[0].sequence, "{pair:?}");
        }
        // On our clock: within the time of filming, give or take the frame whose end vivid stamps before it is there.
        // How soon we take a frame says nothing: an emulated processor may be far behind.
        let filming = before_ns - 40_000_000..=after_ns + 40_000_000;
        for stamp in &stamps {
            assert_eq!(stamp.clock, StampClock::Monotonic);
            assert!(filming.contains(&stamp.kernel_ns), "{} is not in {filming:?}", stamp.kernel_ns);
        }
        let image = pixel::decode(format.encoding(), 640, 480, &packets[14].payload).unwrap();
        assert!(image.data.iter().any(|&byte| byte != image.data[0]), "{format:?} shows nothing");
    }
}

#[test]
#[ignore = "needs the guest: scripts/guest/run.sh cameras"]
fn gain_is_set_and_read_back_by_the_kernel() {
    let config = FrameConfig { gain: Lock::At(77.0), ..vivid(10) };
    let camera = frame::open(&config).unwrap();
    let settings = &camera.description().settings;
    assert_eq!((&settings["gain"], &settings["gain_locked"]), (&77.0.into(), &true.into()));
}

#[test]
#[ignore = "needs the guest: scripts/guest/run.sh cameras"]
fn the_portable_driver_reads_the_same_camera() {
    let config = FrameConfig { backend: Backend::Portable, ..vivid(10) };
    let packets = film(&config, 10);
    assert!(packets.iter().all(|packet| packet.stamp.is_none() && !packet.damaged));
    assert!(packets.windows(2).all(|pair| pair[1].host_ns > pair[0].host_ns));
}
