//! Cameras in space: a frustum for each, with the world's axes, a scale, and boards; to be turned by dragging.

use erfgs_page::html::Escaped;
use erfgs_scene::{Intrinsics, Modality, Pose};
use glam::{DVec2, DVec3};

use super::round_down;

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

/// What is drawn.
pub(super) struct Scene<'a> {
    /// The cameras.
    pub cameras: &'a [Shown<'a>],
    /// Outlines of boards.
    pub outlines: &'a [[DVec3; 4]],
    /// Whether the unit is the metre; without it there are no axes and no scale.
    pub metric: Option<bool>,
}

/// The drawing with `caption` (HTML) below; nothing where fewer than two cameras stand apart.
pub(super) fn drawing(scene: &Scene<'_>, caption: &str) -> String {
    let cameras = scene.cameras;
    let centres: Vec<DVec3> = cameras.iter().map(|camera| camera.pose.centre()).collect();
    let Some((_, reach)) = extent(&centres) else { return String::new() };
    // Boards lie before the cameras, often farther from them than they are from each other.
    let near = |corner: &&DVec3| corner.is_finite() && corner.distance(centres[0]) < 20.0 * reach;
    let shown: Vec<DVec3> = centres.iter().chain(scene.outlines.iter().flatten().filter(near)).copied().collect();
    let [low, high] =
        shown.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &at| [low.min(at), high.max(at)]);
    let middle = 0.5 * (low + high);
    let far = shown.iter().map(|at| at.distance(middle)).fold(reach, f64::max);
    let (scale, reach) = (0.45 * HEIGHT / far, reach.max(0.4 * far));
    let place = |point: DVec3| (point - middle) * scale;
    let mut svg = format!(
        "<div class=\"space\"><svg viewBox=\"{:.0} {:.0} {WIDTH} {HEIGHT}\" data-turn=\"{TURN}\" data-tilt=\"{TILT}\" \
         stroke-width=\"1.2\" role=\"img\" aria-label=\"The rig in space\">",
        -WIDTH / 2.0,
        -HEIGHT / 2.0
    );
    for [a, b, c, d] in scene.outlines {
        let edges = [*a, *b, *b, *c, *c, *d, *d, *a].map(place);
        if edges.iter().all(|edge| edge.is_finite() && edge.length() < 2.0 * WIDTH) {
            svg += &lines("board", &edges);
        }
    }
    if scene.metric.is_some() {
        // Longer than a camera that stands in the origin is deep.
        let length = 0.45 * reach;
        for (class, axis) in ["x", "y", "z"].into_iter().zip(DVec3::AXES) {
            svg += &lines(&format!("axis-{class}"), &[place(DVec3::ZERO), place(axis * length)]);
            svg += &label(place(axis * length), "middle", class);
        }
    }
    let across = centres.iter().map(|centre| flat(place(*centre)).x).sum::<f64>() / centres.len() as f64;
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
        svg += &lines(camera.class, &points);
        // On the side that is away from the other cameras, and from the axes of a camera that is the world.
        let (at, anchor) = if flat(eye).x < across { (corners[0], "end") } else { (corners[1], "start") };
        svg += &label(at, anchor, camera.name);
    }
    if let Some(metric) = scene.metric {
        svg += &scale_bar(scale, metric);
    }
    svg + &format!("</svg><p class=\"caption\">{caption}</p></div>\n<script>\n{}</script>\n", include_str!("rotate.js"))
}

/// Lines between every two points, which turn with the picture.
fn lines(class: &str, points: &[DVec3]) -> String {
    let drawn: Vec<DVec2> = points.iter().map(|point| flat(*point)).collect();
    let path: String = drawn
        .chunks(2)
        .map(|line| format!("M{:.1} {:.1}L{:.1} {:.1}", line[0].x, line[0].y, line[1].x, line[1].y))
        .collect();
    let data: Vec<String> = points.iter().map(|p| format!("[{:.1},{:.1},{:.1}]", p.x, p.y, p.z)).collect();
    format!("<path class=\"{class}\" d=\"{path}\" data-points=\"[{}]\"/>", data.join(","))
}

/// A word above a point, which is at its start, middle or end and turns with the picture.
fn label(at: DVec3, anchor: &str, text: &str) -> String {
    let drawn = flat(at);
    format!(
        "<text class=\"tick\" text-anchor=\"{anchor}\" x=\"{:.1}\" y=\"{:.1}\" data-point=\"[{:.1},{:.1},{:.1}]\">{}</text>",
        drawn.x,
        drawn.y - 6.0,
        at.x,
        at.y,
        at.z,
        Escaped(text)
    )
}

/// A bar of a round length, below on the left; as everything that lies in the plane of the picture, it does not turn.
fn scale_bar(scale: f64, metric: bool) -> String {
    let length = round_down(0.25 * WIDTH / scale);
    let long = length * scale;
    let (x, y) = (-WIDTH / 2.0 + 16.0, HEIGHT / 2.0 - 14.0);
    let text = match (metric, length) {
        (false, length) => format!("{length} units"),
        (true, length) if length < 0.01 => format!("{} mm", (1e6 * length).round() / 1e3),
        (true, length) if length < 1.0 => format!("{} cm", (1e5 * length).round() / 1e3),
        (true, length) => format!("{length} m"),
    };
    format!(
        "<g class=\"scale\"><line x1=\"{x}\" x2=\"{:.1}\" y1=\"{y}\" y2=\"{y}\"/><line x1=\"{x}\" x2=\"{x}\" y1=\"{}\" \
         y2=\"{y}\"/><line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{1}\" y2=\"{y}\"/></g><text class=\"tick bar\" x=\"{x}\" y=\"{2}\">\
         {text}</text>",
        x + long,
        y - 6.0,
        y - 10.0
    )
}

/// As the script draws it at first.
fn flat(point: DVec3) -> DVec2 {
    let across = point.x * TURN.cos() + point.z * TURN.sin();
    let away = point.z * TURN.cos() - point.x * TURN.sin();
    DVec2::new(across, point.y * TILT.cos() - away * TILT.sin())
}

#[cfg(test)]
mod tests {
    use erfgs_scene::Distortion;

    use super::*;

    #[test]
    fn the_scale_bar_is_as_long_as_it_says_and_axes_and_boards_are_drawn() {
        let intrinsics =
            Intrinsics { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, distortion: Distortion::None };
        let shown = |name, x: f64| Shown {
            name,
            class: "RGB",
            intrinsics: &intrinsics,
            pose: Pose { translation: DVec3::new(-x, 0.0, 0.0), ..Pose::IDENTITY },
        };
        let cameras = [shown("a", -0.5), shown("b", 0.5)];
        let board = [DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.2, 0.0, 1.0), DVec3::new(0.2, 0.1, 1.0), DVec3::Z];
        let scene = Scene { cameras: &cameras, outlines: &[board], metric: Some(true) };
        let svg = drawing(&scene, "c");
        for part in ["axis-x", "axis-z", "class=\"board\"", "class=\"scale\""] {
            assert!(svg.contains(part), "{part}");
        }
        // The farthest thing is a board's corner, sqrt(1.05) m from the middle: 160 pixels are 0.93 m.
        assert!(svg.contains(">50 cm</text>"), "{svg}");
        let apart = |scene: &Scene<'_>| drawing(scene, "c").contains("axis-x");
        assert!(!apart(&Scene { metric: None, ..scene }));
    }
}
