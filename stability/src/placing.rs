//! Scenes of other sizes and elsewhere: the picture must be that of the scene in its place.

use crate::{Bound, Case, Expected, Size, cloud::Cloud};

const PART: &str = "scenes of other sizes, elsewhere";

/// Its name, and the truth of its cases.
pub(crate) const ABOUT: [&str; 2] =
    [PART, "The picture of a scene that was scaled or moved, against the twin's of the scene in its place."];

const SCALED: Bound = Bound {
    most: 3e-5,
    unit: "of white",
    why: "the roundings of the rasteriser (2e-5), and one more of every place and size: 36 px / 3 px of 6e-8, 24 times over",
};

/// The cloud with every length times `by`.
fn scaled(cloud: &Cloud, by: f64) -> Cloud {
    let mut scaled = cloud.clone().changed(|_, row| {
        row[..3].iter_mut().for_each(|x| *x *= by);
        row[3..6].iter_mut().for_each(|x| *x += by.ln());
    });
    scaled.options.near *= by as f32;
    scaled
}

/// The cloud and its camera moved along x.
fn moved(cloud: &Cloud, by: f64) -> Cloud {
    let mut moved = cloud.clone().changed(|_, row| row[0] += by);
    moved.view.translation[0] -= by as f32;
    moved
}

/// The cases of scenes of other sizes.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    let mut cases = Vec::new();
    for by in [1e-4, 1e-2, 1e2, 1e4].into_iter().filter(|by| size == Size::Full || [1e-4, 1e4].contains(by)) {
        cases.push(Case::new(PART, format!("every length times {by:e}"), Expected::Within(SCALED), move |bench| {
            let cloud = Cloud::random(910, 24);
            scaled(&cloud, by).against(bench, cloud.twin())
        }));
    }
    for by in [100.0, 1e4, 1e5].into_iter().filter(|by| size == Size::Full || *by == 1e5) {
        // Half a unit in the last place of the places, and as much of every product and sum of the way to the camera; a pixel is 1/24 m
        // where a Gaussian is nearest, and a splat of three pixels changes by at most a fifth of white a pixel, three of them in a row.
        let unit = f64::from(by as f32 * f32::EPSILON);
        let bound = Bound {
            most: SCALED.most + 2.0 * unit * 24.0 * 0.6,
            unit: "of white",
            why: "f32 tells places that far away 12 µm (100 m) to 12 mm (1e5 m) apart: 0.3 pixels of this camera at worst",
        };
        cases.push(Case::new(PART, format!("{by:e} m from the origin"), Expected::Within(bound), move |bench| {
            let cloud = Cloud::random(911, 24);
            moved(&cloud, by).against(bench, cloud.twin())
        }));
    }
    cases
}
