//! The text form.
//!
//! ```text
//! cameras.txt    id MODEL width height parameters...
//! images.txt     id qw qx qy qz tx ty tz camera name
//!                x y point x y point ...                      (point -1 = none; the line may be empty)
//! points3D.txt   id x y z r g b error image keypoint image keypoint ...
//! ```
//! Lines that begin with `#` are comments. COLMAP states the number of items in one of them; where it stands, it is
//! compared with what follows, so that a file that was cut short between two lines is noticed.

use std::{
    collections::BTreeMap,
    fmt::{Display, Write},
    path::{Path, PathBuf},
    str::{FromStr, SplitAsciiWhitespace},
};

use erfgs_base::FileError;
use glam::DVec2;

use super::{CameraModel, ColmapCamera, ColmapError, ColmapImage, Model, Observation, Point2d, Point3d, REMEDY, pose};

/// The comments that COLMAP writes at the beginning of each file; the count follows the last.
const HEADERS: [&str; 3] = [
    "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\
     # Number of cameras: ",
    "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n\
     #   POINTS2D[] as (X, Y, POINT3D_ID)\n# Number of images: ",
    "# 3D point list with one line of data per point:\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, \
     TRACK[] as (IMAGE_ID, POINT2D_IDX)\n# Number of points: ",
];

/// A file: its path, its lines that are no comments with their numbers, and the count that its comments state.
struct File {
    path: PathBuf,
    text: String,
}

/// One line while it is taken apart.
struct Line<'a> {
    path: &'a Path,
    number: usize,
    words: SplitAsciiWhitespace<'a>,
}

impl Line<'_> {
    fn error(&self, what: impl Into<String>) -> ColmapError {
        malformed(self.path, self.number, what)
    }

    fn next<T: FromStr>(&mut self, what: &str) -> Result<T, ColmapError> {
        self.optional(what)?.ok_or_else(|| self.error(format!("{what} is missing: the line is cut short")))
    }

    fn optional<T: FromStr>(&mut self, what: &str) -> Result<Option<T>, ColmapError> {
        let Some(word) = self.words.next() else { return Ok(None) };
        word.parse().map(Some).map_err(|_| self.error(format!("{what} cannot be `{word}`")))
    }

    fn finite(&mut self, what: &str) -> Result<f64, ColmapError> {
        let value: f64 = self.next(what)?;
        if value.is_finite() { Ok(value) } else { Err(self.error(format!("{what} is not finite"))) }
    }

    fn finites<const N: usize>(&mut self, what: &str) -> Result<[f64; N], ColmapError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.finite(what)?;
        }
        Ok(values)
    }

    fn end(mut self) -> Result<(), ColmapError> {
        match self.words.next() {
            None => Ok(()),
            Some(word) => Err(self.error(format!("`{word}` follows the last value"))),
        }
    }
}

fn malformed(path: &Path, line: usize, what: impl Into<String>) -> ColmapError {
    ColmapError::Malformed { path: path.to_owned(), at: format!("line {line}"), what: what.into() }
}

impl File {
    fn open(folder: &Path, name: &str) -> Result<Self, ColmapError> {
        let path = folder.join(name);
        let text = erfgs_base::text::read(&path).map_err(FileError::when("read COLMAP model file", &path))?;
        Ok(Self { path, text })
    }

    /// All lines that are no comments, with their numbers from 1.
    fn lines(&self) -> impl Iterator<Item = Line<'_>> {
        let lines = self.text.lines().enumerate().filter(|(_, line)| !line.starts_with('#'));
        lines.map(|(index, line)| Line { path: &self.path, number: index + 1, words: line.split_ascii_whitespace() })
    }

    /// Refuses a file whose end is missing. `header` is what COLMAP begins the file with.
    fn check_end<I, T>(&self, items: &BTreeMap<I, T>, header: &str) -> Result<(), ColmapError> {
        let last = self.text.lines().count();
        let cut = |what: String| Err(malformed(&self.path, last, format!("the file is cut short: {what}")));
        let (first, count) = (header.lines().next(), header.lines().next_back().unwrap_or_default());
        // COLMAP ends every line; what others write may lack the last end.
        let is_colmaps = self.text.lines().next().is_some_and(|line| Some(line) == first);
        let ends_in_comment = self.text.lines().next_back().is_some_and(|line| line.starts_with('#'));
        if (is_colmaps || ends_in_comment) && !self.text.ends_with('\n') {
            return cut("its last line does not end".to_owned());
        }
        let stated = self.text.lines().find_map(|line| line.strip_prefix(count.trim_end()));
        let Some(stated) = stated else {
            return if is_colmaps { cut("its header is not whole".to_owned()) } else { Ok(()) };
        };
        let digits = stated.trim_start().split(|c: char| !c.is_ascii_digit()).next().unwrap_or_default();
        match digits.parse::<usize>() {
            Ok(stated) if stated != items.len() => cut(format!(
                "it states {stated} items and holds {} (if edited by hand, correct the comment)",
                items.len()
            )),
            _ => Ok(()),
        }
    }
}

/// Adds an item whose id must be new.
fn insert<I: Ord + Display, T>(items: &mut BTreeMap<I, T>, id: I, item: T, line: &Line) -> Result<(), ColmapError> {
    if items.contains_key(&id) {
        return Err(line.error(format!("the id {id} comes twice")));
    }
    items.insert(id, item);
    Ok(())
}

pub(super) fn read(folder: &Path) -> Result<Model, ColmapError> {
    Ok(Model { cameras: read_cameras(folder)?, images: read_images(folder)?, points: read_points(folder)? })
}

