//! Bodies that are followed: paths and gates while a part of the recording is learned from.

use glam::{DQuat, DVec3};

/// How a body turns is told by so many control points, and where it is beside the start's path is carried on by so much from one to the
/// next.
const TOLD: usize = 2;
const KEPT: f64 = 0.75;

/// Splines of poses: control points of `bodies` of `entities` bodies and nodes, knot after knot, as in `shared.wgsl`.
#[derive(Clone, Copy, Debug)]
pub struct Paths<'a> {
    /// The control points as they were at the start.
    pub started: &'a [f32],
    /// Of each body whether it is followed: how it turns at the start is a guess.
    pub guessed: &'a [bool],
    /// Bodies and nodes together.
    pub entities: usize,
    /// Control points of each.
    pub knots: usize,
}

impl Paths<'_> {
    fn pose(&self, control: &[f32], knot: usize, body: usize) -> (DVec3, DQuat) {
        let row = &control[8 * (knot * self.entities + body)..][..8];
        let at = |index: usize| f64::from(row[index]);
        let turn = DQuat::from_xyzw(at(5), at(6), at(7), at(4));
        let turn = if turn.length_squared() > 1e-18 { turn.normalize() } else { DQuat::IDENTITY };
        (DVec3::new(at(0), at(1), at(2)), turn)
    }

    /// Lays the control points of bodies that are followed anew beyond `known` (stretches from the beginning). Such a body goes on turning
    /// as it turned last. Where it is the start knows well: what it was found to be beside that is carried on less and less.
    pub fn carry_on(&self, control: &mut [f32], known: [f64; 2]) {
        let last = self.knots - 1;
        // Of the four control points that decide at an instant the outermost hardly does.
        let low = (known[0].max(0.0).floor() as usize + 1).min(last);
        let high = (known[1].max(0.0).floor() as usize + 2).clamp(low, last);
        for body in (0..self.guessed.len()).filter(|&body| self.guessed[body]) {
            let on = self.turn_between(control, body, [high.max(low + TOLD) - TOLD, high]);
            for knot in high + 1..=last {
                self.lay_beside(control, body, [knot - 1, knot], on);
            }
            let back = self.turn_between(control, body, [low + TOLD.min(high - low), low]);
            for knot in (0..low).rev() {
                self.lay_beside(control, body, [knot + 1, knot], back);
            }
        }
    }

    /// How a body turns in one step from a control point to another.
    fn turn_between(&self, control: &[f32], body: usize, [from, to]: [usize; 2]) -> DQuat {
        let turn = self.pose(control, to, body).1 * self.pose(control, from, body).1.conjugate();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        DQuat::from_scaled_axis(turn.to_scaled_axis() / from.abs_diff(to).max(1) as f64)
    }

    fn lay_beside(&self, control: &mut [f32], body: usize, [beside, knot]: [usize; 2], step: DQuat) {
        let (place, turn) = self.pose(control, beside, body);
        let [then, here] = [beside, knot].map(|at| self.pose(self.started, at, body).0);
        let turned = (step * turn).normalize();
        // Control points of turns are on one side of the sphere.
        let turned = if turned.dot(turn) < 0.0 { -turned } else { turned };
        let place = here + KEPT * (place - then);
        let row = [place.x, place.y, place.z, 0.0, turned.w, turned.x, turned.y, turned.z];
        control[8 * (knot * self.entities + body)..][..8].copy_from_slice(&row.map(|value| value as f32));
    }
}

