//! Which placements take part, and which are held out.

use erfgs_base::random;

use super::{NEEDED, instants::Instant};

const HOLD_OUT: u64 = random::purpose("wand held-out placements");
/// A camera keeps so many placements when they are thinned.
const PER_CAMERA: usize = 40;

/// In how many instants each camera sees the wand.
pub(super) fn counts<'a>(instants: impl Iterator<Item = &'a Instant>, cameras: usize) -> Vec<usize> {
    let mut counts = vec![0; cameras];
    for view in instants.flat_map(|instant| &instant.views) {
        counts[view.camera] += 1;
    }
    counts
}

/// At most about `most` instants, spread over the recording; those of cameras that saw little are all kept.
pub(super) fn thin(instants: Vec<Instant>, cameras: usize, most: usize, seed: u64) -> Vec<Instant> {
    if instants.len() <= most {
        return instants;
    }
    let step = instants.len() as f64 / most as f64;
    let mut kept = vec![false; instants.len()];
    for index in 0..most {
        kept[(index as f64 * step) as usize] = true;
    }
    let mut counts = counts(instants.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(i, _)| i), cameras);
    for index in random::permutation(random::key(seed, &[HOLD_OUT, 1]), instants.len()) {
        let rare = instants[index].views.iter().any(|view| counts[view.camera] < PER_CAMERA);
        if !kept[index] && rare {
            kept[index] = true;
            instants[index].views.iter().for_each(|view| counts[view.camera] += 1);
        }
    }
    instants.into_iter().zip(kept).filter(|(_, kept)| *kept).map(|(instant, _)| instant).collect()
}

/// Which instants are held out: `share` of them, at random, as long as each camera keeps most of its
/// own.
pub(super) fn hold_out(instants: &[Instant], cameras: usize, share: f64, seed: u64) -> Vec<bool> {
    let mut held = vec![false; instants.len()];
    let mut wanted = (share * instants.len() as f64).round() as usize;
    let all = counts(instants.iter(), cameras);
    let mut left = all.clone();
    for index in random::permutation(random::key(seed, &[HOLD_OUT]), instants.len()) {
        if wanted == 0 {
            break;
        }
        let enough = |camera: usize| {
            let rest = left[camera] - 1;
            rest >= 2 * NEEDED && rest as f64 >= (1.0 - 2.0 * share) * all[camera] as f64
        };
        let views = &instants[index].views;
        if views.iter().all(|view| enough(view.camera)) {
            held[index] = true;
            wanted -= 1;
            views.iter().for_each(|view| left[view.camera] -= 1);
        }
    }
    held
}
