//! Epipolar lines: points of one camera, and the lines on which another must see them.

use std::fmt::Write as _;

use erfgs_page::html::{self, Escaped, number};
use erfgs_scene::Modality;
use glam::DVec2;

use super::{
    pairs::{Pair, Shared, curve, pairs, picture},
    previews,
};
use crate::evidence::Evidence;
use erfgs_scene::rig_file::{RigCamera, RigFile};

/// Pairs that are drawn at most; further ones have a row in a table.
const DRAWN: usize = 12;
/// Points of a pair that are drawn at most; there is a colour for each.
const POINTS: usize = 8;
/// How exactly curves are drawn, pixels of the camera.
const TOLERANCE_PX: f64 = 0.1;

pub(super) fn figures(rig: &RigFile, evidence: &Evidence) -> String {
    let pairs = pairs(rig, evidence);
    if pairs.is_empty() {
        return String::new();
    }
    let (drawn, further) = pairs.split_at(DRAWN.min(pairs.len()));
    let figures: String = drawn.iter().map(|pair| figure(rig, evidence, pair)).collect();
    let moved = if evidence.residuals.iter().any(|residual| residual.at_instant != residual.pixel) {
        " Cameras do not expose at the same instant: points are moved to it along their paths."
    } else {
        ""
    };
    let mut text = format!(
        "{}{figures}</div>\n<p class=\"caption\">Points that both cameras saw, and in the second camera their epipolar lines through \
         both lenses; rings mark the observations. Each camera is shown with the most informative neighbour. Distances are those of \
         all common points that were used; errors along a line do not show.{moved}</p>\n",
        previews::grid(drawn.len())
    );
    if !further.is_empty() {
        let rows = further.iter().map(|pair| {
            let name = |camera: usize| Escaped(&rig.cameras[camera].name).to_string();
            let cells = [name(pair.first), name(pair.second), html::count(pair.shared.len() as u64)];
            let quantiles =
                [0.5, 0.95].map(|share| pair.quantile(share).map_or("–".into(), |value| number(value, 2)));
            format!("<tr><td>{}</td><td>{}</td></tr>\n", cells.join("</td><td>"), quantiles.join("</td><td>"))
        });
        let head = "<tr><th>Points of</th><th>Lines in</th><th>Points</th><th>Median <small>px</small></th>\
                    <th>95 % within <small>px</small></th></tr>";
        text += &html::table("figures", head, &rows.collect::<String>());
    }
    text
}

fn figure(rig: &RigFile, evidence: &Evidence, pair: &Pair) -> String {
    let (first, second) = (&rig.cameras[pair.first], &rig.cameras[pair.second]);
    let points = pair.spread(POINTS, [size(first), size(second)]);
    let mut left = frame(evidence, pair, pair.first, first);
    let mut right = frame(evidence, pair, pair.second, second);
    for (colour, shared) in points.iter().enumerate() {
        ring(&mut left, first, shared.first, colour);
        line(&mut right, rig, pair, shared, colour);
    }
    for (colour, shared) in points.iter().enumerate() {
        ring(&mut right, second, shared.second, colour);
    }
    let kinds = match (first.modality, second.modality) {
        (Modality::Rgb, Modality::Event) => " (RGB on events)",
        _ => "",
    };
    let distances = match (pair.quantile(0.5), pair.quantile(0.95)) {
        (Some(median), Some(most)) => {
            format!("median {} px, 95 % within {} px of the line", number(median, 2), number(most, 2))
        }
        _ => "none of them has a line in the second image".into(),
    };
    let lost = pair.shared.len() - pair.distances.len();
    let lost =
        if lost > 0 && lost < pair.shared.len() { format!("; {} have no line there", lost) } else { String::new() };
    format!(
        "<figure><div class=\"two\">{left}</svg>{right}</svg></div><figcaption><b>{} → {}</b>{kinds}: {} points, \
         {distances}{lost}</figcaption></figure>\n",
        Escaped(&first.name),
        Escaped(&second.name),
        html::count(pair.shared.len() as u64),
    )
}

fn size(camera: &RigCamera) -> DVec2 {
    DVec2::new(f64::from(camera.intrinsics.width), f64::from(camera.intrinsics.height))
}

/// The beginning of a camera's image: its picture where that is of the right instant.
fn frame(evidence: &Evidence, pair: &Pair, index: usize, camera: &RigCamera) -> String {
    let shown = picture(evidence, index).filter(|picture| picture.placement == pair.placement);
    let mut svg = previews::svg(camera, "Epipolar lines");
    if shown.is_some() {
        let _ = write!(svg, "<use href=\"#picture-{index}\"/>");
    }
    svg
}

fn ring(svg: &mut String, camera: &RigCamera, at: DVec2, colour: usize) {
    let radius = 0.012 * size(camera).x;
    let circle = format!("cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\"", at.x, at.y);
    let _ = write!(svg, "<circle class=\"halo\" {circle}/><circle class=\"e{colour}\" {circle}/>");
}

fn line(svg: &mut String, rig: &RigFile, pair: &Pair, shared: &Shared, colour: usize) {
    let Some(curve) = curve(rig, pair.first, pair.second, shared.first) else { return };
    let mut path = String::new();
    for part in curve.parts(TOLERANCE_PX) {
        for (index, at) in part.iter().enumerate() {
            let _ = write!(path, "{}{:.1} {:.1}", if index == 0 { 'M' } else { 'L' }, at.x, at.y);
        }
        if part.len() == 1 {
            path.push_str("h.1");
        }
    }
    let _ = write!(svg, "<path class=\"halo\" d=\"{path}\"/><path class=\"e{colour}\" d=\"{path}\"/>");
}
