//! Which frame or event pair each slot of an iteration's batch is. A pure function of seed, iteration and slot, so that a
//! resumed run draws what the uninterrupted one would have drawn.

use erfgs_base::random;

use super::follow::Part;
use crate::{
    config::{Config, Pairing},
    scene::Scene,
    schedule::Stage,
};

const KIND: u64 = 0x6b69_6e64;
const PAIR: u64 = 0x7061_6972;
const FRAME: u64 = 0x0066_7261_6d65;
const EVENT: u64 = 0x0065_7665_6e74;
const PART_FRAME: u64 = random::purpose("a frame of a part of the recording");
const PART_EVENT: u64 = random::purpose("an event pair of a part of the recording");
/// Times that differ by less are the same, of the whole recording.
const SLACK: f64 = 1e-6;
/// So many of the samples lie within the part where there is one.
const IN_PART: f64 = 0.6;
/// Of the iterations with a part so many have an event sample at least, and of those within it so many lie where the part is new.
const PART_EVENTS: f32 = 0.8;
const NEW_PART: f64 = 0.6;

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

/// The sample of slot `slot` of the batch of `iteration` (0-based) of `stage`, more often than not within one of the parts of the recording where there are some.
pub(super) fn draw(scene: &Scene, config: &Config, parts: &[Part], stage: Stage, iteration: u32, slot: u32) -> Sample {
    let at = u64::from(iteration) * u64::from(config.batch) + u64::from(slot);
    let stage_word = stage as u64;
    let part_key = random::key(config.seed, &[PART_FRAME, stage_word, at]);
    if let Some(part) = one_of(parts, part_key).filter(|_| random::uniform(random::extend(part_key, 1)) < IN_PART) {
        let frames = frames_within(scene, part.whole);
        let drawn = random::uniform(part_key);
        return Sample::Frame(frames[((drawn * frames.len() as f64) as usize).min(frames.len() - 1)]);
    }
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

/// One of the parts of the recording that are looked at more often.
fn one_of(parts: &[Part], key: u64) -> Option<&Part> {
    let at = (random::uniform(random::extend(key, 10)) * parts.len() as f64) as usize;
    parts.get(at.min(parts.len().saturating_sub(1)))
}

/// The frames whose exposures lie within a part of the recording; without any, those of the instant nearest to its middle.
fn frames_within(scene: &Scene, [begin, end]: [f64; 2]) -> Vec<usize> {
    let all = 0..scene.frames.len();
    let within = |&frame: &usize| {
        let exposure = scene.frames[frame].exposure;
        exposure[0] >= begin - SLACK && exposure[1] <= end + SLACK
    };
    let frames: Vec<usize> = all.clone().filter(within).collect();
    if !frames.is_empty() {
        return frames;
    }
    let away = |frame: usize| (scene.frames[frame].instant(Some(0.5)) - (begin + end) / 2.0).abs();
    let least = all.clone().map(away).fold(f64::INFINITY, f64::min);
    all.filter(|&frame| away(frame) <= least + SLACK).collect()
}

/// The event sample that an iteration has besides its frames, where `earl.share` asks for one.
pub(super) fn draw_besides(
    scene: &Scene,
    config: &Config,
    parts: &[Part],
    stage: Stage,
    iteration: u32,
) -> Option<Sample> {
    let (at, stage_word) = (u64::from(iteration), stage as u64);
    let on = stage == Stage::Fine && config.earl.enabled && iteration >= config.earl.from;
    let pairs = if on { scene.events.len() * event_pairs(scene, config) } else { 0 };
    let drawn = random::uniform(random::key(config.seed, &[KIND, stage_word, at]));
    // What is new of a part is told by events first.
    let share = if !parts.is_empty() { config.earl.share.max(PART_EVENTS) } else { config.earl.share };
    if pairs == 0 || drawn >= f64::from(share) {
        return None;
    }
    let part_key = random::key(config.seed, &[PART_EVENT, stage_word, at]);
    if let Some(part) = one_of(parts, part_key).filter(|_| random::uniform(random::extend(part_key, 9)) < IN_PART) {
        return event_within(scene, config, part, part_key);
    }
    let pair = random::uniform(random::key(config.seed, &[PAIR, stage_word, at])) * pairs as f64;
    Some(event(scene, config, stage_word, at, (pair as usize).min(pairs - 1)))
}

/// A pair of edges within a part of the recording, more often than not where it grew last; none of a camera that recorded nothing then.
fn event_within(scene: &Scene, config: &Config, part: &Part, key: u64) -> Option<Sample> {
    let drawn = |what: u64| random::uniform(random::extend(key, what));
    let view = ((drawn(0) * scene.events.len() as f64) as usize).min(scene.events.len() - 1);
    let ([begin, end], before) = (part.whole, part.before);
    let grown = [begin, before[0], before[1], end];
    let sides = [grown[1] - grown[0], grown[3] - grown[2]];
    let at = if drawn(1) < NEW_PART && sides[0] + sides[1] > 0.0 {
        let along = drawn(2) * (sides[0] + sides[1]);
        if along < sides[0] { grown[0] + along } else { grown[2] + along - sides[0] }
    } else {
        begin + drawn(2) * (end - begin)
    };
    let edges = &scene.bins.edges;
    // Within what the camera recorded, and within the part.
    let [first, last] = scene.events[view].covers;
    let low = edges.partition_point(|&edge| edge < begin - SLACK).max(first);
    let high = edges.partition_point(|&edge| edge <= end + SLACK).saturating_sub(1).min(last);
    if low >= high {
        return None;
    }
    let longest = if config.earl.pairing == Pairing::Level { 1 } else { scene.bins.per_interval.max(1) };
    let length = 1 + ((drawn(3) * longest as f64) as usize).min(longest - 1);
    // The instant lies between the two edges, anywhere.
    let middle = edges.partition_point(|&edge| edge <= at).saturating_sub(1);
    let back = (drawn(4) * length as f64) as usize;
    let from = middle.saturating_sub(back).clamp(low, high - 1);
    Some(Sample::Event { view, from, to: (from + length).min(high) })
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
