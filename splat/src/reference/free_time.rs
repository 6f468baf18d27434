//! Gaussians that are free in time, in double precision: see [`crate::motion::free_time`].

use crate::motion::free_time::GONE;

/// What the kernels are told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The time, RGB intervals.
    pub time: f64,
    /// Knots of a path on either side of its instant; 0 where it is a parabola.
    pub knots: usize,
    /// Intervals from a knot to the next.
    pub spacing: f64,
    /// The shortest life, intervals.
    pub least: f64,
    /// How much of the gradient reaches instants and lives.
    pub path: f64,
    /// Weight of the mean opacity of what is present.
    pub weight_presence: f64,
    /// Weight of the mean squared acceleration, per square metre.
    pub weight_acceleration: f64,
}

/// How far a row is from its place `dt` intervals after its instant, along one axis.
#[must_use]
pub fn moved(row: &[f64], moment: &Moment, dt: f64, axis: usize) -> f64 {
    if moment.knots == 0 {
        return row[axis] * dt + 0.5 * row[4 + axis] * dt * dt;
    }
    let side = moment.knots;
    let before = row.chunks_exact(4).take(side).map(|knot| knot[axis]);
    let after = row.chunks_exact(4).skip(side).map(|knot| knot[axis]);
    let knots: Vec<f64> = before.chain([0.0]).chain(after).collect();
    let last = knots.len() - 1;
    let inner = |i: usize| 0.5 * (knots[i + 1] - knots[i - 1]);
    let tangent = |i: usize| match i {
        0 => 2.0 * (knots[1] - knots[0]) - inner(1),
        i if i == last => 2.0 * (knots[last] - knots[last - 1]) - inner(last - 1),
        i => inner(i),
    };
    let u = dt / moment.spacing + side as f64;
    if u <= 0.0 {
        return knots[0] + u * tangent(0);
    }
    if u >= last as f64 {
        return knots[last] + (u - last as f64) * tangent(last);
    }
    let i = u.floor() as usize;
    let t = u - i as f64;
    let (square, cube) = (t * t, t * t * t);
    (2.0 * cube - 3.0 * square + 1.0) * knots[i]
        + (cube - 2.0 * square + t) * tangent(i)
        + (3.0 * square - 2.0 * cube) * knots[i + 1]
        + (cube - square) * tangent(i + 1)
}

/// How fast a row is `dt` intervals after its instant, along one axis, metres an interval.
#[must_use]
pub fn velocity(row: &[f64], moment: &Moment, dt: f64, axis: usize) -> f64 {
    if moment.knots == 0 {
        return row[axis] + row[4 + axis] * dt;
    }
    // A cubic between knots and a line beyond the outermost: four places tell it, all on the same side of each knot.
    let u = dt / moment.spacing;
    let side = moment.knots as f64;
    let stretch = if u < -side {
        [-side - 4.0, -side - 3.0, -side - 2.0, -side - 1.0]
    } else if u >= side {
        [side + 1.0, side + 2.0, side + 3.0, side + 4.0]
    } else {
        [0.2, 0.4, 0.6, 0.8].map(|share| u.floor() + share)
    };
    let places = stretch.map(|u| moved(row, moment, u * moment.spacing, axis));
    let slope = |i: usize| {
        // The derivative of Lagrange's polynomial of place i.
        let others: Vec<f64> = (0..4).filter(|k| *k != i).map(|k| stretch[k]).collect();
        let below: f64 = others.iter().map(|other| stretch[i] - other).product();
        let without =
            |k: usize| others.iter().enumerate().filter(move |(at, _)| *at != k).map(move |(_, other)| u - other);
        (0..3).map(|k| without(k).product::<f64>()).sum::<f64>() / below
    };
    (0..4).map(|i| slope(i) * places[i]).sum::<f64>() / moment.spacing
}

