//! What is learned of the training cameras beside the scene: how they show colours, where they stand, and when they took their frames.
//!
//! Each is a few numbers a camera, learned by Adam, and of each nothing tells what all cameras have in common from what the scene is:
//! that is taken from them after each step. Colours take a step on the device with each frame; gradients of poses and of clocks are summed
//! on the device over as many iterations as there are cameras, and their steps are taken here.

mod cautious;
pub mod clock;
pub mod colour;
pub mod pose;

use std::marker::PhantomData;

use self::cautious::cautious_step;
use erfgs_splat::optimiser::decayed;

/// Something that is learned of each camera.
pub trait Quantity: Clone {
    /// The name of its vectors in a checkpoint.
    const NAME: &'static str;
    /// Numbers that a camera has.
    const FLOATS: usize;
    /// Numbers in a camera's row of summed gradients; 0 where none are summed.
    const SUMS: usize;
}

/// What all cameras have learned of a quantity, with the state of its optimiser.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraState<Q> {
    /// Steps that each camera took.
    pub steps: Vec<u32>,
    /// [`Quantity::FLOATS`] a camera.
    pub values: Vec<f32>,
    /// First and second moments of the gradients, like `values`.
    pub moments: [Vec<f32>; 2],
    /// Gradients of renderings since the last step: [`Quantity::SUMS`] a camera.
    pub sums: Vec<f32>,
    quantity: PhantomData<Q>,
}

impl<Q: Quantity> CameraState<Q> {
    /// Of cameras with these values that have learned nothing.
    #[must_use]
    pub fn new(cameras: usize, values: Vec<f32>) -> Self {
        let moments = [vec![0.0; values.len()], vec![0.0; values.len()]];
        Self { steps: vec![0; cameras], values, moments, sums: vec![0.0; cameras * Q::SUMS], quantity: PhantomData }
    }

    /// Of so many cameras at zero.
    #[must_use]
    pub fn zero(cameras: usize) -> Self {
        Self::new(cameras, vec![0.0; cameras * Q::FLOATS])
    }

    /// The numbers of a camera.
    #[must_use]
    pub fn row(&self, camera: usize) -> &[f32] {
        &self.values[camera * Q::FLOATS..][..Q::FLOATS]
    }

    /// The same, to be changed.
    pub(crate) fn row_mut(&mut self, camera: usize) -> &mut [f32] {
        &mut self.values[camera * Q::FLOATS..][..Q::FLOATS]
    }

    /// Its vectors in a checkpoint: what follows their name, and what they hold.
    pub(crate) fn vectors(&self) -> impl Iterator<Item = (String, &[f32])> {
        let [first, second] = &self.moments;
        let parts = [("", &self.values), (".m", first), (".v", second), (".sums", &self.sums)];
        let kept = if Q::SUMS > 0 { 4 } else { 3 };
        parts.into_iter().take(kept).map(|(part, values)| (format!("{}{part}", Q::NAME), &values[..]))
    }

    /// A state whose vectors `next` gives by their names.
    pub(crate) fn from_vectors(
        steps: Vec<u32>,
        mut next: impl FnMut(&str) -> Result<Vec<f32>, String>,
    ) -> Result<Self, String> {
        let mut state = Self::zero(0);
        let [first, second] = &mut state.moments;
        let (values, sums) = (&mut state.values, &mut state.sums);
        let floats = Q::FLOATS;
        for (part, vector, floats) in
            [("", values, floats), (".m", first, floats), (".v", second, floats), (".sums", sums, Q::SUMS)]
        {
            if floats == 0 {
                continue;
            }
            *vector = next(&format!("{}{part}", Q::NAME))?;
            if Some(vector.len()) != steps.len().checked_mul(floats) {
                return Err(format!("its vectors of '{}' are of different lengths", Q::NAME));
            }
        }
        Ok(Self { steps, ..state })
    }
}

/// A quantity whose gradients are summed, and whose steps are taken here.
pub(crate) trait Summed: Quantity {
    /// Where the gradients lie in a row of sums.
    const GRADIENTS: &'static [usize];
    /// Where a row counts renderings.
    const RENDERINGS: usize;
    /// A camera of which it is learned.
    type Learner;

    /// The number of a learner among all cameras.
    fn camera(learner: &Self::Learner) -> usize;

    /// By what the gradient of a number is multiplied before Adam sees it, and how far a step of it goes at a learning rate.
    fn units(learner: &Self::Learner, number: usize, rate: f64) -> [f64; 2];

    /// The standard deviation of a number, where the calibration tells.
    fn sigma(learner: &Self::Learner, number: usize) -> Option<f64>;

    /// Takes from all learners what they have in common.
    fn take_common(state: &mut CameraState<Self>, learners: &[Self::Learner]);
}

/// How a quantity is learned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    /// Learning rate: first, last.
    pub rate: [f32; 2],
    /// The most that a camera is from its calibration, standard deviations, where these are stated.
    pub within: f32,
}

/// A step of the cameras that `sums` (rows of [`Quantity::SUMS`]) tell of, then what all `learners` have in common is taken away.
pub(crate) fn take_step<Q: Summed>(
    state: &mut CameraState<Q>,
    learners: &[Q::Learner],
    sums: &[f32],
    rule: Rule,
    share: f64,
) {
    let rate = f64::from(decayed(rule.rate, share));
    for learner in learners {
        let camera = Q::camera(learner);
        let row = &sums[camera * Q::SUMS..][..Q::SUMS];
        let renderings = f64::from(row[Q::RENDERINGS]);
        let gradients = || Q::GRADIENTS.iter().map(|&at| f64::from(row[at]) / renderings);
        if renderings < 1.0 || !gradients().all(f64::is_finite) {
            continue;
        }
        state.steps[camera] += 1;
        for (number, gradient) in gradients().enumerate() {
            let (at, [unit, step]) = (camera * Q::FLOATS + number, Q::units(learner, number, rate));
            let [first, second] = &mut state.moments;
            let sure = cautious_step(state.steps[camera], [&mut first[at], &mut second[at]], gradient * unit);
            state.values[at] -= (step * sure) as f32;
        }
    }
    Q::take_common(state, learners);
    for learner in learners {
        for (number, value) in state.row_mut(Q::camera(learner)).iter_mut().enumerate() {
            let Some(sigma) = Q::sigma(learner, number) else { continue };
            let most = rule.within * sigma as f32;
            *value = value.clamp(-most, most);
        }
    }
}
