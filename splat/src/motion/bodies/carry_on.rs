//! Bodies that are followed: paths and gates while a part of the recording is learned from.

use glam::{DQuat, DVec3};

/// How a body turns is told by so many control points, and where it is beside the start's path is carried on by so much from one to the
/// next.
const TURN_POINTS: usize = 2;
const KEPT: f64 = 0.75;
/// A node of a body that bends goes on as it went, by so much less from one control point to the next.
const ON: f64 = 0.97;

/// Splines of poses: control points of bodies and nodes, knot after knot, as in `shared.wgsl`.
#[derive(Clone, Copy, Debug)]
pub struct Paths<'a> {
    /// The control points as they were at the start.
    pub started: &'a [f32],
    /// Of each body whether it is followed.
    pub followed: &'a [bool],
    /// Of each node whether its body bends.
    pub loose: &'a [bool],
    /// The body of each node.
    pub of: &'a [usize],
    /// Control points of each.
    pub knots: usize,
}

impl Paths<'_> {
    fn row(&self, knot: usize, entity: usize) -> usize {
        8 * (knot * (self.followed.len() + self.loose.len()) + entity)
    }

    fn pose(&self, control: &[f32], knot: usize, entity: usize) -> (DVec3, DQuat) {
        let row = &control[self.row(knot, entity)..][..8];
        let at = |index: usize| f64::from(row[index]);
        let turn = DQuat::from_xyzw(at(5), at(6), at(7), at(4));
        let turn = if turn.length_squared() > 1e-18 { turn.normalize() } else { DQuat::IDENTITY };
        (DVec3::new(at(0), at(1), at(2)), turn)
    }

    /// Lays the control points of bodies that are followed anew, of each beyond what is `known` of it (stretches from the beginning). Such a
    /// body goes on turning as it turned last. Where it is the start knows well: what it was found to be beside that is carried on less and
    /// less.
    pub fn carry_on(&self, control: &mut [f32], known: &[[f64; 2]]) {
        let last = self.knots - 1;
        // Of the four control points that decide at an instant the outermost hardly does.
        let ends = |[begin, end]: [f64; 2]| {
            let low = (begin.max(0.0).floor() as usize + 1).min(last);
            let high = (end.max(0.0).floor() as usize + 2).clamp(low, last);
            [[low + TURN_POINTS.min(high - low), low], [high.max(low + TURN_POINTS) - TURN_POINTS, high]]
        };
        for body in (0..self.followed.len()).filter(|&body| self.followed[body]) {
            let [begin, end] = ends(known[body]);
            let ([_, low], [_, high]) = (begin, end);
            let on = self.turn_between(control, body, end);
            for knot in high + 1..=last {
                self.lay_beside(control, body, [knot - 1, knot], on);
            }
            let back = self.turn_between(control, body, begin);
            for knot in (0..low).rev() {
                self.lay_beside(control, body, [knot + 1, knot], back);
            }
        }
        for node in (0..self.loose.len()).filter(|&node| self.loose[node]) {
            let [begin, end] = ends(known[self.of[node]]);
            let entity = self.followed.len() + node;
            self.let_go(control, entity, end, end[1] + 1..=last);
            self.let_go(control, entity, begin, (0..begin[1]).rev());
        }
    }

    /// Lets a node go on as it went `from` one control point `to` another.
    fn let_go(&self, control: &mut [f32], node: usize, [from, to]: [usize; 2], knots: impl Iterator<Item = usize>) {
        let step = self.turn_between(control, node, [from, to]);
        let ((before, _), (mut place, mut turn)) = (self.pose(control, from, node), self.pose(control, to, node));
        let mut way = (place - before) / from.abs_diff(to).max(1) as f64;
        for knot in knots {
            way *= ON;
            place += way;
            turn = on_its_side(step * turn, turn);
            self.lay(control, knot, node, place, turn);
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
        self.lay(control, knot, body, here + KEPT * (place - then), on_its_side(step * turn, turn));
    }

    fn lay(&self, control: &mut [f32], knot: usize, entity: usize, place: DVec3, turn: DQuat) {
        let row = [place.x, place.y, place.z, 0.0, turn.w, turn.x, turn.y, turn.z];
        control[self.row(knot, entity)..][..8].copy_from_slice(&row.map(|value| value as f32));
    }
}

/// A turn as its neighbour has it: control points of turns are on one side of the sphere.
fn on_its_side(turn: DQuat, beside: DQuat) -> DQuat {
    let turn = turn.normalize();
    if turn.dot(beside) < 0.0 { -turn } else { turn }
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
        Paths { started, followed: &[true], loose: &[false], of: &[0], knots: KNOTS }
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
        paths(&started).carry_on(&mut learned, &[[3.2, 5.9]]);
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
        of.carry_on(&mut learned, &[[3.5, 5.5]]);
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
        Paths { followed: &[false], ..of }.carry_on(&mut learned, &[[3.5, 5.5]]);
        assert_eq!(learned, before);
        assert!(learned.chunks_exact(8).skip(1).step_by(2).all(|node| node == [0.5; 8]));
    }

    #[test]
    fn nodes_of_what_bends_go_on_as_they_went_and_slow_down() {
        // A node that goes and turns evenly within the part, and was nowhere yet beyond it.
        let (way, rate) = (DVec3::new(0.02, -0.01, 0.03), DVec3::new(0.0, 0.2, 0.1));
        let mut control = control(|_| (DVec3::ZERO, DQuat::IDENTITY));
        let started = control.clone();
        for knot in 4..=7 {
            let (place, turn) = (way * knot as f64, DQuat::from_scaled_axis(rate * knot as f64));
            let row = [place.x, place.y, place.z, 0.0, turn.w, turn.x, turn.y, turn.z].map(|value| value as f32);
            control[8 * (2 * knot + 1)..][..8].copy_from_slice(&row);
        }
        let of = Paths { loose: &[true], ..paths(&started) };
        of.carry_on(&mut control, &[[3.5, 5.5]]);
        let node = |knot: usize| of.pose(&control, knot, 1);
        for (knot, beyond) in [(8, 1), (9, 2), (11, 4), (3, -1), (0, -4)] {
            let gone: f64 = (1..=i32::abs(beyond)).map(|step| ON.powi(step)).sum();
            let end = if beyond > 0 { 7.0 } else { 4.0 };
            let (place, turn) = node(knot);
            assert!(place.abs_diff_eq(way * (end + gone * f64::from(beyond.signum())), 1e-6), "{knot}: {place}");
            assert!(turn.dot(DQuat::from_scaled_axis(rate * knot as f64)).abs() > 1.0 - 1e-9, "{knot}: {turn}");
        }
        // Nodes of others stay.
        let mut stays = started.clone();
        Paths { loose: &[false], ..of }.carry_on(&mut stays, &[[3.5, 5.5]]);
        assert!(stays.chunks_exact(8).skip(1).step_by(2).all(|node| node == [0.5; 8]));
    }

    #[test]
    fn a_part_that_reaches_beyond_the_recording_leaves_nothing_to_be_laid() {
        let started = control(|_| (DVec3::ZERO, DQuat::IDENTITY));
        let learned = control(|_| (DVec3::X, DQuat::IDENTITY));
        let mut carried = learned.clone();
        paths(&started).carry_on(&mut carried, &[[-9.0, 99.0]]);
        assert_alike(&carried[16..], &learned[16..]);
        // Not even of splines of four control points.
        let few = Paths { started: &started[..64], followed: &[true], loose: &[false], of: &[0], knots: 4 };
        let mut carried = learned[..64].to_vec();
        few.carry_on(&mut carried, &[[0.0, 1.0]]);
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
