use erfgs_base::random;

use super::*;
use crate::{
    gpu::{AdapterChoice, Gpu},
    reference::free_time as twin,
};

const INTERVALS: f32 = 11.0;
const EXTENT: f32 = 2.0;
const CORE: usize = 12;

fn open(shape: Shape) -> Gpu {
    Gpu::open(&AdapterChoice { shape: Some(shape), ..Default::default() }).expect("an adapter")
}

fn between(seed: u64, low: f64, high: f64) -> f64 {
    random::range(random::key(seed, &[]), low, high)
}

/// Paths of either kind.
fn paths() -> [FreeTimeOptions; 3] {
    [(0, 1.0), (2, 1.0), (3, 0.75)].map(|(knots, spacing)| FreeTimeOptions {
        knots,
        spacing,
        ..FreeTimeOptions::default()
    })
}

/// Rows that are there to all degrees, and their logits.
fn rows(count: u64, options: &FreeTimeOptions) -> (Vec<f32>, Vec<f32>) {
    let row = |i: u64| {
        let at = move |k: u64, low, high| between(100 * i + k, low, high) as f32;
        let scale = if options.knots == 0 { [1.0, 0.3] } else { [1.0, 1.0] };
        let mut row: Vec<f32> =
            (0..options.floats() as u64).map(|k| scale[usize::from(k > 3)] as f32 * at(k, -1.0, 1.0)).collect();
        row.iter_mut().skip(3).step_by(4).for_each(|unused| *unused = 0.0);
        (row[3], row[7]) = (at(90, 0.0, 11.0), at(91, -2.0, 1.0));
        row
    };
    let logits = (0..count).map(|i| between(100 * i + 50, -3.0, 5.0) as f32).collect();
    ((0..count).flat_map(row).collect(), logits)
}

fn moment(options: &FreeTimeOptions, t01: f32, supervision: Supervision, rows: usize) -> twin::Moment {
    let (path, weight) = match supervision {
        Supervision::Frame(share) => (1.0, f64::from(share) / rows as f64),
        Supervision::Events => (f64::from(options.event_opacity), 0.0),
    };
    twin::Moment {
        time: f64::from(t01 * INTERVALS),
        knots: options.knots as usize,
        spacing: f64::from(options.spacing),
        least: f64::from(options.least_life),
        path,
        weight_presence: weight * f64::from(options.weight_presence),
        weight_acceleration: weight * f64::from(options.weight_acceleration) / f64::from(EXTENT * EXTENT),
    }
}

fn wide(row: &[f32]) -> Vec<f64> {
    row.iter().copied().map(f64::from).collect()
}

/// What the kernels make of rows and gradients: deltas, gradients of the core, gradients of the rows, and what is added to the second of
/// three rows of clocks.
fn run(
    gpu: &Gpu,
    options: &FreeTimeOptions,
    values: &[f32],
    logits: &[f32],
    d: &[f32],
    t01: f32,
    supervision: Supervision,
) -> [Vec<f32>; 4] {
    let rows = logits.len();
    let mut core = vec![0.0_f32; rows * CORE];
    core.chunks_exact_mut(CORE).zip(logits).for_each(|(row, logit)| row[10] = *logit);
    let model = FreeTime::new(gpu, options, INTERVALS, EXTENT).expect("room");
    let core = gpu.storage_from("core", &core).expect("a buffer");
    let values = gpu.storage_from("rows", values).expect("a buffer");
    let [d_core, gradients] =
        [CORE, options.floats()].map(|stride| gpu.storage("gradients", (rows * stride * 4) as u64).expect("a buffer"));
    let rows_of = MotionRows { core: &core, count: rows as u32, values: &values, gradients: &gradients };
    let mut tape = Tape::new(gpu).expect("a tape");
    model.forward(gpu, rows_of, t01, &mut tape).expect("deltas");
    let d_deltas = Deltas::new(gpu, "gradients of the deltas", rows as u32, None).expect("buffers");
    gpu.upload(&d_deltas.core, 0, d);
    model.backward(gpu, rows_of, &tape, &d_deltas, &d_core, supervision).expect("gradients");
    let sums = gpu.storage("clocks", 24).expect("a buffer");
    model.clock(gpu, rows_of, &tape, &d_deltas, ClockRow { sums: &sums, row: 1 });
    let read = |buffer, stride: usize| gpu.download::<f32>(buffer, rows * stride).expect("read back");
    let clocks = gpu.download::<f32>(&sums, 6).expect("read back");
    [read(&tape.deltas.core, CORE), read(&d_core, CORE), read(&gradients, options.floats()), clocks]
}

