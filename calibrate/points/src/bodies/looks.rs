//! How well a motion agrees with what is seen: by the shape that silhouettes leave if a thing moves so.
//!
//! If the motion is right, the shape has the same colours in all frames, lies inside all silhouettes and fills them. Hulls of single
//! instants have fewer numbers to be wrong with, but a wrong motion can agree with them better than the right one.

use glam::DVec3;

use super::{
    carve::Carved,
    film::MOST_APART,
    grow::{Grower, Pose},
};

/// What it costs that none of the silhouettes is filled, beside colours (at most 200).
const BARE_COSTS: f64 = 120.0;
/// The shape is carved in cells so large, spacings of hull points and radii: twice as large as that of a body.
const CELL: [f64; 2] = [0.7, 0.09];
/// What is filled is told by a raster of so many cells a side, each as wide as so many cells of the shape at least, and by so many points
/// of a hull at most.
const RASTER: usize = 40;
const RASTER_CELLS: f64 = 1.5;
const MOST_POINTS: usize = 120;
/// So many instants are looked at, at most.
const MOST_INSTANTS: usize = 25;

impl Grower<'_> {
    /// So many shapes before and after the best, as many as there are, in order; some of them if there are many.
    pub fn around(&self, reach: usize) -> Vec<usize> {
        let from = self.best.saturating_sub(reach);
        let to = (self.best + reach).min(self.shapes.len().saturating_sub(1));
        let step = (to + 1 - from).div_ceil(MOST_INSTANTS);
        (from..=to).filter(|at| at.abs_diff(self.best).is_multiple_of(step)).collect()
    }

    /// How badly its motion agrees with some of its shapes: how far colours are apart in the mean, and what is not filled.
    pub fn disagreement(&self, known: &[usize]) -> f64 {
        let poses = self.all_assumed();
        let cell_m = (CELL[0] * self.film.cell_m).max(CELL[1] * self.radius_m);
        let Some(carved) = self.carve_cells(&poses, known, cell_m) else { return MOST_APART + BARE_COSTS };
        let apart: f64 = known.iter().map(|&at| self.apart(&carved.points, at, poses[at])).sum();
        apart / known.len().max(1) as f64 + BARE_COSTS * self.bare(&carved, known, &poses)
    }

    /// The share of what cameras see of its hulls that a shape does not fill while the shutter is open.
    fn bare(&self, carved: &Carved, known: &[usize], poses: &[Pose]) -> f64 {
        let (mut bare, mut all) = (0_u32, 0_u32);
        let mut filled = vec![false; RASTER * RASTER];
        for &at in known {
            let shape = &self.shapes[at];
            let step = shape.places.len().div_ceil(MOST_POINTS).max(1);
            let ends = self.exposed(at, poses[at]);
            for view in &self.film.moments[shape.moment].views {
                let eye = &self.film.eyes[view.eye];
                let Some((middle, depth_m)) = eye.see(shape.centre) else { continue };
                let wide_m = (4.0 * self.radius_m / RASTER as f64).max(RASTER_CELLS * carved.cell_m);
                let wide_px = (wide_m * eye.intrinsics.fx / depth_m).max(1.0);
                let cell = |place: DVec3| {
                    let at = ((eye.see(place)?.0 - middle) / wide_px).floor() + RASTER as f64 * 0.5;
                    let inside = at.min_element() >= 0.0 && at.max_element() < RASTER as f64;
                    inside.then(|| at.y as usize * RASTER + at.x as usize)
                };
                filled.fill(false);
                for (centre, rotation) in ends {
                    let places = carved.points.iter().map(|point| rotation * DVec3::from(point.position_m) + centre);
                    places.filter_map(cell).for_each(|at| filled[at] = true);
                }
                for at in shape.places.iter().step_by(step).filter_map(|&about| cell(shape.centre + about)) {
                    all += 1;
                    bare += u32::from(!filled[at]);
                }
            }
        }
        f64::from(bare) / f64::from(all.max(1))
    }
}