/// How much of a row is there at `time`, 0 to 1, and how far it is from its place.
#[must_use]
pub fn presence(row: &[f64], moment: &Moment) -> (f64, [f64; 3]) {
    let dt = moment.time - row[3];
    let life = moment.least + row[7].exp();
    let presence = (-0.5 * (dt / life).powi(2)).exp();
    (presence, std::array::from_fn(|axis| moved(row, moment, dt, axis)))
}

/// The change of place and of the logit.
#[must_use]
pub fn forward(logit: f64, row: &[f64], moment: &Moment) -> ([f64; 3], f64) {
    let (presence, moved) = presence(row, moment);
    let opacity = presence / (1.0 + (-logit).exp());
    let wanted = (opacity / (1.0 - opacity)).ln() - logit;
    if wanted > f64::from(GONE) { (moved, wanted) } else { ([0.0; 3], f64::from(GONE)) }
}

/// The mean squared acceleration of a path: that of the parabola, or of the knots within.
fn bend(row: &[f64], moment: &Moment) -> f64 {
    if moment.knots == 0 {
        return row[4..7].iter().map(|a| a * a).sum();
    }
    let within = 1 - moment.knots as i32..moment.knots as i32;
    let count = within.len() as f64;
    let at = |knot: i32, axis: usize| moved(row, moment, f64::from(knot) * moment.spacing, axis);
    let squared = |knot: i32, axis: usize| {
        let second = at(knot - 1, axis) - 2.0 * at(knot, axis) + at(knot + 1, axis);
        (second / moment.spacing.powi(2)).powi(2)
    };
    within.flat_map(|knot| (0..3).map(move |axis| squared(knot, axis))).sum::<f64>() / count
}

/// The regularisers of one row, as the loss counts them: the presence is taken as given.
#[must_use]
pub fn regularisers(logit: f64, row: &[f64], moment: &Moment, presence_given: f64) -> f64 {
    moment.weight_presence * presence_given / (1.0 + (-logit).exp()) + moment.weight_acceleration * bend(row, moment)
}

/// Gradients of logit and row from those of the change of place and of the changed logit.
#[must_use]
pub fn backward(logit: f64, row: &[f64], moment: &Moment, d_mean: [f64; 3], d_changed: f64) -> (f64, Vec<f64>) {
    // Places are linear in the numbers of the path, and squared accelerations quadratic.
    let mut d_row = vec![0.0; row.len()];
    let unit = |k: usize| -> Vec<f64> { (0..row.len()).map(|other| f64::from(u8::from(other == k))).collect() };
    let of_path = |k: &usize| k % 4 != 3;
    for k in (0..row.len()).filter(of_path) {
        let moved_by = |step: f64| -> Vec<f64> {
            (0..row.len()).map(|other| row[other] + if other == k { step } else { 0.0 }).collect()
        };
        d_row[k] = 0.5 * moment.weight_acceleration * (bend(&moved_by(1.0), moment) - bend(&moved_by(-1.0), moment));
    }
    let (presence, _) = presence(row, moment);
    if forward(logit, row, moment).1 <= f64::from(GONE) {
        return (d_changed, d_row);
    }
    let dt = moment.time - row[3];
    let extra = row[7].exp();
    let life = moment.least + extra;
    for k in (0..row.len()).filter(of_path) {
        d_row[k] += moved(&unit(k), moment, dt, k % 4) * d_mean[k % 4];
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

/// What the gradients of the change of place and of the changed logit say of the time, intervals: the presence changes with it, and the
/// place.
#[must_use]
pub fn clock(logit: f64, row: &[f64], moment: &Moment, d_mean: [f64; 3], d_changed: f64) -> f64 {
    if forward(logit, row, moment).1 <= f64::from(GONE) {
        return 0.0;
    }
    let dt = moment.time - row[3];
    let life = moment.least + row[7].exp();
    let opacity = 1.0 / (1.0 + (-logit).exp());
    let d_log_presence = d_changed / (1.0 - opacity * presence(row, moment).0);
    let moving: f64 = (0..3).map(|axis| d_mean[axis] * velocity(row, moment, dt, axis)).sum();
    moving - d_log_presence * dt / (life * life)
}
