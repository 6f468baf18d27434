//! A session in which a wand was waved, of cameras of both kinds, from its packets to the report.

use std::path::Path;

use erfgs_calibrate::{
    evidence::Residual,
    report::page,
    wand::{Found, Stick, WandOptions, calibrate, detect::BlinkOptions, look_session, pictures},
};
use erfgs_events::{CdEvent, EventEncoding, Evt3Encoder};
use erfgs_scene::{
    Distortion, Intrinsics, Modality, Pose,
    pixel::PixelFormat,
    rig_file::{RigCamera, RigFile},
};
use erfgs_session::{
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
};
use erfgs_sync::of_session;
use glam::{DVec2, DVec3};

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
const SECONDS: f64 = 3.0;
const HOST_NS: i64 = 7_000_000_000;

fn stick() -> Stick {
    Stick::new([0.1, 0.2]).unwrap()
}

fn rig() -> RigFile {
    let intrinsics = Intrinsics {
        width: WIDTH,
        height: HEIGHT,
        fx: 300.0,
        fy: 300.0,
        cx: 160.0,
        cy: 120.0,
        distortion: Distortion::None,
    };
    let eyes = [DVec3::new(-0.8, 0.0, -1.0), DVec3::new(0.9, -0.2, -0.9), DVec3::new(0.1, 0.3, -1.3)];
    let cameras = ["left", "right", "film"].into_iter().zip(eyes).map(|(name, eye)| {
        let modality = if name == "film" { Modality::Rgb } else { Modality::Event };
        RigCamera::new(name, modality, intrinsics, Some(Pose::look_at(eye, DVec3::ZERO, DVec3::Y)))
    });
    RigFile::new("board", true, cameras.collect())
}

/// The images of the LEDs of a wand that somebody waves.
fn leds(camera: &RigCamera, t: f64) -> [DVec2; 3] {
    let middle = DVec3::new(0.25 * (2.1 * t).sin(), 0.18 * (2.9 * t + 1.0).sin(), 0.25 * (1.7 * t + 2.0).sin());
    let along = DVec3::new((1.1 * t).cos(), (1.9 * t + 0.5).sin(), 0.7 * (1.3 * t).sin()).normalize();
    let pose = camera.pose.unwrap();
    stick().offsets_m().map(|offset| camera.intrinsics.project(pose.transform(middle + along * offset)).unwrap())
}

/// The pixels around a LED's image, and its brightness there, times the background's.
fn around(middle: DVec2) -> impl Iterator<Item = (u16, u16, f64)> {
    let (left, top) = (middle.x as i32 - 6, middle.y as i32 - 6);
    (0..169).map(move |i| (left + i % 13, top + i / 13)).filter_map(move |(x, y)| {
        let inside = (0..WIDTH as i32).contains(&x) && (0..HEIGHT as i32).contains(&y);
        let distance = (DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - middle).length();
        inside.then(|| (x as u16, y as u16, 20.0 * (-0.5 * (distance / 1.3).powi(2)).exp()))
    })
}

/// Events of LEDs that blink at 500 Hz, in packets of 5 ms.
fn event_packets(camera: &RigCamera) -> Vec<Packet> {
    let mut events = Vec::new();
    for half in 0..(1000.0 * SECONDS) as u64 {
        let t = half as f64 * 1e-3;
        for (x, y, light) in leds(camera, t).into_iter().flat_map(around) {
            for count in 0..((1.0 + light).ln() / 0.4) as u64 {
                let late = 20 + 30 * count + u64::from(x * 7 + y * 13) % 20;
                events.push(CdEvent { t_us: 1000 * half + late, x, y, on: half % 2 == 0 });
            }
        }
    }
    events.sort_by_key(|event| event.t_us);
    let mut encoder = Evt3Encoder::default();
    let mut packets: Vec<Packet> = Vec::new();
    for chunk in events.chunk_by(|a, b| a.t_us / 5000 == b.t_us / 5000) {
        let mut payload = Vec::new();
        chunk.iter().for_each(|event| encoder.event(*event, &mut payload).unwrap());
        encoder.finish(&mut payload);
        let end_us = chunk.last().map_or(0, |event| event.t_us) as i64;
        packets.push(packet(packets.len() as u64, end_us * 1000 + 100_000, None, payload));
    }
    packets
}

