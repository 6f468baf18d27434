//! The planes on the host: features of points, and their gradients.
//!
//! All rows of a pass share one time, so that the two rows of a time plane between which it falls are blended once, into
//! a line over the plane's other axis. A point then reads four cells of each spatial plane and two of each line.

use crate::field::{Layout, layout::locate};

/// The planes of a level at one time: values and sizes.
pub struct LevelView<'a> {
    /// The spatial planes xy, xz, yz.
    planes: [&'a [f32]; 3],
    /// The blended time planes over x, y, z.
    lines: [&'a [f32]; 3],
    /// Cells along x, y, z.
    cells: [usize; 3],
}

/// Where each of the six planes of a level lies in `planes` (spatial) or `lines` (time) of a [`LevelView`].
pub const SPATIAL: [usize; 3] = [0, 1, 3];
/// See [`SPATIAL`].
pub const TEMPORAL: [usize; 3] = [2, 4, 5];
/// Axes along columns and rows of the spatial planes.
const SPATIAL_AXES: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

/// Blends the time planes at a row and weight (see [`Layout::time_row`]) into lines, level by level, x, y, z.
pub fn blend_lines(layout: &Layout, parameters: &[f32], (row, weight): (usize, f32)) -> Vec<Vec<f32>> {
    layout
        .planes
        .iter()
        .filter(|plane| plane.is_time())
        .map(|plane| {
            let length = plane.cols * layout.config.features as usize;
            let rows = &parameters[plane.offset + row * length..][..2 * length];
            let (low, high) = rows.split_at(length);
            low.iter().zip(high).map(|(low, high)| low + weight * (high - low)).collect()
        })
        .collect()
}

/// The levels of a field, at the time of `lines`.
pub fn level_views<'a>(layout: &Layout, parameters: &'a [f32], lines: &'a [Vec<f32>]) -> Vec<LevelView<'a>> {
    let features = layout.config.features as usize;
    layout
        .planes
        .chunks_exact(6)
        .zip(lines.chunks_exact(3))
        .map(|(planes, lines)| LevelView {
            planes: SPATIAL.map(|index| {
                let plane = &planes[index];
                &parameters[plane.offset..plane.offset + plane.rows * plane.cols * features]
            }),
            lines: [&lines[0], &lines[1], &lines[2]],
            cells: TEMPORAL.map(|index| planes[index].cols),
        })
        .collect()
}

fn feature<const F: usize>(values: &[f32], at: usize) -> &[f32; F] {
    values[at..].first_chunk().expect("cells lie within their plane")
}

/// Features of one point (coordinates in the box, 0 to 1; outside clamped): `[level, feature]`.
pub fn gather<const F: usize>(levels: &[LevelView<'_>], point: &[f32; 3], out: &mut [f32]) {
    for (level, out) in levels.iter().zip(out.chunks_exact_mut(F)) {
        let at: [(usize, f32); 3] = std::array::from_fn(|axis| locate(point[axis], level.cells[axis]));
        let mut product = [1.0_f32; F];
        for (plane, axes) in level.planes.iter().zip(SPATIAL_AXES) {
            let [(col, x), (row, y)] = axes.map(|axis| at[axis]);
            let cols = level.cells[axes[0]];
            let base = (row * cols + col) * F;
            let below = (feature::<F>(plane, base), feature::<F>(plane, base + F));
            let above = (feature::<F>(plane, base + cols * F), feature::<F>(plane, base + (cols + 1) * F));
            for (f, product) in product.iter_mut().enumerate() {
                let low = below.0[f] + x * (below.1[f] - below.0[f]);
                let high = above.0[f] + x * (above.1[f] - above.0[f]);
                *product *= low + y * (high - low);
            }
        }
        for (line, (cell, weight)) in level.lines.iter().zip(at) {
            let (low, high) = (feature::<F>(line, cell * F), feature::<F>(line, (cell + 1) * F));
            for (product, (low, high)) in product.iter_mut().zip(low.iter().zip(high)) {
                *product *= low + weight * (high - low);
            }
        }
        out.copy_from_slice(&product);
    }
}

/// The gradient of one point. `d_features` is that of its features; `d_planes` gets that of every plane's value there,
/// `[level, plane, feature]`. Returns that of the coordinates, 0 along an axis where the point is not inside the box.
pub fn pull<const F: usize>(
    levels: &[LevelView<'_>],
    point: &[f32; 3],
    d_features: &[f32],
    d_planes: &mut [f32],
) -> [f32; 3] {
    let mut d_point = [0.0_f32; 3];
    for ((level, d_features), d_planes) in
        levels.iter().zip(d_features.chunks_exact(F)).zip(d_planes.chunks_exact_mut(6 * F))
    {
        let d_features: &[f32; F] = feature(d_features, 0);
        let at: [(usize, f32); 3] = std::array::from_fn(|axis| locate(point[axis], level.cells[axis]));
        // Value of each plane, and its slopes along the axes that it spans.
        let mut value = [[0.0_f32; F]; 6];
        let mut slope = [[[0.0_f32; F]; 2]; 6];
        for (which, plane) in level.planes.iter().enumerate() {
            let axes = SPATIAL_AXES[which];
            let [(col, x), (row, y)] = axes.map(|axis| at[axis]);
            let cols = level.cells[axes[0]];
            let base = (row * cols + col) * F;
            let below = (feature::<F>(plane, base), feature::<F>(plane, base + F));
            let above = (feature::<F>(plane, base + cols * F), feature::<F>(plane, base + (cols + 1) * F));
            let index = SPATIAL[which];
            for f in 0..F {
                let (rise_low, rise_high) = (below.1[f] - below.0[f], above.1[f] - above.0[f]);
                let low = below.0[f] + x * rise_low;
                let high = above.0[f] + x * rise_high;
                value[index][f] = low + y * (high - low);
                slope[index][0][f] = rise_low + y * (rise_high - rise_low);
                slope[index][1][f] = high - low;
            }
        }
        for (axis, line) in level.lines.iter().enumerate() {
            let (cell, weight) = at[axis];
            let (low, high) = (feature::<F>(line, cell * F), feature::<F>(line, (cell + 1) * F));
            let index = TEMPORAL[axis];
            for f in 0..F {
                value[index][f] = low[f] + weight * (high[f] - low[f]);
                slope[index][0][f] = high[f] - low[f];
            }
        }
        // The gradient of a factor is the product of the five others: those before it times those after it.
        let mut before = *d_features;
        let mut after = [[1.0_f32; F]; 6];
        for index in (0..5).rev() {
            for f in 0..F {
                after[index][f] = after[index + 1][f] * value[index + 1][f];
            }
        }
        let mut along = [[0.0_f32; F]; 3];
        for (index, axes) in crate::field::layout::PLANE_AXES.into_iter().enumerate() {
            let d: [f32; F] = std::array::from_fn(|f| before[f] * after[index][f]);
            d_planes[index * F..][..F].copy_from_slice(&d);
            for (side, axis) in axes.into_iter().enumerate().filter(|(_, axis)| *axis < 3) {
                for f in 0..F {
                    along[axis][f] += d[f] * slope[index][side][f];
                }
            }
            for f in 0..F {
                before[f] *= value[index][f];
            }
        }
        for axis in 0..3 {
            let inside = point[axis] > 0.0 && point[axis] < 1.0;
            let last = (level.cells[axis] - 1) as f32;
            d_point[axis] += if inside { along[axis].iter().sum::<f32>() * last } else { 0.0 };
        }
    }
    d_point
}

/// Adds the gradients of `points` to one spatial plane, point after point. `d_planes` is `[point, plane, feature]` with
/// `planes` planes a point, of which this is number `index`.
pub fn scatter_plane<const F: usize>(
    gradient: &mut [f32],
    (index, planes): (usize, usize),
    (axes, cells): ([usize; 2], [usize; 2]),
    points: &[[f32; 3]],
    d_planes: &[f32],
) {
    for (point, d) in points.iter().zip(d_planes.chunks_exact(planes * F)) {
        let d: &[f32; F] = feature(d, index * F);
        let (col, x) = locate(point[axes[0]], cells[0]);
        let (row, y) = locate(point[axes[1]], cells[1]);
        let base = (row * cells[0] + col) * F;
        let row_length = cells[0] * F;
        for (start, weight) in [(base, 1.0 - y), (base + row_length, y)] {
            let (low, high) = gradient[start..start + 2 * F].split_at_mut(F);
            for f in 0..F {
                low[f] += (1.0 - x) * weight * d[f];
                high[f] += x * weight * d[f];
            }
        }
    }
}

/// Adds the gradients of `points` to the line of a time plane over `axis`; the arguments are those of [`scatter_plane`].
pub fn scatter_line<const F: usize>(
    line: &mut [f32],
    (index, planes): (usize, usize),
    (axis, cells): (usize, usize),
    points: &[[f32; 3]],
    d_planes: &[f32],
) {
    for (point, d) in points.iter().zip(d_planes.chunks_exact(planes * F)) {
        let d: &[f32; F] = feature(d, index * F);
        let (cell, weight) = locate(point[axis], cells);
        let (low, high) = line[cell * F..][..2 * F].split_at_mut(F);
        for f in 0..F {
            low[f] += (1.0 - weight) * d[f];
            high[f] += weight * d[f];
        }
    }
}
