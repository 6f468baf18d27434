//! Points of what moves between two frames: the hull of what event cameras see.
//!
//! The sum of a pixel's events is the logarithm of its light but for a constant, and most of the time the pixel sees what
//! stands still. Where the sum is not what it is most of the time, something else is before the pixel, at any microsecond. Event
//! cameras see no colours: points take those of the nearest points of the instant before or after, from frame to frame.

use erfgs_dataset::{Camera, Split};
use glam::DVec3;
use rayon::prelude::*;

use super::{
    CloudError, CloudOptions, CloudPoint, CloudStep, Progress, Reach, Silhouette, SilhouetteView, carve, outer,
};
use crate::rig::{Instant, Rig, Station, station};

/// Fewer views of event cameras say too little: the hull of two is mostly what is not there.
const FEWEST_CAMERAS: usize = 3;
/// More instants than this are not looked at, over the recording.
const MOST_INSTANTS: usize = 100;
/// What a pixel sees most of the time is that of so many frame intervals before and after.
const USUAL_WITHIN: usize = 4;
/// A pixel of which the logarithm of the light differs by less than this, or by less than its threshold, sees the same.
const LEAST_CHANGE: f64 = 0.1;
/// Levels are kept in so many parts of a unit of the logarithm.
const PARTS: f64 = 100.0;

/// An event camera, and the logarithm of its light at every time that is looked at.
struct Levels<'a> {
    station: Station<'a>,
    /// A picture for each time, row-major, in hundredths.
    at: Vec<Vec<i16>>,
    least: i16,
}

