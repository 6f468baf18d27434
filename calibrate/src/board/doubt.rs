//! Whether what all cameras together say is what each of them says: a rig that fits and is wrong looks right by its residuals.

use super::{BoardError, alone::Alone, joint::Joint};
use crate::bundle::{Bundle, Parameter, Uncertainty};

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

/// What speaks against a solution: a sentence for each doubt, the gravest first, and whether one of them is too grave.
pub(super) struct Doubts {
    doubts: Vec<(f64, String)>,
    /// How much all of it weighs; 1 and more is too grave.
    pub gravest: f64,
}

impl Doubts {
    pub fn of(joint: &Joint, alone: &[&Alone], uncertainty: &Uncertainty) -> Self {
        let bundle = &joint.bundle;
        let mut doubts = Vec::new();
        for (index, alone) in alone.iter().enumerate() {
            doubts.extend(alone.is_another());
            doubts.extend(dropped(bundle, index));
            doubts.extend(residual(bundle, index, alone));
            doubts.extend(bent(bundle, index, alone));
            doubts.extend(vague(bundle, index, uncertainty));
        }
        doubts.sort_by(|a, b| b.0.total_cmp(&a.0));
        let gravest = doubts.first().map_or(0.0, |doubt| doubt.0);
        Self { doubts, gravest }
    }

    pub fn is_empty(&self) -> bool {
        self.doubts.is_empty()
    }

    /// The sentences, or the error where one of them is too grave to write a rig.
    pub fn judged(self, timed: bool, has_times: bool) -> Result<Vec<String>, BoardError> {
        let sentences: Vec<String> = self.doubts.into_iter().map(|(_, sentence)| sentence).collect();
        if self.gravest < 1.0 {
            return Ok(sentences);
        }
        let times = match (timed, has_times) {
            (true, _) => "",
            (false, true) => "the frames are of the same instants (--time-offsets did not help), ",
            (false, false) => {
                "the frames are of the same instants (cameras that run freely need a timestamps.csv, and --time-offsets), "
            }
        };
        Err(BoardError::Contradiction {
            what: sentences.iter().take(4).cloned().collect::<Vec<_>>().join("; "),
            times: times.into(),
        })
    }
}

fn dropped(bundle: &Bundle, camera: usize) -> Option<(f64, String)> {
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

fn residual(bundle: &Bundle, camera: usize, alone: &Alone) -> Option<(f64, String)> {
    let name = &bundle.cameras[camera].name;
    let (joint, own) = (bundle.rms_px(Some(camera)).0, alone.rms_px());
    let doubtful = joint > (GREW * own).max(RESIDUAL_PX);
    doubtful.then(|| {
        let text = format!(
            "{name} leaves {joint:.2} px over together with the others, and {own:.2} px by itself: its frames are not of the \
             same instants, or it moved"
        );
        (joint / MOST_RESIDUAL_PX, text)
    })
}

/// Intrinsics that leave what the camera itself says.
fn bent(bundle: &Bundle, camera: usize, alone: &Alone) -> Option<(f64, String)> {
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
            "{} of {} is {from:.0} ± {sigma:.0} px by itself and {to:.0} px together with the others: it was bent to make \
             something else fit",
            parameter.name(before),
            after.name
        );
        doubtful.then_some((far / focal / MOST_MOVED, text))
    });
    changes.max_by(|a, b| a.0.total_cmp(&b.0))
}

fn vague(bundle: &Bundle, camera: usize, uncertainty: &Uncertainty) -> Option<(f64, String)> {
    let state = &bundle.cameras[camera];
    let worst = super::intrinsics::focals(state, &uncertainty.cameras[camera])
        .max_by(|a, b| (a[1] / a[0]).total_cmp(&(b[1] / b[0])))?;
    let [focal, sigma] = worst;
    (sigma > VAGUE * focal).then(|| {
        let text = format!("the focal length of {} is {focal:.0} ± {sigma:.0} px, which is none", state.name);
        (sigma / focal / VAGUE, text)
    })
}