fn gradients(rows: usize) -> Vec<f32> {
    (0..rows * CORE).map(|i| between(7_000_000 + i as u64, -1.0, 1.0) as f32).collect()
}

fn assert_close(what: impl std::fmt::Display, got: f32, want: f64, scale: f64) {
    assert!((f64::from(got) - want).abs() <= 2e-5 * (want.abs() + scale), "{what}: {got} instead of {want}");
}

#[test]
fn both_shapes_follow_the_double_precision_twin() {
    let count = 777;
    let d = gradients(count);
    let gpus = [Shape::Cpu, Shape::Gpu].map(open);
    for path in paths() {
        let options = FreeTimeOptions { event_opacity: 0.3, weight_presence: 0.5, weight_acceleration: 0.7, ..path };
        let floats = options.floats();
        let (values, logits) = rows(count as u64, &options);
        for (t01, supervision) in
            [(0.43, Supervision::Frame(1.0)), (0.0, Supervision::Events), (1.0, Supervision::Frame(0.25))]
        {
            let found = gpus.each_ref().map(|gpu| run(gpu, &options, &values, &logits, &d, t01, supervision));
            let moment = moment(&options, t01, supervision, count);
            let (mut there, mut clock) = (0, 0.0);
            for i in 0..count {
                let (row, logit) = (wide(&values[i * floats..(i + 1) * floats]), f64::from(logits[i]));
                let (moved, changed) = twin::forward(logit, &row, &moment);
                there += u32::from(changed > f64::from(GONE));
                let d_row = &d[i * CORE..];
                let d_mean = std::array::from_fn(|axis| f64::from(d_row[axis]));
                let d_changed = f64::from(d_row[10]);
                let (d_logit, expected) = twin::backward(logit, &row, &moment, d_mean, d_changed);
                clock += twin::clock(logit, &row, &moment, d_mean, d_changed);
                for [deltas, d_core, d_rows, _] in &found {
                    let at = &deltas[i * CORE..(i + 1) * CORE];
                    for axis in 0..3 {
                        assert_close("place", at[axis], moved[axis], 1.0);
                    }
                    assert_close("logit", at[10], changed, 1.0);
                    assert!(at[3..10].iter().chain(&at[11..]).all(|&other| other == 0.0));
                    // The rasteriser adds the gradient of the changed logit to that of the stored one itself.
                    assert_close("d logit", d_core[i * CORE + 10], d_logit - d_changed, 1.0);
                    for k in 0..floats {
                        assert_close(format_args!("d row {k}"), d_rows[i * floats + k], expected[k], 3.0);
                    }
                }
            }
            assert!(there > 100, "{there} rows are there");
            for [.., clocks] in &found {
                assert_close("clock", clocks[2], clock, 100.0);
                assert_eq!([clocks[0], clocks[1], clocks[3], clocks[4], clocks[5]], [0.0, 0.0, 1.0, 0.0, 0.0]);
            }
        }
    }
}

#[test]
fn gradients_of_the_twin_match_finite_differences() {
    for path in paths() {
        let options = FreeTimeOptions { weight_presence: 0.5, weight_acceleration: 0.7, ..path };
        finite_differences(&options);
    }
}

