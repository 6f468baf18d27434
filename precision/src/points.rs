//! The initial points: what instants, planes, windows and the cells of the hull cost and bring.

use std::sync::{Arc, OnceLock};

use erfgs_base::random::{key, purpose, uniform};
use erfgs_dataset::{Camera, Split};
use erfgs_points::{CloudOptions, CloudPoint, HullOptions, Method, SweepOptions};
use erfgs_stage::{FilmOptions, RigOptions, StageView};
use glam::{DVec2, DVec3};

use crate::{
    Bench, Component, Measure, Result, Size, Stopwatch, Study,
    component::About,
    filmed::{Filmed, cloud},
};

const ABOUT: About = About {
    name: "initial points",
    truth: "Frames of eight cameras before the stage, without COLMAP, whose share is measured in lab/notebook/initial-points.md. The truth is the stage's \
            own depth: a point is off by how far it lies from what is there, along the ray of the camera that says so least; gaps are told \
            from true places that cameras see, at that instant for what moves.",
    work: "all points of a recording",
    measures: &[
        Measure { name: "gap where nothing moves, median", unit: "mm", logarithmic: true },
        Measure { name: "gap where things move, median", unit: "mm", logarithmic: true },
        Measure { name: "what a point is off by, 90 %", unit: "mm", logarithmic: true },
    ],
};

/// Places that gaps are told from, of an instant and a kind.
const PLACES: u64 = 400;

/// What one camera sees at one instant.
struct DepthView {
    camera: usize,
    t_ns: i64,
    /// Metres, of each pixel.
    depth: Vec<f32>,
}

/// What is there.
struct Truth {
    cameras: Vec<Camera>,
    seen: Vec<DepthView>,
    still: Vec<DVec3>,
    /// At each instant.
    moving: Vec<(i64, Vec<DVec3>)>,
}

impl Truth {
    fn of(filmed: &Filmed) -> Result<Self> {
        let (stage, _) = filmed.options().set_up()?;
        let cameras: Vec<Camera> = filmed.dataset()?.cameras(Split::Train).cloned().collect();
        let (mut seen, mut still, mut moving) = (Vec::new(), Vec::new(), Vec::<(i64, Vec<DVec3>)>::new());
        for (index, camera) in cameras.iter().enumerate() {
            let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera)?;
            for (instant, frame) in camera.frames.iter().enumerate() {
                let (depth, mask) = (view.depth(frame.t_ns), view.mask(frame.t_ns));
                let pixels = depth.len();
                let drawn = |word: u64| {
                    let key = key(2, &[purpose("precision places"), index as u64, instant as u64, word]);
                    (uniform(key) * pixels as f64) as usize
                };
                let place = |pixel: usize| unproject(camera, pixel, f64::from(depth[pixel]));
                if instant == 0 {
                    still.extend((0..PLACES).map(drawn).filter(|&pixel| !mask[pixel]).map(place));
                }
                let then = (0..40 * PLACES).map(drawn).filter(|&pixel| mask[pixel]).take(PLACES as usize).map(place);
                match moving.iter_mut().find(|(t_ns, _)| *t_ns == frame.t_ns) {
                    Some((_, places)) => places.extend(then),
                    None => moving.push((frame.t_ns, then.collect())),
                }
                seen.push(DepthView { camera: index, t_ns: frame.t_ns, depth });
            }
        }
        Ok(Self { cameras, seen, still, moving })
    }

    /// How far a point lies from what cameras see, along a ray, metres; none where no camera sees past its place.
    fn off(&self, point: &CloudPoint) -> Option<f64> {
        let at = self.seen.iter().filter(|seen| seen.t_ns == point.t_ns);
        at.filter_map(|seen| {
            let camera = &self.cameras[seen.camera];
            let place = camera.world_to_camera.transform(point.position);
            let lens = &camera.intrinsics;
            let DVec2 { x, y } = lens.project_pinhole(place);
            let inside =
                place.z > 0.0 && x >= 0.0 && y >= 0.0 && x < f64::from(lens.width) && y < f64::from(lens.height);
            let pixel = y as usize * lens.width as usize + x as usize;
            inside.then(|| (f64::from(seen.depth[pixel]) - place.z).abs())
        })
        .min_by(f64::total_cmp)
    }

    /// What the points are off by, millimetres, by the measures.
    fn judge(&self, points: &[CloudPoint]) -> Result<Vec<f64>> {
        let (moving, still): (Vec<&CloudPoint>, Vec<&CloudPoint>) = points.iter().partition(|point| point.moving);
        let mut off: Vec<f64> = points.iter().filter_map(|point| self.off(point)).collect();
        let mut still_gaps = gaps(&self.still, &still);
        let mut moving_gaps: Vec<f64> = Vec::new();
        for (t_ns, places) in &self.moving {
            let away = |point: &&CloudPoint| (point.t_ns - t_ns).abs();
            let Some(nearest) = moving.iter().map(away).min() else { return Err("no point is known to move".into()) };
            let then: Vec<&CloudPoint> = moving.iter().filter(|point| away(point) == nearest).copied().collect();
            moving_gaps.extend(gaps(places, &then));
        }
        let figure = |values: &mut Vec<f64>, share: f64| 1e3 * quantile(values, share);
        Ok(vec![figure(&mut still_gaps, 0.5), figure(&mut moving_gaps, 0.5), figure(&mut off, 0.9)])
    }
}

