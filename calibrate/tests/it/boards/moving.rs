//! A printed board that is waved before a simulated event camera.

use std::path::Path;

use erfgs_calibrate::board::{EventBoard, LensModel, Target, look, single};
use erfgs_events::Events;
use erfgs_replay::simulator::{Luma, Mode, Simulator, SimulatorConfig, camera_key};
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::DVec3;

use super::scene::{Rays, Sheet};

fn camera() -> Intrinsics {
    Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 163.0, cy: 118.0, distortion: Distortion::None }
}

/// The events of a camera before which a sheet moves along `path` (seconds to pose), from frames at `fps`.
fn film(
    sheet: &Sheet,
    camera: &Intrinsics,
    path: &dyn Fn(f64) -> Pose,
    seconds: f64,
    fps: f64,
    config: &SimulatorConfig,
) -> Events {
    let mut events = Events::new(camera.width, camera.height);
    let rays = Rays::<2>::of(camera);
    let mut simulator = Simulator::new(camera.width, camera.height, config, camera_key("left")).unwrap();
    for frame in 0..=(seconds * fps) as u64 {
        let t = frame as f64 / fps;
        let luma: Vec<f32> = rays.light(sheet, &path(t), 0.6).into_iter().map(|level| level as f32).collect();
        simulator.step(Luma::F32(&luma), (1e9 * t) as i64, &mut events).unwrap();
    }
    events
}

/// A hand that waves the board: it swings along and about all axes at once, each at its own pace, 200 pixels a second at most.
fn waved(sheet: &Sheet, t: f64) -> Pose {
    let swing = |hz: f64, phase: f64| (std::f64::consts::TAU * (hz * t + phase)).sin();
    let place = DVec3::new(0.07 * swing(0.61, 0.0), 0.05 * swing(0.83, 0.2), 0.42 + 0.08 * swing(0.23, 0.5));
    let turn = DVec3::new(0.5 * swing(0.37, 0.1), 0.5 * swing(0.29, 0.4), 0.3 * swing(0.43, 0.7));
    sheet.pose(place, turn)
}

/// Writes events as a RAW file of EVT2 words.
fn write_evt2(events: &Events, path: &Path) {
    let mut file =
        format!("% evt 2.0\n% format EVT2;height={};width={}\n% end\n", events.height, events.width).into_bytes();
    let mut high = u32::MAX;
    for event in events.iter() {
        let t = event.t_us as u32;
        if t >> 6 != high {
            high = t >> 6;
            file.extend((0x8000_0000 | high).to_le_bytes());
        }
        let word = u32::from(event.on) << 28 | (t & 63) << 22 | u32::from(event.x) << 11 | u32::from(event.y);
        file.extend(word.to_le_bytes());
    }
    std::fs::write(path, file).unwrap();
}

/// The simulator as v2e sets it by default, with some of everything random.
fn sensor(seed: u64) -> SimulatorConfig {
    SimulatorConfig {
        mode: Mode::Enhanced,
        sigma: 0.03,
        cutoff_hz: 300.0,
        leak_hz: 0.1,
        shot_hz: 1.0,
        seed,
        ..SimulatorConfig::default()
    }
}

#[test]
fn an_event_camera_is_calibrated_by_a_printed_board_that_is_waved() {
    for (target, unit_m, seed, least_views, most_rms) in
        [("chessboard:8x5:0.025", 0.025, 1, 20, 0.6), ("aprilgrid:4x3:0.05:0.3", 0.005, 2, 30, 0.9)]
    {
        let target: Target = target.parse().unwrap();
        let sheet = Sheet::of(&target, unit_m);
        let events = film(&sheet, &camera(), &|t| waved(&sheet, t), 3.0, 200.0, &sensor(seed));
        let folder = tempfile::tempdir().unwrap();
        write_evt2(&events, &folder.path().join("left.raw"));
        let unasked = look(folder.path(), &target, None, &|_, _| {}).unwrap_err().to_string();
        assert!(unasked.contains("left.raw") && unasked.contains("--moving"), "{unasked}");
        let seen = look(folder.path(), &target, Some(EventBoard::Moving), &|_, _| {}).unwrap().remove(0);
        println!("{target}: {} events, the board in {} of {} pictures", events.len(), seen.views.len(), seen.frames);
        assert!(seen.events && seen.views.len() >= least_views, "{} views", seen.views.len());
        let found = single(&seen, &target, LensModel::Pinhole, true).unwrap();
        let (i, sigma) = (found.bundle.cameras[0].intrinsics, &found.uncertainty.cameras[0].sigma);
        let rms = found.bundle.rms_px(None).0;
        println!("  f {:.2} c {:.2} {:.2}, sigma {sigma:.2?}, rms {rms:.3} px", i.fx, i.cx, i.cy);
        assert!(rms < most_rms, "{rms}");
        for (off, sigma) in [i.fx - 300.0, i.cx - 163.0, i.cy - 118.0].into_iter().zip(sigma) {
            assert!(off.abs() < 3.0 * sigma && *sigma < 2.5, "off by {off} ± {sigma}");
        }
    }
}
