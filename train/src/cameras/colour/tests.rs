use super::*;
use crate::losses::{Exposure, LossSum, Losses, Part, Target, packed};
use erfgs_splat::gpu::{AdapterChoice, Shape};

const PIXELS: u32 = 1000;
const OPTIONS: CameraColourOptions = CameraColourOptions { enabled: true, from: 0.0, rate: [5e-3, 5e-4], prior: 0.01 };

fn gpus() -> [Gpu; 2] {
    [Shape::Cpu, Shape::Gpu]
        .map(|shape| Gpu::open(&AdapterChoice { shape: Some(shape), ..Default::default() }).expect("an adapter"))
}

fn scene() -> Vec<[f32; 4]> {
    let value = |i: u32| (i.wrapping_mul(2_654_435_761) >> 8 & 0xffff) as f32 / 65_535.0;
    (0..PIXELS)
        .map(|p| [0.8 * value(3 * p) + 0.1, 0.8 * value(3 * p + 1) + 0.1, 0.8 * value(3 * p + 2) + 0.1, 0.0])
        .collect()
}

/// What a camera of this gain and offset takes of the scene.
fn taken(scene: &[[f32; 4]], [gain, offset]: [[f32; 3]; 2]) -> Vec<u32> {
    let byte = |value: f32| (255.0 * value.clamp(0.0, 1.0)).round() as u32;
    scene.iter().map(|p| (0..3).fold(0, |packed, c| packed | byte(gain[c] * p[c] + offset[c]) << (8 * c))).collect()
}

/// Learns from one frame of each camera, in turn.
fn learn(gpu: &Gpu, frames: &[Vec<u32>], options: &CameraColourOptions, rounds: u32) -> CameraColourState {
    learn_of(gpu, frames, options, rounds, false)
}

/// The same, or from none of the pixels.
fn learn_of(
    gpu: &Gpu,
    frames: &[Vec<u32>],
    options: &CameraColourOptions,
    rounds: u32,
    none: bool,
) -> CameraColourState {
    let losses = Losses::new(gpu);
    // The last camera takes no frames.
    let takes: Vec<bool> = (0..=frames.len()).map(|view| view < frames.len()).collect();
    let mut colours = CameraColours::new(gpu, &CameraColourState::neutral(&takes), PIXELS).expect("buffers");
    let loss = LossSum::new(gpu, PIXELS).expect("a buffer");
    let mean = gpu.storage_from("scene", &scene()).expect("a buffer");
    let d_mean = gpu.storage("gradient", u64::from(PIXELS) * 16).expect("a buffer");
    let frames: Vec<Buffer> =
        frames.iter().map(|frame| gpu.storage_from("frame", &packed(frame)).expect("a buffer")).collect();
    let nowhere = gpu.storage("region", u64::from(PIXELS).div_ceil(8)).expect("a buffer");
    let part = if none { Part::Within(&nowhere) } else { Part::All };
    for round in 0..rounds {
        for (view, frame) in frames.iter().enumerate() {
            let mut commands = gpu.commands();
            let exposure = Exposure { pixels: PIXELS, mean: &mean, linear_light: false, view, colours: &colours };
            losses.photometric(gpu, &mut commands, &exposure, &Target { frame, part }, &d_mean, &loss, 1.0);
            colours.step(gpu, &mut commands, view, PIXELS, options, f64::from(round) / f64::from(rounds));
            commands.submit();
        }
    }
    colours.state(gpu).expect("the colours")
}

#[test]
fn gains_and_offsets_of_cameras_are_found() {
    let wanted = [[[1.0; 3], [0.0; 3]], [[0.9, 1.05, 1.1], [0.02, -0.03, 0.0]], [[1.1, 0.95, 0.9], [-0.02, 0.03, 0.0]]];
    let frames = wanted.map(|shown| taken(&scene(), shown));
    for gpu in gpus() {
        let found = learn(&gpu, &frames, &OPTIONS, 300);
        assert_eq!(found.steps, [300, 300, 300, 0]);
        assert_eq!(found.of(3), [[1.0; 3], [0.0; 3]], "who takes no frames");
        for (camera, wanted) in wanted.iter().enumerate() {
            for (found, wanted) in found.of(camera).as_flattened().iter().zip(wanted.as_flattened()) {
                assert!((found - wanted).abs() < 8e-3, "camera {camera}: {found} against {wanted}");
            }
        }
    }
}

