//! What goes into and comes out of the rasteriser.

use erfgs_scene::{Distortion, Intrinsics, Pose};
use serde::{Deserialize, Serialize};
use wgpu::Buffer;

use crate::gpu::{Gpu, GpuError, stored};

/// Floats in a row of a `core` buffer: mean x, y, z | log-scale x, y, z | quaternion w, x, y, z | opacity logit | 0.
pub const CORE_STRIDE: u32 = 12;

/// Floats in a row of an `sh` buffer for coefficients up to `degree`: `3 (degree + 1)^2`, rounded up to 4.
#[must_use]
pub const fn sh_stride(degree: u32) -> u32 {
    (3 * (degree + 1) * (degree + 1)).next_multiple_of(4)
}

/// What can go wrong in the rasteriser.
#[derive(Debug, thiserror::Error)]
pub enum RasterError {
    /// The device failed, or a buffer does not fit it.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The camera is not a pinhole.
    #[error("a camera with {model} lens distortion cannot be rasterised; undistort its images first (`erfgs import`)")]
    Distorted {
        /// The distortion model.
        model: &'static str,
    },
    /// The view cannot be rendered.
    #[error("cannot render the view: {reason}; correct the camera in the dataset's manifest")]
    View {
        /// What is wrong with it.
        reason: String,
    },
    /// An argument does not fit the others.
    #[error("cannot {doing}: {reason}")]
    Arguments {
        /// Which call was made.
        doing: &'static str,
        /// What does not fit.
        reason: String,
    },
    /// There were more tile intersections than the frame had room for. The frame has grown: render again.
    #[error(
        "the image needs {needed} tile intersections and the frame had room for {capacity}; render it again, the frame has grown"
    )]
    Overflow {
        /// Intersections of this image.
        needed: u64,
        /// Intersections that the frame had room for.
        capacity: u64,
    },
}

/// The parameters of all Gaussians, on the device. Rows past `count` are ignored.
#[derive(Clone, Debug)]
pub struct GaussianBuffers {
    /// Number of Gaussians.
    pub count: u32,
    /// SH degree that `sh` has room for (its row stride is `sh_stride(sh_degree)`).
    pub sh_degree: u32,
    /// `count` rows of [`CORE_STRIDE`] floats.
    pub core: Buffer,
    /// `count` rows of `sh_stride(sh_degree)` floats, coefficient-major, then channel.
    pub sh: Buffer,
}

impl GaussianBuffers {
    /// Copies Gaussians to the device: `core` holds rows of [`CORE_STRIDE`] floats, `sh` of `sh_stride(sh_degree)`.
    ///
    /// # Errors
    /// [`RasterError::Arguments`] where the lengths do not fit each other, [`RasterError::Gpu`] where they do not fit
    /// the device.
    pub fn from_slices(gpu: &Gpu, sh_degree: u32, core: &[f32], sh: &[f32]) -> Result<Self, RasterError> {
        let count = core.len() / CORE_STRIDE as usize;
        let fits = count * CORE_STRIDE as usize == core.len()
            && sh_degree <= 3
            && count * sh_stride(sh_degree) as usize == sh.len();
        if !fits {
            let reason = format!("{} core and {} SH floats at degree {sh_degree}", core.len(), sh.len());
            return Err(RasterError::Arguments { doing: "copy Gaussians to the device", reason });
        }
        Ok(Self {
            count: count as u32,
            sh_degree,
            core: gpu.storage_from("gaussians.core", core)?,
            sh: gpu.storage_from("gaussians.sh", sh)?,
        })
    }

    /// Bytes of a buffer of core rows, and of one of SH rows, of so many Gaussians.
    #[must_use]
    pub fn sizes(count: u32, sh_degree: u32) -> [u64; 2] {
        [CORE_STRIDE, sh_stride(sh_degree)].map(|stride| stored(u64::from(count) * u64::from(stride) * 4))
    }
}

/// Where the gradients of all Gaussians are summed.
#[derive(Clone, Debug)]
pub struct Gradients {
    /// Added to: rows of [`CORE_STRIDE`] floats.
    pub core: Buffer,
    /// Added to: rows of the Gaussians' SH stride.
    pub sh: Buffer,
    /// Updated where statistics are asked for: rows of `[sum d_mean2d.x W/2, sum d_mean2d.y H/2, largest radius
    /// (3 sigma, px), number of renders that saw it]`.
    pub screen: Buffer,
}

impl Gradients {
    /// Zeroed gradients for `gaussians`.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn new(gpu: &Gpu, gaussians: &GaussianBuffers) -> Result<Self, RasterError> {
        let [core, sh, screen] = Self::sizes(gaussians.count, gaussians.sh_degree);
        Ok(Self {
            core: gpu.storage("gradients.core", core)?,
            sh: gpu.storage("gradients.sh", sh)?,
            screen: gpu.storage("gradients.screen", screen)?,
        })
    }

    /// Bytes of the three buffers for so many Gaussians.
    #[must_use]
    pub fn sizes(count: u32, sh_degree: u32) -> [u64; 3] {
        let [core, sh] = GaussianBuffers::sizes(count, sh_degree);
        [core, sh, stored(u64::from(count) * 16)]
    }
}

