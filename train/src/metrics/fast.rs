//! The pixels of what is fast: where pictures of one camera that stands still change most from frame to frame.

use super::{MetricError, check_length};

/// The share of the moving pixels that counts as fast.
const SHARE: f64 = 0.1;
/// Steps of a change: the sums of 3 x 3 values of 8 bits go from 0 to 9 x 255.
const STEPS: usize = 9 * 255 + 1;

/// How much the pixels that move change, of a camera's frames in the order of time.
///
/// The change of a pixel is the least of those from the frame before and to the frame after, each the largest of the three channels' in
/// the mean of 3 x 3 pixels: where a thing is for one frame alone, and not what it covered before or uncovers after. The first
/// frame and the last have none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// For each frame the changes of its moving pixels, in their order.
    frames: Vec<Vec<u16>>,
}

impl Changes {
    /// Of 8-bit RGB frames and their masks (`true` = moves).
    ///
    /// # Errors
    /// [`MetricError::Length`] and [`MetricError::Empty`].
    pub fn of(width: u32, height: u32, frames: &[&[u8]], masks: &[&[bool]]) -> Result<Self, MetricError> {
        for (frame, mask) in frames.iter().zip(masks) {
            check_length(width, height, 3, frame.len())?;
            check_length(width, height, 1, mask.len())?;
        }
        let summed: Vec<Vec<[u16; 3]>> = frames.iter().map(|frame| sums(width as usize, frame)).collect();
        let of = |(index, mask): (usize, &&[bool])| {
            let around = index.checked_sub(1).and_then(|before| summed.get(before)).zip(summed.get(index + 1));
            let Some((before, after)) = around else { return Vec::new() };
            let now = &summed[index];
            let moving = mask.iter().enumerate().filter(|(_, moves)| **moves);
            moving.map(|(at, _)| apart(now[at], before[at]).min(apart(now[at], after[at]))).collect()
        };
        Ok(Self { frames: masks.iter().take(frames.len()).enumerate().map(of).collect() })
    }

    /// The pixels of frame `index`, whose mask is given, that change by at least so much.
    #[must_use]
    pub fn mask(&self, index: usize, moving: &[bool], least: u16) -> Vec<bool> {
        let mut changes = self.frames.get(index).into_iter().flatten();
        moving.iter().map(|moves| *moves && changes.next().is_some_and(|change| *change >= least)).collect()
    }
}

/// The change from which on a tenth of the moving pixels of all these cameras are at most; `None` if nothing changes.
#[must_use]
pub fn fast_from<'a>(cameras: impl IntoIterator<Item = &'a Changes>) -> Option<u16> {
    let mut counts = vec![0_u64; STEPS];
    for change in cameras.into_iter().flat_map(|camera| &camera.frames).flatten() {
        counts[usize::from(*change)] += 1;
    }
    let most = (SHARE * counts.iter().sum::<u64>() as f64) as u64;
    let mut above = 0;
    let mut least = None;
    for step in (1..STEPS).rev() {
        above += counts[step];
        if above > most {
            break;
        }
        least = (above > 0).then_some(step as u16);
    }
    least
}

fn apart(a: [u16; 3], b: [u16; 3]) -> u16 {
    std::iter::zip(a, b).map(|(a, b)| a.abs_diff(b)).fold(0, u16::max)
}

