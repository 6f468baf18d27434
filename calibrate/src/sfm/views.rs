//! The images: one of each camera, all of one instant.

use std::{
    fs,
    path::{Path, PathBuf},
};

use erfgs_base::{
    FileError,
    order::{natural, order},
};
use erfgs_dataset::{Dataset, DatasetError};
use erfgs_scene::{Intrinsics, Modality, image::ImageGrey8};

use super::SfmError;
use erfgs_scene::rig_file::RigFile;

/// What one camera saw.
#[derive(Clone, Debug)]
pub struct CameraView {
    /// Name of the camera.
    pub name: String,
    /// What it records.
    pub modality: Modality,
    /// What it saw at the instant, grey.
    pub image: ImageGrey8,
    /// Its intrinsics, where they are known.
    pub intrinsics: Option<Intrinsics>,
    /// The file, where it was one of several of its camera.
    pub chosen: Option<PathBuf>,
}

/// Where intrinsics come from.
#[derive(Clone, Debug)]
pub enum KnownIntrinsics<'a> {
    /// Nowhere: they are estimated.
    Unknown,
    /// The dataset's own.
    Dataset,
    /// A rig file.
    Rig(&'a RigFile, &'a Path),
}

/// Reads the views of `path`: a dataset, a folder with an image of each camera, or a folder with a folder of images for each
/// camera. `frame` counts images in the order of the numbers in their names, from 0.
///
/// # Errors
/// If there are fewer than three, one cannot be read, nobody knows the order of a camera's, or the intrinsics do not fit.
pub fn read_views(path: &Path, frame: usize, known: &KnownIntrinsics<'_>) -> Result<Vec<CameraView>, SfmError> {
    let mut found: Vec<(String, Modality, PathBuf, Option<Intrinsics>, bool)> = Vec::new();
    if path.join("dataset.json").is_file() || path.is_file() {
        let dataset = Dataset::load(path)?;
        for camera in dataset.manifest.cameras.iter().filter(|camera| camera.modality.has_frames()) {
            let file = camera.frames.get(frame).ok_or_else(|| SfmError::NoFrame {
                camera: camera.name.clone(),
                frame,
                has: camera.frames.len(),
            })?;
            let intrinsics = matches!(known, KnownIntrinsics::Dataset).then_some(camera.intrinsics);
            found.push((camera.name.clone(), camera.modality, dataset.root.join(&file.file), intrinsics, false));
        }
    } else {
        let entries = entries(path)?;
        let folders: Vec<&PathBuf> = entries.iter().filter(|entry| entry.is_dir()).collect();
        for folder in &folders {
            let camera = name(folder);
            let images = in_order(&camera, entries_of_images(folder)?)?;
            if images.is_empty() {
                continue;
            }
            let file = images.get(frame).cloned();
            let has = images.len();
            let file = file.ok_or(SfmError::NoFrame { camera: camera.clone(), frame, has })?;
            found.push((camera, Modality::Rgb, file, None, has > 1));
        }
        if found.is_empty() {
            let images = entries_of_images(path)?;
            found.extend(images.into_iter().map(|image| (stem(&image), Modality::Rgb, image, None, false)));
        }
    }
    if found.len() < 3 {
        return Err(SfmError::TooFewViews { path: path.into(), found: found.len() });
    }
    found
        .into_iter()
        .map(|(name, modality, file, intrinsics, is_chosen)| {
            let image = ImageGrey8::read(&file).map_err(|source| SfmError::Image { camera: name.clone(), source })?;
            let intrinsics = match known {
                KnownIntrinsics::Rig(rig, path) => {
                    let camera = rig.camera(&name);
                    let missing = || SfmError::NoIntrinsics { camera: name.clone(), path: (*path).into() };
                    Some(camera.ok_or_else(missing)?.intrinsics)
                }
                KnownIntrinsics::Dataset | KnownIntrinsics::Unknown => intrinsics,
            };
            let view = CameraView { name, modality, image, intrinsics, chosen: is_chosen.then_some(file) };
            view.check()?;
            Ok(view)
        })
        .collect()
}

/// What each camera of a dataset with frames shows of what stands still: the median of frames spread over the recording.
///
/// # Errors
/// If a frame cannot be read.
pub fn read_still_views(dataset: &Dataset) -> Result<Vec<CameraView>, SfmError> {
    let with_frames = dataset.manifest.cameras.iter().filter(|camera| !camera.frames.is_empty());
    with_frames
        .map(|camera| {
            let count = camera.frames.len();
            let frames = (0..count.min(STILL_OF))
                .map(|place| &camera.frames[(2 * place + 1) * count / (2 * count.min(STILL_OF))]);
            let images: Vec<ImageGrey8> = frames
                .map(|frame| Ok(dataset.read_image(camera, frame)?.grey()))
                .collect::<Result<_, DatasetError>>()?;
            let k = camera.intrinsics;
            let pixel = |at: usize| {
                let mut levels: Vec<u8> = images.iter().map(|image| image.data[at]).collect();
                let middle = levels.len() / 2;
                *levels.select_nth_unstable(middle).1
            };
            let image =
                ImageGrey8 { width: k.width, height: k.height, data: (0..images[0].data.len()).map(pixel).collect() };
            let (name, modality, intrinsics) = (camera.name.clone(), camera.modality, Some(k));
            Ok(CameraView { name, modality, image, intrinsics, chosen: None })
        })
        .collect()
}

