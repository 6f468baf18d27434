//! What is learned of bodies: its steps, and what resuming needs of it.

use wgpu::Buffer;

use super::Bodies;
use crate::{
    field::{FieldError, FieldState, NamedVector},
    gpu::{Gpu, GpuError},
    optimiser::{AdamBuffers, AdamConfig, decayed},
};

/// How much faster bodies learn while they are followed.
const FASTER: f32 = 2.0;
/// Adam's memory of squared gradients: each control point is asked for now and then alone.
const BETA2: f32 = 0.99;

/// Parameters with their gradients and moments.
#[derive(Debug)]
pub(super) struct Learned {
    pub(super) values: Buffer,
    pub(super) gradients: Buffer,
    pub(super) moments: [Buffer; 2],
    pub(super) floats: usize,
}

impl Learned {
    pub(super) fn new(gpu: &Gpu, label: &str, values: &[f32]) -> Result<Self, GpuError> {
        let bytes = size_of_val(values) as u64;
        Ok(Self {
            values: gpu.storage_from(label, values)?,
            gradients: gpu.storage("gradients of bodies", bytes)?,
            moments: [gpu.storage("first moment of bodies", bytes)?, gpu.storage("second moment of bodies", bytes)?],
            floats: values.len(),
        })
    }

    fn all(&self) -> [&Buffer; 3] {
        let [first, second] = &self.moments;
        [&self.values, first, second]
    }
}

impl Bodies {
    /// Sets the gradients of an iteration to zero.
    pub fn clear_gradients(&self, gpu: &Gpu) {
        let mut commands = gpu.commands();
        commands.clear(&self.control.gradients);
        commands.clear(&self.other.gradients);
        commands.submit();
    }

    /// One step of Adam, where `progress` is the share of the fine stage that is done; bodies learn faster while they are followed.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn step(&mut self, gpu: &Gpu, progress: f64, follows: bool, epsilon: f32) -> Result<(), FieldError> {
        self.steps += 1;
        let [bodies, nodes, knots] = self.counts;
        let options = &self.options;
        // Appearance first, then bodies, then nodes.
        let early = (0.02 + progress / 0.05).min(1.0) as f32;
        let from = f64::from(options.nodes_from);
        let late = if progress < from { 0.0 } else { ((progress - from) / 0.05).clamp(0.02, 1.0) as f32 };
        let rate = |rates: [f32; 2], scale: f32| scale * decayed(rates, progress);
        let pose = |path: f32, turn: f32| [path, path, path, 0.0, turn, turn, turn, turn];
        let speed = if follows { early * FASTER } else { early };
        let of_body = pose(rate(options.path, speed * self.extent), rate(options.turn, speed));
        let of_node = pose(rate(options.node_path, late * self.extent), rate(options.node_turn, late));
        // What bends has nowhere to be but where its nodes are.
        let of_loose = pose(rate(options.bend_path, early * self.extent), rate(options.bend_turn, early));
        let of_nodes = self.loose.iter().flat_map(|loose| if *loose { of_loose } else { of_node });
        let control_rates: Vec<f32> = of_body.repeat(bodies as usize).into_iter().chain(of_nodes).collect();
        let [gate, reach] = [early * options.gate, late * options.reach];
        let other_rates =
            [[gate, gate, 0.0, 0.0].repeat(bodies as usize), [0.0, 0.0, 0.0, reach].repeat(nodes as usize)].concat();
        let squared = self.extent * self.extent;
        let weight = |weight: f32, of: u32, scale: f32| weight * scale / (of.max(1) * (knots - 3).max(1)) as f32;
        let weights = [
            weight(options.smooth_path[0], bodies, 1.0 / squared),
            weight(options.smooth_turn[0], bodies, 1.0),
            weight(options.smooth_path[1], nodes, 1.0 / squared),
            weight(options.smooth_turn[1], nodes, 1.0),
        ];
        let bits = weights.map(f32::to_bits);
        let smooth = gpu.uniform("smooth", &[[bodies, nodes, knots, 0], bits]);
        let points = knots * self.entities();
        let counts = gpu.uniform("control points", &[points, 0, 0, 0]);
        let groups = points.div_ceil(self.threads);
        let config = AdamConfig { beta2: BETA2, epsilon, ..AdamConfig::default() };
        let mut commands = gpu.commands();
        let (control, other) = (&self.control, &self.other);
        commands.dispatch(&self.kernels.smooth, &[&smooth, &control.values, &control.gradients], groups);
        for (learned, rows, rates) in [(control, knots, &control_rates), (other, 1, &other_rates)] {
            let [first_moment, second_moment] = &learned.moments;
            let buffers = AdamBuffers {
                parameters: &learned.values,
                gradients: &learned.gradients,
                first_moment,
                second_moment,
                rows,
                stride: rates.len() as u32,
                mask: None,
            };
            if !rates.is_empty() {
                self.adam.step(&mut commands, &buffers, rates, &config, self.steps)?;
            }
        }
        commands.dispatch(&self.kernels.unit, &[&counts, &control.values], groups);
        commands.submit();
        Ok(())
    }

    /// Everything that resuming needs.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn state(&self, gpu: &Gpu) -> Result<FieldState, FieldError> {
        let mut vectors = Vec::new();
        for (name, learned) in self.learned() {
            for (part, buffer) in PARTS.iter().zip(learned.all()) {
                vectors
                    .push(NamedVector { name: format!("{name}{part}"), values: gpu.download(buffer, learned.floats)? });
            }
        }
        Ok(FieldState { step: self.steps, vectors })
    }

    /// Goes on from what [`Bodies::state`] gave.
    ///
    /// # Errors
    /// [`FieldError::State`] where that is of other bodies.
    pub fn restore(&mut self, gpu: &Gpu, state: &FieldState) -> Result<(), FieldError> {
        let learned = self.learned();
        let expected =
            learned.iter().flat_map(|(name, learned)| PARTS.map(|part| (format!("{name}{part}"), learned.floats)));
        let fits = expected.eq(state.vectors.iter().map(|vector| (vector.name.clone(), vector.values.len())));
        if !fits {
            let reason =
                "it was saved with other bodies; train anew, or with the dataset that it was trained on".into();
            return Err(FieldError::State { reason });
        }
        let buffers = learned.iter().flat_map(|(_, learned)| learned.all());
        for (vector, buffer) in state.vectors.iter().zip(buffers) {
            gpu.upload(buffer, 0, &vector.values);
        }
        self.steps = state.step;
        Ok(())
    }

    fn learned(&self) -> [(&'static str, &Learned); 2] {
        [("bodies.control", &self.control), ("bodies.other", &self.other)]
    }

    /// Numbers that paths, gates and nodes consist of, and the buffers that they lie in.
    #[must_use]
    pub fn values(&self) -> [(&Buffer, u32); 2] {
        self.learned().map(|(_, learned)| (&learned.values, learned.floats as u32))
    }

    /// The gradients of paths, and of gates and nodes, copied to the host.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gradients(&self, gpu: &Gpu) -> Result<[Vec<f32>; 2], GpuError> {
        let [control, other] = self.learned().map(|(_, learned)| gpu.download(&learned.gradients, learned.floats));
        Ok([control?, other?])
    }
}

/// Parts of what is learned, as [`Learned::all`] has them.
const PARTS: [&str; 3] = ["", ".m", ".v"];
