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
    let told = caused.filter(|counts| counts.iter().all(|&count| count >= EVENTS));
    let mut logs: Vec<f64> = told.map(|[on, off]| (off / on).ln()).collect();
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

    fn told(totals: &[[u32; 2]], stated: f64) -> Option<f64> {
        ratio(totals, noise(totals), stated)
    }

    #[test]
    fn thresholds_that_were_stated_wrong_are_found_by_what_comes_back() {
        for of_sensor in [0.6, 0.8, 1.25, 1.7] {
            for noise in [[0.0, 0.0], [3.0, 0.2], [5.0, 5.0]] {
                let found = told(&totals(3000, of_sensor, 0.3, noise), 1.0).expect("a difference");
                assert!((found / of_sensor).ln().abs() < 0.05, "{found} of {of_sensor} with {noise:?}");
            }
        }
    }

    #[test]
    fn what_is_stated_stays_where_nothing_speaks_against_it() {
        assert_eq!(told(&totals(3000, 1.0, 0.3, [0.0, 0.0]), 1.0), None);
        assert_eq!(told(&totals(3000, 1.0, 0.3, [4.0, 0.1]), 1.0), None, "leaks are no threshold");
        assert_eq!(told(&totals(3000, 1.25, 0.3, [0.0, 0.0]), 1.25), None);
        assert_eq!(told(&totals(450, 1.7, 0.0, [0.0, 0.0]), 1.0), None, "too few pixels");
        assert_eq!(ratio(&vec![[9, 2]; 2000], [0.0, 0.0], 1.0), None, "too few events");
        assert_eq!((told(&[], 1.0), noise(&[])), (None, [0.0, 0.0]));
        // Pixels that contradict each other.
        let torn: Vec<[u32; 2]> = (0..240).map(|at| if at % 2 == 0 { [40, 10] } else { [10, 36] }).collect();
        assert_eq!(ratio(&torn, [0.0, 0.0], 1.0), None);
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
