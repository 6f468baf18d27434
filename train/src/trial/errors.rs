//! How far what was learned is from what the cameras saw that were kept apart, where each body is.

use std::collections::BTreeMap;

use erfgs_dataset::Body;
use erfgs_scene::srgb;
use glam::DVec3;

use super::HeldOut;
use crate::{
    config::Config,
    metrics::to_unit,
    scene::{EventView, Scene, SceneError, grow, project},
    trainer::{TrainError, Trainer},
};
use erfgs_splat::raster::View;

/// Renderings of an exposure.
const RENDERINGS: u32 = 5;
/// Where a body is seen is grown by so many pixels: it may be thinner than the thing.
const GROWN_PX: usize = 2;
/// Where others are seen, too, tells of them as much: it counts where else less than this share of a body's pixels was left.
const LEAST_ALONE: f64 = 0.1;
/// Frames and windows of events that are looked at, at most, spread over the recording.
const MOST_FRAMES: usize = 24;
const MOST_WINDOWS: usize = 32;
/// A window of events is so long, RGB intervals.
const WINDOW: f64 = 0.2;
/// A change of more thresholds counts as so many.
const MOST_THRESHOLDS: f32 = 4.0;

/// A frame that was kept apart.
struct Frame {
    view: usize,
    exposure: [f64; 2],
    /// Red, green and blue of 1.
    rgb: Vec<f32>,
    /// The pixels of each body.
    bodies: Vec<Vec<usize>>,
    /// Whether no body is at a pixel.
    beside: Vec<bool>,
}

/// Events between two instants.
struct Window {
    view: usize,
    edges: [f64; 2],
    counts: Vec<f32>,
    bodies: Vec<Vec<usize>>,
}

/// What was kept apart.
pub(super) struct HeldOutViews {
    frames: Vec<Frame>,
    windows: Vec<Window>,
    events: Option<EventView>,
    bodies: usize,
}

/// Sums of errors at a body.
#[derive(Clone, Debug, Default)]
pub(super) struct Errors {
    squares: f64,
    values: f64,
    /// Sums of squares of what events say, of what is rendered, and of products of both.
    measured: f64,
    shown: f64,
    both: f64,
}

impl Errors {
    /// Such errors, of one value each.
    #[cfg(test)]
    pub fn of(frames: Option<f64>, events: Option<f64>) -> Self {
        let count = |of: Option<f64>| f64::from(u8::from(of.is_some()));
        Self {
            squares: frames.unwrap_or_default().powi(2),
            values: count(frames),
            measured: count(events),
            shown: count(events),
            both: events.map_or(0.0, |left| (1.0 - left * left).sqrt()),
        }
    }

    /// Root mean square error of frames; none where the body is in none.
    pub fn frames(&self) -> Option<f64> {
        (self.values > 0.0).then(|| (self.squares / self.values).sqrt())
    }

    /// The share of what events say, root mean square, that is not explained by a multiple of what is rendered; none likewise. What was
    /// trained for a while only has its edges where they belong long before it has all of their contrast.
    pub fn events(&self) -> Option<f64> {
        let explained = if self.shown > 0.0 { self.both.max(0.0).powi(2) / self.shown } else { 0.0 };
        (self.measured > 0.0).then(|| (1.0 - explained / self.measured).max(0.0).sqrt())
    }
}

