//! Figures of parts of the held-out frames, and after their cameras' colours were matched.

use std::collections::BTreeMap;

use erfgs_run::{ColourCorrected, Part};

use super::split::When;
use crate::metrics::{ColourSums, Dpsnr, MaskedError, MetricError, Picture, masked_error};

/// One held-out frame.
struct FrameErrors {
    when: When,
    camera: usize,
    moving: MaskedError,
    still: MaskedError,
    fast: MaskedError,
    moving_colours: ColourSums,
    still_colours: ColourSums,
}

/// What is gathered over the held-out frames.
#[derive(Default)]
pub(super) struct Parts {
    frames: Vec<FrameErrors>,
}

impl Parts {
    /// Adds a frame of `camera`, as rendered and as it was, with its masks of what moves and of what is fast, whose error
    /// where it moves is `moving`.
    pub fn add(
        &mut self,
        when: When,
        camera: usize,
        [a, b]: [Picture<'_>; 2],
        [mask, fast]: [&[bool]; 2],
        moving: MaskedError,
    ) -> Result<(), MetricError> {
        let still: Vec<bool> = mask.iter().map(|moves| !moves).collect();
        self.frames.push(FrameErrors {
            when,
            camera,
            moving,
            still: masked_error(a, b, &still)?,
            fast: masked_error(a, b, fast)?,
            moving_colours: ColourSums::of(a, b, mask, true)?,
            still_colours: ColourSums::of(a, b, mask, false)?,
        });
        Ok(())
    }

    /// Mean over frames of the PSNR over pixels that stand still, dB.
    pub fn psnr_static(&self) -> Option<f64> {
        mean(self.frames.iter().map(|frame| frame.still))
    }

    /// The PSNR over the pixels of all frames that are fast, dB.
    pub fn psnr_fast(&self) -> Option<f64> {
        gathered(self.frames.iter().map(|frame| frame.fast)).pooled()
    }

    /// The frames of one kind.
    pub fn part(&self, when: When) -> Part {
        let of = || self.frames.iter().filter(|frame| frame.when == when);
        Part {
            frames: of().count() as u64,
            psnr: mean(of().map(|frame| both(frame.moving, frame.still))),
            dpsnr: mean(of().map(|frame| frame.moving)),
            psnr_fast: gathered(of().map(|frame| frame.fast)).pooled(),
        }
    }

    /// The figures after the colours of each camera were matched on what stands still.
    pub fn colour_corrected(&self) -> Option<ColourCorrected> {
        let mut still: BTreeMap<usize, ColourSums> = BTreeMap::new();
        for frame in &self.frames {
            still.entry(frame.camera).or_default().add(&frame.still_colours);
        }
        let maps: BTreeMap<usize, _> = still.into_iter().map(|(camera, sums)| (camera, sums.fit())).collect();
        let matched =
            |sums: &ColourSums, camera: usize| MaskedError { sum: sums.error(&maps[&camera]), pixels: sums.pixels() };
        let moving = |frame: &FrameErrors| matched(&frame.moving_colours, frame.camera);
        let still = |frame: &FrameErrors| matched(&frame.still_colours, frame.camera);
        Some(ColourCorrected {
            psnr: mean(self.frames.iter().map(|frame| both(moving(frame), still(frame))))?,
            dpsnr: mean(self.frames.iter().map(moving)),
            psnr_static: mean(self.frames.iter().map(still)),
        })
    }
}

fn both(a: MaskedError, b: MaskedError) -> MaskedError {
    MaskedError { sum: a.sum + b.sum, pixels: a.pixels + b.pixels }
}

fn mean(errors: impl Iterator<Item = MaskedError>) -> Option<f64> {
    gathered(errors).mean()
}

fn gathered(errors: impl Iterator<Item = MaskedError>) -> Dpsnr {
    let mut all = Dpsnr::default();
    errors.for_each(|error| all.add(error));
    all
}
