//! A figure of capsules that walks, runs or throws: joints that swing, one after the other.
//!
//! Its limbs move in planes along its heading. It stands on whichever foot is lower.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DMat3, DVec3};

use super::Speed;
use crate::motion::there_and_back;

/// How a figure moves.
#[derive(Clone, Debug)]
pub(crate) struct Figure {
    /// Where it is half way through, metres on the floor: x and z.
    pub middle: [f64; 2],
    /// When that is, seconds.
    pub half: f64,
    /// Unit vector along the floor.
    pub heading: DVec3,
    /// Metres per second.
    pub speed: f64,
    /// Strides a second.
    pub hertz: f64,
    /// How far thighs and arms swing, and how far knees bend, radians.
    pub swing: f64,
    pub knee: f64,
    /// How far elbows are bent, and how far the back is, radians.
    pub elbow: f64,
    pub lean: f64,
    /// Phase of the stride, radians.
    pub phase: f64,
    /// When the right arm throws, seconds; it swings without.
    pub throws: Option<f64>,
}

/// The limbs there are; those that come in pairs have a side of -1 or 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Limb {
    Torso,
    Head,
    UpperArm(f64),
    Forearm(f64),
    Thigh(f64),
    Shin(f64),
    Foot(f64),
}

/// How far from the middle of a take it may go before it turns round, metres.
const FARTHEST: f64 = 1.2;
const HIP: f64 = 0.09;
const SHOULDER: f64 = 0.17;
/// A throw takes so long, seconds, from behind the head to before the chest, radians.
const THROW: f64 = 0.3;
const BACK: f64 = 4.1;
const FRONT: f64 = 0.7;

impl Limb {
    /// All of them.
    pub(crate) fn all() -> Vec<Self> {
        let pairs: [fn(f64) -> Self; 5] = [Self::UpperArm, Self::Forearm, Self::Thigh, Self::Shin, Self::Foot];
        let pairs = pairs.into_iter().flat_map(|limb| [limb(-1.0), limb(1.0)]);
        [Self::Torso, Self::Head].into_iter().chain(pairs).collect()
    }

    /// Its name.
    pub(crate) fn name(self) -> String {
        let (name, side) = match self {
            Self::Torso => return "torso".to_owned(),
            Self::Head => return "head".to_owned(),
            Self::UpperArm(side) => ("upper-arm", side),
            Self::Forearm(side) => ("forearm", side),
            Self::Thigh(side) => ("thigh", side),
            Self::Shin(side) => ("shin", side),
            Self::Foot(side) => ("foot", side),
        };
        format!("{}-{name}", if side < 0.0 { "left" } else { "right" })
    }

    /// The distance between its joints and its radius, metres.
    pub(crate) fn size(self) -> [f64; 2] {
        match self {
            Self::Torso => [0.36, 0.1],
            Self::Head => [0.05, 0.095],
            Self::UpperArm(_) => [0.23, 0.042],
            Self::Forearm(_) => [0.22, 0.036],
            Self::Thigh(_) => [0.34, 0.062],
            Self::Shin(_) => [0.34, 0.048],
            Self::Foot(_) => [0.12, 0.034],
        }
    }
}

impl Figure {
    /// The angle of a limb, radians from straight down, forwards.
    fn angle(&self, limb: Limb, t: f64) -> f64 {
        let stride = |side: f64| (TAU * self.hertz * t).rem_euclid(TAU) + self.phase + FRAC_PI_2 * side;
        match limb {
            // From the hips upwards.
            Limb::Torso | Limb::Head => TAU * 0.5 - self.lean,
            Limb::UpperArm(side) => match self.throws {
                Some(at) if side > 0.0 => {
                    let u = ((t - at) / THROW + 0.5).clamp(0.0, 1.0);
                    BACK + (FRONT - BACK) * u * u * (3.0 - 2.0 * u)
                }
                _ => -self.swing * stride(side).sin(),
            },
            Limb::Forearm(side) => self.angle(Limb::UpperArm(side), t) + self.elbow,
            Limb::Thigh(side) => self.swing * stride(side).sin(),
            Limb::Shin(side) => self.angle(Limb::Thigh(side), t) - self.knee * (0.5 + 0.5 * (stride(side) + 0.4).cos()),
            Limb::Foot(side) => self.angle(Limb::Shin(side), t) + FRAC_PI_2,
        }
    }

    /// A bound on how fast that changes, radians per second.
    fn rate(&self, limb: Limb) -> f64 {
        let stride = TAU * self.hertz;
        match limb {
            Limb::Torso | Limb::Head => 0.0,
            Limb::UpperArm(side) | Limb::Forearm(side) => match self.throws {
                Some(_) if side > 0.0 => 1.5 * (BACK - FRONT) / THROW,
                _ => self.swing * stride,
            },
            Limb::Thigh(_) => self.swing * stride,
            Limb::Shin(_) | Limb::Foot(_) => (self.swing + 0.5 * self.knee) * stride,
        }
    }

