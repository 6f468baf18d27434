//! Reading a dataset, as much of it as memory is meant for.

use std::path::Path;

use erfgs_base::{memory, random};
use erfgs_dataset::{Camera, Dataset, DatasetError, Split};
use rayon::prelude::*;

use super::{
    Bins, EventView, Flicker, HeldOutFrame, Pictures, Point, Scene, SceneError, SceneView, TrainFrame, check_memory,
    events::EventCounter,
};
use crate::config::{Config, EarlConfig, MotionModel, Pairing};
use erfgs_splat::raster::View;

/// Bytes that an event takes at most: its own four, and as many of the images of counts between events.
const EVENT: u64 = 8;

const RANDOM_POINTS: u64 = 0x706f_696e_7473;

/// What frames and events may take where the system does not tell how much memory is free, bytes.
const UNKNOWN: u64 = 8 << 30;

/// Steps of single precision that are larger in a picture make the scene tremble.
const MOST_PIXELS_APART: f64 = 0.25;

impl Scene {
    /// Reads what training needs. With `random_init` the dataset's point cloud is not asked for: points are drawn in the
    /// box that the cameras look into. Frames and events take no more than half of the memory that is free.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn load(dataset: Dataset, config: &Config, random_init: bool) -> Result<Self, SceneError> {
        Self::load_within(dataset, config, random_init, None, &std::env::temp_dir())
    }

    /// The same, where frames and events take no more than so many bytes of memory. Frames that do not fit are read again from the
    /// dataset while it is trained on; events that take more than half of it lie in files without a name in the folder `scratch`.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn load_within(
        dataset: Dataset,
        config: &Config,
        random_init: bool,
        most: Option<u64>,
        scratch: &Path,
    ) -> Result<Self, SceneError> {
        check_memory(&dataset, config)?;
        let most = most.unwrap_or_else(|| memory::available().map_or(UNKNOWN, |free| free / 2));
        let uses_events = (config.earl.enabled || config.eds.enabled) && config.motion != MotionModel::Still;
        let events = if uses_events { event_bytes(&dataset) } else { 0 };
        let scratch = (events > most / 2).then_some(scratch);
        let most = if scratch.is_some() { most } else { most - events };
        let views = dataset
            .manifest
            .cameras
            .iter()
            .map(|camera| {
                let view = View::try_from((&camera.intrinsics, &camera.world_to_camera))
                    .map_err(|source| SceneError::Camera { camera: camera.name.clone(), source })?;
                Ok(SceneView { name: camera.name.clone(), split: camera.split, view })
            })
            .collect::<Result<Vec<_>, SceneError>>()?;
        let span_ns = dataset.manifest.span_ns;
        let extent = extent(&dataset, random_init)?;
        let cameras = || dataset.manifest.cameras.iter().enumerate();
        let frames_of = |view: usize, camera: &Camera| (0..camera.frames.len()).map(move |index| (view, index));
        let of = |split: Split| {
            let chosen = cameras().filter(move |(_, camera)| camera.split == split);
            chosen.flat_map(|(view, camera)| frames_of(view, camera)).collect::<Vec<_>>()
        };
        let [training, held_out] = [Split::Train, Split::Test].map(of);
        if training.is_empty() {
            return Err(SceneError::NoFrames { path: dataset.root });
        }
        let mut scene = Self {
            views,
            frames: Vec::new(),
            pictures: Pictures::new(&dataset, training.clone(), most)?,
            events: Vec::new(),
            events_filed: false,
            bins: Bins::default(),
            flicker: None,
            held_out: Vec::new(),
            points: Vec::new(),
            point_times: Vec::new(),
            frame_times: Vec::new(),
            extent,
            linear_exposure: dataset.manifest.linear_exposure,
            dataset,
        };
        scene.frames = training.iter().map(|&(view, index)| scene.frame(view, index)).collect();
        scene.held_out = held_out.iter().map(|&(view, index)| scene.held_out_frame(view, index)).collect();
        let mut times_ns: Vec<i64> =
            training.iter().map(|&(view, index)| scene.dataset.manifest.cameras[view].frames[index].t_ns).collect();
        times_ns.sort_unstable();
        times_ns.dedup();
        scene.frame_times = scene.frames.iter().map(|frame| frame.instant(config.blur.instant)).collect();
        scene.frame_times.sort_unstable_by(f64::total_cmp);
        scene.frame_times.dedup();
        if uses_events {
            let (bins, instants) = (scene.bins_per_interval(config), instants(&scene.dataset, &times_ns));
            scene.bins = Bins::shared(&times_ns, bins, instants, span_ns, scene.events_end());
            let anchored = config.earl.pairing == Pairing::FrameAnchored;
            let flicker = if config.earl.flicker && !anchored { Flicker::find(&scene.dataset)? } else { None };
            if let Some((bins, flicker)) = flicker.and_then(|of| Some((scene.bins.at_peaks(&of, span_ns)?, of))) {
                (scene.bins, scene.flicker) = (bins, Some(flicker));
            }
            scene.events = scene.read_events(&config.earl, scratch)?;
            scene.events_filed = scratch.is_some();
        }
        scene.points = match (random_init, scene.dataset.read_points()?) {
            (false, Some(cloud)) => cloud.positions.into_iter().zip(cloud.colours).collect(),
            (false, None) => return Err(SceneError::NoPoints { path: scene.dataset.root.clone() }),
            (true, _) => scene.random_points(config)?,
        };
        if !random_init {
            scene.point_times = scene.moving_times()?;
        }
        scene.check_place()?;
        Ok(scene)
    }

    /// Positions are kept in single precision, whose steps grow with the distance from the origin.
    fn check_place(&self) -> Result<(), SceneError> {
        for (camera, of) in self.dataset.manifest.cameras.iter().zip(&self.views) {
            let centre = camera.world_to_camera.centre();
            let points = self.points.iter().map(|(point, _)| point);
            let depth = median_distance(centre, points).unwrap_or(f64::from(self.extent));
            let away = centre.abs().max_element();
            let apart = away * f64::from(f32::EPSILON);
            let pixels = apart * f64::from(of.view.fx) / depth;
            if depth > 0.0 && pixels > MOST_PIXELS_APART {
                let (path, camera) = (self.dataset.root.clone(), camera.name.clone());
                return Err(SceneError::FarAway { path, camera, away, apart, pixels });
            }
        }
        Ok(())
    }

    /// When each point of the dataset's cloud was there, for those on something that moves: in the middle of the exposure of
    /// the frames that it was found in, whose label may be the exposure's beginning.
    fn moving_times(&self) -> Result<Vec<Option<f64>>, SceneError> {
        let Some(runs) = self.dataset.point_runs()? else { return Ok(Vec::new()) };
        let times = runs.iter().flat_map(|run| {
            let label = self.to_unit(run.t_ns);
            let middles =
                || self.frames.iter().filter(|frame| frame.t01 == label).map(|frame| frame.instant(Some(0.5)));
            let time = run.moving.then(|| match middles().count() {
                0 => label,
                frames => middles().sum::<f64>() / frames as f64,
            });
            std::iter::repeat_n(time, run.count as usize)
        });
        // The runs add up to the points of the file, which has as many as the manifest says.
        Ok(times.collect())
    }

    fn frame(&self, view: usize, index: usize) -> TrainFrame {
        let frame = &self.dataset.manifest.cameras[view].frames[index];
        let exposure = frame.exposure_ns.map(|t| self.to_unit(t));
        TrainFrame { view, index, t01: self.to_unit(frame.t_ns), exposure }
    }

    fn held_out_frame(&self, view: usize, index: usize) -> HeldOutFrame {
        let t_ns = self.dataset.manifest.cameras[view].frames[index].t_ns;
        HeldOutFrame { view, index, t_ns, t01: self.to_unit(t_ns) }
    }

    fn read_events(&self, earl: &EarlConfig, scratch: Option<&Path>) -> Result<Vec<EventView>, SceneError> {
        let cameras: Vec<(usize, &Camera)> = self
            .dataset
            .manifest
            .cameras
            .iter()
            .enumerate()
            .filter(|(_, camera)| camera.split == Split::Train && camera.events.is_some())
            .collect();
        let views = cameras
            .into_par_iter()
            .map(|(view, _)| self.event_view(view, earl, scratch))
            .collect::<Result<Vec<_>, SceneError>>()?;
        Ok(views.into_iter().flatten().collect())
    }

    /// The events of a view, held out or not; none where it has none in any bin.
    ///
    /// # Errors
    /// [`SceneError`] where they cannot be read.
    pub(crate) fn event_view(
        &self,
        view: usize,
        earl: &EarlConfig,
        scratch: Option<&Path>,
    ) -> Result<Option<EventView>, SceneError> {
        let camera = &self.dataset.manifest.cameras[view];
        let counter = EventCounter::new(view, camera, &self.bins, earl, self.flicker.is_some(), scratch)?;
        let Some(mut counter) = counter else { return Ok(None) };
        self.dataset.read_event_pieces(camera, |events| counter.add(events))?;
        counter.finish().map(Some)
    }

    /// The configured bins an interval, or as many as source frames lie in it, or 8. A simulator that knows no more than
    /// its frames stamps events within the step between two of them, so that finer bins would tell of nothing.
    fn bins_per_interval(&self, config: &Config) -> usize {
        match (config.earl.bins, self.dataset.manifest.subsampled()) {
            (0, 1) => 8,
            (0, every) => every.min(64) as usize,
            (bins, _) => bins as usize,
        }
    }

    fn events_end(&self) -> i64 {
        let ends = self.dataset.manifest.cameras.iter().filter_map(|camera| Some(camera.events.as_ref()?.covers_ns[1]));
        // Beyond the span there is no time to render at.
        let end = self.dataset.manifest.span_ns[1];
        ends.max().map_or(end, |covered| covered.min(end))
    }

    /// Points spread evenly in the cube around the point that the training cameras look at, half as wide as the cameras
    /// are far from it, in the mean colour of the frames.
    fn random_points(&self, config: &Config) -> Result<Vec<Point>, SceneError> {
        if !(self.extent.is_finite() && self.extent > 0.0) {
            return Err(SceneError::NoExtent { path: self.dataset.root.clone() });
        }
        let centre = self.looked_at();
        let half = f64::from(self.extent);
        let points = (0..u64::from(config.init.random_points)).map(|index| {
            let position = std::array::from_fn(|axis| {
                let key = random::key(config.seed, &[RANDOM_POINTS, index, axis as u64]);
                random::range(key, centre[axis] - half, centre[axis] + half) as f32
            });
            (position, [128, 128, 128])
        });
        Ok(points.collect())
    }

    /// The point nearest to the optical axes of the training cameras, in the least squares sense, metres.
    #[must_use]
    pub fn looked_at(&self) -> [f64; 3] {
        use glam::{DMat3, DVec3};
        let mut normal = DMat3::ZERO;
        let mut right = DVec3::ZERO;
        let mut mean = DVec3::ZERO;
        let mut count = 0.0;
        for camera in self.dataset.cameras(Split::Train) {
            let axis = camera.world_to_camera.inverse().rotation * DVec3::Z;
            let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
            let centre = camera.world_to_camera.centre();
            normal += across;
            right += across * centre;
            mean += centre + axis;
            count += 1.0;
        }
        let well_posed = normal.determinant() > 1e-9 * count * count * count;
        if well_posed { (normal.inverse() * right).to_array() } else { (mean / f64::max(count, 1.0)).to_array() }
    }
}

