//! Forward: images and depth.

use std::sync::Arc;

use super::scenes::{FORMS, Form, Rendered, Scene, camera, device};
use crate::gpu::Shape;
use crate::raster::{
    CORE_STRIDE, Frame, GaussianBuffers, LOW_PASS, RasterError, Rasteriser, Region, RenderOptions, Thresholds, View,
};

/// Largest difference of a colour or transmittance between the device and the twin, and of the depth.
fn differences(scene: &Scene, form: Form) -> (f64, f64) {
    let rendered = scene.run(form);
    let twin = scene.twin().render(&scene.view, &scene.options);
    let colour = rendered
        .image
        .iter()
        .zip(&twin.pixels)
        .flat_map(|(device, twin)| device.map(f64::from).into_iter().zip(twin.to_array()))
        .map(|(device, twin)| (device - twin).abs())
        .fold(0.0, f64::max);
    let depth = rendered
        .depth
        .iter()
        .flatten()
        .zip(&twin.depth)
        .map(|(device, twin)| (f64::from(*device) - twin).abs())
        .fold(0.0, f64::max);
    (colour, depth)
}

#[test]
fn images_agree_with_the_twin_at_every_sh_degree() {
    for form in FORMS {
        for degree in 0..=3 {
            let mut scene = Scene::random(u64::from(degree), 60, degree, camera(37, 29), 3.0);
            scene.options.depth = degree == 2;
            let (colour, depth) = differences(&scene, form);
            assert!(colour < 2e-5 && depth < 1e-4, "{form:?} degree {degree}: {colour} {depth}");
        }
    }
}

#[test]
fn a_lower_degree_than_allocated_ignores_the_higher_coefficients() {
    for form in FORMS {
        let mut scene = Scene::random(11, 40, 3, camera(24, 20), 3.0);
        scene.options.sh_degree = 1;
        let (colour, _) = differences(&scene, form);
        assert!(colour < 2e-5, "{form:?}: {colour}");
    }
}

#[test]
fn deltas_move_the_first_rows() {
    for form in FORMS {
        for sh in [false, true] {
            let scene = Scene::random(21, 40, 2, camera(24, 20), 3.0).with_deltas(5, 17, sh);
            let (colour, _) = differences(&scene, form);
            assert!(colour < 2e-5, "{form:?}: {colour}");
            let still = Scene { deltas: None, ..scene.clone() };
            assert!(still.run(form).image != scene.run(form).image, "{form:?}");
        }
    }
}

#[test]
fn three_sigma_squares_are_those_of_tiles_of_16_pixels() {
    for form in FORMS {
        let mut scene = Scene::random(31, 50, 0, camera(75, 50), 6.0);
        // Opaque Gaussians reach beyond 3 sigma, so that the bound shows; round ones do so along the axes.
        for row in scene.core.chunks_exact_mut(12) {
            row.copy_within(3..4, 4);
            row.copy_within(3..4, 5);
            row[10] = 6.0;
        }
        let free = scene.run(form).image;
        scene.options.three_sigma = true;
        let (colour, _) = differences(&scene, form);
        assert!(colour < 2e-5, "{form:?}: {colour}");
        assert!(scene.run(form).image != free, "{form:?}: the bound shows");
    }
}

#[test]
fn the_low_pass_of_enlarged_images_is_that_of_the_twin_and_widens_splats() {
    for form in FORMS {
        let mut scene = Scene::random(17, 40, 1, camera(33, 18), 1.0);
        let sharp = scene.run(form).image;
        scene.options.low_pass = 4.8;
        let (colour, _) = differences(&scene, form);
        assert!(colour < 3e-4, "{form:?}: {colour}");
        let background = |image: &[[f32; 4]]| image.iter().map(|pixel| f64::from(pixel[3])).sum::<f64>();
        assert!(background(&scene.run(form).image) < background(&sharp), "{form:?}: splats cover more");
    }
}

