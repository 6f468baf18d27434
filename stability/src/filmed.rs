//! A small scene that is filmed exactly: Gaussians rendered by the `f64` twin, written as a dataset that the trainer reads like any
//! other.

use std::{f64::consts::TAU, path::Path};

use erfgs_base::random::{key, purpose, range};
use erfgs_dataset::{
    Camera, CameraEvents, Dataset, Frame, Manifest, PointCloudFile, PointRun, Provenance, Split, VariantStep, layout,
};
use erfgs_events::{Events, npz};
use erfgs_replay::{Luma, Mode, Simulator, SimulatorConfig};
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose, image::ImageRgb8, ply::PointCloud};
use erfgs_splat::{
    raster::{RenderOptions, View},
    reference::raster::Gaussians,
};
use glam::{DMat3, DVec3};

use crate::Refusal;

const SIZE: [u32; 2] = [32, 24];
/// Distance of the cameras from the middle of the scene, metres.
const AWAY: f64 = 2.5;

/// A scene and how it is filmed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filmed {
    /// Training cameras.
    pub cameras: usize,
    /// Frames of each.
    pub frames: usize,
    /// From the first frame to the last, nanoseconds.
    pub span_ns: i64,
    /// Share of the Gaussians that move.
    pub moving: f64,
    /// What every colour is times.
    pub light: f64,
    /// What the colours of what moves are times, besides.
    pub dark: f64,
    /// By how much of its brightness what stands still flickers, 7.3 times over the span.
    pub flicker: f64,
    /// What every length is times.
    pub scale: f64,
    /// How far the scene is from the origin, metres, along x.
    pub away: f64,
    /// Focal length, pixels.
    pub focal: f64,
    /// Pictures from a frame to the next that events are simulated from; 0: there are no events.
    pub events: usize,
}

impl Default for Filmed {
    fn default() -> Self {
        Self {
            cameras: 4,
            frames: 6,
            span_ns: 166_666_667,
            moving: 0.3,
            light: 1.0,
            dark: 1.0,
            flicker: 0.0,
            scale: 1.0,
            away: 0.0,
            focal: 40.0,
            events: 0,
        }
    }
}

const GAUSSIANS: u64 = 60;
const PURPOSE: u64 = purpose("stability scene");

impl Filmed {
    fn draw(index: u64, word: u64, from: f64, to: f64) -> f64 {
        range(key(3, &[PURPOSE, index, word]), from, to)
    }

    fn moves(&self, index: u64) -> bool {
        (index as f64 + 0.5) / GAUSSIANS as f64 <= self.moving
    }

    fn place(&self, index: u64, share: f64) -> DVec3 {
        let start = DVec3::from_array([0, 1, 2].map(|word| Self::draw(index, word, -0.6, 0.6)));
        let way = DVec3::from_array([3, 4, 5].map(|word| Self::draw(index, word, -0.3, 0.3)));
        let there = if self.moves(index) { start + share * way } else { start };
        self.scale * there + DVec3::new(self.away, 0.0, 0.0)
    }

    fn colour(&self, index: u64, share: f64) -> [f64; 3] {
        let light = match self.moves(index) {
            true => self.dark,
            false => 1.0 + self.flicker * (TAU * 7.3 * share).sin(),
        };
        [6, 7, 8].map(|word| light * self.light * Self::draw(index, word, 0.15, 0.9))
    }

    /// The scene at a share of its span.
    fn gaussians(&self, share: f64) -> Gaussians {
        let dc = 0.5 / std::f64::consts::PI.sqrt();
        let core = |index: u64| {
            let mean = self.place(index, share);
            let size = (self.scale * Self::draw(index, 9, 0.07, 0.16)).ln();
            [mean.x, mean.y, mean.z, size, size, size, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0]
        };
        let sh = |index: u64| {
            let [r, g, b] = self.colour(index, share).map(|value| (value - 0.5) / dc);
            [r, g, b, 0.0]
        };
        Gaussians {
            sh_degree: 0,
            core: (0..GAUSSIANS).flat_map(core).collect(),
            sh: (0..GAUSSIANS).flat_map(sh).collect(),
        }
    }

    /// Where camera `index` stands: on an arc of 100 degrees, a little higher and lower in turn.
    fn pose(&self, index: usize) -> Pose {
        let turn = if self.cameras > 1 { index as f64 / (self.cameras - 1) as f64 - 0.5 } else { 0.0 };
        let (sine, cosine) = (1.75 * turn).sin_cos();
        let height = [0.3, -0.2, 0.1][index % 3];
        let eye = AWAY * DVec3::new(sine, height, -cosine).normalize();
        let forward = -eye.normalize();
        let right = DVec3::Y.cross(forward).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        let centre = self.scale * eye + DVec3::new(self.away, 0.0, 0.0);
        Pose::from_matrix(rotation, -(rotation * centre))
    }

    fn intrinsics(&self) -> Intrinsics {
        let [width, height] = SIZE;
        let centre = [0.5 * f64::from(width), 0.5 * f64::from(height)];
        Intrinsics {
            width,
            height,
            fx: self.focal,
            fy: self.focal,
            cx: centre[0],
            cy: centre[1],
            distortion: Distortion::None,
        }
    }

    fn t_ns(&self, share: f64) -> i64 {
        (self.span_ns as f64 * share).round() as i64
    }

    fn share(&self, frame: usize) -> f64 {
        if self.frames > 1 { frame as f64 / (self.frames - 1) as f64 } else { 0.0 }
    }

