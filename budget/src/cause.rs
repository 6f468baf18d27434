//! What may be wrong, and by how much.

use std::path::Path;

use erfgs_base::Progress;
use erfgs_dataset::{
    Dataset, DatasetError,
    disturb::{Disturbance, disturb},
};
use erfgs_stage::{FilmOptions, StageError, film};

use crate::stage::{Base, Filmed};

/// Which part of a rig is to blame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Poses and lenses.
    Calibration,
    /// Clocks.
    Clocks,
    /// What the sensors do.
    Sensors,
    /// How many cameras there are.
    Cameras,
}

impl Kind {
    /// All of them, in the order in which they are told.
    pub const ALL: [Self; 4] = [Self::Calibration, Self::Clocks, Self::Sensors, Self::Cameras];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Calibration => "Calibration",
            Self::Clocks => "Clocks",
            Self::Sensors => "Sensors",
            Self::Cameras => "Cameras",
        }
    }
}

/// What there is to know of a cause.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct About {
    /// What it is called.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// What its size means.
    pub meaning: &'static str,
    /// Which part of a rig is to blame.
    pub kind: Kind,
    /// Its size in the base.
    pub usual: f64,
}

/// One thing that may be wrong.
#[derive(Clone, Debug)]
pub struct Cause {
    /// What there is to know of it.
    pub about: About,
    /// Sizes, from the least to the greatest.
    pub steps: Vec<Step>,
}

/// A size of a cause.
#[derive(Clone, Debug)]
pub struct Step {
    /// The size.
    pub size: f64,
    /// The name of its dataset.
    pub name: String,
    /// Whether there are events to train with.
    pub events: bool,
    how: How,
}

#[derive(Clone, Debug)]
enum How {
    Disturb(Box<Disturbance>),
    Film(Box<FilmOptions>),
}

/// Why the dataset of a step cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum BudgetError {
    /// The dataset.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The film.
    #[error(transparent)]
    Stage(#[from] StageError),
}