fn read_cameras(folder: &Path) -> Result<BTreeMap<u32, ColmapCamera>, ColmapError> {
    let (file, mut cameras) = (File::open(folder, "cameras.txt")?, BTreeMap::new());
    for mut line in file.lines() {
        let Some(id) = line.optional("the camera's id")? else { continue };
        let name: String = line.next("the camera's model")?;
        let Some(model) = CameraModel::from_name(&name) else {
            return Err(line.error(format!("camera {id} has the model {name}, which is not supported; {REMEDY}")));
        };
        let (width, height) = (line.next("the width")?, line.next("the height")?);
        let parameter = format!("a parameter of {name}");
        let parameters = (0..model.parameters()).map(|_| line.finite(&parameter)).collect::<Result<_, _>>()?;
        insert(&mut cameras, id, ColmapCamera { model, width, height, parameters }, &line)?;
        line.end()?;
    }
    file.check_end(&cameras, HEADERS[0])?;
    Ok(cameras)
}

fn read_images(folder: &Path) -> Result<BTreeMap<u32, ColmapImage>, ColmapError> {
    let (file, mut images) = (File::open(folder, "images.txt")?, BTreeMap::new());
    let mut lines = file.lines();
    while let Some(mut line) = lines.next() {
        let Some(id) = line.optional("the image's id")? else { continue };
        let (rotation, translation) = (line.finites("the rotation")?, line.finites("the translation")?);
        let camera = line.next("the camera's id")?;
        let name = line.words.by_ref().collect::<Vec<_>>().join(" ");
        if name.is_empty() {
            return Err(line.error("the name is missing: the line is cut short"));
        }
        let Some(pose) = pose(rotation, translation) else {
            return Err(line.error(format!("image {id} ({name}) has no valid rotation")));
        };
        let Some(mut keypoints) = lines.next() else {
            return Err(line.error(format!("image {id} ({name}) has no line of keypoints: the file is cut short")));
        };
        let mut points = Vec::new();
        while let Some(x) = keypoints.optional::<f64>("a keypoint")? {
            let (y, point): (f64, i64) = (keypoints.finite("a keypoint")?, keypoints.next("a point's id")?);
            if !x.is_finite() {
                return Err(keypoints.error("a keypoint is not finite"));
            }
            points.push(Point2d { position: DVec2::new(x, y), point3d: u64::try_from(point).ok() });
        }
        insert(&mut images, id, ColmapImage { pose, camera, name, points }, &line)?;
    }
    file.check_end(&images, HEADERS[1])?;
    Ok(images)
}

fn read_points(folder: &Path) -> Result<BTreeMap<u64, Point3d>, ColmapError> {
    let (file, mut points) = (File::open(folder, "points3D.txt")?, BTreeMap::new());
    for mut line in file.lines() {
        let Some(id) = line.optional("the point's id")? else { continue };
        let position = line.finites::<3>("a coordinate")?;
        let colour = [line.next("red")?, line.next("green")?, line.next("blue")?];
        let (error, mut track) = (line.finite("the error")?, Vec::new());
        while let Some(image) = line.optional("an image's id")? {
            track.push(Observation { image, point2d: line.next("a keypoint's index")? });
        }
        insert(&mut points, id, Point3d { position: position.into(), colour, error, track }, &line)?;
    }
    file.check_end(&points, HEADERS[2])?;
    Ok(points)
}

/// Appends words separated by spaces; writing to a `String` cannot fail.
fn words<T: Display>(text: &mut String, values: impl IntoIterator<Item = T>) {
    for value in values {
        let _ = write!(text, " {value}");
    }
}

fn mean(sum: usize, count: usize) -> f64 {
    if count == 0 { 0.0 } else { sum as f64 / count as f64 }
}

pub(super) fn cameras(model: &Model) -> Vec<u8> {
    let mut text = format!("{}{}\n", HEADERS[0], model.cameras.len());
    for (id, camera) in &model.cameras {
        let _ = write!(text, "{id} {} {} {}", camera.model.name(), camera.width, camera.height);
        words(&mut text, &camera.parameters);
        text.push('\n');
    }
    text.into_bytes()
}

pub(super) fn images(model: &Model) -> Vec<u8> {
    let seen = |image: &ColmapImage| image.points.iter().filter(|point| point.point3d.is_some()).count();
    let observations = mean(model.images.values().map(seen).sum(), model.images.len());
    let mut text = format!("{}{}, mean observations per image: {observations}\n", HEADERS[1], model.images.len());
    for (id, image) in &model.images {
        let (q, t) = (image.pose.rotation, image.pose.translation);
        let _ = write!(text, "{id}");
        words(&mut text, [q.w, q.x, q.y, q.z, t.x, t.y, t.z]);
        let _ = writeln!(text, " {} {}", image.camera, image.name);
        let point = |p: &Point2d| match p.point3d {
            Some(id) => format!("{} {} {id}", p.position.x, p.position.y),
            None => format!("{} {} -1", p.position.x, p.position.y),
        };
        text.push_str(&image.points.iter().map(point).collect::<Vec<_>>().join(" "));
        text.push('\n');
    }
    text.into_bytes()
}

pub(super) fn points(model: &Model) -> Vec<u8> {
    let track = mean(model.points.values().map(|point| point.track.len()).sum(), model.points.len());
    let mut text = format!("{}{}, mean track length: {track}\n", HEADERS[2], model.points.len());
    for (id, point) in &model.points {
        let _ = write!(text, "{id}");
        words(&mut text, point.position.to_array());
        words(&mut text, point.colour);
        words(&mut text, [point.error]);
        words(&mut text, point.track.iter().flat_map(|seen| [seen.image, seen.point2d]));
        text.push('\n');
    }
    text.into_bytes()
}
