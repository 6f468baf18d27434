use std::path::Path;

use erfgs_dataset::{CameraEvents, Manifest, Provenance};
use erfgs_scene::Modality;
use glam::DQuat;

use super::*;

fn dataset(eyes: &[DVec3], target: DVec3, times: &[i64]) -> Dataset {
    let camera = |(index, &eye): (usize, &DVec3)| Camera {
        name: format!("cam{index}"),
        modality: Modality::Rgb,
        split: Split::Train,
        intrinsics: Intrinsics {
            width: 64,
            height: 48,
            fx: 60.0,
            fy: 60.0,
            cx: 32.0,
            cy: 24.0,
            distortion: Distortion::None,
        },
        world_to_camera: Pose::look_at(eye, target, DVec3::Y),
        pose_sigma: None,
        clock_sigma_s: None,
        frames: times
            .iter()
            .enumerate()
            .map(|(frame, &t_ns)| Frame {
                file: format!("images/cam{index}/{frame:04}.png").into(),
                t_ns,
                exposure_ns: [t_ns, t_ns],
                mask: None,
            })
            .collect(),
        events: None::<CameraEvents>,
    };
    let manifest = Manifest {
        format: Manifest::FORMAT.into(),
        version: Manifest::VERSION,
        name: "test".into(),
        provenance: Provenance::default(),
        span_ns: [0, 1_000_000_000],
        seed: 0,
        variant: Vec::new(),
        linear_exposure: false,
        points: None,
        bodies: None,
        cameras: eyes.iter().enumerate().map(camera).collect(),
        sha256: Default::default(),
    };
    Dataset::new(Path::new("nowhere"), manifest)
}

fn circle(count: usize) -> Vec<DVec3> {
    let angle = |index: usize| std::f64::consts::TAU * index as f64 / count as f64;
    (0..count).map(|index| DVec3::new(2.0 * angle(index).cos(), -1.0, 2.0 * angle(index).sin())).collect()
}

const EVERY_33_MS: [i64; 5] = [0, 33_333_333, 66_666_667, 100_000_000, 133_333_333];

#[test]
fn the_default_takes_the_first_the_middle_and_the_last_frame() {
    let dataset = dataset(&circle(4), DVec3::ZERO, &EVERY_33_MS);
    let rig = Rig::new(&dataset, &FrameChoice::default()).unwrap();
    assert_eq!(rig.instants.iter().map(|i| i.t_ns).collect::<Vec<_>>(), [0, 66_666_667, 133_333_333]);
    let one = Rig::new(&dataset, &FrameChoice::Spread(1)).unwrap();
    assert_eq!(one.instants.iter().map(|i| i.t_ns).collect::<Vec<_>>(), [66_666_667]);
    assert_eq!(Rig::new(&dataset, &FrameChoice::Spread(99)).unwrap().instants.len(), 5);
}

#[test]
fn frames_can_be_named_and_an_unknown_name_is_an_error() {
    let dataset = dataset(&circle(4), DVec3::ZERO, &EVERY_33_MS);
    let rig = Rig::new(&dataset, &FrameChoice::Named(vec!["0003".into(), "0001".into()])).unwrap();
    assert_eq!(rig.instants.iter().map(|i| i.t_ns).collect::<Vec<_>>(), [33_333_333, 100_000_000]);
    let error = Rig::new(&dataset, &FrameChoice::Named(vec!["0042".into()])).unwrap_err();
    assert!(error.to_string().contains("'0042'"), "{error}");
    assert!(Rig::new(&dataset, &FrameChoice::Named(Vec::new())).is_err());
    assert!(Rig::new(&dataset, &FrameChoice::Spread(0)).is_err());
}

#[test]
fn held_out_and_event_only_cameras_take_no_part() {
    let mut dataset = dataset(&circle(6), DVec3::ZERO, &EVERY_33_MS);
    dataset.manifest.cameras[1].split = Split::Test;
    dataset.manifest.cameras[4].modality = Modality::Event;
    let rig = Rig::new(&dataset, &FrameChoice::default()).unwrap();
    let names: Vec<_> = rig.stations.iter().map(|station| station.camera.name.as_str()).collect();
    assert_eq!(names, ["cam0", "cam2", "cam3", "cam5"]);
    dataset.manifest.cameras[0].frames.clear();
    dataset.manifest.cameras[2].modality = Modality::Event;
    let error = Rig::new(&dataset, &FrameChoice::default()).unwrap_err();
    assert!(matches!(error, CloudError::TooFewCameras { found: 2 }), "{error}");
}

#[test]
fn frames_within_two_milliseconds_are_one_instant_and_times_without_three_views_are_none() {
    let mut dataset = dataset(&circle(4), DVec3::ZERO, &EVERY_33_MS);
    for (index, camera) in dataset.manifest.cameras.iter_mut().enumerate() {
        camera.frames.iter_mut().for_each(|frame| frame.t_ns += 600_000 * index as i64);
    }
    let rig = Rig::new(&dataset, &FrameChoice::Spread(99)).unwrap();
    assert!(rig.instants.iter().all(|instant| instant.shots.len() == 4));
    assert_eq!(rig.instants[1].t_ns, 33_333_333);
    // Two of four do not make an instant, and frames of others are far away.
    for (index, camera) in dataset.manifest.cameras.iter_mut().enumerate() {
        camera.frames.iter_mut().for_each(|frame| frame.t_ns += 1_000_000_000 * (index / 2) as i64);
    }
    let error = Rig::new(&dataset, &FrameChoice::default()).unwrap_err();
    assert!(matches!(error, CloudError::NoCommonInstant { .. }), "{error}");
}

