//! Cameras in space: a frustum for each, to be turned by dragging.

use std::fmt::Write as _;

use erfgs_page::html::Escaped;
use erfgs_scene::{Intrinsics, Modality, Pose};
use glam::{DVec2, DVec3};

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 420.0;
/// From where it is seen at first, radians.
const TURN: f64 = 0.5;
const TILT: f64 = 0.5;

/// A camera as it is drawn.
pub(super) struct Shown<'a> {
    /// Written above it.
    pub name: &'a str,
    /// Class of its lines, see [`class`].
    pub class: &'a str,
    /// Lens and sensor.
    pub intrinsics: &'a Intrinsics,
    /// World-to-camera pose.
    pub pose: Pose,
}

/// The class of a camera's lines.
pub(super) fn class(modality: Modality) -> &'static str {
    match modality {
        Modality::Rgb => "RGB",
        Modality::Event => "events",
        Modality::Both => "both",
    }
}

/// The middle of the cameras, and how far the farthest is from it; `None` where fewer than two stand apart.
pub(super) fn extent(centres: &[DVec3]) -> Option<(DVec3, f64)> {
    if centres.len() < 2 {
        return None;
    }
    let middle = centres.iter().sum::<DVec3>() / centres.len() as f64;
    let reach = centres.iter().map(|centre| centre.distance(middle)).fold(0.0, f64::max);
    (reach > 0.0 && reach.is_finite()).then_some((middle, reach))
}

/// The drawing with `caption` (HTML) below; nothing where fewer than two cameras stand apart.
pub(super) fn drawing(cameras: &[Shown<'_>], caption: &str) -> String {
    let centres: Vec<DVec3> = cameras.iter().map(|camera| camera.pose.centre()).collect();
    let Some((middle, reach)) = extent(&centres) else { return String::new() };
    let scale = 0.38 * HEIGHT / reach;
    let place = |point: DVec3| (point - middle) * scale;
    let mut svg = format!(
        "<div class=\"space\"><svg viewBox=\"{:.0} {:.0} {WIDTH} {HEIGHT}\" data-turn=\"{TURN}\" data-tilt=\"{TILT}\" \
         stroke-width=\"1.2\" role=\"img\" aria-label=\"The rig in space\">",
        -WIDTH / 2.0,
        -HEIGHT / 2.0
    );
    for camera in cameras {
        let i = camera.intrinsics;
        let depth = 0.22 * reach;
        let corner = |x: f64, y: f64| {
            let ray = DVec3::new((x - i.cx) / i.fx, (y - i.cy) / i.fy, 1.0) * depth;
            place(camera.pose.inverse().transform(ray))
        };
        let (width, height) = (f64::from(i.width), f64::from(i.height));
        let corners = [corner(0.0, 0.0), corner(width, 0.0), corner(width, height), corner(0.0, height)];
        let eye = place(camera.pose.centre());
        let mut points = Vec::new();
        for (index, at) in corners.iter().enumerate() {
            points.extend([eye, *at, *at, corners[(index + 1) % 4]]);
        }
        let drawn: Vec<DVec2> = points.iter().map(|point| flat(*point)).collect();
        let path: String = drawn
            .chunks(2)
            .map(|line| format!("M{:.1} {:.1}L{:.1} {:.1}", line[0].x, line[0].y, line[1].x, line[1].y))
            .collect();
        let data: Vec<String> = points.iter().map(|p| format!("[{:.1},{:.1},{:.1}]", p.x, p.y, p.z)).collect();
        let at = flat(eye);
        let _ = write!(
            svg,
            "<path class=\"{}\" d=\"{path}\" data-points=\"[{}]\"/><text class=\"tick\" text-anchor=\"middle\" \
             x=\"{:.1}\" y=\"{:.1}\" data-point=\"[{:.1},{:.1},{:.1}]\">{}</text>",
            camera.class,
            data.join(","),
            at.x,
            at.y - 6.0,
            eye.x,
            eye.y,
            eye.z,
            Escaped(camera.name)
        );
    }
    svg + &format!("</svg><p class=\"caption\">{caption}</p></div>\n<script>\n{}</script>\n", include_str!("rotate.js"))
}

/// As the script draws it at first.
fn flat(point: DVec3) -> DVec2 {
    let across = point.x * TURN.cos() + point.z * TURN.sin();
    let away = point.z * TURN.cos() - point.x * TURN.sin();
    DVec2::new(across, point.y * TILT.cos() - away * TILT.sin())
}
