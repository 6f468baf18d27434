//! What folders of recordings look like: which files are whose, and which images belong together.
//!
//! A camera is a folder of images or with one video, or a video, or a file of events, or all images whose names begin alike. The
//! `int_` or `ext_` before and the `_img` behind a folder's name are pose2sim's, which has a folder for lenses and one for
//! places, and are no part of the camera's name. Images belong together that are called alike; where no two cameras have such
//! images, those whose numbers are the same do, of the numbers that are not the same in all names of a camera (`left/left01.png`,
//! `right/right01.png`), and single ones in any case.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, order::natural};

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

/// Names that a folder of calibration pictures or videos has among those of a session, or that it begins with.
const CALIBRATION: [&str; 5] = ["calib", "checkerboard", "chessboard", "charuco", "aprilgrid"];

/// A folder of a session in which a calibration was recorded, beside other recordings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CalibrationFolder {
    /// The folder.
    pub folder: PathBuf,
    /// What lies beside it and is not looked at, by name.
    pub passed_over: Vec<String>,
}

impl CalibrationFolder {
    /// The one folder in `session` that is called as those of calibrations are and holds something to look at, if what else there is
    /// are videos and events, and no folders of cameras' pictures.
    ///
    /// # Errors
    /// If a folder cannot be read.
    pub fn of(session: &Path) -> Result<Option<Self>, BoardError> {
        let is_named = |path: &&PathBuf| {
            let name: String = file_name(path).to_lowercase().chars().filter(char::is_ascii_alphanumeric).collect();
            path.is_dir() && CALIBRATION.iter().any(|known| name.starts_with(known))
        };
        let mut holding = Vec::new();
        for folder in list(session)?.iter().filter(is_named) {
            if TwoParts::of(folder).is_some() || !cameras(folder, false)?.is_empty() {
                holding.push(folder.clone());
            }
        }
        let [folder] = holding.as_slice() else { return Ok(None) };
        let (own, others): (Vec<_>, Vec<_>) = named_cameras(session, false)?
            .into_iter()
            .partition(|(_, input)| input.paths().any(|path| path.starts_with(folder)));
        // A single folder of one camera's pictures is that camera.
        let is_other = |(_, input): &(String, Input)| !matches!(input, Input::Images(_));
        if others.is_empty() && !own.is_empty() || !others.iter().all(is_other) {
            return Ok(None);
        }
        let names = others.iter().flat_map(|(_, input)| input.paths()).map(file_name);
        Ok(Some(Self { folder: folder.clone(), passed_over: names.collect() }))
    }
}

impl Input {
    /// The files.
    fn paths(&self) -> impl Iterator<Item = &Path> {
        let (images, file) = match self {
            Self::Images(images) => (images.as_slice(), None),
            Self::Video(path) | Self::Events(path) => (&[][..], Some(path)),
        };
        images.iter().map(|(_, path)| path).chain(file).map(PathBuf::as_path)
    }

