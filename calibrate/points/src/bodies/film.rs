//! What the start reads: the moving points of each instant, and the frames that were taken then.

use erfgs_calibrate::statistics::median;
use erfgs_dataset::{Camera, Dataset};
use erfgs_scene::{
    Intrinsics,
    image::{ImageRgb8, Resample},
};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::smooth::{smooth_image, smooth_plane};
use crate::{
    CloudError, FrameChoice, hull,
    rig::{Rig, Station, all_instants},
};

/// More points of one instant tell no more about where things are; the others are left out evenly.
const MOST_POINTS: usize = 4000;
/// Frames are made smaller, all by the same whole factor, until they have at most so many pixels together.
const MOST_PIXELS: u64 = 40_000_000;
/// A pixel whose largest channel differs by more than this from its usual look, of 255, is of something that moves.
const DIFFERS: f32 = 18.0;
/// Colours that differ by more, summed over channels, count as this: what is hidden must not decide.
pub const MOST_APART: f64 = 200.0;

/// A pinhole camera with its matrices at hand.
#[derive(Clone, Debug)]
pub struct Eye {
    /// Intrinsics of the images that are read here.
    pub intrinsics: Intrinsics,
    /// Where it stands, metres.
    pub centre: DVec3,
    /// Turns from the world into the camera's axes.
    pub rotation: DMat3,
    translation: DVec3,
}

impl Eye {
    /// A camera whose images have `width` x `height` pixels.
    pub fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let pose = &camera.world_to_camera;
        Self {
            intrinsics: camera.intrinsics.resized(width, height),
            centre: pose.centre(),
            rotation: DMat3::from_quat(pose.rotation),
            translation: pose.translation,
        }
    }

    /// A place in the camera's axes, metres.
    pub fn inside(&self, place: DVec3) -> DVec3 {
        self.rotation * place + self.translation
    }

    /// Where a place is seen, pixels, and how deep it is, metres; none behind the camera or outside the image.
    pub fn see(&self, place: DVec3) -> Option<(DVec2, f64)> {
        let at = self.inside(place);
        if at.z <= 1e-9 {
            return None;
        }
        let k = &self.intrinsics;
        let pixel = k.project_pinhole(at);
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < f64::from(k.width) && pixel.y < f64::from(k.height);
        inside.then_some((pixel, at.z))
    }

    /// [`Eye::see`] as the index of a pixel, row-major.
    pub fn pixel(&self, place: DVec3) -> Option<usize> {
        let (pixel, _) = self.see(place)?;
        Some(pixel.y as usize * self.intrinsics.width as usize + pixel.x as usize)
    }
}

/// A frame of an instant.
#[derive(Clone, Debug)]
pub struct View {
    /// Which camera took it.
    pub eye: usize,
    /// Its pixels.
    pub image: ImageRgb8,
    /// The same, smoothed.
    pub soft: ImageRgb8,
    /// Which pixels differ from the camera's usual look, row-major.
    pub moving: Vec<bool>,
}

impl View {
    /// The colour of a pixel by its index.
    pub fn colour(&self, pixel: usize) -> [u8; 3] {
        channels(&self.image, pixel)
    }

    /// The colour of a pixel of the smoothed frame by its index.
    pub fn soft_colour(&self, pixel: usize) -> [u8; 3] {
        channels(&self.soft, pixel)
    }

    /// How far a colour is apart from a pixel of the smoothed frame by its index, summed over channels, at most [`MOST_APART`].
    pub fn apart(&self, pixel: usize, colour: [u8; 3]) -> f64 {
        let soft = channels(&self.soft, pixel);
        let apart: f64 = std::iter::zip(soft, colour).map(|(a, b)| f64::from(a.abs_diff(b))).sum();
        apart.min(MOST_APART)
    }
}

fn channels(image: &ImageRgb8, pixel: usize) -> [u8; 3] {
    std::array::from_fn(|channel| image.data[3 * pixel + channel])
}

/// An instant with points of what moves.
#[derive(Clone, Debug)]
pub struct Moment {
    /// The middle of the exposures, nanoseconds on the session clock: where the hull of a blurred frame is.
    pub t_ns: i64,
    /// The same in seconds since the beginning of the recording.
    pub t_s: f64,
    /// How long the exposures are, seconds.
    pub exposure_s: f64,
    /// Places on hulls, metres.
    pub points: Vec<DVec3>,
    /// Their colours, sRGB.
    pub colours: Vec<[u8; 3]>,
    /// The frames taken then.
    pub views: Vec<View>,
}

