//! What moves on a bent way, as few straight pieces of it: from a sample on to the last that a line from there leads to.

use erfgs_splat::gaussians::{CORE, Gaussians, sigmoid};

/// How far a way may leave its chord, as a share of the largest standard deviation of its Gaussian.
const STRAIGHT: f32 = 0.25;
/// How far a Gaussian may turn along a chord: it stands as it does half way. Radians.
const MOST_TURN: f32 = 0.3;
/// How much of an opacity may come or go along a chord.
const MOST_FADE: f32 = 0.1;
/// What is fainter cannot be seen.
const FAINT: f32 = 1.0 / 255.0;
/// Samples that a chord spans at most: what is kept of each Gaussian.
const LONGEST: usize = 16;

/// A Gaussian at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sample {
    seconds: f32,
    mean: [f32; 3],
    /// w, x, y, z, of length 1.
    turn: [f32; 4],
    opacity: f32,
}

/// A piece of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chord {
    /// Which Gaussian.
    pub index: usize,
    /// From when, to when, seconds.
    pub span: [f32; 2],
    /// Where it begins, metres.
    pub mean: [f32; 3],
    /// Metres a second.
    pub motion: [f32; 3],
    /// w, x, y, z, of length 1.
    pub turn: [f32; 4],
    /// 0 to 1.
    pub opacity: f32,
}

/// The ways of some Gaussians, while their samples come.
#[derive(Debug)]
pub(super) struct Chords {
    /// Of each Gaussian that is followed, the samples since its last chord ended.
    open: Vec<(usize, Vec<Sample>)>,
}

impl Chords {
    /// Of the Gaussians with these indices.
    pub fn new(indices: impl Iterator<Item = usize>) -> Self {
        Self { open: indices.map(|index| (index, Vec::with_capacity(LONGEST))).collect() }
    }

    /// Takes where all Gaussians are at `seconds`, and gives the chords that end before.
    pub fn push(&mut self, seconds: f32, gaussians: &Gaussians) -> Vec<Chord> {
        let mut ended = Vec::new();
        for (index, samples) in &mut self.open {
            let next = sample(seconds, gaussians, *index);
            let size = gaussians.scale(*index).into_iter().fold(0.0, f32::max);
            if samples.len() > 1 && !leads_to(samples, &next, size) {
                ended.extend(chord(*index, samples));
                samples.drain(..samples.len() - 1);
            }
            samples.push(next);
        }
        ended
    }

    /// The last chords, which go on to the end, seconds.
    pub fn end(self, end: f32) -> Vec<Chord> {
        let last = |(index, samples): (usize, Vec<Sample>)| chord(index, &samples);
        let last = self.open.into_iter().filter_map(last);
        last.map(|chord| Chord { span: [chord.span[0], end], ..chord }).collect()
    }
}

fn sample(seconds: f32, gaussians: &Gaussians, index: usize) -> Sample {
    let core = &gaussians.core[index * CORE..];
    let turn = [core[6], core[7], core[8], core[9]];
    Sample { seconds, mean: gaussians.mean(index), turn: unit(turn), opacity: sigmoid(core[10]) }
}

fn unit(turn: [f32; 4]) -> [f32; 4] {
    let length = turn.iter().map(|part| part * part).sum::<f32>().sqrt();
    // A quaternion of nothing turns nothing.
    if length > 0.0 { turn.map(|part| part / length) } else { [1.0, 0.0, 0.0, 0.0] }
}

