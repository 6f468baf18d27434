//! One observation: its residual and what it depends on.

use erfgs_scene::lens::INTRINSIC_PARAMETERS;
use glam::{DVec2, DVec3};

use super::{
    BundleCamera, Observation, Placement, Side,
    parameter::{COLUMNS, PARAMETERS},
};

/// A weighed residual (in standard deviations) and its derivatives.
pub(super) struct Row {
    pub residual: DVec2,
    /// By the camera's free parameters, in order, and zeros behind them.
    pub by_camera: [[f64; PARAMETERS]; 2],
    /// By the placement's parameters.
    pub by_placement: [[f64; 6]; 2],
    /// By those of the target's side, zero where it is fixed.
    pub by_side: [[f64; 6]; 2],
}

/// `side` is that of the observation. `None` where the camera cannot see the feature.
pub(super) fn row(
    camera: &BundleCamera,
    placement: &Placement,
    side: Option<&Side>,
    observation: &Observation,
) -> Option<Row> {
    let on_placement = side.map_or(observation.on_target, |side| side.pose.transform(observation.on_target));
    let world = placement.world(on_placement);
    let seen = camera.pose.transform(world);
    let projection = camera.intrinsics.project_with_derivatives(seen)?;
    let weight = 1.0 / observation.sigma_px;
    let residual = projection.pixel - observation.pixel + observation.velocity * camera.time_offset_s;
    let parameters = placement.parameters();
    let mut row = Row {
        residual: residual * weight,
        by_camera: [[0.0; PARAMETERS]; 2],
        by_placement: [[0.0; 6]; 2],
        by_side: [[0.0; 6]; 2],
    };
    let by_world = placement.derivatives(on_placement);
    let by_side = side.filter(|side| side.free).map(|side| {
        let place = |by: DVec3| placement.direction(by);
        side.derivatives(observation.on_target).map(place)
    });
    for axis in 0..2 {
        let by_point = projection.by_point[axis];
        if !camera.free.is_empty() {
            let mut columns = [0.0; COLUMNS];
            columns[..INTRINSIC_PARAMETERS].copy_from_slice(&projection.by_intrinsics[axis]);
            for (index, unit) in DVec3::AXES.into_iter().enumerate() {
                columns[INTRINSIC_PARAMETERS + index] = by_point.dot(unit.cross(seen));
                columns[INTRINSIC_PARAMETERS + 3 + index] = by_point[index];
            }
            columns[COLUMNS - 1] = observation.velocity[axis];
            for (to, parameter) in row.by_camera[axis].iter_mut().zip(&camera.free) {
                *to = weight * parameter.derivative(&columns, &camera.intrinsics);
            }
        }
        let in_world = camera.pose.rotation.conjugate() * by_point;
        for (to, by) in row.by_placement[axis].iter_mut().zip(&by_world[..parameters]) {
            *to = weight * in_world.dot(*by);
        }
        for (to, by) in row.by_side[axis].iter_mut().zip(by_side.iter().flatten()) {
            *to = weight * in_world.dot(*by);
        }
    }
    Some(row)
}
