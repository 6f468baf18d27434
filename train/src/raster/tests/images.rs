//! Forward: images and depth.

use super::scenes::{SHAPES, Scene, camera};
use crate::{gpu::Shape, raster::View};

/// Largest difference of a colour or transmittance between the device and the twin, and of the depth.
fn differences(scene: &Scene, shape: Shape) -> (f64, f64) {
    let rendered = scene.run(shape);
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
    for shape in SHAPES {
        for degree in 0..=3 {
            let mut scene = Scene::random(u64::from(degree), 60, degree, camera(37, 29), 3.0);
            scene.options.depth = degree == 2;
            let (colour, depth) = differences(&scene, shape);
            assert!(colour < 2e-5 && depth < 1e-4, "{shape:?} degree {degree}: {colour} {depth}");
        }
    }
}

#[test]
fn a_lower_degree_than_allocated_ignores_the_higher_coefficients() {
    for shape in SHAPES {
        let mut scene = Scene::random(11, 40, 3, camera(24, 20), 3.0);
        scene.options.sh_degree = 1;
        let (colour, _) = differences(&scene, shape);
        assert!(colour < 2e-5, "{shape:?}: {colour}");
    }
}

#[test]
fn deltas_move_the_first_rows() {
    for shape in SHAPES {
        for sh in [false, true] {
            let scene = Scene::random(21, 40, 2, camera(24, 20), 3.0).with_deltas(5, 17, sh);
            let (colour, _) = differences(&scene, shape);
            assert!(colour < 2e-5, "{shape:?}: {colour}");
            let still = Scene { deltas: None, ..scene.clone() };
            assert!(still.run(shape).image != scene.run(shape).image, "{shape:?}");
        }
    }
}

#[test]
fn three_sigma_squares_are_those_of_tiles_of_16_pixels() {
    for shape in SHAPES {
        let mut scene = Scene::random(31, 50, 0, camera(75, 50), 6.0);
        // Opaque Gaussians reach beyond 3 sigma, so that the bound shows; round ones do so along the axes.
        for row in scene.core.chunks_exact_mut(12) {
            row.copy_within(3..4, 4);
            row.copy_within(3..4, 5);
            row[10] = 6.0;
        }
        let free = scene.run(shape).image;
        scene.options.three_sigma = true;
        let (colour, _) = differences(&scene, shape);
        assert!(colour < 2e-5, "{shape:?}: {colour}");
        assert!(scene.run(shape).image != free, "{shape:?}: the bound shows");
    }
}

#[test]
fn many_opaque_layers_stop_before_the_transmittance_is_spent() {
    for shape in SHAPES {
        let mut scene = Scene::random(41, 300, 1, camera(33, 18), 6.0);
        for row in scene.core.chunks_exact_mut(12) {
            row[10] = 2.5;
        }
        let (colour, _) = differences(&scene, shape);
        assert!(colour < 3e-4, "{shape:?}: {colour}");
        assert!(scene.run(shape).image.iter().all(|pixel| pixel[3] >= 1e-4));
    }
}

#[test]
fn images_of_any_size_are_complete() {
    for shape in SHAPES {
        for (width, height) in [(1, 1), (3, 5), (16, 16), (17, 4), (4, 33), (65, 2)] {
            let view = View { fx: 20.0, fy: 20.0, ..camera(width, height) };
            let scene = Scene::random(51, 30, 0, view, 2.0);
            let (colour, _) = differences(&scene, shape);
            assert!(colour < 2e-5, "{shape:?} {width} x {height}: {colour}");
        }
    }
}

#[test]
fn no_gaussian_leaves_the_background() {
    for shape in SHAPES {
        let scene = Scene::random(61, 0, 1, camera(19, 7), 2.0);
        let rendered = scene.run(shape);
        assert!(rendered.image.iter().all(|pixel| *pixel == [0.2, 0.5, 0.9, 1.0]), "{:?}", rendered.image[0]);
    }
}
