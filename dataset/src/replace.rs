//! Files of a dataset that is there already, replaced together with the manifest that tells of them.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic::Prepared};
use erfgs_scene::ply::PointCloud;

use super::{Bodies, Dataset, DatasetError, PointCloudFile, hashes::sha256_of, layout};

impl Dataset {
    /// Writes the initial cloud and the manifest that names it: both, or neither. Hashes of other files stay.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn replace_points(
        &mut self,
        cloud: &PointCloud,
        method: &str,
        parameters: BTreeMap<String, serde_json::Value>,
    ) -> Result<PointCloudFile, DatasetError> {
        let file = PathBuf::from(layout::POINTS);
        let bytes = cloud.encode().map_err(FileError::when("write point cloud", &self.root.join(&file)))?;
        let named =
            PointCloudFile { file: file.clone(), count: cloud.len() as u64, method: method.to_owned(), parameters };
        self.manifest.points = Some(named.clone());
        self.replace(&file, &bytes)?;
        Ok(named)
    }

    /// Writes bodies and the manifest that names them: both, or neither. Hashes of other files stay.
    ///
    /// # Errors
    /// If they make no sense, or a file cannot be written.
    pub fn replace_bodies(
        &mut self,
        bodies: &Bodies,
        parameters: BTreeMap<String, serde_json::Value>,
    ) -> Result<(), DatasetError> {
        let text = self.name_bodies(bodies, parameters)?;
        self.replace(Path::new(Bodies::FILE), &text)
    }

    /// Writes a file that the manifest names, and the manifest; neither is seen before both are written.
    fn replace(&mut self, file: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
        if !self.manifest.sha256.is_empty() {
            let files = self.files();
            self.manifest.sha256.retain(|file, _| files.contains(file));
            self.manifest.sha256.insert(file.to_owned(), sha256_of(bytes));
        }
        let prepare = |path: &Path, bytes: &[u8]| Prepared::new(path, bytes).map_err(FileError::when("write", path));
        let (path, manifest) = (self.root.join(file), self.root.join(Self::MANIFEST));
        let prepared = [(&path, prepare(&path, bytes)?), (&manifest, prepare(&manifest, &self.text()?)?)];
        for (path, prepared) in prepared {
            prepared.finish().map_err(FileError::when("write", path))?;
        }
        Ok(())
    }
}
