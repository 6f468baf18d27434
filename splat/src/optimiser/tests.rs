use super::*;
use crate::{
    gpu::{AdapterChoice, Gpu, Shape},
    reference::adam,
};

fn open(shape: Shape) -> Gpu {
    Gpu::open(&AdapterChoice { shape: Some(shape), ..Default::default() }).expect("an adapter")
}

/// Values that vary in sign and over many magnitudes.
fn values(count: usize, phase: f64) -> Vec<f32> {
    (0..count).map(|i| ((i as f64 * 0.7 + phase).sin() * 10_f64.powf((i % 9) as f64 - 6.0)) as f32).collect()
}

/// Runs `steps` steps on the device; returns parameters and moments.
fn run(gpu: &Gpu, rows: u32, stride: u32, epsilon: f32, steps: u32, mask: Option<&[u32]>) -> [Vec<f32>; 3] {
    let floats = (rows * stride) as usize;
    let rates: Vec<f32> = (0..stride).map(|lane| 1e-3 * lane as f32).collect();
    let config = AdamConfig { epsilon, ..Default::default() };
    let adam = Adam::new(gpu);
    let parameters = gpu.storage_from("p", &values(floats, 0.3)).unwrap();
    let moments = [0, 1].map(|_| gpu.storage("moment", floats as u64 * 4).unwrap());
    let mask = mask.map(|mask| gpu.storage_from("mask", mask).unwrap());
    for step in 1..=steps {
        let gradients = gpu.storage_from("g", &values(floats, f64::from(step))).unwrap();
        let buffers = AdamBuffers {
            parameters: &parameters,
            gradients: &gradients,
            first_moment: &moments[0],
            second_moment: &moments[1],
            rows,
            stride,
            mask: mask.as_ref(),
        };
        let mut commands = gpu.commands();
        adam.step(&mut commands, &buffers, &rates, &config, step).unwrap();
        commands.submit();
    }
    [&parameters, &moments[0], &moments[1]].map(|buffer| gpu.download(buffer, floats).unwrap())
}

#[test]
fn both_shapes_follow_the_double_precision_twin() {
    for shape in [Shape::Cpu, Shape::Gpu] {
        let gpu = open(shape);
        for (rows, stride, epsilon) in [(1, 4, 1e-15), (1237, 12, 1e-8), (613, 48, 1e-15)] {
            let [parameters, ..] = run(&gpu, rows, stride, epsilon, 5, None);
            let floats = (rows * stride) as usize;
            let rates: Vec<f64> = (0..stride).map(|lane| f64::from(1e-3 * lane as f32)).collect();
            let config = AdamConfig { epsilon, ..Default::default() };
            let mut twin: Vec<f64> = values(floats, 0.3).into_iter().map(f64::from).collect();
            let (mut first, mut second) = (vec![0.0; floats], vec![0.0; floats]);
            for step in 1..=5 {
                let gradients: Vec<f64> = values(floats, f64::from(step)).into_iter().map(f64::from).collect();
                adam::step(&mut twin, &gradients, &mut first, &mut second, &rates, &config, step);
            }
            for (i, (parameter, expected)) in parameters.iter().zip(&twin).enumerate() {
                // A step is at most a few learning rates; the parameter itself is rounded to f32 at each of five steps.
                let tolerance = 1e-5 * rates[i % stride as usize] + 1e-6 * expected.abs();
                assert!((f64::from(*parameter) - expected).abs() <= tolerance, "{shape:?} {i}: {parameter} {expected}");
            }
        }
    }
}

#[test]
fn a_column_with_rate_zero_stays_and_moments_still_move() {
    let [parameters, first, _] = run(&open(Shape::Cpu), 9, 12, 1e-15, 2, None);
    let start = values(9 * 12, 0.3);
    for row in 0..9 {
        assert_eq!(parameters[row * 12], start[row * 12]);
        assert_ne!(parameters[row * 12 + 1], start[row * 12 + 1]);
        assert_ne!(first[row * 12], 0.0);
    }
}

#[test]
fn masked_rows_are_left_alone_and_the_others_move_as_without_a_mask() {
    for shape in [Shape::Cpu, Shape::Gpu] {
        let gpu = open(shape);
        let mask: Vec<u32> = (0..100).map(|row| u32::from(row % 3 == 0)).collect();
        let masked = run(&gpu, 100, 12, 1e-15, 3, Some(&mask));
        let dense = run(&gpu, 100, 12, 1e-15, 3, None);
        let start = [values(1200, 0.3), vec![0.0; 1200], vec![0.0; 1200]];
        for which in 0..3 {
            for (i, value) in masked[which].iter().enumerate() {
                let expected = if mask[i / 12] != 0 { dense[which][i] } else { start[which][i] };
                assert_eq!(*value, expected, "{shape:?} {which} {i}");
            }
        }
    }
}

#[test]
fn rows_that_do_not_fit_are_an_error_and_no_rows_are_none() {
    let gpu = open(Shape::Cpu);
    let adam = Adam::new(&gpu);
    let buffer = gpu.storage("x", 64).unwrap();
    let buffers = |rows, stride| AdamBuffers {
        parameters: &buffer,
        gradients: &buffer,
        first_moment: &buffer,
        second_moment: &buffer,
        rows,
        stride,
        mask: None,
    };
    let mut commands = gpu.commands();
    let config = AdamConfig::default();
    assert!(adam.step(&mut commands, &buffers(1, 6), &[0.1; 6], &config, 1).is_err());
    assert!(adam.step(&mut commands, &buffers(1, 8), &[0.1; 4], &config, 1).is_err());
    assert!(adam.step(&mut commands, &buffers(0, 4), &[0.1; 4], &config, 1).is_ok());
    commands.submit();
    gpu.wait("stepping nothing").unwrap();
}

#[test]
fn nan_and_infinity_are_counted_until_taken() {
    let gpu = open(Shape::Cpu);
    let check = FiniteCheck::new(&gpu).unwrap();
    let mut bad = values(100_000, 0.0);
    (bad[3], bad[77_777], bad[99_999]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
    let good = gpu.storage_from("good", &[f32::MAX, f32::MIN, 0.0, f32::MIN_POSITIVE]).unwrap();
    let bad = gpu.storage_from("bad", &bad).unwrap();
    let mut commands = gpu.commands();
    check.scan(&mut commands, &good, 4);
    check.scan(&mut commands, &bad, 100_000);
    check.scan(&mut commands, &bad, 99_999);
    commands.submit();
    assert_eq!(check.take(&gpu).unwrap(), 5);
    assert_eq!(check.take(&gpu).unwrap(), 0);
}
