//! Datasets without lens distortion.
//!
//! The trainer renders pinholes. A lens that bends rays is therefore taken out once, before training: each frame and
//! mask is resampled (bilinearly, at pixel centres) to the pinhole of the same size and principal point; each event
//! moves to the pixel in which its ray falls, or is dropped where that lies outside. Event pixels are not split: a
//! stretched part of the image has pixels without events.
//!
//! So that no pixel is made up, the focal length is enlarged where the pinhole would see what the lens did not; the
//! factor is recorded in the variant step.

use std::{collections::BTreeMap, path::Path};

use glam::DVec2;
use serde_json::json;

use crate::{
    Camera, Dataset, Distortion, Event, EventFile, Events, Frame, ImageGrey8, ImageRgb8, Intrinsics,
    dataset::{DatasetError, Problem, VariantStep, layout},
    npz,
    progress::{Progress, in_parallel},
};

/// Focal lengths are enlarged up to this factor before a lens counts as one that no pinhole can replace.
const LARGEST_FACTOR: f64 = 16.0;

/// Takes the distortion out of every camera that has one, as a new dataset in the folder `out`; all else is copied. The
/// step is recorded in [`crate::Manifest::variant`] as `undistort`.
///
/// # Errors
/// If a file cannot be read or written, `out` is not empty, or a lens model cannot be inverted over the image.
pub fn undistort(dataset: &Dataset, out: &Path, progress: &mut dyn FnMut(Progress)) -> Result<Dataset, DatasetError> {
    let folder = DatasetError::new_folder(out)?;
    let cameras = &dataset.manifest.cameras;
    let pinholes: Vec<(Intrinsics, f64)> = cameras
        .iter()
        .map(|camera| pinhole(&camera.intrinsics).map_err(|problem| dataset.in_camera(camera, problem)))
        .collect::<Result<_, _>>()?;
    let tasks: Vec<Task> = cameras.iter().zip(&pinholes).flat_map(|(camera, (to, _))| tasks(camera, *to)).collect();
    let total = tasks.len() as u64;
    let work = |task: &Task, tick: &dyn Fn()| {
        let count = task.run(dataset, folder.path())?;
        tick();
        Ok(count)
    };
    let counts = in_parallel(None, &tasks, ("files", total), work, progress)?;

    let mut new = Dataset::new(folder.path(), dataset.manifest.clone());
    for (camera, (to, _)) in new.manifest.cameras.iter_mut().zip(&pinholes) {
        if camera.intrinsics == *to {
            continue;
        }
        camera.intrinsics = *to;
        for (index, frame) in camera.frames.iter_mut().enumerate() {
            frame.file = layout::image(&camera.name, index);
            frame.mask = frame.mask.as_ref().map(|_| layout::mask(&camera.name, index));
        }
        if let Some(events) = &mut camera.events {
            events.file = layout::events(&camera.name);
        }
    }
    for (task, count) in tasks.iter().zip(counts) {
        if let Some(events) = new.manifest.cameras.iter_mut().find(|camera| camera.name == task.camera.name)
            && let (What::Events(_), Some(file)) = (&task.what, &mut events.events)
        {
            file.count = count;
        }
    }
    if let Some(points) = &dataset.manifest.points {
        copy(dataset, &points.file, folder.path())?;
    }
    let factors: BTreeMap<_, _> = cameras
        .iter()
        .zip(&pinholes)
        .filter(|(camera, _)| camera.intrinsics.distortion != Distortion::None)
        .map(|(camera, (_, factor))| (camera.name.clone(), json!({ "focal_factor": factor })))
        .collect();
    let parameters = [("cameras".to_owned(), json!(factors))].into();
    new.manifest.variant.push(VariantStep { step: "undistort".to_owned(), parameters });
    new.hash_files()?;
    new.save()?;
    new.validate()?;
    folder.finish().map_err(|source| DatasetError::Io { doing: "write", path: out.to_owned(), source })?;
    new.root = out.to_owned();
    Ok(new)
}

/// One file of one camera.
struct Task<'a> {
    camera: &'a Camera,
    to: Intrinsics,
    what: What<'a>,
}

