//! Initial values, determinism, saved states and extreme inputs.

use super::*;

const SHAPES: [Shape; 2] = [Shape::Cpu, Shape::Gpu];

/// A short training on noise; returns the final state.
fn train(gpu: &Gpu, rows: usize) -> FieldState {
    let mut field = Field::new(gpu, &small(), BOX, 9).unwrap();
    for step in 0..3 {
        pass(gpu, &mut field, &core_rows(rows), 0.3 * step as f32, Outputs::All);
        pass(gpu, &mut field, &core_rows(rows), 0.9, Outputs::PositionOnly);
        field.regularise(gpu, &PlaneWeights { space: 0.1, time: 0.1, time_l1: 0.1, ..Default::default() }).unwrap();
        field.step(gpu, 0.01, 0.01, &AdamConfig::default()).unwrap();
    }
    field.state(gpu).unwrap()
}

#[test]
fn training_twice_gives_identical_bits() {
    for shape in SHAPES {
        let gpu = open(shape);
        assert!(train(&gpu, 700) == train(&gpu, 700), "{shape:?}");
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| train(&open(Shape::Cpu), 9000))
    };
    assert!(on(1) == on(3));
}

#[test]
fn a_restored_field_goes_on_as_if_nothing_had_happened() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut field = Field::new(&gpu, &small(), BOX, 1).unwrap();
        let go_on = |field: &mut Field| {
            pass(&gpu, field, &core_rows(50), 0.7, Outputs::All);
            field.step(&gpu, 0.01, 0.01, &AdamConfig::default()).unwrap();
        };
        go_on(&mut field);
        go_on(&mut field);
        let saved = field.state(&gpu).unwrap();
        assert_eq!(saved.step, 2);
        let mut other = Field::new(&gpu, &small(), BOX, 2).unwrap();
        go_on(&mut other);
        other.restore(&gpu, &saved).unwrap();
        assert!(other.state(&gpu).unwrap() == saved, "{shape:?}");
        go_on(&mut field);
        go_on(&mut other);
        assert!(other.state(&gpu).unwrap() == field.state(&gpu).unwrap(), "{shape:?}");
    }
}

#[test]
fn a_state_of_another_configuration_is_refused() {
    let gpu = open(Shape::Cpu);
    let mut field = Field::new(&gpu, &small(), BOX, 1).unwrap();
    let other = Field::new(&gpu, &FieldConfig { width: 32, ..small() }, BOX, 1).unwrap();
    assert!(matches!(field.restore(&gpu, &other.state(&gpu).unwrap()), Err(FieldError::State { .. })));
    let mut renamed = field.state(&gpu).unwrap();
    renamed.vectors[4].name.push('x');
    assert!(matches!(field.restore(&gpu, &renamed), Err(FieldError::State { .. })));
    renamed.vectors.pop();
    assert!(matches!(field.restore(&gpu, &renamed), Err(FieldError::State { .. })));
}

#[test]
fn initial_values_are_those_of_4dgs() {
    let layout = Layout::new(&FieldConfig::default()).unwrap();
    let values = layout.initial(0);
    assert_eq!((layout.grid, layout.total - layout.grid), (2_365_440, 94_395));
    for plane in &layout.planes {
        let values = &values[plane.offset..plane.offset + plane.rows * plane.cols * 16];
        if plane.is_time() {
            assert!(values.iter().all(|value| *value == 1.0));
            continue;
        }
        let mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64;
        assert!(values.iter().all(|value| (0.1..=0.5).contains(value)) && (mean - 0.3).abs() < 0.003, "{mean}");
    }
    for (name, offset, length) in layout.vectors().into_iter().filter(|(name, ..)| !name.starts_with("grid")) {
        let values = &values[offset..offset + length];
        let outputs = match name.as_str() {
            "head.position.1.weight" | "head.scale.1.weight" => 3.0,
            "head.rotation.1.weight" => 4.0,
            "head.opacity.1.weight" => 1.0,
            "head.sh.1.weight" => 48.0,
            _ => 128.0,
        };
        let inputs = if name.starts_with("trunk") { 32.0 } else { 128.0 };
        let bound = if name.ends_with("bias") { 1.0 / f32::sqrt(inputs) } else { (6.0 / (inputs + outputs)).sqrt() };
        let largest = values.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
        assert!(largest <= bound && (length < 20 || largest > 0.9 * bound), "{name}: {largest} {bound}");
    }
    assert_ne!(values, layout.initial(1));
}