/// How many instants of all training cameras there are from a camera's frame to its next one: 1 where they film together.
fn instants(dataset: &Dataset, times_ns: &[i64]) -> usize {
    let (Some(period), [first, .., last]) = (period_ns(dataset), times_ns) else { return 1 };
    let apart = (last - first) as f64 / (times_ns.len() - 1) as f64;
    ((period / apart).round() as usize).max(1)
}

/// The time from a frame of a training camera to its next: the median, nanoseconds; `None` where none has two.
pub(super) fn period_ns(dataset: &Dataset) -> Option<f64> {
    let frames = dataset.cameras(Split::Train).map(|camera| &camera.frames);
    let mut periods: Vec<i64> =
        frames.flat_map(|frames| frames.windows(2).map(|pair| pair[1].t_ns - pair[0].t_ns)).collect();
    let middle = periods.len() / 2;
    (!periods.is_empty()).then(|| *periods.select_nth_unstable(middle).1 as f64)
}

/// The unit of learning rates and sizes, metres: 1.1 times the largest distance of a training camera from the mean of their
/// centres (3DGS), or, where they all stand at one point, the median distance of the initial points from there; 0 where there
/// are none either.
pub(crate) fn extent(dataset: &Dataset, without_points: bool) -> Result<f32, DatasetError> {
    let centres: Vec<_> = dataset.cameras(Split::Train).map(|camera| camera.world_to_camera.centre()).collect();
    let mean = centres.iter().sum::<glam::DVec3>() / centres.len().max(1) as f64;
    let largest = centres.iter().map(|centre| centre.distance(mean)).fold(0.0, f64::max);
    if largest > 0.0 || without_points {
        return Ok((1.1 * largest) as f32);
    }
    let Some(cloud) = dataset.read_points()? else { return Ok(0.0) };
    Ok(median_distance(mean, cloud.positions.iter()).unwrap_or(0.0) as f32)
}

