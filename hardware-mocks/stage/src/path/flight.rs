//! Free flight: parabolas from bounce to bounce, and the free rotation of a symmetric top.
//!
//! Between two bounces nothing turns a thing but its own inertia. What has an axis of symmetry then turns about its angular
//! momentum at a constant rate, and about its own axis at another: `R(t) = exp(drift t) R(0) exp(own t)`. That is exact for balls,
//! rods, coins and boxes with a square end.

use glam::{DMat3, DQuat, DVec3};

use super::Speed;
use crate::motion::GRAVITY;

/// How a thing resists being turned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Top {
    /// Its axis of symmetry, in its own frame.
    pub axis: DVec3,
    /// Its moment of inertia about the axis, as a share of that across it.
    pub ratio: f64,
}

impl Top {
    /// A ball, which has no axis.
    pub const BALL: Self = Self { axis: DVec3::Y, ratio: 1.0 };

    /// A box whose ends across `axis` are squares of half a side `end`, and which is half as long as `length`.
    pub fn square_box(axis: DVec3, end: f64, length: f64) -> Self {
        Self { axis, ratio: 2.0 * end * end / (end * end + length * length) }
    }

    /// A thin rod, so much longer than wide.
    pub fn rod(axis: DVec3, radius: f64, half: f64) -> Self {
        Self { axis, ratio: 0.5 * radius * radius / (0.25 * radius * radius + half * half / 3.0) }
    }

    /// A thin disc.
    pub fn disc(axis: DVec3) -> Self {
        Self { axis, ratio: 2.0 }
    }
}

/// A thing at an instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State {
    /// Where its centre is, metres.
    pub at: DVec3,
    /// How fast its centre moves, metres per second.
    pub velocity: DVec3,
    /// How it is turned: from its frame to the world.
    pub turned: DQuat,
    /// How fast it turns: the axis in the world times radians per second.
    pub spin: DVec3,
}

/// From one bounce to the next.
#[derive(Clone, Debug)]
struct Leg {
    /// When it begins, seconds.
    from: f64,
    /// The instant at which the rest holds, seconds.
    zero: f64,
    at: DVec3,
    velocity: DVec3,
    fall: DVec3,
    turned: DQuat,
    /// Turning in the world's axes, after the body's own.
    drift: DVec3,
    /// Turning in the body's axes, before all else.
    own: DVec3,
}

/// Where a centre may be: beyond, it bounces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arena {
    /// The lowest x, y, z.
    pub low: DVec3,
    /// The highest.
    pub high: DVec3,
    /// The share of the speed across a wall or the floor that a bounce leaves.
    pub restitution: f64,
    /// The radius of a ball that grips what it bounces off, metres; what is none slides.
    pub grip: Option<f64>,
}

/// What a bounce does not leave a speed below, metres per second: a take of any length shows a throw.
const LEAST_REBOUND: f64 = 1.5;
/// More bounces nothing makes.
const MOST_LEGS: usize = 4096;

/// What happens to a thing at one instant of its flight, from which the rest follows in both directions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    /// When, seconds.
    pub t: f64,
    /// Before.
    pub before: State,
    /// After.
    pub after: State,
}

impl Meeting {
    /// Nothing happens.
    pub fn none(t: f64, state: State) -> Self {
        Self { t, before: state, after: state }
    }
}

/// Free flight from bounce to bounce.
#[derive(Clone, Debug)]
pub(crate) struct Flight {
    /// By time; the first begins at minus infinity.
    legs: Vec<Leg>,
}

impl Flight {
    /// The flight through a meeting, over a span of time at least. Bounces before the meeting are without loss: what it would
    /// have had to lose is not known.
    pub(crate) fn through(meeting: &Meeting, top: Top, arena: &Arena, [from, to]: [f64; 2]) -> Self {
        let mut legs = Vec::new();
        // Backwards: a film of a flight without loss, run the other way, is one, too.
        let lossless = Arena { restitution: 1.0, grip: None, ..*arena };
        let (mut t, mut state) = (meeting.t, meeting.before);
        while t > from && legs.len() < MOST_LEGS {
            let leg = Leg::new(t, &state, top, DVec3::Y * GRAVITY);
            let reversed = State { velocity: -state.velocity, ..state };
            let Some((after, normal)) = lossless.next(&reversed) else { break };
            let begin = t - after;
            let mut met = leg.state(begin);
            met.velocity -= normal * (2.0 * met.velocity.dot(normal));
            legs.push(Leg { from: begin, ..leg });
            (t, state) = (begin, met);
        }
        legs.push(Leg { from: f64::NEG_INFINITY, ..Leg::new(t, &state, top, DVec3::Y * GRAVITY) });
        legs.reverse();
        let (mut t, mut state) = (meeting.t, meeting.after);
        loop {
            let leg = Leg::new(t, &state, top, DVec3::Y * GRAVITY);
            let next = arena.next(&state);
            if t > from || legs.last().is_none_or(|last| last.from < t) {
                legs.push(leg.clone());
            }
            let Some((after, normal)) = next else { break };
            t += after;
            if t > to || legs.len() >= 2 * MOST_LEGS {
                break;
            }
            state = arena.bounced(leg.state(t), normal);
        }
        Self { legs }
    }

