//! Host and device against the twin.

use super::*;

const SHAPES: [Shape; 2] = [Shape::Cpu, Shape::Gpu];

fn heads(on: [bool; 5]) -> Heads {
    Heads { position: on[0], scale: on[1], rotation: on[2], opacity: on[3], sh: on[4] }
}

#[test]
fn a_pass_follows_the_twin_forward_and_backward() {
    let configurations = [
        (small(), 0.0, 300),
        (FieldConfig { levels: vec![1], depth: 1, ..small() }, 0.45, 9000),
        (FieldConfig { depth: 0, features: 8, sh_stride: 28, ..small() }, 0.3, 5),
        (FieldConfig { heads: heads([true, true, true, false, false]), features: 16, ..small() }, 0.62, 70),
        (FieldConfig { heads: heads([false, false, false, true, true]), sh_stride: 48, ..small() }, 1.0, 33),
        (FieldConfig { depth: 3, width: 48, features: 32, time_axis: TimeAxis::Full, ..small() }, 0.9, 129),
        (FieldConfig { levels: vec![1, 2, 3], features: 64, sh_stride: 4, ..small() }, 0.5, 2),
    ];
    let gpus = SHAPES.map(open);
    for (number, (config, t01, rows)) in configurations.iter().enumerate() {
        let core = core_rows(*rows);
        let means = means(&core);
        let d_deltas = twin_d_deltas(*rows, config.sh_stride as usize);
        // One twin for both: they start from the same numbers.
        let twin = twin_of(&gpus[0], &shaken(&gpus[0], config));
        for what in [Outputs::All, Outputs::PositionOnly] {
            let expected = twin.forward(&means, f64::from(*t01), what);
            let gradients = twin.backward(&means, f64::from(*t01), what, &d_deltas);
            for (gpu, shape) in gpus.iter().zip(SHAPES) {
                let label = format!("{shape:?} {number} {what:?}");
                let mut field = shaken(gpu, config);
                let found = pass(gpu, &mut field, &core, *t01, what);
                assert_close(&format!("{label} core"), &found.core, &expected.core, 2e-6);
                let with_sh = config.heads.sh && what == Outputs::All;
                assert_eq!(found.sh.is_some(), with_sh, "{label}");
                if let Some(sh) = &found.sh {
                    assert_close(&format!("{label} sh"), sh, &expected.sh, 2e-6);
                }
                assert_close(&format!("{label} gradient"), &found.gradients, &gradients.parameters, 2e-5);
                for (row, d_mean) in gradients.means.iter().enumerate() {
                    // The gradient is added to what is there, and to nothing but the means.
                    let expected: Vec<f64> = d_mean.iter().copied().chain([0.0; 9]).map(|d| 1.0 + d).collect();
                    assert_close(&format!("{label} row {row}"), &found.d_core[row * 12..][..12], &expected, 2e-5);
                }
            }
        }
    }
}

#[test]
fn activations_that_are_not_kept_are_evaluated_again_to_the_same_bits() {
    let gpu = open(Shape::Cpu);
    let mut field = shaken(&gpu, &small());
    let start = field.state(&gpu).unwrap();
    let core = core_rows(300);
    let kept = pass(&gpu, &mut field, &core, 0.6, Outputs::All);
    let mut host = Host::new(&gpu, field.layout(), vec![0.0; field.layout().total]);
    host.keep_at_most(1000);
    field.backend = Box::new(host);
    field.restore(&gpu, &start).unwrap();
    assert!(pass(&gpu, &mut field, &core, 0.6, Outputs::All) == kept);
}

#[test]
fn chunks_of_rows_add_up_to_the_whole_pass() {
    let gpu = open(Shape::Gpu);
    let mut field = shaken(&gpu, &small());
    let start = field.state(&gpu).unwrap();
    let core = core_rows(300);
    let whole = pass(&gpu, &mut field, &core, 0.6, Outputs::All);
    let mut device = Device::new(&gpu, field.layout(), &vec![0.0; field.layout().total]).unwrap();
    device.chunks_of(128);
    field.backend = Box::new(device);
    field.restore(&gpu, &start).unwrap();
    let chunks = pass(&gpu, &mut field, &core, 0.6, Outputs::All);
    assert!((&chunks.core, &chunks.sh, &chunks.d_core) == (&whole.core, &whole.sh, &whole.d_core));
    let whole: Vec<f64> = whole.gradients.into_iter().map(f64::from).collect();
    assert_close("gradients", &chunks.gradients, &whole, 1e-6);
}

#[test]
fn each_tensor_of_the_gradient_follows_the_twin_on_its_own_scale() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut field = shaken(&gpu, &small());
        let core = core_rows(200);
        let found = pass(&gpu, &mut field, &core, 0.4, Outputs::All);
        let gradients =
            twin_of(&gpu, &field).backward(&means(&core), f64::from(0.4_f32), Outputs::All, &twin_d_deltas(200, 12));
        for (name, offset, length) in field.layout().vectors() {
            let range = offset..offset + length;
            assert_close(
                &format!("{shape:?} {name}"),
                &found.gradients[range.clone()],
                &gradients.parameters[range],
                1e-4,
            );
        }
    }
}

