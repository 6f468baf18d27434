//! Which splats touch which tiles, sorted by tile, then depth: the host's side of the CPU shape.
//!
//! Splats are sorted by depth first; walking them in that order and appending each to the lists of its tiles leaves
//! every list sorted. Ties keep the order of the Gaussians.

use std::f32::consts::LN_2;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::uniform::PARITY_TILE;

/// `Splat` in WGSL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Splat {
    pub(super) mean: [f32; 2],
    pub(super) power: [f32; 3],
    pub(super) log_opacity: f32,
    pub(super) extent: [f32; 2],
    pub(super) colour: [f32; 3],
    pub(super) depth: f32,
    pub(super) column: [f32; 4],
}

/// The tiles of an image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Image width and height, pixels.
    pub(super) image: [u32; 2],
    /// Side of a tile, pixels.
    pub(super) tile: u32,
    /// Columns and rows.
    pub(super) tiles: [u32; 2],
    /// Whether splats are bounded by the squares that the 3DGS code uses.
    pub(super) three_sigma: bool,
    /// How far a splat reaches otherwise.
    pub(super) negligible_alpha: f32,
}

impl Grid {
    /// Number of tiles.
    pub(super) fn count(&self) -> u32 {
        self.tiles[0] * self.tiles[1]
    }
}

/// The lists of all tiles.
#[derive(Debug, Default)]
pub(super) struct Bins {
    /// Splat and emission index, sorted by tile, then depth.
    pub(super) entries: Vec<[u32; 2]>,
    /// Tile, first entry, end of entries, needed blocks; longest first.
    pub(super) lists: Vec<[u32; 4]>,
    /// Gaussian, first emission index, number of entries, 0, of each Gaussian that touches a tile.
    pub(super) ranges: Vec<[u32; 4]>,
}

/// Neighbouring tiles of one row that a splat touches.
#[derive(Clone, Copy, Debug, Default)]
struct Span {
    row: u32,
    first: u32,
    end: u32,
    splat: u32,
    emission: u32,
}

/// All blocks of a tile.
const WHOLE_TILE: u32 = 0xff;

/// Sorts splats into tiles. `needed`: which blocks of each tile are needed (see `Region::tiles`); all where there is
/// none.
pub(super) fn bin(splats: &[Splat], grid: &Grid, needed: Option<&[u32]>) -> Bins {
    let mut order: Vec<(u32, u32)> = splats
        .iter()
        .zip(0..)
        .filter(|(splat, _)| splat.extent[0] > 0.0)
        .map(|(splat, index)| (splat.depth.to_bits(), index))
        .collect();
    radsort::sort_by_key(&mut order, |entry| entry.0);

    let chunk = order.len().div_ceil(4 * rayon::current_num_threads()).max(1024);
    let mut chunks: Vec<Vec<Span>> = order
        .par_chunks(chunk)
        .map(|part| {
            let mut spans = Vec::with_capacity(4 * part.len());
            for &(_, index) in part {
                spans_of(&splats[index as usize], index, grid, &mut spans);
            }
            if let Some(needed) = needed {
                spans = spans.into_iter().flat_map(|span| runs(span, needed, grid)).collect();
            }
            spans
        })
        .collect();

    let mut ranges = vec![[0u32; 4]; splats.len()];
    let mut starts = vec![0u32; grid.count() as usize + 1];
    let mut emission = 0;
    for span in chunks.iter_mut().flatten() {
        span.emission = emission;
        let range = &mut ranges[span.splat as usize];
        if range[2] == 0 {
            (range[0], range[1]) = (span.splat, emission);
        }
        range[2] += span.end - span.first;
        emission += span.end - span.first;
        let row = (span.row * grid.tiles[0]) as usize;
        for tile in span.first..span.end {
            starts[row + tile as usize + 1] += 1;
        }
    }
    for tile in 1..starts.len() {
        starts[tile] += starts[tile - 1];
    }
    ranges.retain(|range| range[2] > 0);
    let entries = scatter(&chunks, &starts, grid, emission as usize);
    Bins { entries, lists: schedule(&starts, needed), ranges }
}

/// The parts of a span that lie on needed tiles.
fn runs(span: Span, needed: &[u32], grid: &Grid) -> impl Iterator<Item = Span> {
    let row = &needed[(span.row * grid.tiles[0]) as usize..][..grid.tiles[0] as usize];
    let mut next = span.first;
    std::iter::from_fn(move || {
        let first = (next..span.end).find(|&tile| row[tile as usize] != 0)?;
        let end = (first..span.end).find(|&tile| row[tile as usize] == 0).unwrap_or(span.end);
        next = end;
        Some(Span { first, end, ..span })
    })
}

