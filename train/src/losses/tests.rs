use super::*;
use crate::{cameras::colour::CameraColourState, config::Config, reference::losses as twin};
use erfgs_splat::gpu::{AdapterChoice, Shape};

mod colour;
mod level;

const PIXELS: u32 = 150;

fn image(seed: u32) -> Vec<[f32; 4]> {
    let value = |i: u32| ((i.wrapping_mul(2_654_435_761).wrapping_add(seed * 977)) >> 8 & 0xffff) as f32 / 65_535.0;
    (0..PIXELS).map(|p| [value(p * 3), value(p * 3 + 1), value(p * 3 + 2), 0.3]).collect()
}

fn to_f64(image: &[[f32; 4]]) -> Vec<[f64; 3]> {
    image.iter().map(|p| [p[0].into(), p[1].into(), p[2].into()]).collect()
}

fn gpus() -> [Gpu; 2] {
    [Shape::Cpu, Shape::Gpu]
        .map(|shape| Gpu::open(&AdapterChoice { shape: Some(shape), ..Default::default() }).expect("an adapter"))
}

/// Within what a driver may err in `log` and `pow` (WGSL allows 3 ULP of an intermediate, lavapipe uses it).
fn assert_close(got: f64, want: f64, what: &str) {
    assert!((got - want).abs() <= 2e-3 * want.abs().max(0.1), "{what}: {got} against {want}");
}

/// The derivative of `loss` with respect to one channel of one pixel, by central differences.
fn difference(mut loss: impl FnMut(f64) -> f64) -> f64 {
    let step = 1e-6;
    (loss(step) - loss(-step)) / (2.0 * step)
}

#[test]
fn the_lin_log_of_a_sensor_is_the_twins() {
    for (lin_log, linear_light) in [(20.0, false), (20.0, true), (5.0, true)] {
        let sensor = Sensor { threshold: 0.2, lin_log, linear_light };
        for pixel in image(5).iter().flat_map(|p| [[p[0], p[1], p[2]], [p[0] * 0.02, p[1] * 0.02, p[2] * 0.02]]) {
            let (got, want) = (f64::from(sensor.lin_log(&pixel)), twin::lin_log(&pixel.map(f64::from), &sensor));
            assert!((got - want).abs() <= 2e-6 * want.abs().max(1.0), "{pixel:?}: {got} against {want}");
        }
    }
}

#[test]
fn the_photometric_loss_and_its_gradients_match_the_twin() {
    for gpu in gpus() {
        let bits: Vec<u32> = (1..=PIXELS.div_ceil(32)).map(|word| word.wrapping_mul(0x9e37_79b9)).collect();
        let bits = gpu.storage_from("region", &bits).expect("a buffer");
        for part in [Part::All, Part::Within(&bits), Part::Outside(&bits)] {
            for linear_light in [false, true] {
                check_photometric(&gpu, part, linear_light);
            }
        }
    }
}

#[test]
fn frames_are_packed_without_gaps() {
    assert_eq!(packed(&[0xff03_0201, 0x0006_0504, 7]), [1, 2, 3, 4, 5, 6, 7, 0, 0, 0, 0, 0]);
    assert_eq!((packed(&[]), packed(&[0x0003_0201; 4])), (vec![], [1, 2, 3].repeat(4)));
}

