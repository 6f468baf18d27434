//! Neighbours side by side, so that a block of rows spans little.

use erfgs_train::gaussians::CORE;

/// Bits of a coordinate in a code.
const BITS: u32 = 21;

/// Rows of `core` in the order of a space-filling curve (Morton's): those that move first, as they were.
pub(super) fn by_place(core: &[f32], dynamic: usize) -> Vec<usize> {
    let rows = core.as_chunks::<CORE>().0;
    let end = |better: fn(f32, f32) -> f32, from: f32| {
        rows.iter().fold([from; 3], |best, row| std::array::from_fn(|axis| better(best[axis], row[axis])))
    };
    let (low, high) = (end(f32::min, f32::INFINITY), end(f32::max, f32::NEG_INFINITY));
    let code = |row: usize| {
        let cells = f64::from((1_u32 << BITS) - 1);
        let coded = |axis: usize| {
            let [from, to, at] = [low[axis], high[axis], rows[row][axis]].map(f64::from);
            let share = if to > from { (at - from) / (to - from) } else { 0.0 };
            spread((share * cells) as u64) << axis
        };
        coded(0) | coded(1) | coded(2)
    };
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by_cached_key(|&row| (row >= dynamic, code(row)));
    order
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
        assert_eq!(by_place(&core, 3), [0, 2, 1, 4, 6, 7, 5, 3]);
        assert_eq!(by_place(&core[..CORE], 0), [0]);
        assert_eq!(by_place(&[], 0), [0; 0]);
    }
}
