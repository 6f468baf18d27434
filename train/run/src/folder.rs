//! Where everything lies in a run folder.

use std::path::{Path, PathBuf};

use erfgs_dataset::Manifest;

use super::{Curve, CurveWriter, Metrics, PerView, RunError, RunInfo, json};

/// What to do about a damaged `run.json`.
const ANEW: &str = "remove it, and `erfgs train --resume` writes it anew from checkpoint.bin";

/// A run folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    root: PathBuf,
}

impl RunFolder {
    /// Digits of the number that is the name of a point cloud at a time.
    pub const POINT_CLOUD_DIGITS: usize = 5;

    /// The run folder at `root`, which need not exist yet.
    #[must_use]
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The existing run folder at `root`.
    ///
    /// # Errors
    /// [`RunError::NotARun`] where there is no `run.json`.
    pub fn open(root: impl Into<PathBuf>) -> Result<Self, RunError> {
        let folder = Self::new(root);
        if folder.info_file().is_file() { Ok(folder) } else { Err(RunError::NotARun { folder: folder.root }) }
    }

    /// The folder itself.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The last component of the folder's path, for tables and legends.
    #[must_use]
    pub fn name(&self) -> String {
        let absolute = std::path::absolute(&self.root).unwrap_or_else(|_| self.root.clone());
        absolute.file_name().map_or_else(|| self.root.display().to_string(), |name| name.to_string_lossy().into_owned())
    }

    /// `run.json`.
    #[must_use]
    pub fn info_file(&self) -> PathBuf {
        self.root.join("run.json")
    }

    /// `config.toml`: the effective configuration.
    #[must_use]
    pub fn config_file(&self) -> PathBuf {
        self.root.join("config.toml")
    }

    /// `dataset.json`: a copy of the dataset's manifest.
    #[must_use]
    pub fn dataset_file(&self) -> PathBuf {
        self.root.join("dataset.json")
    }

    /// `curve.csv`.
    #[must_use]
    pub fn curve_file(&self) -> PathBuf {
        self.root.join("curve.csv")
    }

    /// `metrics.json`.
    #[must_use]
    pub fn metrics_file(&self) -> PathBuf {
        self.root.join("metrics.json")
    }

    /// `per_view.json`.
    #[must_use]
    pub fn per_view_file(&self) -> PathBuf {
        self.root.join("per_view.json")
    }

    /// `checkpoint.bin`.
    #[must_use]
    pub fn checkpoint_file(&self) -> PathBuf {
        self.root.join("checkpoint.bin")
    }

    /// `point_cloud.ply`: the canonical Gaussians.
    #[must_use]
    pub fn point_cloud_file(&self) -> PathBuf {
        self.root.join("point_cloud.ply")
    }

    /// `point_cloud_t`: the folder of the Gaussians deformed to times.
    #[must_use]
    pub fn point_clouds_at_folder(&self) -> PathBuf {
        self.root.join("point_cloud_t")
    }

    /// `<index>.ply` in that folder: the Gaussians deformed to one time.
    #[must_use]
    pub fn point_cloud_at_name(index: u32) -> String {
        format!("{index:0digits$}.ply", digits = Self::POINT_CLOUD_DIGITS)
    }

    /// The rendered picture of a held-out frame.
    ///
    /// # Errors
    /// [`RunError::CameraName`].
    pub fn render_file(&self, camera: &str, index: u32) -> Result<PathBuf, RunError> {
        self.picture("renders", camera, index, "")
    }

    /// The ground truth of a held-out frame.
    ///
    /// # Errors
    /// [`RunError::CameraName`].
    pub fn truth_file(&self, camera: &str, index: u32) -> Result<PathBuf, RunError> {
        self.picture("truth", camera, index, "")
    }

    /// The pixels of a held-out frame that count for DPSNR (white).
    ///
    /// # Errors
    /// [`RunError::CameraName`].
    pub fn mask_file(&self, camera: &str, index: u32) -> Result<PathBuf, RunError> {
        self.picture("masks", camera, index, "")
    }

    /// The event frame that a camera measured; `index` is the time bin at which it begins.
    ///
    /// # Errors
    /// [`RunError::CameraName`].
    pub fn measured_events_file(&self, camera: &str, index: u32) -> Result<PathBuf, RunError> {
        self.picture("events", camera, index, "-measured")
    }

    /// The event frame that the model predicts for the same camera and bin.
    ///
    /// # Errors
    /// [`RunError::CameraName`].
    pub fn rendered_events_file(&self, camera: &str, index: u32) -> Result<PathBuf, RunError> {
        self.picture("events", camera, index, "-rendered")
    }

