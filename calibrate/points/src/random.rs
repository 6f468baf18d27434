//! Points at random in the box that the cameras see.

use erfgs_base::random;
use glam::DVec3;

use super::{
    CloudError, CloudPoint,
    photo::{Photo, median_colour},
    rig::{Reach, Rig},
};

const POSITION: u64 = random::purpose("random cloud position");

/// At most so many draws for each point: a box that the cameras hardly see ends in an error instead of a long wait.
const DRAWS_PER_POINT: u64 = 1000;

/// `count` points uniform in `bounds`, or in the box around what the cameras see up to the depth they look at, seen by
/// at least one camera. `photos` are those of the instant `instant`.
pub fn points(
    rig: &Rig<'_>,
    instant: usize,
    photos: &[Photo],
    reach: &Reach,
    bounds: Option<[DVec3; 2]>,
    count: usize,
    seed: u64,
) -> Vec<CloudPoint> {
    let [low, high] = bounds.unwrap_or_else(|| seen_box(rig, reach));
    let taken = &rig.instants[instant];
    let draw = |index: u64| {
        let key = random::key(seed, &[POSITION, index]);
        let along = |axis: u64| random::uniform(random::extend(key, axis));
        low + (high - low) * DVec3::new(along(0), along(1), along(2))
    };
    (0..(count as u64).saturating_mul(DRAWS_PER_POINT))
        .map(draw)
        .filter_map(|position| {
            let colours: Vec<[u8; 3]> = taken
                .shots
                .iter()
                .zip(photos)
                .filter_map(|(&(station, _), photo)| {
                    let (pixel, depth) = rig.stations[station].see(position)?;
                    (depth >= reach.depth_m[0]).then(|| photo.colour(pixel))
                })
                .collect();
            (!colours.is_empty()).then(|| CloudPoint {
                position,
                colour: median_colour(&colours),
                track: 0,
                reprojection_error_px: 0.0,
                t_ns: taken.t_ns,
                instants: 1,
                moving: false,
            })
        })
        .take(count)
        .collect()
}

/// The box around the frusta of all cameras, from the nearest depth to twice the depth that they look at.
fn seen_box(rig: &Rig<'_>, reach: &Reach) -> [DVec3; 2] {
    let far = (2.0 * reach.focus_m).min(reach.depth_m[1]);
    let corners = rig.stations.iter().flat_map(|station| {
        let k = *station.intrinsics();
        let to_world = station.pose().inverse();
        let (w, h) = (f64::from(k.width), f64::from(k.height));
        [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)].into_iter().flat_map(move |(x, y)| {
            [reach.depth_m[0], far].map(|z| to_world.transform(k.unproject_pinhole((x, y).into(), z)))
        })
    });
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

/// Checks a box given by its corners.
pub fn check_bounds(bounds: Option<[[f64; 3]; 2]>) -> Result<Option<[DVec3; 2]>, CloudError> {
    let Some(corners) = bounds else { return Ok(None) };
    let [low, high] = corners.map(DVec3::from);
    if low.is_finite() && high.is_finite() && low.cmplt(high).all() {
        return Ok(Some([low, high]));
    }
    let why = format!("{corners:?} are not the lower and the upper corner of a box");
    Err(CloudError::Option { option: "bounds_m", why })
}