    /// At rest until `t`, and in flight from then on.
    pub(crate) fn launched(t: f64, state: &State, top: Top, arena: &Arena, to: f64) -> Self {
        let mut flight = Self::through(&Meeting::none(t, *state), top, arena, [t, to]);
        let rest = State { velocity: DVec3::ZERO, spin: DVec3::ZERO, ..*state };
        flight.legs[0] = Leg { from: f64::NEG_INFINITY, ..Leg::new(t, &rest, top, DVec3::ZERO) };
        flight
    }

    pub(crate) fn place(&self, t: f64) -> (DVec3, DMat3) {
        let leg = self.leg(t);
        let (since, own) = (t - leg.zero, leg.own * (t - leg.zero));
        let at = leg.at + leg.velocity * since + leg.fall * (0.5 * since * since);
        let turned = DQuat::from_scaled_axis(leg.drift * since) * leg.turned * DQuat::from_scaled_axis(own);
        (at, DMat3::from_quat(turned.normalize()))
    }

    pub(crate) fn speed(&self, t: f64, half: f64) -> Speed {
        let (from, to) = (t - half, t + half);
        let first = self.legs.partition_point(|leg| leg.from <= from).max(1) - 1;
        let mut speed = Speed { origin: 0.0, turn: 0.0 };
        for (index, leg) in self.legs.iter().enumerate().skip(first).take_while(|(_, leg)| leg.from <= to) {
            let end = self.legs.get(index + 1).map_or(f64::INFINITY, |next| next.from);
            // The square of the speed on a parabola is greatest at an end.
            for t in [from.max(leg.from), to.min(end)] {
                speed.origin = speed.origin.max((leg.velocity + leg.fall * (t - leg.zero)).length());
            }
            speed.turn = speed.turn.max(leg.drift.length() + leg.own.length());
        }
        speed
    }

    /// The instants at which it bounces, seconds.
    #[cfg(test)]
    pub(crate) fn bounces(&self) -> Vec<f64> {
        self.legs.iter().skip(1).map(|leg| leg.from).collect()
    }

    fn leg(&self, t: f64) -> &Leg {
        // The first leg begins before all.
        &self.legs[self.legs.partition_point(|leg| leg.from <= t).max(1) - 1]
    }
}

impl Leg {
    fn new(t: f64, state: &State, top: Top, fall: DVec3) -> Self {
        let along = (state.turned.inverse() * state.spin).dot(top.axis);
        let axis = state.turned * top.axis;
        // The angular momentum over the moment of inertia across the axis.
        let drift = state.spin + axis * (along * (top.ratio - 1.0));
        let own = top.axis * (along * (1.0 - top.ratio));
        Self { from: t, zero: t, at: state.at, velocity: state.velocity, fall, turned: state.turned, drift, own }
    }

    fn state(&self, t: f64) -> State {
        let since = t - self.zero;
        let turned =
            (DQuat::from_scaled_axis(self.drift * since) * self.turned * DQuat::from_scaled_axis(self.own * since))
                .normalize();
        State {
            at: self.at + self.velocity * since + self.fall * (0.5 * since * since),
            velocity: self.velocity + self.fall * since,
            turned,
            spin: self.drift + turned * self.own,
        }
    }
}

impl Arena {
    /// How long until a thing that falls leaves the arena, seconds, and the normal inwards of where it does.
    fn next(&self, state: &State) -> Option<(f64, DVec3)> {
        let mut first: Option<(f64, DVec3)> = None;
        for axis in 0..3 {
            let fall = if axis == 1 { GRAVITY } else { 0.0 };
            for (wall, inwards) in [(self.low[axis], 1.0), (self.high[axis], -1.0)] {
                let (gap, speed) = (wall - state.at[axis], state.velocity[axis]);
                let mut normal = DVec3::ZERO;
                normal[axis] = inwards;
                for t in crossings(gap, speed, fall) {
                    // Outwards alone.
                    let leaves = (speed + fall * t) * inwards < 0.0;
                    if leaves && t > 1e-9 && first.is_none_or(|(known, _)| t < known) {
                        first = Some((t, normal));
                    }
                }
            }
        }
        first
    }

    /// What a bounce off a surface with this normal leaves.
    pub(crate) fn bounced(&self, state: State, normal: DVec3) -> State {
        let into = -state.velocity.dot(normal);
        let share = if into * self.restitution < LEAST_REBOUND { 1.0 } else { self.restitution };
        let mut after = State { velocity: state.velocity + normal * (into * (1.0 + share)), ..state };
        if let Some(radius) = self.grip {
            // A solid ball that grips: where it touches it stands still afterwards.
            let along = state.velocity + normal * into;
            let slip = along - (state.spin.cross(normal)) * radius;
            let change = slip * (-2.0 / 7.0);
            after.velocity += change;
            after.spin -= normal.cross(change) * (2.5 / radius);
        }
        after
    }
}

