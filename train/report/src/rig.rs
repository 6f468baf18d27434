//! A picture of the rig from above.

use std::fmt::Write as _;

use erfgs_dataset::{Camera, Manifest};
use glam::{DVec2, DVec3};

use super::{
    html::{Escaped, number},
    setting::role,
};

const WIDTH: f64 = 440.0;
const MARGIN: f64 = 34.0;

/// Cameras as wedges that open as wide as they see, from above.
pub(super) fn figure(dataset: &Manifest) -> String {
    let cameras: Vec<&Camera> = dataset.cameras.iter().filter(|camera| camera.world_to_camera.is_finite()).collect();
    let Some(map) = Map::new(&cameras) else { return String::new() };
    let mut svg = format!(
        "<figure class=\"rig\"><svg viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" aria-label=\"The rig from above\">",
        map.height
    );
    for camera in &cameras {
        let pose = camera.world_to_camera;
        let eye = map.place(pose.centre());
        let half = 0.5 * f64::from(camera.intrinsics.width) / camera.intrinsics.fx;
        let edge = |side: f64| {
            let direction = pose.rotation.conjugate() * DVec3::new(side * half, 0.0, 1.0);
            // In the plane: a camera that looks down has a short wedge.
            eye + map.direction(direction) * map.wedge
        };
        let (left, right) = (edge(-1.0), edge(1.0));
        let class = role(camera).split(' ').next().unwrap_or_default();
        let dot = match role(camera) {
            "held out" => format!("<circle class=\"held\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"4.5\"/>", eye.x, eye.y),
            "events" => {
                format!("<path class=\"events\" d=\"M{:.1} {:.1}l5.5 5.5l-5.5 5.5l-5.5 -5.5z\"/>", eye.x, eye.y - 5.5)
            }
            "RGB and events" => format!(
                "<rect class=\"both\" x=\"{:.1}\" y=\"{:.1}\" width=\"9\" height=\"9\"/>",
                eye.x - 4.5,
                eye.y - 4.5
            ),
            _ => format!("<circle class=\"rgb\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\"/>", eye.x, eye.y),
        };
        let away = (eye - map.middle).try_normalize().unwrap_or(DVec2::X) * DVec2::new(26.0, 15.0);
        let _ = write!(
            svg,
            "<g><title>{0}: {1}</title><path class=\"wedge {class}\" d=\"M{2:.1} {3:.1}L{4:.1} {5:.1}L{6:.1} {7:.1}Z\"/>{dot}\
             <text class=\"tick\" text-anchor=\"middle\" x=\"{8:.1}\" y=\"{9:.1}\">{0}</text></g>",
            Escaped(&camera.name),
            role(camera),
            eye.x,
            eye.y,
            left.x,
            left.y,
            right.x,
            right.y,
            eye.x + away.x,
            eye.y + away.y + 4.0
        );
    }
    let (length, pixels) = map.bar();
    let y = map.height - 8.0;
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M10 {:.1}v4h{pixels:.1}v-4\"/><text class=\"tick\" x=\"{:.1}\" y=\"{y:.1}\">{} m</text></svg>",
        y - 4.0,
        pixels + 16.0,
        number(length, usize::from(length < 1.0))
    );
    svg + "<figcaption>The rig from above: <span class=\"key rgb\">●</span> RGB, <span class=\"key events\">◆</span> events, \
           <span class=\"key both\">■</span> both, <span class=\"key held\">○</span> held out.</figcaption></figure>\n"
}

/// The ground plane and where it lies in the picture.
struct Map {
    across: DVec3,
    along: DVec3,
    low: DVec2,
    scale: f64,
    offset: DVec2,
    middle: DVec2,
    height: f64,
    /// Pixels of a wedge.
    wedge: f64,
}

impl Map {
    fn new(cameras: &[&Camera]) -> Option<Self> {
        let first = cameras.first()?.world_to_camera.rotation.conjugate();
        // Down in the pictures is, on average, down in the world.
        let sum: DVec3 = cameras.iter().map(|camera| camera.world_to_camera.rotation.conjugate() * DVec3::Y).sum();
        let down = sum.try_normalize().unwrap_or(first * DVec3::Y);
        let across =
            (first * DVec3::X).reject_from_normalized(down).try_normalize().unwrap_or(down.any_orthonormal_vector());
        let along = across.cross(down);
        let flat = |point: DVec3| DVec2::new(point.dot(across), -point.dot(along));
        let centres: Vec<DVec2> = cameras.iter().map(|camera| flat(camera.world_to_camera.centre())).collect();
        let low = centres.iter().copied().reduce(DVec2::min)?;
        let high = centres.iter().copied().reduce(DVec2::max)?;
        let wedge = if cameras.len() > 16 { 26.0 } else { 38.0 };
        let room = WIDTH - 2.0 * (MARGIN + wedge);
        let size = (high - low).max(DVec2::splat(1e-6));
        let scale = (room / size.x).min(room / size.y).min(room);
        let height = (size.y * scale + 2.0 * (MARGIN + wedge)).max(160.0);
        let offset = (DVec2::new(WIDTH, height) - (high - low) * scale) / 2.0;
        let middle = DVec2::new(WIDTH, height) / 2.0;
        Some(Self { across, along, low, scale, offset, middle, height, wedge })
    }

    fn direction(&self, direction: DVec3) -> DVec2 {
        DVec2::new(direction.dot(self.across), -direction.dot(self.along))
    }

    fn place(&self, point: DVec3) -> DVec2 {
        (self.direction(point) - self.low) * self.scale + self.offset
    }

    /// A length in metres for the scale bar, and its pixels.
    fn bar(&self) -> (f64, f64) {
        let most = 110.0 / self.scale;
        let magnitude = 10f64.powf(most.log10().floor());
        let length = [5.0, 2.0, 1.0].into_iter().map(|multiple| multiple * magnitude).find(|length| *length <= most);
        let length = length.unwrap_or(magnitude);
        (length, length * self.scale)
    }
}
