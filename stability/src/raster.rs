//! The rasteriser on extreme Gaussians, against its `f64` twin. Gradients must be finite besides.

use crate::{Bound, Case, Expected, Size, cloud::Cloud};

const PART: &str = "rasteriser";

/// Its name, and the truth of its cases.
pub(crate) const ABOUT: [&str; 2] = [
    PART,
    "Twenty-four Gaussians in a picture of 40 x 30 pixels, against the rasteriser's `f64` twin; the error is the largest of any pixel, and the gradients must be finite.",
];

const BOUND: Bound =
    Bound { most: 2e-5, unit: "of white", why: "24 blended splats of about 14 roundings of f32 each (6e-8)" };

/// Scenes and their names.
fn scenes(size: Size) -> Vec<(String, Cloud)> {
    let ratio = 1e6_f64.ln();
    let set = |from: usize, to: usize, value: f64| move |_: usize, row: &mut [f64]| row[from..to].fill(value);
    let longer = move |by: f64| move |index: usize, row: &mut [f64]| row[3 + index % 3] += by;
    let cloud = || Cloud::random(900, 24);
    let mut scenes: Vec<(String, Cloud)> = vec![
        ("ordinary Gaussians, for comparison".into(), cloud()),
        ("needles, 1e6 times as long as wide".into(), cloud().changed(longer(ratio))),
        ("pancakes, 1e6 times as wide as thick".into(), cloud().changed(longer(-ratio))),
        ("scale 1e-8 m".into(), cloud().changed(set(3, 6, 1e-8_f64.ln()))),
        ("scale 1e4 m".into(), cloud().changed(set(3, 6, 1e4_f64.ln()))),
        ("all opaque (logit 50)".into(), cloud().changed(set(10, 11, 50.0))),
        ("all transparent (logit -50)".into(), cloud().changed(set(10, 11, -50.0))),
    ];
    for z in [-3.0, 0.0, 1e-9, 0.01, 0.010_001, 1e6] {
        scenes.push((format!("depth {z:e} m, where the near plane is at 0.01 m"), cloud().changed(set(2, 3, z))));
    }
    if size == Size::Full {
        for decade in -7..=3 {
            let scale = 10_f64.powi(decade);
            scenes.push((format!("scale {scale:.0e} m"), cloud().changed(set(3, 6, scale.ln()))));
        }
        for logit in [-5.54, -5.5, 0.0, 4.59, 4.6, 17.0] {
            scenes.push((format!("opacity logit {logit}"), cloud().changed(set(10, 11, logit))));
        }
    }
    scenes
}

/// The cases of the rasteriser.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    let case = |(name, cloud): (String, Cloud)| {
        Case::new(PART, name, Expected::Within(BOUND), move |bench| cloud.against(bench, cloud.twin()))
    };
    scenes(size).into_iter().map(case).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_something_to_see_but_where_everything_is_left_out() {
        for (name, cloud) in scenes(Size::Full) {
            let empty = ["transparent", "depth -3e0 ", "depth 0e0 ", "depth 1e-9 ", "depth 1e-2 ", "logit -5.54"];
            let background = cloud.options.background.map(f64::from);
            let picture = cloud.twin();
            let seen = picture.chunks_exact(4).any(|pixel| pixel[..3] != background);
            assert_eq!(seen, !empty.iter().any(|of| name.contains(of)), "{name}");
        }
    }
}