fn finite_differences(options: &FreeTimeOptions) {
    let (values, logits) = rows(60, options);
    for (i, row) in values.chunks_exact(options.floats()).enumerate() {
        let moment = moment(options, 0.37, Supervision::Frame(1.0), 1);
        let (row, logit) = (wide(row), f64::from(logits[i]));
        if twin::forward(logit, &row, &moment).1 <= f64::from(GONE) {
            continue;
        }
        let weights = [0.3, -0.7, 0.2, 0.9];
        let given = twin::presence(&row, &moment).0;
        // The motion of the instant is left out of its gradient, so the place is that of the row as it was.
        let loss = |logit: f64, moved: &[f64], for_place: &[f64]| {
            let place = twin::forward(logit, for_place, &moment).0;
            let changed = twin::forward(logit, moved, &moment).1 + logit;
            std::iter::zip(place, weights).map(|(p, w)| p * w).sum::<f64>()
                + weights[3] * changed
                + twin::regularisers(logit, moved, &moment, given)
        };
        let (d_logit, d_row) = twin::backward(logit, &row, &moment, [0.3, -0.7, 0.2], 0.9);
        let step = 1e-6;
        let close = |what: &str, gradient: f64, above: f64, below: f64| {
            let difference = (above - below) / (2.0 * step);
            assert!(
                (gradient - difference).abs() < 1e-6 * (1.0 + difference.abs()),
                "{what} of {i}: {gradient} {difference}"
            );
        };
        let later = |step: f64| {
            let moment = twin::Moment { time: moment.time + step, ..moment };
            let (place, changed) = twin::forward(logit, &row, &moment);
            std::iter::zip(place, weights).map(|(p, w)| p * w).sum::<f64>() + weights[3] * changed
        };
        close("clock", twin::clock(logit, &row, &moment, [0.3, -0.7, 0.2], 0.9), later(step), later(-step));
        close("logit", d_logit, loss(logit + step, &row, &row), loss(logit - step, &row, &row));
        for k in 0..row.len() {
            let at = |delta: f64| {
                let mut moved = row.clone();
                moved[k] += delta;
                loss(logit, &moved, if k == 3 { &row } else { &moved })
            };
            close(&format!("parameter {k}"), d_row[k], at(step), at(-step));
        }
    }
}

#[test]
fn extremes_stay_finite_and_what_is_over_is_gone() {
    let options = FreeTimeOptions::default();
    let huge = 1e30_f32;
    let cases: [([f32; ROW], f32); 7] = [
        ([1.0, 0.0, 0.0, 5.5, 0.0, 0.0, 0.0, 0.0], 80.0),
        ([1.0, 0.0, 0.0, 5.5, 0.0, 0.0, 0.0, 0.0], -80.0),
        ([1.0, 0.0, 0.0, 5.5, 0.0, 0.0, 0.0, 200.0], 0.0),
        ([1.0, 0.0, 0.0, 5.5, 0.0, 0.0, 0.0, -200.0], 0.0),
        ([huge, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0, -200.0], 0.0),
        ([1.0, 0.0, 0.0, -1e6, huge, 0.0, 0.0, 0.0], 9.0),
        ([1.0, 0.0, 0.0, 5.500_001, 0.0, 0.0, 0.0, 0.0], 30.0),
    ];
    let values: Vec<f32> = cases.iter().flat_map(|(row, _)| *row).collect();
    let logits: Vec<f32> = cases.iter().map(|(_, logit)| *logit).collect();
    for shape in [Shape::Cpu, Shape::Gpu] {
        let gpu = open(shape);
        let [deltas, d_core, d_rows, clocks] =
            run(&gpu, &options, &values, &logits, &gradients(7), 0.5, Supervision::Frame(1.0));
        for all in [&deltas, &d_core, &clocks] {
            assert!(all.iter().all(|value| value.is_finite()), "{all:?}");
        }
        // The acceleration of the row that is out of range is regularised as it is: a huge, finite number.
        assert!(d_rows.iter().all(|value| value.is_finite()), "{d_rows:?}");
        for over in [4, 5] {
            assert_eq!(deltas[over * CORE..over * CORE + 3], [0.0; 3], "what is over does not move");
            assert_eq!(deltas[over * CORE + 10], GONE);
        }
        // At its own instant a Gaussian is as its parameters say.
        assert_eq!((deltas[0], deltas[10]), (0.0, 0.0));
    }
}