    fn picture(&self, folder: &str, camera: &str, index: u32, suffix: &str) -> Result<PathBuf, RunError> {
        // Names come from files: one that climbs out of the folder must not become a path.
        let plain = !camera.is_empty()
            && !camera.starts_with('.')
            && !camera.chars().any(|c| matches!(c, '/' | '\\' | ':') || c.is_control());
        if !plain {
            return Err(RunError::CameraName { name: camera.into() });
        }
        Ok(self.root.join(folder).join(camera).join(format!("{index:05}{suffix}.png")))
    }

    /// Writes `run.json`.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn write_info(&self, info: &RunInfo) -> Result<(), RunError> {
        json::write_json(&self.info_file(), "run description", info)
    }

    /// Notes in `run.json` that the training is over and everything that it writes is there.
    ///
    /// # Errors
    /// Those of [`Self::read_info`] and [`Self::write_info`].
    pub fn finish(&self) -> Result<(), RunError> {
        self.write_info(&RunInfo { finished: true, ..self.read_info()? })
    }

    /// Reads `run.json`.
    ///
    /// # Errors
    /// [`RunError::Missing`], [`RunError::File`], [`RunError::Malformed`], [`RunError::Version`].
    pub fn read_info(&self) -> Result<RunInfo, RunError> {
        let path = self.info_file();
        let info: RunInfo =
            json::read_json(&path, "run description", "give a folder that `erfgs train --out` wrote", ANEW)?;
        if info.format != RunInfo::FORMAT {
            return Err(RunError::Malformed {
                path,
                what: "run description",
                message: format!("its format is '{}', not '{}'", info.format, RunInfo::FORMAT),
                remedy: ANEW,
            });
        }
        if info.format_version > RunInfo::FORMAT_VERSION {
            return Err(RunError::Version { path, found: info.format_version, known: RunInfo::FORMAT_VERSION });
        }
        Ok(info)
    }

    /// Writes the effective configuration.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn write_config(&self, toml: &str) -> Result<(), RunError> {
        json::write_atomically(&self.config_file(), toml.as_bytes())
    }

    /// Reads the effective configuration.
    ///
    /// # Errors
    /// [`RunError::Missing`], [`RunError::File`], [`RunError::Malformed`].
    pub fn read_config(&self) -> Result<toml::Table, RunError> {
        let path = self.config_file();
        let text = json::read_text(&path, "the run has not begun to train; start it with `erfgs train`")?;
        text.parse().map_err(|error: toml::de::Error| RunError::Malformed {
            path,
            what: "configuration",
            message: error.to_string(),
            remedy: "`erfgs train --resume` writes it anew",
        })
    }

    /// Writes the copy of the dataset's manifest.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn write_dataset(&self, manifest: &Manifest) -> Result<(), RunError> {
        json::write_json(&self.dataset_file(), "dataset manifest", manifest)
    }

    /// Reads the copy of the dataset's manifest.
    ///
    /// # Errors
    /// [`RunError::Missing`], [`RunError::File`], [`RunError::Malformed`].
    pub fn read_dataset(&self) -> Result<Manifest, RunError> {
        json::read_json(
            &self.dataset_file(),
            "dataset manifest",
            "copy dataset.json of the dataset here",
            "copy dataset.json of the dataset here",
        )
    }

    /// Starts `curve.csv`.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn create_curve(&self) -> Result<CurveWriter, RunError> {
        CurveWriter::create(&self.curve_file())
    }

    /// Continues `curve.csv` after `iteration` iterations (see [`CurveWriter::resume`]).
    ///
    /// # Errors
    /// Those of [`CurveWriter::resume`].
    pub fn resume_curve(&self, iteration: u64) -> Result<CurveWriter, RunError> {
        CurveWriter::resume(&self.curve_file(), iteration)
    }

    /// Reads `curve.csv`.
    ///
    /// # Errors
    /// Those of [`Curve::read`].
    pub fn read_curve(&self) -> Result<Curve, RunError> {
        Curve::read(&self.curve_file())
    }

    /// Writes `metrics.json`.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn write_metrics(&self, metrics: &Metrics) -> Result<(), RunError> {
        json::write_json(&self.metrics_file(), "evaluation", metrics)
    }

    /// Reads `metrics.json`.
    ///
    /// # Errors
    /// [`RunError::Missing`], [`RunError::File`], [`RunError::Malformed`].
    pub fn read_metrics(&self) -> Result<Metrics, RunError> {
        json::read_json(
            &self.metrics_file(),
            "evaluation",
            "evaluate the run with `erfgs eval`",
            "`erfgs eval` writes it anew",
        )
    }

    /// Writes `per_view.json`.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn write_per_view(&self, views: &[PerView]) -> Result<(), RunError> {
        json::write_json(&self.per_view_file(), "list of views", &views)
    }

    /// Reads `per_view.json`.
    ///
    /// # Errors
    /// [`RunError::Missing`], [`RunError::File`], [`RunError::Malformed`].
    pub fn read_per_view(&self) -> Result<Vec<PerView>, RunError> {
        json::read_json(
            &self.per_view_file(),
            "list of views",
            "evaluate the run with `erfgs eval`",
            "`erfgs eval` writes it anew",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LeftOut, MaskKind, Part};
    use crate::{LpipsKind, LpipsNet, LpipsScaling};

    #[test]
    fn what_is_written_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path().join("run"));
        let info = RunInfo {
            method: "erf-gs".into(),
            preset: "paper".into(),
            seed: u64::MAX,
            left_out: vec![LeftOut { what: "sh head".into(), why: "degree 0".into(), saves: "11 % of time".into() }],
            ..RunInfo::default()
        };
        run.write_info(&info).unwrap();
        assert_eq!(RunFolder::open(run.root()).unwrap().read_info().unwrap(), info);

        let metrics = Metrics {
            psnr: 26.123_456_789_012_345,
            dpsnr: None,
            dpsnr_pooled: Some(1.0 / 3.0),
            dpsnr_mask: MaskKind::Motion,
            psnr_static: Some(25.0),
            psnr_fast: Some(15.0),
            at_frames: Part { frames: 3, psnr: Some(24.0), dpsnr: None, psnr_fast: Some(16.0) },
            between_frames: Part::default(),
            outside_frames: Part::default(),
            colour_corrected: None,
            ssim: 0.9,
            lpips: Some(0.1),
            lpips_kind: Some(LpipsKind { net: LpipsNet::Vgg16, scaling: LpipsScaling::ZeroToOne }),
            train_psnr: Some(30.0),
            iterations: 17_000,
            train_seconds: 1.5,
            train_cpu_seconds: Some(2.5),
            gaussians: 40_000,
            bytes: 1 << 33,
            render_fps: 42.0,
        };
        run.write_metrics(&metrics).unwrap();
        assert_eq!(run.read_metrics().unwrap(), metrics);

        let views = vec![PerView {
            camera: "cam00".into(),
            index: 3,
            t_ns: -5,
            psnr: 20.0,
            dpsnr: Some(18.0),
            ssim: 0.8,
            lpips: None,
            moving_pixels: 12,
        }];
        run.write_per_view(&views).unwrap();
        assert_eq!(run.read_per_view().unwrap(), views);

        run.write_config("seed = 1\n").unwrap();
        assert_eq!(run.read_config().unwrap()["seed"].as_integer(), Some(1));
    }

    #[test]
    fn lpips_is_null_in_the_file_where_there_are_no_weights() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path());
        let text = r#"{"psnr": 20.0, "dpsnr": 18.0, "dpsnr_mask": "given", "ssim": 0.8, "lpips": null, "train_psnr": 25.0,
            "iterations": 100, "train_seconds": 3.0, "gaussians": 10, "bytes": 560, "render_fps": 30.0}"#;
        std::fs::write(run.metrics_file(), text).unwrap();
        let metrics = run.read_metrics().unwrap();
        assert_eq!((metrics.lpips, metrics.dpsnr_mask), (None, MaskKind::Given));
        run.write_metrics(&metrics).unwrap();
        let value: serde_json::Value = serde_json::from_slice(&std::fs::read(run.metrics_file()).unwrap()).unwrap();
        assert!(value["lpips"].is_null() && value.get("lpips").is_some());
    }

    #[test]
    fn a_folder_without_a_run_is_named_in_the_error() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("nowhere");
        let message = RunFolder::open(&missing).unwrap_err().to_string();
        assert!(message.contains("nowhere") && message.contains("erfgs train"), "{message}");
        let message = RunFolder::new(&missing).read_metrics().unwrap_err().to_string();
        assert!(message.contains("metrics.json") && message.contains("erfgs eval"), "{message}");
    }

    #[test]
    fn a_newer_format_and_a_foreign_file_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path());
        run.write_info(&RunInfo { format_version: 2, ..RunInfo::default() }).unwrap();
        assert!(matches!(run.read_info(), Err(RunError::Version { found: 2, .. })));
        run.write_info(&RunInfo { format: "something".into(), ..RunInfo::default() }).unwrap();
        assert!(matches!(run.read_info(), Err(RunError::Malformed { .. })));
    }

    #[test]
    fn a_camera_name_cannot_leave_the_folder() {
        let run = RunFolder::new("run");
        for name in ["../x", "a/b", "..", "", "c:x", "a\\b", "a\nb"] {
            assert!(matches!(run.render_file(name, 0), Err(RunError::CameraName { .. })), "{name:?}");
        }
        assert_eq!(run.truth_file("cam 07", 12).unwrap(), Path::new("run/truth/cam 07/00012.png"));
    }
}
