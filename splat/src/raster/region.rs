//! The part of an image that is needed.

/// Side of the blocks that a region is made of, pixels. The sides of all tiles are multiples of it.
const BLOCK: u32 = 4;

/// The part of an image that is needed. Outside it a rendering may hold the background alone (the CPU shape leaves those
/// tiles out, the GPU shape draws them), so that losses must not look there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Region {
    columns: u32,
    rows: u32,
    needed: Vec<bool>,
}

impl Region {
    /// The blocks with a pixel of `mask` (row-major, of an image of `width` x `height` pixels).
    #[must_use]
    pub fn new(mask: &[bool], width: u32, height: u32) -> Self {
        let (columns, rows) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        let mut needed = vec![false; (columns * rows) as usize];
        for (row, y) in mask.chunks_exact(width.max(1) as usize).zip(0..height) {
            for (&needs, x) in row.iter().zip(0..width) {
                needed[(y / BLOCK * columns + x / BLOCK) as usize] |= needs;
            }
        }
        Self { columns, rows, needed }
    }

    /// Whether a pixel lies in a needed block.
    #[must_use]
    pub fn contains(&self, x: u32, y: u32) -> bool {
        let (column, row) = (x / BLOCK, y / BLOCK);
        column < self.columns && row < self.rows && self.needed[(row * self.columns + column) as usize]
    }

    /// A bit for each pixel of an image of `width` x `height` pixels, row by row, the lowest of a word first: whether a needed block has it.
    #[must_use]
    pub fn bits(&self, width: u32, height: u32) -> Vec<u32> {
        let mut bits = vec![0; (u64::from(width) * u64::from(height)).div_ceil(32) as usize];
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        for (pixel, _) in pixels.enumerate().filter(|(_, (x, y))| self.contains(*x, *y)) {
            bits[pixel / 32] |= 1 << (pixel % 32);
        }
        bits
    }

    /// Share of the blocks that are needed.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.needed.iter().filter(|&&needs| needs).count() as f64 / self.needed.len().max(1) as f64
    }

    /// For each tile of 16 x 16 pixels, row by row, which of its eight blocks of 8 x 4 pixels are needed: bits 0 to 3 are
    /// the left half from top to bottom, bits 4 to 7 the right half.
    pub(super) fn tiles(&self, [columns, rows]: [u32; 2]) -> Vec<u32> {
        let needs = |column: u32, row: u32| {
            column < self.columns && row < self.rows && self.needed[(row * self.columns + column) as usize]
        };
        let tile = |column: u32, row: u32| {
            (0..8).fold(0, |bits, block| {
                let (x, y) = (4 * column + 2 * (block / 4), 4 * row + block % 4);
                bits | u32::from(needs(x, y) || needs(x + 1, y)) << block
            })
        };
        (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))).map(|(x, y)| tile(x, y)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_is_made_of_the_blocks_that_a_mask_touches() {
        let mut mask = vec![false; 20 * 10];
        mask[9 * 20 + 19] = true;
        let region = Region::new(&mask, 20, 10);
        assert!(region.contains(16, 8) && region.contains(19, 9) && !region.contains(15, 9));
        assert_eq!(region.tiles([2, 1]), [0, 1 << 2]);
        assert!((region.share() - 1.0 / 15.0).abs() < 1e-12);
        let bits = region.bits(20, 10);
        assert_eq!(bits.len(), 7);
        for pixel in 0..224_u32 {
            let is_in = pixel < 200 && region.contains(pixel % 20, pixel / 20);
            assert_eq!(bits[pixel as usize / 32] >> (pixel % 32) & 1, u32::from(is_in), "{pixel}");
        }
    }
}