#[test]
fn many_opaque_layers_stop_before_the_transmittance_is_spent() {
    for form in FORMS {
        let mut scene = Scene::random(41, 300, 1, camera(33, 18), 6.0);
        for row in scene.core.chunks_exact_mut(12) {
            row[10] = 2.5;
        }
        let (colour, _) = differences(&scene, form);
        assert!(colour < 3e-4, "{form:?}: {colour}");
        assert!(scene.run(form).image.iter().all(|pixel| pixel[3] >= 1e-4));
    }
}

#[test]
fn images_of_any_size_are_complete() {
    for form in FORMS {
        for (width, height) in [(1, 1), (3, 5), (16, 16), (17, 4), (4, 33), (65, 2)] {
            let view = View { fx: 20.0, fy: 20.0, ..camera(width, height) };
            let scene = Scene::random(51, 30, 0, view, 2.0);
            let (colour, _) = differences(&scene, form);
            assert!(colour < 2e-5, "{form:?} {width} x {height}: {colour}");
        }
    }
}

#[test]
fn no_gaussian_leaves_the_background() {
    for form in FORMS {
        let scene = Scene::random(61, 0, 1, camera(19, 7), 2.0);
        let rendered = scene.run(form);
        assert!(rendered.image.iter().all(|pixel| *pixel == [0.2, 0.5, 0.9, 1.0]), "{:?}", rendered.image[0]);
    }
}

#[test]
fn gaussians_that_reach_the_camera_are_culled_where_that_is_asked_for() {
    for form in FORMS {
        let mut scene = Scene::random(71, 40, 0, camera(24, 20), 3.0);
        for row in scene.core.chunks_exact_mut(12).step_by(3) {
            row[3..6].fill(0.9);
        }
        let veiled = scene.run(form).image;
        scene.options.near_sigmas = 1.0;
        let (colour, _) = differences(&scene, form);
        assert!(colour < 2e-5, "{form:?}: {colour}");
        assert!(scene.run(form).image != veiled, "{form:?}");
    }
}

#[test]
fn a_frame_without_room_is_refused_and_grows() {
    let scene = Scene::random(81, 200, 0, camera(60, 50), 4.0);
    let (gpu, rasteriser) = device(Form::Gpu);
    let gaussians = GaussianBuffers::from_slices(gpu, 0, &scene.core, &scene.sh).expect("room");
    let mut frame = Frame::new(gpu).expect("room");
    let options = RenderOptions { first_room: Some(64), ..scene.options };
    let mut render = || {
        rasteriser.forward(gpu, &gaussians, None, &scene.view, &options, &mut frame).expect("a render");
        let checked = frame.check(gpu);
        (checked, gpu.download::<[f32; 4]>(&frame.image, 60 * 50).expect("a read back"))
    };
    let (checked, truncated) = render();
    assert!(matches!(checked, Err(RasterError::Overflow { capacity: 64, needed }) if needed > 64), "{checked:?}");
    assert!(truncated.as_flattened().iter().all(|x| x.is_finite()));
    let (checked, whole) = render();
    assert!(checked.is_ok() && whole == scene.run(Form::Gpu).image && whole != truncated);
}