#[test]
fn depth_zero_and_one_are_the_same() {
    let of = |depth| Layout::new(&FieldConfig { depth, ..small() }).unwrap();
    assert_eq!(of(0).vectors(), of(1).vectors());
    assert_eq!(of(0).initial(3), of(1).initial(3));
}

#[test]
fn heads_that_start_at_zero_deform_nothing() {
    for shape in SHAPES {
        let gpu = open(shape);
        let config = FieldConfig { head_init: HeadInit::ZeroLast, ..small() };
        let mut field = Field::new(&gpu, &config, BOX, 1).unwrap();
        let found = pass(&gpu, &mut field, &core_rows(10), 0.5, Outputs::All);
        assert!(found.core.iter().chain(found.sh.iter().flatten()).all(|value| *value == 0.0));
        assert!(found.gradients.iter().any(|value| *value != 0.0));
    }
}

#[test]
fn the_time_axis_uses_its_upper_half_or_all_of_it_and_clamps() {
    let row = |time_axis, t01| {
        Layout::new(&FieldConfig { time_axis, time_resolution: 151, ..small() }).unwrap().time_row(t01)
    };
    assert_eq!(row(TimeAxis::UpperHalf, 0.0), (75, 0.0));
    assert_eq!(row(TimeAxis::UpperHalf, 1.0), (149, 1.0));
    assert_eq!(row(TimeAxis::Full, 0.0), (0, 0.0));
    assert_eq!(row(TimeAxis::Full, 0.5), (75, 0.0));
    for (time_axis, t01, clamped) in [
        (TimeAxis::Full, -3.0, 0.0),
        (TimeAxis::Full, 7.0, 1.0),
        (TimeAxis::UpperHalf, f32::NAN, 0.0),
        (TimeAxis::UpperHalf, f32::INFINITY, 1.0),
    ] {
        assert_eq!(row(time_axis, t01), row(time_axis, clamped));
    }
}

#[test]
fn passes_that_overlap_add_up() {
    for shape in SHAPES {
        let gpu = open(shape);
        let gradients_of = |times: &[f32]| {
            let mut field = shaken(&gpu, &small());
            let core = gpu.storage_from("core", &core_rows(60)).unwrap();
            let d_core = gpu.storage("d core", 60 * 48).unwrap();
            let mut tapes: Vec<_> = times.iter().map(|_| Tape::new(&gpu).unwrap()).collect();
            for (tape, t01) in tapes.iter_mut().zip(times) {
                field.forward(&gpu, &core, 60, *t01, tape, Outputs::All).unwrap();
            }
            let d = Deltas::new(&gpu, "d", 60, Some(12)).unwrap();
            gpu.upload(&d.core, 0, &noise(1, 720));
            for tape in &tapes {
                field.backward(&gpu, tape, &d, &d_core).unwrap();
            }
            (field.gradients(&gpu).unwrap(), gpu.download::<f32>(&d_core, 720).unwrap())
        };
        let (both, one, two) = (gradients_of(&[0.2, 0.7]), gradients_of(&[0.2]), gradients_of(&[0.7]));
        let sum = |a: &[f32], b: &[f32]| -> Vec<f64> {
            a.iter().zip(b).map(|(a, b)| f64::from(*a) + f64::from(*b)).collect()
        };
        assert_close("gradients", &both.0, &sum(&one.0, &two.0), 1e-6);
        assert_close("means", &both.1, &sum(&one.1, &two.1), 1e-6);
    }
}

#[test]
fn no_rows_and_one_row_are_fine() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut field = shaken(&gpu, &small());
        assert!(pass(&gpu, &mut field, &[], 0.5, Outputs::All).gradients.iter().all(|value| *value == 0.0));
        let one = pass(&gpu, &mut field, &core_rows(1), 0.5, Outputs::All);
        assert!(one.gradients.iter().all(|value| value.is_finite()) && one.core.iter().any(|value| *value != 0.0));
    }
}

#[test]
fn means_that_are_far_away_or_not_numbers_give_finite_deltas() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut field = shaken(&gpu, &small());
        let mut core = core_rows(6);
        (core[0], core[13], core[26]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
        (core[36], core[48]) = (1e30, -1e30);
        let found = pass(&gpu, &mut field, &core, f32::NAN, Outputs::All);
        let all = found.core.iter().chain(found.sh.iter().flatten()).chain(&found.gradients).chain(&found.d_core);
        assert!(all.into_iter().all(|value| value.is_finite()), "{shape:?}");
        field.step(&gpu, 0.01, 0.01, &AdamConfig::default()).unwrap();
    }
}

