//! The running statistics of density control, on the device.

use wgpu::Buffer;

use super::ScreenStatistics;
use crate::kernels::kernel;
use erfgs_splat::gpu::{Commands, Gpu, GpuError, Kernel, stored};

/// Running statistics of every Gaussian.
#[derive(Debug)]
pub struct Statistics {
    kernel: Kernel,
    seen: Buffer,
    rows: u32,
}

impl Statistics {
    /// Nothing seen yet of `rows` Gaussians.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, rows: u32) -> Result<Self, GpuError> {
        let kernel = kernel(gpu, "statistics", &[include_str!("statistics.wgsl")]);
        Ok(Self { kernel, seen: gpu.storage("statistics", Self::bytes(rows))?, rows })
    }

    /// Bytes of the device's memory that they take.
    #[must_use]
    pub fn bytes(rows: u32) -> u64 {
        stored(u64::from(rows) * 16)
    }

    /// Adds the screen statistics of an iteration (rows of vec4; see [`erfgs_splat::raster::Gradients`]). Where a picture was looked at in
    /// `part`, Gaussians without a gradient were not looked at.
    pub fn add(&self, gpu: &Gpu, commands: &mut Commands<'_>, screen: &Buffer, part: bool) {
        let rows = gpu.uniform("rows", &[self.rows, part.into(), 0, 0]);
        commands.dispatch(&self.kernel, &[&rows, screen, &self.seen], self.rows.div_ceil(64));
    }

    /// What was seen so far.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<ScreenStatistics>, GpuError> {
        let rows: Vec<[f32; 4]> = gpu.download(&self.seen, self.rows as usize)?;
        Ok(rows
            .iter()
            .map(|row| ScreenStatistics { gradient: row[0], iterations: row[1], radius_px: row[2] })
            .collect())
    }

    /// Starts anew with `seen` (of other rows, perhaps).
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn replace(&mut self, gpu: &Gpu, seen: &[ScreenStatistics]) -> Result<(), GpuError> {
        let rows: Vec<[f32; 4]> =
            seen.iter().map(|seen| [seen.gradient, seen.iterations, seen.radius_px, 0.0]).collect();
        self.seen = gpu.storage_from("statistics", &rows)?;
        self.rows = seen.len() as u32;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use erfgs_splat::gpu::AdapterChoice;

    #[test]
    fn gradients_add_up_over_the_iterations_that_saw_a_gaussian() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        let statistics = Statistics::new(&gpu, 2).expect("a buffer");
        for screen in [[[3.0f32, 4.0, 2.0, 1.0], [9.0, 9.0, 9.0, 0.0]], [[0.0, 1.0, 5.0, 2.0], [0.0; 4]]] {
            let screen = gpu.storage_from("screen", &screen).expect("a buffer");
            let mut commands = gpu.commands();
            statistics.add(&gpu, &mut commands, &screen, false);
            commands.submit();
        }
        let seen = statistics.read(&gpu).expect("statistics");
        assert_eq!(seen[0], ScreenStatistics { gradient: 6.0, iterations: 2.0, radius_px: 5.0 });
        assert_eq!(seen[1], ScreenStatistics::default());
    }
    #[test]
    fn what_was_left_out_of_a_picture_was_not_seen() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        for (part, iterations) in [(false, 1.0), (true, 0.0)] {
            let statistics = Statistics::new(&gpu, 2).expect("a buffer");
            let screen =
                gpu.storage_from("screen", &[[0.0_f32, 0.0, 2.0, 1.0], [3.0, 4.0, 2.0, 1.0]]).expect("a buffer");
            let mut commands = gpu.commands();
            statistics.add(&gpu, &mut commands, &screen, part);
            commands.submit();
            let seen = statistics.read(&gpu).expect("statistics");
            assert_eq!(seen.iter().map(|seen| seen.iterations).collect::<Vec<_>>(), [iterations, 1.0]);
        }
    }
}