#[test]
fn outside_a_region_there_is_the_background_alone_and_no_gradient() {
    let mut scene = Scene::random(91, 150, 0, camera(70, 45), 3.0);
    let mask: Vec<bool> = (0..70 * 45).map(|pixel| (20..31).contains(&(pixel % 70)) && pixel / 70 < 19).collect();
    let region = Arc::new(Region::new(&mask, 70, 45));
    for (pixel, d) in scene.d_image.iter_mut().enumerate() {
        if !region.contains(pixel as u32 % 70, pixel as u32 / 70) {
            *d = [0.0; 4];
        }
    }
    for form in FORMS {
        let whole = scene.run(form);
        let part = scene.run_in(form, Some(Arc::clone(&region)));
        let pixels = whole.image.iter().zip(&part.image).zip(0..);
        let wrong = pixels.filter(|((whole, part), pixel)| region.contains(pixel % 70, pixel / 70) && whole != part);
        assert_eq!(wrong.count(), 0, "{form:?}");
        let far = |pixel: &usize| pixel % 70 > 48;
        let background = (0..70 * 45).filter(far).all(|pixel| part.image[pixel] == [0.2, 0.5, 0.9, 1.0]);
        assert_eq!(background, form.shape() == Shape::Cpu, "{form:?}");
        let off = whole.d_core.iter().zip(&part.d_core).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let largest = whole.d_core.iter().fold(0.0, |most: f32, x| most.max(x.abs()));
        assert!(off < 1e-5 * largest, "{form:?}: {off} of {largest}");
        // What is outside was not seen: density control would take it for a place that is right.
        let has_gradient = part.d_core.chunks_exact(CORE_STRIDE as usize).map(|row| row.iter().any(|&d| d != 0.0));
        let counted: Vec<(bool, bool)> = has_gradient.zip(part.screen.iter().map(|row| row[3] > 0.0)).collect();
        assert!(
            counted.iter().all(|&(has_gradient, counted)| counted || !has_gradient),
            "{form:?}: a gradient that is not counted"
        );
        let seen = |rendered: &Rendered| rendered.screen.iter().filter(|row| row[3] > 0.0).count();
        assert!(2 * seen(&part) < seen(&whole) && seen(&part) > 10, "{form:?}: {} of {}", seen(&part), seen(&whole));
        if form.shape() == Shape::Gpu {
            assert!(counted.iter().all(|&(has_gradient, counted)| has_gradient == counted), "{form:?}");
        }
    }
}

#[test]
fn thresholds_bound_what_a_splat_reaches_and_how_deep_a_pixel_goes() {
    let covered = |form: Form, thresholds: Thresholds| {
        let gpu = &device(form).0;
        let rasteriser = Rasteriser::with_thresholds(gpu, thresholds).expect("kernels that compile");
        let view = View {
            translation: [0.0; 3],
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            ..camera(33, 33)
        };
        // Ten round splats of an opacity of 0.9, one behind another, of 2 pixels.
        let core = |layer: u8| {
            let z = 2.0 + 0.1 * f32::from(layer);
            let size = ((4.0_f32 - LOW_PASS).sqrt() * z / view.fx).ln();
            [0.0, 0.0, z, size, size, size, 1.0, 0.0, 0.0, 0.0, 9_f32.ln(), 0.0]
        };
        let core: Vec<f32> = (0..10).flat_map(core).collect();
        let gaussians = GaussianBuffers::from_slices(gpu, 0, &core, &[0.0; 40]).expect("buffers");
        let mut frame = Frame::new(gpu).expect("a frame");
        let options = RenderOptions { sh_degree: 0, ..RenderOptions::default() };
        rasteriser.forward(gpu, &gaussians, None, &view, &options, &mut frame).expect("a picture");
        let image: Vec<[f32; 4]> = gpu.download(&frame.image, 33 * 33).expect("pixels");
        let least = image.iter().map(|pixel| pixel[3]).fold(1.0, f32::min);
        (image.iter().filter(|pixel| pixel[3] < 1.0).count(), least)
    };
    for form in [Form::Cpu, Form::Gpu] {
        let usual = Thresholds::default();
        let (area, least) = covered(form, usual);
        let (wide, _) = covered(form, Thresholds { negligible_alpha: 1e-5, ..usual });
        let (narrow, _) = covered(form, Thresholds { negligible_alpha: 0.3, ..usual });
        // A circle of radius 2 sqrt(2 ln(0.9 / threshold)) pixels.
        for (pixels, threshold) in [(area, 1.0 / 255.0), (wide, 1e-5), (narrow, 0.3)] {
            let circle = std::f64::consts::TAU * 4.0 * (0.9_f64 / threshold).ln();
            assert!((pixels as f64 / circle - 1.0).abs() < 0.1, "{form:?} {threshold}: {pixels} and {circle}");
        }
        let (_, deep) = covered(form, Thresholds { least_transmittance: 1e-9, ..usual });
        assert!(least >= 1e-4 && deep < 1e-8, "{form:?}: {least} {deep}");
    }
    for wrong in [0.0, -1.0, f32::NAN, 1.5] {
        let thresholds = Thresholds { negligible_alpha: wrong, ..Thresholds::default() };
        assert!(Rasteriser::with_thresholds(&device(Form::Cpu).0, thresholds).is_err(), "{wrong}");
    }
}
