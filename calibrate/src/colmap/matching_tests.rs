use erfgs_base::random;
use erfgs_scene::Distortion;
use proptest::prelude::*;

use super::*;

const LIMITS: Limits =
    Limits { band_px: 1.5, ratio: 0.85, max_descriptor_angle: 0.7, max_ray_angle: 0.7, depth_m: [0.3, 8.0] };

fn camera(eye: DVec3, target: DVec3) -> (Intrinsics, Pose) {
    let (width, height) = (640, 360);
    let (fx, fy, cx, cy) = (480.0, 470.0, 330.0, 175.0);
    let intrinsics = Intrinsics { width, height, fx, fy, cx, cy, distortion: Distortion::None };
    (intrinsics, Pose::look_at(eye, target, DVec3::Y))
}

fn numbers(seed: u64, words: &[u64]) -> impl Fn(u64, f64, f64) -> f64 + use<> {
    let key = random::key(seed, words);
    move |index, from, to| random::range(random::extend(key, index), from, to)
}

/// A descriptor of its own for each `point`, with a little noise for each `view`.
fn descriptor(seed: u64, point: u64, view: u64) -> [u8; DESCRIPTOR] {
    let (own, noise) = (numbers(seed, &[1, point]), numbers(seed, &[2, point, view]));
    std::array::from_fn(|index| (own(index as u64, 0.0, 200.0).powi(3) / 4e4 + noise(index as u64, 0.0, 12.0)) as u8)
}

/// Features of `count` points in front of the cameras, seen with up to `blur` pixels of error.
fn features(seed: u64, count: u64, view: u64, camera: &(Intrinsics, Pose), blur: f64) -> (Vec<u64>, Features) {
    let (mut ids, mut points, mut descriptors) = (Vec::new(), Vec::new(), Vec::new());
    for id in 0..count {
        let place = numbers(seed, &[3, id]);
        let world = DVec3::new(place(0, -1.5, 1.5), place(1, -1.0, 1.0), place(2, 2.0, 4.0));
        let seen = camera.1.transform(world);
        let error = numbers(seed, &[4, id, view]);
        let pixel = camera.0.project_pinhole(seen) + DVec2::new(error(0, -blur, blur), error(1, -blur, blur));
        if seen.z > 0.1 && pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(DVec2::new(640.0, 360.0)).all() {
            ids.push(id);
            points.push(pixel);
            descriptors.push(descriptor(seed, id, view));
        }
    }
    (ids, Features::new(640, 360, points, descriptors))
}

fn matched(
    a: &Features,
    a_camera: &(Intrinsics, Pose),
    b: &Features,
    b_camera: &(Intrinsics, Pose),
    limits: &Limits,
) -> Vec<[u32; 2]> {
    let (a_camera, b_camera) = ((&a_camera.0, &a_camera.1), (&b_camera.0, &b_camera.1));
    match_pair(a, a_camera, b, b_camera, &Relative::new(a_camera, b_camera), limits)
}

