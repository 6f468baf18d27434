//! Pictures of a take: the truth, and what each method makes of it, at one time between frames.

use std::path::Path;

use erfgs_dataset::{Camera, Dataset, Split};
use erfgs_run::RunFolder;
use erfgs_scene::{ImageGrey8, ImageRgb8};

use crate::ActsError;

/// A held-out frame, and the part of it where things move.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shot {
    /// Name of the camera.
    pub camera: String,
    /// Index of the frame.
    pub index: u32,
    /// Column, row, width and height of the part, pixels.
    pub part: [u32; 4],
}

/// So many pixels around what moves are shown, too.
const RIM: u32 = 6;

/// The frame of a held-out camera, between the exposures of the training frames where there are such, in which most pixels move, and
/// the part of it that holds them. None where nothing moves.
///
/// # Errors
/// [`ActsError`].
pub fn choose(dataset: &Dataset) -> Result<Option<Shot>, ActsError> {
    let exposures: Vec<[i64; 2]> =
        dataset.cameras(Split::Train).flat_map(|camera| camera.frames.iter().map(|frame| frame.exposure_ns)).collect();
    let exposed = |t: i64| exposures.iter().any(|[open, close]| (*open..=*close).contains(&t));
    let mut best: Option<((bool, usize), Shot)> = None;
    for camera in dataset.cameras(Split::Test) {
        for (index, frame) in camera.frames.iter().enumerate() {
            let Some(mask) = dataset.read_mask(camera, frame)? else { continue };
            let moving = mask.data.iter().filter(|value| **value > 127).count();
            let rank = (!exposed(frame.t_ns), moving);
            if moving > 0 && best.as_ref().is_none_or(|(known, _)| rank > *known) {
                best = Some((rank, Shot { camera: camera.name.clone(), index: index as u32, part: bounds(&mask) }));
            }
        }
    }
    Ok(best.map(|(_, shot)| shot))
}

/// The least rectangle that holds what moves, and its rim.
fn bounds(mask: &ImageGrey8) -> [u32; 4] {
    let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
    for (at, _) in mask.data.iter().enumerate().filter(|(_, value)| **value > 127) {
        let place = [at as u32 % mask.width, at as u32 / mask.width];
        for axis in 0..2 {
            low[axis] = low[axis].min(place[axis]);
            high[axis] = high[axis].max(place[axis]);
        }
    }
    let [left, top] = low.map(|side| side.saturating_sub(RIM));
    let (right, bottom) = ((high[0] + RIM + 1).min(mask.width), (high[1] + RIM + 1).min(mask.height));
    [left, top, right - left, bottom - top]
}

impl Shot {
    /// Writes the truth of it as PNG.
    ///
    /// # Errors
    /// [`ActsError`].
    pub fn write_truth(&self, dataset: &Dataset, file: &Path) -> Result<(), ActsError> {
        let of_name = |camera: &&Camera| camera.name == self.camera;
        let Some(camera) = dataset.cameras(Split::Test).find(of_name) else { return Ok(()) };
        let Some(frame) = camera.frames.get(self.index as usize) else { return Ok(()) };
        Ok(self.cropped(&dataset.read_image(camera, frame)?).write_png(file)?)
    }

    /// Writes what a run rendered of it as PNG; false where it has no such picture.
    ///
    /// # Errors
    /// [`ActsError`].
    pub fn write_render(&self, run: &RunFolder, file: &Path) -> Result<bool, ActsError> {
        let render = run.render_file(&self.camera, self.index)?;
        if !render.is_file() {
            return Ok(false);
        }
        self.cropped(&ImageRgb8::read(&render)?).write_png(file)?;
        Ok(true)
    }

    fn cropped(&self, image: &ImageRgb8) -> ImageRgb8 {
        let [left, top, width, height] = self.part;
        let (left, top) = (left.min(image.width.saturating_sub(1)), top.min(image.height.saturating_sub(1)));
        let (width, height) = (width.min(image.width - left), height.min(image.height - top));
        let row = |y: u32| {
            let from = 3 * (y as usize * image.width as usize + left as usize);
            &image.data[from..from + 3 * width as usize]
        };
        ImageRgb8 { width, height, data: (top..top + height).flat_map(row).copied().collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_holds_what_moves_and_stays_in_the_picture() {
        let mut mask = ImageGrey8 { width: 40, height: 30, data: vec![0; 1200] };
        mask.data[40 * 2 + 20] = 255;
        mask.data[40 * 12 + 38] = 255;
        assert_eq!(bounds(&mask), [14, 0, 26, 19]);
        let shot = Shot { camera: "test00".into(), index: 0, part: bounds(&mask) };
        let mut image = ImageRgb8::new(40, 30);
        image.data[3 * (40 * 2 + 20)] = 7;
        let part = shot.cropped(&image);
        assert_eq!((part.width, part.height, part.pixel(6, 2)), (26, 19, [7, 0, 0]));
        let small = shot.cropped(&ImageRgb8::new(10, 5));
        assert_eq!(small.data.len(), 3 * small.width as usize * small.height as usize);
    }
}