enum What<'a> {
    Frame(usize, &'a Frame),
    Events(&'a EventFile),
}

fn tasks(camera: &Camera, to: Intrinsics) -> impl Iterator<Item = Task<'_>> {
    let frames = camera.frames.iter().enumerate().map(|(index, frame)| What::Frame(index, frame));
    frames.chain(camera.events.iter().map(What::Events)).map(move |what| Task { camera, to, what })
}

impl Task<'_> {
    /// Writes the files and returns how many events they hold.
    fn run(&self, dataset: &Dataset, root: &Path) -> Result<u64, DatasetError> {
        let Self { camera, to, what } = self;
        let (name, from) = (&camera.name, &camera.intrinsics);
        let image = |source| DatasetError::Image { camera: name.clone(), source };
        match what {
            What::Frame(_, frame) if from == to => {
                copy(dataset, &frame.file, root)?;
                frame.mask.iter().try_for_each(|mask| copy(dataset, mask, root))?;
                Ok(0)
            }
            What::Frame(index, frame) => {
                let map = pixel_map(from, to);
                let picture = undistort_image(&map, &dataset.read_image(camera, frame)?);
                picture.write_png(&root.join(layout::image(name, *index))).map_err(image)?;
                if let Some(mask) = dataset.read_mask(camera, frame)? {
                    undistort_mask(&map, &mask).write_png(&root.join(layout::mask(name, *index))).map_err(image)?;
                }
                Ok(0)
            }
            What::Events(file) if from == to => copy(dataset, &file.file, root).map(|()| file.count),
            What::Events(_) => {
                let Some(events) = dataset.read_events(camera)? else { return Ok(0) };
                let events = undistort_events(from, to, &events);
                npz::write_events(&root.join(layout::events(name)), &events)
                    .map_err(|source| DatasetError::Events { camera: name.clone(), source: Box::new(source) })?;
                Ok(events.len() as u64)
            }
        }
    }
}

fn copy(dataset: &Dataset, file: &Path, root: &Path) -> Result<(), DatasetError> {
    let (from, to) = (dataset.path(file)?, root.join(file));
    let io = |source| DatasetError::Io { doing: "copy", path: from.clone(), source };
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(io)?;
    }
    std::fs::copy(&from, &to).map(drop).map_err(io)
}

/// The pinhole that replaces a lens, and the factor by which its focal length was enlarged so that the lens saw all
/// that the pinhole sees.
///
/// # Errors
/// If even a much longer focal length does not help.
pub fn pinhole(from: &Intrinsics) -> Result<(Intrinsics, f64), Problem> {
    if from.distortion == Distortion::None {
        return Ok((*from, 1.0));
    }
    let scaled =
        |factor: f64| Intrinsics { fx: from.fx * factor, fy: from.fy * factor, distortion: Distortion::None, ..*from };
    if sees_all(from, &scaled(1.0)) {
        return Ok((scaled(1.0), 1.0));
    }
    let (mut short, mut long) = (1.0, LARGEST_FACTOR);
    if !sees_all(from, &scaled(long)) {
        return Err(Problem::Lens);
    }
    while long - short > 1e-4 {
        let middle = 0.5 * (short + long);
        if sees_all(from, &scaled(middle)) { long = middle } else { short = middle }
    }
    Ok((scaled(long), long))
}

/// Whether the lens has an image of every pixel on the border of `to`, and so of all within.
fn sees_all(from: &Intrinsics, to: &Intrinsics) -> bool {
    let [width, height] = [to.width, to.height].map(f64::from);
    let columns =
        (0..to.width).map(|x| f64::from(x) + 0.5).flat_map(|x| [DVec2::new(x, 0.5), DVec2::new(x, height - 0.5)]);
    let rows =
        (0..to.height).map(|y| f64::from(y) + 0.5).flat_map(|y| [DVec2::new(0.5, y), DVec2::new(width - 0.5, y)]);
    let seen = |pixel: DVec2| {
        let source = from.project(to.unproject_pinhole(pixel, 1.0))?;
        // Between the centres of the outermost pixels nothing needs to be made up; rounding gets a hair's breadth.
        let inside = |value: f64, size: f64| (0.5 - 1e-6..=size - 0.5 + 1e-6).contains(&value);
        (inside(source.x, width) && inside(source.y, height)).then_some(())
    };
    columns.chain(rows).all(|pixel| seen(pixel).is_some())
}

