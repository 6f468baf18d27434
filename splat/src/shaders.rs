//! The texts of the kernels that draw, for who draws the scene on a device of his own: a viewer runs what the trainer runs.

macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        /// Names, as the files are called in this crate, and texts.
        pub const TEXTS: &[(&str, &str)] = &[$(($name, include_str!($name))),*];
    };
}

texts![
    "field/device/gather.wgsl",
    "field/device/lines.wgsl",
    "field/device/planes.wgsl",
    "motion/bodies/carry.wgsl",
    "motion/bodies/poses.wgsl",
    "motion/bodies/row.wgsl",
    "motion/bodies/shared.wgsl",
    "motion/free_time/forward.wgsl",
    "motion/free_time/knots.wgsl",
    "motion/free_time/parabola.wgsl",
    "motion/free_time/row.wgsl",
    "raster/blend_gpu.wgsl",
    "raster/emit.wgsl",
    "raster/intersect.wgsl",
    "raster/order.wgsl",
    "raster/plan_tiles.wgsl",
    "raster/project.wgsl",
    "raster/shared/colour.wgsl",
    "raster/shared/gaussian.wgsl",
    "raster/shared/harmonics.wgsl",
    "raster/shared/splat.wgsl",
    "raster/shared/tiles.wgsl",
    "raster/shared/view.wgsl",
    "raster/tile_ranges.wgsl",
    "sort/radix_count.wgsl",
    "sort/radix_scatter.wgsl",
    "sort/scan_apply.wgsl",
    "sort/scan_reduce.wgsl",
    "sort/scan_shared.wgsl",
    "sort/scan_sums.wgsl",
    "sort/scan_whole.wgsl",
    "sort/shared.wgsl",
];
