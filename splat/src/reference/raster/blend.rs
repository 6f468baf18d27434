//! Twin of `raster/blend_cpu.wgsl` and `raster/blend_gpu.wgsl`.

use glam::{DVec2, DVec3, DVec4};

use super::Splat;
use crate::raster::{RenderOptions, View};

/// A rendered image.
#[derive(Clone, Debug)]
pub struct Image {
    /// r, g, b over the background; the final transmittance.
    pub pixels: Vec<DVec4>,
    /// Depth weighted by alpha and transmittance, metres.
    pub depth: Vec<f64>,
    /// What each pixel is made of, front to back.
    pub(super) layers: Vec<Vec<Layer>>,
}

/// One splat's share of a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layer {
    pub(super) splat: usize,
    pub(super) alpha: f64,
    /// Transmittance in front of it.
    pub(super) transmittance: f64,
    /// Pixel centre minus the splat's mean.
    pub(super) offset: DVec2,
}

/// Blends splats front to back: `alpha = min(0.99, opacity exp(power))`, left out below 1/255; a pixel is finished
/// before the splat that would bring its transmittance below 1e-4.
#[must_use]
pub fn blend(splats: &[Option<Splat>], view: &View, options: &RenderOptions) -> Image {
    let mut order: Vec<(usize, &Splat)> =
        splats.iter().enumerate().filter_map(|(index, splat)| splat.as_ref().map(|splat| (index, splat))).collect();
    order.sort_by(|a, b| a.1.depth.total_cmp(&b.1.depth));
    let background = DVec3::from(options.background.map(f64::from));
    let mut image = Image { pixels: Vec::new(), depth: Vec::new(), layers: Vec::new() };
    for (y, x) in (0..view.height).flat_map(|y| (0..view.width).map(move |x| (y, x))) {
        let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let mut transmittance = 1.0;
        let mut colour = DVec3::ZERO;
        let mut depth = 0.0;
        let mut layers = Vec::new();
        for &(index, splat) in &order {
            if options.three_sigma && !in_parity_square(splat, x, y) {
                continue;
            }
            let offset = pixel - splat.mean;
            let [a, b, c] = splat.conic;
            let power = -0.5 * (a * offset.x * offset.x + c * offset.y * offset.y) - b * offset.x * offset.y;
            let alpha = (splat.opacity * power.min(0.0).exp()).min(0.99);
            if alpha < 1.0 / 255.0 {
                continue;
            }
            if transmittance * (1.0 - alpha) < 1e-4 {
                break;
            }
            layers.push(Layer { splat: index, alpha, transmittance, offset });
            colour += transmittance * alpha * splat.colour;
            depth += transmittance * alpha * splat.depth;
            transmittance *= 1.0 - alpha;
        }
        image.pixels.push((colour + transmittance * background).extend(transmittance));
        image.depth.push(depth);
        image.layers.push(layers);
    }
    image
}

/// Whether the pixel lies in a 16 x 16 tile that the splat's 3 sigma square touches.
fn in_parity_square(splat: &Splat, x: u32, y: u32) -> bool {
    let radius = splat.radius.ceil();
    let touches = |mean: f64, index: u32| {
        let low = f64::from(index / 16 * 16) + 0.5;
        mean + radius >= low && mean - radius <= low + 15.0
    };
    touches(splat.mean.x, x) && touches(splat.mean.y, y)
}