fn check_photometric(gpu: &Gpu, part: Part<'_>, linear_light: bool) {
    let losses = Losses::new(gpu);
    let renderings = [image(1), image(2), image(3)];
    let frame: Vec<u32> = (0..PIXELS).map(|p| 0xff00_0000 | p.wrapping_mul(0x0001_2345) & 0x00ff_ffff).collect();
    let bits: Vec<u32> = match part {
        Part::All => vec![u32::MAX; PIXELS.div_ceil(32) as usize],
        Part::Within(bits) | Part::Outside(bits) => gpu.download(bits, PIXELS.div_ceil(32) as usize).expect("bits"),
    };
    let is_left_out =
        |pixel: u32| (bits[pixel as usize / 32] >> (pixel % 32) & 1 == 0) != matches!(part, Part::Outside(_));
    let left_out = (0..PIXELS).filter(|&pixel| is_left_out(pixel)).count();
    assert!(if matches!(part, Part::All) { left_out == 0 } else { (20..130).contains(&left_out) }, "{left_out}");
    let truth: Vec<Option<[f64; 3]>> = (0..)
        .zip(&frame)
        .map(|(pixel, v)| (!is_left_out(pixel)).then(|| [0, 8, 16].map(|shift| f64::from(v >> shift & 255) / 255.0)))
        .collect();
    let mut state = CameraColourState::neutral(&[true; 3]);
    state.values[8..16].copy_from_slice(&[1.25, 0.9, 1.0, 0.0, 0.03, -0.02, 0.0, 0.0]);
    let colours = CameraColours::new(gpu, &state, PIXELS).expect("buffers");
    let loss = LossSum::new(gpu, PIXELS).expect("a buffer");
    let buffers = renderings.each_ref().map(|image| gpu.storage_from("image", image).expect("a buffer"));
    let new = || gpu.storage("scratch", u64::from(PIXELS) * 16).expect("a buffer");
    let (mean, d_mean, d_image) = (new(), new(), new());
    let frame = gpu.storage_from("frame", &packed(&frame)).expect("a buffer");
    let mut commands = gpu.commands();
    for (index, image) in buffers.iter().enumerate() {
        losses.accumulate(gpu, &mut commands, PIXELS, image, &mean, index == 0, 1.0 / 3.0, linear_light);
    }
    let exposure = Exposure { pixels: PIXELS, mean: &mean, linear_light, view: 1, colours: &colours };
    losses.photometric(gpu, &mut commands, &exposure, &Target { frame: &frame, part }, &d_mean, &loss, 1.0);
    losses.spread(gpu, &mut commands, PIXELS, &buffers[1], &d_mean, &d_image, 1.0 / 3.0);
    commands.submit();

    let images = renderings.each_ref().map(|image| to_f64(image));
    let shown = state.of(1).map(|of| of.map(f64::from));
    assert_close(loss.take(gpu).expect("a sum"), twin::photometric(&images, shown, &truth, linear_light), "loss");
    assert_eq!(loss.take(gpu).expect("a sum"), 0.0, "taking starts anew");
    let gradient: Vec<[f32; 4]> =
        gpu.download(if linear_light { &d_image } else { &d_mean }, PIXELS as usize).expect("a gradient");
    let share = if linear_light { 1.0 } else { 1.0 / 3.0 };
    for pixel in (0..PIXELS as usize).step_by(7) {
        for channel in 0..3 {
            let want = difference(|step| {
                let mut images = images.clone();
                images[1][pixel][channel] += step;
                twin::photometric(&images, shown, &truth, linear_light)
            });
            assert_close(share * f64::from(gradient[pixel][channel]), want, "gradient");
        }
    }
    let partial: Vec<[f32; 4]> =
        gpu.download(&colours.partial, 2 * threads_for(PIXELS) as usize).expect("the threads' gradients");
    for (part, channel) in (0..2).flat_map(|part| (0..3).map(move |channel| (part, channel))) {
        let got: f64 = partial.iter().skip(part).step_by(2).map(|sum| f64::from(sum[channel])).sum();
        let want = difference(|step| {
            let mut shown = shown;
            shown[part][channel] += step;
            twin::photometric(&images, shown, &truth, linear_light)
        });
        assert_close(got, want, "gradient of the camera's colour");
    }
}

#[test]
fn the_event_loss_and_its_gradient_match_the_twin() {
    for gpu in gpus() {
        for quantise in [Quantise::None, Quantise::DeadZone] {
            for norm in [Norm::L1, Norm::L2] {
                for linear_light in [false, true] {
                    let config = EarlConfig { quantise, norm, ..Config::default().earl };
                    check_event_loss(&gpu, &config, linear_light);
                }
            }
        }
    }
}

