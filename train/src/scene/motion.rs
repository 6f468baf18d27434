//! Which Gaussians can move: those that project onto moving pixels in most of the cameras that have them in view.

use rayon::prelude::*;

use super::{Pixels, Scene, SceneError};
use crate::config::DynamicConfig;
use erfgs_splat::raster::View;

/// Frames of a camera that are held at one time, whose median stands for that of all: more tell hardly more.
const MEDIAN_OF: usize = 64;
/// Frames that are read while another is looked at.
const READ_AHEAD: usize = 8;

/// Moving pixels of every training camera that says something about motion.
#[derive(Clone, Debug)]
pub struct MotionMasks {
    /// View index and mask (true: moving), row-major.
    pub masks: Vec<(usize, Vec<bool>)>,
}

impl MotionMasks {
    /// From the frames of the training cameras (a pixel that leaves its median over time) and from the events (a pixel
    /// with at least two events).
    ///
    /// # Errors
    /// [`SceneError`] where a frame or events cannot be read.
    pub fn new(scene: &Scene, config: &DynamicConfig) -> Result<Self, SceneError> {
        let of_view = |view: usize| -> Result<Option<(usize, Vec<bool>)>, SceneError> {
            let frames: Vec<usize> = scene.frames_of(view).collect();
            // Two frames have no median worth the name, but they differ where something moved.
            if frames.len() < 2 {
                return Ok(None);
            }
            let mut pixels = OverTime::new(frames.len());
            for (at, &frame) in frames.iter().enumerate() {
                // Their order here is when they are due; none is forgotten in between.
                frames[at..].iter().take(READ_AHEAD).for_each(|&next| scene.pictures.expect(next, 0));
                pixels.add(scene.pictures.get(frame)?);
            }
            Ok(Some((view, pixels.moving(config.motion_threshold))))
        };
        let views = 0..scene.views.len();
        let masks: Vec<Option<(usize, Vec<bool>)>> = if scene.pictures.all_are_kept() {
            views.into_par_iter().map(of_view).collect::<Result<_, _>>()?
        } else {
            // One after another, as each holds many frames; what reads ahead has the other processors.
            views.map(of_view).collect::<Result<_, _>>()?
        };
        let mut masks: Vec<(usize, Vec<bool>)> = masks.into_iter().flatten().collect();
        if let Some(last) = scene.bins.len().checked_sub(1) {
            for events in &scene.events {
                let view = &scene.views[events.view].view;
                let mut seen = vec![false; view.width as usize * view.height as usize];
                for bin in 0..=last {
                    for (seen, count) in seen.iter_mut().zip(events.activity(bin, bin + 1, false)?) {
                        *seen |= count >= 2.0;
                    }
                }
                masks.push((events.view, seen));
            }
        }
        for (view, mask) in &mut masks {
            *mask = grow(mask, scene.views[*view].view.width as usize, config.grow_px as usize);
        }
        Ok(Self { masks })
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

/// What the pixels of a camera are over its frames.
struct OverTime {
    /// How many frames there are, and how many came so far.
    frames: usize,
    added: usize,
    /// Frames evenly among all.
    some: Vec<Pixels>,
    /// The least and the greatest value of each pixel and channel.
    least: Vec<[u8; 4]>,
    greatest: Vec<[u8; 4]>,
}

impl OverTime {
    fn new(frames: usize) -> Self {
        Self { frames, added: 0, some: Vec::new(), least: Vec::new(), greatest: Vec::new() }
    }

    fn add(&mut self, frame: Pixels) {
        self.least.resize(frame.len(), [u8::MAX; 4]);
        self.greatest.resize(frame.len(), [0; 4]);
        for ((least, greatest), pixel) in self.least.iter_mut().zip(&mut self.greatest).zip(frame.iter()) {
            for ((least, greatest), value) in least.iter_mut().zip(greatest).zip(pixel.to_le_bytes()) {
                *least = value.min(*least);
                *greatest = value.max(*greatest);
            }
        }
        // One at each time that the share of what was added reaches another one of those that are held.
        let most = MEDIAN_OF.min(self.frames);
        self.added += 1;
        if self.added * most / self.frames > self.some.len() {
            self.some.push(frame);
        }
    }

    /// Pixels that leave their median by more than `threshold` (of 1).
    fn moving(&self, threshold: f32) -> Vec<bool> {
        let limit = (threshold * 255.0).round() as i32;
        let mut values = Vec::with_capacity(self.some.len());
        (0..self.least.len())
            .map(|pixel| {
                (0..3).any(|channel| {
                    values.clear();
                    values.extend(self.some.iter().map(|frame| i32::from(frame[pixel].to_le_bytes()[channel])));
                    values.sort_unstable();
                    let median = values[values.len() / 2];
                    let [least, greatest] = [&self.least, &self.greatest].map(|of| i32::from(of[pixel][channel]));
                    median - least > limit || greatest - median > limit
                })
            })
            .collect()
    }
}

/// The mask grown by `radius` pixels (a square).
pub(crate) fn grow(mask: &[bool], width: usize, radius: usize) -> Vec<bool> {
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
        let mut pixels = OverTime::new(3);
        for frame in [[still, still], [still, 0xff10_1080], [still, still]] {
            pixels.add(Pixels::new(frame.to_vec()));
        }
        assert_eq!(pixels.moving(0.06), [false, true]);
    }

    #[test]
    fn of_many_frames_some_are_held_and_all_count() {
        for frames in [63, 64, 65, 100, 1000] {
            let mut pixels = OverTime::new(frames);
            // The second pixel changes for one frame, wherever that is among those that are held; the third has two values half of the time each.
            for at in 0..frames {
                let half = if at < frames / 2 { 0xff10_1010 } else { 0xff10_1013 };
                pixels.add(Pixels::new(vec![0xff10_1010, if at == 38 { 0xff10_8010 } else { 0xff10_1010 }, half]));
            }
            assert_eq!(pixels.some.len(), frames.min(MEDIAN_OF), "{frames}");
            assert_eq!(pixels.moving(0.06), [false, true, false], "{frames}");
        }
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
