//! What a picture leaves open: what lies under transparent pixels, and how many of 16 bits count.

use std::path::Path;

use image::{DynamicImage, GenericImageView as _};

use super::{ImageError, ImageRgb8};

/// What is said of pictures that do not say it themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// The colour that transparent pixels are laid over, sRGB. Without it a picture with such pixels is refused.
    pub background: Option<[u8; 3]>,
    /// How many low bits of 16 hold the samples; all 16 without it.
    pub bits: Option<u8>,
}

/// Samples of 16 bits that stay below this have 12 bits or fewer, or are nearly black.
pub const FEW_BITS: u16 = 1 << 12;

impl ImageRgb8 {
    /// Reads a PNG or JPEG file, as [`ImageRgb8::read`] does, and takes `reading` for what it leaves open. Gives the largest
    /// sample, too, where these have 16 bits: below [`FEW_BITS`] the picture is nearly black unless `reading` says how many count.
    ///
    /// # Errors
    /// If the file is missing, cut short or no image, has transparent pixels and no background is given, or a sample of more bits.
    pub fn read_as(path: &Path, reading: Reading) -> Result<(Self, Option<u16>), ImageError> {
        let image = super::decode(path)?;
        let (width, height) = image.dimensions();
        if depth(&image) == 8 && !image.color().has_alpha() {
            return Ok((Self { width, height, data: image.into_rgb8().into_raw() }, None));
        }
        if depth(&image) == 8 {
            let rgba = image.into_rgba8().into_raw();
            let over = |pixel: &[u8; 4]| [pixel[0], pixel[1], pixel[2]];
            let (pixels, _) = rgba.as_chunks::<4>();
            let data = laid(path, pixels.iter().map(|pixel| (over(pixel), f32::from(pixel[3]) / 255.0)), reading)?;
            return Ok((Self { width, height, data }, None));
        }
        let rgba = image.into_rgba16().into_raw();
        let (pixels, _) = rgba.as_chunks::<4>();
        let most = pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).max().unwrap_or(0);
        let bits = reading.bits.unwrap_or(16);
        let white = (1_u32 << bits.clamp(1, 16)) - 1;
        if u32::from(most) > white {
            return Err(ImageError::MoreBits { path: path.to_owned(), sample: most, bits });
        }
        let level = |sample: u16| ((u32::from(sample) * 255 + white / 2) / white) as u8;
        let pixels = pixels.iter().map(|&[r, g, b, a]| ([r, g, b].map(level), f32::from(a) / 65_535.0));
        Ok((Self { width, height, data: laid(path, pixels, reading)? }, Some(most)))
    }
}

/// Bits of a sample.
fn depth(image: &DynamicImage) -> u8 {
    if image.color().bytes_per_pixel() / image.color().channel_count() > 1 { 16 } else { 8 }
}

/// Pixels laid over the background by their opacity.
fn laid(path: &Path, pixels: impl Iterator<Item = ([u8; 3], f32)>, reading: Reading) -> Result<Vec<u8>, ImageError> {
    let mut data = Vec::new();
    for (colour, opacity) in pixels {
        if opacity >= 1.0 {
            data.extend(colour);
            continue;
        }
        let background = reading.background.ok_or_else(|| ImageError::Transparent { path: path.to_owned() })?;
        let over =
            |channel: usize| opacity * f32::from(colour[channel]) + (1.0 - opacity) * f32::from(background[channel]);
        data.extend([0, 1, 2].map(|channel| (over(channel) + 0.5) as u8));
    }
    Ok(data)
}

/// Refuses what nothing can be said of: transparent pixels, and samples of 16 bits that are nearly black.
pub(super) fn check(path: &Path, image: &DynamicImage) -> Result<(), ImageError> {
    let has_alpha = image.color().has_alpha();
    if has_alpha && image.pixels().any(|(_, _, pixel)| pixel.0[3] < 255) {
        return Err(ImageError::Transparent { path: path.to_owned() });
    }
    let most = match image {
        DynamicImage::ImageLuma16(samples) => samples.iter().max().copied(),
        DynamicImage::ImageRgb16(samples) => samples.iter().max().copied(),
        DynamicImage::ImageLumaA16(samples) => samples.pixels().map(|pixel| pixel.0[0]).max(),
        DynamicImage::ImageRgba16(samples) => {
            samples.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2]]).max()
        }
        _ => None,
    };
    few_bits(path, most)
}

