//! The base: the scene and the rig that nothing is wrong with.

use std::path::Path;

use erfgs_base::Progress;
use erfgs_dataset::{
    Dataset, Split,
    disturb::{Disturbance, disturb},
};
use erfgs_stage::{FilmOptions, RigOptions, film};

use crate::BudgetError;

/// How large the film is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Half a second at 320 x 180, of which figures can be quoted.
    Full,
    /// A few small frames, to see that everything works.
    Small,
}

/// What is compared with.
#[derive(Clone, Debug)]
pub struct Base {
    /// The dataset.
    pub dataset: Dataset,
    pub(crate) stage: Option<Filmed>,
}

/// What the base was filmed with.
#[derive(Clone, Debug)]
pub(crate) struct Filmed {
    /// All cameras.
    pub all: Dataset,
    /// How those of the base were filmed.
    pub film: FilmOptions,
    /// How many RGB and event cameras the base has.
    pub cameras: [usize; 2],
    /// How many there are.
    pub most: [usize; 2],
}

impl Filmed {
    /// Names of so many cameras, spread evenly.
    pub fn spread(&self, rgb: usize, event: usize) -> Vec<String> {
        spread(rgb, event, self.most)
    }
}

/// RGB and event cameras of the base, and of the film that it is taken from.
fn rig(size: Size) -> [[usize; 2]; 2] {
    match size {
        Size::Full => [[8, 3], [16, 6]],
        Size::Small => [[4, 1], [4, 2]],
    }
}

fn options(size: Size) -> FilmOptions {
    let [_, [rgb, event]] = rig(size);
    let (width, height) = match size {
        Size::Full => (320, 180),
        Size::Small => (96, 54),
    };
    FilmOptions {
        rig: RigOptions {
            width,
            height,
            rgb,
            event,
            test: if size == Size::Full { 2 } else { 1 },
            ..RigOptions::default()
        },
        // Another stage than the one that defaults were chosen on.
        seed: 2,
        duration_ns: if size == Size::Full { 500_000_000 } else { 200_000_000 },
        rgb_fps: 15.0,
        exposure_ns: 20_000_000,
        test_fps: if size == Size::Full { 60.0 } else { 20.0 },
        truth_points: 0,
        ..FilmOptions::default()
    }
}

impl Base {
    /// The stage, filmed into `folder`, or found there.
    ///
    /// # Errors
    /// [`BudgetError`].
    pub fn of_stage(size: Size, folder: &Path, progress: &(dyn Fn(Progress) + Sync)) -> Result<Self, BudgetError> {
        let options = options(size);
        let [cameras, most] = rig(size);
        let place = folder.join("all-cameras");
        let all = match place.join(Dataset::MANIFEST).is_file() {
            true => Dataset::load(&place)?,
            false => film(&place, &options, progress)?.dataset,
        };
        let names = spread(cameras[0], cameras[1], most);
        let base = folder.join("base");
        let dataset = match base.join(Dataset::MANIFEST).is_file() {
            true => Dataset::load(&base)?,
            false => {
                let wrong = Disturbance { cameras: Some(names.clone()), ..Disturbance::default() };
                disturb(&all, &wrong, &base, &mut |step| progress(step))?
            }
        };
        let filming = dataset.manifest.cameras.iter().map(|camera| camera.name.clone()).collect();
        let film = FilmOptions { cameras: Some(filming), ..options };
        Ok(Self { dataset, stage: Some(Filmed { all, film, cameras, most }) })
    }

    /// A dataset of the user's, whose truth is what it says.
    #[must_use]
    pub fn of_dataset(dataset: Dataset) -> Self {
        Self { dataset, stage: None }
    }

    /// The dataset that cameras can be chosen from.
    pub(crate) fn all_cameras(&self) -> &Dataset {
        self.stage.as_ref().map_or(&self.dataset, |stage| &stage.all)
    }

    /// Whether a training camera has events.
    #[must_use]
    pub fn has_events(&self) -> bool {
        self.dataset.cameras(Split::Train).any(|camera| camera.events.is_some())
    }
}

/// Names of `rgb` and `event` cameras of the stage, which has `most` of each, spread evenly and alike on both sides.
fn spread(rgb: usize, event: usize, most: [usize; 2]) -> Vec<String> {
    let of = |prefix: &str, count: usize, most: usize| -> Vec<String> {
        (0..count.min(most))
            .map(|index| {
                // The middle of the index's share; on the border of two, the outer one.
                let twice = (2 * index + 1) * most;
                let on_the_border = twice.is_multiple_of(2 * count);
                let left = 2 * index + 1 < count;
                format!("{prefix}{:02}", twice / (2 * count) - usize::from(on_the_border && left))
            })
            .collect()
    };
    let mut names = of("rgb", rgb, most[0]);
    names.extend(of("event", event, most[1]));
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_spread_evenly_and_alike_on_both_sides() {
        let places = |count, most| -> Vec<usize> {
            spread(count, 0, [most, 0]).iter().map(|name| name["rgb".len()..].parse().unwrap()).collect()
        };
        assert_eq!(places(8, 16), [0, 2, 4, 6, 9, 11, 13, 15]);
        assert_eq!(places(4, 16), [1, 5, 10, 14]);
        assert_eq!(places(16, 16), (0..16).collect::<Vec<_>>());
        assert_eq!(places(3, 6), [0, 3, 5]);
        assert_eq!(places(1, 6), [3]);
        assert_eq!(spread(1, 1, [4, 2]), ["rgb02", "event01"]);
    }
}
