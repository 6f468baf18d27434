use super::*;
use crate::losses::level::{FIRST, Levels};

/// Loss, gradient and levels after one rendering.
fn run(
    gpu: &Gpu,
    image: &[[f32; 4]],
    count: &[f32],
    levels: &[f32],
    sensor: &Sensor,
) -> (f64, Vec<[f32; 4]>, Vec<f32>) {
    let losses = Losses::new(gpu);
    let loss = LossSum::new(gpu, PIXELS).expect("a buffer");
    let image = gpu.storage_from("image", image).expect("a buffer");
    let count = gpu.storage_from("count", count).expect("a buffer");
    let levels = Levels::restore(gpu, levels).expect("a buffer");
    let d_image = gpu.storage("gradient", u64::from(PIXELS) * 16).expect("a buffer");
    let mut commands = gpu.commands();
    losses.event_level(gpu, &mut commands, &image, &count, &levels, &d_image, &loss, 1.0, sensor);
    commands.submit();
    let gradient = gpu.download(&d_image, PIXELS as usize).expect("a gradient");
    (loss.take(gpu).expect("a sum"), gradient, levels.read(gpu).expect("levels"))
}

#[test]
fn the_loss_against_levels_its_gradient_and_the_levels_match_the_twin() {
    for gpu in gpus() {
        for (threshold, linear_light) in [(0.2, false), (0.25, true)] {
            let sensor = Sensor { threshold, lin_log: 20.0, linear_light };
            let colours = image(4);
            let count: Vec<f32> = (0..PIXELS).map(|p| (p % 9) as f32 - 4.0).collect();
            // Half of the pixels are new.
            let levels: Vec<f32> =
                (0..PIXELS).flat_map(|p| [20.0 + (p % 7) as f32, (p % 2 * 2 * FIRST) as f32]).collect();
            let (loss, gradient, moved) = run(&gpu, &colours, &count, &levels, &sensor);
            let colours = to_f64(&colours);
            let at = |pixel: usize, colour: &[f64; 3]| {
                let before = [f64::from(levels[2 * pixel]), f64::from(levels[2 * pixel + 1])];
                twin::event_level(colour, count[pixel].into(), before, &sensor)
            };
            let cost = |pixel: usize| twin::event_cost(&colours[pixel], &sensor);
            let of_all = (0..PIXELS as usize).map(|pixel| cost(pixel) * at(pixel, &colours[pixel]).0).sum();
            assert_close(loss, of_all, "loss");
            for pixel in 0..PIXELS as usize {
                assert_close(moved[2 * pixel].into(), at(pixel, &colours[pixel]).1, "level");
                assert_eq!(moved[2 * pixel + 1], levels[2 * pixel + 1] + 1.0, "one rendering more");
                for channel in 0..3 {
                    let want = difference(|step| {
                        let mut colour = colours[pixel];
                        colour[channel] += step;
                        // What an error costs is taken as given.
                        cost(pixel) * at(pixel, &colour).0
                    });
                    assert_close(gradient[pixel][channel].into(), want, "gradient");
                }
            }
        }
    }
}

#[test]
fn a_level_is_that_of_what_is_seen_most_of_the_time_and_tells_when_something_passes() {
    let [gpu, _] = gpus();
    let sensor = Sensor { threshold: 0.2, lin_log: 20.0, linear_light: false };
    let grey = |value: f32| vec![[value, value, value, 0.0]; PIXELS as usize];
    let (wall, thing) = (0.4_f32, 0.8_f32);
    let events = ((thing / wall).ln() / 0.2).round();
    let mut levels = vec![0.0; 2 * PIXELS as usize];
    // The thing is there a quarter of the time, and the scene knows of it in the first renderings only half of that.
    for time in 0..60 {
        let passes = time % 4 == 3;
        let known = passes && time % 8 == 3;
        let count = vec![if passes { events } else { 0.0 }; PIXELS as usize];
        levels = run(&gpu, &grey(if known { thing } else { wall }), &count, &levels, &sensor).2;
    }
    let expected = (255.0 * wall).ln() / 0.2;
    assert!((levels[0] - expected).abs() < 0.5, "{} instead of {expected}", levels[0]);
    let counts = vec![events; PIXELS as usize];
    let (loss, gradient, _) = run(&gpu, &grey(wall), &counts, &levels, &sensor);
    assert!(loss > 2.0 * f64::from(PIXELS) && gradient[3][1] < 0.0, "descending brightens what passes: {loss}");
    let (loss, gradient, _) = run(&gpu, &grey(thing), &counts, &levels, &sensor);
    assert!(loss < 0.3 * f64::from(PIXELS) && gradient[3][1].abs() < 1e-6, "what is there costs nothing: {loss}");
}

#[test]
fn an_error_costs_as_much_as_it_is_seen() {
    let [gpu, _] = gpus();
    for linear_light in [false, true] {
        let sensor = Sensor { threshold: 0.2, lin_log: 5.0, linear_light };
        // All renderings are too dark by far; how the picture is asked to change does not depend on how dark they are.
        let pulls = [0.1_f32, 0.3, 0.5, 0.9].map(|grey| {
            let levels: Vec<f32> = (0..PIXELS).flat_map(|_| [1000.0, 100.0]).collect();
            let image = vec![[grey, grey, grey, 0.0]; PIXELS as usize];
            let (_, gradient, _) = run(&gpu, &image, &vec![0.0; PIXELS as usize], &levels, &sensor);
            gradient[0].iter().sum::<f32>()
        });
        assert!(pulls.iter().all(|pull| (pull / pulls[0] - 1.0).abs() < 1e-3 && *pull < 0.0), "{pulls:?}");
    }
}

#[test]
fn black_odd_and_left_out_pixels_leave_levels_finite() {
    let [gpu, _] = gpus();
    let sensor = Sensor { threshold: 0.01, lin_log: 20.0, linear_light: true };
    let levels: Vec<f32> = (0..PIXELS).flat_map(|_| [3.0, 100.0]).collect();
    let mut count = vec![1e6; PIXELS as usize];
    count[7] = LEFT_OUT;
    let (loss, gradient, moved) = run(&gpu, &vec![[0.0; 4]; PIXELS as usize], &count, &levels, &sensor);
    assert!(loss.is_finite() && moved.iter().chain(gradient.iter().flatten()).all(|value| value.is_finite()));
    assert_eq!((gradient[7], &moved[14..16]), ([0.0; 4], &[3.0, 100.0][..]));
}
