//! Backward: analytic gradients of the kernels against central differences of the twin.

use glam::{DMat3, DQuat, DVec3, DVec4};

use super::scenes::{FORMS, Scene, camera};
use crate::{
    raster::{CORE_STRIDE, RenderOptions, sh_stride},
    reference::raster::{blend, blend_backward, pose, project},
};

const STEP: f64 = 1e-6;

/// Central differences of the twin's loss with respect to every parameter: core, then SH.
fn by_differences(scene: &Scene) -> (Vec<f64>, Vec<f64>) {
    let twin = scene.twin();
    let core = (0..twin.core.len())
        .map(|index| {
            let loss = |step: f64| {
                let mut moved = twin.clone();
                moved.core[index] += step;
                scene.loss(&moved)
            };
            (loss(STEP) - loss(-STEP)) / (2.0 * STEP)
        })
        .collect();
    let sh = (0..twin.sh.len())
        .map(|index| {
            let loss = |step: f64| {
                let mut moved = twin.clone();
                moved.sh[index] += step;
                scene.loss(&moved)
            };
            (loss(STEP) - loss(-STEP)) / (2.0 * STEP)
        })
        .collect();
    (core, sh)
}

/// The same with respect to a turn of the camera about its axes and a shift along them.
fn pose_by_differences(scene: &Scene) -> [f64; 6] {
    let twin = scene.twin();
    let (rotation, translation) = pose(&scene.view);
    std::array::from_fn(|axis| {
        let loss = |step: f64| {
            let mut by = [0.0; 6];
            by[axis] = step;
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(&by[..3])));
            let moved = (turn * rotation, turn * translation + DVec3::from_slice(&by[3..]));
            scene.loss_of(&blend(&twin.splats_from(&scene.view, &moved, &scene.options), &scene.view, &scene.options))
        };
        (loss(STEP) - loss(-STEP)) / (2.0 * STEP)
    })
}

/// Asserts that each column group of rows of `stride` agrees, relative to the largest entry of the group.
fn assert_groups_agree(
    what: &str,
    device: &[f32],
    twin: &[f64],
    stride: usize,
    groups: &[(&str, std::ops::Range<usize>)],
) {
    for (name, columns) in groups {
        let pairs = || {
            device
                .chunks_exact(stride)
                .zip(twin.chunks_exact(stride))
                .flat_map(|(device, twin)| columns.clone().map(move |column| (f64::from(device[column]), twin[column])))
        };
        let largest = pairs().map(|(_, twin)| twin.abs()).fold(0.0, f64::max);
        let worst = pairs().map(|(device, twin)| (device - twin).abs()).fold(0.0, f64::max);
        assert!(largest > 0.0, "{what} {name}: the test has no gradient to compare");
        assert!(worst < 2e-4 * largest, "{what} {name}: off by {worst}, largest {largest}");
    }
}

const CORE_GROUPS: [(&str, std::ops::Range<usize>); 4] =
    [("mean", 0..3), ("log scale", 3..6), ("quaternion", 6..10), ("opacity logit", 10..11)];

fn assert_gradients_agree(what: &str, scene: &Scene) {
    let (core, sh) = by_differences(scene);
    let stride = sh_stride(scene.sh_degree) as usize;
    let active = 3 * (scene.options.sh_degree as usize + 1).pow(2);
    for form in FORMS {
        let what = format!("{what} {form:?}");
        let device = scene.run(form);
        assert_groups_agree(&what, &device.d_core, &core, CORE_STRIDE as usize, &CORE_GROUPS);
        assert_groups_agree(&what, &device.d_sh, &sh, stride, &[("constant", 0..3), ("all", 0..active)]);
        let pose = pose_by_differences(scene);
        assert_groups_agree(&what, &device.d_pose, &pose, 6, &[("turn", 0..3), ("shift", 3..6)]);
        if let Some((delta_core, delta_sh)) = &scene.deltas {
            assert!(device.d_delta_core == device.d_core[..delta_core.len()], "{what}");
            let delta_sh = delta_sh.as_ref().map_or(0, Vec::len);
            assert!(device.d_delta_sh == device.d_sh[..delta_sh], "{what}");
        }
    }
}

#[test]
fn gradients_agree_with_differences_at_every_sh_degree() {
    for degree in 0..=3 {
        let scene = Scene::random(100 + u64::from(degree), 12, degree, camera(21, 17), 3.0);
        assert_gradients_agree(&format!("degree {degree}"), &scene);
    }
}

#[test]
fn gradients_of_deltas_are_those_of_the_rows_they_move() {
    for sh in [false, true] {
        let scene = Scene::random(200, 10, 1, camera(18, 15), 3.0).with_deltas(3, 6, sh);
        assert_gradients_agree(&format!("deltas, SH {sh}"), &scene);
    }
}

