//! Which parts of an image something was seen in.

use glam::DVec2;

/// An image divided into equal parts, and how often something was seen in each.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Coverage {
    size: DVec2,
    grid: [usize; 2],
    counts: Vec<u32>,
}

impl Coverage {
    /// Nothing seen yet in an image of `size` (columns and rows, pixels), divided into `grid` columns and rows of parts.
    pub fn new(size: [u32; 2], grid: [usize; 2]) -> Self {
        Self { size: DVec2::from(size.map(f64::from)), grid, counts: vec![0; grid[0] * grid[1]] }
    }

    /// Something was seen at `pixel`; what lies outside the image counts in the part next to it.
    pub fn see(&mut self, pixel: DVec2) {
        let cell = |axis: usize| {
            let at = (pixel[axis] / self.size[axis] * self.grid[axis] as f64).max(0.0) as usize;
            at.min(self.grid[axis] - 1)
        };
        self.counts[cell(1) * self.grid[0] + cell(0)] += 1;
    }

    /// How often something was seen in each part, row by row.
    pub fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// How often something was seen in the part of this column and row.
    pub fn at(&self, column: usize, row: usize) -> u32 {
        self.counts[row * self.grid[0] + column]
    }

    /// Number of parts.
    pub fn parts(&self) -> usize {
        self.counts.len()
    }

    /// Number of parts in which something was seen.
    pub fn covered(&self) -> usize {
        self.counts.iter().filter(|count| **count > 0).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_seen_counts_in_its_part_and_on_the_border_in_the_last() {
        let mut coverage = Coverage::new([60, 40], [3, 2]);
        for at in [(0.0, 0.0), (19.9, 19.9), (20.0, 19.9), (60.0, 40.0), (-3.0, 99.0)] {
            coverage.see(DVec2::from(at));
        }
        assert_eq!(coverage.counts(), [2, 1, 0, 1, 0, 1]);
        assert_eq!((coverage.at(0, 0), coverage.at(2, 1), coverage.parts(), coverage.covered()), (2, 1, 6, 4));
    }
}
