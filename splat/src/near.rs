//! How near to a camera there is something to see.

use crate::raster::View;

/// Fewer points than this in view say nothing.
const LEAST_POINTS: usize = 100;
/// The nearest hundredth of the points in view may be wrong.
const WRONG: usize = 100;

/// The near plane of `view`, metres: `share` of the depth before which the camera sees a hundredth of the initial
/// `points`, but at least `least`.
///
/// A camera beside a wall has Gaussians of the wall's colour before its lens, which all training cameras see in front of
/// that wall and cannot tell from it. A few of them veil the whole image: what lies well before everything that the
/// cloud knows is left out.
#[must_use]
pub fn near_plane<'a>(points: impl Iterator<Item = &'a [f32; 3]>, view: &View, share: f32, least: f32) -> f32 {
    let (width, height) = (view.width as f32, view.height as f32);
    let depth = |point: &[f32; 3]| {
        let [x, y, z] = view.to_camera(point);
        let (u, v) = (view.fx * x / z + view.cx, view.fy * y / z + view.cy);
        (z > 0.0 && u >= 0.0 && u < width && v >= 0.0 && v < height).then_some(z)
    };
    let mut depths: Vec<f32> = if share > 0.0 { points.filter_map(depth).collect() } else { Vec::new() };
    if depths.len() < LEAST_POINTS {
        return least;
    }
    let index = depths.len() / WRONG;
    let (_, nearest, _) = depths.select_nth_unstable_by(index, f32::total_cmp);
    least.max(share * *nearest)
}

/// The near plane of `view`, metres, beside cameras whose frames were `trained` on. One of these is rendered as it was trained; in front
/// of any other, event cameras without frames among them, lie Gaussians that no frame could see through or past: [`near_plane`].
#[must_use]
pub fn near_plane_beside<'a, 'b>(
    mut trained: impl Iterator<Item = &'a View>,
    points: impl Iterator<Item = &'b [f32; 3]>,
    view: &View,
    share: f32,
    least: f32,
) -> f32 {
    if trained.any(|camera| camera == view) { least } else { near_plane(points, view, share, least) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: View = View {
        width: 100,
        height: 100,
        fx: 100.0,
        fy: 100.0,
        cx: 50.0,
        cy: 50.0,
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
    };

    fn points(depths: impl IntoIterator<Item = f32>) -> Vec<[f32; 3]> {
        depths.into_iter().map(|z| [0.0, 0.0, z]).collect()
    }

    #[test]
    fn a_few_wrong_points_at_the_lens_do_not_count() {
        let wall = (0..1000).map(|i| 2.0 + 0.001 * i as f32);
        let near = near_plane(points([0.05, 0.1].into_iter().chain(wall)).iter(), &VIEW, 0.5, 0.2);
        assert!((near - 1.0).abs() < 0.01, "{near}");
    }

    #[test]
    fn points_beside_and_behind_the_view_do_not_count() {
        let mut cloud = points((0..200).map(|_| 4.0));
        cloud.extend((0..200).map(|_| [5.0, 0.0, 1.0]));
        cloud.extend(points((0..200).map(|_| -1.0)));
        assert_eq!(near_plane(cloud.iter(), &VIEW, 0.5, 0.2), 2.0);
    }

    #[test]
    fn without_enough_points_or_switched_off_the_least_counts() {
        assert_eq!(near_plane([].iter(), &VIEW, 0.5, 0.2), 0.2);
        assert_eq!(near_plane(points([3.0; 99]).iter(), &VIEW, 0.5, 0.2), 0.2);
        assert_eq!(near_plane(points([f32::NAN; 500]).iter(), &VIEW, 0.5, 0.2), 0.2);
        assert_eq!(near_plane(points([3.0; 500]).iter(), &VIEW, 0.0, 0.2), 0.2);
        assert_eq!(near_plane(points([0.1; 500]).iter(), &VIEW, 0.5, 0.2), 0.2);
    }
}
