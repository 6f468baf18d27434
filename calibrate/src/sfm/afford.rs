//! Features at a size that the machine affords.
//!
//! Looking for features takes time and memory in proportion to the pixels of the enlarged pictures: 21 pictures of 5.5 megapixels at twice
//! their size are a quarter of an hour on two cores. A rig is found from smaller ones, too.

use std::{fmt, num::NonZero, thread};

use erfgs_base::memory;

use super::{CameraView, SfmOptions};

/// Pixels of a run, enlarged, that a core looks at in about two minutes: COLMAP's SIFT takes 4 s of a core for a million.
const PIXELS_OF_A_CORE: f64 = 30e6;
/// What SIFT keeps of each pixel, of the picture at twice the size: six smoothed levels, five differences and gradients, bytes.
const BYTES_OF_A_PIXEL: f64 = 256.0;
/// A longer side of fewer pixels than this is made no smaller.
const LEAST_SIDE: f64 = 1280.0;

/// Pictures that are looked at at less than the size that was meant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduced {
    /// The size of the largest, enlarged as was meant.
    pub wanted: [u32; 2],
    /// The size at which it is looked at.
    pub taken: [u32; 2],
    /// The share of the sides.
    pub factor: f64,
    /// For how many threads, and bytes of free memory where that is known; nothing where the user gave the size.
    pub machine: Option<(usize, Option<u64>)>,
}

impl fmt::Display for Reduced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([w, h], [x, y]) = (self.taken, self.wanted);
        write!(f, "features are searched at {w} x {h} pixels instead of {x} x {y}")?;
        match self.machine {
            Some((threads, free)) => {
                let free = free.map(|bytes| format!(", {:.1} GiB of memory free", bytes as f64 / f64::from(1 << 30)));
                let longest = x.max(y);
                write!(
                    f,
                    ", the size that this machine handles in some minutes ({threads} threads{}); --feature-side {longest} uses the \
                     full size",
                    free.unwrap_or_default()
                )
            }
            None => Ok(()),
        }
    }
}

impl SfmOptions {
    /// Makes the pictures of all runs smaller, in the same proportion, where looking for features would take more time or memory than
    /// the machine has, or longer sides than `longest` pixels where that is given. Says so if it does.
    pub fn afford(&mut self, views: &[CameraView], longest: Option<u32>) -> Option<Reduced> {
        let enlarge = self.settings.iter().map(|setting| setting.enlarge).fold(0.0, f64::max);
        let reduced = reduced(views, enlarge, self.threads, longest)?;
        for setting in &mut self.settings {
            // As runs are called by it.
            setting.enlarge = (1e3 * setting.enlarge * reduced.factor).round().max(1.0) / 1e3;
        }
        Some(reduced)
    }
}

/// How far pictures of these views that are to be enlarged are made smaller, for `threads` (0: all), where they are.
#[must_use]
pub fn reduced(views: &[CameraView], enlarge: f64, threads: usize, longest: Option<u32>) -> Option<Reduced> {
    let sizes: Vec<[u32; 2]> = views.iter().map(|view| [view.image.width, view.image.height]).collect();
    let threads = if threads == 0 { thread::available_parallelism().map_or(1, NonZero::get) } else { threads };
    within(&sizes, enlarge, threads, memory::available(), longest)
}

