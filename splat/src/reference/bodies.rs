//! Gaussians that bodies carry, in double precision: see [`crate::motion::bodies`].

use glam::{DQuat, DVec3, DVec4};

use crate::motion::bodies::spline::{Basis, basis};

/// A place and a turn at a time, and how much of the body is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Of a body: where its frame is. Of a node: how far it is from its rest.
    pub shift: DVec3,
    /// w, x, y, z, of length 1.
    pub turn: DVec4,
    /// The logarithm of how much of the body is there; 0 of a node.
    pub log_presence: f64,
}

/// A control point: shift, turn (w, x, y, z, of any length).
pub type Control = (DVec3, DVec4);

/// What a body has besides its path: the times at which it appears and vanishes, seconds, where it does, and how softly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Seconds.
    pub times: [f64; 2],
    /// Seconds.
    pub softness: f64,
}

impl Gate {
    /// ln(sigmoid((t - begin) / softness) sigmoid((end - t) / softness)).
    #[must_use]
    pub fn log_presence(&self, seconds: f64) -> f64 {
        let log_sigmoid = |x: f64| -(-x).exp().ln_1p();
        let [begin, end] = self.times;
        log_sigmoid((seconds - begin) / self.softness) + log_sigmoid((end - seconds) / self.softness)
    }
}

/// Where a spline is at `s` stretches, before its turn is brought to length 1.
#[must_use]
pub fn spline(control: &[Control], s: f64) -> Control {
    let Basis { first, weights } = basis(s, control.len());
    let four = || control[first..].iter().zip(weights);
    (four().map(|((shift, _), weight)| *shift * weight).sum(), four().map(|((_, turn), weight)| *turn * weight).sum())
}

/// The pose of a spline.
#[must_use]
pub fn pose(control: &[Control], s: f64, log_presence: f64) -> Pose {
    let (shift, turn) = spline(control, s);
    Pose { shift, turn: turn.normalize(), log_presence }
}

/// A node as it rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Where, in the frame of its body, metres.
    pub rest: DVec3,
    /// The logarithm of how far it reaches, metres.
    pub log_radius: f64,
}

/// A Gaussian in the frame of its body: place, turn (any length), opacity logit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Metres.
    pub place: DVec3,
    /// w, x, y, z.
    pub turn: DVec4,
    /// Of its opacity.
    pub logit: f64,
}

fn quaternion(q: DVec4) -> DQuat {
    DQuat::from_xyzw(q.y, q.z, q.w, q.x)
}

fn product(a: DVec4, b: DVec4) -> DVec4 {
    let q = quaternion(a) * quaternion(b);
    DVec4::new(q.w, q.x, q.y, q.z)
}

/// The place `v` turned by `q`, of length 1.
#[must_use]
pub fn turned(q: DVec4, v: DVec3) -> DVec3 {
    let u = DVec3::new(q.y, q.z, q.w);
    v + 2.0 * (q.x * u.cross(v) + u.cross(u.cross(v)))
}

/// The row as its body and the nodes that it hangs on carry it.
#[must_use]
pub fn carried(row: &Row, body: &Pose, nodes: &[(Node, Pose)]) -> Row {
    let reach = |node: &Node| -(row.place - node.rest).length_squared() / (2.0 * (2.0 * node.log_radius).exp());
    let most = nodes.iter().map(|(node, _)| reach(node)).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = nodes.iter().map(|(node, _)| (reach(node) - most).exp()).collect();
    let total: f64 = weights.iter().sum();
    let (mut place, mut turn) = (DVec3::ZERO, DVec4::ZERO);
    for ((node, pose), weight) in nodes.iter().zip(weights) {
        let weight = weight / total;
        place += weight * (turned(pose.turn, row.place - node.rest) + node.rest + pose.shift);
        let sign = if pose.turn.dot(nodes[0].1.turn) < 0.0 { -1.0 } else { 1.0 };
        turn += sign * weight * pose.turn;
    }
    if nodes.is_empty() {
        (place, turn) = (row.place, DVec4::X);
    }
    let opacity = body.log_presence.exp() / (1.0 + (-row.logit).exp());
    Row {
        place: turned(body.turn, place) + body.shift,
        turn: product(product(body.turn, turn.normalize()), row.turn),
        logit: (opacity / (1.0 - opacity)).ln(),
    }
}

/// What holds the nodes of a body together: neighbours keep their places as each sees them turned (ARAP), none goes far from its rest,
/// and neighbours turn alike. `neighbours` lists pairs (node, other).
#[must_use]
pub fn together(nodes: &[(Node, Pose)], neighbours: &[(usize, usize)], [rigid, away, alike]: [f64; 3]) -> f64 {
    let held = |&(k, j): &(usize, usize)| {
        let ((a, at), (b, there)) = (&nodes[k], &nodes[j]);
        let way = b.rest - a.rest;
        let error = way + there.shift - at.shift - turned(at.turn, way);
        rigid * error.length_squared() + alike * (1.0 - at.turn.dot(there.turn).powi(2))
    };
    neighbours.iter().map(held).sum::<f64>()
        + away * nodes.iter().map(|(_, pose)| pose.shift.length_squared()).sum::<f64>()
}

/// What keeps paths smooth: squared third differences of control points.
#[must_use]
pub fn roughness(control: &[Control], [shift, turn]: [f64; 2]) -> f64 {
    let third = control.windows(4).map(|c| {
        let shifts = c[3].0 - 3.0 * c[2].0 + 3.0 * c[1].0 - c[0].0;
        let turns = c[3].1 - 3.0 * c[2].1 + 3.0 * c[1].1 - c[0].1;
        shift * shifts.length_squared() + turn * turns.length_squared()
    });
    third.sum()
}
