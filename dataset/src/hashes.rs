//! The files that a manifest names, and their hashes.

use std::{
    collections::BTreeSet,
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::{Dataset, DatasetError};

impl Dataset {
    /// Every file that the manifest names, relative to the folder: frames, masks, events, points, bodies.
    #[must_use]
    pub fn files(&self) -> BTreeSet<PathBuf> {
        let mut files: BTreeSet<PathBuf> = self.manifest.points.iter().map(|points| points.file.clone()).collect();
        files.extend(self.manifest.bodies.iter().map(|bodies| bodies.file.clone()));
        for camera in &self.manifest.cameras {
            files.extend(camera.frames.iter().map(|frame| frame.file.clone()));
            files.extend(camera.frames.iter().filter_map(|frame| frame.mask.clone()));
            files.extend(camera.events.iter().map(|events| events.file.clone()));
        }
        files
    }

    /// Computes the SHA-256 of every file that the manifest names into [`super::Manifest::sha256`], replacing what is
    /// there. Call it before [`Dataset::save`].
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn hash_files(&mut self) -> Result<(), DatasetError> {
        self.manifest.sha256 = self.hashes()?.into_iter().collect();
        Ok(())
    }

    /// Recomputes the hashes and compares them with those of the manifest.
    ///
    /// # Errors
    /// The first file that is missing, has changed, or has no hash.
    pub fn verify(&self) -> Result<(), DatasetError> {
        for (file, hash) in self.hashes()? {
            match self.manifest.sha256.get(&file) {
                None => return Err(DatasetError::NoHash { path: self.root.join(file) }),
                Some(stored) if *stored != hash => return Err(DatasetError::Changed { path: self.root.join(file) }),
                Some(_) => {}
            }
        }
        Ok(())
    }

    /// SHA-256 (hexadecimal) of the manifest, which holds the hash of every file: equal datasets have equal ones,
    /// wherever they lie.
    #[must_use]
    pub fn sha256(&self) -> String {
        // A manifest always serialises: its keys are strings and its numbers finite.
        hexadecimal(&Sha256::digest(serde_json::to_vec(&self.manifest).unwrap_or_default()))
    }

    fn hashes(&self) -> Result<Vec<(PathBuf, String)>, DatasetError> {
        let files: Vec<PathBuf> = self.files().into_iter().collect();
        let hashes: Vec<_> = files.par_iter().map(|file| sha256(&self.path(file)?)).collect();
        // The first error in the order of the files, whatever thread met one first.
        files.into_iter().zip(hashes).map(|(file, hash)| Ok((file, hash?))).collect()
    }
}

fn sha256(path: &Path) -> Result<String, DatasetError> {
    let io = FileError::when("read", path);
    let (mut file, mut hasher, mut buffer) = (File::open(path).map_err(&io)?, Sha256::new(), vec![0; 1 << 16]);
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(hexadecimal(&hasher.finalize())),
            Ok(length) => hasher.update(&buffer[..length]),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(io(error).into()),
        }
    }
}

/// Of what a file holds.
pub(crate) fn sha256_of(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
