//! The steps that COLMAP is asked for, under the names that its versions give their flags.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use serde::Serialize;

use super::{
    Colmap, RunError,
    program::{Count, Program, Wanted, text},
};

/// What feature extraction needs to know.
#[derive(Clone, Debug, Serialize)]
pub struct Extraction {
    /// Database to make.
    pub database: PathBuf,
    /// Folder of the images, one subfolder per camera.
    pub images: PathBuf,
    /// File with the names, one a line.
    #[serde(skip)]
    pub list: PathBuf,
    /// Images below the folder.
    pub names: Vec<String>,
    /// Any plausible `fx,fy,cx,cy`; replaced in the database.
    pub camera_params: String,
    /// Threads; -1 = all.
    pub threads: i64,
    /// Side above which COLMAP would shrink an image.
    pub max_image_size: u32,
    /// SIFT's limit of features per image.
    pub max_features: u32,
    /// SIFT's threshold on the difference of Gaussians.
    pub peak_threshold: f64,
    /// SIFT's threshold on edge-like features.
    pub edge_threshold: f64,
}

/// What triangulation needs to know.
#[derive(Clone, Debug, Serialize)]
pub struct Triangulation {
    /// Database with features and matches.
    pub database: PathBuf,
    /// Folder of the images.
    pub images: PathBuf,
    /// Folder of the model with the poses.
    pub input: PathBuf,
    /// Existing folder for the model with the points.
    pub output: PathBuf,
    /// Threads; -1 = all.
    pub threads: i64,
    /// Greatest reprojection error, pixels.
    pub max_error_px: f64,
    /// Smallest angle between two rays of a point, degrees.
    pub min_ray_angle_deg: f64,
}

/// What the verification of matches needs to know.
#[derive(Clone, Debug, Serialize)]
pub struct Verification {
    /// Database with features and matches of all pairs.
    pub database: PathBuf,
    /// Threads; -1 = all.
    pub threads: i64,
    /// Seed of RANSAC.
    pub seed: u32,
}

/// What the mapper needs to know.
#[derive(Clone, Debug, Serialize)]
pub struct Mapping {
    /// Database with features and verified matches.
    pub database: PathBuf,
    /// Folder of the images.
    pub images: PathBuf,
    /// Existing folder for the models, one subfolder each.
    pub output: PathBuf,
    /// Threads; -1 = all.
    pub threads: i64,
    /// Seed of RANSAC.
    pub seed: u32,
    /// Whether focal lengths and distortion change.
    pub refine_intrinsics: bool,
}

impl Colmap {
    /// Extracts features into a fresh database.
    pub fn extract(&self, job: &Extraction, progress: Count<'_>) -> Result<(), RunError> {
        match &self.program {
            Program::Pycolmap(python) => self.python_step(
                "feature_extractor",
                (python, "extract"),
                job,
                &|| remove_database(&job.database),
                progress,
            ),
            Program::Binary(path) => {
                let wanted: [Wanted<'_>; _] = [
                    (&["log_to_stderr"], "1".into(), false),
                    (&["database_path"], job.database.clone().into(), true),
                    (&["image_path"], job.images.clone().into(), true),
                    (&["image_list_path"], job.list.clone().into(), true),
                    (&["ImageReader.camera_model"], "PINHOLE".into(), true),
                    (&["ImageReader.camera_params"], job.camera_params.clone().into(), true),
                    (&["ImageReader.single_camera_per_folder"], "1".into(), true),
                    (&["FeatureExtraction.use_gpu", "SiftExtraction.use_gpu"], "0".into(), true),
                    (&["FeatureExtraction.num_threads", "SiftExtraction.num_threads"], text(job.threads), false),
                    (
                        &["FeatureExtraction.max_image_size", "SiftExtraction.max_image_size"],
                        text(job.max_image_size),
                        true,
                    ),
                    (&["SiftExtraction.max_num_features"], text(job.max_features), true),
                    (&["SiftExtraction.peak_threshold"], text(job.peak_threshold), true),
                    (&["SiftExtraction.edge_threshold"], text(job.edge_threshold), true),
                ];
                self.binary_step("feature_extractor", path, &wanted, &|| remove_database(&job.database), progress)
            }
        }
    }