#[test]
fn a_flat_box_is_fine_and_one_that_is_none_is_refused() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut flat = Field::new(&gpu, &small(), [[0.0; 3], [1.0, 0.0, 1.0]], 1).unwrap();
        let found = pass(&gpu, &mut flat, &core_rows(5), 0.5, Outputs::All);
        assert!(found.core.iter().chain(&found.d_core).all(|value| value.is_finite()));
        for corner in [f32::NAN, -1.0, f32::INFINITY] {
            let refused = Field::new(&gpu, &small(), [[0.0; 3], [1.0, corner, 1.0]], 1);
            assert!(matches!(refused, Err(FieldError::Config { .. })));
        }
    }
}

#[test]
fn a_gradient_that_is_not_finite_stops_the_step_and_leaves_the_parameters() {
    for shape in SHAPES {
        let gpu = open(shape);
        let mut field = shaken(&gpu, &small());
        let before = field.state(&gpu).unwrap();
        let core = gpu.storage_from("core", &core_rows(3)).unwrap();
        let mut tape = Tape::new(&gpu).unwrap();
        field.forward(&gpu, &core, 3, 0.5, &mut tape, Outputs::All).unwrap();
        let d = Deltas::new(&gpu, "d", 3, Some(12)).unwrap();
        gpu.upload(&d.core, 0, &[f32::NAN]);
        field.backward(&gpu, &tape, &d, &gpu.storage("d core", 144).unwrap()).unwrap();
        let stepped = field.step(&gpu, 0.01, 0.01, &AdamConfig::default());
        assert!(matches!(stepped, Err(FieldError::Diverged { count: 1.., .. })), "{shape:?}");
        assert!(field.state(&gpu).unwrap() == before, "{shape:?}");
    }
}

#[test]
fn gradients_beyond_the_range_of_the_fixed_point_sums_stop_the_step() {
    let gpu = open(Shape::Gpu);
    let mut field = shaken(&gpu, &small());
    let core = gpu.storage_from("core", &core_rows(3)).unwrap();
    let mut tape = Tape::new(&gpu).unwrap();
    field.forward(&gpu, &core, 3, 0.5, &mut tape, Outputs::PositionOnly).unwrap();
    let d = Deltas::new(&gpu, "d", 3, None).unwrap();
    gpu.upload(&d.core, 0, &[1e15_f32; 36]);
    field.backward(&gpu, &tape, &d, &gpu.storage("d core", 144).unwrap()).unwrap();
    assert!(field.gradients(&gpu).unwrap().iter().all(|value| value.is_finite()));
    let stepped = field.step(&gpu, 0.01, 0.01, &AdamConfig::default());
    assert!(matches!(stepped, Err(FieldError::Diverged { count: 1.., .. })));
}

#[test]
fn gradients_of_another_shape_are_refused() {
    let gpu = open(Shape::Cpu);
    let mut field = shaken(&gpu, &small());
    let core = gpu.storage_from("core", &core_rows(3)).unwrap();
    let mut tape = Tape::new(&gpu).unwrap();
    field.forward(&gpu, &core, 3, 0.5, &mut tape, Outputs::All).unwrap();
    for (rows, sh) in [(2, Some(12)), (3, None)] {
        let d = Deltas::new(&gpu, "d", rows, sh).unwrap();
        let refused = field.backward(&gpu, &tape, &d, &core);
        assert!(matches!(refused, Err(FieldError::Mismatch { .. })));
    }
}

#[test]
fn impossible_configurations_are_refused() {
    let wrong = [
        FieldConfig { levels: vec![], ..small() },
        FieldConfig { levels: vec![0], ..small() },
        FieldConfig { features: 5, ..small() },
        FieldConfig { spatial_resolution: [5, 1, 5], ..small() },
        FieldConfig { time_resolution: 0, ..small() },
        FieldConfig { width: 0, ..small() },
        FieldConfig { width: 100, ..small() },
        FieldConfig { depth: 99, ..small() },
        FieldConfig { sh_stride: 13, ..small() },
        FieldConfig { levels: vec![64; 8], spatial_resolution: [1024; 3], ..small() },
        FieldConfig {
            heads: Heads { position: false, scale: false, rotation: false, opacity: false, sh: false },
            ..small()
        },
    ];
    for config in wrong {
        assert!(matches!(Layout::new(&config), Err(FieldError::Config { .. })), "{config:?}");
    }
}