impl HeldOutViews {
    /// What the cameras that were kept apart saw, with where each body is by its path.
    pub fn new(scene: &Scene, bodies: &[Body], held_out: &HeldOut, config: &Config) -> Result<Self, SceneError> {
        let find = |name: &Option<String>| {
            name.as_ref().and_then(|name| scene.views.iter().position(|view| view.name == *name))
        };
        let mut frames = Vec::new();
        if let Some(view) = find(&held_out.frames) {
            let camera = &scene.dataset.manifest.cameras[view];
            for index in spread(camera.frames.len(), MOST_FRAMES) {
                let frame = &camera.frames[index];
                let exposure = frame.exposure_ns.map(|t_ns| scene.to_unit(t_ns));
                let times = times(exposure).map(|t01| scene.from_unit(t01)).collect::<Vec<_>>();
                let seen = where_seen(bodies, &scene.views[view].view, &times);
                let mut beside = vec![true; (scene.views[view].view.width * scene.views[view].view.height) as usize];
                seen.iter().flatten().for_each(|&pixel| beside[pixel] = false);
                let rgb = to_unit(&scene.dataset.read_image(camera, frame)?.data);
                frames.push(Frame { view, exposure, rgb, bodies: seen, beside });
            }
        }
        // Where each event camera is needed, what is learned from is better than nothing.
        let of_events = find(&held_out.events).or_else(|| scene.events.first().map(|events| events.view));
        let events = match of_events {
            Some(view) if !scene.bins.is_empty() => scene.event_view(view, &config.earl, None)?,
            _ => None,
        };
        let mut windows = Vec::new();
        if let Some(events) = &events {
            let view = &scene.views[events.view].view;
            let edges = &scene.bins.edges;
            let span = ((WINDOW * scene.bins.per_interval as f64).round() as usize).max(1);
            let [first, last] = events.covers;
            let count = (last - first).saturating_sub(span) + usize::from(last - first >= span);
            for at in spread(count, MOST_WINDOWS) {
                let (from, to) = (first + at, first + at + span);
                let times = [edges[from], edges[to]];
                let seen = where_seen(bodies, view, &times.map(|t01| scene.from_unit(t01)));
                windows.push(Window {
                    view: events.view,
                    edges: times,
                    counts: events.between(from, to)?,
                    bodies: seen,
                });
            }
        }
        let mut seen = Self { frames, windows, events, bodies: bodies.len() };
        seen.tell_apart();
        Ok(seen)
    }

    /// Leaves each body the pixels that no other is seen at, if enough are left of it.
    fn tell_apart(&mut self) {
        let alone: Vec<Vec<Vec<usize>>> = self.all_seen().map(|of| alone(of)).collect();
        let pixels = |of: &dyn Fn(usize) -> usize| (0..alone.len()).map(of).sum::<usize>() as f64;
        let all: Vec<&Vec<Vec<usize>>> = self.all_seen().collect();
        let enough: Vec<bool> = (0..self.bodies)
            .map(|body| pixels(&|at| alone[at][body].len()) >= LEAST_ALONE * pixels(&|at| all[at][body].len()))
            .collect();
        let frames = self.frames.iter_mut().map(|frame| &mut frame.bodies);
        let windows = self.windows.iter_mut().map(|window| &mut window.bodies);
        for (of, alone) in frames.chain(windows).zip(alone) {
            for ((pixels, alone), enough) in of.iter_mut().zip(alone).zip(&enough) {
                if *enough {
                    *pixels = alone;
                }
            }
        }
    }

    /// The pixels of each body in each frame and window.
    fn all_seen(&self) -> impl Iterator<Item = &Vec<Vec<usize>>> {
        let frames = self.frames.iter().map(|frame| &frame.bodies);
        frames.chain(self.windows.iter().map(|window| &window.bodies))
    }

    /// The errors of what a training learned, for each body.
    pub fn errors(&self, trainer: &mut Trainer<'_>) -> Result<Vec<Errors>, TrainError> {
        let mut errors = vec![Errors::default(); self.bodies];
        for frame in &self.frames {
            let mut rendered = exposed(trainer, frame)?;
            fit_colours(&mut rendered, &frame.rgb, &frame.beside);
            for (errors, pixels) in std::iter::zip(&mut errors, &frame.bodies) {
                for value in pixels.iter().flat_map(|pixel| 3 * pixel..3 * pixel + 3) {
                    errors.squares += f64::from(rendered[value].clamp(0.0, 1.0) - frame.rgb[value]).powi(2);
                    errors.values += 1.0;
                }
            }
        }
        let Some(events) = &self.events else { return Ok(errors) };
        for window in &self.windows {
            let [before, after] = window.edges.map(|t01| trainer.render_view(window.view, t01));
            let (before, after) = (before?, after?);
            let (before, after) = (before.as_chunks::<3>().0, after.as_chunks::<3>().0);
            for (errors, pixels) in std::iter::zip(&mut errors, &window.bodies) {
                for &pixel in pixels {
                    let light = |colours: &[[f32; 3]]| {
                        events.sensor.lin_log(&colours[pixel].map(|value| value.clamp(0.0, 1.0)))
                    };
                    let most = MOST_THRESHOLDS;
                    let change = ((light(after) - light(before)) / events.sensor.threshold).clamp(-most, most);
                    let [measured, shown] = [window.counts[pixel].clamp(-most, most), change].map(f64::from);
                    errors.measured += measured * measured;
                    errors.shown += shown * shown;
                    errors.both += measured * shown;
                }
            }
        }
        Ok(errors)
    }
}