fn within(
    sizes: &[[u32; 2]],
    enlarge: f64,
    threads: usize,
    free: Option<u64>,
    longest: Option<u32>,
) -> Option<Reduced> {
    let pixels = |[width, height]: [u32; 2]| f64::from(width) * f64::from(height) * enlarge * enlarge;
    let largest = sizes.iter().copied().max_by(|a, b| pixels(*a).total_cmp(&pixels(*b)))?;
    let side = enlarge * f64::from(sizes.iter().flatten().copied().max()?);
    let factor = match longest {
        Some(longest) => f64::from(longest) / side,
        None => {
            let all: f64 = sizes.iter().copied().map(pixels).sum();
            let by_time = PIXELS_OF_A_CORE * threads as f64 / all;
            // Each thread has a picture of its own.
            let at_once = threads.min(sizes.len()) as f64 * pixels(largest);
            let by_memory = free.map_or(f64::INFINITY, |free| 0.5 * free as f64 / (BYTES_OF_A_PIXEL * at_once));
            by_time.min(by_memory).sqrt().max(LEAST_SIDE / side)
        }
    };
    let scaled = |by: f64| largest.map(|side| ((f64::from(side) * by).round() as u32).max(1));
    let machine = longest.is_none().then_some((threads, free));
    (factor < 1.0).then(|| Reduced { wanted: scaled(enlarge), taken: scaled(enlarge * factor), factor, machine })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const GIB: u64 = 1 << 30;

    #[test]
    fn full_pictures_of_a_large_rig_are_reduced_and_small_ones_are_not() {
        // 21 cameras at full resolution, which took more than eight minutes.
        let large = within(&[[2704, 2028]; 21], 2.0, 2, Some(16 * GIB), None).unwrap();
        let [width, height] = large.taken;
        assert!((1500..2400).contains(&width) && 21 * u64::from(width) * u64::from(height) < 61_000_000, "{large:?}");
        let text = large.to_string();
        for word in ["5408 x 4056", "2 threads", "16.0 GiB", "--feature-side 5408"] {
            assert!(text.contains(word), "{text}");
        }
        // PanopticSports.
        assert_eq!(within(&[[640, 360]; 31], 2.0, 2, Some(16 * GIB), None), None);
        assert_eq!(within(&[[640, 360]; 31], 2.0, 1, Some(GIB), None), None);
        // What the user says.
        assert_eq!(within(&[[2704, 2028]; 21], 2.0, 2, Some(GIB), Some(5408)), None);
        assert_eq!(within(&[[2704, 2028]; 21], 2.0, 2, Some(GIB), Some(u32::MAX)), None);
        let given = within(&[[2704, 2028], [640, 480]], 2.0, 2, Some(GIB), Some(1000)).unwrap();
        assert_eq!((given.taken, given.to_string().contains("machine")), ([1000, 750], false));
        assert_eq!(within(&[], 2.0, 2, None, None), None);
    }

    proptest! {
        #[test]
        fn no_machine_is_asked_for_more_than_it_has(
            sizes in prop::collection::vec((16..8000_u32, 16..8000_u32), 1..40),
            threads in 1..64_usize,
            free in prop::option::of(GIB / 4..64 * GIB),
        ) {
            let sizes: Vec<[u32; 2]> = sizes.into_iter().map(|(width, height)| [width, height]).collect();
            let factor = within(&sizes, 2.0, threads, free, None).map_or(1.0, |reduced| reduced.factor);
            let side = |by: f64| by * f64::from(*sizes.iter().flatten().max().unwrap());
            prop_assert!(factor > 0.0 && factor <= 1.0);
            if side(2.0 * factor) > LEAST_SIDE + 1.0 {
                let pixels = |[w, h]: &[u32; 2]| 4.0 * factor * factor * f64::from(*w) * f64::from(*h);
                let (all, most) = sizes.iter().map(pixels).fold((0.0, 0.0_f64), |(all, most), one| (all + one, most.max(one)));
                prop_assert!(all <= 1.001 * PIXELS_OF_A_CORE * threads as f64);
                let bytes = BYTES_OF_A_PIXEL * most * threads.min(sizes.len()) as f64;
                prop_assert!(free.is_none_or(|free| bytes <= 0.501 * free as f64));
            } else {
                prop_assert!(factor == 1.0 || (side(2.0 * factor) - LEAST_SIDE).abs() < 1.0);
            }
        }
    }

    #[test]
    fn runs_are_reduced_in_proportion() {
        let image = erfgs_scene::image::ImageGrey8::new(3000, 2000);
        let view = |name: &str| CameraView {
            name: name.into(),
            modality: erfgs_scene::Modality::Rgb,
            image: image.clone(),
            intrinsics: None,
            chosen: None,
        };
        let views = [view("a"), view("b"), view("c")];
        let mut options = SfmOptions { threads: 1, ..SfmOptions::default() };
        assert!(options.afford(&views, Some(1500)).is_some());
        assert_eq!(options.settings.iter().map(|setting| setting.enlarge).collect::<Vec<_>>(), [0.5, 0.25, 0.375]);
    }
}
