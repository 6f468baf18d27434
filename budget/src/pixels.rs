//! How far errors of cameras move what they see.

use erfgs_dataset::{Camera, Dataset, Split};
use erfgs_scene::PointCloud;
use glam::{DVec2, DVec3};

/// Less than this is rounding.
const LEAST_PX: f64 = 1e-6;

/// The root mean square of how far `points` are, in the images of `to`'s training cameras, from where the same cameras of `from` see
/// them, pixels; none where no point is seen, or nothing moved.
#[must_use]
pub fn moved_px(from: &Dataset, to: &Dataset, points: &PointCloud) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0_u64);
    for camera in to.cameras(Split::Train) {
        let Some(before) = from.camera(&camera.name) else { continue };
        for position in &points.positions {
            let point = DVec3::from(position.map(f64::from));
            if let Some((here, there)) = seen(before, point).zip(seen(camera, point)) {
                sum += (here - there).length_squared();
                count += 1;
            }
        }
    }
    let moved = (sum / count as f64).sqrt();
    (moved > LEAST_PX).then_some(moved)
}

/// Where a camera sees a point; none where it does not.
fn seen(camera: &Camera, point: DVec3) -> Option<DVec2> {
    let there = camera.world_to_camera.transform(point);
    let pixel = (there.z > 1e-6).then(|| camera.intrinsics.project(there)).flatten()?;
    let inside = pixel.cmpge(DVec2::ZERO).all()
        && pixel.x <= f64::from(camera.intrinsics.width)
        && pixel.y <= f64::from(camera.intrinsics.height);
    inside.then_some(pixel)
}
