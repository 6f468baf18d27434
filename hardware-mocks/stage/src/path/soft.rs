//! A soft ball: it is pressed flat where it touches the floor, and trembles after.
//!
//! On the floor it is a spring, so that its height follows a half wave; in the air its height follows a parabola, and its shape a
//! wave that dies out. Position, velocity and shape are continuous everywhere, and its volume is constant.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};

use super::Speed;
use crate::motion::{GRAVITY, there_and_back};

/// A soft ball that bounces without loss, for ever.
#[derive(Clone, Debug)]
pub(crate) struct SoftBall {
    /// Radius of the undisturbed ball, metres.
    pub radius: f64,
    /// Speed at which it meets the floor, metres per second.
    pub speed: f64,
    /// How long it touches the floor, seconds.
    pub contact: f64,
    /// When it first touches the floor, seconds.
    pub first: f64,
    /// Frequency of its trembling, hertz.
    pub hertz: f64,
    /// Range of its centre along x, metres, where it is at time 0, and its speed there.
    pub x: ([f64; 2], f64, f64),
    /// Where its centre is along z, metres.
    pub z: f64,
    /// Axis of its spin, and radians per second.
    pub spin: (DVec3, f64),
}

/// The trembling dies out within so many seconds.
const DECAY: f64 = 0.07;

impl SoftBall {
    /// Seconds from one touch of the floor to the next.
    pub(crate) fn period(&self) -> f64 {
        self.contact + 2.0 * self.speed / GRAVITY
    }

    /// Height of the centre above the floor, metres, and how tall it is as a share of its undisturbed height.
    fn height(&self, t: f64) -> (f64, f64) {
        let since = (t - self.first).rem_euclid(self.period());
        if since < self.contact {
            let pressed = self.speed * self.contact / PI * (PI * since / self.contact).sin();
            return (self.radius - pressed, 1.0 - pressed / self.radius);
        }
        let air = since - self.contact;
        let rate = TAU * self.hertz;
        // As fast at first as the floor leaves it.
        let wave = self.speed / (self.radius * rate) * (-air / DECAY).exp() * (rate * air).sin();
        (self.radius + self.speed * air - 0.5 * GRAVITY * air * air, 1.0 + wave)
    }

    pub(crate) fn place(&self, t: f64) -> (DVec3, DMat3) {
        let (range, start, speed) = self.x;
        let at = DVec3::new(there_and_back(start + speed * t, range), -self.height(t).0, self.z);
        (at, DMat3::from_axis_angle(self.spin.0, self.spin.1 * t))
    }

    /// Its half axes along x, y and z of the world, metres.
    pub(crate) fn axes(&self, t: f64) -> DVec3 {
        let tall = self.height(t).1;
        let wide = tall.recip().sqrt();
        DVec3::new(wide, tall, wide) * self.radius
    }

    pub(crate) fn speed(&self) -> Speed {
        Speed { origin: self.speed.hypot(self.x.2), turn: self.spin.1.abs() }
    }

    /// It is never larger, metres.
    pub(crate) fn reach(&self) -> f64 {
        let flat = 1.0 - self.speed * self.contact / (PI * self.radius);
        let tall = 1.0 + self.speed / (self.radius * TAU * self.hertz);
        self.radius * flat.recip().sqrt().max(tall)
    }

    /// No point of it moves faster because of its shape, metres per second.
    pub(crate) fn bends(&self) -> f64 {
        let flat = 1.0 - self.speed * self.contact / (PI * self.radius);
        self.speed * (1.0 + 0.5 * flat.powf(-1.5))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stays_above_the_floor_keeps_its_volume_and_never_jumps() {
        let ball = SoftBall {
            radius: 0.15,
            speed: 3.6,
            contact: 0.05,
            first: 0.1,
            hertz: 15.0,
            x: ([-1.0, 1.0], 0.0, 1.5),
            z: 0.0,
            spin: (DVec3::X, 4.0),
        };
        let step = 1e-4;
        let mut flattest: f64 = 1.0;
        for tick in 0..30_000 {
            let t = f64::from(tick) * step;
            let ((at, _), axes) = (ball.place(t), ball.axes(t));
            assert!(-at.y - axes.y > -1e-9, "{at} and {axes} at {t} s");
            assert!(
                (axes.element_product() / ball.radius.powi(3) - 1.0).abs() < 1e-9 && axes.max_element() <= ball.reach()
            );
            let (next, after) = (ball.place(t + step).0, ball.axes(t + step));
            assert!((next - at).length() <= ball.speed().origin * step * (1.0 + 1e-9));
            assert!((after - axes).abs().max_element() <= ball.bends() * step);
            flattest = flattest.min(axes.y / ball.radius);
        }
        assert!((0.5..0.75).contains(&flattest), "{flattest}");
    }
}