/// The same by comparing every keypoint with every other, from world rays instead of matrices.
fn matched_plainly(
    a: &Features,
    a_camera: &(Intrinsics, Pose),
    b: &Features,
    b_camera: &(Intrinsics, Pose),
    limits: &Limits,
) -> Vec<[u32; 2]> {
    let ray = |camera: &(Intrinsics, Pose), pixel| camera.1.inverse().rotation * camera.0.unproject_pinhole(pixel, 1.0);
    // Distance of `pixel` from the projection of the ray `from` + s `along`.
    let off_line = |camera: &(Intrinsics, Pose), pixel: DVec2, from: DVec3, along: DVec3| {
        let [p, q] = [from, from + along].map(|point| {
            let seen = camera.1.transform(point);
            DVec3::new(camera.0.fx * seen.x + camera.0.cx * seen.z, camera.0.fy * seen.y + camera.0.cy * seen.z, seen.z)
        });
        let line = p.cross(q);
        line.dot(pixel.extend(1.0)).abs() / line.truncate().length()
    };
    let (from_a, from_b) = (a_camera.1.centre(), b_camera.1.centre());
    let angle = |i: usize, j: usize| {
        let product = dot(&a.descriptors[i], &b.descriptors[j]) as f32 * a.inverse_length[i] * b.inverse_length[j];
        f64::from(product.clamp(-1.0, 1.0)).acos()
    };
    let candidate = |i: usize, j: usize| {
        let (u, v) = (ray(a_camera, a.points[i]), ray(b_camera, b.points[j]));
        if u.angle_between(v) > limits.max_ray_angle {
            return false;
        }
        if off_line(b_camera, b.points[j], from_a, u) >= limits.band_px
            || off_line(a_camera, a.points[i], from_b, v) >= limits.band_px
        {
            return false;
        }
        // Closest points: (from_a + s u) - (from_b + r v) is perpendicular to both rays.
        let apart = from_b - from_a;
        let normal = u.cross(v);
        let s = apart.cross(v).dot(normal) / normal.length_squared();
        let r = apart.cross(u).dot(normal) / normal.length_squared();
        [s, r].iter().all(|depth| (limits.depth_m[0]..=limits.depth_m[1]).contains(depth))
    };
    let table: Vec<Vec<bool>> = (0..a.count()).map(|i| (0..b.count()).map(|j| candidate(i, j)).collect()).collect();
    let accepted = |mut rivals: Vec<(f64, usize)>| -> Option<usize> {
        rivals.sort_by(|x, y| x.0.total_cmp(&y.0));
        let (nearest, index) = *rivals.first()?;
        let second = rivals.get(1).map_or(limits.max_descriptor_angle, |rival| rival.0);
        (nearest < limits.ratio * second && nearest < limits.max_descriptor_angle).then_some(index)
    };
    let of_a = |i: usize| accepted((0..b.count()).filter(|&j| table[i][j]).map(|j| (angle(i, j), j)).collect());
    let of_b = |j: usize| accepted((0..a.count()).filter(|&i| table[i][j]).map(|i| (angle(i, j), i)).collect());
    (0..a.count()).filter_map(|i| of_a(i).filter(|&j| of_b(j) == Some(i)).map(|j| [i as u32, j as u32])).collect()
}

#[test]
fn every_common_point_is_matched_and_nothing_else() {
    let a_camera = camera(DVec3::new(-0.6, -0.2, 0.0), DVec3::new(0.0, 0.0, 3.0));
    let b_camera = camera(DVec3::new(0.7, 0.1, 0.2), DVec3::new(0.0, 0.0, 3.0));
    let (a_ids, a) = features(1, 400, 0, &a_camera, 0.3);
    let (b_ids, b) = features(1, 400, 1, &b_camera, 0.3);
    let matches = matched(&a, &a_camera, &b, &b_camera, &LIMITS);
    assert!(matches.iter().all(|&[i, j]| a_ids[i as usize] == b_ids[j as usize]), "a wrong match");
    let common = a_ids.iter().filter(|id| b_ids.contains(id)).count();
    assert!(matches.len() * 100 >= common * 99, "{} of {common}", matches.len());
}

#[test]
fn a_keypoint_off_the_epipolar_line_is_not_matched() {
    let a_camera = camera(DVec3::new(-0.6, 0.0, 0.0), DVec3::new(0.0, 0.0, 3.0));
    let b_camera = camera(DVec3::new(0.6, 0.0, 0.0), DVec3::new(0.0, 0.0, 3.0));
    let (_, a) = features(2, 100, 0, &a_camera, 0.0);
    let (_, mut b) = features(2, 100, 1, &b_camera, 0.0);
    b.points.iter_mut().for_each(|point| point.y += 4.0);
    let b = Features::new(640, 360, b.points, b.descriptors);
    assert!(matched(&a, &a_camera, &b, &b_camera, &LIMITS).is_empty());
}

