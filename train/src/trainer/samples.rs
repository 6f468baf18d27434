//! Which frame or event pair each slot of an iteration's batch is. A pure function of seed, iteration and slot, so that a
//! resumed run draws what the uninterrupted one would have drawn.

use erfgs_base::random;

use crate::{
    config::{Config, Pairing},
    scene::Scene,
    schedule::Stage,
};

const KIND: u64 = 0x6b69_6e64;
const PAIR: u64 = 0x7061_6972;
const FRAME: u64 = 0x0066_7261_6d65;
const EVENT: u64 = 0x0065_7665_6e74;

/// A training sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sample {
    /// A frame: its index in the scene.
    Frame(usize),
    /// A pair of bin edges of an event view.
    Event {
        /// Index of the event view.
        view: usize,
        /// First edge.
        from: usize,
        /// Second edge, later.
        to: usize,
    },
}

/// The sample of slot `slot` of the batch of `iteration` (0-based) of `stage`.
pub(super) fn draw(scene: &Scene, config: &Config, stage: Stage, iteration: u32, slot: u32) -> Sample {
    let at = u64::from(iteration) * u64::from(config.batch) + u64::from(slot);
    let stage_word = stage as u64;
    let events = stage == Stage::Fine && config.earl.enabled && iteration >= config.earl.from;
    let pairs = if events { scene.events.len() * event_pairs(scene, config) } else { 0 };
    let frames = scene.frames.len();
    let shuffled = |purpose: u64, count: usize| {
        let epoch = at / count as u64;
        let order = random::permutation(random::key(config.seed, &[purpose, stage_word, epoch]), count);
        order[(at % count as u64) as usize]
    };
    if pairs == 0 {
        return Sample::Frame(shuffled(FRAME, frames));
    }
    if config.earl.share > 0.0 {
        return Sample::Frame(shuffled(FRAME, frames));
    }
    // One pool of frames and event anchors, as in the released code.
    let drawn = shuffled(FRAME, frames + pairs);
    match drawn.checked_sub(frames) {
        None => Sample::Frame(drawn),
        Some(pair) => event(scene, config, stage_word, at, pair),
    }
}

/// The event sample that an iteration has besides its frames, where `earl.share` asks for one.
pub(super) fn draw_besides(scene: &Scene, config: &Config, stage: Stage, iteration: u32) -> Option<Sample> {
    let (at, stage_word) = (u64::from(iteration), stage as u64);
    let on = stage == Stage::Fine && config.earl.enabled && iteration >= config.earl.from;
    let pairs = if on { scene.events.len() * event_pairs(scene, config) } else { 0 };
    let drawn = random::uniform(random::key(config.seed, &[KIND, stage_word, at]));
    if pairs == 0 || drawn >= f64::from(config.earl.share) {
        return None;
    }
    let pair = random::uniform(random::key(config.seed, &[PAIR, stage_word, at])) * pairs as f64;
    Some(event(scene, config, stage_word, at, (pair as usize).min(pairs - 1)))
}

/// First times that an event pair can have.
fn event_pairs(scene: &Scene, config: &Config) -> usize {
    match config.earl.pairing {
        // The last frame has no interval after it.
        Pairing::FrameAnchored => scene.bins.anchors.len().saturating_sub(1),
        Pairing::Any | Pairing::Level => scene.bins.len(),
    }
}

fn event(scene: &Scene, config: &Config, stage: u64, at: u64, pair: usize) -> Sample {
    let starts = event_pairs(scene, config);
    let (view, start) = (pair / starts, pair % starts);
    let from = match config.earl.pairing {
        Pairing::FrameAnchored => scene.bins.anchors[start],
        Pairing::Any | Pairing::Level => start,
    };
    // Within what the camera recorded.
    let [first, last] = scene.events[view].covers;
    let from = from.clamp(first, last - 1);
    if config.earl.pairing == Pairing::Level {
        return Sample::Event { view, from, to: from + 1 };
    }
    let longest = scene.bins.per_interval.min(last - from).max(1);
    let length = random::uniform(random::key(config.seed, &[EVENT, stage, at])) * longest as f64;
    Sample::Event { view, from, to: from + 1 + (length as usize).min(longest - 1) }
}