/// The median distance of points from a place, metres; `None` without points.
fn median_distance<'a>(from: glam::DVec3, points: impl Iterator<Item = &'a [f32; 3]>) -> Option<f64> {
    median(points.map(|point| from.distance(glam::Vec3::from(*point).as_dvec3())).collect())
}

/// The median; `None` of nothing.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Bytes that the events of the training cameras take at most.
fn event_bytes(dataset: &Dataset) -> u64 {
    let counts = dataset.cameras(Split::Train).filter_map(|camera| Some(camera.events.as_ref()?.count));
    counts.fold(0, u64::saturating_add).saturating_mul(EVENT)
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use erfgs_dataset::{Bodies, Body, BodyPose, Frame, SurfacePoint};
    use erfgs_scene::{Pose, image::ImageRgb8, ply::PointCloud};

    use super::*;
    use crate::scene::fixtures;

    /// Cameras at these places, all of which look along z, and points around the origin.
    fn dataset(root: &Path, places: &[[f64; 3]]) -> Dataset {
        let camera = |place: &[f64; 3]| Camera {
            world_to_camera: Pose { translation: -glam::DVec3::from(*place), ..Pose::IDENTITY },
            pose_sigma: None,
            clock_sigma_s: None,
            ..fixtures::camera(&format!("{place:?}"), [8, 8], 8.0)
        };
        let mut dataset = fixtures::dataset(root, places.iter().map(camera).collect(), [0, 1]);
        let cloud = PointCloud { positions: vec![[0.0; 3]; 3], colours: vec![[9; 3]; 3] };
        dataset.set_points(&cloud, "known", Default::default()).expect("a file");
        dataset
    }

    #[test]
    fn cameras_at_one_point_take_the_distance_of_the_points_for_a_unit() {
        let folder = tempfile::tempdir().expect("a folder");
        let apart = dataset(folder.path(), &[[-2.0, 0.0, -3.0], [2.0, 0.0, -3.0]]);
        assert!((extent(&apart, false).expect("points") - 2.2).abs() < 1e-6);
        let alone = dataset(folder.path(), &[[0.0, 0.0, -3.0]]);
        assert!((extent(&alone, false).expect("points") - 3.0).abs() < 1e-6);
        assert_eq!(extent(&alone, true).expect("none are asked for"), 0.0);
    }

    #[test]
    fn the_near_plane_comes_closer_in_a_small_scene_and_stays_in_a_room() {
        let folder = tempfile::tempdir().expect("a folder");
        let near_m = |by: f64| {
            let dataset = dataset(folder.path(), &[[-2.0 * by, 0.0, 0.0], [2.0 * by, 0.0, 0.0]]);
            let mut config = Config::default();
            config.settle(&dataset, false).expect("settled");
            config.near_m
        };
        assert_eq!(near_m(1.0), Config::default().near_m);
        assert!((near_m(1e-4) / 4.4e-5 - 1.0).abs() < 1e-4, "{}", near_m(1e-4));
    }

    #[test]
    fn bodies_start_with_the_same_points_after_poses_were_learned() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut dataset = dataset(folder.path(), &[[-0.4, 0.0, -3.0], [0.4, 0.0, -3.0]]);
        for (index, camera) in dataset.manifest.cameras.iter_mut().enumerate() {
            let file = PathBuf::from(format!("{index}.png"));
            let image = ImageRgb8 { width: 8, height: 8, data: vec![90; 3 * 64] };
            image.write_png(&folder.path().join(&file)).expect("a picture");
            camera.frames.push(Frame { file, t_ns: 0, exposure_ns: [0, 0], mask: None });
        }
        let point = |n: u32| SurfacePoint {
            position_m: [0.01 * f64::from(n % 40), 0.01 * f64::from(n / 40), 0.0],
            normal: [0.0, 0.0, -1.0],
            colour: [90; 3],
        };
        let pose = BodyPose { t_ns: 0, translation_m: [0.0; 3], rotation_wxyz: [1.0, 0.0, 0.0, 0.0] };
        let body = Body {
            name: "plate".into(),
            span_ns: [0, 1],
            poses: vec![pose],
            points: (0..1600).map(point).collect(),
            found_by: Default::default(),
        };
        dataset.set_bodies(&Bodies::new(vec![body]), Default::default()).expect("a file");
        let mut config = Config::default();
        config.bodies.spacing_px = 0.1;
        let mut scene = Scene::load_within(dataset, &config, false, None, folder.path()).expect("a scene");
        let before = scene.bodies(&config).expect("bodies");
        for view in &mut scene.views {
            view.view.translation[2] += 0.5;
        }
        assert_eq!(scene.bodies(&config).expect("bodies"), before);
        assert!(before.gaussians.len() < 1600, "nothing was thinned");
    }
}
