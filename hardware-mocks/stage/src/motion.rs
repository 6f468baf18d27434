//! Where things are: closed forms of time, without state.
//!
//! All times are seconds on the session clock, positive or negative. The ball bounces without loss between the floor
//! and the walls of its corridor, so that a take of any length shows a throw.

use glam::{DMat3, DVec3};

/// Acceleration of free fall, metres per second squared. Down is +y.
pub const GRAVITY: f64 = 9.81;

/// The thrown ball: parabolas between bounces, constant spin.
#[derive(Clone, Debug, PartialEq)]
pub struct Ball {
    /// Radius, metres.
    pub radius: f64,
    /// Range of the centre along x, metres; it turns round at either end.
    pub x_range: [f64; 2],
    /// Range of the centre along z, metres.
    pub z_range: [f64; 2],
    /// Position of the centre at time 0 along x and z, metres.
    pub start: [f64; 2],
    /// Velocity at time 0 along x and z, metres per second.
    pub velocity: [f64; 2],
    /// Height of the apex above the lowest position, metres.
    pub apex: f64,
    /// Time since the last touch of the floor at time 0, seconds.
    pub since_bounce: f64,
    /// Axis of the spin, a unit vector.
    pub spin_axis: DVec3,
    /// Rate of the spin, radians per second.
    pub spin: f64,
}

impl Default for Ball {
    fn default() -> Self {
        Self {
            radius: 0.13,
            x_range: [-1.7, 1.7],
            z_range: [-0.4, 0.15],
            start: [-1.05, -0.3],
            velocity: [4.6, 0.7],
            apex: 1.2,
            since_bounce: 0.32,
            spin_axis: DVec3::new(0.25, 0.35, 0.9).normalize(),
            spin: 11.0,
        }
    }
}

impl Ball {
    /// Position of the centre, metres.
    #[must_use]
    pub fn centre(&self, t: f64) -> DVec3 {
        let x = there_and_back(self.start[0] + self.velocity[0] * t, self.x_range);
        let z = there_and_back(self.start[1] + self.velocity[1] * t, self.z_range);
        let up = self.take_off_speed();
        let u = (t + self.since_bounce).rem_euclid(self.flight_seconds());
        DVec3::new(x, -(self.radius + up * u - 0.5 * GRAVITY * u * u), z)
    }

    /// Rotation from the ball's own axes to the world's.
    #[must_use]
    pub fn rotation(&self, t: f64) -> DMat3 {
        DMat3::from_axis_angle(self.spin_axis, self.spin * t)
    }

    /// Seconds from one touch of the floor to the next.
    #[must_use]
    pub fn flight_seconds(&self) -> f64 {
        2.0 * self.take_off_speed() / GRAVITY
    }

    /// No point of the ball moves faster than this, metres per second.
    #[must_use]
    pub fn speed_limit(&self) -> f64 {
        self.centre_speed_limit() + self.spin.abs() * self.radius
    }

    /// The centre moves no faster than this, metres per second.
    #[must_use]
    pub fn centre_speed_limit(&self) -> f64 {
        let [vx, vz] = self.velocity;
        (vx * vx + vz * vz + self.take_off_speed().powi(2)).sqrt()
    }

    fn take_off_speed(&self) -> f64 {
        (2.0 * GRAVITY * self.apex).sqrt()
    }
}

/// `x` folded into a range as a ball that turns round at both ends.
pub(crate) fn there_and_back(x: f64, [low, high]: [f64; 2]) -> f64 {
    let width = high - low;
    let u = (x - low).rem_euclid(2.0 * width);
    low + if u > width { 2.0 * width - u } else { u }
}

/// The fan: pitched blades about an axis, turning at a constant rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Fan {
    /// How many blades it has.
    pub count: usize,
    /// Position of the hub, metres.
    pub centre: DVec3,
    /// Unit vector from the hub to where the air goes.
    pub axis: DVec3,
    /// Distances of a blade's root and tip from the axis, metres.
    pub blade_span: [f64; 2],
    /// Greatest width of a blade, metres.
    pub blade_width: f64,
    /// Angle between a blade and the plane of rotation, radians.
    pub pitch: f64,
    /// Rate of turning, radians per second.
    pub rate: f64,
    /// Angle of the first blade at time 0, radians.
    pub phase: f64,
}

