//! The rig in space: a frustum for each camera, to be turned by dragging.

use std::fmt::Write as _;

use erfgs_session::{Modality, page::html::Escaped};
use glam::{DVec2, DVec3};

use crate::rig_file::{RigCamera, RigFile};

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 420.0;
/// From where it is seen at first, radians.
const TURN: f64 = 0.5;
const TILT: f64 = 0.5;

pub(super) fn picture(rig: &RigFile) -> String {
    let posed: Vec<&RigCamera> = rig.cameras.iter().filter(|camera| camera.pose.is_some()).collect();
    let centres: Vec<DVec3> = posed.iter().filter_map(|camera| camera.pose).map(|pose| pose.centre()).collect();
    if centres.len() < 2 {
        return String::new();
    }
    let middle = centres.iter().sum::<DVec3>() / centres.len() as f64;
    let reach = centres.iter().map(|centre| centre.distance(middle)).fold(0.0, f64::max);
    if reach <= 0.0 || !reach.is_finite() {
        return String::new();
    }
    let scale = 0.38 * HEIGHT / reach;
    let place = |point: DVec3| (point - middle) * scale;
    let mut svg = format!(
        "<div class=\"space\"><svg viewBox=\"{:.0} {:.0} {WIDTH} {HEIGHT}\" data-turn=\"{TURN}\" data-tilt=\"{TILT}\" \
         stroke-width=\"1.2\" role=\"img\" aria-label=\"The rig in space\">",
        -WIDTH / 2.0,
        -HEIGHT / 2.0
    );
    for (camera, pose) in posed.iter().filter_map(|camera| Some((camera, camera.pose?))) {
        let class = match camera.modality {
            Modality::Rgb => "RGB",
            Modality::Event => "events",
            Modality::Both => "both",
        };
        let i = &camera.intrinsics;
        let depth = 0.22 * reach;
        let corner = |x: f64, y: f64| {
            let ray = DVec3::new((x - i.cx) / i.fx, (y - i.cy) / i.fy, 1.0) * depth;
            place(pose.inverse().transform(ray))
        };
        let (width, height) = (f64::from(i.width), f64::from(i.height));
        let corners = [corner(0.0, 0.0), corner(width, 0.0), corner(width, height), corner(0.0, height)];
        let eye = place(pose.centre());
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
            "<path class=\"{class}\" d=\"{path}\" data-points=\"[{}]\"/><text class=\"tick\" text-anchor=\"middle\" \
             x=\"{:.1}\" y=\"{:.1}\" data-point=\"[{:.1},{:.1},{:.1}]\">{}</text>",
            data.join(","),
            at.x,
            at.y - 6.0,
            eye.x,
            eye.y,
            eye.z,
            Escaped(&camera.name)
        );
    }
    let unit = if rig.metric { format!("; the farthest is {reach:.2} m from their middle") } else { String::new() };
    svg + &format!(
        "</svg><p class=\"caption\">Drag to turn. Blue: RGB; orange: events{unit}.</p></div>\n<script>\n{}</script>\n",
        include_str!("rotate.js")
    )
}

/// As the script draws it at first.
fn flat(point: DVec3) -> DVec2 {
    let across = point.x * TURN.cos() + point.z * TURN.sin();
    let away = point.z * TURN.cos() - point.x * TURN.sin();
    DVec2::new(across, point.y * TILT.cos() - away * TILT.sin())
}