/// The mean of what is seen while the shutter is open, in the light that the camera gathers.
fn exposed(trainer: &mut Trainer<'_>, frame: &Frame) -> Result<Vec<f32>, TrainError> {
    let linear = trainer.scene.linear_exposure;
    let mut sum = vec![0.0; frame.rgb.len()];
    for t01 in times(frame.exposure) {
        let rendered = trainer.render_view(frame.view, t01)?;
        for (sum, value) in std::iter::zip(&mut sum, rendered) {
            *sum += if linear { srgb::decode(value.clamp(0.0, 1.0)) } else { value };
        }
    }
    let mean = |sum: f32| sum / RENDERINGS as f32;
    Ok(sum.into_iter().map(|sum| if linear { srgb::encode(mean(sum)) } else { mean(sum) }).collect())
}

/// Instants of an exposure, evenly.
fn times([start, end]: [f64; 2]) -> impl Iterator<Item = f64> {
    (0..RENDERINGS).map(move |k| start + (end - start) * (f64::from(k) + 0.5) / f64::from(RENDERINGS))
}

/// Gives a rendering the gain and offset of each channel with which it is nearest to a frame where nothing moves: a camera that takes no
/// part shows colours in its own way.
fn fit_colours(rendered: &mut [f32], truth: &[f32], beside: &[bool]) {
    for channel in 0..3 {
        let [mut n, mut x, mut y, mut xx, mut xy] = [0.0_f64; 5];
        for pixel in (0..beside.len()).filter(|&pixel| beside[pixel]) {
            let [a, b] = [rendered[3 * pixel + channel], truth[3 * pixel + channel]].map(f64::from);
            n += 1.0;
            x += a;
            y += b;
            xx += a * a;
            xy += a * b;
        }
        let spread = n * xx - x * x;
        if n == 0.0 || spread <= 1e-6 * n * n {
            continue;
        }
        let gain = (n * xy - x * y) / spread;
        let offset = (y - gain * x) / n;
        rendered
            .iter_mut()
            .skip(channel)
            .step_by(3)
            .for_each(|value| *value = (gain * f64::from(*value) + offset) as f32);
    }
}

/// The pixels of each body, at any of some instants (nanoseconds).
fn where_seen(bodies: &[Body], view: &View, times_ns: &[i64]) -> Vec<Vec<usize>> {
    let size = (view.width * view.height) as usize;
    let of = |body: &Body| {
        let mut mask = vec![false; size];
        for &t_ns in times_ns.iter().filter(|t_ns| (body.span_ns[0]..=body.span_ns[1]).contains(t_ns)) {
            let Some(pose) = body.pose_at(t_ns) else { continue };
            for point in &body.points {
                let place = pose.place(DVec3::from(point.position_m)).as_vec3().to_array();
                if let Some(pixel) = project(view, &place) {
                    mask[pixel] = true;
                }
            }
        }
        let mask = grow(&mask, view.width as usize, GROWN_PX);
        (0..size).filter(|&pixel| mask[pixel]).collect()
    };
    bodies.iter().map(of).collect()
}

/// The pixels of each body that are of no other.
fn alone(bodies: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut times: BTreeMap<usize, u32> = BTreeMap::new();
    bodies.iter().flatten().for_each(|&pixel| *times.entry(pixel).or_default() += 1);
    let of = |pixels: &Vec<usize>| pixels.iter().copied().filter(|pixel| times.get(pixel) == Some(&1)).collect();
    bodies.iter().map(of).collect()
}

/// Indices of at most `most` of `count`, evenly.
fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let taken = count.min(most);
    (0..taken).map(move |k| (2 * k + 1) * count / (2 * taken))
}

