//! How fast a thing turns: what frames say, what events say, and both together.

use std::collections::BTreeMap;

use erfgs_dataset::Body;
use glam::DVec3;
use serde_json::{Value, json};

use super::{
    contrast::{Window, contrasts},
    shades::Compared,
    turn::{climb, rates},
};

/// Directions that are tried, by frames and by events.
const FRAME_DIRECTIONS: usize = 60;
const EVENT_DIRECTIONS: usize = 80;
/// Turns from one instant to the next that are tried by frames, degrees.
const FRAME_TURNS_DEG: [f64; 10] = [12.0, 28.0, 44.0, 60.0, 76.0, 92.0, 108.0, 124.0, 140.0, 156.0];
/// Rates that are tried by events, radians per second.
const EVENT_RATES: [f64; 10] = [3.0, 5.0, 8.0, 11.5, 15.0, 21.0, 28.0, 37.0, 48.0, 62.0];
/// So many hypotheses by frames are improved, which differ by at least so many radians from one instant to the next.
const KEPT: usize = 6;
/// The first step by which they are improved, radians from one instant to the next.
const FIRST_STEP: f64 = 0.12;
const APART: f64 = 0.45;
/// So many by events.
const KEPT_BY_EVENTS: usize = 40;
/// By frames alone a thing turns if its colours are so much nearer to one another than if it did not.
const BY_FRAMES: f64 = 0.95;
/// How much more the contrast of events weighs than the colours of frames, and by how much both must be better than without a turn.
const EVENTS_WEIGH: f64 = 10.0;
const BETTER: f64 = 0.1;
/// Where frames show a turn, so much of what it brings colours nearer must be brought by one that events show.
const SHARED: f64 = 0.7;
/// A contrast without a turn that is so near to the best tells nothing.
const FLAT: f64 = 0.985;

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Spin {
    /// Axis times rate, radians per second; zero if none was found.
    pub rate: DVec3,
    /// The best rate that was looked at, taken or not; zero if there was nothing to look at.
    pub looked_at: DVec3,
    /// What it was found by: numbers for reports.
    pub found_by: BTreeMap<String, Value>,
}

/// How a thing turns, by the frames and windows of events that there are; `step_s` is the usual time between instants. `compared` are
/// neighbouring instants, and then those that are farther apart, if they are to be.
pub fn spin(compared: &[&dyn Compared], windows: &[&Window], step_s: f64) -> Spin {
    let mut spin = Spin::default();
    let mut note = |name: &str, value: Value| {
        spin.found_by.insert(name.into(), value);
    };
    let by_frames = by_frames(compared, step_s);
    if let Some(best) = by_frames.first() {
        spin.looked_at = best.1;
        note("rate_by_frames_rad_s", vector(best.1));
        note("colours_apart_to_no_turn", json!(rounded(best.0, 3)));
    }
    note("event_windows", json!(windows.len()));
    let frames_tell = by_frames.first().filter(|best| best.0 < BY_FRAMES);
    if windows.is_empty() {
        match (frames_tell, by_frames.first()) {
            (Some(best), _) => {
                spin.rate = best.1;
                spin.found_by.insert("rotation".into(), json!("by frames"));
            }
            (None, Some(_)) => {
                let why = "not determined: frames show no rotating texture, and there are too few events";
                spin.found_by.insert("rotation".into(), json!(why));
            }
            (None, None) => {
                let why = "not determined: too few points or instants, and too few events";
                spin.found_by.insert("rotation".into(), json!(why));
            }
        }
        return spin;
    }
    let mut tried = rates(EVENT_DIRECTIONS, &EVENT_RATES);
    tried.extend(by_frames.iter().map(|best| best.1));
    let contrast = contrasts(windows, &tried);
    let top = contrast.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let mut order: Vec<usize> = (0..tried.len()).collect();
    order.sort_by(|&a, &b| contrast[b].total_cmp(&contrast[a]));
    let colours = |rates: &[DVec3]| -> Vec<f64> {
        let Some(shades) = compared.last() else { return vec![1.0; rates.len()] };
        let still = shades.apart(&[DVec3::ZERO])[0].max(f64::MIN_POSITIVE);
        shades.apart(rates).into_iter().map(|apart| apart / still).collect()
    };
    // Events of what passes before a thing or behind it are sharp at other rates. Where frames show how it turns, a rate is its own only
    // if it brings colours nearer to one another, too.
    let nearest = frames_tell.map_or(f64::INFINITY, |best| 1.0 - SHARED * (1.0 - best.0));
    let score = |rates: &[DVec3]| -> Vec<f64> {
        let one = |(apart, sharp): (f64, f64)| {
            if apart > nearest { f64::NEG_INFINITY } else { EVENTS_WEIGH * sharp / top - apart }
        };
        std::iter::zip(colours(rates), contrasts(windows, rates)).map(one).collect()
    };
    let kept: Vec<DVec3> = order.iter().take(KEPT_BY_EVENTS).map(|&index| tried[index]).collect();
    let candidates: Vec<DVec3> =
        [DVec3::ZERO].into_iter().chain(by_frames.iter().map(|best| best.1)).chain(kept).collect();
    let scores = score(&candidates);
    let mut best = (f64::NEG_INFINITY, DVec3::ZERO);
    for (&rate, &score) in std::iter::zip(&candidates, &scores) {
        if score > best.0 {
            best = (score, rate);
        }
    }
    let best = climb(best, 3.0, 4, score);
    let [still, sharp]: [f64; 2] = {
        let both = contrasts(windows, &[DVec3::ZERO, best.1]);
        let most = both[1].max(top);
        [both[0] / most, both[1] / most]
    };
    let mut apart: Vec<(DVec3, f64)> = Vec::new();
    for &index in &order {
        if apart.iter().all(|(rate, _)| rate.distance(tried[index]) > 6.0) {
            apart.push((tried[index], contrast[index] / top));
        }
        if apart.len() >= KEPT {
            break;
        }
    }
    if best.1 != DVec3::ZERO {
        spin.looked_at = best.1;
    }
    spin.found_by.insert("rate_by_events_rad_s".into(), vector(best.1));
    spin.found_by.insert("contrast_without_turn".into(), json!(rounded(still, 3)));
    spin.found_by.insert("contrast_with_turn".into(), json!(rounded(sharp, 3)));
    let hypotheses =
        apart.iter().map(|(rate, contrast)| json!({"rate_rad_s": vector(*rate), "contrast": rounded(*contrast, 3)}));
    spin.found_by.insert("hypotheses".into(), hypotheses.collect());
    let why = if still > FLAT && frames_tell.is_none() {
        "not determined: events are as sharp without rotation, and frames show no rotating texture"
    } else if best.0 > scores[0] + BETTER {
        spin.rate = best.1;
        if compared.is_empty() { "by events" } else { "by events and frames" }
    } else {
        "none found: events and frames fit as well without rotation"
    };
    spin.found_by.insert("rotation".into(), json!(why));
    spin
}