    /// Triangulates the matches, poses and intrinsics fixed.
    pub fn triangulate(&self, job: &Triangulation, progress: Count<'_>) -> Result<(), RunError> {
        match &self.program {
            Program::Pycolmap(python) => {
                self.python_step("point_triangulator", (python, "triangulate"), job, &|| Ok(()), progress)
            }
            Program::Binary(path) => {
                let wanted: [Wanted<'_>; _] = [
                    (&["log_to_stderr"], "1".into(), false),
                    (&["database_path"], job.database.clone().into(), true),
                    (&["image_path"], job.images.clone().into(), true),
                    (&["input_path"], job.input.clone().into(), true),
                    (&["output_path"], job.output.clone().into(), true),
                    (&["clear_points"], "1".into(), true),
                    (&["refine_intrinsics"], "0".into(), false),
                    (&["Mapper.extract_colors"], "0".into(), false),
                    (&["Mapper.num_threads"], text(job.threads), false),
                    (&["Mapper.ba_refine_focal_length"], "0".into(), false),
                    (&["Mapper.ba_refine_principal_point"], "0".into(), false),
                    (&["Mapper.ba_refine_extra_params"], "0".into(), false),
                    (&["Mapper.filter_max_reproj_error"], text(job.max_error_px), true),
                    (&["Mapper.filter_min_tri_angle"], text(job.min_ray_angle_deg), true),
                    (&["Mapper.tri_min_angle"], text(job.min_ray_angle_deg), true),
                ];
                self.binary_step("point_triangulator", path, &wanted, &|| Ok(()), progress)
            }
        }
    }

    /// Estimates the geometry of each pair from the matches in the database. Pairs whose matches are there are not matched
    /// again, by any version.
    pub fn verify(&self, job: &Verification, progress: Count<'_>) -> Result<(), RunError> {
        match &self.program {
            Program::Pycolmap(python) => {
                self.python_step("exhaustive_matcher", (python, "verify"), job, &|| Ok(()), progress)
            }
            Program::Binary(path) => {
                let wanted: [Wanted<'_>; _] = [
                    (&["log_to_stderr"], "1".into(), false),
                    (&["database_path"], job.database.clone().into(), true),
                    (&["FeatureMatching.use_gpu", "SiftMatching.use_gpu"], "0".into(), true),
                    (&["FeatureMatching.num_threads", "SiftMatching.num_threads"], text(job.threads), false),
                    (&["TwoViewGeometry.random_seed", "random_seed"], text(job.seed), false),
                ];
                self.binary_step("exhaustive_matcher", path, &wanted, &|| Ok(()), progress)
            }
        }
    }

    /// Builds models from the verified matches.
    pub fn map(&self, job: &Mapping, progress: Count<'_>) -> Result<(), RunError> {
        match &self.program {
            Program::Pycolmap(python) => {
                self.python_step("mapper", (python, "map"), job, &|| empty(&job.output), progress)
            }
            Program::Binary(path) => {
                let refine = if job.refine_intrinsics { "1" } else { "0" };
                let wanted: [Wanted<'_>; _] = [
                    (&["log_to_stderr"], "1".into(), false),
                    (&["database_path"], job.database.clone().into(), true),
                    (&["image_path"], job.images.clone().into(), true),
                    (&["output_path"], job.output.clone().into(), true),
                    (&["Mapper.extract_colors"], "0".into(), false),
                    (&["Mapper.num_threads"], text(job.threads), false),
                    (&["Mapper.ba_refine_focal_length"], refine.into(), true),
                    (&["Mapper.ba_refine_principal_point"], "0".into(), false),
                    (&["Mapper.ba_refine_extra_params"], refine.into(), true),
                    (&["Mapper.min_model_size"], "3".into(), false),
                    (&["Mapper.random_seed", "random_seed"], text(job.seed), false),
                ];
                self.binary_step("mapper", path, &wanted, &|| empty(&job.output), progress)
            }
        }
    }
}

/// Removes a database, with what SQLite keeps beside it, so that features are extracted anew.
fn remove_database(database: &Path) -> io::Result<()> {
    for end in ["", "-journal", "-wal", "-shm"] {
        let mut name = database.as_os_str().to_owned();
        name.push(end);
        match fs::remove_file(name) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

/// Removes the models of a mapper that was ended.
fn empty(folder: &Path) -> io::Result<()> {
    fs::remove_dir_all(folder)?;
    fs::create_dir(folder)
}
