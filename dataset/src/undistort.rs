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

use crate::{Camera, CameraEvents, Dataset, DatasetError, Frame, Problem, VariantStep, layout};
use erfgs_base::progress::{Progress, in_parallel};
use erfgs_events::{Event, Events, npz};
use erfgs_scene::{
    Distortion, Intrinsics,
    undistort::{Undistortion, pinhole},
};

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
        .map(|camera| pinhole(&camera.intrinsics).map_err(|_| dataset.in_camera(camera, Problem::Lens)))
        .collect::<Result<_, _>>()?;
    let tasks: Vec<Task> = cameras.iter().zip(&pinholes).flat_map(|(camera, (to, _))| tasks(camera, *to)).collect();
    let total = tasks.len() as u64;
    let work = |task: &Task, tick: &dyn Fn()| -> Result<u64, DatasetError> {
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
    let points = dataset.manifest.points.iter().map(|points| &points.file);
    for file in points.chain(dataset.manifest.bodies.iter().map(|bodies| &bodies.file)) {
        dataset.copy_file(file, &folder.path().join(file))?;
    }
    let factors: BTreeMap<_, _> = cameras
        .iter()
        .zip(&pinholes)
        .filter(|(camera, _)| camera.intrinsics.distortion != Distortion::None)
        .map(|(camera, (_, factor))| (camera.name.clone(), json!({ "focal_factor": factor })))
        .collect();
    let parameters = [("cameras".to_owned(), json!(factors))].into();
    new.manifest.variant.push(VariantStep { step: "undistort".to_owned(), parameters });
    new.complete(folder, out)
}

/// One file of one camera.
struct Task<'a> {
    camera: &'a Camera,
    to: Intrinsics,
    what: What<'a>,
}

enum What<'a> {
    Frame(usize, &'a Frame),
    Events(&'a CameraEvents),
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
                dataset.copy_file(&frame.file, &root.join(&frame.file))?;
                frame.mask.iter().try_for_each(|mask| dataset.copy_file(mask, &root.join(mask)))?;
                Ok(0)
            }
            What::Frame(index, frame) => {
                let undistortion = Undistortion::new(from, to);
                let picture = undistortion.picture(&dataset.read_image(camera, frame)?);
                picture.write_png(&root.join(layout::image(name, *index))).map_err(image)?;
                if let Some(mask) = dataset.read_mask(camera, frame)? {
                    undistortion.mask(&mask).write_png(&root.join(layout::mask(name, *index))).map_err(image)?;
                }
                Ok(0)
            }
            What::Events(file) if from == to => {
                dataset.copy_file(&file.file, &root.join(&file.file)).map(|()| file.count)
            }
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
