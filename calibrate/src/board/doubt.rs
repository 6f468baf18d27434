//! Whether what all cameras together say is what each of them says: a rig that fits and is wrong looks right by its residuals.

use super::{alone::Alone, joint::Joint};
use crate::{
    bundle::{Bundle, Parameter, Uncertainty},
    statistics::median,
};

/// A greater share of a camera's corners left out is said first.
const DROPPED: f64 = 0.05;
/// With a greater share left out, what remains is a choice and no measurement.
const MOST_DROPPED: f64 = 0.3;
/// A residual so many times that of the camera by itself is not the detector's.
const GREW: f64 = 2.5;
/// And at least so much, pixels.
const RESIDUAL_PX: f64 = 0.7;
/// What a lens that was given may leave over by itself, pixels.
pub(super) const GIVEN_PX: f64 = 1.0;
/// Beyond this, pixels, nothing is being measured.
pub(super) const MOST_RESIDUAL_PX: f64 = 5.0;
/// A change of intrinsics by so many of the camera's own deviations is no accident.
pub(super) const DEVIATIONS: f64 = 4.0;
/// Smaller changes, as a share of the focal length, do not matter.
pub(super) const MOVED: f64 = 0.01;
/// Greater ones mean that the intrinsics were bent to make something else fit.
pub(super) const MOST_MOVED: f64 = 0.05;
/// A focal length known to no better than this share is none.
const VAGUE: f64 = 0.05;
/// Where a board is fast, residuals so many times those of a board that stands are not the detector's.
const GREW_BY_SPEED: f64 = 2.0;
/// Speeds that differ by less tell nothing.
const SPREAD: f64 = 1.5;
/// With fewer corners nothing is said of speeds.
const LEAST_CORNERS: usize = 90;

/// What speaks against a solution: a sentence for each doubt, causes before what they bring about and then the gravest first, and
/// whether one of them is too grave.
pub(super) struct Doubts {
    doubts: Vec<Doubt>,
    /// How much all of it weighs; 1 and more is too grave.
    pub gravest: f64,
}

/// How grave it is (1 is too grave), and a sentence.
type Weighed = (f64, String);

struct Doubt {
    cause: bool,
    weight: f64,
    sentence: String,
}

impl Doubts {
    pub fn of(joint: &Joint, alone: &[&Alone], uncertainty: &Uncertainty) -> Self {
        let bundle = &joint.bundle;
        let mut doubts = Vec::new();
        let mut add = |cause, found: Option<Weighed>| {
            doubts.extend(found.map(|(weight, sentence)| Doubt { cause, weight, sentence }));
        };
        for (index, alone) in alone.iter().enumerate() {
            add(true, alone.is_another());
            add(true, late(joint, index, alone));
            add(false, dropped(bundle, index));
            add(false, residual(joint, index, alone));
            add(false, bent(bundle, index, alone));
            add(false, vague(bundle, index, uncertainty));
        }
        doubts.sort_by(|a, b| b.cause.cmp(&a.cause).then(b.weight.total_cmp(&a.weight)));
        let gravest = doubts.iter().map(|doubt| doubt.weight).fold(0.0, f64::max);
        Self { doubts, gravest }
    }

    pub fn is_empty(&self) -> bool {
        self.doubts.is_empty()
    }

    /// Whether a rig may be written all the same.
    pub fn is_bearable(&self) -> bool {
        self.gravest < 1.0
    }

    /// What those say that tell where the others come from.
    pub fn causes(&self) -> impl Iterator<Item = String> + '_ {
        self.doubts.iter().filter(|doubt| doubt.cause).map(|doubt| doubt.sentence.clone())
    }

    /// What they say.
    pub fn sentences(&self) -> Vec<String> {
        self.doubts.iter().map(|doubt| doubt.sentence.clone()).collect()
    }
}

