//! Loading, saving, and the files that a manifest names.

use std::{
    collections::BTreeMap,
    ops::ControlFlow,
    path::{Component, Path, PathBuf},
};

use super::{Camera, Dataset, DatasetError, Frame, Manifest, PointCloudFile, PointRun};
use erfgs_base::{FileError, atomic::NewFolder, copy_file, plausible::POINT};
use erfgs_events::{Events, npz};
use erfgs_scene::{
    image::{ImageGrey8, ImageRgb8},
    ply::PointCloud,
};

impl Dataset {
    /// The name of the manifest in a dataset's folder.
    pub const MANIFEST: &str = "dataset.json";

    /// A dataset that is about to be written to `root`; call [`Dataset::save`] once its files are there.
    #[must_use]
    pub fn new(root: &Path, manifest: Manifest) -> Self {
        Self { root: root.to_owned(), manifest }
    }

    /// Reads the manifest of the dataset in the folder `path` (or of the `dataset.json` that `path` names) and
    /// validates it, so that every file that it names exists.
    ///
    /// # Errors
    /// If there is no manifest, it is malformed or of another version, or [`Dataset::validate`] refuses it.
    pub fn load(path: &Path) -> Result<Self, DatasetError> {
        let root = if path.is_file() { path.parent().unwrap_or(Path::new(".")) } else { path };
        let file = root.join(Self::MANIFEST);
        let text = erfgs_base::text::read(&file).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => DatasetError::NotADataset { path: root.to_owned() },
            _ => FileError::when("read", &file)(source).into(),
        })?;
        #[derive(serde::Deserialize)]
        struct Head {
            format: String,
            version: u32,
        }
        let json = |source| DatasetError::Json { path: file.clone(), source };
        let head: Head = serde_json::from_str(&text).map_err(json)?;
        if head.format != Manifest::FORMAT || head.version != Manifest::VERSION {
            return Err(DatasetError::Version { path: file, format: head.format, version: head.version });
        }
        let dataset = Self::new(root, serde_json::from_str(&text).map_err(json)?);
        dataset.validate()?;
        Ok(dataset)
    }

    /// Writes the manifest, making the folder where needed. The file is replaced in one step: a reader sees the old one
    /// or the new one.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self) -> Result<(), DatasetError> {
        let path = self.root.join(Self::MANIFEST);
        Ok(erfgs_base::atomic::write(&path, &self.text()?).map_err(FileError::when("write", &path))?)
    }

    /// What the manifest's file holds.
    pub(crate) fn text(&self) -> Result<Vec<u8>, DatasetError> {
        let json = |source| DatasetError::Json { path: self.root.join(Self::MANIFEST), source };
        let mut text = serde_json::to_vec_pretty(&self.manifest).map_err(json)?;
        text.push(b'\n');
        Ok(text)
    }

    /// Where a file that the manifest names lies on disk.
    ///
    /// # Errors
    /// If the path is absolute, empty, or climbs out of the folder.
    pub fn path(&self, file: &Path) -> Result<PathBuf, DatasetError> {
        let inside = file.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        if !inside || file.as_os_str().is_empty() {
            return Err(DatasetError::Outside { file: file.to_owned() });
        }
        Ok(self.root.join(file))
    }

    /// Reads a frame of a camera.
    ///
    /// # Errors
    /// If the file is missing, unreadable, or its size is not that of the camera's intrinsics.
    pub fn read_image(&self, camera: &Camera, frame: &Frame) -> Result<ImageRgb8, DatasetError> {
        let path = self.path(&frame.file)?;
        let image =
            ImageRgb8::read(&path).map_err(|source| DatasetError::Image { camera: camera.name.clone(), source })?;
        check_size(camera, &path, [image.width, image.height])?;
        Ok(image)
    }

    /// Reads the mask of moving pixels of a frame (255 = moving), where it has one.
    ///
    /// # Errors
    /// If the file is missing, unreadable, or its size is not that of the camera's intrinsics.
    pub fn read_mask(&self, camera: &Camera, frame: &Frame) -> Result<Option<ImageGrey8>, DatasetError> {
        let Some(file) = &frame.mask else { return Ok(None) };
        let path = self.path(file)?;
        let image =
            ImageGrey8::read(&path).map_err(|source| DatasetError::Image { camera: camera.name.clone(), source })?;
        check_size(camera, &path, [image.width, image.height])?;
        Ok(Some(image.binarised()))
    }

    /// Reads the events of a camera, where it has any.
    ///
    /// # Errors
    /// If the file is missing or malformed, or does not hold as many events as the manifest says.
    pub fn read_events(&self, camera: &Camera) -> Result<Option<Events>, DatasetError> {
        let Some(file) = &camera.events else { return Ok(None) };
        let path = self.path(&file.file)?;
        let size = [camera.intrinsics.width, camera.intrinsics.height];
        let events = npz::read_events(&path, Some(size))
            .map_err(|source| DatasetError::Events { camera: camera.name.clone(), source: Box::new(source) })?;
        if events.len() as u64 != file.count {
            let (found, named) = (events.len() as u64, file.count);
            return Err(DatasetError::EventCount { camera: camera.name.clone(), path, found, named });
        }
        Ok(Some(events))
    }

    /// Reads the events of a camera, where it has any, and hands them over piece by piece, in their order: they may be larger than
    /// memory. Says whether it has any.
    ///
    /// # Errors
    /// As [`Dataset::read_events`], after which what was handed over counts for nothing; and what `take` returns.
    pub fn read_event_pieces<E: From<DatasetError>>(
        &self,
        camera: &Camera,
        mut take: impl FnMut(&Events) -> Result<(), E>,
    ) -> Result<bool, E> {
        let Some(file) = &camera.events else { return Ok(false) };
        let path = self.path(&file.file)?;
        let size = [camera.intrinsics.width, camera.intrinsics.height];
        let (mut found, mut refused) = (0, None);
        let read = npz::read_pieces(&path, size, |events| {
            found += events.len() as u64;
            refused = take(events).err();
            if refused.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        read.map_err(|source| DatasetError::Events { camera: camera.name.clone(), source: Box::new(source) })?;
        if let Some(refused) = refused {
            return Err(refused);
        }
        if found != file.count {
            return Err(DatasetError::EventCount { camera: camera.name.clone(), path, found, named: file.count }.into());
        }
        Ok(true)
    }

    /// Reads the initial point cloud, where there is one.
    ///
    /// # Errors
    /// If the file is missing or malformed, or does not hold as many points as the manifest says.
    pub fn read_points(&self) -> Result<Option<PointCloud>, DatasetError> {
        let Some(file) = &self.manifest.points else { return Ok(None) };
        let path = self.path(&file.file)?;
        let cloud = PointCloud::read(&path).map_err(|source| DatasetError::Points { source: Box::new(source) })?;
        if cloud.len() as u64 != file.count {
            return Err(DatasetError::PointCount { path, found: cloud.len() as u64, named: file.count });
        }
        for (index, position) in cloud.positions.iter().enumerate() {
            let checked = POINT.check_all(position.map(f64::from));
            checked.map_err(|wrong| DatasetError::Point { path: path.clone(), index, wrong })?;
        }
        Ok(Some(cloud))
    }

    /// Puts a dataset that was written into `folder` in its place `out`: files hashed, manifest saved and validated.
    ///
    /// # Errors
    /// If a file cannot be read or written, or the manifest makes no sense.
    pub(crate) fn complete(mut self, folder: NewFolder, out: &Path) -> Result<Self, DatasetError> {
        self.hash_files()?;
        self.save()?;
        self.validate()?;
        folder.finish().map_err(FileError::when("write", out))?;
        self.root = out.to_owned();
        Ok(self)
    }

    /// Copies a file that the manifest names, making the folder of the copy where needed.
    pub(crate) fn copy_file(&self, file: &Path, to: &Path) -> Result<(), DatasetError> {
        Ok(copy_file(&self.path(file)?, to)?)
    }

    /// Writes the initial cloud into the folder and names it in the manifest, which is not saved yet.
    ///
    /// # Errors
    /// [`DatasetError::Points`] where the file cannot be written.
    pub fn set_points(
        &mut self,
        cloud: &PointCloud,
        method: &str,
        parameters: BTreeMap<String, serde_json::Value>,
    ) -> Result<PointCloudFile, DatasetError> {
        let named = PointCloudFile::of(cloud, method, parameters);
        cloud
            .write(&self.root.join(&named.file))
            .map_err(|source| DatasetError::Points { source: Box::new(source) })?;
        self.manifest.points = Some(named.clone());
        Ok(named)
    }

    /// Which instant each point of the initial cloud belongs to, where that is known.
    ///
    /// # Errors
    /// [`DatasetError::PointRuns`] where the manifest tells it in a way that cannot be.
    pub fn point_runs(&self) -> Result<Option<Vec<PointRun>>, DatasetError> {
        let Some(file) = &self.manifest.points else { return Ok(None) };
        file.runs().map_err(|reason| DatasetError::PointRuns { path: self.root.join(Self::MANIFEST), reason })
    }
}

pub(super) fn check_size(camera: &Camera, path: &Path, found: [u32; 2]) -> Result<(), DatasetError> {
    let named = [camera.intrinsics.width, camera.intrinsics.height];
    if found == named {
        return Ok(());
    }
    Err(DatasetError::ImageSize { camera: camera.name.clone(), path: path.to_owned(), found, named })
}
