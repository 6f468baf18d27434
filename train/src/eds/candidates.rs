//! Points on the rays of pixels with events, seen to move by every event camera.

use rayon::prelude::*;

use crate::{
    config::{EdsConfig, Uniqueness},
    scene::{Scene, project},
};
use erfgs_splat::raster::View;

/// What one source camera gave.
pub(super) struct Found {
    /// Rays of pixels with events.
    pub rays: usize,
    /// At most one point for each ray, metres.
    pub points: Vec<[f32; 3]>,
}

/// Casts the rays of event view `source` and keeps what all event views agree on.
pub(super) fn find(
    scene: &Scene,
    activity: &[Option<Vec<f32>>],
    source: usize,
    movers: &[[f32; 3]],
    config: &EdsConfig,
) -> Found {
    let view = &scene.views[scene.events[source].view].view;
    let (Some(range), Some(active)) = (depth_range(view, movers), &activity[source]) else {
        return Found { rays: 0, points: Vec::new() };
    };
    let stride = config.stride as usize;
    let (width, height) = (view.width as usize, view.height as usize);
    let pixels: Vec<(usize, usize)> = (0..height)
        .step_by(stride)
        .flat_map(|y| (0..width).step_by(stride).map(move |x| (x, y)))
        .filter(|&(x, y)| active[y * width + x] >= config.min_events)
        .collect();
    let points = pixels.par_iter().filter_map(|&(x, y)| {
        let ray = [(x as f32 + 0.5 - view.cx) / view.fx, (y as f32 + 0.5 - view.cy) / view.fy, 1.0];
        let unique = match config.uniqueness {
            Uniqueness::OnlyRun => only_run,
            Uniqueness::SmallestDepth => nearest,
        };
        unique(config.depths, &|step| {
            let share = step as f32 / (config.depths - 1) as f32;
            let depth = range[0] + share * (range[1] - range[0]);
            let point = to_world(view, &ray.map(|axis| axis * depth));
            seen_to_move(scene, activity, &point, config).then_some(point)
        })
    });
    Found { rays: pixels.len(), points: points.collect() }
}

/// The 1st to 99th percentile of the depths of the points that `view` sees.
fn depth_range(view: &View, points: &[[f32; 3]]) -> Option<[f32; 2]> {
    let mut depths: Vec<f32> =
        points.iter().filter(|point| project(view, point).is_some()).map(|point| view.to_camera(point)[2]).collect();
    if depths.is_empty() {
        return None;
    }
    depths.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| depths[((depths.len() - 1) as f64 * share).round() as usize];
    Some([at(0.01), at(0.99)])
}

/// Whether the event cameras that recorded then saw events where the point is in their images.
fn seen_to_move(scene: &Scene, activity: &[Option<Vec<f32>>], point: &[f32; 3], config: &EdsConfig) -> bool {
    let mut seen = 0;
    for (events, activity) in scene.events.iter().zip(activity) {
        let Some(activity) = activity else { continue };
        let view = &scene.views[events.view].view;
        match project(view, point) {
            Some(pixel) if active(activity, view, pixel, config) => seen += 1,
            None if !config.all_must_see => {}
            _ => return false,
        }
    }
    config.all_must_see || seen >= 2
}

/// Whether there are events around a pixel.
fn active(activity: &[f32], view: &View, pixel: usize, config: &EdsConfig) -> bool {
    let (width, height, reach) = (view.width as usize, view.height as usize, config.tolerance_px as usize);
    let (x, y) = (pixel % width, pixel / width);
    (y.saturating_sub(reach)..=(y + reach).min(height - 1)).any(|y| {
        let row = &activity[y * width..(y + 1) * width];
        row[x.saturating_sub(reach)..=(x + reach).min(width - 1)].iter().any(|&events| events >= config.min_events)
    })
}

/// The first step for which `test` gives a point.
fn nearest(steps: u32, test: &dyn Fn(u32) -> Option<[f32; 3]>) -> Option<[f32; 3]> {
    (0..steps).find_map(test)
}

/// The middle of the one run of steps for which `test` gives a point; nothing where there is no run, or more than one.
fn only_run(steps: u32, test: &dyn Fn(u32) -> Option<[f32; 3]>) -> Option<[f32; 3]> {
    let mut run: Vec<[f32; 3]> = Vec::new();
    let mut ended = false;
    for step in 0..steps {
        match test(step) {
            Some(_) if ended => return None,
            Some(point) => run.push(point),
            None => ended = !run.is_empty(),
        }
    }
    run.get(run.len() / 2).copied()
}

fn to_world(view: &View, camera: &[f32; 3]) -> [f32; 3] {
    let (r, t) = (&view.rotation, &view.translation);
    let moved: [f32; 3] = std::array::from_fn(|k| camera[k] - t[k]);
    std::array::from_fn(|k| r[0][k] * moved[0] + r[1][k] * moved[1] + r[2][k] * moved[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_with_two_runs_is_ambiguous() {
        let run = |pattern: &'static [u8]| {
            only_run(pattern.len() as u32, &|step| (pattern[step as usize] == 1).then_some([step as f32, 0.0, 0.0]))
        };
        assert_eq!(run(&[0, 1, 1, 1, 0]), Some([2.0, 0.0, 0.0]));
        assert_eq!(run(&[0, 1, 0, 1, 0]), None);
        assert_eq!(run(&[0, 0, 0]), None);
    }

    #[test]
    fn the_nearest_depth_is_taken_where_it_is_asked_for() {
        let pattern = [0, 0, 1, 0, 1];
        let at = |step: u32| (pattern[step as usize] == 1).then_some([step as f32, 0.0, 0.0]);
        assert_eq!(nearest(5, &at), Some([2.0, 0.0, 0.0]));
        assert_eq!(nearest(2, &at), None);
    }

    #[test]
    fn events_beside_a_pixel_count_within_the_tolerance_and_not_around_the_edge() {
        let view = View {
            width: 4,
            height: 3,
            fx: 1.0,
            fy: 1.0,
            cx: 0.0,
            cy: 0.0,
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
        };
        let mut activity = vec![0.0; 12];
        activity[4] = 2.0;
        let seen = |pixel: usize, tolerance_px: u32| {
            let eds = EdsConfig { tolerance_px, ..crate::config::Config::default().eds };
            active(&activity, &view, pixel, &eds)
        };
        assert!(seen(4, 0) && !seen(5, 0) && seen(5, 1) && seen(0, 1) && seen(9, 1) && !seen(6, 1) && seen(6, 2));
        assert!(!seen(3, 1), "the end of the row before is not its neighbour");
    }

    #[test]
    fn a_camera_point_returns_to_where_it_came_from() {
        let view = View {
            width: 10,
            height: 10,
            fx: 10.0,
            fy: 10.0,
            cx: 5.0,
            cy: 5.0,
            rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.1, 0.2, 0.3],
        };
        let world = [0.5, -0.25, 2.0];
        let back = to_world(&view, &view.to_camera(&world));
        assert!(back.iter().zip(&world).all(|(a, b)| (a - b).abs() < 1e-6), "{back:?}");
    }
}