#[test]
fn what_stands_still_can_be_left_as_it_is() {
    let all = Scene::random(200, 10, 1, camera(18, 15), 3.0).with_deltas(3, 6, true);
    let options = RenderOptions { still_learn: false, ..all.options };
    let moving = Scene { options, ..all.clone() };
    for form in FORMS {
        let (all, moving) = (all.run(form), moving.run(form));
        let stride = sh_stride(1) as usize;
        let [core, sh] = [6 * CORE_STRIDE as usize, 6 * stride];
        assert_eq!(moving.image, all.image, "{form:?}");
        assert_eq!((&moving.d_core[..core], &moving.d_sh[..sh]), (&all.d_core[..core], &all.d_sh[..sh]), "{form:?}");
        assert_eq!((&moving.d_delta_core, &moving.d_delta_sh), (&all.d_delta_core, &all.d_delta_sh), "{form:?}");
        assert_eq!(moving.screen[..6], all.screen[..6], "{form:?}");
        let rest = moving.d_core[core..].iter().chain(&moving.d_sh[sh..]).chain(moving.screen[6..].as_flattened());
        assert!(rest.clone().all(|&gradient| gradient == 0.0), "{form:?}");
        assert!(all.d_core[core..].iter().any(|&gradient| gradient != 0.0), "{form:?}");
    }
}

#[test]
fn gradients_hold_where_the_slope_of_the_jacobian_is_bounded() {
    // Large Gaussians whose means lie far outside of the image.
    let mut scene = Scene::random(300, 8, 1, camera(20, 16), 14.0);
    for (index, row) in scene.core.chunks_exact_mut(12).enumerate() {
        row[index % 2] += if index % 4 < 2 { 1.6 } else { -1.6 };
        row[10] = 3.0;
    }
    assert_gradients_agree("bounded slopes", &scene);
}

#[test]
fn gradients_hold_with_dense_layers_and_the_parity_square() {
    let mut scene = Scene::random(400, 40, 0, camera(20, 18), 4.0);
    scene.options.three_sigma = true;
    assert_gradients_agree("three sigma", &scene);
}

#[test]
fn the_twin_of_the_backward_blending_agrees_with_differences() {
    let scene = Scene::random(500, 9, 1, camera(16, 12), 3.0);
    let splats = scene.twin().splats(&scene.view, &scene.options);
    let image = scene.twin().render(&scene.view, &scene.options);
    let d_image: Vec<DVec4> = scene.d_image.iter().map(|d| DVec4::from(d.map(f64::from))).collect();
    let background = DVec3::from(scene.options.background.map(f64::from));
    let gradients = blend_backward(&splats, &image, background, &d_image);
    let twin = scene.twin();
    let stride = sh_stride(scene.sh_degree) as usize;
    for (index, gradient) in gradients.iter().enumerate() {
        let core = &twin.core[12 * index..12 * index + 12];
        let sh = &twin.sh[stride * index..stride * (index + 1)];
        let splat = project(core, sh, &scene.view, &scene.options).expect("a visible splat");
        // The opacity logit enters through v alone, red through the first SH coefficient alone.
        let loss = |column: Option<usize>, step: f64| {
            let mut moved = twin.clone();
            match column {
                Some(column) => moved.core[12 * index + column] += step,
                None => moved.sh[stride * index] += step,
            }
            scene.loss(&moved)
        };
        let slope = |column| (loss(column, STEP) - loss(column, -STEP)) / (2.0 * STEP);
        let logit = gradient.moments[0] * (1.0 - splat.opacity);
        assert!((slope(Some(10)) - logit).abs() < 1e-6, "{index}: {logit}");
        let red = if splat.colour.x > 0.0 { 0.28209479177387814 * gradient.colour.x } else { 0.0 };
        assert!((slope(None) - red).abs() < 1e-6, "{index}: {red}");
    }
}

#[test]
fn two_runs_give_the_same_bits() {
    for form in FORMS {
        let mut scene = Scene::random(600, 400, 2, camera(61, 47), 3.0).with_deltas(1, 100, true);
        scene.options.depth = true;
        assert!(scene.run(form) == scene.run(form), "{form:?}");
    }
}

#[test]
fn gradients_of_parameters_add_up_and_statistics_count_renders() {
    for form in FORMS {
        let scene = Scene::random(700, 20, 0, camera(20, 16), 2.0);
        let rendered = scene.run(form);
        let splats = scene.twin().splats(&scene.view, &scene.options);
        for (row, splat) in rendered.screen.iter().zip(&splats) {
            if row[3] == 0.0 {
                assert_eq!(*row, [0.0; 4]);
                continue;
            }
            let radius = splat.expect("a visible splat").radius.ceil();
            assert!((f64::from(row[2]) - radius).abs() < 1.1 && row[3] == 1.0, "{row:?} {radius}");
        }
        assert!(rendered.screen.iter().any(|row| row[3] == 1.0 && row[0] != 0.0));
    }
}
