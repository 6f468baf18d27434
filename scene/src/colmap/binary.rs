//! The binary form (little-endian).
//!
//! ```text
//! cameras.bin   u64 n; n x (u32 id, i32 model, u64 width, u64 height, f64 x parameters of the model)
//! images.bin    u64 n; n x (u32 id, f64 x 4 quaternion wxyz, f64 x 3 translation, u32 camera, name, NUL,
//!                           u64 m; m x (f64 x, f64 y, u64 point or 2^64 - 1))
//! points3D.bin  u64 n; n x (u64 id, f64 x 3 position, u8 x 3 colour, f64 error,
//!                           u64 m; m x (u32 image, u32 keypoint))
//! ```

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use glam::DVec2;

use crate::Pose;

use super::{CameraModel, ColmapCamera, ColmapError, ColmapImage, Model, Observation, Point2d, Point3d, REMEDY, pose};

const NONE: u64 = u64::MAX;

/// A file and how far it has been read.
struct Reader {
    path: PathBuf,
    bytes: Vec<u8>,
    at: usize,
}

impl Reader {
    fn open(folder: &Path, name: &str) -> Result<Self, ColmapError> {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).map_err(FileError::when("read COLMAP model file", &path))?;
        Ok(Self { path, bytes, at: 0 })
    }

    fn error(&self, what: impl Into<String>) -> ColmapError {
        ColmapError::Malformed { path: self.path.clone(), at: format!("byte {}", self.at), what: what.into() }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], ColmapError> {
        match self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>()) {
            Some(&chunk) => {
                self.at += N;
                Ok(chunk)
            }
            None => Err(self.error("the file is cut short")),
        }
    }

    fn u32(&mut self) -> Result<u32, ColmapError> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, ColmapError> {
        self.take().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, ColmapError> {
        let value = f64::from_le_bytes(self.take()?);
        if value.is_finite() { Ok(value) } else { Err(self.error(format!("the number {value} is not finite"))) }
    }

    fn f64s<const N: usize>(&mut self) -> Result<[f64; N], ColmapError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// A count of items of at least `size` bytes, which must fit into the rest of the file.
    fn count(&mut self, size: usize) -> Result<usize, ColmapError> {
        let count = self.u64()?;
        let rest = self.bytes.len().saturating_sub(self.at);
        match usize::try_from(count).ok().filter(|count| count.checked_mul(size).is_some_and(|needed| needed <= rest)) {
            Some(count) => Ok(count),
            None => Err(self.error(format!("the file is cut short: {count} items do not fit into {rest} bytes"))),
        }
    }

    fn name(&mut self) -> Result<String, ColmapError> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let Some(length) = rest.iter().position(|&byte| byte == 0) else {
            return Err(self.error("the file is cut short in a name"));
        };
        match std::str::from_utf8(&rest[..length]) {
            Ok(name) => {
                let name = name.to_owned();
                self.at += length + 1;
                Ok(name)
            }
            Err(_) => Err(self.error("a name is not UTF-8")),
        }
    }

    /// Reads all items of a file, which must end after the last one; no id may come twice.
    fn items<I: Ord + std::fmt::Display, T>(
        mut self,
        size: usize,
        read: impl Fn(&mut Self) -> Result<(I, T), ColmapError>,
    ) -> Result<BTreeMap<I, T>, ColmapError> {
        let mut items = BTreeMap::new();
        for _ in 0..self.count(size)? {
            let (id, item) = read(&mut self)?;
            if items.contains_key(&id) {
                return Err(self.error(format!("the id {id} comes twice")));
            }
            items.insert(id, item);
        }
        if self.at < self.bytes.len() {
            return Err(self.error(format!("{} bytes follow the last item", self.bytes.len() - self.at)));
        }
        Ok(items)
    }
}

