//! Gaussians that are free in time, in double precision: see [`crate::motion::free_time`].

use crate::motion::free_time::{GONE, ROW};

/// What the kernels are told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The time, RGB intervals.
    pub time: f64,
    /// The shortest life, intervals.
    pub least: f64,
    /// How much of the gradient reaches instants and lives.
    pub path: f64,
    /// Weight of the mean opacity of what is present.
    pub weight_presence: f64,
    /// Weight of the mean squared acceleration, per square metre.
    pub weight_acceleration: f64,
}

/// How much of a row is there at `time`, 0 to 1, and how far it is from its place.
#[must_use]
pub fn presence(row: &[f64; ROW], moment: &Moment) -> (f64, [f64; 3]) {
    let dt = moment.time - row[3];
    let life = moment.least + row[7].exp();
    let presence = (-0.5 * (dt / life).powi(2)).exp();
    (presence, std::array::from_fn(|axis| row[axis] * dt + 0.5 * row[4 + axis] * dt * dt))
}

/// The change of place and of the logit.
#[must_use]
pub fn forward(logit: f64, row: &[f64; ROW], moment: &Moment) -> ([f64; 3], f64) {
    let (presence, moved) = presence(row, moment);
    let opacity = presence / (1.0 + (-logit).exp());
    let wanted = (opacity / (1.0 - opacity)).ln() - logit;
    if wanted > f64::from(GONE) { (moved, wanted) } else { ([0.0; 3], f64::from(GONE)) }
}

/// The regularisers of one row, as the loss counts them: the presence is taken as given.
#[must_use]
pub fn regularisers(logit: f64, row: &[f64; ROW], moment: &Moment, presence_given: f64) -> f64 {
    let squared: f64 = row[4..7].iter().map(|a| a * a).sum();
    moment.weight_presence * presence_given / (1.0 + (-logit).exp()) + moment.weight_acceleration * squared
}

/// Gradients of logit and row from those of the change of place and of the changed logit.
#[must_use]
pub fn backward(logit: f64, row: &[f64; ROW], moment: &Moment, d_mean: [f64; 3], d_changed: f64) -> (f64, [f64; ROW]) {
    let mut d_row = [0.0; ROW];
    for axis in 0..3 {
        d_row[4 + axis] = 2.0 * moment.weight_acceleration * row[4 + axis];
    }
    let (presence, _) = presence(row, moment);
    if forward(logit, row, moment).1 <= f64::from(GONE) {
        return (d_changed, d_row);
    }
    let dt = moment.time - row[3];
    let extra = row[7].exp();
    let life = moment.least + extra;
    for axis in 0..3 {
        d_row[axis] += dt * d_mean[axis];
        d_row[4 + axis] += 0.5 * dt * dt * d_mean[axis];
    }
    // The logit of o p: its derivatives are (1 - o) / (1 - o p) by the logit of o, and 1 / (1 - o p) by ln p.
    let opacity = 1.0 / (1.0 + (-logit).exp());
    let rest = 1.0 / (1.0 - opacity * presence);
    let d_log_presence = moment.path * d_changed * rest;
    d_row[3] = d_log_presence * dt / (life * life);
    d_row[7] = d_log_presence * dt * dt / life.powi(3) * extra;
    let d_logit = d_changed * (1.0 - opacity) * rest + moment.weight_presence * presence * opacity * (1.0 - opacity);
    (d_logit, d_row)
}
