//! The uniform of `shared/view.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{Deltas, GaussianBuffers, RasterError, RenderOptions, Thresholds, View, sh_stride};

/// Side of the tiles that bound a splat with [`RenderOptions::three_sigma`], pixels.
pub(super) const PARITY_TILE: u32 = 16;
/// Largest image side, pixels: tile indices and pixel offsets stay within 32 bits.
const LARGEST_SIDE: u32 = 16_384;

/// `View` in WGSL.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct ViewUniform {
    world_to_camera: [[f32; 4]; 3],
    centre_near: [f32; 4],
    pinhole: [f32; 4],
    slope_bounds: [f32; 4],
    background: [f32; 4],
    pub(super) size: [u32; 4],
    pub(super) counts: [u32; 4],
    pub(super) switches: [u32; 4],
    pub(super) outputs: [u32; 4],
    thresholds: [f32; 4],
}

impl ViewUniform {
    /// Checks the arguments of a render and packs them. `tile`: width and height of a tile, pixels.
    pub(super) fn new(
        gaussians: &GaussianBuffers,
        deltas: Option<&Deltas>,
        view: &View,
        options: &RenderOptions,
        thresholds: &Thresholds,
        tile: u32,
    ) -> Result<Self, RasterError> {
        check_view(view)?;
        check_gaussians(gaussians, deltas, options)?;
        let [r0, r1, r2] = view.rotation;
        let t = view.translation;
        let c = view.centre();
        let (w, h) = (view.width as f32, view.height as f32);
        Ok(Self {
            world_to_camera: [[r0[0], r0[1], r0[2], t[0]], [r1[0], r1[1], r1[2], t[1]], [r2[0], r2[1], r2[2], t[2]]],
            centre_near: [c[0], c[1], c[2], options.near.max(1e-6)],
            pinhole: [view.fx, view.fy, view.cx, view.cy],
            // 1.3 times the half field of view from a centred principal point: 15 % of the image beyond each border.
            slope_bounds: [
                (-0.15 * w - view.cx) / view.fx,
                (1.15 * w - view.cx) / view.fx,
                (-0.15 * h - view.cy) / view.fy,
                (1.15 * h - view.cy) / view.fy,
            ],
            background: [options.background[0], options.background[1], options.background[2], options.near_sigmas],
            size: [view.width, view.height, view.width.div_ceil(tile), view.height.div_ceil(tile)],
            counts: [
                gaussians.count,
                deltas.map_or(0, |deltas| deltas.rows),
                options.sh_degree,
                sh_stride(gaussians.sh_degree),
            ],
            switches: [
                u32::from(deltas.is_some_and(|deltas| deltas.sh.is_some())),
                u32::from(options.three_sigma),
                0,
                0,
            ],
            outputs: [0, 0, 0, options.low_pass.to_bits()],
            thresholds: [
                thresholds.negligible_alpha,
                f64::from(thresholds.negligible_alpha).log2() as f32,
                thresholds.least_transmittance,
                0.0,
            ],
        })
    }
}

fn check_view(view: &View) -> Result<(), RasterError> {
    let numbers = view.rotation.as_flattened().iter().chain(&view.translation);
    let finite = numbers.chain(&[view.fx, view.fy, view.cx, view.cy]).all(|x| x.is_finite());
    let reason = if view.width == 0 || view.height == 0 || view.width.max(view.height) > LARGEST_SIDE {
        format!(
            "its image has {} x {} pixels; between 1 and {LARGEST_SIDE} a side are possible",
            view.width, view.height
        )
    } else if !finite {
        "its pose or its intrinsics are not finite".into()
    } else if view.fx <= 0.0 || view.fy <= 0.0 {
        format!("its focal lengths are {} and {} pixels; they must be positive", view.fx, view.fy)
    } else {
        return Ok(());
    };
    Err(RasterError::View { reason })
}

fn check_gaussians(
    gaussians: &GaussianBuffers,
    deltas: Option<&Deltas>,
    options: &RenderOptions,
) -> Result<(), RasterError> {
    let rows = u64::from(gaussians.count);
    let core_bytes = 48 * rows;
    let sh_bytes = 4 * rows * u64::from(sh_stride(gaussians.sh_degree));
    let delta_rows = deltas.map_or(0, |deltas| deltas.rows);
    let reason = if gaussians.sh_degree > 3 || options.sh_degree > gaussians.sh_degree {
        format!("SH degree {} of {} allocated; at most 3", options.sh_degree, gaussians.sh_degree)
    } else if gaussians.core.size() < core_bytes || gaussians.sh.size() < sh_bytes {
        format!("the parameter buffers are too small for {rows} Gaussians")
    } else if delta_rows > gaussians.count {
        format!("{delta_rows} rows of deltas for {rows} Gaussians")
    } else {
        return Ok(());
    };
    Err(RasterError::Arguments { doing: "render", reason })
}