/// Residuals that grow with the speed at which the board crosses the image: what comes of frames that are not of the same instants,
/// and of nothing else.
fn late(joint: &Joint, camera: usize, alone: &Alone) -> Option<Weighed> {
    let of_camera = joint.bundle.observations.iter().zip(&joint.speeds).filter(|(o, _)| o.camera == camera);
    let mut all: Vec<(f64, f64)> =
        of_camera.filter_map(|(o, speed)| Some(((*speed)?, joint.beyond_timing(o)?))).collect();
    if all.len() < LEAST_CORNERS {
        return None;
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let third = all.len() / 3;
    let (slow, fast) = (&all[..third], &all[all.len() - third..]);
    let middle = |part: &[(f64, f64)]| {
        let (speeds, residuals): (Vec<f64>, Vec<f64>) = part.iter().copied().unzip();
        Some((median(speeds)?, median(residuals)?))
    };
    let ((slow_speed, slow_px), (fast_speed, fast_px)) = (middle(slow)?, middle(fast)?);
    // Errors of time and others add up by their squares, so that two speeds tell what would be left of a board that stands.
    let per_speed = (fast_px.powi(2) - slow_px.powi(2)) / (fast_speed.powi(2) - slow_speed.powi(2));
    let standing_px = (slow_px.powi(2) - per_speed * slow_speed.powi(2)).max(0.0).sqrt().max(alone.rms_px());
    let grew = fast_speed > SPREAD * slow_speed && fast_px > (GREW_BY_SPEED * standing_px).max(RESIDUAL_PX);
    grew.then(|| {
        let text = format!(
            "the residual of {} grows with the speed of the board ({slow_px:.2} px where it is slow, {fast_px:.2} px where it is \
             fast): its frames are not simultaneous with the others'",
            joint.bundle.cameras[camera].name
        );
        (fast_px / MOST_RESIDUAL_PX, text)
    })
}

fn dropped(bundle: &Bundle, camera: usize) -> Option<Weighed> {
    let own = || bundle.observations.iter().filter(move |o| o.camera == camera);
    let (all, out) = (own().count(), own().filter(|o| !o.used).count());
    let share = out as f64 / all.max(1) as f64;
    (share > DROPPED).then(|| {
        let name = &bundle.cameras[camera].name;
        let text = format!(
            "{out} of the {all} corners that {name} saw ({:.0} %) contradict the rest and were left out",
            100.0 * share
        );
        (share / MOST_DROPPED, text)
    })
}

fn residual(joint: &Joint, camera: usize, alone: &Alone) -> Option<Weighed> {
    let name = &joint.bundle.cameras[camera].name;
    let (left_px, own_px) = (joint.rms_px(Some(camera)), alone.rms_px());
    // However little is known of when frames were taken, nothing explains as much as this.
    let whole_px = joint.bundle.rms_px(Some(camera)).0;
    let doubtful = left_px > (GREW * own_px).max(RESIDUAL_PX) || whole_px > MOST_RESIDUAL_PX;
    doubtful.then(|| {
        let text = format!(
            "{name} has a residual of {whole_px:.2} px together with the others, and {own_px:.2} px alone: its frames are not \
             simultaneous, or it moved"
        );
        (whole_px / MOST_RESIDUAL_PX, text)
    })
}

/// Intrinsics that leave what the camera itself says.
fn bent(bundle: &Bundle, camera: usize, alone: &Alone) -> Option<Weighed> {
    let single = alone.single.as_ref()?;
    let (before, after) = (&single.bundle.cameras[0], &bundle.cameras[camera]);
    let focal = before.intrinsics.fx;
    let changes = before.free.iter().zip(&single.uncertainty.cameras[0].sigma).filter_map(|(parameter, sigma)| {
        if !matches!(parameter, Parameter::Focal | Parameter::Fx | Parameter::Fy | Parameter::Cx | Parameter::Cy) {
            return None;
        }
        let (from, to) = (parameter.value(before), parameter.value(after));
        let far = (to - from).abs();
        let doubtful = far > DEVIATIONS * sigma && far > MOVED * focal;
        let text = format!(
            "{} of {} is {from:.0} ± {sigma:.0} px alone and {to:.0} px together with the others: it absorbs an error elsewhere",
            parameter.name(before),
            after.name
        );
        doubtful.then_some((far / focal / MOST_MOVED, text))
    });
    changes.max_by(|a, b| a.0.total_cmp(&b.0))
}

fn vague(bundle: &Bundle, camera: usize, uncertainty: &Uncertainty) -> Option<Weighed> {
    let state = &bundle.cameras[camera];
    let worst = super::intrinsics::focals(state, &uncertainty.cameras[camera])
        .max_by(|a, b| (a[1] / a[0]).total_cmp(&(b[1] / b[0])))?;
    let [focal, sigma] = worst;
    (sigma > VAGUE * focal).then(|| {
        let text = format!("the focal length of {} is undetermined: {focal:.0} ± {sigma:.0} px", state.name);
        (sigma / focal / VAGUE, text)
    })
}
