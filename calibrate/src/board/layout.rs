//! What folders of recordings look like: which files are whose, and which images belong together.
//!
//! A camera is a folder of images or with one video, or a video, or a file of events, or all images whose names begin alike. The
//! `int_` or `ext_` before and the `_img` behind a folder's name are pose2sim's, which has a folder for lenses and one for
//! places, and are no part of the camera's name. Images belong together that are called alike; where no two cameras have such
//! images, those that end in the same number do (`left/left01.png`, `right/right01.png`), and single ones in any case.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use erfgs_base::FileError;

use super::BoardError;

/// The file with the times of videos' frames.
pub(super) const TIMES: &str = "timestamps.csv";
const IMAGES: [&str; 4] = ["png", "jpg", "jpeg", "ppm"];
const EVENTS: [&str; 4] = ["raw", "dat", "aedat4", "aedat"];
pub(super) const VIDEOS: [&str; 6] = ["mp4", "mkv", "avi", "mov", "webm", "m4v"];

/// One camera's input.
#[derive(Debug, PartialEq)]
pub(super) enum Input {
    /// What the instant is called, and the file.
    Images(Vec<(String, PathBuf)>),
    Video(PathBuf),
    Events(PathBuf),
}

/// A recording of lenses and one of places, which are folders of one folder as caliscope and pose2sim have them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TwoParts {
    /// Where the board was shown to each camera, if there is such a folder.
    pub lenses: Option<PathBuf>,
    /// Where it was shown to several at once.
    pub places: Option<PathBuf>,
}

impl TwoParts {
    /// The parts of `folder`; `None` where there are none.
    #[must_use]
    pub fn of(folder: &Path) -> Option<Self> {
        let first = |names: [&str; 2]| names.map(|name| folder.join(name)).into_iter().find(|path| path.is_dir());
        let parts = Self { lenses: first(["intrinsics", "intrinsic"]), places: first(["extrinsics", "extrinsic"]) };
        (parts.lenses.is_some() || parts.places.is_some()).then_some(parts)
    }
}

fn list(folder: &Path) -> Result<Vec<PathBuf>, BoardError> {
    let error = FileError::when("read the folder", folder);
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(&error)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<_, _>>()
        .map_err(error)?;
    entries.sort();
    Ok(entries)
}

