//! Inputs that must give finite results or a typed error.

use super::scenes::{FORMS, Scene, camera, device};
use crate::{
    gpu::GpuError,
    raster::{Frame, GaussianBuffers, RasterError, View},
};

fn assert_finite(what: &str, scene: &Scene) {
    for form in FORMS {
        let rendered = scene.run(form);
        let finite = |values: &[f32]| values.iter().all(|x| x.is_finite());
        assert!(finite(rendered.image.as_flattened()), "{what} {form:?}: image");
        assert!(finite(&rendered.d_core), "{what} {form:?}: core");
        assert!(finite(&rendered.d_sh), "{what} {form:?}: sh");
        assert!(finite(rendered.screen.as_flattened()), "{what} {form:?}: screen");
        assert!(rendered.image.iter().all(|pixel| (0.0..=1.0).contains(&pixel[3])), "{what} {form:?}");
    }
}

fn changed(change: impl Fn(usize, &mut [f32])) -> Scene {
    let mut scene = Scene::random(900, 24, 1, camera(40, 30), 3.0);
    for (index, row) in scene.core.chunks_exact_mut(12).enumerate() {
        change(index, row);
    }
    scene
}

#[test]
fn needles_and_pancakes_stay_finite() {
    let spread = 1e6f32.ln();
    assert_finite("needles", &changed(|index, row| row[3 + index % 3] += spread));
    assert_finite("pancakes", &changed(|index, row| row[3 + index % 3] -= spread));
    assert_finite("long needles", &changed(|index, row| row[3 + index % 3] = 1e4f32.ln()));
}

#[test]
fn tiny_and_huge_scales_stay_finite() {
    assert_finite("tiny", &changed(|_, row| row[3..6].fill(1e-8f32.ln())));
    assert_finite("huge", &changed(|_, row| row[3..6].fill(1e4f32.ln())));
    assert_finite("beyond the bound", &changed(|_, row| row[3..6].fill(80.0)));
    assert_finite("vanishing", &changed(|_, row| row[3..6].fill(-200.0)));
}

#[test]
fn extreme_opacities_stay_finite() {
    assert_finite("opaque", &changed(|_, row| row[10] = 50.0));
    assert_finite("transparent", &changed(|_, row| row[10] = -50.0));
}

#[test]
fn gaussians_at_and_behind_the_near_plane_stay_finite() {
    let view =
        View { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation: [0.0; 3], ..camera(40, 30) };
    for z in [-3.0, -1e-9, 0.0, 1e-9, 0.01, 0.010_001, 1e-2 + 1e-7, 1e30] {
        let mut scene = changed(|_, row| row[2] = z);
        scene.view = view;
        assert_finite(&format!("z = {z}"), &scene);
    }
}

#[test]
fn a_zero_quaternion_is_left_out() {
    let scene = changed(|index, row| {
        if index % 2 == 0 {
            row[6..10].fill(0.0);
        }
    });
    assert_finite("zero quaternion", &scene);
    for form in FORMS {
        let rendered = scene.run(form);
        assert!(rendered.screen.iter().step_by(2).all(|row| row[3] == 0.0));
        assert!(rendered.screen.iter().skip(1).step_by(2).any(|row| row[3] == 1.0));
    }
}

#[test]
fn parameters_that_are_not_finite_are_left_out() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for column in 0..11 {
            let scene = changed(|index, row| {
                if index == 3 {
                    row[column] = bad;
                }
            });
            assert_finite(&format!("{bad} in column {column}"), &scene);
        }
        let mut scene = changed(|_, _| {});
        scene.sh[5] = bad;
        assert_finite(&format!("{bad} in SH"), &scene);
    }
}

#[test]
fn coincident_gaussians_keep_their_order() {
    let scene = changed(|index, row| {
        row[0..3].copy_from_slice(&[0.1, 0.1, 2.0]);
        row[10] = index as f32 / 10.0;
    });
    assert_finite("coincident", &scene);
    let images = FORMS.map(|form| scene.run(form).image);
    let differs = images[0]
        .as_flattened()
        .iter()
        .zip(images[FORMS.len() - 1].as_flattened())
        .map(|(cpu, gpu)| (cpu - gpu).abs())
        .fold(0.0, f32::max);
    assert!(differs < 1e-4, "{differs}");
}

#[test]
fn one_gaussian_in_one_pixel_is_differentiable() {
    let view = View { fx: 2.0, fy: 2.0, ..camera(1, 1) };
    let scene = Scene::random(901, 1, 0, view, 1.0);
    assert_finite("one", &scene);
}

#[test]
fn unusable_arguments_are_refused() {
    let (gpu, rasteriser) = device(FORMS[0]);
    let scene = Scene::random(902, 4, 1, camera(8, 8), 1.0);
    let gaussians = GaussianBuffers::from_slices(gpu, 1, &scene.core, &scene.sh).expect("room");
    let mut frame = Frame::new(gpu).expect("room");
    let mut render = |view: View, degree: u32| {
        let options = crate::raster::RenderOptions { sh_degree: degree, ..scene.options };
        rasteriser.forward(gpu, &gaussians, None, &view, &options, &mut frame)
    };
    assert!(matches!(render(View { width: 0, ..scene.view }, 1), Err(RasterError::View { .. })));
    assert!(matches!(render(View { fx: f32::NAN, ..scene.view }, 1), Err(RasterError::View { .. })));
    assert!(matches!(render(View { fy: -1.0, ..scene.view }, 1), Err(RasterError::View { .. })));
    assert!(matches!(render(scene.view, 2), Err(RasterError::Arguments { .. })));
    assert!(render(scene.view, 1).is_ok());
    assert!(matches!(
        GaussianBuffers::from_slices(gpu, 1, &scene.core[1..], &scene.sh),
        Err(RasterError::Arguments { .. })
    ));
}

#[test]
fn more_gaussians_than_a_buffer_holds_are_refused() {
    let (gpu, _) = device(FORMS[0]);
    let too_many = gpu.limits.max_storage_buffer_binding_size / 4 + 4;
    assert!(matches!(gpu.storage("too many", 4 * too_many), Err(GpuError::TooLarge { .. })));
}

#[test]
fn two_million_gaussians_are_rendered() {
    let (gpu, rasteriser) = device(FORMS[0]);
    let count = 2_000_000;
    let one = Scene::random(903, 1, 0, camera(32, 24), 1.0);
    let mut core = one.core.repeat(count);
    for (index, row) in core.chunks_exact_mut(12).enumerate() {
        row[0] += index as f32 * 1e-3 - 1000.0;
        row[10] = -2.0;
    }
    let gaussians = GaussianBuffers::from_slices(gpu, 0, &core, &one.sh.repeat(count)).expect("room");
    let mut frame = Frame::new(gpu).expect("room");
    rasteriser.forward(gpu, &gaussians, None, &one.view, &one.options, &mut frame).expect("a render");
    let image = gpu.download::<[f32; 4]>(&frame.image, 32 * 24).expect("a read back");
    assert!(image.as_flattened().iter().all(|x| x.is_finite()));
    assert!(image.iter().any(|pixel| pixel[3] < 0.9));
}
