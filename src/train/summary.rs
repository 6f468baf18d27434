//! What came of a training.

use std::path::Path;

use erfgs_run::{CameraPose, CameraTime, CurveRow, LeftOut, RunFolder};
use serde::Serialize;

use crate::{
    progress::duration,
    terminal::{table, thousands},
};

#[derive(Serialize)]
pub(super) struct Summary<'a> {
    pub(super) run: &'a Path,
    pub(super) finished: bool,
    pub(super) iterations: u64,
    pub(super) train_seconds: f64,
    pub(super) cpu_seconds: f64,
    pub(super) gaussians: u64,
    pub(super) dynamic: u64,
    pub(super) psnr: Option<f64>,
    pub(super) dpsnr: Option<f64>,
    pub(super) camera_poses: Vec<CameraPose>,
    pub(super) camera_times: Vec<CameraTime>,
    pub(super) left_out: Vec<LeftOut>,
}

impl<'a> Summary<'a> {
    /// What the curve of a finished run says.
    pub(super) fn of_finished(folder: &'a RunFolder) -> anyhow::Result<Self> {
        let rows = folder.read_curve()?.rows;
        let last = rows.last().cloned().unwrap_or_default();
        let look = |quality: fn(&CurveRow) -> Option<f64>| rows.iter().rev().find_map(quality);
        let info = folder.read_info()?;
        Ok(Self {
            run: folder.root(),
            finished: true,
            iterations: last.iteration,
            train_seconds: last.wall_seconds,
            cpu_seconds: last.cpu_seconds.unwrap_or_default(),
            gaussians: last.gaussians,
            dynamic: last.dynamic,
            psnr: look(|row| row.psnr),
            dpsnr: look(|row| row.dpsnr),
            camera_poses: info.camera_poses,
            camera_times: info.camera_times,
            left_out: info.left_out,
        })
    }
}

pub(super) fn describe(summary: &Summary<'_>) -> String {
    let mut rows = vec![
        ("run", summary.run.display().to_string()),
        ("iterations", thousands(summary.iterations)),
        ("time", format!("{}, {} of CPU time", duration(summary.train_seconds), duration(summary.cpu_seconds))),
        ("Gaussians", format!("{}, of which {} move", thousands(summary.gaussians), thousands(summary.dynamic))),
    ];
    for (name, value) in [("PSNR", summary.psnr), ("DPSNR", summary.dpsnr)] {
        rows.extend(value.map(|value| (name, format!("{value:.2} dB at the last evaluation"))));
    }
    let mut moved: Vec<&CameraPose> = summary.camera_poses.iter().collect();
    moved.sort_by(|a, b| a.moved_px.total_cmp(&b.moved_px));
    if let Some(most) = moved.last() {
        let (median, CameraPose { camera, moved_px, .. }) = (moved[moved.len() / 2].moved_px, most);
        let text = format!(
            "learned poses differ from the calibration by {median:.2} px in the median, by {moved_px:.2} px at most ({camera})"
        );
        rows.push(("cameras", text));
    }
    if let Some(CameraTime { camera, late_ms }) =
        summary.camera_times.iter().max_by(|a, b| a.late_ms.abs().total_cmp(&b.late_ms.abs()))
    {
        let late = if *late_ms < 0.0 { "earlier" } else { "later" };
        let text = format!(
            "{camera} recorded {:.1} ms {late} than its stamps say, the others are nearer to theirs",
            late_ms.abs()
        );
        rows.push(("clocks", text));
    }
    rows.extend(summary.left_out.iter().map(|left_out| ("left out", left_out.to_string())));
    table(&rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect::<Vec<_>>())
}