pub(super) fn has_extension(path: &Path, of: &[&str]) -> bool {
    path.extension().is_some_and(|e| of.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The camera that a folder is of.
fn of_folder(name: &str) -> &str {
    let own = name.strip_prefix("int_").or_else(|| name.strip_prefix("ext_")).unwrap_or(name);
    let own = own.strip_suffix("_img").unwrap_or(own);
    if own.is_empty() { name } else { own }
}

/// The cameras of a folder, by name. Tables beside videos are often no events; `with_tables` says that events are looked for.
pub(super) fn cameras(folder: &Path, with_tables: bool) -> Result<BTreeMap<String, Input>, BoardError> {
    let mut cameras = BTreeMap::new();
    let mut loose: BTreeMap<String, Vec<(String, PathBuf)>> = BTreeMap::new();
    for path in list(folder)? {
        if path.is_dir() {
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            if let Some(input) = within(&path)? {
                cameras.insert(of_folder(&name).to_owned(), input);
            }
        } else if has_extension(&path, &VIDEOS) {
            cameras.insert(of_folder(&stem(&path)).to_owned(), Input::Video(path));
        } else if has_extension(&path, &EVENTS)
            || (with_tables && has_extension(&path, &["csv"]) && !path.ends_with(TIMES))
        {
            cameras.insert(stem(&path), Input::Events(path));
        } else if has_extension(&path, &IMAGES) {
            let name = stem(&path);
            let camera = name.trim_end_matches(|c: char| c.is_ascii_digit());
            let instant = name[camera.len()..].to_owned();
            let camera = camera.trim_end_matches(['_', '-', '.']);
            let camera = if camera.is_empty() { "camera" } else { camera };
            loose.entry(camera.to_owned()).or_default().push((instant, path));
        }
    }
    // Beside folders or videos, loose images are something else: a mask, a photograph of the rig.
    if cameras.is_empty() {
        cameras.extend(loose.into_iter().map(|(camera, images)| (camera, Input::Images(images))));
    }
    name_alike(&mut cameras);
    Ok(cameras)
}

/// What a folder of one camera holds.
fn within(folder: &Path) -> Result<Option<Input>, BoardError> {
    let files = list(folder)?;
    let of = |kinds: &[&str]| -> Vec<PathBuf> { files.iter().filter(|f| has_extension(f, kinds)).cloned().collect() };
    let images = of(&IMAGES);
    if !images.is_empty() {
        return Ok(Some(Input::Images(images.into_iter().map(|file| (stem(&file), file)).collect())));
    }
    Ok(match of(&VIDEOS).as_slice() {
        [video] => Some(Input::Video(video.clone())),
        _ => None,
    })
}

/// Calls instants by the last number in images' names where no two cameras have images that are called alike.
fn name_alike(cameras: &mut BTreeMap<String, Input>) {
    let mut images: Vec<(&str, &mut Vec<(String, PathBuf)>)> = cameras
        .iter_mut()
        .filter_map(
            |(camera, input)| if let Input::Images(images) = input { Some((camera.as_str(), images)) } else { None },
        )
        .collect();
    let shared = |images: &[(&str, &mut Vec<(String, PathBuf)>)]| {
        let mut before = BTreeSet::new();
        images.iter().any(|(_, own)| {
            let own: BTreeSet<String> = own.iter().map(|(instant, _)| instant.clone()).collect();
            let again = own.iter().any(|instant| before.contains(instant));
            before.extend(own);
            again
        })
    };
    if images.len() < 2 || shared(&images) {
        return;
    }
    let single = images.iter().all(|(_, own)| own.len() == 1);
    for (camera, own) in &mut images {
        let numbers: Vec<String> = own.iter().map(|(instant, _)| last_number(instant, camera)).collect();
        let apart = numbers.iter().collect::<BTreeSet<_>>().len() == numbers.len();
        for ((instant, _), number) in own.iter_mut().zip(numbers) {
            if single {
                *instant = "1".into();
            } else if apart && !number.is_empty() {
                *instant = number;
            }
        }
    }
}

/// The last number in a name, without zeros before it; that of the camera's own name does not count.
fn last_number(name: &str, camera: &str) -> String {
    let own = name.strip_prefix(camera).or_else(|| name.strip_suffix(camera)).unwrap_or(name);
    let end = own.trim_end_matches(|c: char| !c.is_ascii_digit());
    let digits = end.rsplit(|c: char| !c.is_ascii_digit()).next().unwrap_or_default();
    let short = digits.trim_start_matches('0');
    if short.is_empty() && !digits.is_empty() { "0".into() } else { short.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is called how, in a folder with these files.
    fn named(files: &[&str]) -> Vec<(String, Vec<String>)> {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let instants = |input: Input| match input {
            Input::Images(images) => images.into_iter().map(|(instant, _)| instant).collect(),
            Input::Video(path) | Input::Events(path) => vec![stem(&path)],
        };
        cameras(folder.path(), false).unwrap().into_iter().map(|(camera, input)| (camera, instants(input))).collect()
    }

    fn expected(cameras: &[(&str, &[&str])]) -> Vec<(String, Vec<String>)> {
        let own = |(camera, instants): &(&str, &[&str])| {
            (String::from(*camera), instants.iter().map(|instant| String::from(*instant)).collect())
        };
        cameras.iter().map(own).collect()
    }

    #[test]
    fn folders_as_people_have_them_name_cameras_and_instants() {
        // OpenCV's pictures, loose and in folders.
        let pairs = ["left01.jpg", "left14.jpg", "right01.jpg", "right14.jpg"];
        assert_eq!(named(&pairs), expected(&[("left", &["01", "14"]), ("right", &["01", "14"])]));
        let sorted = ["left/left01.jpg", "left/left14.jpg", "right/right01.jpg", "right/right14.jpg"];
        assert_eq!(named(&sorted), expected(&[("left", &["1", "14"]), ("right", &["1", "14"])]));
        // pose2sim's.
        let lenses = ["int_cam01_img/a1.png", "int_cam01_img/a2.png", "int_cam02_img/b.mp4"];
        assert_eq!(named(&lenses), expected(&[("cam01", &["a1", "a2"]), ("cam02", &["b"])]));
        let places = ["ext_cam01_img/cam01.png", "ext_cam02_img/other.png"];
        assert_eq!(named(&places), expected(&[("cam01", &["1"]), ("cam02", &["1"])]));
        // What is called alike stays, and numbers that meet are no names.
        let alike = ["a/x_7.png", "a/y_7.png", "b/x_7.png"];
        assert_eq!(named(&alike), expected(&[("a", &["x_7", "y_7"]), ("b", &["x_7"])]));
        let meet = ["a/x_7.png", "a/y_7.png", "b/z_7.png", "b/z_8.png"];
        assert_eq!(named(&meet), expected(&[("a", &["x_7", "y_7"]), ("b", &["7", "8"])]));
    }

    #[test]
    fn the_parts_of_a_calibration_are_found() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(TwoParts::of(folder.path()), None);
        std::fs::create_dir(folder.path().join("extrinsic")).unwrap();
        let places = Some(folder.path().join("extrinsic"));
        assert_eq!(TwoParts::of(folder.path()), Some(TwoParts { lenses: None, places }));
    }
}