/// Writes the lists. Each worker owns some rows of tiles and reads all spans.
fn scatter(chunks: &[Vec<Span>], starts: &[u32], grid: &Grid, count: usize) -> Vec<[u32; 2]> {
    let mut entries = vec![[0u32; 2]; count];
    let columns = grid.tiles[0] as usize;
    let workers = rayon::current_num_threads().clamp(1, 8);
    let mut bands = Vec::with_capacity(workers);
    let mut rest = entries.as_mut_slice();
    let mut row = 0;
    for worker in 0..workers {
        let goal = count * (worker + 1) / workers;
        let first_row = row;
        while row < grid.tiles[1] as usize && (worker + 1 == workers || (starts[row * columns] as usize) < goal) {
            row += 1;
        }
        let length = (starts[row * columns] - starts[first_row * columns]) as usize;
        let (band, remaining) = rest.split_at_mut(length);
        rest = remaining;
        bands.push((first_row, row, band));
    }
    bands.into_par_iter().for_each(|(first_row, end_row, band)| {
        let first_tile = first_row * columns;
        let mut cursors: Vec<u32> =
            starts[first_tile..end_row * columns].iter().map(|start| start - starts[first_tile]).collect();
        for span in chunks.iter().flatten() {
            let row = span.row as usize;
            if !(first_row..end_row).contains(&row) {
                continue;
            }
            let first = row * columns - first_tile;
            for (cursor, emission) in
                cursors[first + span.first as usize..first + span.end as usize].iter_mut().zip(span.emission..)
            {
                band[*cursor as usize] = [span.splat, emission];
                *cursor += 1;
            }
        }
    });
    entries
}

/// The tiles' lists, longest first, so that no worker ends up with a long one; equally long ones in the order of the
/// tiles.
fn schedule(starts: &[u32], needed: Option<&[u32]>) -> Vec<[u32; 4]> {
    let blocks = |tile: u32| needed.map_or(WHOLE_TILE, |needed| needed[tile as usize]);
    let mut lists: Vec<[u32; 4]> =
        starts.windows(2).zip(0..).map(|(pair, tile)| [tile, pair[0], pair[1], blocks(tile)]).collect();
    radsort::sort_by_key(&mut lists, |list| u32::MAX - (list[2] - list[1]));
    lists
}

/// Pixels whose centre lies within `low..=high`, as first and end index within `0..size`.
fn pixels_between(low: f32, high: f32, size: u32) -> (u32, u32) {
    let first = (low - 0.5).ceil().clamp(0.0, size as f32);
    let end = ((high - 0.5).floor() + 1.0).clamp(0.0, size as f32);
    (first as u32, end as u32)
}

