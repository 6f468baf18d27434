//! What events tell of their sensor, over a whole recording: how many of them nothing caused, and what an ON event stands for beside an
//! OFF event. Sensors' thresholds for the two differ by tens of per cent, with bias settings and temperature, and are seldom known; leaks
//! make ON events alone. Where counts are added up for long, both carry them away.

/// A pixel with fewer events of either kind tells too little.
const EVENTS: f64 = 4.0;
/// So many pixels must tell.
const PIXELS: usize = 200;
/// A smaller difference from what is stated, of the logarithm, may be of what did not come back.
const LEAST: f64 = 0.15;
/// The share of pixels, of those with the most, that may have seen something after all.
const SEEN: f64 = 0.1;

/// ON and OFF events of a pixel in all that nothing caused: the mean over pixels that have few of the other kind, which what moves makes
/// as many of; 0 where too few pixels tell.
pub(super) fn noise(totals: &[[u32; 2]]) -> [f64; 2] {
    [0, 1].map(|kind| {
        let other = 1 - kind;
        let mut others: Vec<u32> = totals.iter().map(|counts| counts[other]).collect();
        if others.len() < PIXELS {
            return 0.0;
        }
        let middle = others.len() / 2;
        let few = *others.select_nth_unstable(middle).1;
        let mut quiet: Vec<u32> =
            totals.iter().filter(|counts| counts[other] <= few).map(|counts| counts[kind]).collect();
        quiet.sort_unstable();
        let kept = &quiet[..((1.0 - SEEN) * quiet.len() as f64).ceil() as usize];
        kept.iter().copied().map(f64::from).sum::<f64>() / kept.len() as f64
    })
}

/// An ON event's change of light beside that of an OFF event: the median over pixels that had many of both besides `noise`. Where
/// something has passed a pixel sees what it saw before: what ON events added, OFF events took away. Nothing where too few pixels
/// tell, or where they do not agree that it is another than was `stated`.
pub(super) fn ratio(totals: &[[u32; 2]], noise: [f64; 2], stated: f64) -> Option<f64> {
    let caused = totals.iter().map(|counts| [0, 1].map(|kind| f64::from(counts[kind]) - noise[kind]));
    let revealing = caused.filter(|counts| counts.iter().all(|&count| count >= EVENTS));
    let mut logs: Vec<f64> = revealing.map(|[on, off]| (off / on).ln()).collect();
    if logs.len() < PIXELS {
        return None;
    }
    logs.sort_unstable_by(f64::total_cmp);
    let [low, median, high] = [0.25, 0.5, 0.75].map(|share| logs[((logs.len() - 1) as f64 * share).round() as usize]);
    // Three quarters of the pixels must agree on which side of what is stated it lies.
    let stated = stated.ln();
    let agreed = low > stated || high < stated;
    (agreed && (median - stated).abs() > LEAST).then(|| median.exp())
}

/// From so many events of either kind on, a pixel tells of its own thresholds.
const MANY: u32 = 50;

/// ON and OFF events of pixels between edges at which the light of a lamp was the same, wherever nothing else had changed.
#[derive(Debug)]
pub(super) struct Returns {
    /// All events up to the last edge.
    last: Vec<[u32; 2]>,
    counts: Vec<[u32; 2]>,
}

impl Returns {
    /// Of so many pixels without events yet.
    pub fn new(pixels: usize) -> Self {
        Self { last: vec![[0; 2]; pixels], counts: vec![[0; 2]; pixels] }
    }

    /// Another edge, up to which there were so many events in all.
    pub fn edge(&mut self, now: &[[u32; 2]]) {
        for ((last, counts), now) in self.last.iter_mut().zip(&mut self.counts).zip(now) {
            let [on, off] = [0, 1].map(|kind| now[kind] - last[kind]);
            if on.abs_diff(off) <= 1 + on.min(off) / 2 {
                *counts = [counts[0] + on, counts[1] + off];
            }
            *last = *now;
        }
    }

    /// The counts of pixels that tell of their own thresholds.
    pub fn revealing(&self, pixel: usize) -> Option<[u32; 2]> {
        Some(self.counts[pixel]).filter(|counts| counts.iter().all(|&count| count >= MANY))
    }
}

