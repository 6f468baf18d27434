//! `metrics.json` and `per_view.json`: the evaluation.

use serde::{Deserialize, Serialize};

use crate::LpipsKind;

/// Where the masks of DPSNR came from. Values under different kinds of mask are different quantities.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskKind {
    /// The dataset brought them.
    Given,
    /// Made from the motion of the ground truth (see `erfgs_train::metrics::motion_masks`).
    Motion,
}

impl std::fmt::Display for MaskKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Given => "given",
            Self::Motion => "motion",
        })
    }
}

/// Means over the frames of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// How many frames.
    pub frames: u64,
    /// Mean over frames of the PSNR of each, dB; null without frames.
    pub psnr: Option<f64>,
    /// Mean over frames of the PSNR over moving pixels, dB; null where nothing moves.
    pub dpsnr: Option<f64>,
    /// The PSNR over the fast pixels of all of them together, dB; null where nothing is fast.
    #[serde(default)]
    pub psnr_fast: Option<f64>,
}

/// Figures after an affine map of the colours of each held-out camera, fitted on the pixels of it that stand still: what
/// no training camera can know of a camera's colour does not count against them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourCorrected {
    /// Mean over frames of the PSNR of each, dB.
    pub psnr: f64,
    /// Mean over frames of the PSNR over moving pixels, dB; null where nothing moves.
    pub dpsnr: Option<f64>,
    /// Mean over frames of the PSNR over pixels that stand still, dB; null where everything moves.
    pub psnr_static: Option<f64>,
}

/// What `metrics.json` holds: means over all frames of the held-out cameras.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Mean over frames of the PSNR of each, dB.
    pub psnr: f64,
    /// Mean over frames (with moving pixels) of the PSNR over moving pixels, dB; null where nothing moves.
    pub dpsnr: Option<f64>,
    /// The PSNR over the moving pixels of all frames together, dB.
    #[serde(default)]
    pub dpsnr_pooled: Option<f64>,
    /// Where the masks came from.
    pub dpsnr_mask: MaskKind,
    /// Mean over frames of the PSNR over pixels that stand still, dB; null where everything moves.
    #[serde(default)]
    pub psnr_static: Option<f64>,
    /// The PSNR over the fast pixels of all frames together, dB: the tenth of the moving ones that changes most from frame to frame
    /// (see `erfgs_train::metrics::Changes`); null where nothing is fast.
    #[serde(default)]
    pub psnr_fast: Option<f64>,
    /// Frames taken while a training frame was exposed.
    #[serde(default)]
    pub at_frames: Part,
    /// Frames taken between exposures.
    #[serde(default)]
    pub between_frames: Part,
    /// Frames taken before the first exposure or after the last.
    #[serde(default)]
    pub outside_frames: Part,
    /// The figures after each held-out camera's colours were matched.
    #[serde(default)]
    pub colour_corrected: Option<ColourCorrected>,
    /// Mean SSIM.
    pub ssim: f64,
    /// Mean LPIPS; null without weights.
    pub lpips: Option<f64>,
    /// Which LPIPS that is; null without weights.
    #[serde(default)]
    pub lpips_kind: Option<LpipsKind>,
    /// Mean PSNR of the training frames, dB.
    pub train_psnr: Option<f64>,
    /// Iterations over all stages.
    pub iterations: u64,
    /// Seconds of training, without evaluation.
    pub train_seconds: f64,
    /// CPU seconds of training over all threads, without evaluation; null where the system does not tell.
    #[serde(default)]
    pub train_cpu_seconds: Option<f64>,
    /// Gaussians.
    pub gaussians: u64,
    /// Bytes of the model (Gaussians and field, without optimiser state).
    pub bytes: u64,
    /// Frames rendered in a second at the size of the held-out frames.
    pub render_fps: f64,
}

/// One row of `per_view.json`: a held-out camera at one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PerView {
    /// Name of the camera.
    pub camera: String,
    /// Index of the frame in the camera's frames.
    pub index: u32,
    /// Time of the frame, nanoseconds on the session clock.
    pub t_ns: i64,
    /// PSNR, dB.
    pub psnr: f64,
    /// PSNR over moving pixels, dB; null where none moves.
    pub dpsnr: Option<f64>,
    /// SSIM.
    pub ssim: f64,
    /// LPIPS; null without weights.
    pub lpips: Option<f64>,
    /// How many pixels count as moving.
    #[serde(default)]
    pub moving_pixels: u64,
}
