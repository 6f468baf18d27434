//! Bundle adjustment: rigs whose truth is known, what their deviations cover, and what is left open.

use erfgs_base::random;
use erfgs_calibrate::bundle::{
    Bundle, BundleCamera, BundleError, Loss, Method, Observation, Options, Parameter, Placement, Prior, Side, Stop,
    clusters, jackknife,
};
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DQuat, DVec2, DVec3};

fn lens() -> Intrinsics {
    let distortion = Distortion::BrownConrady([-0.1, 0.05, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    Intrinsics { width: 1280, height: 720, fx: 900.0, fy: 905.0, cx: 640.0, cy: 355.0, distortion }
}

/// `count` cameras on an arc of 3 m around the origin.
fn arc(count: usize) -> Vec<BundleCamera> {
    (0..count)
        .map(|i| {
            let angle = -1.0 + 2.0 * i as f64 / (count - 1) as f64;
            let eye = DVec3::new(3.0 * angle.sin(), -0.4, -3.0 * angle.cos());
            BundleCamera {
                name: format!("c{i}"),
                intrinsics: lens(),
                pose: Pose::look_at(eye, DVec3::ZERO, DVec3::Y),
                time_offset_s: 0.0,
                free: if i == 0 { Vec::new() } else { Parameter::POSE.to_vec() },
            }
        })
        .collect()
}

fn vector(seed: u64, index: u64, scale: f64) -> DVec3 {
    let part = |axis| scale * random::normal(random::key(seed, &[index, axis]));
    DVec3::new(part(0), part(1), part(2))
}

/// What `cameras` see of wands at random places, with noise of `sigma` pixels.
fn wands(cameras: &[BundleCamera], count: usize, sigma: f64, seed: u64) -> Bundle {
    let mut bundle = Bundle { cameras: cameras.to_vec(), ..Bundle::default() };
    for index in 0..count {
        let direction = vector(seed, 2 * index as u64, 1.0).normalize();
        bundle.placements.push(Placement::Wand { middle: vector(seed, 2 * index as u64 + 1, 0.3), direction });
        for camera in 0..cameras.len() {
            for (k, offset) in [-0.195, -0.065, 0.195].into_iter().enumerate() {
                let on_target = DVec3::new(offset, 0.0, 0.0);
                see(&mut bundle, camera, index, on_target, sigma, random::key(seed, &[99, index as u64, k as u64]));
            }
        }
    }
    bundle
}

fn see(bundle: &mut Bundle, camera: usize, placement: usize, on_target: DVec3, sigma: f64, key: u64) {
    let world = bundle.placements[placement].world(on_target);
    let state = &bundle.cameras[camera];
    let Some(pixel) = state.intrinsics.project(state.pose.transform(world)) else { return };
    let noise = |axis| sigma * random::normal(random::extend(random::extend(key, axis), camera as u64));
    bundle.observations.push(Observation {
        camera,
        placement,
        on_target,
        side: None,
        pixel: pixel + DVec2::new(noise(0), noise(1)),
        sigma_px: sigma.max(0.1),
        velocity: DVec2::ZERO,
        used: true,
    });
}

/// A pose turned by a vector of radians, and moved.
fn turned(pose: &Pose, by: DVec3, shift: DVec3) -> Pose {
    let turn = DQuat::from_scaled_axis(by);
    Pose { rotation: turn * pose.rotation, translation: pose.translation + shift }
}

/// How far apart the first steps of the two methods lead, in parts of the step.
fn steps_apart(bundle: &Bundle) -> f64 {
    let numbers = |bundle: &Bundle| -> Vec<f64> {
        let poses = bundle.cameras.iter().map(|camera| camera.pose).chain(bundle.sides.iter().map(|side| side.pose));
        poses
            .flat_map(|pose| [pose.rotation.to_array().to_vec(), pose.translation.to_array().to_vec()].concat())
            .collect()
    };
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let [exact, approximate] = [Method::Cholesky, Method::ConjugateGradients].map(|method| {
        let mut bundle = bundle.clone();
        let solution = bundle.solve(&Options { method, iterations: 1, ..Options::default() }).unwrap();
        assert!(solution.steps[1].taken && solution.steps.len() == 2);
        numbers(&bundle)
    });
    distance(&exact, &approximate) / distance(&exact, &numbers(bundle))
}

fn disturb(bundle: &mut Bundle, by: f64) {
    for (i, camera) in bundle.cameras.iter_mut().enumerate().skip(1) {
        camera.pose.rotation *= DQuat::from_scaled_axis(vector(7, i as u64, by));
        camera.pose.translation += vector(8, i as u64, by);
    }
    for (i, placement) in bundle.placements.iter_mut().enumerate() {
        let (first, second) = (vector(9, i as u64, by), vector(10, i as u64, by));
        match placement {
            Placement::Board(pose) => *pose = turned(pose, first, second),
            Placement::Wand { middle, direction } => {
                *middle += first;
                *direction = (*direction + second).normalize();
            }
            Placement::Point(point) => *point += first,
            Placement::Fixed => {}
        }
    }
}

/// The back of a plate of 6 mm, glued askew.
fn back() -> Side {
    let rotation = DQuat::from_scaled_axis(DVec3::new(0.02, 3.1, -0.04));
    let pose = Pose { rotation, translation: DVec3::new(0.42, 0.01, 0.006) };
    Side { name: "back".into(), pose, middle: DVec3::new(0.2, 0.15, 0.0), free: true }
}

/// Boards of which the first half of the cameras sees the front, and the second half the back, with noise of `sigma` pixels.
fn two_sided(cameras: &[BundleCamera], count: u64, sigma: f64, seed: u64) -> Bundle {
    let mut bundle = Bundle { cameras: cameras.to_vec(), sides: vec![back()], ..Bundle::default() };
    for index in 0..count {
        let rotation = DQuat::from_scaled_axis(vector(seed, 2 * index, 0.4));
        let translation = vector(seed, 2 * index + 1, 0.2) - rotation * DVec3::new(0.2, 0.15, 0.0);
        bundle.placements.push(Placement::Board(Pose { rotation, translation }));
        for camera in 0..cameras.len() {
            let side = (2 * camera >= cameras.len()).then_some(0);
            for corner in 0..20_u64 {
                let on_target = DVec3::new(0.1 * (corner % 5) as f64, 0.1 * (corner / 5) as f64, 0.0);
                let on_placement = side.map_or(on_target, |_| back().pose.transform(on_target));
                let before = bundle.observations.len();
                see(&mut bundle, camera, index as usize, on_placement, sigma, random::key(seed, &[7, index, corner]));
                for new in &mut bundle.observations[before..] {
                    (new.on_target, new.side) = (on_target, side);
                }
            }
        }
    }
    bundle
}

#[test]
fn where_the_back_of_boards_is_comes_out_with_the_cameras_by_either_method() {
    let truth = two_sided(&arc(4), 12, 0.0, 21);
    for method in [Method::Cholesky, Method::ConjugateGradients] {
        let mut bundle = truth.clone();
        disturb(&mut bundle, 0.01);
        bundle.sides[0].pose =
            turned(&bundle.sides[0].pose, DVec3::new(0.05, -0.04, 0.06), DVec3::new(0.01, -0.02, 0.01));
        let solution = bundle.solve(&Options { method, ..Options::default() }).unwrap();
        assert_eq!((solution.stop, solution.parameters), (Stop::Converged, [24, 72]));
        let off = bundle.sides[0].pose.translation - back().pose.translation;
        assert!(off.length() < 1e-6, "{method:?}: {off}");
        for (found, true_camera) in bundle.cameras.iter().zip(&truth.cameras) {
            assert!((found.pose.centre() - true_camera.pose.centre()).length() < 1e-6, "{method:?}");
        }
    }
    // The same step of both, the back's columns among them.
    let mut bundle = two_sided(&arc(4), 12, 0.5, 21);
    disturb(&mut bundle, 0.005);
    let apart = steps_apart(&bundle);
    assert!(apart < 1e-6, "{apart}");
}

#[test]
fn the_deviations_of_a_back_are_those_of_repeated_trials() {
    let (cameras, seeds, mut squares) = (arc(4), 40, 0.0);
    for seed in 0..seeds {
        let mut bundle = two_sided(&cameras, 12, 0.3, 500 + seed);
        bundle.solve(&Options::default()).unwrap();
        let groups = jackknife::successive(bundle.placements.len(), jackknife::MOST_GROUPS);
        let uncertainty = bundle.uncertainty(Loss::Squared).unwrap();
        let grouped = bundle.uncertainty_of_groups(Loss::Squared, &groups).unwrap();
        let (own, least) = (&uncertainty.sides[0], &grouped.sides[0]);
        assert!(least.middle.cmpge(own.middle).all() && uncertainty.open.is_empty(), "{own:?} {least:?}");
        let side = &bundle.sides[0];
        let off = side.pose.transform(side.middle) - back().pose.transform(side.middle);
        let turned = (side.pose.rotation * back().pose.rotation.conjugate()).normalize();
        let turned = 2.0 * DVec3::new(turned.x, turned.y, turned.z) * turned.w.signum();
        squares += (off / own.middle).length_squared() + (turned / own.rotation).length_squared();
    }
    // Six figures each, correlated: the bounds are wider than the 22 of independent ones.
    assert!((150.0..340.0).contains(&squares), "{squares}");
}

#[test]
fn a_back_that_turns_about_one_axis_alone_is_named_as_open() {
    let mut bundle = two_sided(&arc(4), 12, 0.0, 22);
    for (index, placement) in bundle.placements.iter_mut().enumerate() {
        let rotation = DQuat::from_rotation_x(0.1 * index as f64 - 0.5);
        *placement = Placement::Board(Pose { rotation, translation: rotation * DVec3::new(-0.2, -0.15, 0.0) });
    }
    for index in 0..bundle.observations.len() {
        let o = bundle.observations[index];
        let residual = bundle.residual_px(&o).unwrap();
        bundle.observations[index].pixel += residual;
    }
    let uncertainty = bundle.uncertainty(Loss::Squared).unwrap();
    // A turn about that axis and a shift along it.
    assert_eq!(uncertainty.open.len(), 2);
    assert!(uncertainty.sides[0].rotation.x.is_infinite() && uncertainty.sides[0].middle.x.is_infinite());
    // Where the front was never seen the back may be anywhere.
    bundle.observations.retain(|o| o.side.is_some());
    bundle.cameras.iter_mut().for_each(|camera| camera.free.clear());
    let uncertainty = bundle.uncertainty(Loss::Squared).unwrap();
    let quality = bundle.rig("board", &uncertainty, &[erfgs_scene::Modality::Rgb; 4]).quality.unwrap();
    assert!(quality.open.len() == 6 && quality.open[0].contains("of back"), "{:?}", quality.open);
}

#[test]
fn a_disturbed_rig_comes_back_exactly_by_either_method() {
    for method in [Method::Cholesky, Method::ConjugateGradients] {
        let truth = wands(&arc(5), 30, 0.0, 1);
        let mut bundle = truth.clone();
        disturb(&mut bundle, 0.05);
        let solution = bundle.solve(&Options { method, ..Options::default() }).unwrap();
        assert_eq!((solution.stop, solution.method), (Stop::Converged, method));
        assert_eq!(solution.parameters, [24, 150]);
        for (found, true_camera) in bundle.cameras.iter().zip(&truth.cameras) {
            assert!((found.pose.centre() - true_camera.pose.centre()).length() < 1e-7, "{method:?}");
        }
        assert!(solution.steps.last().unwrap().rms_px < 1e-5);
        assert!(solution.steps.len() < 60, "{}", solution.steps.len());
    }
}

#[test]
fn both_methods_take_the_same_step_whatever_the_order_of_what_was_seen() {
    let mut bundle = wands(&arc(5), 30, 0.5, 1);
    disturb(&mut bundle, 0.01);
    bundle.observations.sort_by_key(|seen| random::key(5, &[seen.camera as u64, seen.placement as u64]));
    let apart = steps_apart(&bundle);
    assert!(apart < 1e-6, "{apart}");
}

#[test]
fn the_covariance_is_that_of_repeated_trials() {
    let cameras = arc(4);
    let (seeds, mut squares, mut freedom) = (60, 0.0, 0);
    for seed in 0..seeds {
        let mut bundle = wands(&cameras, 20, 0.3, 100 + seed);
        bundle.solve(&Options::default()).unwrap();
        let uncertainty = bundle.uncertainty(Loss::Squared).unwrap();
        assert!(uncertainty.open.is_empty() && uncertainty.rank == 18 && uncertainty.condition < 1e6);
        for (index, (found, truth)) in bundle.cameras.iter().zip(&cameras).enumerate().skip(1) {
            let error = found.pose.centre() - truth.pose.centre();
            squares += error.dot(uncertainty.cameras[index].centre.inverse() * error);
            freedom += 3;
        }
    }
    // Chi-square of 540 degrees of freedom; the errors of one trial's cameras are correlated, so that the bounds are wider
    // than its standard deviation of 33.
    assert_eq!(freedom, 540);
    assert!((440.0..660.0).contains(&squares), "{squares}");
}

#[test]
fn errors_that_neighbours_share_widen_the_covariance() {
    let cameras = arc(4);
    let (seeds, mut apart, mut together) = (30, 0.0, 0.0);
    for seed in 0..seeds {
        let mut bundle = Bundle { cameras: cameras.clone(), ..Bundle::default() };
        let points: Vec<DVec3> = (0..480).map(|index| vector(200 + seed, index, 0.4)).collect();
        let neighbours = clusters::boxes(&points, 32);
        for (index, &point) in points.iter().enumerate() {
            bundle.placements.push(Placement::Point(point));
            for camera in 0..cameras.len() {
                see(&mut bundle, camera, index, DVec3::ZERO, 0.1, random::key(300 + seed, &[index as u64]));
                let shared = vector(400 + seed, (neighbours[index] * cameras.len() + camera) as u64, 0.4);
                bundle.observations.last_mut().unwrap().pixel += shared.truncate();
            }
        }
        let metres = (cameras[0].pose.centre() - cameras[3].pose.centre()).length();
        bundle.priors.push(Prior::Distance { cameras: [0, 3], metres, sigma: 1e-6 });
        bundle.solve(&Options::default()).unwrap();
        let own = bundle.uncertainty(Loss::Squared).unwrap();
        let shared = bundle.uncertainty_of_clusters(Loss::Squared, &neighbours).unwrap();
        assert_eq!(
            (own.variance_factor, own.rank, own.condition),
            (shared.variance_factor, shared.rank, shared.condition)
        );
        for (index, truth) in cameras.iter().enumerate().take(3).skip(1) {
            let error = bundle.cameras[index].pose.centre() - truth.pose.centre();
            apart += error.dot(own.cameras[index].centre.inverse() * error);
            together += error.dot(shared.cameras[index].centre.inverse() * error);
        }
    }
    // Chi-square of 180 degrees of freedom, were the covariance known; from 32 clusters it is known to a quarter.
    assert!((120.0..300.0).contains(&together), "{together}");
    assert!(apart > 3.0 * together, "{apart} {together}");
}

#[test]
fn what_is_not_determined_is_named() {
    // A camera that sees nothing, and a focal length that one plane seen head on cannot tell from its distance.
    let mut bundle = wands(&arc(4), 20, 0.1, 3);
    bundle.observations.retain(|o| o.camera != 3);
    let uncertainty = bundle.uncertainty(Loss::Squared).unwrap();
    assert_eq!((uncertainty.rank, uncertainty.open.len()), (12, 6));
    assert!(uncertainty.condition.is_infinite());
    assert!(uncertainty.open.iter().flat_map(|open| &open.parameters).all(|(camera, _, _)| *camera == 3));
    assert!(uncertainty.cameras[3].sigma.iter().all(|sigma| sigma.is_infinite()));
    assert!(uncertainty.cameras[2].sigma.iter().all(|sigma| sigma.is_finite()));

    let mut flat = Bundle { cameras: arc(3), ..Bundle::default() };
    flat.cameras.truncate(1);
    flat.cameras[0].free = vec![Parameter::Focal];
    flat.cameras[0].intrinsics.distortion = Distortion::None;
    let away = flat.cameras[0].pose.inverse().transform(DVec3::new(0.0, 0.0, 2.0));
    flat.placements
        .push(Placement::Board(Pose { translation: away, rotation: flat.cameras[0].pose.rotation.conjugate() }));
    for (x, y) in [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1), (0.0, 0.05)] {
        see(&mut flat, 0, 0, DVec3::new(x, y, 0.0), 0.1, 5);
    }
    let uncertainty = flat.uncertainty(Loss::Squared).unwrap();
    assert_eq!(uncertainty.open[0].parameters[0].1, Parameter::Focal);
}

#[test]
fn points_alone_leave_the_scale_open_and_a_distance_closes_it() {
    let cameras = arc(3);
    let mut bundle = Bundle { cameras, ..Bundle::default() };
    for index in 0..25 {
        bundle.placements.push(Placement::Point(vector(4, index, 0.5)));
        for camera in 0..3 {
            see(&mut bundle, camera, index as usize, DVec3::ZERO, 0.1, random::key(4, &[50, index]));
        }
    }
    assert_eq!(bundle.uncertainty(Loss::Squared).unwrap().open.len(), 1);
    let metres = (bundle.cameras[0].pose.centre() - bundle.cameras[2].pose.centre()).length();
    bundle.priors.push(Prior::Distance { cameras: [0, 2], metres, sigma: 1e-4 });
    let uncertainty = bundle.uncertainty(Loss::Squared).unwrap();
    assert!(uncertainty.open.is_empty(), "{:?}", uncertainty.open);
    disturb(&mut bundle, 0.02);
    bundle.solve(&Options::default()).unwrap();
    let found = (bundle.cameras[0].pose.centre() - bundle.cameras[2].pose.centre()).length();
    assert!((found - metres).abs() < 1e-6, "{found} {metres}");
}

#[test]
fn outliers_are_borne_found_and_left_out() {
    let truth = wands(&arc(5), 40, 0.2, 5);
    let mut bundle = truth.clone();
    let mut wrong = 0;
    for (index, observation) in bundle.observations.iter_mut().enumerate() {
        if random::uniform(random::key(6, &[index as u64])) < 0.3 {
            let far = vector(6, 1000 + index as u64, 150.0);
            observation.pixel += far.truncate();
            wrong += usize::from(far.truncate().length() > 2.0);
        }
    }
    disturb(&mut bundle, 0.02);
    bundle.solve(&Options { loss: Loss::Cauchy(3.0), ..Options::default() }).unwrap();
    let found = bundle.mark_outliers(5.0, 1.0);
    assert!(found.abs_diff(wrong) <= 5, "{found} of {wrong}");
    bundle.solve(&Options::default()).unwrap();
    for (camera, true_camera) in bundle.cameras.iter().zip(&truth.cameras) {
        let off = (camera.pose.centre() - true_camera.pose.centre()).length();
        assert!(off < 2e-3, "{off}");
    }
}

#[test]
fn a_late_camera_is_found_by_what_moves() {
    let mut bundle = wands(&arc(4), 30, 0.1, 8);
    bundle.cameras[2].free.push(Parameter::TimeOffset);
    for (index, observation) in bundle.observations.iter_mut().enumerate() {
        observation.velocity = vector(9, index as u64, 300.0).truncate();
        if observation.camera == 2 {
            // Its stamps are 4 ms early: what it saw under a stamp had moved on by then.
            observation.pixel += observation.velocity * 0.004;
        }
    }
    bundle.solve(&Options::default()).unwrap();
    assert!((bundle.cameras[2].time_offset_s - 0.004).abs() < 1e-4, "{}", bundle.cameras[2].time_offset_s);
}

#[test]
fn nonsense_is_refused() {
    let good = wands(&arc(3), 3, 0.1, 2);
    let mut bundle = good.clone();
    bundle.observations[4].pixel.x = f64::NAN;
    assert!(bundle.solve(&Options::default()).unwrap_err().to_string().starts_with("observation 4"));
    let mut bundle = good.clone();
    bundle.observations[4].side = Some(0);
    assert!(bundle.solve(&Options::default()).unwrap_err().to_string().contains("side"));
    bundle.sides.push(Side { middle: DVec3::NAN, ..back() });
    assert!(bundle.solve(&Options::default()).unwrap_err().to_string().starts_with("back"));
    let mut bundle = good.clone();
    bundle.cameras[1].intrinsics.fx = -3.0;
    assert!(bundle.uncertainty(Loss::Squared).unwrap_err().to_string().starts_with("camera c1"));
    let mut bundle = good.clone();
    bundle.priors.push(Prior::Value { camera: 9, parameter: Parameter::Fx, value: 1.0, sigma: 1.0 });
    assert!(bundle.solve(&Options::default()).is_err());
    let mut bundle = good.clone();
    bundle.cameras[1].free = Parameter::POSE.repeat(4);
    assert!(bundle.solve(&Options::default()).unwrap_err().to_string().contains("more free parameters"));
    assert_eq!(Bundle::default().solve(&Options::default()).unwrap_err(), BundleError::Empty);
}

/// Matrices of no rows, or of one.
#[test]
fn problems_with_nothing_or_one_thing_free_are_solved_and_told() {
    for method in [Method::Cholesky, Method::ConjugateGradients] {
        for free in [vec![], vec![Parameter::Focal]] {
            let mut bundle = wands(&arc(2), 8, 0.2, 4);
            bundle.cameras[0].free.clear();
            bundle.cameras[1].free.clone_from(&free);
            bundle.solve(&Options { method, ..Options::default() }).unwrap();
            let groups = jackknife::successive(bundle.placements.len(), jackknife::MOST_GROUPS);
            for uncertainty in [
                bundle.uncertainty(Loss::Squared).unwrap(),
                bundle.uncertainty_of_groups(Loss::Squared, &groups).unwrap(),
                bundle.uncertainty_of_clusters(Loss::Squared, &groups).unwrap(),
            ] {
                assert_eq!((uncertainty.rank, uncertainty.covariance.nrows()), (free.len(), free.len()));
                assert!(uncertainty.open.is_empty() && uncertainty.condition >= 1.0 - 1e-12, "{uncertainty:?}");
                assert!(uncertainty.cameras[1].sigma.iter().all(|sigma| *sigma > 0.0 && sigma.is_finite()));
            }
        }
    }
    // Points that are known, and cameras that see them, alone.
    let mut bundle = Bundle { cameras: arc(2), placements: vec![Placement::Fixed], ..Bundle::default() };
    bundle.cameras[0].free = Parameter::POSE.to_vec();
    for index in 0..8 {
        for camera in 0..2 {
            see(&mut bundle, camera, 0, vector(5, index, 0.4), 0.0, 0);
        }
    }
    let truth = bundle.cameras.clone();
    bundle.cameras[1].pose.translation.x += 0.02;
    bundle.cameras[0].pose.rotation = DQuat::from_rotation_y(0.01) * bundle.cameras[0].pose.rotation;
    let solution = bundle.solve(&Options::default()).unwrap();
    assert_eq!(solution.parameters, [12, 0]);
    for (found, truth) in bundle.cameras.iter().zip(&truth) {
        assert!(found.pose.centre().distance(truth.pose.centre()) < 1e-7);
    }
}