impl Step {
    /// Makes the dataset of the step in `folder`, or finds it made. It has its initial points only where these are not touched.
    ///
    /// # Errors
    /// [`BudgetError`].
    pub fn make(
        &self,
        base: &Base,
        folder: &Path,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Dataset, BudgetError> {
        let out = folder.join(&self.name);
        if out.join(Dataset::MANIFEST).is_file() {
            return Ok(Dataset::load(&out)?);
        }
        match &self.how {
            How::Disturb(wrong) => {
                let source = if wrong.cameras.is_some() { base.all_cameras() } else { &base.dataset };
                Ok(disturb(source, wrong, &out, &mut |step| progress(step))?)
            }
            How::Film(options) => Ok(film(&out, options, progress)?.dataset),
        }
    }
}

/// What may be wrong with a base: what can be put into any dataset, and on the stage what must be filmed otherwise.
#[must_use]
pub fn causes(base: &Base) -> Vec<Cause> {
    let mut causes = put_in(base);
    if let Some(stage) = &base.stage {
        causes.extend(filmed(&stage.film));
        causes.extend(other_cameras(stage));
    }
    // A small stage has no other numbers of cameras.
    causes.retain(|cause| !cause.steps.is_empty());
    causes
}

fn name(cause: &str, size: f64) -> String {
    format!("{}-{size}", cause.replace(' ', "-"))
}

/// A cause whose steps are disturbances of the base.
fn disturbed(
    [name, unit, meaning]: [&'static str; 3],
    kind: Kind,
    sizes: &[f64],
    wrong: impl Fn(f64) -> Disturbance,
) -> Cause {
    let step = |&size: &f64| Step {
        size,
        name: self::name(name, size),
        events: true,
        how: How::Disturb(Box::new(Disturbance { seed: 1, ..wrong(size) })),
    };
    Cause { about: About { name, unit, meaning, kind, usual: 0.0 }, steps: sizes.iter().map(step).collect() }
}

fn put_in(base: &Base) -> Vec<Cause> {
    let none = Disturbance::default;
    let mut causes = vec![
        disturbed(
            ["place", "mm", "standard deviation of each camera's place along each axis"],
            Kind::Calibration,
            &[1.0, 3.0, 10.0, 30.0],
            |mm| Disturbance { place_m: 1e-3 * mm, ..none() },
        ),
        disturbed(
            ["direction", "degrees", "standard deviation of each camera's direction about each axis"],
            Kind::Calibration,
            &[0.03, 0.1, 0.3, 1.0],
            |degrees| Disturbance { direction_deg: degrees, ..none() },
        ),
        disturbed(
            ["focal length", "%", "standard deviation of each camera's focal length"],
            Kind::Calibration,
            &[0.1, 0.3, 1.0, 3.0],
            |percent| Disturbance { focal: 1e-2 * percent, ..none() },
        ),
        disturbed(
            [
                "frames late",
                "µs",
                "standard deviation of one shift of all frames of each RGB camera (initial points are those of right clocks)",
            ],
            Kind::Clocks,
            &[300.0, 1000.0, 3000.0, 10_000.0],
            |us| Disturbance { frame_clock_s: 1e-6 * us, ..none() },
        ),
    ];
    if base.has_events() {
        causes.extend([
            disturbed(
                ["events late", "µs", "all event cameras are late by this much"],
                Kind::Clocks,
                &[300.0, 1000.0, 3000.0, 10_000.0],
                |us| Disturbance { event_clock_s: 1e-6 * us, ..none() },
            ),
            disturbed(
                ["threshold stated", "%", "contrast thresholds are stated higher than they are by this much"],
                Kind::Sensors,
                &[5.0, 10.0, 20.0, 50.0],
                |percent| Disturbance { threshold: 1e-2 * percent, ..none() },
            ),
            disturbed(
                [
                    "ON beside OFF",
                    "%",
                    "what an ON event changes beside an OFF event is stated higher than it is by this much",
                ],
                Kind::Sensors,
                &[5.0, 10.0, 20.0, 50.0],
                |percent| Disturbance { balance: 1e-2 * percent, ..none() },
            ),
            disturbed(
                ["event noise", "Hz", "more events of noise of each pixel in a second"],
                Kind::Sensors,
                &[1.0, 3.0, 10.0, 30.0],
                |noise_hz| Disturbance { noise_hz, ..none() },
            ),
            disturbed(
                ["packets lost", "%", "packets of 1024 events that are lost, unnoticed"],
                Kind::Sensors,
                &[1.0, 3.0, 10.0, 30.0],
                |percent| Disturbance { lost: 1e-2 * percent, ..none() },
            ),
        ]);
    }
    causes
}

/// What exposures and thresholds cost: other films with the cameras of the base.
fn filmed(film: &FilmOptions) -> Vec<Cause> {
    let step = |cause: &str, size: f64, film: FilmOptions| Step {
        size,
        name: name(cause, size),
        events: true,
        how: How::Film(Box::new(film)),
    };
    let exposure = |ms: &f64| {
        let film = FilmOptions { exposure_ns: (1e6 * ms) as i64, ..film.clone() };
        step("exposure", *ms, film)
    };
    // No shutter is open for longer than a frame takes.
    let fits = |ms: &&f64| 1e-3 * **ms * film.rgb_fps <= 1.0;
    let threshold = |size: &f64| {
        let events = erfgs_stage::EventOptions { threshold_on: *size, threshold_off: *size, ..film.events.clone() };
        step("threshold", *size, FilmOptions { events, ..film.clone() })
    };
    vec![
        Cause {
            about: About {
                name: "exposure",
                unit: "ms",
                meaning: "how long the RGB cameras' shutters are open",
                kind: Kind::Sensors,
                usual: 1e-6 * film.exposure_ns as f64,
            },
            steps: [1.0, 5.0, 40.0, 60.0].iter().filter(fits).map(exposure).collect(),
        },
        Cause {
            about: About {
                name: "threshold",
                unit: "log intensity",
                meaning: "the sensors' contrast threshold, which is stated rightly",
                kind: Kind::Sensors,
                usual: film.events.threshold_on,
            },
            steps: [0.1, 0.4, 0.8].iter().map(threshold).collect(),
        },
    ]
}

/// What fewer and more cameras cost, at places that are spread as evenly.
fn other_cameras(stage: &Filmed) -> Vec<Cause> {
    let ([rgb, event], [most_rgb, most_event]) = (stage.cameras, stage.most);
    let cause =
        |[name, meaning]: [&'static str; 2], usual: usize, counts: &[usize], rig: &dyn Fn(usize) -> [usize; 2]| {
            let step = |&count: &usize| {
                let [rgb, event] = rig(count);
                let wrong = Disturbance { cameras: Some(stage.spread(rgb, event)), ..Disturbance::default() };
                let size = count as f64;
                Step { size, name: self::name(name, size), events: event > 0, how: How::Disturb(Box::new(wrong)) }
            };
            let about = About { name, unit: "", meaning, kind: Kind::Cameras, usual: usual as f64 };
            Cause { about, steps: counts.iter().filter(|&&count| count != usual).map(step).collect() }
        };
    let up_to =
        |most: usize, counts: &[usize]| counts.iter().copied().filter(|&count| count <= most).collect::<Vec<_>>();
    vec![
        cause(["RGB cameras", "how many there are, on the same arc"], rgb, &up_to(most_rgb, &[4, 8, 16]), &|count| {
            [count, event]
        }),
        cause(
            ["event cameras", "how many there are, on the same arc; without any it is the method without events"],
            event,
            &up_to(most_event, &[0, 1, 3, 6]),
            &|count| [rgb, count],
        ),
    ]
}