fn frame_packets(camera: &RigCamera) -> Vec<Packet> {
    let frame = |index: u64| {
        let t_ns = index as i64 * 20_000_000;
        let mut pixels = vec![20_u8; (WIDTH * HEIGHT) as usize];
        for (x, y, light) in leds(camera, t_ns as f64 * 1e-9).into_iter().flat_map(around) {
            let pixel = &mut pixels[usize::from(y) * WIDTH as usize + usize::from(x)];
            *pixel = pixel.saturating_add((10.0 * light) as u8);
        }
        let kernel_ns = HOST_NS + t_ns;
        let (clock, point) = (StampClock::Monotonic, StampPoint::StartOfExposure);
        let stamp = FrameStamp { kernel_ns, clock, point, sequence: index as u32 };
        packet(index, t_ns + 8_000_000, Some(stamp), pixels)
    };
    (0..(50.0 * SECONDS) as u64).map(frame).collect()
}

fn packet(sequence: u64, after_ns: i64, stamp: Option<FrameStamp>, payload: Vec<u8>) -> Packet {
    let host_ns = HOST_NS + after_ns;
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp, payload: payload.into() }
}

fn record(path: &Path) {
    let start = SessionStart { host_ns: HOST_NS, program: "test".into(), ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    for camera in &rig().cameras {
        let is_film = camera.name == "film";
        let description = Description {
            id: camera.name.clone(),
            model: "simulated".into(),
            serial: String::new(),
            encoding: if is_film {
                Encoding::Frames(PixelFormat::Grey8)
            } else {
                Encoding::Events(EventEncoding::Evt3)
            },
            width: WIDTH,
            height: HEIGHT,
            start_order: 0,
            settings: serde_json::Map::new(),
        };
        let stream = writer.add_stream(&description).unwrap();
        let packets = if is_film { frame_packets(camera) } else { event_packets(camera) };
        packets.iter().for_each(|packet| writer.packet(stream, packet).unwrap());
    }
    writer.finish().unwrap();
}

#[test]
fn a_recorded_wand_calibrates_cameras_of_both_kinds() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    record(&path);
    let mut session = Session::open(&path).unwrap();
    let sync = of_session(&mut session, &mut |_| {}, |_, _| {}).unwrap();
    let mut look = |rig| look_session(&mut session, &sync, rig, &stick(), &BlinkOptions::default(), &mut |_, _| {});
    let known = rig();
    let Found { cameras, lit, without } = look(Some(&known)).unwrap();
    let error = look(None).unwrap_err().to_string();
    assert_eq!(cameras.len(), 3);
    assert!(lit.iter().zip(&cameras).all(|(lit, camera)| *lit >= camera.sightings.len()) && without.is_empty());
    let (found, mut evidence) = calibrate(&cameras, &WandOptions::new(stick())).unwrap();
    let centre = |rig: &RigFile, index: usize| rig.cameras[index].pose.unwrap().centre();
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let apart = |rig: &RigFile| (centre(rig, a) - centre(rig, b)).length();
        assert!((apart(&found) - apart(&known)).abs() < 5e-3, "{a} {b}: {} {}", apart(&found), apart(&known));
    }
    assert!(found.quality.as_ref().unwrap().rms_px < 0.25);
    evidence.pictures = pictures(&mut session, &sync, &found, &evidence).unwrap();
    assert_eq!(evidence.pictures.iter().map(|picture| picture.camera).collect::<Vec<_>>(), [0, 1, 2]);
    for picture in &evidence.pictures {
        // It is bright where the LEDs were found.
        let own = |r: &&Residual| r.camera == picture.camera && Some(r.placement) == picture.placement;
        let leds: Vec<DVec2> = evidence.residuals.iter().filter(own).map(|r| r.at_instant).collect();
        assert!(leds.len() >= 2);
        for led in leds {
            let [red, ..] = picture.image.pixel(led.x as u32, led.y as u32);
            assert!(red > 60, "{}: {red} at {led}", picture.camera);
        }
    }
    let page = page(&found, &evidence);
    assert!(page.contains("RGB on events") && page.matches("data:image/jpeg").count() == 3);
    assert!(error.contains("--rig") && error.contains("left, right, film"), "{error}");
}
