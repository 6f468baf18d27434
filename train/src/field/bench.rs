//! How long each stage of the field takes.

use std::time::Instant;

use erfgs_base::random::{key, purpose, uniform};

use super::{Blend, Field, FieldConfig, FieldError, Outputs, PlaneWeights, Tape};
use crate::{gpu::Gpu, optimiser::AdamConfig, raster::Deltas};

/// What to time.
#[derive(Clone, Debug)]
pub struct BenchField {
    /// The field.
    pub config: FieldConfig,
    /// Dynamic Gaussians.
    pub rows: u32,
}

impl Default for BenchField {
    /// The field of 4DGS on Neu3D at 8,000 Gaussians.
    fn default() -> Self {
        Self { config: FieldConfig::default(), rows: 8000 }
    }
}

/// A timed stage: the best of several runs, each with a wait for the device at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldStage {
    /// Its name.
    pub name: &'static str,
    /// Wall time, milliseconds.
    pub ms: f64,
    /// Operations of its matrix products (a multiplication and an addition are two), 1e9 a second; 0 without products.
    pub gflops: f64,
}

/// Times every stage of a training step.
///
/// # Errors
/// [`FieldError`].
pub fn bench(gpu: &Gpu, setting: &BenchField, repeats: u32) -> Result<Vec<FieldStage>, FieldError> {
    const PURPOSE: u64 = purpose("field bench");
    let rows = setting.rows;
    let mut field = Field::new(gpu, &setting.config, [[0.0; 3], [1.0; 3]], 0)?;
    let stride = setting.config.sh_stride;
    let numbers = |word: u64, count: u32| -> Vec<f32> {
        (0..u64::from(count)).map(|i| uniform(key(word, &[PURPOSE, i])) as f32).collect()
    };
    let core = gpu.storage_from("core", &numbers(0, rows * 12))?;
    let d_core = gpu.storage("d core", u64::from(rows) * 48)?;
    let [mut tape, mut position, mut other] = [Tape::new(gpu)?, Tape::new(gpu)?, Tape::new(gpu)?];
    field.forward(gpu, &core, rows, 0.2, &mut other, Outputs::PositionOnly)?;
    let d_deltas = Deltas::new(gpu, "d deltas", rows, setting.config.heads.sh.then_some(stride))?;
    gpu.upload(&d_deltas.core, 0, &numbers(1, rows * 12));
    if let Some(sh) = &d_deltas.sh {
        gpu.upload(sh, 0, &numbers(2, rows * stride));
    }
    let weights = PlaneWeights { space: 1e-4, time: 1e-3, time_l1: 1e-4, ..Default::default() };
    let products = |what: Outputs| {
        let layout = field.layout();
        let heads = layout.heads_of(what).iter().flat_map(|head| [&head.hidden, &head.out]);
        let weights: usize = layout.trunk.iter().chain(heads).map(|linear| linear.inputs * linear.outputs).sum();
        2e-9 * weights as f64 * f64::from(rows)
    };
    let (all, some) = (products(Outputs::All), products(Outputs::PositionOnly));
    let mut best: Vec<(&'static str, f64, f64)> = Vec::new();
    for _ in 0..repeats.max(1) {
        let mut at = 0;
        let mut time = |name, work, run: &mut dyn FnMut() -> Result<(), FieldError>| {
            let start = Instant::now();
            run()?;
            gpu.wait("timing the field")?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            if at == best.len() {
                best.push((name, ms, work));
            }
            best[at].1 = best[at].1.min(ms);
            at += 1;
            Ok::<(), FieldError>(())
        };
        time("forward", all, &mut || field.forward(gpu, &core, rows, 0.6, &mut tape, Outputs::All))?;
        time("forward, position only", some, &mut || {
            field.forward(gpu, &core, rows, 0.4, &mut position, Outputs::PositionOnly)
        })?;
        time("trajectory loss", 0.0, &mut || {
            let blend = Blend { before: &other.deltas, after: &tape.deltas, blend: 0.5 };
            field.trajectory_loss(gpu, &position, blend, 0.01, &d_deltas).map(drop)
        })?;
        // Two products for each one of the forward pass; what is evaluated again does not count.
        time("backward", 2.0 * all, &mut || field.backward(gpu, &tape, &d_deltas, &d_core))?;
        time("backward, position only", 2.0 * some, &mut || field.backward(gpu, &position, &d_deltas, &d_core))?;
        time("regularise planes", 0.0, &mut || field.regularise(gpu, &weights).map(drop))?;
        time("Adam", 0.0, &mut || field.step(gpu, 1e-3, 1e-4, &AdamConfig::default()))?;
    }
    Ok(best.into_iter().map(|(name, ms, work)| FieldStage { name, ms, gflops: 1e3 * work / ms }).collect())
}