#[test]
fn two_alike_on_one_epipolar_line_are_not_told_apart() {
    let a_camera = camera(DVec3::new(-0.5, 0.0, 0.0), DVec3::new(-0.5, 0.0, 3.0));
    let b_camera = camera(DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.5, 0.0, 3.0));
    let a = Features::new(640, 360, vec![DVec2::new(400.0, 200.0)], vec![descriptor(5, 0, 0)]);
    let at = |x: f64| DVec2::new(x, 200.0);
    let one = Features::new(640, 360, vec![at(250.0)], vec![descriptor(5, 0, 1)]);
    assert_eq!(matched(&a, &a_camera, &one, &b_camera, &LIMITS), [[0, 0]]);
    let twins = vec![descriptor(5, 0, 1), descriptor(5, 0, 2)];
    let two = Features::new(640, 360, vec![at(250.0), at(300.0)], twins);
    assert!(matched(&a, &a_camera, &two, &b_camera, &LIMITS).is_empty());
}

#[test]
fn points_outside_the_depth_range_are_not_matched() {
    let a_camera = camera(DVec3::new(-0.5, 0.0, 0.0), DVec3::new(-0.5, 0.0, 3.0));
    let b_camera = camera(DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.5, 0.0, 3.0));
    let (_, a) = features(6, 200, 0, &a_camera, 0.0);
    let (_, b) = features(6, 200, 1, &b_camera, 0.0);
    let all = matched(&a, &a_camera, &b, &b_camera, &LIMITS).len();
    let near = matched(&a, &a_camera, &b, &b_camera, &Limits { depth_m: [0.3, 3.0], ..LIMITS }).len();
    assert!(near > 0 && near < all, "{near} of {all}");
    assert_eq!(matched(&a, &a_camera, &b, &b_camera, &Limits { depth_m: [0.3, 1.9], ..LIMITS }).len(), 0);
}

#[test]
fn cameras_at_one_place_and_images_without_features_have_no_matches() {
    let one = camera(DVec3::ZERO, DVec3::Z);
    let (_, some) = features(7, 50, 0, &one, 0.0);
    assert!(matched(&some, &one, &some, &one, &LIMITS).is_empty());
    let none = Features::new(640, 360, Vec::new(), Vec::new());
    let other = camera(DVec3::X, DVec3::Z);
    assert!(matched(&some, &one, &none, &other, &LIMITS).is_empty());
    assert!(matched(&none, &one, &some, &other, &LIMITS).is_empty());
}

#[test]
fn the_relative_pose_satisfies_the_epipolar_constraint() {
    let a = camera(DVec3::new(-0.6, 0.3, 0.1), DVec3::new(0.2, 0.0, 3.0));
    let b = camera(DVec3::new(0.9, -0.1, 0.4), DVec3::new(0.0, 0.1, 2.5));
    let relative = Relative::new((&a.0, &a.1), (&b.0, &b.1));
    let world = DVec3::new(0.2, -0.3, 2.9);
    let (in_a, in_b) = (a.1.transform(world), b.1.transform(world));
    assert!((relative.rotation * in_a + relative.translation - in_b).length() < 1e-12);
    assert!(in_b.dot(relative.essential * in_a).abs() < 1e-12);
    let (x, y) = (a.0.project_pinhole(in_a).extend(1.0), b.0.project_pinhole(in_b).extend(1.0));
    assert!(y.dot(relative.fundamental * x).abs() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Cameras beside, before and behind each other: epipoles outside and inside the images.
    #[test]
    fn the_grid_finds_what_comparing_all_with_all_finds(
        seed in 0_u64..1 << 40,
        a_eye in prop::array::uniform3(-1.5..1.5_f64),
        b_eye in prop::array::uniform3(-1.5..1.5_f64),
        aim in prop::array::uniform3(-0.5..0.5_f64),
        band_px in 0.5..6.0_f64,
        max_ray_angle in 0.2..2.0_f64,
    ) {
        let target = DVec3::new(0.0, 0.0, 3.0);
        let a_camera = camera(a_eye.into(), target);
        let b_camera = camera(b_eye.into(), target + DVec3::from(aim));
        let (_, a) = features(seed, 150, 0, &a_camera, band_px);
        let (_, b) = features(seed, 150, 1, &b_camera, band_px);
        let limits = Limits { band_px, max_ray_angle, depth_m: [0.5, 5.0], ..LIMITS };
        prop_assert_eq!(
            matched(&a, &a_camera, &b, &b_camera, &limits),
            matched_plainly(&a, &a_camera, &b, &b_camera, &limits)
        );
    }
}