impl Default for Fan {
    fn default() -> Self {
        Self {
            count: 4,
            centre: DVec3::new(-0.85, -1.12, 0.72),
            axis: DVec3::new(0.25, -0.05, -1.0).normalize(),
            blade_span: [0.06, 0.4],
            blade_width: 0.21,
            pitch: 0.35,
            rate: 2.4 * std::f64::consts::TAU,
            phase: 0.3,
        }
    }
}

/// One blade at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BladePose {
    /// Unit vector along the blade, from the axis outwards.
    pub along: DVec3,
    /// Unit vector across the blade.
    pub across: DVec3,
    /// Unit normal of the blade.
    pub normal: DVec3,
}

impl Fan {
    /// The blades at a time.
    #[must_use]
    pub fn blades(&self, t: f64) -> Vec<BladePose> {
        (0..self.count).map(|number| self.blade(t, number)).collect()
    }

    /// One of the blades at a time.
    #[must_use]
    pub fn blade(&self, t: f64, number: usize) -> BladePose {
        // The angle is reduced first, so that the sine of a large time keeps its digits.
        let turned = (self.rate * t).rem_euclid(std::f64::consts::TAU) + self.phase;
        let u = self.axis.cross(DVec3::Y).normalize();
        let v = self.axis.cross(u);
        let (pitch_sin, pitch_cos) = self.pitch.sin_cos();
        let angle = turned + number as f64 * std::f64::consts::TAU / self.count as f64;
        let (sin, cos) = angle.sin_cos();
        let along = u * cos + v * sin;
        let across = (v * cos - u * sin) * pitch_cos + self.axis * pitch_sin;
        BladePose { along, across, normal: along.cross(across) }
    }

    /// Half the width of a blade at `distance` (metres) from the axis: a leaf, widest past its middle.
    #[must_use]
    pub fn half_width(&self, distance: f64) -> f64 {
        leaf_half_width(self.blade_span, self.blade_width, distance)
    }

    /// No point of a blade moves faster than this, metres per second.
    #[must_use]
    pub fn speed_limit(&self) -> f64 {
        self.rate.abs() * self.blade_span[1].hypot(0.5 * self.blade_width)
    }
}

/// Half the width of a leaf from `root` to `tip` whose greatest width is `width`, at a distance from its root's end, metres.
pub(crate) fn leaf_half_width([root, tip]: [f64; 2], width: f64, distance: f64) -> f64 {
    let u = ((distance - root) / (tip - root)).clamp(0.0, 1.0);
    0.5 * width * ((0.25 + 1.9 * u) * (1.0 - u.powi(4))).clamp(0.0, 1.0).sqrt()
}

/// The pendulum: a rod with a ball (the bob) at its end, in the harmonic motion of small swings.
#[derive(Clone, Debug, PartialEq)]
pub struct Pendulum {
    /// Where the rod hangs from, metres.
    pub pivot: DVec3,
    /// Distance from the pivot to the centre of the bob, metres.
    pub length: f64,
    /// Radius of the rod, metres.
    pub rod_radius: f64,
    /// Radius of the bob, metres.
    pub bob_radius: f64,
    /// Horizontal unit vector along which it swings.
    pub swing: DVec3,
    /// Greatest angle from the vertical, radians.
    pub amplitude: f64,
    /// Phase of the swing at time 0, radians; the angle is `amplitude * cos(rate t + phase)`.
    pub phase: f64,
}

impl Default for Pendulum {
    fn default() -> Self {
        Self {
            pivot: DVec3::new(0.72, -2.1, 0.68),
            length: 1.0,
            rod_radius: 0.016,
            bob_radius: 0.12,
            swing: DVec3::new(0.97, 0.0, 0.24).normalize(),
            amplitude: 0.62,
            phase: 0.75,
        }
    }
}

/// The pendulum at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PendulumPose {
    /// Unit vector from the pivot to the bob.
    pub along: DVec3,
    /// Centre of the bob, metres.
    pub bob: DVec3,
    /// Rotation from the bob's own axes to the world's: it swings with the rod.
    pub rotation: DMat3,
}

impl Pendulum {
    /// Angular frequency of small swings, `sqrt(g / length)`, radians per second.
    #[must_use]
    pub fn rate(&self) -> f64 {
        (GRAVITY / self.length).sqrt()
    }