#[test]
fn knots_that_are_far_away_stay_finite() {
    let options = FreeTimeOptions { knots: 2, spacing: 0.01, ..FreeTimeOptions::default() };
    let huge = [1e30, -1e30, 1e30, 5.5, -1e30, 1e30, 0.0, 0.0, 1e30, 0.0, 0.0, 0.0, -1e30, 0.0, 0.0, 0.0];
    let mut gone = [1.0; 16];
    gone[3] = 1e6;
    let values = [huge, gone].concat();
    for shape in [Shape::Cpu, Shape::Gpu] {
        let gpu = open(shape);
        let [deltas, d_core, d_rows, clocks] =
            run(&gpu, &options, &values, &[0.0; 2], &gradients(2), 0.5, Supervision::Frame(1.0));
        assert!([deltas.clone(), d_core, d_rows, clocks].concat().iter().all(|value| value.is_finite()), "{deltas:?}");
        assert_eq!((&deltas[CORE..CORE + 3], deltas[CORE + 10]), (&[0.0; 3][..], GONE), "what is over does not move");
    }
}

#[test]
fn a_path_through_knots_passes_them_and_follows_a_parabola_exactly() {
    let options = FreeTimeOptions { knots: 3, spacing: 0.5, ..FreeTimeOptions::default() };
    let parabola = |dt: f64| [0.4 * dt, -0.2 * dt + 0.7 * dt * dt, 0.1 * dt * dt];
    let row = options.bent(5.0, |dt| parabola(f64::from(dt)).map(|place| place as f32));
    assert_eq!((row.len(), row[3]), (24, 5.0));
    let row = wide(&row);
    let moment = moment(&options, 0.5, Supervision::Events, 1);
    for step in -15..=15 {
        let dt = 0.1 * f64::from(step);
        for axis in 0..3 {
            let off = (twin::moved(&row, &moment, dt, axis) - parabola(dt)[axis]).abs();
            assert!(off < 1e-6, "{off} m off {dt} intervals later");
        }
    }
    // The function for exports is the same path.
    for options in paths() {
        let (values, _) = rows(20, &options);
        for row in values.chunks_exact(options.floats()) {
            let twin_moment =
                twin::Moment { knots: options.knots as usize, spacing: f64::from(options.spacing), ..moment };
            for step in -12..=12 {
                let dt = 0.3 * step as f32;
                let there = options.moved(row, dt);
                for (axis, place) in there.into_iter().enumerate() {
                    assert_close("place", place, twin::moved(&wide(row), &twin_moment, f64::from(dt), axis), 3.0);
                }
            }
        }
    }
    // Beyond the last knot it goes straight on: at twice the distance, twice as far.
    let at = |dt: f64| twin::moved(&row, &moment, dt, 1);
    assert!((at(2.5) - 2.0 * at(2.0) + at(1.5)).abs() < 1e-12);
}

#[test]
fn lives_are_half_as_long_where_things_go_far_and_some_begin_between_frames() {
    let lives = |displacement| {
        let mut options = FreeTimeOptions::default();
        options.live(displacement);
        (options.least_life, options.first_life, options.between)
    };
    let [unknown, near, far] = [None, Some(0.1), Some(0.2)].map(lives);
    assert_eq!([unknown, near, far], [(0.25, 0.5, 0), (0.25, 0.5, 0), (0.125, 0.25, 1)]);
    // What nobody decided on is what things that go less far get.
    let born = |options: &FreeTimeOptions| options.born(0.0, [0.0; 3]);
    let decided = FreeTimeOptions { first_life: 0.5, ..FreeTimeOptions::default() };
    assert_eq!(born(&FreeTimeOptions::default()), born(&decided));
}
