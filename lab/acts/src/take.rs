//! A take: acts with a seed, filmed by an ordinary rig and by an ideal one.

use std::path::{Path, PathBuf};

use erfgs_base::Progress;
use erfgs_dataset::Dataset;
use erfgs_stage::{Act, FilmOptions, RigOptions, StageOptions, film};

use crate::ActsError;

/// How large the films are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Six tenths of a second at 320 x 180, of which figures can be quoted.
    Full,
    /// A few small frames, to see that everything works.
    Small,
}

/// Acts with a seed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Take {
    /// What happens, at once.
    pub acts: Vec<Act>,
    /// The seed.
    pub seed: u64,
}

impl Take {
    /// The acts, joined: `throw`, or `throw+fan`.
    #[must_use]
    pub fn act(&self) -> String {
        self.acts.iter().map(|act| act.name()).collect::<Vec<_>>().join("+")
    }

    /// Its name, and that of its dataset; another for what an ideal rig records.
    #[must_use]
    pub fn name(&self, ideal: bool) -> String {
        format!("{}-{}{}", self.act(), self.seed, if ideal { "-ceiling" } else { "" })
    }

    /// Where its dataset lies.
    #[must_use]
    pub fn folder(&self, datasets: &Path, ideal: bool) -> PathBuf {
        datasets.join(self.name(ideal))
    }

    /// How it is filmed.
    #[must_use]
    pub fn options(&self, size: Size, ideal: bool) -> FilmOptions {
        let rig = match size {
            Size::Full => RigOptions { width: 320, height: 180, rgb: 8, event: 3, test: 2, ..RigOptions::default() },
            Size::Small => RigOptions { width: 96, height: 54, rgb: 3, event: 1, test: 1, ..RigOptions::default() },
        };
        let full = size == Size::Full;
        let options = FilmOptions {
            stage: StageOptions { acts: self.acts.clone(), ..StageOptions::default() },
            rig,
            seed: self.seed,
            duration_ns: if full { 600_000_000 } else { 200_000_000 },
            rgb_fps: 15.0,
            exposure_ns: 20_000_000,
            test_fps: if full { 60.0 } else { 30.0 },
            truth_points: 0,
            name: self.name(ideal),
            ..FilmOptions::default()
        };
        if ideal { options.ceiling() } else { options }
    }

    /// Its dataset, filmed or found.
    ///
    /// # Errors
    /// [`ActsError`].
    pub fn film(
        &self,
        datasets: &Path,
        size: Size,
        ideal: bool,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Dataset, ActsError> {
        let folder = self.folder(datasets, ideal);
        if folder.join(Dataset::MANIFEST).is_file() {
            return Ok(Dataset::load(&folder)?);
        }
        Ok(film(&folder, &self.options(size, ideal), progress)?.dataset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ideal_rig_sees_the_same_take_from_the_same_places() {
        let take = Take { acts: vec![Act::Throw, Act::Fan], seed: 3 };
        assert_eq!((take.name(false).as_str(), take.name(true).as_str()), ("throw+fan-3", "throw+fan-3-ceiling"));
        let [usual, ideal] = [false, true].map(|ideal| take.options(Size::Full, ideal));
        assert_eq!((ideal.exposure_ns, ideal.rgb_fps), (0, 8.0 * usual.rgb_fps));
        let places = |options: &FilmOptions| {
            let rig = options.set_up().unwrap().1;
            rig.into_iter().filter(|camera| !camera.name.starts_with("event")).collect::<Vec<_>>()
        };
        assert_eq!(places(&usual), places(&ideal));
        assert_eq!((usual.test_fps, usual.stage), (ideal.test_fps, ideal.stage));
    }
}