/// The sums over the 3 x 3 pixels around each; beyond the border lies what is at it.
fn sums(width: usize, rgb: &[u8]) -> Vec<[u16; 3]> {
    let pixels = rgb.as_chunks::<3>().0;
    let three = |a: [u16; 3], b: [u16; 3], c: [u16; 3]| std::array::from_fn(|k| a[k] + b[k] + c[k]);
    let across: Vec<[u16; 3]> = pixels
        .chunks_exact(width)
        .flat_map(|row| {
            let at = move |x: usize| row[x.min(width - 1)].map(u16::from);
            (0..width).map(move |x| three(at(x.saturating_sub(1)), at(x), at(x + 1)))
        })
        .collect();
    let last = across.len() - width;
    (0..across.len())
        .map(|at| {
            let above = if at < width { at } else { at - width };
            let below = if at >= last { at } else { at + width };
            three(across[above], across[at], across[below])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 40;
    const HEIGHT: usize = 30;

    /// A grey room in which a white square of 4 pixels flies by 6 pixels a frame, and one of 12 creeps by one.
    fn frames(count: usize) -> (Vec<Vec<u8>>, Vec<Vec<bool>>) {
        let squares = |index: usize| [(6 * index, 4, 4), (index, 14, 12)];
        let inside = |index: usize, at: usize| {
            let (x, y) = (at % WIDTH, at / WIDTH);
            squares(index)
                .iter()
                .any(|&(left, top, side)| (left..left + side).contains(&x) && (top..top + side).contains(&y))
        };
        let masks: Vec<Vec<bool>> =
            (0..count).map(|index| (0..WIDTH * HEIGHT).map(|at| inside(index, at)).collect()).collect();
        let frame = |mask: &Vec<bool>| mask.iter().flat_map(|moves| [if *moves { 250 } else { 100 }; 3]).collect();
        (masks.iter().map(frame).collect(), masks)
    }

    fn changes(frames: &[Vec<u8>], masks: &[Vec<bool>]) -> Changes {
        let (frames, masks): (Vec<&[u8]>, Vec<&[bool]>) =
            (frames.iter().map(Vec::as_slice).collect(), masks.iter().map(Vec::as_slice).collect());
        Changes::of(WIDTH as u32, HEIGHT as u32, &frames, &masks).unwrap()
    }

    #[test]
    fn what_flies_is_fast_and_what_creeps_is_not() {
        let (frames, masks) = frames(6);
        let changes = changes(&frames, &masks);
        let least = fast_from([&changes]).expect("something flies");
        for (index, mask) in masks.iter().enumerate() {
            let fast: Vec<usize> = changes
                .mask(index, mask, least)
                .iter()
                .enumerate()
                .filter(|(_, fast)| **fast)
                .map(|(at, _)| at)
                .collect();
            if [0, 5].contains(&index) {
                assert!(fast.is_empty(), "there is no frame before or after frame {index}");
            } else {
                // All of the small square: 16 of 160 pixels are a tenth, and all of them were grey before and are after.
                assert_eq!(fast.len(), 16, "frame {index}");
                assert!(fast.iter().all(|at| at / WIDTH < 8), "frame {index}");
            }
        }
    }

    #[test]
    fn where_nothing_changes_nothing_is_fast() {
        let (frames, masks) = frames(1);
        let still = [frames[0].clone(), frames[0].clone(), frames[0].clone()];
        let masks = [masks[0].clone(), masks[0].clone(), masks[0].clone()];
        assert_eq!(fast_from([&changes(&still, &masks)]), None);
        assert_eq!(fast_from([]), None);
        assert_eq!(fast_from([&changes(&still[..1], &masks[..1])]), None, "a single frame");
        assert!(Changes::of(3, 3, &[&[0; 5]], &[&[false; 9]]).is_err());
    }

    #[test]
    fn sums_are_those_of_nine_pixels() {
        let rgb: Vec<u8> = (0..4 * 3 * 3).map(|at| (at * 37 % 251) as u8).collect();
        for (at, sum) in sums(4, &rgb).into_iter().enumerate() {
            let (x, y) = ((at % 4) as i32, (at / 4) as i32);
            for (channel, sum) in sum.into_iter().enumerate() {
                let mut want = 0;
                for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
                    let (x, y) = ((x + dx).clamp(0, 3) as usize, (y + dy).clamp(0, 2) as usize);
                    want += u16::from(rgb[(y * 4 + x) * 3 + channel]);
                }
                assert_eq!(sum, want, "pixel {at}");
            }
        }
    }
}
