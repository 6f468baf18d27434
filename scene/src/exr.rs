//! OpenEXR files: linear colour, alpha and depth.

use std::{
    fs::File,
    io::BufWriter,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic, ending::place_of};
use exr::{
    error::Error,
    math::Vec2,
    prelude::{Image, SpecificChannels, WritableImage, f16},
};

use crate::{ImageRgb8, pixel::LightRgb, srgb::decode as to_linear};

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
pub enum ExrError {
    /// The file system refuses.
    #[error(transparent)]
    File(#[from] FileError),
    /// The picture makes no such file.
    #[error("cannot write {}: {source}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Error,
    },
}

/// A rendered view: rows of `width` pixels.
#[derive(Clone, Copy, Debug)]
pub struct Layers<'a> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Red, green and blue of every pixel over the background, sRGB-encoded.
    pub rgb: &'a [f32],
    /// Light that passes every pixel, 0 to 1.
    pub transmittance: &'a [f32],
    /// Depth of every pixel, metres; 0 where nothing is.
    pub depth: &'a [f32],
}

/// Writes `R`, `G`, `B` (half, linear light, over the background), `A` (half) and `Z` (float, metres along the optical
/// axis: the mean over what the pixel shows, infinite where it shows nothing).
///
/// # Errors
/// If the layers differ in size or the file cannot be written.
pub fn write_layers(path: &Path, layers: &Layers<'_>) -> Result<(), ExrError> {
    let size = [layers.width as usize, layers.height as usize];
    let pixels = size[0] * size[1];
    require(path, [layers.rgb.len(), layers.transmittance.len(), layers.depth.len()] == [3 * pixels, pixels, pixels])?;
    let channels = SpecificChannels::build()
        .with_channel("R")
        .with_channel("G")
        .with_channel("B")
        .with_channel("A")
        .with_channel("Z")
        .with_pixel_fn(|position| {
            let index = position.y() * size[0] + position.x();
            let [r, g, b] = [0, 1, 2].map(|channel| f16::from_f32(to_linear(layers.rgb[3 * index + channel])));
            let depth = layers.depth[index];
            let depth = if depth > 0.0 { depth } else { f32::INFINITY };
            (r, g, b, f16::from_f32(1.0 - layers.transmittance[index]), depth)
        });
    appear(path, |file| Image::from_channels((size[0], size[1]), channels).write().to_buffered(file))
}

/// Writes the `R`, `G`, `B` (half, linear light) of a picture that is coded as sRGB.
///
/// # Errors
/// If the picture has not the size that it says or the file cannot be written.
pub fn write_rgb8(path: &Path, image: &ImageRgb8) -> Result<(), ExrError> {
    let [width, height] = [image.width as usize, image.height as usize];
    require(path, image.data.len() == 3 * width * height)?;
    let linear: Vec<f16> = (0..=255_u8).map(|level| f16::from_f32(to_linear(f32::from(level) / 255.0))).collect();
    let channels = SpecificChannels::rgb(|position: Vec2<usize>| {
        let index = 3 * (position.y() * width + position.x());
        let [r, g, b] = [0, 1, 2].map(|channel| linear[usize::from(image.data[index + channel])]);
        (r, g, b)
    });
    appear(path, |file| Image::from_channels((width, height), channels).write().to_buffered(file))
}

/// Writes the `R`, `G`, `B` (float, linear light, nothing cut) of a frame as a sensor gave it.
///
/// # Errors
/// If the frame has not the size that it says or the file cannot be written.
pub fn write_light(path: &Path, light: &LightRgb) -> Result<(), ExrError> {
    let [width, height] = [light.width as usize, light.height as usize];
    require(path, light.data.len() == 3 * width * height)?;
    let channels = SpecificChannels::rgb(|position: Vec2<usize>| {
        let index = 3 * (position.y() * width + position.x());
        (light.data[index], light.data[index + 1], light.data[index + 2])
    });
    appear(path, |file| Image::from_channels((width, height), channels).write().to_buffered(file))
}

/// Writes a file that appears whole or not at all.
fn appear(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), Error>) -> Result<(), ExrError> {
    written(path, atomic::try_write_one_of_many(path, write, Error::Io))
}

fn require(path: &Path, fits: bool) -> Result<(), ExrError> {
    written(path, if fits { Ok(()) } else { Err(Error::Invalid("the pixels are not as many as the size says".into())) })
}

fn written(path: &Path, result: Result<(), Error>) -> Result<(), ExrError> {
    result.map_err(|source| match source {
        Error::Io(source) => FileError::when("write", path)(source).into(),
        source => ExrError::Picture { path: place_of(path), source },
    })
}

#[cfg(test)]
mod tests {
    use exr::prelude::{ReadChannels, ReadLayers, read};

    use super::*;

    #[test]
    fn a_picture_reads_back_as_linear_light_with_depth_in_metres() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("view.exr");
        let rgb = &[0.5, 0.0, 1.0, 0.2, 0.2, 0.2];
        let layers = Layers { width: 2, height: 1, rgb, transmittance: &[0.5, 1.0], depth: &[3.0, 0.0] };
        write_layers(&path, &layers).expect("written");
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(&path)
            .expect("an EXR file");
        let channel = |name: &str| -> Vec<f32> {
            let list = &image.layer_data.channel_data.list;
            let found = list.iter().find(|channel| channel.name.eq(name)).expect("the channel");
            found.sample_data.values_as_f32().collect()
        };
        assert!((channel("R")[0] - 0.2140).abs() < 2e-4 && channel("B")[0] == 1.0, "linear light");
        assert_eq!(channel("A"), [0.5, 0.0]);
        assert_eq!(channel("Z"), [3.0, f32::INFINITY]);
    }

    #[test]
    fn pixels_that_are_too_few_are_an_error() {
        let path = Path::new("/nowhere/view.exr");
        let layers = Layers { width: 2, height: 1, rgb: &[0.5; 6], transmittance: &[0.5], depth: &[3.0, 0.0] };
        for error in [
            write_layers(path, &layers).unwrap_err(),
            write_rgb8(path, &ImageRgb8 { width: 1, height: 2, data: vec![0; 5] }).unwrap_err(),
            write_light(path, &LightRgb { width: 1, height: 2, data: Vec::new() }).unwrap_err(),
        ] {
            assert!(error.to_string().contains("view.exr") && error.to_string().contains("size"), "{error:?}");
        }
    }
}