fn dot(a: [f32; 4], b: [f32; 4]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Whether a straight line leads past all of these to `next`.
fn leads_to(samples: &[Sample], next: &Sample, size: f32) -> bool {
    let first = &samples[0];
    let within = |sample: &Sample| {
        let share = (sample.seconds - first.seconds) / (next.seconds - first.seconds);
        let off =
            (0..3).map(|axis| first.mean[axis] + share * (next.mean[axis] - first.mean[axis]) - sample.mean[axis]);
        off.map(|off| off * off).sum::<f32>().sqrt() <= STRAIGHT * size
    };
    let turn = 2.0 * dot(first.turn, next.turn).abs().min(1.0).acos();
    samples.len() < LONGEST
        && turn <= MOST_TURN
        && (first.opacity - next.opacity).abs() <= MOST_FADE
        && samples[1..].iter().all(within)
}

/// The line from the first of these to the last; none where there is nothing to be seen.
fn chord(index: usize, samples: &[Sample]) -> Option<Chord> {
    let [first, .., last] = samples else { return None };
    let opacity = 0.5 * (first.opacity + last.opacity);
    let length = last.seconds - first.seconds;
    let sign = if dot(first.turn, last.turn) < 0.0 { -1.0 } else { 1.0 };
    (opacity >= FAINT && length > 0.0).then(|| Chord {
        index,
        span: [first.seconds, last.seconds],
        mean: first.mean,
        motion: std::array::from_fn(|axis| (last.mean[axis] - first.mean[axis]) / length),
        turn: unit(std::array::from_fn(|k| first.turn[k] + sign * last.turn[k])),
        opacity,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two Gaussians of 1 cm: one goes straight, one around in a circle of 20 cm while it turns with it.
    fn at(seconds: f32) -> Gaussians {
        let angle = 4.0 * seconds;
        let (sin, cos) = angle.sin_cos();
        let size = 0.01_f32.ln();
        let (z, w) = (0.5 * angle).sin_cos();
        let core = [
            [0.3 * seconds, 0.0, 0.0, size, size, size, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0],
            [0.2 * cos, 0.2 * sin, 0.0, size, size, size, -2.0 * w, 0.0, 0.0, -2.0 * z, 2.0, 0.0],
        ];
        Gaussians { dynamic: 2, core: core.concat(), sh: vec![0.0; 8], ..Gaussians::default() }
    }

    #[test]
    fn chords_stay_near_the_way_and_leave_nothing_out() {
        let mut chords = Chords::new([0, 1].into_iter());
        let mut all = Vec::new();
        for k in 0..=50 {
            let seconds = 0.02 * k as f32;
            all.extend(chords.push(seconds, &at(seconds)));
        }
        all.extend(chords.end(1.1));
        for index in [0, 1] {
            let own: Vec<&Chord> = all.iter().filter(|chord| chord.index == index).collect();
            assert_eq!((own[0].span[0], own[own.len() - 1].span[1]), (0.0, 1.1));
            assert!(own.windows(2).all(|pair| pair[0].span[1] == pair[1].span[0]));
            // The straight way is cut by how long chords are alone.
            let expected = if index == 0 { 4..=5 } else { 13..=30 };
            assert!(expected.contains(&own.len()), "{index}: {}", own.len());
            for chord in own {
                let to = chord.span[1].min(1.0);
                for share in [0.0, 0.3, 0.5, 1.0] {
                    let seconds = chord.span[0] + share * (to - chord.span[0]);
                    let truth = at(seconds);
                    let mean: [f32; 3] =
                        std::array::from_fn(|axis| chord.mean[axis] + chord.motion[axis] * (seconds - chord.span[0]));
                    let off = (0..3).map(|axis| (mean[axis] - truth.mean(index)[axis]).powi(2)).sum::<f32>().sqrt();
                    assert!(off <= 0.3 * 0.01, "{index} at {seconds}: {off}");
                    let turn = 2.0 * dot(chord.turn, sample(seconds, &truth, index).turn).abs().min(1.0).acos();
                    assert!(turn <= 0.52 * MOST_TURN, "{index} at {seconds}: {turn}");
                }
            }
        }
    }

    #[test]
    fn what_is_not_there_has_no_chord() {
        let mut chords = Chords::new([0].into_iter());
        let mut all = Vec::new();
        for k in 0..40 {
            let mut gaussians = at(0.02 * k as f32);
            // There from 0.4 s on.
            gaussians.core[10] = if k < 20 { -30.0 } else { 2.0 };
            all.extend(chords.push(0.02 * k as f32, &gaussians));
        }
        all.extend(chords.end(0.8));
        let first = all.iter().map(|chord| chord.span[0]).fold(f32::INFINITY, f32::min);
        assert!((0.36..0.41).contains(&first), "{first}");
        assert!(Chords::new([0].into_iter()).end(1.0).is_empty());
    }
}
