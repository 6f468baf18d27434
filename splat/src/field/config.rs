//! What a field looks like, and what can go wrong with it.

use serde::{Deserialize, Serialize};

use crate::gpu::GpuError;

/// Which attributes the field deforms. A head that is off costs nothing and its deltas are zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Heads {
    /// Mean (3 values).
    pub position: bool,
    /// Log-scale (3 values).
    pub scale: bool,
    /// Quaternion (4 values).
    pub rotation: bool,
    /// Opacity logit (1 value).
    pub opacity: bool,
    /// Spherical harmonics (3 values a coefficient).
    pub sh: bool,
}

impl Default for Heads {
    /// All heads, as 4DGS has them on Neu3D.
    fn default() -> Self {
        Self { position: true, scale: true, rotation: true, opacity: true, sh: true }
    }
}

/// How the time in [0, 1] maps to the rows of the time planes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeAxis {
    /// [0, 1] falls on the upper half of the rows, as in 4DGS, which hands it to a sampler whose range is [-1, 1].
    #[default]
    UpperHalf,
    /// [0, 1] spans all rows.
    Full,
}

/// How the last layer of every head starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadInit {
    /// Xavier-uniform weights and small random biases as in 4DGS: training starts from a random deformation.
    #[default]
    Xavier,
    /// Zero weights and biases: training starts from no deformation.
    ZeroLast,
}

/// The shape of the HexPlane field and its MLP. The defaults are those of 4DGS on Neu3D.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FieldConfig {
    /// Multipliers of the spatial resolution, one a level.
    pub levels: Vec<u32>,
    /// Features of every plane.
    pub features: u32,
    /// Cells along x, y, z at multiplier 1.
    pub spatial_resolution: [u32; 3],
    /// Rows of the time planes, the same at every level.
    pub time_resolution: u32,
    /// Width of the MLP.
    pub width: u32,
    /// Linear layers of the trunk; 0 and 1 are the same.
    pub depth: u32,
    /// Which attributes are deformed.
    pub heads: Heads,
    /// Floats of a row of SH parameters: 4, 12, 28 or 48 for degree 0 to 3.
    pub sh_stride: u32,
    /// How time maps to rows.
    pub time_axis: TimeAxis,
    /// How the heads start.
    pub head_init: HeadInit,
}

impl Default for FieldConfig {
    fn default() -> Self {
        Self {
            levels: vec![1, 2],
            features: 16,
            spatial_resolution: [64; 3],
            time_resolution: 150,
            width: 128,
            depth: 1,
            heads: Heads::default(),
            sh_stride: 48,
            time_axis: TimeAxis::default(),
            head_init: HeadInit::default(),
        }
    }
}

/// What can go wrong in the field.
#[derive(Debug, thiserror::Error)]
pub enum FieldError {
    /// The configuration is not possible.
    #[error("the deformation field cannot be built: {reason}; correct the [field] section of the configuration")]
    Config {
        /// What is wrong.
        reason: String,
    },
    /// A saved state does not belong to this configuration.
    #[error(
        "the saved deformation field does not fit this configuration: {reason}; resume with the configuration that it was saved with"
    )]
    State {
        /// What differs.
        reason: String,
    },
    /// Buffers or tapes do not belong together.
    #[error("the deformation field was called with buffers that do not belong together while {doing}: {reason}")]
    Mismatch {
        /// The call.
        doing: String,
        /// What differs.
        reason: String,
    },
    /// Training diverged.
    #[error(
        "training diverged: {count} values of the deformation field's {what} are not finite or out of range; lower the learning rates or check the poses and the initial cloud"
    )]
    Diverged {
        /// Gradients or parameters.
        what: String,
        /// How many.
        count: u64,
    },
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}