/// All that the start reads of frames and points.
#[derive(Clone, Debug)]
pub struct Film {
    /// Beginning and end of the recording, nanoseconds on the session clock.
    pub span_ns: [i64; 2],
    /// The training cameras with frames.
    pub eyes: Vec<Eye>,
    /// The instants, ordered by time.
    pub moments: Vec<Moment>,
    /// The usual distance of a point of an instant from the next, metres.
    pub cell_m: f64,
}

impl Film {
    /// Reads the moving points of a dataset and the frames of their instants.
    pub fn read(dataset: &Dataset, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Self, CloudError> {
        let bare = bare_moments(dataset)?;
        let rig = Rig::new(dataset, &FrameChoice::Spread(usize::MAX))?;
        let instants = all_instants(&rig.stations);
        let total = bare.len() * rig.stations.len();
        progress(0, total);
        let factor = shrink(&rig.stations, bare.len());
        let sizes: Vec<[u32; 2]> = rig.stations.iter().map(|station| size(station, factor)).collect();
        let usual: Vec<ImageRgb8> = (0..rig.stations.len())
            .into_par_iter()
            .map(|index| {
                let k = rig.stations[index].intrinsics();
                let data = hull::usual(&rig, index)?.into_flattened();
                Ok(shrunk(ImageRgb8 { width: k.width, height: k.height, data }, sizes[index]))
            })
            .collect::<Result<_, CloudError>>()?;
        let mut moments = Vec::with_capacity(bare.len());
        for (done, (label_ns, points, colours)) in bare.into_iter().enumerate() {
            // Points without frames of their time were made for other frames.
            let Some(instant) = instants.iter().min_by_key(|instant| instant.t_ns.abs_diff(label_ns)) else { continue };
            let views: Vec<View> = instant
                .shots
                .par_iter()
                .map(|&(eye, frame)| {
                    let photo = rig.photo(eye, frame)?;
                    Ok(view(eye, shrunk(photo.image().clone(), sizes[eye]), &usual[eye]))
                })
                .collect::<Result<_, CloudError>>()?;
            let middles = instant.shots.iter().map(|(_, frame)| {
                let [start, end] = frame.exposure_ns.map(i128::from);
                (start + end) / 2
            });
            let t_ns = (middles.sum::<i128>() / (instant.shots.len().max(1) as i128)) as i64;
            let lengths = instant.shots.iter().map(|(_, frame)| {
                let [start, end] = frame.exposure_ns;
                1e-9 * end.saturating_sub(start).max(0) as f64
            });
            let exposure_s = median(lengths).unwrap_or(0.0);
            let t_s = 1e-9 * t_ns.saturating_sub(dataset.manifest.span_ns[0]) as f64;
            moments.push(Moment { t_ns, t_s, exposure_s, points, colours, views });
            progress((done + 1) * rig.stations.len(), total);
        }
        // Two labels may mean the same frames; later steps divide by what lies between two instants.
        moments.sort_by_key(|moment| moment.t_ns);
        moments.dedup_by_key(|moment| moment.t_ns);
        let eyes = std::iter::zip(&rig.stations, &sizes).map(|(station, &size)| Eye::new(station.camera, size));
        Ok(Self { span_ns: dataset.manifest.span_ns, eyes: eyes.collect(), cell_m: spacing(&moments), moments })
    }

    /// Seconds since the beginning of the recording as nanoseconds on the session clock.
    pub fn ns(&self, t_s: f64) -> i64 {
        self.span_ns[0].saturating_add((1e9 * t_s).round() as i64)
    }

    /// The usual time between instants, seconds.
    pub fn step_s(&self) -> f64 {
        median(self.moments.windows(2).map(|pair| pair[1].t_s - pair[0].t_s)).unwrap_or(1.0)
    }

    /// How long exposures usually are, seconds.
    pub fn exposure_s(&self) -> f64 {
        median(self.moments.iter().map(|moment| moment.exposure_s)).unwrap_or(0.0)
    }

    /// The length of the recording, seconds.
    pub fn seconds(&self) -> f64 {
        1e-9 * self.span_ns[1].saturating_sub(self.span_ns[0]) as f64
    }
}

type BareMoment = (i64, Vec<DVec3>, Vec<[u8; 3]>);

/// The moving points of the initial cloud by the label of their instant.
fn bare_moments(dataset: &Dataset) -> Result<Vec<BareMoment>, CloudError> {
    let (Some(cloud), Some(runs)) = (dataset.read_points()?, dataset.point_runs()?) else {
        return Err(CloudError::NoMovingPoints { instants: 0 });
    };
    let mut moments: Vec<BareMoment> = Vec::new();
    let mut next = 0;
    for run in &runs {
        let members = next..next + run.count as usize;
        next = members.end;
        if !run.moving {
            continue;
        }
        let step = members.len().div_ceil(MOST_POINTS).max(1);
        let picked = members.step_by(step).filter(|&index| cloud.positions[index].iter().all(|at| at.is_finite()));
        let picked: Vec<usize> = picked.collect();
        let points = picked.iter().map(|&index| DVec3::from(cloud.positions[index].map(f64::from))).collect();
        let colours = picked.iter().map(|&index| cloud.colours[index]).collect();
        moments.push((run.t_ns, points, colours));
    }
    moments.sort_by_key(|moment| moment.0);
    moments.dedup_by(|later, kept| {
        let same = later.0 == kept.0;
        if same {
            kept.1.append(&mut later.1);
            kept.2.append(&mut later.2);
        }
        same
    });
    if moments.len() < 2 {
        return Err(CloudError::NoMovingPoints { instants: moments.len() });
    }
    Ok(moments)
}

/// By which whole factor frames are made smaller, so that those of all instants fit into memory.
fn shrink(stations: &[Station<'_>], instants: usize) -> u32 {
    let of = |factor: u32| {
        stations.iter().map(|station| size(station, factor).map(u64::from).iter().product::<u64>()).sum::<u64>()
            * instants as u64
    };
    (1..64).find(|&factor| of(factor) <= MOST_PIXELS).unwrap_or(64)
}

fn size(station: &Station<'_>, factor: u32) -> [u32; 2] {
    let k = station.intrinsics();
    [k.width.div_ceil(factor), k.height.div_ceil(factor)]
}

fn shrunk(image: ImageRgb8, [width, height]: [u32; 2]) -> ImageRgb8 {
    if [image.width, image.height] == [width, height] { image } else { image.resized(width, height, Resample::Area) }
}

fn view(eye: usize, image: ImageRgb8, usual: &ImageRgb8) -> View {
    let moving = silhouette(&image, usual);
    View { eye, soft: smooth_image(&image, 3), image, moving }
}

/// Pixels that differ from the usual look, smoothed so that noise does not, and those beside them.
fn silhouette(image: &ImageRgb8, usual: &ImageRgb8) -> Vec<bool> {
    let (width, height) = (image.width as usize, image.height as usize);
    let apart = |(now, then): (&[u8], &[u8])| {
        std::iter::zip(now, then).map(|(a, b)| f32::from(a.abs_diff(*b))).fold(0.0, f32::max)
    };
    let mut difference: Vec<f32> =
        std::iter::zip(image.data.chunks_exact(3), usual.data.chunks_exact(3)).map(apart).collect();
    smooth_plane(&mut difference, width, height, 1);
    let raw = |x: usize, y: usize| difference[y * width + x] > DIFFERS;
    let mut moving = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            moving.push(raw(x, y) || beside.into_iter().any(|(x, y)| x < width && y < height && raw(x, y)));
        }
    }
    moving
}

