//! Points on the true surfaces, for tests: what a perfect initial point cloud would hold.

use erfgs_base::random;
use erfgs_scene::PointCloud;

use super::{
    actors::{Actors, Moment},
    colour::to_u8,
    seconds,
    view::StageView,
};

const PURPOSE: u64 = random::purpose("stage truth points");

/// `count` points that `view` sees at `t_ns`, uniform over its image, with their display colours.
#[must_use]
pub fn truth_points(view: &StageView<'_>, t_ns: i64, count: usize, seed: u64) -> PointCloud {
    let moment = Moment::at(view.stage, seconds(t_ns), Actors::ALL);
    let (width, height) = (f64::from(view.intrinsics.width), f64::from(view.intrinsics.height));
    let mut cloud = PointCloud::default();
    for index in 0..count {
        let key = random::key(seed, &[PURPOSE, index as u64]);
        let place = [width * random::uniform(random::extend(key, 0)), height * random::uniform(random::extend(key, 1))];
        if let Some((point, colour)) = view.probe(place, &moment) {
            cloud.positions.push(point.as_vec3().to_array());
            cloud.colours.push(to_u8(colour));
        }
    }
    cloud
}
