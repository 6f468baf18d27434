//! A picture of each camera as it is and without the lens's distortion, with what was found in it.

use std::{collections::BTreeMap, fmt::Write as _};

use erfgs_page::{
    html::{Escaped, number},
    picture::data_uri,
};
use erfgs_scene::{
    Distortion, ImageRgb8, Intrinsics,
    image::{Resample, jpeg},
    undistort::{Undistortion, pinhole},
};
use glam::{DVec2, DVec3};

use crate::evidence::{Evidence, Picture};
use erfgs_scene::rig_file::{RigCamera, RigFile};

/// Up to so many pictures are shown at full width, and at most so wide where there are more, pixels.
const WIDTHS: [(usize, u32); 3] = [(12, 640), (32, 480), (usize::MAX, 320)];
const QUALITY: u8 = 82;
/// Points that are drawn in a picture at most.
const DRAWN: usize = 400;
/// A row of fewer features is no line to be straight.
const LEAST_IN_A_ROW: usize = 3;

pub(super) fn figures(rig: &RigFile, evidence: &Evidence) -> String {
    let width = WIDTHS.iter().find(|(count, _)| evidence.pictures.len() <= *count).map_or(320, |(_, width)| *width);
    let figures: String = evidence
        .pictures
        .iter()
        .filter_map(|picture| figure(rig.cameras.get(picture.camera)?, picture, evidence, width))
        .collect();
    if figures.is_empty() {
        return figures;
    }
    format!(
        "{}{figures}</div>\n<p class=\"caption\">First as recorded, with the detections; then undistorted. Thin lines join the ends \
         of the target's rows and columns: straight lines must be straight in the second picture.</p>\n",
        grid(evidence.pictures.len())
    )
}

/// The beginning of a grid of figures with two pictures each: large ones, if they are few.
pub(super) fn grid(count: usize) -> &'static str {
    if count > 6 { "<div class=\"overlays many\">" } else { "<div class=\"overlays\">" }
}

/// The beginning of an image in the camera's pixels.
pub(super) fn svg(camera: &RigCamera, what: &str) -> String {
    let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
    format!(
        "<svg viewBox=\"0 0 {width} {height}\" stroke-width=\"{:.2}\" role=\"img\" aria-label=\"{what}, {}\">",
        f64::from(width) / 260.0,
        Escaped(&camera.name)
    )
}

fn figure(camera: &RigCamera, picture: &Picture, evidence: &Evidence, width: u32) -> Option<String> {
    let found = found(picture, evidence);
    let rows = rows(&found);
    let i = &camera.intrinsics;
    let mut left = svg(camera, "As recorded");
    let id = format!(" id=\"picture-{}\"", picture.camera);
    left += &embedded(&picture.image, width, i, &id)?;
    let pixels: Vec<Option<DVec2>> = found.iter().map(|(_, pixel)| Some(*pixel)).collect();
    draw(&mut left, i, &pixels, &rows);
    let mut caption = format!("<b>{}</b>", Escaped(&camera.name));
    if let Some(moment) = picture.placement.and_then(|placement| evidence.moments.get(placement)) {
        let _ = write!(caption, ", instant {}", Escaped(&moment.name));
    }
    let mut right = String::new();
    if i.distortion == Distortion::None {
        caption += ": a pinhole, without distortion";
    } else {
        let small = i.resized(picture.image.width, picture.image.height);
        match pinhole(&small) {
            Ok((to, factor)) => {
                right = svg(camera, "Undistorted");
                right += &embedded(&Undistortion::new(&small, &to).picture(&picture.image), width, i, "")?;
                let full = to.resized(i.width, i.height);
                let straight: Vec<Option<DVec2>> =
                    pixels.iter().map(|pixel| straightened(i, &full, (*pixel)?)).collect();
                draw(&mut right, i, &straight, &rows);
                right += "</svg>";
                if factor > 1.005 {
                    let _ = write!(
                        caption,
                        "; undistorted picture {} times larger, so that every pixel is real",
                        number(factor, 2)
                    );
                }
                if let (Some(before), Some(after)) = (bend_px(&pixels, &rows), bend_px(&straight, &rows)) {
                    let (before, after) = (number(before, 2), number(after / factor, 2));
                    let _ = write!(
                        caption,
                        "; rows deviate from straight lines by {before} px before, {after} px after (rms)"
                    );
                }
            }
            Err(_) => caption += ": no pinhole sees what this lens sees",
        }
    }
    Some(format!("<figure><div class=\"two\">{left}</svg>{right}</div><figcaption>{caption}</figcaption></figure>\n"))
}

