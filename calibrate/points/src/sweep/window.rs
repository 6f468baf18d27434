//! Sums over square windows, kept exact.
//!
//! Images are whole grey levels held as `f32`. Sums of up to 15 x 15 products of two of them stay below 2^24, so that
//! adding what enters a window and taking away what leaves it never rounds.

/// Running sums of one quantity: a sum for each column over the window's rows, and the window's sum at each pixel.
#[derive(Clone, Debug)]
pub struct BoxSum {
    columns: Vec<f32>,
    sums: Vec<f32>,
    radius: usize,
}

impl BoxSum {
    /// For rows of `width` pixels and windows of `2 radius + 1`.
    pub fn new(width: usize, radius: usize) -> Self {
        Self { columns: vec![0.0; width], sums: vec![0.0; width], radius }
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.columns.fill(0.0);
    }

    /// Adds the products of two rows.
    pub fn enter(&mut self, a: &[f32], b: &[f32]) {
        for ((sum, a), b) in self.columns.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }

    /// Takes the products of two rows away.
    pub fn leave(&mut self, a: &[f32], b: &[f32]) {
        for ((sum, a), b) in self.columns.iter_mut().zip(a).zip(b) {
            *sum -= a * b;
        }
    }

    /// The window's sum at each pixel of the current row; 0 where the window leaves the row.
    pub fn row(&mut self) -> &[f32] {
        let size = 2 * self.radius + 1;
        self.sums.fill(0.0);
        if self.columns.len() >= size {
            let mut sum: f32 = self.columns[..size].iter().sum();
            self.sums[self.radius] = sum;
            let steps = self.columns[size..].iter().zip(&self.columns);
            for (out, (entering, leaving)) in self.sums[self.radius + 1..].iter_mut().zip(steps) {
                sum += entering - leaving;
                *out = sum;
            }
        }
        &self.sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn running_sums_equal_direct_sums_exactly() {
        let (width, height, radius) = (23_usize, 17_usize, 4_usize);
        let value = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 256) as f32;
        let rows: Vec<Vec<f32>> = (0..height).map(|y| (0..width).map(|x| value(x, y)).collect()).collect();
        let mut sum = BoxSum::new(width, radius);
        for y in 0..height {
            sum.enter(&rows[y], &rows[y]);
            if y > 2 * radius {
                let old = &rows[y - 2 * radius - 1];
                sum.leave(old, old);
            }
            if y < 2 * radius {
                continue;
            }
            for (x, &got) in sum.row().iter().enumerate().take(width - radius).skip(radius) {
                let direct: u64 = (y - 2 * radius..=y)
                    .flat_map(|v| (x - radius..=x + radius).map(move |u| value(u, v) as u64))
                    .map(|grey| grey * grey)
                    .sum();
                assert_eq!(f64::from(got), direct as f64, "{x}, {y}");
            }
        }
    }
}