pub(super) fn read(folder: &Path) -> Result<Model, ColmapError> {
    let cameras = Reader::open(folder, "cameras.bin")?.items(24, |file| {
        let (id, number) = (file.u32()?, file.take().map(i32::from_le_bytes)?);
        let Some(model) = CameraModel::from_id(number) else {
            return Err(file.error(format!("camera {id} has the model {number}, which is not supported; {REMEDY}")));
        };
        let (width, height) = (file.u64()?, file.u64()?);
        let parameters = (0..model.parameters()).map(|_| file.f64()).collect::<Result<_, _>>()?;
        Ok((id, ColmapCamera { model, width, height, parameters }))
    })?;
    let images = Reader::open(folder, "images.bin")?.items(73, |file| {
        let (id, rotation, translation, camera) = (file.u32()?, file.f64s()?, file.f64s()?, file.u32()?);
        let name = file.name()?;
        let pose = pose(rotation, translation)
            .ok_or_else(|| file.error(format!("image {id} ({name}) has no valid rotation")))?;
        let keypoint = |file: &mut Reader| {
            let [x, y] = file.f64s()?;
            Ok(Point2d { position: DVec2::new(x, y), point3d: Some(file.u64()?).filter(|&point| point != NONE) })
        };
        let points = (0..file.count(24)?).map(|_| keypoint(file)).collect::<Result<_, ColmapError>>()?;
        Ok((id, ColmapImage { pose, camera, name, points }))
    })?;
    let points = Reader::open(folder, "points3D.bin")?.items(51, |file| {
        let (id, position, colour, error) = (file.u64()?, file.f64s::<3>()?, file.take()?, file.f64()?);
        let seen = |file: &mut Reader| Ok(Observation { image: file.u32()?, point2d: file.u32()? });
        let track = (0..file.count(8)?).map(|_| seen(file)).collect::<Result<_, ColmapError>>()?;
        Ok((id, Point3d { position: position.into(), colour, error, track }))
    })?;
    Ok(Model { cameras, images, points })
}

fn push(bytes: &mut Vec<u8>, values: &[f64]) {
    values.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
}

/// A pose: its quaternion w, x, y, z and its translation.
pub(super) fn push_pose(bytes: &mut Vec<u8>, pose: &Pose) {
    let q = pose.rotation;
    push(bytes, &[q.w, q.x, q.y, q.z]);
    push(bytes, &pose.translation.to_array());
}

pub(super) fn counted(count: usize) -> Vec<u8> {
    (count as u64).to_le_bytes().to_vec()
}

pub(super) fn cameras(model: &Model) -> Vec<u8> {
    let mut bytes = counted(model.cameras.len());
    for (id, camera) in &model.cameras {
        bytes.extend_from_slice(&id.to_le_bytes());
        bytes.extend_from_slice(&camera.model.id().to_le_bytes());
        bytes.extend_from_slice(&camera.width.to_le_bytes());
        bytes.extend_from_slice(&camera.height.to_le_bytes());
        push(&mut bytes, &camera.parameters);
    }
    bytes
}

pub(super) fn images(model: &Model) -> Vec<u8> {
    let mut bytes = counted(model.images.len());
    for (id, image) in &model.images {
        bytes.extend_from_slice(&id.to_le_bytes());
        push_pose(&mut bytes, &image.pose);
        bytes.extend_from_slice(&image.camera.to_le_bytes());
        bytes.extend_from_slice(image.name.as_bytes());
        bytes.push(0);
        bytes.extend_from_slice(&(image.points.len() as u64).to_le_bytes());
        for point in &image.points {
            push(&mut bytes, &point.position.to_array());
            bytes.extend_from_slice(&point.point3d.unwrap_or(NONE).to_le_bytes());
        }
    }
    bytes
}

pub(super) fn points(model: &Model) -> Vec<u8> {
    let mut bytes = counted(model.points.len());
    for (id, point) in &model.points {
        bytes.extend_from_slice(&id.to_le_bytes());
        push(&mut bytes, &point.position.to_array());
        bytes.extend_from_slice(&point.colour);
        push(&mut bytes, &[point.error]);
        bytes.extend_from_slice(&(point.track.len() as u64).to_le_bytes());
        for seen in &point.track {
            bytes.extend_from_slice(&seen.image.to_le_bytes());
            bytes.extend_from_slice(&seen.point2d.to_le_bytes());
        }
    }
    bytes
}
