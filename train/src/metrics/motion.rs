//! Masks of moving pixels, made from the frames of one camera that stands still.

use rayon::prelude::*;

use super::{MetricError, check_length};

/// How moving pixels are told from still ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotionMaskOptions {
    /// A pixel moves where a channel differs from its median over time by more than this, 8-bit steps.
    pub threshold: u8,
    /// Gaps up to twice this wide are closed, pixels.
    pub close_px: u32,
    /// What is then at most twice this wide is removed, pixels.
    pub open_px: u32,
}

impl Default for MotionMaskOptions {
    fn default() -> Self {
        Self { threshold: 24, close_px: 2, open_px: 1 }
    }
}

/// One mask a frame (`true` = moves), of the 8-bit RGB frames of one camera.
///
/// The background is the median over the frames, channel by channel; a pixel moves in a frame where its largest
/// channel difference from the background exceeds the threshold. A morphological closing and then an opening (with
/// squares) follow. This stands in for segmentation masks where a dataset has none, and finds what moves through; what
/// stays at one place for more than half of the frames becomes background there.
///
/// # Errors
/// [`MetricError::Length`] and [`MetricError::Empty`].
pub fn motion_masks(
    width: u32,
    height: u32,
    frames: &[&[u8]],
    options: &MotionMaskOptions,
) -> Result<Vec<Vec<bool>>, MetricError> {
    for frame in frames {
        check_length(width, height, 3, frame.len())?;
    }
    let Some(first) = frames.first() else { return Ok(Vec::new()) };
    let background: Vec<u8> = (0..first.len())
        .into_par_iter()
        .map_init(Vec::new, |values, i| {
            values.clear();
            values.extend(frames.iter().map(|frame| frame[i]));
            let middle = values.len() / 2;
            *values.select_nth_unstable(middle).1
        })
        .collect();
    let grid = Grid { width: width as usize, height: height as usize };
    let mask_of = |frame: &&[u8]| {
        let differs = |(now, still): (&[u8; 3], &[u8; 3])| {
            now.iter().zip(still).any(|(now, still)| now.abs_diff(*still) > options.threshold)
        };
        let raw: Vec<bool> = frame.as_chunks::<3>().0.iter().zip(background.as_chunks::<3>().0).map(differs).collect();
        let (close, open) = (options.close_px as usize, options.open_px as usize);
        let closed = grid.erode(&grid.dilate(&raw, close), close);
        grid.dilate(&grid.erode(&closed, open), open)
    };
    Ok(frames.par_iter().map(mask_of).collect())
}

struct Grid {
    width: usize,
    height: usize,
}

impl Grid {
    /// Sets what lies within a square of side `2 radius + 1` around a set pixel.
    fn dilate(&self, mask: &[bool], radius: usize) -> Vec<bool> {
        let mut across = vec![false; mask.len()];
        for y in 0..self.height {
            spread(self.width, radius, |x| mask[y * self.width + x], |x| across[y * self.width + x] = true);
        }
        let mut both = vec![false; mask.len()];
        for x in 0..self.width {
            spread(self.height, radius, |y| across[y * self.width + x], |y| both[y * self.width + x] = true);
        }
        both
    }

    /// Clears what lies within such a square around a clear pixel. Outside the picture nothing is clear, so that what
    /// touches the border stays.
    fn erode(&self, mask: &[bool], radius: usize) -> Vec<bool> {
        let clear: Vec<bool> = mask.iter().map(|set| !set).collect();
        self.dilate(&clear, radius).iter().map(|clear| !clear).collect()
    }
}

/// Calls `mark` for all positions of a line that lie within `radius` of one where `set`, in one pass.
fn spread(length: usize, radius: usize, set: impl Fn(usize) -> bool, mut mark: impl FnMut(usize)) {
    let mut marked = 0;
    for at in (0..length).filter(|&at| set(at)) {
        let end = (at + radius + 1).min(length);
        for position in at.saturating_sub(radius).max(marked)..end {
            mark(position);
        }
        marked = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 32;
    const HEIGHT: usize = 20;

    /// Frames of a grey room through which a white square of `side` pixels moves by 3 pixels a frame.
    fn frames(count: usize, side: usize) -> Vec<Vec<u8>> {
        let frame = |index: usize| {
            let mut frame = vec![100; WIDTH * HEIGHT * 3];
            for y in 6..6 + side {
                for x in 3 * index..3 * index + side {
                    frame[(y * WIDTH + x) * 3..][..3].fill(250);
                }
            }
            frame
        };
        (0..count).map(frame).collect()
    }

    fn masks(frames: &[Vec<u8>], options: &MotionMaskOptions) -> Vec<Vec<bool>> {
        let views: Vec<&[u8]> = frames.iter().map(Vec::as_slice).collect();
        motion_masks(WIDTH as u32, HEIGHT as u32, &views, options).unwrap()
    }

    #[test]
    fn a_square_that_passes_is_found_exactly() {
        let masks = masks(&frames(8, 5), &MotionMaskOptions::default());
        for (index, mask) in masks.iter().enumerate() {
            for y in 0..HEIGHT {
                for x in 0..WIDTH {
                    let inside = (6..11).contains(&y) && (3 * index..3 * index + 5).contains(&x);
                    assert_eq!(mask[y * WIDTH + x], inside, "frame {index} pixel {x},{y}");
                }
            }
        }
    }

    #[test]
    fn noise_and_single_pixels_do_not_move_and_holes_are_closed() {
        let mut frames = frames(8, 7);
        for frame in &mut frames {
            for (i, value) in frame.iter_mut().enumerate() {
                *value = value.saturating_add((i * 7 % 11) as u8);
            }
        }
        frames[2][(16 * WIDTH + 28) * 3] = 255;
        frames[2][(9 * WIDTH + 9) * 3..][..3].fill(100);
        let masks = masks(&frames, &MotionMaskOptions::default());
        assert!(!masks[2][16 * WIDTH + 28], "a lone pixel");
        assert!(masks[2][9 * WIDTH + 9], "a hole in the square");
        assert_eq!(masks[2].iter().filter(|&&moves| moves).count(), 49);
    }

    #[test]
    fn a_still_scene_has_no_moving_pixels() {
        let still = vec![vec![77; WIDTH * HEIGHT * 3]; 5];
        assert!(masks(&still, &MotionMaskOptions::default()).iter().flatten().all(|moves| !moves));
        assert!(masks(&[], &MotionMaskOptions::default()).is_empty());
    }

    #[test]
    fn what_touches_the_border_is_not_eaten() {
        let masks = masks(&frames(9, 5), &MotionMaskOptions { open_px: 2, ..MotionMaskOptions::default() });
        assert_eq!(masks[0].iter().filter(|&&moves| moves).count(), 25, "the square starts at the left border");
    }
}
