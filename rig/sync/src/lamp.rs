//! A flashing lamp in a session: when it was lit, as an event camera saw it, and how bright the frames were.

use erfgs_session::{clock::Clock, source::Description};

use super::{
    flash::{self, FlashLag},
    frames::Arrived,
};

/// Width of a bin of events, microseconds.
const BIN_US: u64 = 1000;
/// The longest time that is looked at: six hours.
const MAX_BINS: u64 = 6 * 3_600_000;
/// Fewer flashes than this may be anything.
const MIN_FLASHES: usize = 3;
/// What is taken for the exposure of a camera that does not say it, nanoseconds.
const SHORT_NS: i64 = 1_000_000;

/// Counts of OFF and ON events in bins of the camera's own time.
#[derive(Default)]
pub(super) struct Counts {
    bins: Vec<(u64, [u32; 2])>,
}

impl Counts {
    pub fn add(&mut self, t_us: u64, on: bool) {
        let bin = t_us / BIN_US;
        match self.bins.last_mut() {
            Some((last, counts)) if *last == bin => counts[usize::from(on)] += 1,
            _ => {
                let mut counts = [0; 2];
                counts[usize::from(on)] = 1;
                self.bins.push((bin, counts));
            }
        }
    }

    /// The intervals of session time in which a lamp was lit.
    pub fn lit(&self, clock: &Clock) -> Vec<[i64; 2]> {
        let bins = || self.bins.iter().map(|(bin, _)| *bin);
        let (Some(first), Some(last)) = (bins().min(), bins().max()) else { return Vec::new() };
        let count = (last - first).min(MAX_BINS) as usize + 1;
        let mut counts = [vec![0_u32; count], vec![0_u32; count]];
        for (bin, found) in &self.bins {
            let at = (bin - first) as usize;
            for (counts, found) in std::iter::zip(&mut counts, found) {
                if let Some(count) = counts.get_mut(at) {
                    *count += found;
                }
            }
        }
        let [off, on] = &counts;
        let session_ns = |ns: i64| {
            // Halves of bins are whole microseconds.
            let ticks = (first * BIN_US).saturating_add(ns.unsigned_abs() / 1000);
            clock.session_ns(i64::try_from(ticks).unwrap_or(i64::MAX))
        };
        let lit = flash::lit_intervals(on, off, 0, BIN_US as i64 * 1000).into_iter();
        lit.map(|interval| interval.map(session_ns)).collect()
    }
}

/// A lamp's flashes in session time.
pub(super) struct Lamp {
    /// The event camera that saw them.
    pub seen_by: String,
    pub lit: Vec<[i64; 2]>,
}

impl Lamp {
    /// A lamp, unless fewer than three flashes stand out.
    pub fn new(seen_by: &str, lit: Vec<[i64; 2]>) -> Option<Self> {
        (lit.len() >= MIN_FLASHES).then(|| Self { seen_by: seen_by.to_owned(), lit })
    }

    /// The lag of a free-running camera. Frames without a brightness are left out.
    pub fn lag(&self, frames: &[Arrived], brightness: &[Option<f64>], exposure_ns: Option<i64>) -> Option<FlashLag> {
        let known = std::iter::zip(frames, brightness).filter_map(|(frame, level)| Some((*frame, (*level)?)));
        let (frames, levels): (Vec<Arrived>, Vec<f64>) = known.unzip();
        flash::find_lag(&frames, &levels, &self.lit, exposure_ns.unwrap_or(SHORT_NS).max(SHORT_NS))
    }
}

/// Mean level of a frame, 0 to 255; `None` if it cannot be decoded.
pub(super) fn brightness(description: &Description, payload: &[u8]) -> Option<f64> {
    let image = description.frame_format()?.picture(payload).ok()?;
    let sum: u64 = image.data.iter().map(|&level| u64::from(level)).sum();
    Some(sum as f64 / image.data.len().max(1) as f64)
}