    /// What is looked at, for the user: a file, or the folder of so many pictures.
    pub(super) fn source(&self) -> PathBuf {
        let first = self.paths().next().unwrap_or(Path::new(""));
        let images = matches!(self, Self::Images(_));
        if images { first.parent().unwrap_or(first).to_owned() } else { first.to_owned() }
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// What a folder holds, but for hidden files: others than these leave some that are called as pictures are.
pub(super) fn list(folder: &Path) -> Result<Vec<PathBuf>, BoardError> {
    let error = FileError::when("read the folder", folder);
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(&error)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<_, _>>()
        .map_err(error)?;
    entries.retain(|path| !file_name(path).starts_with('.'));
    entries.sort_by(|a, b| natural(&file_name(a), &file_name(b)));
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

/// The cameras of a folder, in the order of the numbers in their names. Tables beside videos are often no events; `with_tables` says
/// that events are looked for.
pub(super) fn cameras(folder: &Path, with_tables: bool) -> Result<Vec<(String, Input)>, BoardError> {
    let mut cameras: Vec<(String, Input)> = named_cameras(folder, with_tables)?.into_iter().collect();
    cameras.sort_by(|a, b| natural(&a.0, &b.0));
    Ok(cameras)
}

fn named_cameras(folder: &Path, with_tables: bool) -> Result<BTreeMap<String, Input>, BoardError> {
    let mut cameras = BTreeMap::new();
    let mut loose: BTreeMap<String, Vec<(String, PathBuf)>> = BTreeMap::new();
    for path in list(folder)? {
        if path.is_dir() {
            if let Some(input) = within(&path)? {
                cameras.insert(of_folder(&file_name(&path)).to_owned(), input);
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

/// Calls instants by the numbers in images' names where no two cameras have images that are called alike.
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
    let of_names = |(camera, own): &(&str, &mut Vec<(String, PathBuf)>)| -> Vec<Vec<String>> {
        own.iter().map(|(instant, _)| numbers(instant, camera)).collect()
    };
    let all: Vec<Vec<Vec<String>>> = images.iter().map(of_names).collect();
    let telling = telling(&all);
    for ((_, own), numbers) in images.iter_mut().zip(&all) {
        let numbers: Vec<String> = numbers.iter().map(|numbers| joined(numbers, &telling)).collect();
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

/// The places of the numbers, in the names of each camera, that are not the same in all names of a camera; none where names have
/// different counts of numbers.
fn telling(all: &[Vec<Vec<String>>]) -> Vec<usize> {
    let count = all.iter().flatten().map(Vec::len).max().unwrap_or(0);
    if all.iter().flatten().any(|numbers| numbers.len() != count) {
        return Vec::new();
    }
    let differs = |at: usize| all.iter().any(|own| own.iter().any(|numbers| numbers[at] != own[0][at]));
    (0..count).filter(|&at| differs(at)).collect()
}

/// The numbers at some places of a name joined by `-`; without any places its last one.
fn joined(numbers: &[String], places: &[usize]) -> String {
    match places {
        [] => numbers.last().cloned().unwrap_or_default(),
        places => places.iter().map(|&at| numbers[at].as_str()).collect::<Vec<_>>().join("-"),
    }
}

/// The numbers in a name, without zeros before them; that of the camera's own name does not count.
fn numbers(name: &str, camera: &str) -> Vec<String> {
    let own = name.strip_prefix(camera).or_else(|| name.strip_suffix(camera)).unwrap_or(name);
    let runs = own.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty());
    let short = |digits: &str| match digits.trim_start_matches('0') {
        "" => "0".to_owned(),
        short => short.to_owned(),
    };
    runs.map(short).collect()
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
        // Of numbers that are the same in all names of a camera nothing follows; seconds and milliseconds count together.
        let takes = ["left/l_2_0001_v2.png", "left/l_2_0012_v2.png", "right/r_3_0001_v1.png", "right/r_3_0012_v1.png"];
        assert_eq!(named(&takes), expected(&[("left", &["1", "12"]), ("right", &["1", "12"])]));
        let clocks = ["a/a_12-01-500.png", "a/a_12-02-500.png", "b/b_12-02-500.png", "b/b_12-03-500.png"];
        assert_eq!(named(&clocks), expected(&[("a", &["1", "2"]), ("b", &["2", "3"])]));
        let clocks = ["a/a_12-01-500.png", "a/a_12-02-250.png", "b/b_12-02-500.png", "b/b_12-02-250.png"];
        assert_eq!(named(&clocks), expected(&[("a", &["1-500", "2-250"]), ("b", &["2-250", "2-500"])]));
        let meet = ["a/x_7.png", "a/y_7.png", "b/z_7.png", "b/z_8.png"];
        assert_eq!(named(&meet), expected(&[("a", &["x_7", "y_7"]), ("b", &["7", "8"])]));
    }

    #[test]
    fn cameras_and_pictures_come_in_the_order_of_their_numbers_and_hidden_files_are_none() {
        let files =
            ["cam10/img_10.png", "cam10/img_9.png", "cam2/img_9.png", "cam2/img_10.png", "cam2/._img_9.png", ".x.png"];
        assert_eq!(named(&files), expected(&[("cam2", &["img_9", "img_10"]), ("cam10", &["img_9", "img_10"])]));
    }

    #[test]
    fn a_folder_of_calibration_pictures_is_found_among_a_sessions_videos() {
        let found = |files: &[&str]| {
            let folder = tempfile::tempdir().unwrap();
            for file in files {
                let path = folder.path().join(file);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, "").unwrap();
            }
            let found = CalibrationFolder::of(folder.path()).unwrap()?;
            let own: Vec<String> =
                cameras(&found.folder, false).unwrap().into_iter().map(|(camera, _)| camera).collect();
            Some((file_name(&found.folder), own, found.passed_over))
        };
        for name in ["calibration_images", "Calib", "calibration-videos", "Checkerboard", "charuco_pictures"] {
            let within = |file: &str| format!("{name}/{file}");
            let cameras = [within("cam1_01.jpg"), within("cam1_02.jpg"), within("cam2_01.jpg")];
            let mut files = vec!["mouse-cam1.mp4", "mouse-cam2.mp4", "notes.txt"];
            files.extend(cameras.iter().map(String::as_str));
            let (folder, own, passed_over) = found(&files).unwrap();
            assert_eq!((folder.as_str(), own.join(" ").as_str()), (name, "cam1 cam2"));
            assert_eq!(passed_over, ["mouse-cam1.mp4", "mouse-cam2.mp4"]);
        }
        let (folder, own, _) =
            found(&["a.mp4", "calibration_images/left/1.png", "calibration_images/right/1.png"]).unwrap();
        assert_eq!((folder.as_str(), own.join(" ").as_str()), ("calibration_images", "left right"));
        // Nothing to read beside it: its own folders are the cameras.
        assert!(found(&["calibration/left/1.png", "calibration/right/1.png", "notes.txt"]).is_some());
        // Cameras that are called so, and folders without pictures.
        assert_eq!(found(&["calib_left/1.png", "calib_right/1.png"]), None);
        assert_eq!(found(&["calib/1.png"]), None);
        assert_eq!(found(&["calib/1.png", "other/1.png"]), None);
        assert_eq!(found(&["a.mp4", "calibration/result.json"]), None);
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