    /// What camera `camera` sees at a share of the span: r, g, b of every pixel, 0 to 1.
    ///
    /// The scene is rendered where it would be at its usual size and place, in which the twin's view, in `f32`, is exact enough.
    ///
    /// # Errors
    /// Of the view.
    pub fn picture(&self, camera: usize, share: f64) -> Result<Vec<f64>, Refusal> {
        let usual = Self { scale: 1.0, away: 0.0, ..*self };
        let view = View::try_from((&self.intrinsics(), &usual.pose(camera)))?;
        let options = RenderOptions { sh_degree: 0, ..RenderOptions::default() };
        let image = usual.gaussians(share).render(&view, &options);
        Ok(image
            .pixels
            .iter()
            .flat_map(|pixel| [pixel.x, pixel.y, pixel.z].map(|value| value.clamp(0.0, 1.0)))
            .collect())
    }

    /// The training pictures: camera, time in [0, 1], and r, g, b of every pixel.
    ///
    /// # Errors
    /// Of the view.
    pub fn pictures(&self) -> Result<Vec<(usize, f64, Vec<f64>)>, Refusal> {
        let all = (0..self.cameras).flat_map(|camera| (0..self.frames).map(move |frame| (camera, frame)));
        all.map(|(camera, frame)| Ok((camera, self.share(frame), self.picture(camera, self.share(frame))?))).collect()
    }

    fn film(&self, root: &Path, index: usize) -> Result<Camera, Refusal> {
        let name = format!("{index:02}");
        let mut frames = Vec::new();
        for frame in 0..self.frames {
            let pixels = self.picture(index, self.share(frame))?;
            let mut image = ImageRgb8::new(SIZE[0], SIZE[1]);
            image.data.iter_mut().zip(pixels).for_each(|(byte, value)| *byte = (255.0 * value).round() as u8);
            let file = layout::image(&name, frame);
            let path = root.join(&file);
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            image.write_png(&path)?;
            let t_ns = self.t_ns(self.share(frame));
            frames.push(Frame { file, t_ns, exposure_ns: [t_ns; 2], mask: None });
        }
        let events = if self.events > 0 { Some(self.record(root, index, &name)?) } else { None };
        Ok(Camera {
            modality: if events.is_some() { Modality::Both } else { Modality::Rgb },
            split: Split::Train,
            intrinsics: self.intrinsics(),
            world_to_camera: self.pose(index),
            pose_sigma: None,
            clock_sigma_s: None,
            frames,
            events,
            name,
        })
    }

    fn record(&self, root: &Path, index: usize, name: &str) -> Result<CameraEvents, Refusal> {
        let config = SimulatorConfig { mode: Mode::Enhanced, ..SimulatorConfig::default() };
        let mut simulator = Simulator::new(SIZE[0], SIZE[1], &config, index as u64)?;
        let mut events = Events::new(SIZE[0], SIZE[1]);
        let pictures = (self.frames - 1) * self.events;
        for picture in 0..=pictures {
            let share = picture as f64 / pictures as f64;
            let pixels = self.picture(index, share)?;
            let luma = |rgb: &[f64]| (255.0 * (0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2])) as f32;
            let luma: Vec<f32> = pixels.chunks_exact(3).map(luma).collect();
            simulator.step(Luma::F32(&luma), self.t_ns(share), &mut events)?;
        }
        let file = layout::events(name);
        let path = root.join(&file);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        npz::write_events(&path, &events)?;
        Ok(CameraEvents {
            file,
            count: events.len() as u64,
            threshold_on: config.threshold_on,
            threshold_off: config.threshold_off,
            lin_log_threshold: SimulatorConfig::LIN_LOG_THRESHOLD,
            linear_light: false,
            covers_ns: [0, self.span_ns],
            simulator: None,
        })
    }

    /// Writes the dataset. Its points are the Gaussians' places at the beginning, of which `known` says whether it is told which of
    /// them move.
    ///
    /// # Errors
    /// Of any file.
    pub fn dataset(&self, root: &Path, known: bool) -> Result<Dataset, Refusal> {
        let cameras = (0..self.cameras).map(|index| self.film(root, index)).collect::<Result<Vec<_>, Refusal>>()?;
        let variant = if self.events > 1 { vec![VariantStep::subsample(self.events as u32)] } else { Vec::new() };
        let manifest = Manifest {
            format: Manifest::FORMAT.into(),
            version: Manifest::VERSION,
            name: "filmed".into(),
            provenance: Provenance::default(),
            span_ns: [0, self.span_ns],
            seed: 0,
            variant,
            linear_exposure: false,
            points: None,
            bodies: None,
            cameras,
            sha256: Default::default(),
        };
        let mut dataset = Dataset::new(root, manifest);
        let shares: Vec<f64> =
            if known { (0..self.frames).map(|frame| self.share(frame)).collect() } else { vec![0.0] };
        let (mut cloud, mut runs) = (PointCloud::default(), Vec::new());
        for (moving, shares) in [(false, &shares[..1]), (true, &shares[..])] {
            for &share in shares {
                let before = cloud.positions.len();
                for index in (0..GAUSSIANS).filter(|&index| self.moves(index) == moving) {
                    cloud.positions.push(self.place(index, share).as_vec3().to_array());
                    cloud.colours.push(self.colour(index, share).map(|value| (255.0 * value.min(1.0)).round() as u8));
                }
                let count = (cloud.positions.len() - before) as u64;
                if count > 0 {
                    runs.push(PointRun { t_ns: self.t_ns(share), found_again: !moving, moving, count });
                }
            }
        }
        let metadata = if known {
            [(PointCloudFile::RUNS.to_owned(), serde_json::to_value(runs)?)].into()
        } else {
            Default::default()
        };
        dataset.set_points(&cloud, "known", metadata)?;
        dataset.hash_files()?;
        dataset.save()?;
        Ok(Dataset::load(root)?)
    }
}