    /// Angle from the vertical, radians, positive towards [`Pendulum::swing`].
    #[must_use]
    pub fn angle(&self, t: f64) -> f64 {
        self.amplitude * ((self.rate() * t).rem_euclid(std::f64::consts::TAU) + self.phase).cos()
    }

    /// The rod and the bob at a time.
    #[must_use]
    pub fn pose(&self, t: f64) -> PendulumPose {
        let angle = self.angle(t);
        let along = self.swing * angle.sin() + DVec3::Y * angle.cos();
        let axis = DVec3::Y.cross(self.swing);
        PendulumPose { along, bob: self.pivot + along * self.length, rotation: DMat3::from_axis_angle(axis, angle) }
    }

    /// No point of the pendulum moves faster than this, metres per second.
    #[must_use]
    pub fn speed_limit(&self) -> f64 {
        (self.amplitude * self.rate()).abs() * (self.length + self.bob_radius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ball_falls_with_gravity_between_bounces() {
        let ball = Ball::default();
        let step = 1e-3;
        for tick in 0..3000 {
            let t = f64::from(tick) * step - 1.0;
            let since = (t - step + ball.since_bounce).rem_euclid(ball.flight_seconds());
            if since + 2.0 * step > ball.flight_seconds() {
                continue;
            }
            let [before, now, after] = [t - step, t, t + step].map(|t| ball.centre(t).y);
            let acceleration = (after - 2.0 * now + before) / (step * step);
            assert!((acceleration - GRAVITY).abs() < 1e-6, "{acceleration} m/s2 at {t} s");
        }
    }

    #[test]
    fn the_ball_stays_in_its_corridor_for_ever_and_is_fast() {
        let ball = Ball::default();
        for tick in -20_000..20_000 {
            let t = f64::from(tick) * 0.0137;
            let at = ball.centre(t);
            assert!(at.x >= ball.x_range[0] && at.x <= ball.x_range[1], "{at} at {t} s");
            assert!(at.z >= ball.z_range[0] && at.z <= ball.z_range[1], "{at} at {t} s");
            assert!(at.y <= -ball.radius + 1e-12 && at.y >= -ball.radius - ball.apex - 1e-12, "{at} at {t} s");
        }
        let speed = (ball.centre(0.301) - ball.centre(0.3)).length() / 1e-3;
        assert!((4.5..8.0).contains(&speed), "{speed} m/s");
    }

    #[test]
    fn nothing_moves_faster_than_its_speed_limit() {
        let (ball, fan, pendulum) = (Ball::default(), Fan::default(), Pendulum::default());
        let step = 1e-4;
        for tick in 0..20_000 {
            let t = f64::from(tick) * step;
            assert!(
                (ball.centre(t + step) - ball.centre(t)).length() <= ball.centre_speed_limit() * step * (1.0 + 1e-9)
            );
            let tip = |t| fan.blades(t)[0].along * fan.blade_span[1];
            assert!((tip(t + step) - tip(t)).length() <= fan.speed_limit() * step);
            assert!((pendulum.pose(t + step).bob - pendulum.pose(t).bob).length() <= pendulum.speed_limit() * step);
        }
    }

    #[test]
    fn the_pendulum_obeys_its_equation_of_motion() {
        let pendulum = Pendulum::default();
        let step = 1e-3;
        for tick in 0..2000 {
            let t = f64::from(tick) * step;
            let acceleration =
                (pendulum.angle(t + step) - 2.0 * pendulum.angle(t) + pendulum.angle(t - step)) / (step * step);
            assert!((acceleration + GRAVITY / pendulum.length * pendulum.angle(t)).abs() < 1e-4);
            let pose = pendulum.pose(t);
            assert!(((pose.bob - pendulum.pivot).length() - pendulum.length).abs() < 1e-12);
            assert!((pose.rotation * DVec3::Y - pose.along).length() < 1e-12, "the bob turns with the rod");
        }
    }

    #[test]
    fn blades_are_orthonormal_and_turn_at_the_nominal_rate() {
        let fan = Fan::default();
        let turn = std::f64::consts::TAU / fan.rate;
        for tick in 0..100 {
            let t = f64::from(tick) * 0.031;
            for (now, later) in fan.blades(t).into_iter().zip(fan.blades(t + turn)) {
                assert!(now.along.dot(now.across).abs() < 1e-12 && (now.normal.length() - 1.0).abs() < 1e-12);
                assert!((now.along - later.along).length() < 1e-9);
            }
        }
    }
}
