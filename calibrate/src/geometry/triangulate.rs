//! A point from the rays that meet it.

use erfgs_scene::{Intrinsics, Pose};
use glam::{DMat3, DVec2, DVec3};

/// A ray in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts, metres.
    pub origin: DVec3,
    /// Where it goes, length 1.
    pub direction: DVec3,
}

impl Ray {
    /// The ray of a camera's pixel; `None` where the lens model has none.
    #[must_use]
    pub fn of_pixel(intrinsics: &Intrinsics, pose: &Pose, pixel: DVec2) -> Option<Self> {
        let direction = intrinsics.unproject(pixel).ok()?;
        Some(Self { origin: pose.centre(), direction: pose.rotation.conjugate() * direction })
    }
}

/// The point with the least sum of squared distances from the rays' lines; `None` where they are parallel or fewer than
/// two.
#[must_use]
pub fn nearest_point(rays: &[Ray]) -> Option<DVec3> {
    if rays.len() < 2 {
        return None;
    }
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for Ray { origin, direction: d } in rays {
        let across = DMat3::IDENTITY - DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z);
        matrix += across;
        right += across * *origin;
    }
    let point = matrix.inverse() * right;
    // The determinant is about the squared angle between the rays.
    (matrix.determinant() > 1e-10 && point.is_finite()).then_some(point)
}

/// One view of a point: lens, world-to-camera pose, pixel, standard deviation in pixels.
type PixelView<'a> = (&'a Intrinsics, &'a Pose, DVec2, f64);

/// The point whose images are nearest to the views' pixels in units of their standard deviations, and its covariance in
/// square metres (Gauss-Newton from [`nearest_point`]). `None` where the rays are parallel or the iteration fails.
#[must_use]
pub fn triangulate(views: &[PixelView<'_>]) -> Option<(DVec3, DMat3)> {
    let rays: Option<Vec<Ray>> = views.iter().map(|(lens, pose, pixel, _)| Ray::of_pixel(lens, pose, *pixel)).collect();
    let mut point = nearest_point(&rays?)?;
    for _ in 0..20 {
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (lens, pose, pixel, sigma) in views {
            let projection = lens.project_with_derivatives(pose.transform(point))?;
            let residual = (*pixel - projection.pixel) / *sigma;
            for axis in 0..2 {
                let row = pose.rotation.conjugate() * projection.by_point[axis] / *sigma;
                matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
                right += row * residual[axis];
            }
        }
        let covariance = matrix.inverse();
        let step = covariance * right;
        if !step.is_finite() {
            return None;
        }
        point += step;
        if step.length() < 1e-9 {
            return Some((point, covariance));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use erfgs_scene::Distortion;

    use super::*;

    #[test]
    fn rays_that_meet_give_their_point_and_parallel_ones_none() {
        let point = DVec3::new(0.3, -0.2, 2.0);
        let ray = |origin: DVec3| Ray { origin, direction: (point - origin).normalize() };
        let found = nearest_point(&[ray(DVec3::ZERO), ray(DVec3::X), ray(DVec3::Y)]).unwrap();
        assert!((found - point).length() < 1e-12);
        let along = |origin: DVec3| Ray { origin, direction: DVec3::Z };
        assert_eq!(nearest_point(&[along(DVec3::ZERO), along(DVec3::X)]), None);
        assert_eq!(nearest_point(&[ray(DVec3::ZERO)]), None);
    }

    #[test]
    fn a_point_comes_back_from_its_images() {
        let distortion = Distortion::BrownConrady([-0.1, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let lens = Intrinsics { width: 640, height: 480, fx: 600.0, fy: 610.0, cx: 320.0, cy: 240.0, distortion };
        let point = DVec3::new(0.1, -0.05, 0.2);
        let poses = [-0.8, 0.1, 0.7].map(|x| Pose::look_at(DVec3::new(x, 0.2, -2.0), DVec3::ZERO, DVec3::Y));
        let views: Vec<_> =
            poses.iter().map(|pose| (&lens, pose, lens.project(pose.transform(point)).unwrap(), 0.5)).collect();
        let (found, covariance) = triangulate(&views).unwrap();
        assert!((found - point).length() < 1e-9);
        // Half a pixel at 2.2 m and a focal length of 600: 1.8 mm across in one view.
        let sigma = covariance.col(0).x.sqrt();
        assert!((0.5e-3..2.5e-3).contains(&sigma), "{sigma}");
    }
}
