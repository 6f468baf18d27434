//! A scene as a `.4dgs` file, the open container of 4D Gaussians (<https://4dgs.dev>, version 1, `gaussian-birth`).
//!
//! There, a Gaussian stands at `position + motion (t - mu)` within a window of time, and its opacity is multiplied by
//! `exp(-((t - mu) / sigma)^2 / 2)`. What is free in time is that but for its acceleration: where a curve leaves its tangent
//! visibly, and for what a field deforms, each Gaussian becomes one for each RGB interval, on a chord of its path. What bodies carry becomes
//! as many as its way and its turning ask for (`chords`).

mod chords;

use erfgs_splat::{
    gaussians::{CORE, Gaussians, SH_C0, sh_stride, sigmoid},
    model::ModelError,
    motion::{FreeTimeOptions, MotionPlan, bodies::EXTRA_FLOATS},
    trained::{Reconstruction, TrainedScene},
};
use fourdgs::{GaussianSet, SceneExtras, WriteOptions};

use self::chords::{Chord, Chords};

/// Standard deviations at which an opacity falls to the container's least share of 0.05.
const SUPPORT: f32 = 2.45;
/// Samples of what bodies carry, a stretch of their splines.
const SAMPLES: usize = 4;
/// More Gaussians no file has that a reader is asked to open.
const MOST: usize = 1 << 22;
/// How far a curve may leave its tangent, as a share of the largest standard deviation of its Gaussian.
const STRAIGHT: f32 = 0.25;

/// What was written.
#[derive(Clone, Debug)]
pub struct Written {
    /// The file.
    pub bytes: Vec<u8>,
    /// Gaussians of the file.
    pub gaussians: usize,
    /// What it cannot hold.
    pub left_out: Vec<String>,
}

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum FourDgsError {
    /// The run.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The container's own code.
    #[error("the scene cannot be written as 4dgs: {0}")]
    Container(#[from] fourdgs::Error),
    /// Bodies that turn fast, for long.
    #[error(
        "4dgs stores straight paths only, for which the Gaussians of bodies would become more than {MOST}: export the run --to e4d \
         or html, which store bodies"
    )]
    TooManyChords,
}

/// One Gaussian at a time, in the container's terms.
struct Birth {
    mean: [f32; 3],
    /// Metres a second.
    motion: [f32; 3],
    /// Seconds.
    mu: f32,
    sigma: f32,
    window: [f32; 2],
}