/// Where each pixel of `to`, row by row, lies in images of `from` (pixels; centres at half-integers).
fn pixel_map(from: &Intrinsics, to: &Intrinsics) -> Vec<DVec2> {
    let pixels = (0..to.height).flat_map(|y| (0..to.width).map(move |x| (x, y)));
    let centre = |(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    // Within the border that `sees_all` checked every ray has an image; a lens that folds inside it shows its corner.
    pixels.map(|pixel| from.project(to.unproject_pinhole(centre(pixel), 1.0)).unwrap_or(DVec2::ZERO)).collect()
}

/// Samples an image of `C` interleaved channels bilinearly at every position of `map`; outside, the border goes on.
fn sample<const C: usize>(map: &[DVec2], data: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut out = Vec::with_capacity(map.len() * C);
    let clamp = |value: f64, size: u32| value.clamp(0.0, f64::from(size.max(1) - 1));
    let value = |x: usize, y: usize, channel: usize| {
        f64::from(data.get((y * width as usize + x) * C + channel).copied().unwrap_or(0))
    };
    for position in map {
        let (x, y) = (clamp(position.x - 0.5, width), clamp(position.y - 0.5, height));
        let (left, top) = (x.floor() as usize, y.floor() as usize);
        let (right, bottom) = ((x.ceil() as usize), (y.ceil() as usize));
        let (u, v) = (x.fract(), y.fract());
        for channel in 0..C {
            let above = value(left, top, channel) * (1.0 - u) + value(right, top, channel) * u;
            let below = value(left, bottom, channel) * (1.0 - u) + value(right, bottom, channel) * u;
            out.push((above * (1.0 - v) + below * v).round() as u8);
        }
    }
    out
}

/// An image of `from` as `to` (see [`pinhole`]) sees it, resampled bilinearly.
#[must_use]
pub fn undistort_picture(from: &Intrinsics, to: &Intrinsics, image: &ImageRgb8) -> ImageRgb8 {
    if from == to {
        return image.clone();
    }
    let image = undistort_image(&pixel_map(from, to), image);
    ImageRgb8 { width: to.width, height: to.height, ..image }
}

fn undistort_image(map: &[DVec2], image: &ImageRgb8) -> ImageRgb8 {
    let (width, height) = (image.width, image.height);
    ImageRgb8 { width, height, data: sample::<3>(map, &image.data, width, height) }
}

fn undistort_mask(map: &[DVec2], mask: &ImageGrey8) -> ImageGrey8 {
    let (width, height) = (mask.width, mask.height);
    ImageGrey8 { width, height, data: sample::<1>(map, &mask.data, width, height) }.binarised()
}

/// Events of `from` moved to the pixels of `to` that their rays fall in; those outside are dropped.
#[must_use]
pub fn undistort_events(from: &Intrinsics, to: &Intrinsics, events: &Events) -> Events {
    let place = |(x, y): (u32, u32)| {
        let ray = from.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).ok()?;
        let pixel = (ray.z > 0.0).then(|| to.project_pinhole(ray))?.floor();
        let inside = (0.0..f64::from(to.width)).contains(&pixel.x) && (0.0..f64::from(to.height)).contains(&pixel.y);
        inside.then_some((pixel.x as u16, pixel.y as u16))
    };
    let pixels = (0..from.height).flat_map(|y| (0..from.width).map(move |x| (x, y)));
    let table: Vec<Option<(u16, u16)>> = pixels.map(place).collect();
    let mut moved = Events::new(to.width, to.height);
    for event in events.iter() {
        let at = usize::from(event.y) * from.width as usize + usize::from(event.x);
        if let Some(&Some((x, y))) = table.get(at) {
            moved.push(Event { x, y, ..event });
        }
    }
    moved
}

#[cfg(test)]
mod tests;
