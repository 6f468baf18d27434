//! Files of a dataset that is there already, replaced together with the manifest that tells of them.
//!
//! Two files cannot be replaced at once. Where the manifest names a file already, its successor is first put beside it under another
//! name, with a manifest that names that; then under its own name, with a manifest that names it again. Whenever this ends too soon, the
//! manifest tells of the file that it names.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic::Prepared};
use erfgs_scene::ply::PointCloud;

use super::{Bodies, BodiesFile, Dataset, DatasetError, Manifest, PointCloudFile, hashes::sha256_of};

/// What the name of a successor begins with while its predecessor is still named.
const NEXT: &str = "next-";

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
        let named = PointCloudFile::of(cloud, method, parameters);
        let bytes = cloud.encode().map_err(FileError::when("write point cloud", &self.root.join(&named.file)))?;
        let name = |manifest: &mut Manifest, file: PathBuf| {
            manifest.points = Some(PointCloudFile { file, ..named.clone() });
        };
        self.replace(&named.file, &bytes, name)?;
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
        let (named, text) = self.bodies_file(bodies, parameters)?;
        let name = |manifest: &mut Manifest, file: PathBuf| {
            manifest.bodies = Some(BodiesFile { file, ..named.clone() });
        };
        self.replace(Path::new(Bodies::FILE), &text, name)
    }

    /// Writes a file, and the manifest, in which `name` names it; nothing is seen before all is written.
    fn replace(
        &mut self,
        file: &Path,
        bytes: &[u8],
        name: impl Fn(&mut Manifest, PathBuf),
    ) -> Result<(), DatasetError> {
        let next = PathBuf::from(format!("{NEXT}{}", file.display()));
        let names: &[&Path] = if self.files().contains(file) { &[&next, file] } else { &[file] };
        let (place, manifest) = (self.root.join(file), self.root.join(Self::MANIFEST));
        // Errors name what the user knows.
        let (not_written, not_named) = (FileError::when("write", &place), FileError::when("write", &manifest));
        let mut steps = Vec::new();
        for &file in names {
            let mut after = Self::new(&self.root, self.manifest.clone());
            name(&mut after.manifest, file.to_owned());
            if !self.manifest.sha256.is_empty() {
                let files = after.files();
                after.manifest.sha256.retain(|file, _| files.contains(file));
                after.manifest.sha256.insert(file.to_owned(), sha256_of(bytes));
            }
            let bytes = Prepared::new(&self.root.join(file), bytes).map_err(&not_written)?;
            let text = Prepared::new(&manifest, &after.text()?).map_err(&not_named)?;
            steps.push((bytes, text, after.manifest));
        }
        let take = || -> Result<(), FileError> {
            for (bytes, text, after) in steps {
                bytes.finish().map_err(&not_written)?;
                text.finish().map_err(&not_named)?;
                self.manifest = after;
            }
            Ok(())
        };
        let taken = take();
        if !self.files().contains(&next) {
            let _ = std::fs::remove_file(self.root.join(&next));
        }
        Ok(taken?)
    }
}