/// Writes what a run learned. `on_progress` is told of instants of a field that are done, and of how many.
///
/// # Errors
/// [`FourDgsError`].
pub fn write(scene: &mut TrainedScene<'_>, on_progress: &mut dyn FnMut(u64, u64)) -> Result<Written, FourDgsError> {
    let Reconstruction { record, gaussians, .. } = scene.learned().clone();
    let [start, end] = record.span_ns;
    let seconds = (end.saturating_sub(start) as f64 / 1e9) as f32;
    let intervals = record.intervals.max(1.0) as f32;
    let moves = if record.motion == MotionPlan::Still { 0 } else { gaussians.dynamic };
    // The window is open at its end, and the last instant belongs to the scene.
    let whole = [0.0, seconds * 1.001 + 1e-6];
    let mut set = Set::new(&gaussians, record.drawing.sh_degree);
    let mut left_out = Vec::new();
    match &record.motion {
        MotionPlan::FreeTime { options, .. } if moves > 0 => {
            for (index, row) in gaussians.motion.chunks_exact(options.floats()).enumerate().take(moves) {
                for birth in births(&gaussians, index, row, options, [intervals, seconds], whole) {
                    set.push(&gaussians, index, &birth);
                }
            }
        }
        MotionPlan::Bodies { options: free, knots, .. } if moves > 0 => {
            left_out.push("how what bodies carry turns along each of its straight pieces".to_owned());
            let floats = free.floats();
            let (of_none, carried): (Vec<usize>, Vec<usize>) =
                (0..moves).partition(|index| gaussians.motion[index * (floats + EXTRA_FLOATS) + floats] < 1.0);
            for index in of_none {
                let row = &gaussians.motion[index * (floats + EXTRA_FLOATS)..][..floats];
                for birth in births(&gaussians, index, row, free, [intervals, seconds], whole) {
                    set.push(&gaussians, index, &birth);
                }
            }
            let stretches = knots.saturating_sub(3).max(1);
            let steps = SAMPLES * stretches;
            let mut chords = Chords::new(carried.into_iter());
            for step in 0..=steps {
                on_progress(step as u64, steps as u64);
                let t01 = step as f64 / steps as f64;
                let there = scene.gaussians_at(t01)?;
                set.follow(&gaussians, &chords.push(t01 as f32 * seconds, &there))?;
            }
            set.follow(&gaussians, &chords.end(whole[1]))?;
        }
        MotionPlan::HexPlane { field, .. } if moves > 0 => {
            if field.heads.sh {
                left_out.push("how colours change with time".to_owned());
            }
            let steps = intervals.ceil() as u64;
            let mut from = scene.gaussians_at(0.0)?;
            for step in 0..steps {
                on_progress(step, steps);
                let at = |offset: f64| (step as f64 + offset) / steps as f64;
                let middle = scene.gaussians_at(at(0.5))?;
                let to = scene.gaussians_at(at(1.0))?;
                let last = if step + 1 == steps { whole[1] } else { at(1.0) as f32 * seconds };
                let window = [at(0.0) as f32 * seconds, last];
                let length = seconds / steps as f32;
                for index in 0..moves {
                    let (mean, next) = (from.mean(index), to.mean(index));
                    let motion = std::array::from_fn(|axis| (next[axis] - mean[axis]) / length);
                    let birth = Birth { mean, motion, mu: window[0], sigma: f32::INFINITY, window };
                    set.push(&middle, index, &birth);
                }
                from = to;
            }
        }
        _ => {}
    }
    for index in moves..gaussians.len() {
        let birth =
            Birth { mean: gaussians.mean(index), motion: [0.0; 3], mu: 0.0, sigma: f32::INFINITY, window: whole };
        set.push(&gaussians, index, &birth);
    }
    let options = WriteOptions {
        profile: fourdgs::quantization::Profile::Fine,
        // The writer's own check compares decoded f32 with its bound to the last digit, which rounding oversteps where a
        // Gaussian lies metres away.
        verify: false,
        sh_bands: set.degree as u8,
        library: concat!("erfgs ", env!("CARGO_PKG_VERSION")).into(),
        ..WriteOptions::default()
    };
    let count = set.set.count();
    let bytes = fourdgs::write_to_vec(&set.set, f64::from(seconds), &options, &SceneExtras::default())?;
    Ok(Written { bytes, gaussians: count, left_out })
}

/// What a row that is free in time becomes: itself, or one for each interval that it is seen in.
fn births(
    gaussians: &Gaussians,
    index: usize,
    row: &[f32],
    options: &FreeTimeOptions,
    [intervals, seconds]: [f32; 2],
    whole: [f32; 2],
) -> Vec<Birth> {
    let (instant, mean) = (row[3], gaussians.mean(index));
    // As the kernel bounds it.
    let life = options.least_life + row[7].clamp(-30.0, 30.0).exp();
    let second = seconds / intervals;
    let (mu, sigma) = (instant * second, life * second);
    // The instants at which it is seen, in intervals.
    let first = (instant - SUPPORT * life).max(0.0);
    let last = (instant + SUPPORT * life).min(intervals);
    let moved = |t: f32| options.moved(row, t - instant);
    // Its velocity at its instant, from the places around it.
    let near = 1e-2;
    let (ahead, behind) = (options.moved(row, near), options.moved(row, -near));
    let v: [f32; 3] = std::array::from_fn(|axis| (ahead[axis] - behind[axis]) / (2.0 * near));
    let bend = [first, last, 0.5 * (first + last)].map(|t| {
        let place = moved(t);
        (0..3).map(|axis| (place[axis] - v[axis] * (t - instant)).powi(2)).sum::<f32>().sqrt()
    });
    let size = gaussians.scale(index).into_iter().fold(0.0, f32::max);
    if bend.into_iter().fold(0.0, f32::max) <= STRAIGHT * size || last <= first {
        return vec![Birth { mean, motion: v.map(|v| v / second), mu, sigma, window: whole }];
    }
    let at = |t: f32| -> [f32; 3] {
        let moved = moved(t);
        std::array::from_fn(|axis| mean[axis] + moved[axis])
    };
    let steps = intervals.ceil() as usize;
    let of = |step: usize| step as f32 * intervals / steps as f32;
    let seen = (0..steps).filter(|&step| of(step + 1) > first && of(step) < last);
    let chord = |step: usize| {
        let (from, to) = (of(step), of(step + 1));
        let (begin, end) = (at(from), at(to));
        let motion: [f32; 3] = std::array::from_fn(|axis| (end[axis] - begin[axis]) / (to - from));
        // Where the chord is at the instant of its own, from which the container counts.
        let mean = std::array::from_fn(|axis| begin[axis] + motion[axis] * (instant - from));
        let end = if step + 1 == steps { whole[1] } else { to * second };
        Birth { mean, motion: motion.map(|v| v / second), mu, sigma, window: [from * second, end] }
    };
    seen.map(chord).collect()
}