#[test]
fn what_all_cameras_have_in_common_is_left_to_the_scene() {
    let frames = [taken(&scene(), [[1.3; 3], [0.05; 3]]), taken(&scene(), [[1.1; 3], [0.03; 3]])];
    for gpu in gpus() {
        let found = learn(&gpu, &frames, &OPTIONS, 200);
        for (one, other) in std::iter::zip(found.of(0).as_flattened(), found.of(1).as_flattened()) {
            let neutral = if *one > 0.5 { 2.0 } else { 0.0 };
            assert!((one + other - neutral).abs() < 1e-5, "{one} and {other}");
        }
        assert!(found.of(0)[0].iter().all(|&gain| gain > 1.0), "{:?}", found.of(0));
    }
}

#[test]
fn a_camera_whose_frames_say_nothing_stays_as_it_was() {
    let frames = [taken(&scene(), [[0.5; 3], [0.2; 3]]), taken(&scene(), [[1.0; 3], [0.0; 3]])];
    for gpu in gpus() {
        let found = learn_of(&gpu, &frames, &OPTIONS, 20, true);
        assert_eq!([found.of(0), found.of(1)], [[[1.0; 3], [0.0; 3]]; 2]);
    }
}

/// Adam on |gain x + offset - y| with the prior, in f64.
#[test]
fn a_step_is_the_twins() {
    let frames = [taken(&scene(), [[1.0; 3], [0.0; 3]]), taken(&scene(), [[0.8, 1.1, 1.2], [0.05, 0.0, -0.02]])];
    let options = CameraColourOptions { prior: 0.3, ..OPTIONS };
    let rounds = 12;
    let [mut value, mut m, mut v] = [[[[0.0_f64; 3]; 2]; 2]; 3];
    value.iter_mut().for_each(|of| of[0] = [1.0; 3]);
    let neutral = [1.0, 0.0];
    for round in 0..rounds {
        let rate = f64::from(decayed(options.rate, f64::from(round) / f64::from(rounds)));
        for camera in 0..2 {
            let mut gradient = [[0.0_f64; 3]; 2];
            for (pixel, &packed) in scene().iter().zip(&frames[camera]) {
                for c in 0..3 {
                    let x = f64::from(pixel[c]);
                    let [gain, offset] = value[camera];
                    let error = gain[c] * x + offset[c] - f64::from(packed >> (8 * c) & 255) / 255.0;
                    gradient[0][c] += error.signum() * x / f64::from(3 * PIXELS);
                    gradient[1][c] += error.signum() / f64::from(3 * PIXELS);
                }
            }
            let [beta1, beta2] = [ADAM.beta1, ADAM.beta2].map(f64::from);
            for (part, c) in (0..2).flat_map(|part| (0..3).map(move |c| (part, c))) {
                let g = gradient[part][c] + 2.0 * f64::from(options.prior) * (value[camera][part][c] - neutral[part]);
                let (m, v) = (&mut m[camera][part][c], &mut v[camera][part][c]);
                *m = beta1 * *m + (1.0 - beta1) * g;
                *v = beta2 * *v + (1.0 - beta2) * g * g;
                let (m, v) = (*m / (1.0 - beta1.powi(round as i32 + 1)), *v / (1.0 - beta2.powi(round as i32 + 1)));
                value[camera][part][c] -= rate * m / (v.sqrt() + 1e-15);
                let astray = 0.5 * (value[0][part][c] + value[1][part][c]) - neutral[part];
                value.iter_mut().for_each(|of| of[part][c] -= astray);
            }
        }
    }
    for gpu in gpus() {
        let found = learn(&gpu, &frames, &options, rounds);
        for (camera, twin) in value.iter().enumerate() {
            for (found, twin) in found.of(camera).as_flattened().iter().zip(twin.as_flattened()) {
                assert!((f64::from(*found) - twin).abs() < 1e-5, "camera {camera}: {found} against {twin}");
            }
        }
    }
}
