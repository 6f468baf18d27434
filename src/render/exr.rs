//! OpenEXR files: linear colour, alpha and depth.

use std::path::Path;

use anyhow::Context;
use erfgs_scene::{ImageRgb8, pixel::LightRgb, srgb::decode as to_linear};
use erfgs_train::trainer::Rendered;
use exr::prelude::{Image, SpecificChannels, WritableImage, f16};

/// Writes `R`, `G`, `B` (half, linear light, over the background), `A` (half) and `Z` (float, metres along the optical
/// axis: the mean over what the pixel shows, infinite where it shows nothing).
pub fn write(path: &Path, width: u32, height: u32, rendered: &Rendered) -> anyhow::Result<()> {
    let [width, height] = [width as usize, height as usize];
    let channels = SpecificChannels::build()
        .with_channel("R")
        .with_channel("G")
        .with_channel("B")
        .with_channel("A")
        .with_channel("Z")
        .with_pixel_fn(|position| {
            let index = position.y() * width + position.x();
            let [r, g, b] = [0, 1, 2].map(|channel| f16::from_f32(to_linear(rendered.rgb[3 * index + channel])));
            let depth = rendered.depth[index];
            let depth = if depth > 0.0 { depth } else { f32::INFINITY };
            (r, g, b, f16::from_f32(1.0 - rendered.transmittance[index]), depth)
        });
    Image::from_channels((width, height), channels)
        .write()
        .to_file(path)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Writes the `R`, `G`, `B` (half, linear light) of a picture that is coded as sRGB.
pub fn write_rgb8(path: &Path, image: &ImageRgb8) -> anyhow::Result<()> {
    let [width, height] = [image.width as usize, image.height as usize];
    let linear: Vec<f16> = (0..=255_u8).map(|level| f16::from_f32(to_linear(f32::from(level) / 255.0))).collect();
    let channels = SpecificChannels::rgb(|position: exr::math::Vec2<usize>| {
        let index = 3 * (position.y() * width + position.x());
        let [r, g, b] = [0, 1, 2].map(|channel| linear[usize::from(image.data[index + channel])]);
        (r, g, b)
    });
    Image::from_channels((width, height), channels)
        .write()
        .to_file(path)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Writes the `R`, `G`, `B` (float, linear light, nothing cut) of a frame as a sensor gave it.
pub fn write_light(path: &Path, light: &LightRgb) -> anyhow::Result<()> {
    let [width, height] = [light.width as usize, light.height as usize];
    let channels = SpecificChannels::rgb(|position: exr::math::Vec2<usize>| {
        let index = 3 * (position.y() * width + position.x());
        (light.data[index], light.data[index + 1], light.data[index + 2])
    });
    Image::from_channels((width, height), channels)
        .write()
        .to_file(path)
        .with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use exr::prelude::{ReadChannels, ReadLayers, read};

    use super::*;

    #[test]
    fn a_picture_reads_back_as_linear_light_with_depth_in_metres() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("view.exr");
        let rendered =
            Rendered { rgb: vec![0.5, 0.0, 1.0, 0.2, 0.2, 0.2], transmittance: vec![0.5, 1.0], depth: vec![3.0, 0.0] };
        write(&path, 2, 1, &rendered).expect("written");
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
}
