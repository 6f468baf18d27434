//! Residuals where they are in each camera's image: coverage, and what the model does not explain.

use std::fmt::Write as _;

use erfgs_page::html::{Escaped, number};

use super::round_down;
use crate::{
    coverage::Coverage,
    evidence::{Evidence, Residual},
    statistics::median,
};
use erfgs_scene::rig_file::{RigCamera, RigFile};

/// Residuals that are drawn for one camera at most.
const DRAWN: usize = 1500;

pub(super) fn maps(rig: &RigFile, evidence: &Evidence) -> String {
    let figures: String = rig
        .cameras
        .iter()
        .enumerate()
        .filter_map(|(index, camera)| {
            let own: Vec<&Residual> = evidence.residuals.iter().filter(|residual| residual.camera == index).collect();
            (!own.is_empty()).then(|| map(camera, &own))
        })
        .collect();
    if figures.is_empty() {
        return figures;
    }
    format!(
        "<div class=\"maps\">{figures}</div>\n<p class=\"caption\">Each line points from an observation to its prediction, enlarged \
         by the factor below the image. Crosses are outliers. Dark parts have no observations: an image should be covered to its \
         corners, and neighbouring lines should not point the same way.</p>\n"
    )
}

/// An image is divided into so many columns and rows of parts to say where something was seen.
const GRID: usize = 6;

fn map(camera: &RigCamera, residuals: &[&Residual]) -> String {
    let (width, height) = (f64::from(camera.intrinsics.width), f64::from(camera.intrinsics.height));
    let used = || residuals.iter().filter(|residual| residual.used);
    let typical = median(used().filter_map(|r| r.residual).map(|off| off.length())).unwrap_or(0.0);
    // A typical residual becomes a fortieth of the image; a round factor.
    let factor = if typical > 0.0 { round_down((0.025 * width / typical).max(1.0)) } else { 1.0 };
    let stroke = width / 450.0;
    let mut svg = format!(
        "<figure><svg viewBox=\"0 0 {width} {height}\" stroke-width=\"{stroke:.2}\" role=\"img\" aria-label=\"Residuals of {}\">",
        Escaped(&camera.name)
    );
    let mut coverage = Coverage::new([camera.intrinsics.width, camera.intrinsics.height], [GRID; 2]);
    used().for_each(|residual| coverage.see(residual.pixel));
    for (index, _) in coverage.counts().iter().enumerate().filter(|(_, count)| **count == 0) {
        let (w, h) = (width / GRID as f64, height / GRID as f64);
        let (x, y) = (w * (index % GRID) as f64, h * (index / GRID) as f64);
        let _ = write!(svg, "<rect class=\"bare\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\"/>");
    }
    let every = residuals.len().div_ceil(DRAWN).max(1);
    let (mut kept, mut left, mut spots) = (String::new(), String::new(), String::new());
    for residual in residuals.iter().step_by(every) {
        let at = residual.pixel;
        match residual.residual {
            Some(off) if residual.used => {
                let _ = write!(kept, "M{:.1} {:.1}l{:.1} {:.1}", at.x, at.y, factor * off.x, factor * off.y);
                let _ = write!(spots, "M{:.1} {:.1}h.1", at.x, at.y);
            }
            _ => {
                let size = 4.0 * stroke;
                let _ = write!(
                    left,
                    "M{:.1} {:.1}l{size:.1} {size:.1}m{:.1} 0l{size:.1} {:.1}",
                    at.x - size / 2.0,
                    at.y - size / 2.0,
                    -size,
                    -size
                );
            }
        }
    }
    let _ = write!(
        svg,
        "<path class=\"residual\" d=\"{kept}\"/><path class=\"residual\" stroke-linecap=\"round\" stroke-width=\"{:.2}\" \
         d=\"{spots}\"/><path class=\"outlier\" d=\"{left}\"/></svg><figcaption><b>{}</b> drawn {} times larger; median {} px; \
         seen in {} of {} parts",
        3.0 * stroke,
        Escaped(&camera.name),
        number(factor, 0),
        number(typical, 3),
        coverage.covered(),
        coverage.parts()
    );
    if every > 1 {
        let _ = write!(svg, "; one in {every} is drawn");
    }
    svg + "</figcaption></figure>\n"
}
