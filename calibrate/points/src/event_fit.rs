//! Whether event cameras are the right way up: what moves must be where they have events.
//!
//! An event camera has no pictures that could be matched with those of others. But where the points of what moves are in its
//! image at an instant, by its pose, there it should have events around that instant, and few elsewhere. How well both agree is
//! their correlation over the cells of a coarse grid; that of a camera that hangs upside down is better if the image is turned.

use std::collections::BTreeMap;

use erfgs_dataset::{Camera, Dataset, DatasetError};
use glam::{DVec2, DVec3};

use super::CloudPoint;

/// Cells along the wider side of a sensor.
const CELLS: u32 = 48;
/// Events so long before and after an instant are held against the points of it, microseconds.
const AROUND_US: i64 = 5_000;
/// Fewer instants, or fewer points in all of them, tell nothing.
const FEWEST_INSTANTS: usize = 4;
const FEWEST_POINTS: usize = 50;

/// How well the events of a camera agree with the points of what moves.
#[derive(Clone, Debug, PartialEq)]
pub struct EventFit {
    /// The camera.
    pub camera: String,
    /// The correlation by its pose.
    pub upright: f64,
    /// The same if it is turned by half a turn about its optical axis.
    pub upside_down: f64,
}

/// What speaks for a camera that is upside down: so good a correlation, and so much better than that by its pose.
const LEAST: f64 = 0.1;
const BETTER: f64 = 0.1;

impl EventFit {
    /// Whether the camera hangs upside down.
    #[must_use]
    pub fn is_upside_down(&self) -> bool {
        self.upside_down > LEAST && self.upside_down > self.upright + BETTER
    }
}

/// Holds the event cameras of a dataset against the `points` of what moves; cameras that see too little of it are left out.
///
/// # Errors
/// If events cannot be read.
pub fn event_fit(dataset: &Dataset, points: &[CloudPoint]) -> Result<Vec<EventFit>, DatasetError> {
    let mut instants: BTreeMap<i64, Vec<DVec3>> = BTreeMap::new();
    for point in points.iter().filter(|point| point.moving) {
        instants.entry(point.t_ns).or_default().push(point.position);
    }
    let mut found = Vec::new();
    for camera in &dataset.manifest.cameras {
        found.extend(of_camera(dataset, camera, &instants)?);
    }
    Ok(found)
}

fn of_camera(
    dataset: &Dataset,
    camera: &Camera,
    instants: &BTreeMap<i64, Vec<DVec3>>,
) -> Result<Option<EventFit>, DatasetError> {
    let Some(file) = &camera.events else { return Ok(None) };
    let Some(events) = dataset.read_events(camera)? else { return Ok(None) };
    let k = &camera.intrinsics;
    let side = (k.width.max(k.height)).div_ceil(CELLS).max(1);
    let (columns, rows) = (k.width.div_ceil(side) as usize, k.height.div_ceil(side) as usize);
    let cell = |at: DVec2| {
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < f64::from(k.width) && at.y < f64::from(k.height);
        inside.then(|| (at.y / f64::from(side)) as usize * columns + (at.x / f64::from(side)) as usize)
    };
    let (mut upright, mut turned) = (Correlation::default(), Correlation::default());
    let (mut used, mut seen) = (0, 0);
    for (&t_ns, points) in instants {
        let around = [t_ns / 1000 - AROUND_US, t_ns / 1000 + AROUND_US];
        if around[0] * 1000 < file.covers_ns[0] || around[1] * 1000 > file.covers_ns[1] {
            continue;
        }
        let mut activity = vec![0_u32; columns * rows];
        for index in events.between(around[0], around[1]) {
            let at = DVec2::new(f64::from(events.x[index]), f64::from(events.y[index]));
            if let Some(cell) = cell(at) {
                activity[cell] += 1;
            }
        }
        let mut expected = [vec![0.0; columns * rows], vec![0.0; columns * rows]];
        for point in points {
            let at = camera.world_to_camera.transform(*point);
            if at.z <= 0.0 {
                continue;
            }
            let pixel = k.project_pinhole(at);
            let turned = DVec2::new(2.0 * k.cx, 2.0 * k.cy) - pixel;
            for (expected, pixel) in std::iter::zip(&mut expected, [pixel, turned]) {
                if let Some(cell) = cell(pixel) {
                    expected[cell] = 1.0;
                }
            }
            seen += usize::from(cell(pixel).is_some() || cell(turned).is_some());
        }
        // Pixels that flicker or an edge of great contrast must not outweigh all else.
        let activity: Vec<f64> = activity.into_iter().map(|count| f64::from(count).ln_1p()).collect();
        upright.take(&activity, &expected[0]);
        turned.take(&activity, &expected[1]);
        used += 1;
    }
    Ok((used >= FEWEST_INSTANTS && seen >= FEWEST_POINTS).then(|| EventFit {
        camera: camera.name.clone(),
        upright: upright.finish(),
        upside_down: turned.finish(),
    }))
}

/// Pearson's correlation of pairs that come one after the other.
#[derive(Default)]
struct Correlation {
    n: f64,
    sums: [f64; 5],
}

impl Correlation {
    fn take(&mut self, a: &[f64], b: &[f64]) {
        for (&a, &b) in std::iter::zip(a, b) {
            self.n += 1.0;
            for (sum, value) in self.sums.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                *sum += value;
            }
        }
    }

    fn finish(&self) -> f64 {
        let [a, b, aa, bb, ab] = self.sums.map(|sum| sum / self.n.max(1.0));
        let spread = ((aa - a * a) * (bb - b * b)).sqrt();
        if spread > 1e-12 { (ab - a * b) / spread } else { 0.0 }
    }
}