/// The container's arrays, while they grow.
struct Set {
    set: GaussianSet,
    stride: usize,
    degree: u32,
}

impl Set {
    fn new(gaussians: &Gaussians, active: u32) -> Self {
        let degree = active.min(gaussians.sh_degree);
        let coefficients = (degree as usize + 1).pow(2) - 1;
        let set = GaussianSet {
            sh: (coefficients > 0).then(Vec::new),
            sh_coefficients: coefficients,
            sh_degree: degree as u8,
            ..GaussianSet::default()
        };
        Self { set, stride: sh_stride(gaussians.sh_degree), degree }
    }

    /// Adds pieces of the ways of `gaussians`.
    fn follow(&mut self, gaussians: &Gaussians, chords: &[Chord]) -> Result<(), FourDgsError> {
        if self.set.count() + chords.len() > MOST {
            return Err(FourDgsError::TooManyChords);
        }
        for &Chord { index, span, mean, motion, turn: [w, x, y, z], opacity } in chords {
            self.push(gaussians, index, &Birth { mean, motion, mu: span[0], sigma: f32::INFINITY, window: span });
            let Set { set, .. } = self;
            let (turns, colours) = (set.rotations.len(), set.colors.len());
            set.rotations[turns - 4..].copy_from_slice(&[x, y, z, w]);
            set.colors[colours - 1] = opacity;
        }
        Ok(())
    }

    /// Adds Gaussian `index` of `gaussians`, as it stands there but for its place.
    fn push(&mut self, gaussians: &Gaussians, index: usize, birth: &Birth) {
        let set = &mut self.set;
        let core = &gaussians.core[index * CORE..];
        let sh = &gaussians.sh[index * self.stride..];
        set.positions.extend(birth.mean);
        set.scales.extend(gaussians.scale(index));
        // Ours are w x y z, of any length.
        let [w, x, y, z] = [core[6], core[7], core[8], core[9]];
        let length = (w * w + x * x + y * y + z * z).sqrt().max(1e-12);
        set.rotations.extend([x, y, z, w].map(|part| part / length));
        set.colors.extend([0, 1, 2].map(|channel| (0.5 + SH_C0 * sh[channel]).clamp(0.0, 1.0)));
        set.colors.push(sigmoid(core[10]));
        set.motions.extend(birth.motion);
        set.mu_t.push(birth.mu);
        set.sigma_t.push(birth.sigma);
        set.win_lo.push(birth.window[0]);
        set.win_hi.push(birth.window[1]);
        if let Some(bytes) = &mut set.sh {
            let (low, high) = (fourdgs::quantization::SH_QUANT_LO as f32, fourdgs::quantization::SH_QUANT_HI as f32);
            for channel in 0..3 {
                for coefficient in 1..=set.sh_coefficients {
                    let value = sh[3 * coefficient + channel];
                    bytes.push(((value - low) / (high - low) * 255.0).round().clamp(0.0, 255.0) as u8);
                }
            }
        }
    }
}
