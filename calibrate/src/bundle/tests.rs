use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DQuat, DVec2, DVec3};

use super::{residual::row, *};

fn camera() -> BundleCamera {
    let distortion = Distortion::BrownConrady([-0.1, 0.05, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    BundleCamera {
        name: "c".into(),
        intrinsics: Intrinsics { width: 1280, height: 720, fx: 900.0, fy: 905.0, cx: 640.0, cy: 355.0, distortion },
        pose: Pose::look_at(DVec3::new(2.5, -0.4, -1.6), DVec3::ZERO, DVec3::Y),
        time_offset_s: 0.0,
        free: Parameter::POSE.to_vec(),
    }
}

#[test]
fn rows_are_the_limits_of_differences() {
    let placements = [
        Placement::Board(Pose::look_at(DVec3::new(0.1, 0.2, -0.3), DVec3::Z, DVec3::Y)),
        Placement::Wand { middle: DVec3::new(0.1, -0.1, 0.2), direction: DVec3::new(1.0, 2.0, -0.5).normalize() },
        Placement::Point(DVec3::new(-0.2, 0.1, 0.1)),
        Placement::Fixed,
    ];
    let mut camera = camera();
    camera.free = free_lens(8);
    camera.free.extend([Parameter::Focal, Parameter::TimeOffset]);
    camera.free.extend(Parameter::POSE);
    let observation = Observation {
        camera: 0,
        placement: 0,
        on_target: DVec3::new(0.2, -0.1, 0.05),
        side: None,
        pixel: DVec2::new(600.0, 300.0),
        sigma_px: 0.5,
        velocity: DVec2::new(30.0, -20.0),
        used: true,
    };
    for placement in placements {
        let at = row(&camera, &placement, None, &observation).unwrap();
        let residual =
            |camera: &BundleCamera, placement: &Placement| row(camera, placement, None, &observation).unwrap().residual;
        let unit = |index: usize, size: usize, by: f64| {
            (0..size).map(|i| if i == index { by } else { 0.0 }).collect::<Vec<_>>()
        };
        for (index, parameter) in camera.free.iter().enumerate() {
            let moved = |by| residual(&camera.moved(&unit(index, camera.free.len(), by)), &placement);
            let slope = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            for axis in 0..2 {
                let analytic = at.by_camera[axis][index];
                assert!(
                    (slope[axis] - analytic).abs() < 1e-3 + 1e-6 * analytic.abs(),
                    "{parameter:?}: {slope} {analytic}"
                );
            }
        }
        for index in 0..placement.parameters() {
            let moved = |by| residual(&camera, &placement.moved(&unit(index, 6, by)));
            let slope = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            for axis in 0..2 {
                assert!((slope[axis] - at.by_placement[axis][index]).abs() < 1e-3, "{placement:?} {index}: {slope}");
            }
        }
    }
}

/// The back of a plate of 6 mm, glued askew.
fn back() -> Side {
    let rotation = DQuat::from_scaled_axis(DVec3::new(0.02, 3.1, -0.04));
    let pose = Pose { rotation, translation: DVec3::new(0.42, 0.01, 0.006) };
    Side { name: "back".into(), pose, middle: DVec3::new(0.2, 0.15, 0.0), free: true }
}

#[test]
fn rows_of_a_further_side_are_the_limits_of_differences_too() {
    let placements = [
        Placement::Board(Pose::look_at(DVec3::new(0.1, 0.2, -0.3), DVec3::Z, DVec3::Y)),
        Placement::Wand { middle: DVec3::new(0.1, -0.1, 0.2), direction: DVec3::new(1.0, 2.0, -0.5).normalize() },
        Placement::Point(DVec3::new(-0.2, 0.1, 0.1)),
        Placement::Fixed,
    ];
    let (camera, side) = (camera(), back());
    let observation = Observation {
        camera: 0,
        placement: 0,
        on_target: DVec3::new(0.2, -0.1, 0.0),
        side: Some(0),
        pixel: DVec2::new(600.0, 300.0),
        sigma_px: 0.5,
        velocity: DVec2::ZERO,
        used: true,
    };
    let unit = |index: usize, by: f64| std::array::from_fn::<_, 6, _>(|i| if i == index { by } else { 0.0 });
    for placement in placements {
        let at = row(&camera, &placement, Some(&side), &observation).unwrap();
        let residual = |camera: &BundleCamera, placement: &Placement, side: &Side| {
            row(camera, placement, Some(side), &observation).unwrap().residual
        };
        let slope = |moved: &dyn Fn(f64) -> DVec2| (moved(1e-6) - moved(-1e-6)) / 2e-6;
        for index in 0..6 {
            let by_side = slope(&|by| residual(&camera, &placement, &side.moved(&unit(index, by))));
            let by_camera = slope(&|by| residual(&camera.moved(&unit(index, by)), &placement, &side));
            let by_placement = slope(&|by| residual(&camera, &placement.moved(&unit(index, by)), &side));
            for axis in 0..2 {
                assert!((by_side[axis] - at.by_side[axis][index]).abs() < 1e-3, "{placement:?} {index}: {by_side}");
                assert!((by_camera[axis] - at.by_camera[axis][index]).abs() < 1e-3, "{index}: {by_camera}");
                let own = if index < placement.parameters() { at.by_placement[axis][index] } else { 0.0 };
                assert!((by_placement[axis] - own).abs() < 1e-3, "{placement:?} {index}: {by_placement}");
            }
        }
        let fixed = Side { free: false, ..side.clone() };
        assert_eq!(row(&camera, &placement, Some(&fixed), &observation).unwrap().by_side, [[0.0; 6]; 2]);
        assert_eq!(fixed.moved(&[]), fixed);
    }
}