#[test]
fn regularisers_follow_the_twin() {
    for shape in SHAPES {
        let gpu = open(shape);
        for form in [SpatialSmoothness::SecondDifference, SpatialSmoothness::TotalVariation] {
            let mut field = shaken(&gpu, &small());
            let weights = PlaneWeights { space: 0.7, time: 1.3, time_l1: 0.2, form };
            let found = field.regularise(&gpu, &weights).unwrap();
            let (expected, gradient) = twin_of(&gpu, &field).regularise(&weights);
            assert_close(&format!("{shape:?} {form:?}"), &field.gradients(&gpu).unwrap(), &gradient, 2e-5);
            let found = [found.space, found.time, found.time_l1];
            for (found, expected) in found.into_iter().zip([expected.space, expected.time, expected.time_l1]) {
                assert!((found - expected).abs() <= 1e-5 * expected, "{shape:?} {form:?}: {found} {expected}");
            }
        }
    }
}

#[test]
fn a_step_is_adam_with_a_rate_for_planes_and_one_for_the_mlp() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut field = shaken(&gpu, &small());
        let mut twin = twin_of(&gpu, &field);
        let (mut first, mut second) = (vec![0.0; twin.parameters.len()], vec![0.0; twin.parameters.len()]);
        let config = AdamConfig { epsilon: 1e-8, ..Default::default() };
        for step in 1..=3 {
            let found = pass(&gpu, &mut field, &core_rows(40), 0.2, Outputs::All);
            field.step(&gpu, 0.01, 0.002, &config).unwrap();
            let gradients: Vec<f64> = found.gradients.iter().copied().map(f64::from).collect();
            let rates: Vec<f64> =
                (0..twin.parameters.len()).map(|i| if i < field.layout().grid { 0.01 } else { 0.002 }).collect();
            crate::reference::adam::step(
                &mut twin.parameters,
                &gradients,
                &mut first,
                &mut second,
                &rates,
                &config,
                step,
            );
            assert_eq!(field.gradients(&gpu).unwrap(), vec![0.0; twin.parameters.len()]);
        }
        let found = twin_of(&gpu, &field).parameters;
        for (at, (found, expected)) in found.iter().zip(&twin.parameters).enumerate() {
            assert!((found - expected).abs() < 1e-6, "{shape:?} {at}: {found} {expected}");
        }
    }
}

#[test]
fn the_trajectory_loss_is_the_mean_distance_from_the_blend_and_adds_its_sign() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut field = shaken(&gpu, &small());
        let rows = 1500_u32;
        let core = gpu.storage_from("core", &core_rows(rows as usize)).unwrap();
        let [mut tape, mut before, mut after] = std::array::from_fn(|_| Tape::new(&gpu).unwrap());
        for (tape, t01) in [(&mut tape, 0.4), (&mut before, 0.1), (&mut after, 0.9)] {
            field.forward(&gpu, &core, rows, t01, tape, Outputs::PositionOnly).unwrap();
        }
        let d_deltas = Deltas::new(&gpu, "d", rows, None).unwrap();
        gpu.upload(&d_deltas.core, 0, &vec![0.5_f32; rows as usize * 12]);
        let blend = Blend { before: &before.deltas, after: &after.deltas, blend: 0.25 };
        let loss = field.trajectory_loss(&gpu, &tape, blend, 0.8, &d_deltas).unwrap();
        let [x, a, b, d] = [&tape.deltas.core, &before.deltas.core, &after.deltas.core, &d_deltas.core]
            .map(|buffer| gpu.download::<f32>(buffer, rows as usize * 12).unwrap());
        let mut expected = 0.0;
        let step = 0.8 / (3.0 * f64::from(rows));
        for i in 0..x.len() {
            let off = f64::from(x[i]) - 0.75 * f64::from(a[i]) - 0.25 * f64::from(b[i]);
            let moved = if i % 12 < 3 { off.signum() * step } else { 0.0 };
            expected += if i % 12 < 3 { off.abs() / (3.0 * f64::from(rows)) } else { 0.0 };
            assert!((f64::from(d[i]) - 0.5 - moved).abs() < 1e-7 || off.abs() < 1e-6, "{shape:?} {i}");
        }
        assert!((loss - expected).abs() < 1e-6 * expected, "{shape:?}: {loss} {expected}");
        // Against itself a pass has no loss and no gradient.
        let start = gpu.download::<f32>(&d_deltas.core, 12).unwrap();
        let own = Blend { before: &tape.deltas, after: &tape.deltas, blend: 0.0 };
        assert_eq!(field.trajectory_loss(&gpu, &tape, own, 0.8, &d_deltas).unwrap(), 0.0);
        assert_eq!(gpu.download::<f32>(&d_deltas.core, 12).unwrap(), start);
    }
}
