//! What the tests share: small fields, points, and a run of one pass on an adapter.

mod behaviour;
mod shapes;
mod twin;

use erfgs_base::random;

use super::*;
use crate::{
    gpu::{AdapterChoice, Shape},
    reference::field::{FieldTwin, TwinDeltas},
};

const BOX: [[f32; 3]; 2] = [[-1.0, 0.5, 2.0], [1.5, 1.5, 6.0]];

fn open(shape: Shape) -> Gpu {
    Gpu::open(&AdapterChoice { shape: Some(shape), ..Default::default() }).expect("an adapter")
}

/// A field small enough for plain loops, with unequal sizes everywhere.
fn small() -> FieldConfig {
    FieldConfig {
        levels: vec![1, 2],
        features: 4,
        spatial_resolution: [5, 4, 6],
        time_resolution: 7,
        width: 16,
        depth: 2,
        sh_stride: 12,
        ..Default::default()
    }
}

/// Uniform numbers in [-1, 1).
fn noise(seed: u64, count: usize) -> Vec<f32> {
    (0..count as u64).map(|i| random::range(random::key(seed, &[i]), -1.0, 1.0) as f32).collect()
}

/// Rows of core parameters with means in and around the box, the last one far outside along x.
fn core_rows(rows: usize) -> Vec<f32> {
    let mut core = noise(11, rows * 12);
    for (row, core) in core.chunks_exact_mut(12).enumerate() {
        for axis in 0..3 {
            let (low, high) = (BOX[0][axis], BOX[1][axis]);
            core[axis] = low + (0.5 + 0.49 * core[axis]) * (high - low);
        }
        if row + 1 == rows {
            core[0] = BOX[1][0] + 3.0;
        }
    }
    core
}

fn means(core: &[f32]) -> Vec<[f64; 3]> {
    core.chunks_exact(12).map(|row| std::array::from_fn(|axis| f64::from(row[axis]))).collect()
}

/// The twin of a field: its parameters in double precision.
fn twin_of(gpu: &Gpu, field: &Field) -> FieldTwin {
    let state = field.state(gpu).unwrap();
    let parameters = state.vectors.iter().step_by(3).flat_map(|vector| &vector.values).copied().map(f64::from);
    let mut flat = vec![0.0; field.layout().total];
    let mut parameters = parameters;
    for (_, offset, length) in field.layout().vectors() {
        flat[offset..offset + length].iter_mut().for_each(|value| *value = parameters.next().unwrap());
    }
    FieldTwin::new(&field.layout().config, BOX.map(|corner| corner.map(f64::from)), flat).unwrap()
}

/// A field whose parameters have moved away from their special initial values.
fn shaken(gpu: &Gpu, config: &FieldConfig) -> Field {
    let mut field = Field::new(gpu, config, BOX, 5).unwrap();
    let mut state = field.state(gpu).unwrap();
    for (index, vector) in state.vectors.iter_mut().enumerate().step_by(3) {
        let length = vector.values.len();
        vector.values.iter_mut().zip(noise(index as u64, length)).for_each(|(value, noise)| *value += 0.1 * noise);
    }
    field.restore(gpu, &state).unwrap();
    field
}

/// What a forward and a backward pass gave.
#[derive(Clone, Debug, PartialEq)]
struct Pass {
    core: Vec<f32>,
    sh: Option<Vec<f32>>,
    gradients: Vec<f32>,
    d_core: Vec<f32>,
}

/// Runs a pass; the gradients of its outputs are noise.
fn pass(gpu: &Gpu, field: &mut Field, core: &[f32], t01: f32, what: Outputs) -> Pass {
    let rows = core.len() / 12;
    let buffer = gpu.storage_from("core", core).unwrap();
    let mut tape = Tape::new(gpu).unwrap();
    field.forward(gpu, &buffer, rows as u32, t01, &mut tape, what).unwrap();
    let stride = field.layout().config.sh_stride as usize;
    let d_deltas = Deltas {
        rows: rows as u32,
        core: gpu.storage_from("d core", &noise(21, rows * 12)).unwrap(),
        sh: tape.deltas.sh.as_ref().map(|_| gpu.storage_from("d sh", &noise(22, rows * stride)).unwrap()),
    };
    let d_core = gpu.storage_from("d core", &vec![1.0_f32; rows * 12]).unwrap();
    field.backward(gpu, &tape, &d_deltas, &d_core).unwrap();
    Pass {
        core: gpu.download(&tape.deltas.core, rows * 12).unwrap(),
        sh: tape.deltas.sh.as_ref().map(|sh| gpu.download(sh, rows * stride).unwrap()),
        gradients: field.gradients(gpu).unwrap(),
        d_core: gpu.download(&d_core, rows * 12).unwrap(),
    }
}

/// The gradient that [`pass`] hands down.
fn twin_d_deltas(rows: usize, stride: usize) -> TwinDeltas {
    let double = |values: Vec<f32>| values.into_iter().map(f64::from).collect();
    TwinDeltas { core: double(noise(21, rows * 12)), sh: double(noise(22, rows * stride)) }
}

/// Asserts that two vectors agree within `tolerance` of the largest value.
fn assert_close(what: &str, found: &[f32], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(error <= tolerance * scale, "{what} {i}: {found} is not {expected} (largest {scale})");
    }
}
