//! Pictures in `f64` by any rules, or by none: what the rasteriser's rules are measured against.

use erfgs_splat::{
    raster::{CORE_STRIDE, RenderOptions, Thresholds, View, sh_stride},
    reference::raster::{Gaussians, Splat, project},
};
use glam::{DVec2, DVec3, DVec4};

/// What may be left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Faint splats, and what lies behind a pixel that is nearly opaque; nothing where there are none.
    pub thresholds: Option<Thresholds>,
    /// What lies outside the 16 x 16 tiles that a splat's 3 sigma square touches.
    pub three_sigma: bool,
}

impl Rules {
    /// Everything counts.
    pub const NONE: Self = Self { thresholds: None, three_sigma: false };
}

/// Whatever is left out beyond this many standard deviations (squared) is below 1e-30.
const NOTHING: f64 = 140.0;

/// r, g, b over the background and the final transmittance of each pixel, row by row.
#[must_use]
pub fn exact(gaussians: &Gaussians, view: &View, options: &RenderOptions, rules: &Rules) -> Vec<DVec4> {
    let stride = sh_stride(gaussians.sh_degree) as usize;
    let rows = gaussians.core.chunks_exact(CORE_STRIDE as usize).zip(gaussians.sh.chunks_exact(stride));
    let mut splats: Vec<Splat> = rows
        .filter_map(|(core, sh)| {
            // The twin leaves out what is faint everywhere; here it is the rules that say so.
            let mut opaque = core.to_vec();
            opaque[10] = 50.0;
            let opacity = 1.0 / (1.0 + (-core[10]).exp());
            project(&opaque, sh, view, options).map(|splat| Splat { opacity, ..splat })
        })
        .collect();
    splats.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    let background = DVec3::from(options.background.map(f64::from));
    let (faint, spent) =
        rules.thresholds.map_or((0.0, 0.0), |of| (f64::from(of.negligible_alpha), f64::from(of.least_transmittance)));
    let pixels = (0..view.height).flat_map(|y| (0..view.width).map(move |x| [x, y]));
    pixels
        .map(|pixel| {
            let centre = DVec2::from(pixel.map(|at| f64::from(at) + 0.5));
            let (mut colour, mut transmittance) = (DVec3::ZERO, 1.0);
            for splat in &splats {
                let d = centre - splat.mean;
                let [a, b, c] = splat.conic;
                let squared = a * d.x * d.x + 2.0 * b * d.x * d.y + c * d.y * d.y;
                if squared > NOTHING || (rules.three_sigma && !touches(splat, pixel)) {
                    continue;
                }
                let alpha = (splat.opacity * (-0.5 * squared).exp()).min(0.99);
                if alpha < faint {
                    continue;
                }
                if transmittance * (1.0 - alpha) < spent {
                    break;
                }
                colour += transmittance * alpha * splat.colour;
                transmittance *= 1.0 - alpha;
            }
            (colour + transmittance * background).extend(transmittance)
        })
        .collect()
}

/// Whether a splat's 3 sigma square touches the tile of a pixel.
fn touches(splat: &Splat, pixel: [u32; 2]) -> bool {
    let radius = splat.radius.ceil();
    let mean = splat.mean.to_array();
    (0..2).all(|axis| {
        let first = f64::from(pixel[axis] / 16 * 16) + 0.5;
        (first - radius..=first + 15.0 + radius).contains(&mean[axis])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_rules_a_lone_splat_is_its_formula_and_with_them_it_ends() {
        // A round splat of an opacity of a half in the middle of 33 x 33 pixels; its variance is 4 square pixels.
        let size = ((4.0 - f64::from(erfgs_splat::raster::LOW_PASS)).sqrt() / 33.0 * 2.0).ln();
        let gaussians = Gaussians {
            sh_degree: 0,
            core: vec![0.0, 0.0, 2.0, size, size, size, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            sh: vec![0.0; 4],
        };
        let view = View {
            width: 33,
            height: 33,
            fx: 33.0,
            fy: 33.0,
            cx: 16.5,
            cy: 16.5,
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
        };
        let options = RenderOptions { sh_degree: 0, ..RenderOptions::default() };
        let line = |rules: &Rules| -> Vec<f64> {
            exact(&gaussians, &view, &options, rules)[16 * 33..17 * 33].iter().map(|pixel| 1.0 - pixel.w).collect()
        };
        let usual = Rules { thresholds: Some(Thresholds::default()), three_sigma: false };
        for (x, (free, cut)) in line(&Rules::NONE).into_iter().zip(line(&usual)).enumerate() {
            let formula = 0.5 * (-0.125 * (x as f64 - 16.0).powi(2)).exp();
            assert!((free - formula).abs() < 1e-9, "{x}: {free} and {formula}");
            assert_eq!(cut, if formula < 1.0 / 255.0 { 0.0 } else { free }, "{x}");
        }
    }
}