/// The picture as a part of an image in the camera's pixels.
fn embedded(picture: &ImageRgb8, width: u32, camera: &Intrinsics, attributes: &str) -> Option<String> {
    let height = (u64::from(picture.height) * u64::from(width) / u64::from(picture.width.max(1))).max(1) as u32;
    let small = (width < picture.width).then(|| picture.resized(width, height, Resample::Area));
    let shown = small.as_ref().unwrap_or(picture);
    let uri = data_uri("image/jpeg", &jpeg(&shown.data, shown.width, shown.height, QUALITY)?);
    Some(format!(
        "<image{attributes} width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" href=\"{uri}\"/>",
        camera.width, camera.height
    ))
}

/// What was found in the picture: on the target, and in the image.
fn found(picture: &Picture, evidence: &Evidence) -> Vec<(DVec3, DVec2)> {
    if !picture.found.is_empty() {
        return picture.found.clone();
    }
    let own = |placement: usize| picture.placement.is_none_or(|shown| shown == placement);
    let of = evidence.residuals.iter().filter(|r| r.camera == picture.camera && r.used && own(r.placement));
    // Points of the scene are no target, and have no rows.
    let on_target = |on: DVec3| if picture.placement.is_some() { on } else { DVec3::NAN };
    of.map(|residual| (on_target(residual.on_target), residual.at_instant)).collect()
}

/// The features of each row and column of the target, in order.
fn rows(found: &[(DVec3, DVec2)]) -> Vec<Vec<usize>> {
    let mut rows: BTreeMap<(usize, u64), Vec<usize>> = BTreeMap::new();
    for (index, (on_target, _)) in found.iter().enumerate().filter(|(_, (on_target, _))| on_target.is_finite()) {
        for axis in 0..2 {
            rows.entry((axis, on_target[1 - axis].to_bits())).or_default().push(index);
        }
    }
    rows.into_iter()
        .map(|((axis, _), mut row)| {
            row.sort_by(|a, b| found[*a].0[axis].total_cmp(&found[*b].0[axis]));
            row
        })
        .filter(|row| row.len() >= LEAST_IN_A_ROW)
        .collect()
}

/// Where a pinhole sees what the lens shows at `pixel`.
fn straightened(lens: &Intrinsics, pinhole: &Intrinsics, pixel: DVec2) -> Option<DVec2> {
    let ray = lens.unproject(pixel).ok().filter(|ray| ray.z > 1e-6)?;
    Some(pinhole.project_pinhole(ray))
}

/// How far the features of rows lie from the straight line that fits each best: root mean square, pixels.
fn bend_px(pixels: &[Option<DVec2>], rows: &[Vec<usize>]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for row in rows {
        let points: Vec<DVec2> = row.iter().filter_map(|index| pixels[*index]).collect();
        if points.len() < LEAST_IN_A_ROW {
            continue;
        }
        let mean = points.iter().sum::<DVec2>() / points.len() as f64;
        let [xx, xy, yy] = points
            .iter()
            .map(|point| *point - mean)
            .fold([0.0; 3], |[xx, xy, yy], d| [xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y]);
        // The smaller eigenvalue of the scatter is the sum of the squared distances from the line.
        sum += 0.5 * (xx + yy - (xx - yy).hypot(2.0 * xy)).max(0.0);
        count += points.len();
    }
    (count > 0).then(|| (sum / f64::from(count as u32)).sqrt())
}

fn draw(svg: &mut String, camera: &Intrinsics, pixels: &[Option<DVec2>], rows: &[Vec<usize>]) {
    let mut path = String::new();
    for row in rows {
        let ends = [row.first(), row.last()].map(|index| index.and_then(|index| pixels[*index]));
        if let [Some(from), Some(to)] = ends {
            let _ = write!(path, "M{:.1} {:.1}L{:.1} {:.1}", from.x, from.y, to.x, to.y);
        }
    }
    let _ = write!(svg, "<path class=\"row\" d=\"{path}\"/>");
    let radius = 0.006 * f64::from(camera.width);
    for at in pixels.iter().step_by(pixels.len().div_ceil(DRAWN).max(1)).flatten() {
        let _ = write!(svg, "<circle class=\"found\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\"/>", at.x, at.y);
    }
}