/// From so many frames at most.
const STILL_OF: usize = 9;

impl CameraView {
    /// Whether the image is of the size that the intrinsics are for.
    ///
    /// # Errors
    /// [`SfmError::Size`].
    pub fn check(&self) -> Result<(), SfmError> {
        let image = [self.image.width, self.image.height];
        match &self.intrinsics {
            Some(k) if [k.width, k.height] != image => {
                Err(SfmError::Size { camera: self.name.clone(), image, intrinsics: [k.width, k.height] })
            }
            _ => Ok(()),
        }
    }
}

/// The images of a rig's cameras that have poses, of those that `path` has images of.
///
/// # Errors
/// As [`read_views`].
pub fn read_model_views(path: &Path, frame: usize, rig: &RigFile) -> Result<Vec<CameraView>, SfmError> {
    let placed = |view: &CameraView| rig.camera(&view.name).filter(|camera| camera.pose.is_some());
    let views = read_views(path, frame, &KnownIntrinsics::Unknown)?.into_iter().filter_map(|view| {
        let camera = placed(&view)?;
        Some(CameraView { intrinsics: Some(camera.intrinsics), modality: camera.modality, ..view })
    });
    let views: Vec<CameraView> = views.collect();
    views.iter().try_for_each(CameraView::check)?;
    if views.len() < 3 {
        return Err(SfmError::TooFewViews { path: path.into(), found: views.len() });
    }
    Ok(views)
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, SfmError> {
    let io = FileError::when("list the folder", folder);
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)
        .map_err(&io)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()
        .map_err(io)?;
    entries.sort_by(|a, b| natural(&name(a), &name(b)));
    Ok(entries)
}

/// A camera's images in the order of the numbers in their names.
fn in_order(camera: &str, images: Vec<PathBuf>) -> Result<Vec<PathBuf>, SfmError> {
    let names: Vec<String> = images.iter().map(|image| stem(image)).collect();
    let order = order(&names).map_err(|doubt| SfmError::Order { camera: camera.into(), doubt })?;
    Ok(order.into_iter().map(|at| images[at].clone()).collect())
}

fn entries_of_images(folder: &Path) -> Result<Vec<PathBuf>, SfmError> {
    let is_image = |path: &PathBuf| {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        // Other systems leave hidden files beside pictures that are called as these are.
        !name(path).starts_with('.') && path.is_file() && matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg"))
    };
    Ok(entries(folder)?.into_iter().filter(is_image).collect())
}

fn name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey picture of so many columns.
    fn write(folder: &Path, file: &str, columns: u32) {
        ImageGrey8::new(columns, 20).write_png(&folder.join(file)).unwrap();
    }

    fn taken(folder: &Path, frame: usize) -> Result<Vec<(String, u32)>, SfmError> {
        let views = read_views(folder, frame, &KnownIntrinsics::Unknown)?;
        Ok(views.into_iter().map(|view| (view.name, view.image.width)).collect())
    }

    #[test]
    fn images_and_cameras_are_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let pairs = |names: [&str; 3], columns: u32| names.map(|name| (name.to_owned(), columns)).to_vec();
        for camera in ["cam10", "cam2", "cam1"] {
            for (number, file) in (0..).zip(["img_8.png", "img_9.png", "img_10.png", "img_100.png"]) {
                write(folder, &format!("{camera}/{file}"), 16 + number);
            }
            // As other systems leave them beside pictures.
            std::fs::write(folder.join(camera).join("._img_8.png"), "no picture").unwrap();
        }
        for frame in 0..4 {
            let found = taken(folder, frame).unwrap();
            assert_eq!(found, pairs(["cam1", "cam2", "cam10"], 16 + frame as u32), "frame {frame}");
        }
        let views = read_views(folder, 2, &KnownIntrinsics::Unknown).unwrap();
        assert_eq!(views[1].chosen.as_deref(), Some(folder.join("cam2/img_10.png").as_path()));
        write(folder, "cam2/img_09.png", 16);
        let message = taken(folder, 0).unwrap_err().to_string();
        assert!(message.contains("cam2") && message.contains("img_9") && message.contains("img_09"), "{message}");
    }

    #[test]
    fn single_images_are_cameras_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for file in ["10.png", "9.png", "1.png"] {
            write(folder.path(), file, 16);
        }
        let names: Vec<String> = taken(folder.path(), 0).unwrap().into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["1", "9", "10"]);
        let views = read_views(folder.path(), 0, &KnownIntrinsics::Unknown).unwrap();
        assert!(views.iter().all(|view| view.chosen.is_none()));
    }
}
