//! Which Gaussians can move: those that project onto moving pixels in most of the cameras that have them in view.

use rayon::prelude::*;

use super::Scene;
use crate::{config::DynamicConfig, raster::View};

/// Moving pixels of every training camera that says something about motion.
#[derive(Clone, Debug)]
pub struct MotionMasks {
    /// View index and mask (true: moving), row-major.
    pub masks: Vec<(usize, Vec<bool>)>,
}

impl MotionMasks {
    /// From the frames of the training cameras (a pixel that leaves its median over time) and from the events (a pixel
    /// with at least two events).
    #[must_use]
    pub fn new(scene: &Scene, config: &DynamicConfig) -> Self {
        let mut masks: Vec<(usize, Vec<bool>)> = (0..scene.views.len())
            .into_par_iter()
            .filter_map(|view| {
                let frames: Vec<&[u32]> =
                    scene.frames.iter().filter(|frame| frame.view == view).map(|frame| &frame.pixels[..]).collect();
                // Two frames have no median worth the name, but they differ where something moved.
                (frames.len() >= 2).then(|| (view, moving(&frames, config.motion_threshold)))
            })
            .collect();
        if let Some(last) = scene.bins.len().checked_sub(1) {
            for events in &scene.events {
                let mut seen = vec![false; events.activity(0, last + 1, false).len()];
                for bin in 0..=last {
                    for (seen, count) in seen.iter_mut().zip(events.activity(bin, bin + 1, false)) {
                        *seen |= count >= 2.0;
                    }
                }
                masks.push((events.view, seen));
            }
        }
        for (view, mask) in &mut masks {
            *mask = grow(mask, scene.views[*view].view.width as usize, config.grow_px as usize);
        }
        Self { masks }
    }

    /// Share of moving pixels over all cameras.
    #[must_use]
    pub fn share(&self) -> f64 {
        let pixels: usize = self.masks.iter().map(|(_, mask)| mask.len()).sum();
        let moving: usize = self.masks.iter().map(|(_, mask)| mask.iter().filter(|&&m| m).count()).sum();
        moving as f64 / pixels.max(1) as f64
    }
}

/// Whether each of `means` can move. Points that no camera has in view cannot.
#[must_use]
pub fn classify(scene: &Scene, masks: &MotionMasks, means: &[[f32; 3]], share: f32) -> Vec<bool> {
    means
        .par_iter()
        .map(|mean| {
            let (mut in_view, mut moving) = (0u32, 0u32);
            for (view, mask) in &masks.masks {
                if let Some(pixel) = project(&scene.views[*view].view, mean) {
                    in_view += 1;
                    moving += u32::from(mask[pixel]);
                }
            }
            in_view > 0 && moving as f32 >= share * in_view as f32
        })
        .collect()
}

/// The pixel index that a world point falls on, if it lies before the camera and inside the image.
#[must_use]
pub fn project(view: &View, point: &[f32; 3]) -> Option<usize> {
    let [x, y, z] = view.to_camera(point);
    if z.is_nan() || z <= 0.0 {
        return None;
    }
    let (u, v) = (view.fx * x / z + view.cx, view.fy * y / z + view.cy);
    let inside = u >= 0.0 && v >= 0.0 && u < view.width as f32 && v < view.height as f32;
    inside.then(|| v as usize * view.width as usize + u as usize)
}

fn moving(frames: &[&[u32]], threshold: f32) -> Vec<bool> {
    let limit = (threshold * 255.0).round() as i32;
    let mut values = Vec::with_capacity(frames.len());
    (0..frames[0].len())
        .map(|pixel| {
            (0..3).any(|channel| {
                values.clear();
                values.extend(frames.iter().map(|frame| i32::from(frame[pixel].to_le_bytes()[channel])));
                values.sort_unstable();
                let median = values[values.len() / 2];
                median - values[0] > limit || values[values.len() - 1] - median > limit
            })
        })
        .collect()
}

/// The mask grown by `radius` pixels (a square).
fn grow(mask: &[bool], width: usize, radius: usize) -> Vec<bool> {
    if radius == 0 || width == 0 {
        return mask.to_vec();
    }
    let height = mask.len() / width;
    let mut across = vec![false; mask.len()];
    for (y, row) in mask.chunks_exact(width).enumerate() {
        for x in (0..width).filter(|&x| row[x]) {
            across[y * width + x.saturating_sub(radius)..y * width + (x + radius + 1).min(width)].fill(true);
        }
    }
    let mut grown = vec![false; mask.len()];
    for y in 0..height {
        for source in y.saturating_sub(radius)..(y + radius + 1).min(height) {
            for x in 0..width {
                grown[y * width + x] |= across[source * width + x];
            }
        }
    }
    grown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_moves_if_one_frame_differs_from_the_median() {
        let still = 0xff10_1010;
        let frames: [&[u32]; 3] = [&[still, still], &[still, 0xff10_1080], &[still, still]];
        assert_eq!(moving(&frames, 0.06), [false, true]);
    }

    #[test]
    fn a_mask_grows_by_its_radius_and_no_further() {
        let mut mask = vec![false; 49];
        mask[24] = true;
        let grown = grow(&mask, 7, 2);
        assert_eq!(grown.iter().filter(|&&m| m).count(), 25);
        assert!(grown[8] && !grown[7]);
    }
}
