//! How a rig is calibrated from images of its surroundings.

use crate::colmap::ColmapProgram;

/// One independent way to an arrangement of the cameras: its own features, matches and seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// How many times the images are enlarged before features are looked for.
    pub enlarge: f64,
    /// SIFT's threshold on the difference of Gaussians.
    pub peak_threshold: f64,
    /// SIFT's threshold on edge-like features.
    pub edge_threshold: f64,
    /// The nearest descriptor must be closer (as an angle) than this share of the second nearest.
    pub ratio: f64,
    /// Seed of RANSAC, and of the order in which the images are listed; 0 keeps the order.
    pub seed: u32,
}

/// How a rig is calibrated from images of its surroundings.
#[derive(Clone, Debug, PartialEq)]
pub struct SfmOptions {
    /// The COLMAP to use.
    pub colmap: ColmapProgram,
    /// The independent runs; the later ones are left out where the earlier agree on all cameras. The first one's features are
    /// those that the result is adjusted to.
    pub settings: Vec<Setting>,
    /// Names of two cameras, and how far apart their centres are, metres.
    pub scale: Option<(String, String, f64)>,
    /// Threads; 0 = all.
    pub threads: usize,
    /// Cameras with fewer points than this are in doubt, whatever the runs say.
    pub fewest_points: usize,
}

impl Default for SfmOptions {
    fn default() -> Self {
        let double = Setting { enlarge: 2.0, peak_threshold: 0.02 / 3.0, edge_threshold: 10.0, ratio: 0.8, seed: 0 };
        Self {
            colmap: ColmapProgram::Auto,
            settings: vec![
                double,
                Setting { enlarge: 1.0, peak_threshold: 0.001, edge_threshold: 20.0, seed: 1, ..double },
                Setting { enlarge: 1.5, peak_threshold: 0.003, ratio: 0.85, seed: 2, ..double },
            ],
            scale: None,
            threads: 0,
            fewest_points: 60,
        }
    }
}

impl Setting {
    /// As tables and messages call it: `2x, peak 0.0067, seed 0`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}x, peak {:.4}, seed {}", self.enlarge, self.peak_threshold, self.seed)
    }
}
