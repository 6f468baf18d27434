//! Twins and kernels against the oracles: the same equations written again in JAX (`*.py` in this folder), whose gradients
//! come from automatic differentiation; and files against the programs of others (`exchange.rs`).
//!
//! `scripts/setup.sh --oracles` makes the Python environment; the environment variable `ERFGS_ORACLES` names another
//! Python that has JAX.

mod bodies;
mod event;
mod exchange;
mod field;
mod metrics;
mod motion;
mod raster;

use std::process::Command;

use erfgs_recordings::{python, root};
use erfgs_splat::gpu::{AdapterChoice, Gpu, Shape};
use serde_json::Value;

/// Runs an oracle, a file of this folder, with what `arguments` adds to its command.
fn run(oracle: &str, arguments: impl FnOnce(&mut Command) -> &mut Command) {
    let mut command = Command::new(python());
    command.arg(root().join("tests/oracles").join(oracle)).env("JAX_PLATFORMS", "cpu");
    let output = arguments(&mut command).output().unwrap();
    assert!(output.status.success(), "the oracle failed:\n{}", String::from_utf8_lossy(&output.stderr));
}

/// Asks the oracles; one answer for each question, in order.
fn ask(questions: &[Value]) -> Vec<Value> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [asked, answered] = ["questions.json", "answers.json"].map(|name| folder.path().join(name));
    std::fs::write(&asked, serde_json::to_vec(questions).expect("JSON")).expect("questions written");
    run("answer.py", |oracle| {
        // Small scenes take longer to compile than to compute.
        let quick = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true";
        oracle.args([&asked, &answered]).env("XLA_FLAGS", quick)
    });
    serde_json::from_slice(&std::fs::read(&answered).expect("answers")).expect("JSON")
}

/// The numbers of an answer under `name`.
fn numbers(answer: &Value, name: &str) -> Vec<f64> {
    serde_json::from_value(answer[name].clone()).unwrap_or_else(|error| panic!("'{name}' of an answer: {error}"))
}

/// Both shapes of the kernels.
fn gpus() -> [Gpu; 2] {
    [Shape::Cpu, Shape::Gpu]
        .map(|shape| Gpu::open(&AdapterChoice { shape: Some(shape), ..AdapterChoice::default() }).expect("an adapter"))
}

/// Reproducible numbers, uniform in [0, 1).
struct Numbers(u64);

impl Numbers {
    fn unit(&mut self) -> f64 {
        self.0 += 1;
        erfgs_base::random::uniform(erfgs_base::random::key(self.0, &[]))
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// Asserts that every `got` is within `relative` of `want`, on the scale of the largest `want`.
fn assert_close(what: &str, got: &[f64], want: &[f64], relative: f64) {
    assert_eq!(got.len(), want.len(), "{what}");
    let scale = want.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
    for (index, (got, want)) in got.iter().zip(want).enumerate() {
        // Written so that NaN fails.
        let close = (got - want).abs() <= relative * (want.abs() + 0.1 * scale);
        assert!(close, "{what}[{index}]: {got} instead of {want} (the largest is {scale})");
    }
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| value.into()).collect()
}