/// What a backward pass keeps besides gradients of the Gaussians.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted<'a> {
    /// Whether the statistics of [`Gradients::screen`] are kept.
    pub statistics: bool,
    /// Where the gradient of the camera's pose is added, if it is wanted.
    pub pose: Option<PoseRow<'a>>,
}

/// A camera's row of gradients of poses.
#[derive(Clone, Copy, Debug)]
pub struct PoseRow<'a> {
    /// [`PoseRow::FLOATS`] a row: the gradient of a turn (radians, about the camera's axes) and 0, that of a shift (metres, along them)
    /// and 0, of which the zeros count renderings. A camera at (R, t) that turns by w and shifts by s is at (exp(w) R, exp(w) t + s).
    pub sums: &'a Buffer,
    /// Which row.
    pub row: u32,
}

impl PoseRow<'_> {
    /// Floats of a row.
    pub const FLOATS: usize = 8;
}

/// A pinhole camera and where it stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f32,
    /// Focal length along y, pixels.
    pub fy: f32,
    /// Principal point x, pixels; the centre of the left column is 0.5.
    pub cx: f32,
    /// Principal point y, pixels; the centre of the top row is 0.5.
    pub cy: f32,
    /// World-to-camera rotation, row-major.
    pub rotation: [[f32; 3]; 3],
    /// World-to-camera translation, metres.
    pub translation: [f32; 3],
}

impl View {
    /// The centre of the camera in the world, metres.
    #[must_use]
    pub fn centre(&self) -> [f32; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|k| -(r[0][k] * t[0] + r[1][k] * t[1] + r[2][k] * t[2]))
    }

    /// The same camera elsewhere.
    #[must_use]
    pub fn placed(&self, pose: &Pose) -> Self {
        let columns = glam::DMat3::from_quat(pose.rotation).to_cols_array_2d();
        Self {
            rotation: std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row] as f32)),
            translation: pose.translation.as_vec3().to_array(),
            ..*self
        }
    }

    /// A world point in camera coordinates, metres.
    #[must_use]
    pub fn to_camera(&self, world: &[f32; 3]) -> [f32; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|k| r[k][0] * world[0] + r[k][1] * world[1] + r[k][2] * world[2] + t[k])
    }
}

impl TryFrom<(&Intrinsics, &Pose)> for View {
    type Error = RasterError;

    fn try_from((camera, pose): (&Intrinsics, &Pose)) -> Result<Self, RasterError> {
        let model = match camera.distortion {
            Distortion::None => None,
            Distortion::BrownConrady(c) if c.iter().all(|c| *c == 0.0) => None,
            Distortion::BrownConrady(_) => Some("Brown-Conrady"),
            Distortion::KannalaBrandt(_) => Some("Kannala-Brandt"),
        };
        if let Some(model) = model {
            return Err(RasterError::Distorted { model });
        }
        let pinhole = Self {
            width: camera.width,
            height: camera.height,
            fx: camera.fx as f32,
            fy: camera.fy as f32,
            cx: camera.cx as f32,
            cy: camera.cy as f32,
            rotation: [[0.0; 3]; 3],
            translation: [0.0; 3],
        };
        Ok(pinhole.placed(pose))
    }
}

/// The low pass of the 3DGS code, square pixels.
pub const LOW_PASS: f32 = 0.3;

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// Colour behind everything.
    pub background: [f32; 3],
    /// SH degree in use, at most the allocated one.
    pub sh_degree: u32,
    /// Gaussians whose mean is nearer than this along the optical axis are left out, metres (the 3DGS code has 0.2).
    pub near: f32,
    /// Standard deviations of a Gaussian, along the viewing direction, that must lie in front of the camera, or it is
    /// culled: 0 looks at its centre alone (3DGS). A large Gaussian beside a camera would otherwise veil its whole image.
    pub near_sigmas: f32,
    /// Added to the variances of a splat, square pixels: no splat is thinner than about a pixel. In an image that is seen larger
    /// than it was trained on it grows with the square of that, or thin splats become needles.
    pub low_pass: f32,
    /// Also render the alpha-weighted depth.
    pub depth: bool,
    /// Whether Gaussians without deltas, which stand still, get gradients and statistics, too.
    pub still_learn: bool,
    /// Cut Gaussians at the 16 x 16 tiles that their 3 sigma square touches, as the 3DGS code does. Otherwise they
    /// reach as far as their alpha is at least [`Thresholds::negligible_alpha`].
    pub three_sigma: bool,
    /// On the GPU shape: tile intersections that a new frame has room for; a guess by default.
    pub first_room: Option<u32>,
}

/// What the blending leaves out: see [`super::Rasteriser::with_thresholds`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// A splat is left out of a pixel where its alpha is less; it reaches as far as that.
    pub negligible_alpha: f32,
    /// A pixel is finished before the splat that would bring its transmittance below this.
    pub least_transmittance: f32,
}

impl Default for Thresholds {
    /// Those of the 3DGS code.
    fn default() -> Self {
        Self { negligible_alpha: 1.0 / 255.0, least_transmittance: 1e-4 }
    }
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            background: [0.0; 3],
            sh_degree: 3,
            near: 0.01,
            near_sigmas: 0.0,
            low_pass: LOW_PASS,
            depth: false,
            still_learn: true,
            three_sigma: false,
            first_room: None,
        }
    }
}