fn check_event_loss(gpu: &Gpu, config: &EarlConfig, linear_light: bool) {
    let sensor = Sensor { threshold: 0.2, lin_log: 20.0, linear_light };
    let (before, after) = (image(4), image(5));
    let count: Vec<f32> = (0..PIXELS).map(|p| (p % 9) as f32 - 4.0).collect();
    let run = event_loss(gpu, &before, &after, &count, &sensor, config);
    let counts: Vec<f64> = count.iter().map(|&e| e.into()).collect();
    let (before, after) = (to_f64(&before), to_f64(&after));
    assert_close(run.0, twin::event(&before, &after, &counts, &sensor, config), "loss");
    for pixel in (0..PIXELS as usize).step_by(5) {
        for channel in 0..3 {
            let d_before = difference(|step| {
                let mut moved = before.clone();
                moved[pixel][channel] += step;
                twin::event(&moved, &after, &counts, &sensor, config)
            });
            let d_after = difference(|step| {
                let mut moved = after.clone();
                moved[pixel][channel] += step;
                twin::event(&before, &moved, &counts, &sensor, config)
            });
            assert_close(run.1[pixel][channel].into(), d_before, "gradient before");
            assert_close(run.2[pixel][channel].into(), d_after, "gradient after");
        }
    }
}

type Run = (f64, Vec<[f32; 4]>, Vec<[f32; 4]>);

fn event_loss(
    gpu: &Gpu,
    before: &[[f32; 4]],
    after: &[[f32; 4]],
    count: &[f32],
    sensor: &Sensor,
    config: &EarlConfig,
) -> Run {
    let losses = Losses::new(gpu);
    let pixels = before.len() as u32;
    let loss = LossSum::new(gpu, pixels).expect("a buffer");
    let before = gpu.storage_from("before", before).expect("a buffer");
    let after = gpu.storage_from("after", after).expect("a buffer");
    let count = gpu.storage_from("count", count).expect("a buffer");
    let new = || gpu.storage("gradient", u64::from(pixels) * 16).expect("a buffer");
    let (d_before, d_after) = (new(), new());
    let mut commands = gpu.commands();
    losses.event(gpu, &mut commands, pixels, &before, &after, &count, &d_before, &d_after, &loss, 1.0, sensor, config);
    commands.submit();
    let gradients = [&d_before, &d_after].map(|buffer| gpu.download(buffer, pixels as usize).expect("a gradient"));
    let [d_before, d_after] = gradients;
    (loss.take(gpu).expect("a sum"), d_before, d_after)
}

#[test]
fn truncation_passes_the_gradient_straight_through_where_the_count_is_wrong() {
    let [gpu, _] = gpus();
    let config = Config::preset(crate::config::Method::ErfGs, crate::config::Preset::Paper).earl;
    let sensor = Sensor { threshold: 0.2, lin_log: 20.0, linear_light: false };
    // From grey 100 to grey 150 of 255 is ln 1.5 / 0.2 = 2.03 thresholds.
    let (before, after) = (vec![[100.0 / 255.0, 100.0 / 255.0, 100.0 / 255.0, 0.0]; 2], vec![[150.0 / 255.0; 4]; 2]);
    let (loss, d_before, d_after) = event_loss(&gpu, &before, &after, &[2.0, 3.0], &sensor, &config);
    assert_close(loss, 1.0 / 3.0, "one event short, of three");
    assert_eq!(d_before[0], [0.0; 4], "the right count leaves nothing to pull at");
    assert!(
        d_after[1][1] < 0.0 && d_before[1][1] > 0.0,
        "descending brightens the later image and darkens the earlier"
    );
}

#[test]
fn black_pixels_and_empty_event_frames_stay_finite() {
    let [gpu, _] = gpus();
    let sensor = Sensor { threshold: 0.2, lin_log: 20.0, linear_light: false };
    let black = vec![[0.0; 4]; 3];
    let (loss, d_before, d_after) =
        event_loss(&gpu, &black, &black, &[0.0, 50.0, -50.0], &sensor, &Config::default().earl);
    assert!(loss.is_finite());
    assert!(d_before.iter().chain(&d_after).flatten().all(|value| value.is_finite()));
}

#[test]
fn pixels_that_are_left_out_cost_nothing_and_pull_at_nothing() {
    let [gpu, _] = gpus();
    let sensor = Sensor { threshold: 0.2, lin_log: 20.0, linear_light: false };
    let (before, after) = (image(1), image(2));
    let count = vec![LEFT_OUT; PIXELS as usize];
    let (loss, d_before, d_after) = event_loss(&gpu, &before, &after, &count, &sensor, &Config::default().earl);
    assert_eq!(loss, 0.0);
    assert!(d_before.iter().chain(&d_after).flatten().all(|&value| value == 0.0));
}