    fn direction(&self, limb: Limb, t: f64) -> DVec3 {
        let (sin, cos) = self.angle(limb, t).sin_cos();
        DVec3::Y * cos + self.heading * sin
    }

    /// From one joint of a limb to the next.
    fn span(&self, limb: Limb, t: f64) -> DVec3 {
        self.direction(limb, t) * limb.size()[0]
    }

    fn hips(&self, t: f64) -> DVec3 {
        let way = there_and_back(self.speed * (t - self.half), [-FARTHEST, FARTHEST]);
        let floor = DVec3::new(self.middle[0], 0.0, self.middle[1]) + self.heading * way;
        // As high as the lower foot allows.
        let reach = [-1.0, 1.0].map(|side| {
            let ankle = (self.span(Limb::Thigh(side), t) + self.span(Limb::Shin(side), t)).y;
            let toe = ankle + self.span(Limb::Foot(side), t).y + Limb::Foot(side).size()[1];
            toe.max(ankle + Limb::Shin(side).size()[1])
        });
        floor - DVec3::Y * reach[0].max(reach[1])
    }

    pub(crate) fn place(&self, limb: Limb, t: f64) -> (DVec3, DMat3) {
        let lateral = self.heading.cross(DVec3::Y);
        let hips = self.hips(t);
        let neck = || hips + self.span(Limb::Torso, t) + self.direction(Limb::Torso, t) * 0.05;
        let joint = match limb {
            Limb::Torso => hips - self.direction(limb, t) * -0.03,
            Limb::Head => neck() + self.direction(limb, t) * 0.15,
            Limb::UpperArm(side) => neck() - self.direction(Limb::Torso, t) * 0.07 + lateral * (SHOULDER * side),
            Limb::Forearm(side) => {
                let shoulder = neck() - self.direction(Limb::Torso, t) * 0.07 + lateral * (SHOULDER * side);
                shoulder + self.span(Limb::UpperArm(side), t)
            }
            Limb::Thigh(side) => hips + lateral * (HIP * side),
            Limb::Shin(side) => hips + lateral * (HIP * side) + self.span(Limb::Thigh(side), t),
            Limb::Foot(side) => {
                hips + lateral * (HIP * side) + self.span(Limb::Thigh(side), t) + self.span(Limb::Shin(side), t)
            }
        };
        let along = self.direction(limb, t);
        let axes = DMat3::from_cols(along.cross(lateral), along, lateral);
        (joint + self.span(limb, t) * 0.5, axes)
    }

    /// A bound on the speed of a limb.
    pub(crate) fn speed(&self, limb: Limb) -> Speed {
        let leg = |side: f64| {
            [Limb::Thigh(side), Limb::Shin(side), Limb::Foot(side)].map(|limb| self.rate(limb) * limb.size()[0])
        };
        let hips: f64 = self.speed + leg(1.0).iter().sum::<f64>();
        let chain: f64 = match limb {
            Limb::Torso | Limb::Head => 0.0,
            Limb::UpperArm(side) | Limb::Forearm(side) => {
                [Limb::UpperArm(side), Limb::Forearm(side)].map(|limb| self.rate(limb) * limb.size()[0]).iter().sum()
            }
            Limb::Thigh(side) | Limb::Shin(side) | Limb::Foot(side) => leg(side).iter().sum(),
        };
        Speed { origin: hips + chain, turn: self.rate(limb) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limbs_hang_together_stand_on_the_floor_and_keep_their_limits() {
        let figure = Figure {
            middle: [0.0, 0.0],
            half: 0.3,
            heading: DVec3::new(0.8, 0.0, 0.6),
            speed: 2.0,
            hertz: 1.5,
            swing: 0.7,
            knee: 1.2,
            elbow: 1.3,
            lean: 0.1,
            phase: 0.4,
            throws: Some(0.4),
        };
        let step = 1e-4;
        for tick in 0..6000 {
            let t = f64::from(tick) * step;
            let mut lowest = f64::NEG_INFINITY;
            for limb in Limb::all() {
                let ((at, axes), [length, radius]) = (figure.place(limb, t), limb.size());
                let end = |share: f64| at + axes.y_axis * (share * length);
                lowest = lowest.max(end(0.5).y.max(end(-0.5).y) + radius);
                let (next, turned) = figure.place(limb, t + step);
                assert!((next - at).length() <= figure.speed(limb).origin * step, "{limb:?} at {t} s");
                assert!(
                    (turned.y_axis - axes.y_axis).length() <= figure.speed(limb).turn * step * (1.0 + 1e-6) + 1e-12
                );
                if let Limb::Shin(side) = limb {
                    let (thigh, turned) = figure.place(Limb::Thigh(side), t);
                    let knee = thigh + turned.y_axis * (0.5 * Limb::Thigh(side).size()[0]);
                    assert!((knee - end(-0.5)).length() < 1e-9);
                }
            }
            assert!((-0.02..1e-9).contains(&lowest), "{lowest} at {t} s");
        }
    }
}