/// What an ON and an OFF event change at a pixel where so many of each came back to where they began, and where they change `step` at
/// others. Thresholds differ by per cents from pixel to pixel, which hundreds of events would add up.
pub(super) fn own_steps([on, off]: [u32; 2], step: [f32; 2]) -> [f32; 2] {
    let more = (off as f32 * step[1] / (on as f32 * step[0])).sqrt();
    [step[0] * more, step[1] / more]
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    fn draw(pixel: u64, what: u64, low: f64, high: f64) -> f64 {
        random::range(random::key(5, &[pixel, what]), low, high)
    }

    /// Counts of pixels of which a third see something and return to where they were, by sensors whose thresholds have this ratio;
    /// in some of these, what was there went away. All have events of noise besides, so many in the mean.
    fn totals(pixels: u64, ratio: f64, gone: f64, noise: [f64; 2]) -> Vec<[u32; 2]> {
        (0..pixels)
            .map(|pixel| {
                let up = if pixel % 3 == 0 { draw(pixel, 0, 2.0, 8.0) } else { 0.0 };
                let down = if draw(pixel, 1, 0.0, 1.0) < gone { up - draw(pixel, 2, -1.0, 1.0) } else { up };
                let caused = [up / (0.2 * ratio.sqrt()), (down / 0.2 * ratio.sqrt()).max(0.0)];
                [0, 1].map(|kind| (caused[kind] + draw(pixel, 3 + kind as u64, 0.0, 2.0 * noise[kind])).round() as u32)
            })
            .collect()
    }

    fn revealing(totals: &[[u32; 2]], stated: f64) -> Option<f64> {
        ratio(totals, noise(totals), stated)
    }

    #[test]
    fn thresholds_that_were_stated_wrong_are_found_by_what_comes_back() {
        for of_sensor in [0.6, 0.8, 1.25, 1.7] {
            for noise in [[0.0, 0.0], [3.0, 0.2], [5.0, 5.0]] {
                let found = revealing(&totals(3000, of_sensor, 0.3, noise), 1.0).expect("a difference");
                assert!((found / of_sensor).ln().abs() < 0.05, "{found} of {of_sensor} with {noise:?}");
            }
        }
    }

    #[test]
    fn what_is_stated_stays_where_nothing_speaks_against_it() {
        assert_eq!(revealing(&totals(3000, 1.0, 0.3, [0.0, 0.0]), 1.0), None);
        assert_eq!(revealing(&totals(3000, 1.0, 0.3, [4.0, 0.1]), 1.0), None, "leaks are no threshold");
        assert_eq!(revealing(&totals(3000, 1.25, 0.3, [0.0, 0.0]), 1.25), None);
        assert_eq!(revealing(&totals(450, 1.7, 0.0, [0.0, 0.0]), 1.0), None, "too few pixels");
        assert_eq!(ratio(&vec![[9, 2]; 2000], [0.0, 0.0], 1.0), None, "too few events");
        assert_eq!((revealing(&[], 1.0), noise(&[])), (None, [0.0, 0.0]));
        // Pixels that contradict each other.
        let torn: Vec<[u32; 2]> = (0..240).map(|at| if at % 2 == 0 { [40, 10] } else { [10, 36] }).collect();
        assert_eq!(ratio(&torn, [0.0, 0.0], 1.0), None);
    }

    #[test]
    fn a_pixel_under_a_lamp_tells_of_its_own_thresholds() {
        for (on, off) in [(0.2, 0.2), (0.17, 0.22), (0.25, 0.2)] {
            // So far up and down a hundred times, and once up for good; another pixel sees little.
            let mut returns = Returns::new(2);
            for period in 1..=100 {
                let jump = if period > 30 { 6 } else { 0 };
                let [on, off] = [on, off].map(|threshold: f64| (f64::from(period) * 0.9 / threshold) as u32);
                returns.edge(&[[on + jump, off], [period / 3, period]]);
            }
            let counts = returns.revealing(0).expect("a lamp");
            let [up, down] = own_steps(counts, [1.0, 1.0]);
            assert!((f64::from(up / down) - on / off).abs() < 0.015 && (up * down - 1.0).abs() < 1e-5, "{up} {down}");
            assert_eq!(returns.revealing(1), None);
        }
    }

    #[test]
    fn what_nothing_caused_is_counted_where_nothing_is_seen() {
        for of_sensor in [[0.0, 0.0], [3.0, 0.0], [0.5, 4.0], [6.0, 6.0]] {
            let found = noise(&totals(3000, 1.2, 0.3, of_sensor));
            let close = |kind: usize| (found[kind] - of_sensor[kind]).abs() <= 0.2 * of_sensor[kind] + 0.05;
            assert!(close(0) && close(1), "{found:?} of {of_sensor:?}");
        }
    }
}
