//! The most important Gaussians first, and among them neighbours side by side, so that a block of rows spans little.

use erfgs_splat::gaussians::{CORE, sigmoid};

use super::Precision;

/// Shares of the Gaussians of which there is a picture before all are there.
const COARSE: [f64; 2] = [0.125, 0.5];
/// Fewer Gaussians come at once.
const LEAST: usize = 512;
/// Bits of a coordinate in a code.
const BITS: u32 = 21;

/// In which order rows are written: first those that move, as in memory, then the others.
#[derive(Debug, PartialEq)]
pub(super) struct Order {
    /// For each row of the file, its row in memory.
    pub rows: Vec<usize>,
    /// For each part of the file, how many of the rows that move and of the others are there with it. The last has all.
    pub parts: Vec<[usize; 2]>,
}

/// The order of the rows of `core`, of which the first `dynamic` move.
pub(super) fn order(core: &[f32], dynamic: usize, precision: Precision) -> Order {
    let all = core.as_chunks::<CORE>().0;
    let shares = if all.len() < LEAST { &[] } else { &COARSE[..] };
    let places = if precision == Precision::Packed { codes(all) } else { (0..all.len() as u64).collect() };
    let groups = [0..dynamic, dynamic..all.len()];
    let part =
        |share: f64| -> [usize; 2] { [0, 1].map(|group: usize| (share * groups[group].len() as f64).ceil() as usize) };
    let parts: Vec<[usize; 2]> = shares.iter().chain(&[1.0]).map(|&share| part(share)).collect();
    let mut rows: Vec<usize> = (0..all.len()).collect();
    for (index, group) in groups.into_iter().enumerate() {
        let group = &mut rows[group];
        if parts.len() > 1 {
            group.sort_by(|&a, &b| importance(&all[b]).total_cmp(&importance(&all[a])));
        }
        let mut from = 0;
        for part in &parts {
            group[from..part[index]].sort_by_key(|&row| places[row]);
            from = part[index];
        }
    }
    Order { rows, parts }
}

/// How much a Gaussian covers, seen from nowhere in particular: its opacity times the area of its two longer axes, as a logarithm.
fn importance(row: &[f32; CORE]) -> f32 {
    let shortest = row[3].min(row[4]).min(row[5]);
    sigmoid(row[10]).max(f32::MIN_POSITIVE).ln() + row[3] + row[4] + row[5] - shortest
}

/// The place of each row on a space-filling curve (Morton's).
fn codes(rows: &[[f32; CORE]]) -> Vec<u64> {
    let end = |better: fn(f32, f32) -> f32, from: f32| {
        rows.iter().fold([from; 3], |best, row| std::array::from_fn(|axis| better(best[axis], row[axis])))
    };
    let (low, high) = (end(f32::min, f32::INFINITY), end(f32::max, f32::NEG_INFINITY));
    let code = |row: &[f32; CORE]| {
        let cells = f64::from((1_u32 << BITS) - 1);
        let coded = |axis: usize| {
            let [from, to, at] = [low[axis], high[axis], row[axis]].map(f64::from);
            let share = if to > from { (at - from) / (to - from) } else { 0.0 };
            spread((share * cells) as u64) << axis
        };
        coded(0) | coded(1) | coded(2)
    };
    rows.iter().map(code).collect()
}

/// The lowest 21 bits, each three places from the next.
fn spread(value: u64) -> u64 {
    let mut bits = value & 0x1f_ffff;
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_three_places_apart() {
        for value in [0, 1, 0b101, 0x1f_ffff, 0x15_5555] {
            let spread = spread(value);
            let naive = (0..21).fold(0_u64, |sum, bit| sum | (value >> bit & 1) << (3 * bit));
            assert_eq!(spread, naive, "{value:b}");
        }
    }

    #[test]
    fn rows_that_move_stay_in_front_and_neighbours_come_together() {
        // On a line, from one end to the other and back.
        let places = [0.0, 10.0, 1.0, 9.0, 2.0, 8.0, 3.0, 7.0];
        let core: Vec<f32> =
            places.iter().flat_map(|&x| (0..CORE).map(move |i| if i == 0 { x } else { 0.0 })).collect();
        let packed = order(&core, 3, Precision::Packed);
        assert_eq!(packed, Order { rows: vec![0, 2, 1, 4, 6, 7, 5, 3], parts: vec![[3, 5]] });
        assert_eq!(order(&core, 3, Precision::Exact).rows, [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(order(&core[..CORE], 0, Precision::Packed).rows, [0]);
        assert_eq!(order(&[], 0, Precision::Packed), Order { rows: vec![], parts: vec![[0, 0]] });
    }

    #[test]
    fn of_each_kind_those_that_cover_most_come_first() {
        let (count, dynamic) = (1000, 101);
        let mut core = vec![0.0; count * CORE];
        for (row, values) in core.as_chunks_mut::<CORE>().0.iter_mut().enumerate() {
            // Thin along one axis, which covers nothing; the others grow with the row's number, scattered by a prime.
            let size = ((row * 617) % count) as f32 / count as f32;
            (values[3], values[4], values[5]) = (size, -50.0, size);
        }
        // Large, and not to be seen.
        (core[5 * CORE + 3], core[5 * CORE + 10]) = (5.0, -90.0);
        for precision in [Precision::Exact, Precision::Packed] {
            let Order { rows, parts } = order(&core, dynamic, precision);
            assert_eq!(parts, [[13, 113], [51, 450], [101, 899]]);
            let mut sorted = rows.clone();
            sorted.sort_unstable();
            assert!(sorted.iter().copied().eq(0..count), "each row once");
            assert!(rows[..dynamic].iter().all(|&row| row < dynamic));
            let covers = |rows: &[usize]| -> Vec<f32> {
                rows.iter().map(|&row| importance(core[row * CORE..].first_chunk().unwrap())).collect()
            };
            for (index, group) in [&rows[..dynamic], &rows[dynamic..]].into_iter().enumerate() {
                for part in &parts[..2] {
                    let (some, others) = group.split_at(part[index]);
                    let least = covers(some).into_iter().fold(f32::INFINITY, f32::min);
                    assert!(covers(others).into_iter().all(|other| other <= least));
                }
            }
            assert!(!rows[..51].contains(&5));
        }
    }
}