/// The best rates by colours: how far they are apart compared with no turn, and the rate.
fn by_frames(all: &[&dyn Compared], step_s: f64) -> Vec<(f64, DVec3)> {
    let Some(shades) = all.first() else { return Vec::new() };
    let turns = FRAME_TURNS_DEG.map(|degrees| degrees.to_radians() / step_s);
    let tried = rates(FRAME_DIRECTIONS, &turns);
    let apart = shades.apart(&tried);
    let mut order: Vec<usize> = (0..tried.len()).collect();
    order.sort_by(|&a, &b| apart[a].total_cmp(&apart[b]));
    let mut kept: Vec<usize> = Vec::new();
    for index in order.into_iter().take(40) {
        if kept.len() < KEPT && kept.iter().all(|&other| tried[other].distance(tried[index]) > APART / step_s) {
            kept.push(index);
        }
    }
    let mut best: Vec<(f64, DVec3)> =
        kept.into_iter().map(|index| climbed(all, (apart[index], tried[index]), step_s)).collect();
    let still = all.last().map_or(1.0, |last| last.apart(&[DVec3::ZERO])[0].max(f64::MIN_POSITIVE));
    best.iter_mut().for_each(|best| best.0 /= still);
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    best
}

/// A rate improved by colours of neighbouring instants, and then by those of farther and farther ones: how far they are apart, and the
/// rate.
fn climbed(all: &[&dyn Compared], (mut apart, mut rate): (f64, DVec3), step_s: f64) -> (f64, DVec3) {
    for (longer, shades) in all.iter().enumerate() {
        let nearer = |rates: &[DVec3]| shades.apart(rates).into_iter().map(|apart| -apart).collect::<Vec<_>>();
        if longer > 0 {
            apart = shades.apart(&[rate])[0];
        }
        let first = FIRST_STEP / step_s * 0.5_f64.powi(longer as i32).sqrt();
        let best = climb((-apart, rate), first, 2 + longer as u32, nearer);
        (apart, rate) = (-best.0, best.1);
    }
    (apart, rate)
}

pub(super) fn rounded(value: f64, digits: i32) -> f64 {
    let scale = 10_f64.powi(digits);
    (value * scale).round() / scale
}

/// How a body turns where it is seen best, by those who found it: axis times rate, radians per second.
pub fn noted_rate(body: &Body) -> Option<DVec3> {
    let rate = body.found_by.get("rate_rad_s")?;
    serde_json::from_value::<[f64; 3]>(rate.clone()).ok().map(DVec3::from)
}

pub(super) fn vector(of: DVec3) -> Value {
    json!(of.to_array().map(|value| rounded(value, 2)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::contrast::test_windows;

    /// Colours that are nearest at a rate, where they are so much nearer than without a turn.
    struct Nearest(DVec3, f64);

    impl Compared for Nearest {
        fn apart(&self, rates: &[DVec3]) -> Vec<f64> {
            rates.iter().map(|rate| 100.0 * (1.0 - self.1 * (-rate.distance_squared(self.0) / 18.0).exp())).collect()
        }
    }

    #[test]
    fn events_of_something_else_do_not_tell_how_a_thing_turns_whose_colours_do() {
        let (own, others) = (DVec3::new(6.0, -3.0, 5.0), DVec3::new(-4.0, 14.0, 6.0));
        let windows = test_windows(others, DVec3::X, 0.01);
        let windows: Vec<&Window> = windows.iter().collect();
        let found = |nearer: f64| spin(&[&Nearest(own, nearer)], &windows, 0.07).rate;
        assert!(found(0.3).distance(own) < 3.0, "{}", found(0.3));
        // What is plain turns as events tell.
        assert!(found(0.01).distance(others) < 1.0, "{}", found(0.01));
    }

    #[test]
    fn a_rotation_that_nothing_tells_is_none_and_says_so() {
        let spin = spin(&[], &[], 0.1);
        assert_eq!(spin.rate, DVec3::ZERO);
        assert!(spin.found_by["rotation"].as_str().is_some_and(|why| why.starts_with("not determined")), "{spin:?}");
    }
}
