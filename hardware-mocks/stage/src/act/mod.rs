//! Acts: what moves in place of the ball, the fan and the pendulum, by name. A seed varies each.
//!
//! Acts can be combined. Those that need the room's middle share it in depth, each a lane of its own; with more than three of them
//! lanes are narrower than things, which then pass through one another.

mod articulated;
mod cloth;
mod crossing;
mod debris;
mod fan;
mod gloss;
mod pendulum;
mod shadow;
mod squash;
mod throw;
mod tumble;

#[cfg(test)]
mod tests;

use std::{fmt, str::FromStr};

use erfgs_base::random;
use glam::{DQuat, DVec3};

use super::{
    cast::Cast,
    path::{Arena, State},
    set::{Furniture, ROOM_LOW},
};

/// Something that happens on the stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Act {
    /// A fan of 2 to 6 blades, at 2 to 40 turns a second.
    Fan,
    /// Balls, textured and plain, that bounce off the floor and a wall: their velocity jumps, and their spin changes.
    Throw,
    /// Boxes, a rod and a coin in free fall, turning as free tops do.
    Tumble,
    /// A ball on a rod.
    Pendulum,
    /// A figure of capsules that walks, runs or throws.
    Articulated,
    /// A flag: smooth, and not rigid.
    Cloth,
    /// A soft ball that is pressed flat where it bounces.
    Squash,
    /// Forty small pieces from one place, which appear within the take.
    Debris,
    /// Things that pass before one another, and two that touch.
    Crossing,
    /// The soft shadow of a ball that no camera sees.
    Shadow,
    /// Shiny things, whose highlights stay where the lamp is while they move.
    Gloss,
}

impl Act {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Fan,
        Self::Throw,
        Self::Tumble,
        Self::Pendulum,
        Self::Articulated,
        Self::Cloth,
        Self::Squash,
        Self::Debris,
        Self::Crossing,
        Self::Shadow,
        Self::Gloss,
    ];

    /// What it is called on a command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fan => "fan",
            Self::Throw => "throw",
            Self::Tumble => "tumble",
            Self::Pendulum => "pendulum",
            Self::Articulated => "articulated",
            Self::Cloth => "cloth",
            Self::Squash => "squash",
            Self::Debris => "debris",
            Self::Crossing => "crossing",
            Self::Shadow => "shadow",
            Self::Gloss => "gloss",
        }
    }

    /// Whether it needs the middle of the room.
    fn in_the_middle(self) -> bool {
        !matches!(self, Self::Fan | Self::Pendulum | Self::Shadow)
    }

    fn enter(self, script: &mut Script) {
        match self {
            Self::Fan => fan::enter(script),
            Self::Throw => throw::enter(script),
            Self::Tumble => tumble::enter(script),
            Self::Pendulum => pendulum::enter(script),
            Self::Articulated => articulated::enter(script),
            Self::Cloth => cloth::enter(script),
            Self::Squash => squash::enter(script),
            Self::Debris => debris::enter(script),
            Self::Crossing => crossing::enter(script),
            Self::Shadow => shadow::enter(script),
            Self::Gloss => gloss::enter(script),
        }
    }
}

impl fmt::Display for Act {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Act {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        let found = Self::ALL.into_iter().find(|act| act.name() == text);
        found.ok_or_else(|| format!("no act is called `{text}`: choose from {}", known()))
    }
}

/// Where things fly in the middle of the room: the highest and lowest x, metres.
const WINGS: [f64; 2] = [-1.25, 1.25];
/// The middle of the room in depth, metres: what one act alone gets, and what several share.
const ALONE: [f64; 2] = [-0.35, 0.3];
const SHARED: [f64; 2] = [-0.6, 0.45];
/// Before a take's beginning and after its end things still move, seconds: an exposure may reach there.
const MARGIN: f64 = 1.1;

/// What an act works with.
struct Script {
    cast: Cast,
    furniture: Furniture,
    /// Length of the take, seconds.
    seconds: f64,
    /// Its part of the room's middle in depth, metres.
    lane: [f64; 2],
    draw: Draw,
}

impl Script {
    /// Moments of the flights, from before the take to after it.
    fn span(&self) -> [f64; 2] {
        [-MARGIN, self.seconds + MARGIN]
    }

    /// The middle of the lane in depth, metres.
    fn depth(&self) -> f64 {
        0.5 * (self.lane[0] + self.lane[1])
    }

    /// What a ball of this radius may not leave.
    fn arena(&self, radius: f64, restitution: f64) -> Arena {
        let inset = (0.5 * (self.lane[1] - self.lane[0]) - radius).max(0.01);
        Arena {
            low: DVec3::new(WINGS[0], ROOM_LOW.y + radius, self.depth() - inset),
            high: DVec3::new(WINGS[1], -radius, self.depth() + inset),
            restitution,
            grip: None,
        }
    }
}

/// Numbers by chance, each by its own word.
#[derive(Clone, Copy)]
struct Draw(u64);

impl Draw {
    /// Those of one thing among several.
    fn of(self, thing: usize) -> Self {
        Self(random::extend(self.0, 1000 + thing as u64))
    }

    fn range(self, word: u64, from: f64, to: f64) -> f64 {
        random::range(random::extend(self.0, word), from, to)
    }

    fn sign(self, word: u64) -> f64 {
        if self.range(word, -1.0, 1.0) < 0.0 { -1.0 } else { 1.0 }
    }

    /// A direction, any as likely as any other.
    fn direction(self, word: u64) -> DVec3 {
        let y = self.range(word, -1.0, 1.0);
        let (sin, cos) = self.range(word + 100, 0.0, std::f64::consts::TAU).sin_cos();
        let ring = (1.0 - y * y).sqrt();
        DVec3::new(ring * cos, y, ring * sin)
    }

    /// A thing at rest that is turned anyhow.
    fn turned(self, word: u64) -> DQuat {
        DQuat::from_axis_angle(self.direction(word), self.range(word + 200, 0.0, std::f64::consts::PI))
    }

    /// A thing at a place with a velocity, turned anyhow and spinning so fast about a direction of its own.
    fn state(self, at: DVec3, velocity: DVec3, spin: f64) -> State {
        State { at, velocity, turned: self.turned(900), spin: self.direction(901) * spin }
    }
}

const PURPOSE: u64 = random::purpose("stage act");

/// What moves in these acts, and what stands about for it.
pub(crate) fn staged(acts: &[Act], seed: u64, seconds: f64) -> (Cast, Furniture) {
    let mut once: Vec<Act> = Vec::new();
    for act in acts {
        if !once.contains(act) {
            once.push(*act);
        }
    }
    let sharing = once.iter().filter(|act| act.in_the_middle()).count();
    let [near, far] = if sharing > 1 { SHARED } else { ALONE };
    let width = (far - near) / sharing.max(1) as f64;
    let draw = Draw(0);
    let seconds = if seconds.is_finite() { seconds.clamp(0.01, 3600.0) } else { 1.0 };
    let (cast, furniture) = (Cast::default(), Furniture::default());
    let mut script = Script { cast, furniture, seconds, lane: [near, far], draw };
    let mut lane = 0;
    for act in once {
        // What an act does depends on the seed and on itself, not on what else there is.
        script.draw = Draw(random::key(seed, &[PURPOSE, random::purpose(act.name())]));
        if act.in_the_middle() {
            let from = near + width * f64::from(lane);
            script.lane = [from, from + width];
            lane += 1;
        }
        act.enter(&mut script);
    }
    (script.cast, script.furniture)
}