/// Refuses a picture whose largest sample of 16 bits is so small that not all of them count.
pub(super) fn few_bits(path: &Path, most: Option<u16>) -> Result<(), ImageError> {
    match most {
        Some(most @ 1..FEW_BITS) => Err(ImageError::FewBits { path: path.to_owned(), most }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use image::{ImageBuffer, Luma, LumaA, Rgb, Rgba};

    use super::*;
    use crate::ImageGrey8;

    #[test]
    fn samples_of_any_depth_become_the_same_grey_where_it_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        for bits in [9, 10, 12, 14, 16_u8] {
            let white = ((1_u32 << bits) - 1) as u16;
            for colours in [false, true] {
                let level = |x: u32| (u32::from(white) * x / 63) as u16;
                if colours {
                    ImageBuffer::from_fn(64, 2, |x, _| Rgb([level(x); 3])).save(&path).unwrap();
                } else {
                    ImageBuffer::from_fn(64, 2, |x, _| Luma([level(x)])).save(&path).unwrap();
                }
                let (image, most) =
                    ImageRgb8::read_as(&path, Reading { bits: Some(bits), ..Reading::default() }).unwrap();
                assert_eq!(most, Some(white));
                for x in 0..64 {
                    assert!(u32::from(image.pixel(x, 1)[0]).abs_diff(255 * x / 63) <= 1, "{bits} bits, {x}");
                }
                // Nothing is said: full scale, or refused where the picture is nearly black.
                for error in [ImageRgb8::read(&path).err(), ImageGrey8::read(&path).err()] {
                    assert_eq!(error.is_some(), bits <= 12, "{bits} bits: {error:?}");
                    assert!(error.is_none_or(|error| error.to_string().contains(&format!("largest is {white}"))));
                }
                let few =
                    ImageRgb8::read_as(&path, Reading { bits: Some(bits - 1), ..Reading::default() }).unwrap_err();
                assert!(few.to_string().contains(&format!("more than {} bits", bits - 1)), "{few}");
            }
        }
    }

    #[test]
    fn transparent_pixels_are_laid_over_a_colour_that_is_given_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let save: [&dyn Fn(u8); 4] = [
            &|a| {
                ImageBuffer::from_fn(2, 1, |x, _| Rgba([200_u8, 10, 90, if x == 0 { a } else { 255 }]))
                    .save(&path)
                    .unwrap()
            },
            &|a| ImageBuffer::from_fn(2, 1, |x, _| LumaA([200_u8, if x == 0 { a } else { 255 }])).save(&path).unwrap(),
            &|a| {
                let a = u16::from(a) * 257;
                let colour = |x| Rgba([200 * 257, 10 * 257, 90 * 257, if x == 0 { a } else { u16::MAX }]);
                ImageBuffer::from_fn(2, 1, |x, _| colour(x)).save(&path).unwrap();
            },
            &|a| {
                let a = u16::from(a) * 257;
                ImageBuffer::from_fn(2, 1, |x, _| LumaA([200 * 257_u16, if x == 0 { a } else { u16::MAX }]))
                    .save(&path)
                    .unwrap();
            },
        ];
        for (kind, save) in save.into_iter().enumerate() {
            for alpha in [0, 1, 128, 254, 255] {
                save(alpha);
                for refused in [ImageRgb8::read(&path).err(), ImageGrey8::read(&path).err()] {
                    assert_eq!(refused.is_some(), alpha < 255, "{kind}, {alpha}: {refused:?}");
                    assert!(refused.is_none_or(|error| error.to_string().contains("--background")));
                }
                for background in [[0; 3], [255; 3], [10, 20, 30]] {
                    let reading = Reading { background: Some(background), ..Reading::default() };
                    let (image, _) = ImageRgb8::read_as(&path, reading).unwrap();
                    let part = f32::from(alpha) / 255.0;
                    let wanted = 200.0 * part + f32::from(background[0]) * (1.0 - part);
                    assert!((f32::from(image.pixel(0, 0)[0]) - wanted).abs() <= 1.0, "{kind}, {alpha}");
                    assert_eq!(image.pixel(1, 0)[0], 200);
                }
            }
        }
    }
}