/// When `speed t + fall t^2 / 2` is `gap`.
fn crossings(gap: f64, speed: f64, fall: f64) -> [f64; 2] {
    if fall == 0.0 {
        return [gap / speed, f64::NAN];
    }
    let root = (speed * speed + 2.0 * fall * gap).sqrt();
    [(-speed - root) / fall, (-speed + root) / fall]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arena() -> Arena {
        Arena { low: DVec3::new(-1.0, -2.4, -0.5), high: DVec3::new(1.0, -0.1, 0.5), restitution: 0.8, grip: Some(0.1) }
    }

    fn state() -> State {
        State {
            at: DVec3::new(0.2, -1.0, 0.1),
            velocity: DVec3::new(3.0, -1.0, 0.4),
            turned: DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 1.0)),
            spin: DVec3::new(4.0, 9.0, -3.0),
        }
    }

    fn flight(top: Top) -> Flight {
        Flight::through(&Meeting::none(0.3, state()), top, &arena(), [-1.0, 3.0])
    }

    #[test]
    fn a_flight_is_continuous_falls_and_stays_in_its_arena() {
        let (flight, arena) = (flight(Top::BALL), arena());
        assert!(flight.bounces().len() > 6);
        let step = 1e-4;
        for tick in -10_000..30_000 {
            let t = f64::from(tick) * step;
            let [(before, _), (now, axes), (after, next)] = [t - step, t, t + step].map(|t| flight.place(t));
            assert!(now.cmpge(arena.low - 1e-9).all() && now.cmple(arena.high + 1e-9).all(), "{now} at {t} s");
            assert!((after - now).length() <= flight.speed(t + 0.5 * step, 0.5 * step).origin * step * (1.0 + 1e-6));
            assert!((next.x_axis - axes.x_axis).length() <= 40.0 * step, "at {t} s");
            if flight.bounces().iter().all(|bounce| (bounce - t).abs() > 1.5 * step) {
                let pull = (after - 2.0 * now + before) / (step * step);
                assert!((pull - DVec3::Y * GRAVITY).length() < 1e-4, "{pull} at {t} s");
            }
        }
    }

    #[test]
    fn a_bounce_reverses_the_velocity_and_grip_changes_the_spin() {
        let flight = flight(Top::BALL);
        let mut seen = 0;
        for bounce in flight.bounces().into_iter().filter(|&t| t > 0.31 && t < 2.5) {
            let leg = |t: f64| flight.leg(t).state(bounce);
            let (before, after) = (leg(bounce - 1e-7), leg(bounce + 1e-7));
            // It turns round along the wall's normal, and changes less along the wall.
            let turn = after.velocity - before.velocity;
            let axis = (0..3).max_by(|&a, &b| turn[a].abs().total_cmp(&turn[b].abs())).unwrap();
            let normal = DVec3::AXES[axis] * turn[axis].signum();
            let (into, out) = (-before.velocity.dot(normal), after.velocity.dot(normal));
            let left = out / into;
            assert!((left - 0.8).abs() < 1e-6 || (left - 1.0).abs() < 1e-6, "{left} at {bounce}");
            let touch = |state: &State| {
                let slip = state.velocity - state.spin.cross(normal) * 0.1;
                slip - normal * slip.dot(normal)
            };
            assert!(touch(&after).length() < 1e-9, "it grips");
            let energy = |s: &State| s.velocity.length_squared() + 0.4 * 0.01 * s.spin.length_squared();
            assert!(energy(&after) < energy(&before) + 1e-9);
            seen += 1;
        }
        assert!(seen > 4);
    }

    #[test]
    fn angular_momentum_and_energy_of_a_free_top_are_constant() {
        for top in [Top::rod(DVec3::X, 0.02, 0.2), Top::disc(DVec3::Z), Top::square_box(DVec3::Y, 0.08, 0.15)] {
            let leg = Leg::new(0.0, &state(), top, DVec3::ZERO);
            let step = 1e-5;
            let mut first: Option<(DVec3, f64)> = None;
            for tick in 0..200 {
                let t = f64::from(tick) * 0.01;
                let now = leg.state(t);
                // The spin is what turns the pose.
                let turn = (leg.state(t + step).turned * leg.state(t - step).turned.inverse()).to_scaled_axis();
                assert!((turn / (2.0 * step) - now.spin).length() < 1e-5, "{turn} and {}", now.spin);
                let axis = now.turned * top.axis;
                let along = axis * now.spin.dot(axis);
                let momentum = (now.spin - along) + along * top.ratio;
                let energy = momentum.dot(now.spin);
                let (m, e) = *first.get_or_insert((momentum, energy));
                assert!((momentum - m).length() < 1e-9 && (energy - e).abs() < 1e-9);
            }
        }
    }
}