/// The gate of a body that starts with `gate`, as in `poses.wgsl`, while only a part of the recording (from when to when, seconds) is known
/// of it.
pub fn gate_within(gate: [f32; 4], [begin, end]: [f32; 2]) -> [f32; 4] {
    let [from, to] = if gate[2] > 0.0 { [gate[0], gate[1]] } else { [begin, end] };
    [begin.max(from), end.min(to), 1.0, 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOTS: usize = 12;

    /// A body that flies and turns, and a node beside it, after what is done to the body from a knot on.
    fn control(changed: impl Fn(usize) -> (DVec3, DQuat)) -> Vec<f32> {
        let knot = |knot: usize| {
            let at = knot as f64;
            let turn = DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 0.5) * at);
            let turn = if knot > 0 && turn.w < 0.0 { -turn } else { turn };
            let (place, more) = changed(knot);
            let (place, turn) = (DVec3::new(0.1 * at, 1.0, 0.01 * at * at) + place, more * turn);
            let body = [place.x, place.y, place.z, 0.0, turn.w, turn.x, turn.y, turn.z].map(|value| value as f32);
            [body, [0.5; 8]]
        };
        (0..KNOTS).flat_map(knot).flatten().collect()
    }

    fn paths(started: &[f32]) -> Paths<'_> {
        Paths { started, guessed: &[true], entities: 2, knots: KNOTS }
    }

    /// Whether poses are the same, by either sign of a turn.
    fn assert_alike(a: &[f32], b: &[f32]) {
        for (a, b) in std::iter::zip(a.chunks_exact(8), b.chunks_exact(8)) {
            let apart = |sign: f32| {
                let turns = std::iter::zip(&a[4..], &b[4..]).map(|(a, b)| (a - sign * b).abs());
                std::iter::zip(&a[..4], &b[..4]).map(|(a, b)| (a - b).abs()).chain(turns).fold(0.0, f32::max)
            };
            assert!(apart(1.0).min(apart(-1.0)) < 1e-5, "{a:?} {b:?}");
        }
    }

    #[test]
    fn what_was_right_stays_as_it_is() {
        let started = control(|_| (DVec3::ZERO, DQuat::IDENTITY));
        let mut learned = started.clone();
        paths(&started).carry_on(&mut learned, [3.2, 5.9]);
        assert_alike(&learned, &started);
    }

    #[test]
    fn turns_go_on_as_they_were_learned_and_places_come_back_to_the_start() {
        let (shift, rate) = (DVec3::new(0.2, 0.0, -0.1), DVec3::new(-0.6, 0.1, 0.2));
        let started = control(|_| (DVec3::ZERO, DQuat::IDENTITY));
        // Within the part it turns otherwise; beyond it something else was there.
        let known = |knot: usize| (4..=7).contains(&knot);
        let own = DVec3::new(0.3, -0.2, 0.5);
        let turned = |knot: usize| DQuat::from_scaled_axis(rate * knot as f64);
        let mut learned = control(|knot| {
            let as_started = DQuat::from_scaled_axis(own * knot as f64);
            let more = turned(knot) * as_started.conjugate();
            if known(knot) { (shift, more) } else { (DVec3::ONE, DQuat::from_rotation_z(2.0)) }
        });
        let of = paths(&started);
        of.carry_on(&mut learned, [3.5, 5.5]);
        let mut last = DQuat::IDENTITY;
        for knot in 0..KNOTS {
            let [(place, turn), (then, _)] = [&learned, &started].map(|control| of.pose(control, knot, 0));
            assert!(turn.dot(turned(knot)).abs() > 1.0 - 1e-9, "{knot}: {turn}");
            assert!(
                knot == 0 || (5..8).contains(&knot) || turn.dot(last) > 0.0,
                "{knot}: the other side of the sphere"
            );
            last = turn;
            let beyond = 4_usize.saturating_sub(knot).max(knot.saturating_sub(7));
            assert!((place - then).abs_diff_eq(shift * KEPT.powi(beyond as i32), 1e-6), "{knot}: {place}");
        }
        // What is no guess is left as it is.
        let before = learned.clone();
        Paths { guessed: &[false], ..of }.carry_on(&mut learned, [3.5, 5.5]);
        assert_eq!(learned, before);
        assert!(learned.chunks_exact(8).skip(1).step_by(2).all(|node| node == [0.5; 8]));
    }

    #[test]
    fn a_part_that_reaches_beyond_the_recording_leaves_nothing_to_be_laid() {
        let started = control(|_| (DVec3::ZERO, DQuat::IDENTITY));
        let learned = control(|_| (DVec3::X, DQuat::IDENTITY));
        let mut carried = learned.clone();
        paths(&started).carry_on(&mut carried, [-9.0, 99.0]);
        assert_alike(&carried[16..], &learned[16..]);
        // Not even of splines of four control points.
        let few = Paths { started: &started[..64], guessed: &[true], entities: 2, knots: 4 };
        let mut carried = learned[..64].to_vec();
        few.carry_on(&mut carried, [0.0, 1.0]);
        assert_alike(&carried[16..], &learned[16..64]);
    }

    #[test]
    fn gates_are_within_the_part_and_within_what_was_found() {
        assert_eq!(gate_within([0.0, 0.6, 0.0, 0.0], [0.2, 0.4]), [0.2, 0.4, 1.0, 0.0]);
        assert_eq!(gate_within([0.3, 0.6, 1.0, 0.0], [0.2, 0.4]), [0.3, 0.4, 1.0, 0.0]);
        // Not there at all: it ends before it begins.
        assert_eq!(gate_within([0.5, 0.6, 1.0, 0.0], [0.2, 0.4]), [0.5, 0.4, 1.0, 0.0]);
    }
}
