//! Datasets in the layouts that other trainers read.
//!
//! ```text
//! images/<camera>/<index>.png   the frames; images/<camera>.png where a camera has one alone
//! frames.csv                    camera, split, time and exposure of each image
//! sparse/0/                     COLMAP: cameras, images and points3D as .bin; one image for each frame
//! transforms.json, points.ply   nerfstudio: poses, `time` in [0, 1], the split, and the initial points
//! ```
//! Frames are copied as they are. What a layout has no place for is said.

mod colmap;
mod nerfstudio;

use std::{fmt::Write as _, path::Path};

use erfgs_base::{
    FileError, atomic,
    progress::{Progress, in_parallel},
};
use erfgs_scene::PointCloud;

use crate::{Camera, Dataset, DatasetError, Frame, Split};

/// A layout of other programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// COLMAP's: 3DGS and most programs after it.
    Colmap,
    /// nerfstudio's `transforms.json`.
    Nerfstudio,
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exported {
    /// Frames.
    pub images: u64,
    /// Initial points.
    pub points: u64,
    /// What the layout has no place for, a sentence each.
    pub notes: Vec<String>,
}

/// A frame and where it goes, relative to the folder.
struct Image<'a> {
    camera: &'a Camera,
    frame: &'a Frame,
    file: String,
}

impl Image<'_> {
    /// Its name in the folder `images`.
    fn name(&self) -> &str {
        self.file.strip_prefix("images/").unwrap_or(&self.file)
    }

    fn held_out(&self) -> bool {
        self.camera.split == Split::Test
    }
}

/// Writes the frames of `dataset`, their cameras and the initial points into the new folder `out`.
///
/// # Errors
/// If a file cannot be read or written, `out` is not empty, or the layout has no model of a lens.
pub fn export(
    dataset: &Dataset,
    layout: Layout,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Exported, DatasetError> {
    let folder = DatasetError::new_folder(out)?;
    let root = folder.path();
    let images: Vec<Image<'_>> = dataset.manifest.cameras.iter().flat_map(images).collect();
    let points = dataset.read_points()?;
    let notes = left_out(dataset)?;
    let copy = |image: &Image<'_>, tick: &dyn Fn()| -> Result<(), DatasetError> {
        dataset.copy_file(&image.frame.file, &root.join(&image.file))?;
        tick();
        Ok(())
    };
    in_parallel(None, &images, ("images", images.len() as u64), copy, progress)?;
    let table = root.join("frames.csv");
    atomic::write(&table, frames(&images).as_bytes()).map_err(FileError::when("write", &table))?;
    match layout {
        Layout::Colmap => colmap::write(&images, points.as_ref(), root)?,
        Layout::Nerfstudio => nerfstudio::write(&images, points.as_ref(), dataset.manifest.span_ns, root)?,
    }
    folder.finish().map_err(FileError::when("write", out))?;
    Ok(Exported { images: images.len() as u64, points: points.as_ref().map_or(0, PointCloud::len) as u64, notes })
}

fn images(camera: &Camera) -> impl Iterator<Item = Image<'_>> {
    let name = &camera.name;
    let alone = camera.frames.len() == 1;
    camera.frames.iter().enumerate().map(move |(index, frame)| {
        let extension = frame.file.extension().map_or_else(|| "png".into(), |extension| extension.to_string_lossy());
        let file = match alone {
            true => format!("images/{name}.{extension}"),
            false => format!("images/{name}/{index:05}.{extension}"),
        };
        Image { camera, frame, file }
    })
}

fn frames(images: &[Image<'_>]) -> String {
    let mut table = String::from("image,camera,split,t_ns,exposure_start_ns,exposure_end_ns\n");
    for image in images {
        let split = if image.held_out() { "test" } else { "train" };
        let (t_ns, [start, end]) = (image.frame.t_ns, image.frame.exposure_ns);
        let _ = writeln!(table, "{},{},{split},{t_ns},{start},{end}", image.file, image.camera.name);
    }
    table
}

/// What of the dataset is not in the folder.
fn left_out(dataset: &Dataset) -> Result<Vec<String>, DatasetError> {
    let cameras = &dataset.manifest.cameras;
    let mut notes = Vec::new();
    let mut note = |count: usize, text: &str| {
        if count > 0 {
            notes.push(format!("{text}: {count}"));
        }
    };
    note(cameras.iter().filter(|camera| camera.events.is_some()).count(), "cameras whose events are left out");
    note(
        cameras.iter().filter(|camera| camera.frames.is_empty()).count(),
        "cameras left out, because they have no frames",
    );
    let masks = cameras.iter().flat_map(|camera| &camera.frames).filter(|frame| frame.mask.is_some()).count();
    note(masks, "masks of moving pixels left out");
    let moving: u64 = dataset.point_runs()?.into_iter().flatten().filter(|run| run.moving).map(|run| run.count).sum();
    note(moving as usize, "moving points, whose instants are left out");
    Ok(notes)
}