#[cfg(test)]
mod tests {
    use erfgs_dataset::{BodyPose, SurfacePoint};
    use erfgs_scene::{Intrinsics, Pose};

    use super::*;
    use crate::scene::fixtures;

    #[test]
    fn a_body_is_seen_where_it_is_at_those_times_and_nowhere_before_it_appears() {
        let camera = fixtures::camera("a", [64, 32], 32.0);
        let (k, pose): (&Intrinsics, &Pose) = (&camera.intrinsics, &camera.world_to_camera);
        let view = View::try_from((k, pose)).expect("a view");
        let pose = |k: i64| BodyPose {
            t_ns: 10 * k,
            translation_m: [0.1 * k as f64, 0.0, 2.0],
            rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
        };
        let point = SurfacePoint { position_m: [0.0; 3], normal: [0.0, 0.0, -1.0], colour: [0; 3] };
        let body = Body {
            name: "dot".into(),
            span_ns: [10, 100],
            poses: (0..=10).map(pose).collect(),
            points: vec![point],
            found_by: Default::default(),
        };
        assert_eq!(body.pose_at(34).map(|pose| pose.t_ns), Some(30));
        assert_eq!(body.pose_at(9_999).map(|pose| pose.t_ns), Some(100));
        let bodies = [body];
        // At 0.5 m aside in 2 m depth the pixel is 8 beside the middle.
        let seen = where_seen(&bodies, &view, &[50]);
        let columns: Vec<usize> = seen[0].iter().map(|pixel| pixel % 64).collect();
        assert_eq!((columns.iter().min(), columns.iter().max(), seen[0].len()), (Some(&38), Some(&42), 25));
        assert_eq!(where_seen(&bodies, &view, &[50, 100])[0].len(), 50);
        assert!(where_seen(&bodies, &view, &[5])[0].is_empty());
    }

    #[test]
    fn the_colours_of_a_camera_are_told_by_what_stands_still() {
        let mut rendered: Vec<f32> = (0..60).map(|k| 0.01 * k as f32).collect();
        let mut truth: Vec<f32> =
            rendered.iter().enumerate().map(|(at, value)| value * [0.8, 1.0, 1.1][at % 3] + 0.05).collect();
        // Something moves at a pixel, of which nothing is to be learned.
        truth[..3].fill(1.0);
        let beside: Vec<bool> = (0..20).map(|pixel| pixel > 0).collect();
        fit_colours(&mut rendered, &truth, &beside);
        assert!(std::iter::zip(&rendered, &truth).skip(3).all(|(a, b)| (a - b).abs() < 1e-5));
        assert!((rendered[0] - 0.05).abs() < 1e-5);
        // A picture of one colour tells no gain.
        let mut flat = vec![0.5; 60];
        fit_colours(&mut flat, &truth, &beside);
        assert!(flat.iter().all(|value| *value == 0.5));
    }

    #[test]
    fn where_two_bodies_are_seen_tells_of_neither_unless_one_has_nothing_else() {
        let frame = |bodies: [Vec<usize>; 3]| Frame {
            view: 0,
            exposure: [0.0; 2],
            rgb: Vec::new(),
            bodies: bodies.to_vec(),
            beside: Vec::new(),
        };
        let frames = vec![frame([vec![0, 1, 2], vec![2, 3], vec![3]]), frame([vec![5], vec![6, 7], vec![6, 7]])];
        let mut seen = HeldOutViews { frames, windows: Vec::new(), events: None, bodies: 3 };
        seen.tell_apart();
        // The first has pixels of its own; the others have none in either frame, and keep what they share.
        assert_eq!(seen.frames[0].bodies, [vec![0, 1], vec![2, 3], vec![3]]);
        assert_eq!(seen.frames[1].bodies, [vec![5], vec![6, 7], vec![6, 7]]);
    }

    #[test]
    fn what_is_looked_at_is_spread_evenly() {
        assert_eq!(spread(4, 10).collect::<Vec<_>>(), [0, 1, 2, 3]);
        assert_eq!(spread(100, 4).collect::<Vec<_>>(), [12, 37, 62, 87]);
        assert_eq!(spread(0, 4).count(), 0);
    }
}