/// How far each place is from the nearest point, metres.
fn gaps(places: &[DVec3], points: &[&CloudPoint]) -> Vec<f64> {
    let nearest = |place: &DVec3| {
        points.iter().map(|point| point.position.distance_squared(*place)).min_by(f64::total_cmp).map(f64::sqrt)
    };
    places.iter().filter_map(nearest).collect()
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values
        .get(((share * values.len() as f64) as usize).min(values.len().saturating_sub(1)))
        .copied()
        .unwrap_or(f64::NAN)
}

fn unproject(camera: &Camera, pixel: usize, depth: f64) -> DVec3 {
    let lens = &camera.intrinsics;
    let [x, y] = [pixel % lens.width as usize, pixel / lens.width as usize].map(|at| at as f64 + 0.5);
    let place = lens.unproject_pinhole(DVec2::new(x, y), depth);
    camera.world_to_camera.inverse().transform(place)
}

/// The knobs of the initial points.
#[must_use]
pub(crate) fn component(size: Size) -> Component {
    let [width, height] = if size == Size::Small { [80, 60] } else { [240, 180] };
    let filmed = Filmed::new(
        FilmOptions {
            rig: RigOptions { width, height, rgb: 8, event: 0, test: 0, ..RigOptions::default() },
            seed: 5,
            duration_ns: 400_000_000,
            rgb_fps: 20.0,
            exposure_ns: 0,
            truth_points: 0,
            ..FilmOptions::default()
        },
        false,
    );
    let truth: Arc<OnceLock<std::result::Result<Truth, String>>> = Arc::default();
    let run = move |_: &Bench, stopwatch: &mut Stopwatch, options: &CloudOptions| {
        let truth = truth.get_or_init(|| Truth::of(&filmed).map_err(|error| error.to_string()));
        let truth = truth.as_ref().map_err(String::clone)?;
        let (dataset, folder) = (filmed.dataset()?, erfgs_base::scratch::Scratch::new()?);
        let found = stopwatch.time(|| cloud(dataset, options, folder.path()))?;
        truth.judge(&found.points)
    };
    let default = CloudOptions { method: Method::Sweep, ..CloudOptions::default() };
    let sweep = |sweep: SweepOptions| CloudOptions { sweep, ..default.clone() };
    let hull = |hull: HullOptions| CloudOptions { hull, ..default.clone() };
    let (of_sweep, of_hull) = (default.sweep, default.hull);
    let instants: &[u32] = if size == Size::Small { &[3, 12] } else { &[3, 6, 9, 12] };
    let study = Study::new(ABOUT, run).knob(
        "instants of the hull",
        &default,
        instants.iter().map(|&instants| (instants.to_string(), hull(HullOptions { instants, ..of_hull }))),
    );
    if size == Size::Small {
        return study.component();
    }
    study
        .knob(
            "cells of the hull, pixels",
            &default,
            [1.0, 2.0, 4.0, 8.0].map(|cell_px| (cell_px.to_string(), hull(HullOptions { cell_px, ..of_hull }))),
        )
        .knob(
            "what a pixel must differ by to be of the hull",
            &default,
            [0.04, 0.08, 0.16].map(|threshold| (threshold.to_string(), hull(HullOptions { threshold, ..of_hull }))),
        )
        .knob(
            "planes of the sweep, pixels apart",
            &default,
            [0.75, 1.5, 3.0, 6.0]
                .map(|plane_step_px| (plane_step_px.to_string(), sweep(SweepOptions { plane_step_px, ..of_sweep }))),
        )
        .knob(
            "window of the sweep, pixels",
            &default,
            [5, 7, 9, 13].map(|window| (window.to_string(), sweep(SweepOptions { window, ..of_sweep }))),
        )
        .knob(
            "neighbours of a camera in the sweep",
            &default,
            [3, 4, 6, 7].map(|neighbours| (neighbours.to_string(), sweep(SweepOptions { neighbours, ..of_sweep }))),
        )
        .knob(
            "instants of the sweep",
            &default,
            [1, 2, 3].map(|instants| (instants.to_string(), sweep(SweepOptions { instants, ..of_sweep }))),
        )
        .component()
}