#[test]
fn of_cameras_that_run_freely_the_frames_nearest_in_time_are_one_instant() {
    let mut dataset = dataset(&circle(5), DVec3::ZERO, &EVERY_33_MS);
    let late = [0, 14_000_000, -9_000_000, 5_000_000, 40_000_000];
    for (camera, late) in dataset.manifest.cameras.iter_mut().zip(late) {
        camera.frames.iter_mut().for_each(|frame| frame.t_ns += late);
    }
    let rig = Rig::new(&dataset, &FrameChoice::Spread(99)).unwrap();
    assert_eq!(rig.instants.len(), 5);
    let instant = &rig.instants[2];
    let frames: Vec<(usize, i64)> = instant.shots.iter().map(|(station, frame)| (*station, frame.t_ns)).collect();
    assert_eq!(frames, [(0, 66_666_667), (1, 80_666_667), (2, 57_666_667), (3, 71_666_667), (4, 73_333_333)]);
    assert_eq!(instant.t_ns, 71_666_667, "the median label");
    // The last camera begins later than the others, and has no frame near the first.
    assert_eq!(rig.instants[0].shots.len(), 4);
}

#[test]
fn degenerate_cameras_are_named() {
    type Spoil = fn(&mut Camera);
    let spoilt: [(Spoil, &str); 6] = [
        (|camera| camera.world_to_camera.translation.x = f64::NAN, "not finite"),
        (|camera| camera.world_to_camera.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), "unit quaternion"),
        (|camera| camera.intrinsics.fx = 0.0, "focal length"),
        (|camera| camera.intrinsics.cy = f64::INFINITY, "principal point"),
        (|camera| camera.intrinsics.height = 0, "no pixels"),
        (|camera| camera.intrinsics.distortion = Distortion::KannalaBrandt([0.1, 0.0, 0.0, 0.0]), "distorted"),
    ];
    for (spoil, expected) in spoilt {
        let mut dataset = dataset(&circle(4), DVec3::ZERO, &EVERY_33_MS);
        spoil(&mut dataset.manifest.cameras[2]);
        let message = Rig::new(&dataset, &FrameChoice::default()).unwrap_err().to_string();
        assert!(message.contains("cam2") && message.contains(expected), "{message}");
    }
    let dataset = dataset(&[DVec3::ONE; 4], DVec3::ZERO, &EVERY_33_MS);
    let error = Rig::new(&dataset, &FrameChoice::default()).unwrap_err();
    assert!(matches!(error, CloudError::NoBaseline { cameras: 4, .. }), "{error}");
}

#[test]
fn cameras_around_a_scene_reach_to_the_opposite_wall() {
    let dataset = dataset(&circle(8), DVec3::new(0.0, 0.5, 0.0), &[0]);
    let rig = Rig::new(&dataset, &FrameChoice::default()).unwrap();
    let distance = (4.0_f64 + 1.5 * 1.5).sqrt();
    let found = reach(&rig.stations, None, None).unwrap();
    assert!((found.focus_m - distance).abs() < 1e-9, "{found:?}");
    assert!((found.depth_m[0] - 0.1 * distance).abs() < 1e-9 && (found.depth_m[1] - 2.5 * distance).abs() < 1e-9);
}

#[test]
fn parallel_cameras_have_a_finite_reach_too() {
    let eyes = [DVec3::ZERO, DVec3::X, DVec3::new(2.0, 0.0, 0.0)];
    let mut dataset = dataset(&eyes, DVec3::Z, &[0]);
    for (camera, eye) in dataset.manifest.cameras.iter_mut().zip(eyes) {
        camera.world_to_camera = Pose::look_at(eye, eye + DVec3::Z, DVec3::Y);
    }
    let rig = Rig::new(&dataset, &FrameChoice::default()).unwrap();
    let found = reach(&rig.stations, None, None).unwrap();
    assert_eq!(found, Reach { depth_m: [1.0, 200.0], focus_m: 10.0 });
}

#[test]
fn a_given_range_or_box_rules_and_a_senseless_one_is_refused() {
    let dataset = dataset(&circle(8), DVec3::ZERO, &[0]);
    let rig = Rig::new(&dataset, &FrameChoice::default()).unwrap();
    assert_eq!(reach(&rig.stations, Some([1.0, 3.0]), None).unwrap().depth_m, [1.0, 3.0]);
    let cube = [DVec3::splat(-0.5), DVec3::splat(0.5)];
    let [near, far] = reach(&rig.stations, None, Some(cube)).unwrap().depth_m;
    let distance = 5.0_f64.sqrt();
    assert!(near > distance - 0.9 && near < distance && far > distance && far < distance + 0.9, "{near}..{far}");
    for wrong in [[0.0, 1.0], [2.0, 1.0], [f64::NAN, 1.0], [1.0, f64::INFINITY]] {
        assert!(reach(&rig.stations, Some(wrong), None).is_err(), "{wrong:?}");
    }
}