/// The points at `between` instants between the middle of each frame's exposure and that of the next, coloured as `known` points of
/// the frames are.
pub fn points(
    rig: &Rig<'_>,
    frames: &[Instant<'_>],
    known: &[CloudPoint],
    options: &CloudOptions,
    reach: &Reach,
    progress: Progress<'_>,
) -> Result<Vec<CloudPoint>, CloudError> {
    let gaps = frames.len().saturating_sub(1);
    let parts = (options.hull.between as usize).min(MOST_INSTANTS / gaps.max(1)) + 1;
    let cameras: Vec<&Camera> = rig.dataset.cameras(Split::Train).filter(|camera| camera.events.is_some()).collect();
    if parts < 2 || gaps == 0 || cameras.len() < FEWEST_CAMERAS {
        return Ok(Vec::new());
    }
    let middles: Vec<i64> = frames.iter().map(middle_ns).collect();
    // Frames' times, too: what is usual is taken over all of them.
    let mut times: Vec<i64> = (0..gaps * parts)
        .map(|at| {
            let (gap, part) = (at / parts, (at % parts) as i64);
            middles[gap] + (middles[gap + 1] - middles[gap]) * part / parts as i64
        })
        .collect();
    times.push(middles[gaps]);
    let total = times.len() + cameras.len();
    let mut levels = Vec::new();
    for (done, camera) in cameras.into_iter().enumerate() {
        progress(CloudStep::Silhouettes, done, total);
        levels.extend(Levels::new(rig, camera, &times)?);
    }
    let most = (options.hull.max_points as usize / (gaps * (parts - 1))).max(1);
    let shell = |at: usize| -> Vec<DVec3> {
        let views: Vec<SilhouetteView<'_>> = levels
            .iter()
            .filter(|levels| levels.covers(times[at]))
            .map(|levels| SilhouetteView {
                station: &levels.station,
                silhouette: levels.silhouette(at, USUAL_WITHIN * parts),
            })
            .collect();
        if views.len() < FEWEST_CAMERAS {
            return Vec::new();
        }
        let (grid, cells) = carve(&views, reach, options.hull.cell_px, FEWEST_CAMERAS as u32);
        let outer = outer(&cells);
        outer.iter().step_by(outer.len().div_ceil(most).max(1)).map(|&cell| grid.centre(cell)).collect()
    };
    let mut found = Vec::new();
    for gap in 0..gaps {
        progress(CloudStep::Silhouettes, total - times.len() + gap * parts, total);
        let shells: Vec<Vec<DVec3>> = (1..parts).into_par_iter().map(|part| shell(gap * parts + part)).collect();
        // From either frame to the middle.
        let half = shells.len().div_ceil(2);
        let of_frame = |t_ns: i64| known.iter().filter(|point| point.t_ns == t_ns).copied().collect::<Vec<_>>();
        for (frame, order) in [(gap, (0..half).collect::<Vec<_>>()), (gap + 1, (half..shells.len()).rev().collect())] {
            let mut before = of_frame(frames[frame].t_ns);
            for part in order {
                let t_ns = times[gap * parts + part + 1];
                let coloured = coloured(&shells[part], &before, levels.len(), t_ns);
                found.extend_from_slice(&coloured);
                before = coloured;
            }
        }
    }
    progress(CloudStep::Silhouettes, total, total);
    Ok(found)
}

/// The middle of the exposures of an instant, whose label may be their beginning.
fn middle_ns(instant: &Instant<'_>) -> i64 {
    let middle = |[open, close]: [i64; 2]| open + (close - open) / 2;
    let sum: i128 = instant.shots.iter().map(|(_, frame)| i128::from(middle(frame.exposure_ns))).sum();
    (sum / instant.shots.len().max(1) as i128) as i64
}

/// Points at `places` with the colours of those that are nearest to them; none where there are none.
fn coloured(places: &[DVec3], before: &[CloudPoint], views: usize, t_ns: i64) -> Vec<CloudPoint> {
    let point = |place: &DVec3| {
        let squared = |point: &&CloudPoint| (point.position - *place).length_squared();
        let nearest = before.iter().min_by(|a, b| squared(a).total_cmp(&squared(b)))?;
        Some(super::moving_point(*place, nearest.colour, views, t_ns))
    };
    places.par_iter().filter_map(point).collect()
}

impl<'a> Levels<'a> {
    /// Of a camera at `times`, which are in order.
    fn new(rig: &Rig<'_>, camera: &'a Camera, times: &[i64]) -> Result<Option<Self>, CloudError> {
        let station = station(camera)?;
        let (Some(file), Some(events)) = (&camera.events, rig.dataset.read_events(camera)?) else { return Ok(None) };
        let width = camera.intrinsics.width as usize;
        let mut level = vec![0.0_f32; width * camera.intrinsics.height as usize];
        let [on, off] = [file.threshold_on, -file.threshold_off].map(|threshold| (PARTS * threshold) as f32);
        let mut next = events.iter().peekable();
        let at = times
            .iter()
            .map(|t_ns| {
                while let Some(event) = next.next_if(|event| event.t_us.saturating_mul(1000) <= *t_ns) {
                    if let Some(level) = level.get_mut(usize::from(event.y) * width + usize::from(event.x)) {
                        *level += if event.on { on } else { off };
                    }
                }
                level.iter().map(|level| level.round() as i16).collect()
            })
            .collect();
        let least = LEAST_CHANGE.max(0.75 * file.threshold_on.max(file.threshold_off));
        Ok(Some(Self { station, at, least: (PARTS * least).min(f64::from(i16::MAX)) as i16 }))
    }

    fn covers(&self, t_ns: i64) -> bool {
        let covers = self.station.camera.events.as_ref().map(|events| events.covers_ns);
        covers.is_some_and(|[first, last]| (first..=last).contains(&t_ns))
    }

    /// Where the camera sees something else at the time with index `at` than at most times `within` so many steps of it.
    fn silhouette(&self, at: usize, within: usize) -> Silhouette {
        let near = &self.at[at.saturating_sub(within)..(at + within + 1).min(self.at.len())];
        let (width, height) = (self.station.camera.intrinsics.width, self.station.camera.intrinsics.height);
        let mut differs = vec![false; self.at[at].len()];
        let mut some = vec![0_i16; near.len()];
        for (pixel, differs) in differs.iter_mut().enumerate() {
            some.iter_mut().zip(near).for_each(|(some, levels)| *some = levels[pixel]);
            let now = self.at[at][pixel];
            if some.iter().any(|level| *level != now) {
                let middle = some.len() / 2;
                let usual = *some.select_nth_unstable(middle).1;
                *differs = now.abs_diff(usual) >= self.least.unsigned_abs();
            }
        }
        Silhouette::new(width, height, |x, y| differs[(y * width + x) as usize])
    }
}
