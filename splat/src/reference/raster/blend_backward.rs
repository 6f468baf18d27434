//! Twin of `raster/blend_backward_cpu.wgsl`, `raster/blend_backward_gpu.wgsl` and `raster/gather.wgsl`.

use glam::{DVec3, DVec4};

use super::{Image, Splat};

/// The gradient of a splat, in the sums that the kernels keep: `v` is dL/d power at a pixel, (dx, dy) the pixel's offset
/// from the mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatGradient {
    /// Sums of v; v dx; v dy; v dx dx; v dx dy; v dy dy.
    pub moments: [f64; 6],
    /// dL/d colour.
    pub colour: DVec3,
}

/// The gradients of all splats, given dL/d image. The bound of alpha at 0.99 is not differentiated, as in the 3DGS code:
/// d alpha / d power is alpha everywhere.
#[must_use]
pub fn blend_backward(
    splats: &[Option<Splat>],
    image: &Image,
    background: DVec3,
    d_image: &[DVec4],
) -> Vec<SplatGradient> {
    let mut gradients = vec![SplatGradient::default(); splats.len()];
    for (layers, d) in image.layers.iter().zip(d_image) {
        let mut behind = d.truncate().dot(background) + d.w;
        for layer in layers.iter().rev() {
            let Some(splat) = &splats[layer.splat] else { continue };
            let gradient = &mut gradients[layer.splat];
            let colour = splat.colour.dot(d.truncate());
            gradient.colour += layer.alpha * layer.transmittance * d.truncate();
            let v = layer.alpha * layer.transmittance * (colour - behind);
            let (dx, dy) = (layer.offset.x, layer.offset.y);
            for (sum, factor) in gradient.moments.iter_mut().zip([1.0, dx, dy, dx * dx, dx * dy, dy * dy]) {
                *sum += v * factor;
            }
            behind += layer.alpha * (colour - behind);
        }
    }
    gradients
}