fn spans_of(splat: &Splat, index: u32, grid: &Grid, spans: &mut Vec<Span>) {
    let [mx, my] = splat.mean;
    let [ex, ey] = splat.extent;
    let side = grid.tile;
    let mut push = |row: u32, pixels: (u32, u32)| {
        if pixels.0 < pixels.1 {
            let end = (pixels.1 - 1) / side + 1;
            spans.push(Span { row, first: pixels.0 / side, end, splat: index, emission: 0 });
        }
    };
    let (top, bottom) = pixels_between(my - ey, my + ey, grid.image[1]);
    if grid.three_sigma {
        // Whole tiles of 16 pixels, whatever the side of the tiles here.
        let snap = |first: u32, end: u32, size: u32| {
            (first / PARITY_TILE * PARITY_TILE, end.next_multiple_of(PARITY_TILE).min(size))
        };
        let (left, right) = pixels_between(mx - ex, mx + ex, grid.image[0]);
        if top < bottom && left < right {
            let (top, bottom) = snap(top, bottom, grid.image[1]);
            for row in top / side..bottom.div_ceil(side) {
                push(row, snap(left, right, grid.image[0]));
            }
        }
        return;
    }
    if top >= bottom {
        return;
    }
    // In natural units, a negligible alpha is where -2 ln 2 power = reach.
    let reach = (2.0 * LN_2 * (splat.log_opacity - grid.negligible_alpha.log2()) * 1.0001 + 1e-4).max(0.0);
    let [a, b, _] = splat.power;
    let half_widest = reach / (-2.0 * LN_2 * a);
    let slant = -0.5 * b / a;
    let rightmost_y = splat.column[2] * ex;
    let inverse_ey = 1.0 / ey;
    // Largest x (relative to the mean) of the ellipse at y, mirrored for the smallest.
    let edge = |y: f32, sign: f32| slant * y + sign * (half_widest * (1.0 - (y * inverse_ey).powi(2)).max(0.0)).sqrt();
    for row in top / side..(bottom - 1) / side + 1 {
        let low = (row * side).max(top) as f32 + 0.5 - my;
        let high = ((row + 1) * side).min(bottom) as f32 - 0.5 - my;
        let right = if (low..=high).contains(&rightmost_y) { ex } else { edge(rightmost_y.clamp(low, high), 1.0) };
        let left = if (low..=high).contains(&-rightmost_y) { -ex } else { edge((-rightmost_y).clamp(low, high), -1.0) };
        push(row, pixels_between(mx + left, mx + right, grid.image[0]));
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random::{key, range};

    use super::*;

    /// A splat of a random ellipse, and its covariance xx, xy, yy.
    fn ellipse(seed: u64, image: [u32; 2]) -> Splat {
        let number = |word, from, to| range(key(seed, &[word]), from, to) as f32;
        let mean = [number(0, -20.0, f64::from(image[0]) + 20.0), number(1, -20.0, f64::from(image[1]) + 20.0)];
        let (sx, sy) = (number(2, -1.0, 3.5).exp(), number(3, -1.0, 3.5).exp());
        let correlation = number(4, -0.99, 0.99);
        let opacity = number(5, 0.01, 1.0);
        let [xx, xy, yy] = [sx * sx, correlation * sx * sy, sy * sy];
        let determinant = xx * yy - xy * xy;
        let scale = -1.0 / (2.0 * LN_2 * determinant);
        let reach = 2.0 * (255.0 * opacity).ln() * 1.0001 + 1e-4;
        Splat {
            mean,
            power: [scale * yy, -2.0 * scale * xy, scale * xx],
            log_opacity: opacity.log2(),
            extent: [(reach * xx).sqrt(), (reach * yy).sqrt()],
            colour: [0.5; 3],
            depth: number(6, 0.1, 9.0),
            column: [0.0, 0.0, xy / xx, 0.0],
        }
    }

    /// Whether alpha is at least 1/255 in some pixel of the tile.
    fn touches(splat: &Splat, grid: &Grid, tile: u32) -> bool {
        let (column, row) = (tile % grid.tiles[0], tile / grid.tiles[0]);
        let side = |index: u32, size: u32| index * grid.tile..((index + 1) * grid.tile).min(size);
        side(row, grid.image[1]).any(|y| {
            side(column, grid.image[0]).any(|x| {
                let (dx, dy) = (x as f32 + 0.5 - splat.mean[0], y as f32 + 0.5 - splat.mean[1]);
                let [a, b, c] = splat.power;
                a * dx * dx + b * dx * dy + c * dy * dy + splat.log_opacity >= -(255f32.log2())
            })
        })
    }

    #[test]
    fn lists_hold_the_splats_that_touch_each_tile_by_depth() {
        let grid = Grid { image: [93, 70], tile: 16, tiles: [6, 5], three_sigma: false, negligible_alpha: 1.0 / 255.0 };
        let splats: Vec<Splat> = (0..300).map(|seed| ellipse(seed, grid.image)).collect();
        let bins = bin(&splats, &grid, None);
        let (mut needed, mut listed) = (0, 0);
        for list in &bins.lists {
            let entries = &bins.entries[list[1] as usize..list[2] as usize];
            assert!(entries.is_sorted_by(|a, b| splats[a[0] as usize].depth <= splats[b[0] as usize].depth));
            let touching: Vec<u32> =
                (0..300).filter(|&index| touches(&splats[index as usize], &grid, list[0])).collect();
            assert!(touching.iter().all(|index| entries.iter().any(|entry| entry[0] == *index)), "tile {}", list[0]);
            needed += touching.len();
            listed += entries.len();
        }
        assert_eq!(listed, bins.entries.len());
        assert!(listed <= needed + needed / 20, "{listed} entries, {needed} needed");
        for range in &bins.ranges {
            let own = |entry: &&[u32; 2]| entry[0] == range[0];
            let mut emissions: Vec<u32> = bins.entries.iter().filter(own).map(|entry| entry[1]).collect();
            emissions.sort_unstable();
            assert!(emissions.into_iter().eq(range[1]..range[1] + range[2]));
        }
    }

    #[test]
    fn the_longest_lists_come_first() {
        let grid = Grid { image: [64, 64], tile: 16, tiles: [4, 4], three_sigma: false, negligible_alpha: 1.0 / 255.0 };
        let splats: Vec<Splat> = (0..50).map(|seed| ellipse(seed, grid.image)).collect();
        let lists = bin(&splats, &grid, None).lists;
        assert!(lists.is_sorted_by_key(|list| u32::MAX - (list[2] - list[1])));
        let mut tiles: Vec<u32> = lists.iter().map(|list| list[0]).collect();
        tiles.sort_unstable();
        assert!(tiles.into_iter().eq(0..16));
    }
}