/// The median over instants of the median distance to the next point.
fn spacing(moments: &[Moment]) -> f64 {
    let of = |points: &Vec<DVec3>| {
        // Some hundred tell the median.
        let step = points.len().div_ceil(400).max(1);
        let next = |index: usize| {
            let others = points.iter().enumerate().filter(|(other, _)| *other != index);
            others.map(|(_, other)| other.distance_squared(points[index])).fold(f64::INFINITY, f64::min).sqrt()
        };
        median((0..points.len()).step_by(step).map(next).filter(|distance| distance.is_finite()))
    };
    median(moments.par_iter().filter_map(|moment| of(&moment.points)).collect::<Vec<_>>()).unwrap_or(0.0)
}

/// A camera of 320 x 180 pixels at `from` that looks at `to`.
#[cfg(test)]
pub fn test_eye(from: DVec3, to: DVec3) -> Eye {
    let pose = erfgs_scene::Pose::look_at(from, to, DVec3::Y);
    let distortion = erfgs_scene::Distortion::None;
    let intrinsics = Intrinsics { width: 320, height: 180, fx: 250.0, fy: 250.0, cx: 160.0, cy: 90.0, distortion };
    Eye { intrinsics, centre: pose.centre(), rotation: DMat3::from_quat(pose.rotation), translation: pose.translation }
}
