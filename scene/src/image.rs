//! Images in memory and in PNG and JPEG files.

mod decoding;
mod listing;
mod reading;

use std::{
    fs::File,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic, order::Doubt};
use image::{
    ExtendedColorType, ImageBuffer, ImageEncoder, Luma, Rgb,
    codecs::{
        jpeg::JpegEncoder,
        png::{CompressionType, FilterType, PngEncoder},
    },
    imageops,
};

use self::decoding::decode;
pub use self::{
    decoding::size,
    listing::{is_picture, pictures},
    reading::{FEW_BITS, Reading},
};
use crate::srgb;

/// What can go wrong with an image file.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file cannot be opened or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file is no image that can be decoded.
    #[error("cannot decode image {}: {source}; check that it is a complete PNG or JPEG file", path.display())]
    Decode {
        /// The image file.
        path: PathBuf,
        /// Why.
        source: Box<image::ImageError>,
    },
    /// The image is transparent somewhere, and nothing says what it is to be laid over.
    #[error(
        "{} has transparent pixels: give a background (erfgs dataset import --background black, or white, or #rrggbb), or save it \
         without transparency",
        path.display()
    )]
    Transparent {
        /// The image file.
        path: PathBuf,
    },
    /// The picture is stored in another position than it is to be shown in.
    #[error(
        "the EXIF data of {} asks to show it turned {how}, which not all programs do: store it as shown (mogrify -auto-orient), or \
         remove the tag if lenses and poses belong to the picture as stored (exiftool -Orientation=)",
        path.display()
    )]
    Turned {
        /// The image file.
        path: PathBuf,
        /// How.
        how: &'static str,
    },
    /// The samples have 16 bits of which the upper ones may not count.
    #[error(
        "the samples of {} have 16 bits, and the largest is {most}: either fewer bits count, or the picture is nearly black; say \
         how many (erfgs dataset import --bits 10, or 12; --bits 16 if all do), or write them in 8 bits",
        path.display()
    )]
    FewBits {
        /// The image file.
        path: PathBuf,
        /// The largest sample.
        most: u16,
    },
    /// A sample has more bits than count.
    #[error("a sample of {} is {sample}, which is more than {bits} bits hold; give --bits as many as count", path.display())]
    MoreBits {
        /// The image file.
        path: PathBuf,
        /// The sample.
        sample: u16,
        /// The bits that count.
        bits: u8,
    },
    /// Nobody knows which of two pictures of a folder comes first.
    #[error("{}: {doubt}", folder.display())]
    Order {
        /// The folder.
        folder: PathBuf,
        /// Which two, and why.
        doubt: Box<Doubt>,
    },
    /// The image cannot be encoded.
    #[error("cannot encode image {}: {source}", path.display())]
    Encode {
        /// The image file.
        path: PathBuf,
        /// Why.
        source: Box<image::ImageError>,
    },
}

/// How an image is resized.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resample {
    /// The mean over the source area that a target pixel covers (OpenCV's `INTER_AREA` when shrinking). Keeps masks and
    /// event counts meaningful and never rings; what v2e does.
    #[default]
    Area,
    /// Lanczos with three lobes, widened when shrinking. Sharper, may ring at edges; what 4DGS uses for Neu3D.
    Lanczos,
}

/// A colour image: `data` holds `height` rows of `width` pixels of red, green, blue, sRGB-encoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageRgb8 {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width * height * 3` bytes.
    pub data: Vec<u8>,
}

/// A colour image of 16 bits: `data` holds `height` rows of `width` pixels of red, green, blue, sRGB-encoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageRgb16 {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width * height * 3` values.
    pub data: Vec<u16>,
}

/// A grey image: `data` holds `height` rows of `width` values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageGrey8 {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width * height` bytes.
    pub data: Vec<u8>,
}

impl ImageRgb8 {
    /// A black image.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, data: vec![0; width as usize * height as usize * 3] }
    }

    /// Reads a PNG or JPEG file. Grey images are spread to three channels, 16-bit ones reduced to 8.
    ///
    /// # Errors
    /// If the file is missing, cut short or no image, is transparent somewhere, or has samples of 16 bits of which the upper ones
    /// may not count; [`ImageRgb8::read_as`] is told more.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        let (image, most) = Self::read_as(path, Reading::default())?;
        reading::few_bits(path, most)?;
        Ok(image)
    }

    /// Writes a PNG file (fast compression; the same image gives the same bytes), making its folder where needed.
    ///
    /// # Errors
    /// If the file cannot be written, or `data` has the wrong length.
    pub fn write_png(&self, path: &Path) -> Result<(), ImageError> {
        encode(path, &self.data, self.width, self.height, ExtendedColorType::Rgb8)
    }

    /// The red, green and blue value of the pixel in column `x` and row `y`.
    ///
    /// # Panics
    /// If the pixel lies outside the image.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = (y as usize * self.width as usize + x as usize) * 3;
        [self.data[at], self.data[at + 1], self.data[at + 2]]
    }

    /// The image resized to `width` x `height` pixels.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32, how: Resample) -> Self {
        Self { width, height, data: resize::<Rgb<u8>, 3>(&self.data, [self.width, self.height], [width, height], how) }
    }

    /// Luma of every pixel, 0..=255: 0.299 R + 0.587 G + 0.114 B of the encoded values, not rounded.
    #[must_use]
    pub fn luma(&self) -> Vec<f32> {
        self.data
            .chunks_exact(3)
            .map(|p| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]))
            .collect()
    }

    /// The code, 0..=255 and not rounded, of the grey that has each pixel's luminance: 0.2126 R + 0.7152 G + 0.0722 B of linear
    /// light (sRGB's primaries). Of greys it is their luma; of saturated colours it is not.
    #[must_use]
    pub fn luminance(&self) -> Vec<f32> {
        let linear: [f32; 256] = std::array::from_fn(|code| srgb::decode(code as f32 / 255.0));
        let of = |code: u8| linear[usize::from(code)];
        let luminance = |p: &[u8]| 0.2126 * of(p[0]) + 0.7152 * of(p[1]) + 0.0722 * of(p[2]);
        self.data.chunks_exact(3).map(|p| 255.0 * srgb::encode(luminance(p))).collect()
    }

    /// Luma, rounded to 8 bits.
    #[must_use]
    pub fn grey(&self) -> ImageGrey8 {
        let data = self.luma().into_iter().map(|value| (value + 0.5) as u8).collect();
        ImageGrey8 { width: self.width, height: self.height, data }
    }
}

impl ImageRgb16 {
    /// Writes a PNG file of 16 bits a colour, making its folder where needed.
    ///
    /// # Errors
    /// If the file cannot be written, or `data` has the wrong length.
    pub fn write_png(&self, path: &Path) -> Result<(), ImageError> {
        encode(path, bytemuck::cast_slice(&self.data), self.width, self.height, ExtendedColorType::Rgb16)
    }
}

impl ImageGrey8 {
    /// A black image.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, data: vec![0; width as usize * height as usize] }
    }

    /// Reads a PNG or JPEG file. Colour is reduced to luma, 1-bit values become 0 and 255.
    ///
    /// # Errors
    /// As [`ImageRgb8::read`].
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        let image = decode(path)?;
        reading::check(path, &image)?;
        let image = image.into_luma8();
        Ok(Self { width: image.width(), height: image.height(), data: image.into_raw() })
    }

    /// Writes a PNG file, making its folder where needed.
    ///
    /// # Errors
    /// If the file cannot be written, or `data` has the wrong length.
    pub fn write_png(&self, path: &Path) -> Result<(), ImageError> {
        encode(path, &self.data, self.width, self.height, ExtendedColorType::L8)
    }

    /// The image resized to `width` x `height` pixels.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32, how: Resample) -> Self {
        Self { width, height, data: resize::<Luma<u8>, 1>(&self.data, [self.width, self.height], [width, height], how) }
    }

    /// Every value made 0 or 255: 255 where it is at least 128.
    #[must_use]
    pub fn binarised(mut self) -> Self {
        self.data.iter_mut().for_each(|value| *value = if *value >= 128 { 255 } else { 0 });
        self
    }
}

/// A picture of `width * height` pixels of red, green and blue as a JPEG file of `quality` (1 to 100); `None` where it has no
/// pixels, not as many, or more than the format holds.
#[must_use]
pub fn jpeg(data: &[u8], width: u32, height: u32, quality: u8) -> Option<Vec<u8>> {
    let expected = width as usize * height as usize * 3;
    if expected == 0 || data.len() != expected {
        return None;
    }
    let mut bytes = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    encoder.write_image(data, width, height, ExtendedColorType::Rgb8).ok()?;
    Some(bytes)
}

/// The samples of a picture, row by row: grey, or red, green and blue.
#[derive(Clone, Copy, Debug)]
pub enum PngSamples<'a> {
    /// Grey of 8 bits.
    Grey8(&'a [u8]),
    /// Colour of 8 bits.
    Rgb8(&'a [u8]),
    /// Grey of 16 bits.
    Grey16(&'a [u16]),
    /// Colour of 16 bits.
    Rgb16(&'a [u16]),
}

/// A picture of `width * height` pixels as a PNG file; `None` where it has no pixels, or not as many.
#[must_use]
pub fn png(samples: PngSamples<'_>, width: u32, height: u32) -> Option<Vec<u8>> {
    let (data, colour): (&[u8], _) = match samples {
        PngSamples::Grey8(data) => (data, ExtendedColorType::L8),
        PngSamples::Rgb8(data) => (data, ExtendedColorType::Rgb8),
        PngSamples::Grey16(data) => (bytemuck::cast_slice(data), ExtendedColorType::L16),
        PngSamples::Rgb16(data) => (bytemuck::cast_slice(data), ExtendedColorType::Rgb16),
    };
    let expected = width as usize * height as usize * usize::from(colour.bits_per_pixel()) / 8;
    if expected == 0 || data.len() != expected {
        return None;
    }
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive);
    encoder.write_image(data, width, height, colour).ok()?;
    Some(bytes)
}

fn encode(path: &Path, data: &[u8], width: u32, height: u32, colour: ExtendedColorType) -> Result<(), ImageError> {
    let io = FileError::when("write image", path);
    let bytes = usize::from(colour.bits_per_pixel()) / 8;
    if data.len() != width as usize * height as usize * bytes {
        let what = format!("{} bytes do not make {width} x {height} pixels", data.len());
        return Err(io(std::io::Error::new(std::io::ErrorKind::InvalidInput, what)).into());
    }
    let write = |file: &mut std::io::BufWriter<&File>| {
        PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Adaptive)
            .write_image(data, width, height, colour)
            .map_err(|source| ImageError::Encode { path: path.to_owned(), source: Box::new(source) })
    };
    atomic::try_write_one_of_many(path, write, |error| io(error).into())
}

fn resize<P, const C: usize>(data: &[u8], from: [u32; 2], to: [u32; 2], how: Resample) -> Vec<u8>
where
    P: image::Pixel<Subpixel = u8> + 'static,
{
    if from == to {
        return data.to_vec();
    }
    match how {
        Resample::Area => area::<C>(data, from, to),
        Resample::Lanczos => match ImageBuffer::<P, &[u8]>::from_raw(from[0], from[1], data) {
            Some(image) => imageops::resize(&image, to[0], to[1], imageops::FilterType::Lanczos3).into_raw(),
            None => vec![0; to[0] as usize * to[1] as usize * C],
        },
    }
}

/// The overlap of target pixel `index` of `to` with the source pixels of a line of `from`: first pixel and weights.
fn overlap(index: u32, from: u32, to: u32) -> (usize, Vec<f32>) {
    let scale = f64::from(from) / f64::from(to);
    let (start, end) = (f64::from(index) * scale, (f64::from(index) + 1.0) * scale);
    let first = (start.floor() as usize).min(from.saturating_sub(1) as usize);
    let last = (end.ceil() as usize).clamp(first + 1, (from as usize).max(first + 1));
    let cover = |pixel: usize| (end.min(pixel as f64 + 1.0) - start.max(pixel as f64)).max(0.0);
    let total: f64 = (first..last).map(cover).sum();
    (first, (first..last).map(|pixel| (cover(pixel) / total.max(f64::MIN_POSITIVE)) as f32).collect())
}

fn area<const C: usize>(data: &[u8], from: [u32; 2], to: [u32; 2]) -> Vec<u8> {
    if from.contains(&0) || data.len() < from[0] as usize * from[1] as usize * C {
        return vec![0; to[0] as usize * to[1] as usize * C];
    }
    let columns: Vec<_> = (0..to[0]).map(|x| overlap(x, from[0], to[0])).collect();
    let (stride, mut out) = (from[0] as usize * C, Vec::with_capacity(to[0] as usize * to[1] as usize * C));
    let mut line = vec![0.0_f32; stride];
    for y in 0..to[1] {
        let (top, weights) = overlap(y, from[1], to[1]);
        line.fill(0.0);
        for (row, weight) in data.chunks_exact(stride).skip(top).zip(&weights) {
            line.iter_mut().zip(row).for_each(|(sum, &value)| *sum += weight * f32::from(value));
        }
        for (left, weights) in &columns {
            for channel in 0..C {
                let sum: f32 = line[left * C + channel..].iter().step_by(C).zip(weights).map(|(v, w)| v * w).sum();
                out.push((sum + 0.5) as u8);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_becomes_a_jpeg_and_one_that_is_none_nothing() {
        assert!(jpeg(&[0; 60], 5, 4, 80).is_some_and(|bytes| bytes.starts_with(&[0xff, 0xd8, 0xff])));
        assert_eq!(jpeg(&[], 0, 4, 80), None);
        assert_eq!(jpeg(&[0; 7], 5, 4, 80), None);
        assert_eq!(jpeg(&[0; 210_000], 70_000, 1, 80), None);
    }

    #[test]
    fn a_png_in_memory_is_the_picture_with_all_its_bits() {
        let decoded = |bytes: Option<Vec<u8>>| image::load_from_memory(&bytes.unwrap()).unwrap();
        let colour = gradient(5, 4);
        assert_eq!(decoded(png(PngSamples::Rgb8(&colour.data), 5, 4)).into_rgb8().into_raw(), colour.data);
        let grey = [0_u16, 1, 256, 65_535, 40_000, 4095];
        assert_eq!(decoded(png(PngSamples::Grey16(&grey), 3, 2)).into_luma16().into_raw(), grey);
        assert_eq!(decoded(png(PngSamples::Rgb16(&grey), 2, 1)).into_rgb16().into_raw(), grey);
        assert_eq!(decoded(png(PngSamples::Grey8(&[7, 9]), 1, 2)).into_luma8().into_raw(), [7, 9]);
        assert_eq!(png(PngSamples::Grey8(&[]), 0, 2), None);
        assert_eq!(png(PngSamples::Grey8(&[1]), 1, 2), None);
    }

    fn gradient(width: u32, height: u32) -> ImageRgb8 {
        let mut image = ImageRgb8::new(width, height);
        for (index, pixel) in image.data.chunks_exact_mut(3).enumerate() {
            let (x, y) = (index as u32 % width, index as u32 / width);
            pixel.copy_from_slice(&[(x * 7) as u8, (y * 11) as u8, (x * y) as u8]);
        }
        image
    }

    #[test]
    fn png_keeps_every_byte() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/er/0000.png");
        let image = gradient(37, 21);
        image.write_png(&path).unwrap();
        assert_eq!(ImageRgb8::read(&path).unwrap(), image);
        let deep = ImageRgb16 { width: 2, height: 1, data: vec![1, 2, 65_535, 256, 40_000, 0] };
        deep.write_png(&path).unwrap();
        assert_eq!(image::open(&path).unwrap().into_rgb16().into_raw(), deep.data);
        let grey = ImageGrey8 { width: 3, height: 2, data: vec![0, 255, 7, 9, 128, 127] };
        grey.write_png(&path).unwrap();
        assert_eq!(ImageGrey8::read(&path).unwrap(), grey);
        assert_eq!(grey.binarised().data, [0, 255, 0, 0, 255, 0]);
    }

    #[test]
    fn a_png_cut_short_anywhere_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        gradient(5, 4).write_png(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        // The last chunk (IEND, 12 bytes) carries nothing, and decoders may do without it.
        for length in 0..whole.len() - 12 {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(ImageRgb8::read(&path).is_err(), "{length} of {} bytes", whole.len());
        }
    }

    #[test]
    fn halving_by_area_is_the_mean_of_four_pixels() {
        let image = gradient(8, 6);
        let half = image.resized(4, 3, Resample::Area);
        for y in 0..3 {
            for x in 0..4 {
                for channel in 0..3 {
                    let sum: u32 = [(0, 0), (1, 0), (0, 1), (1, 1)]
                        .iter()
                        .map(|(dx, dy)| u32::from(image.pixel(2 * x + dx, 2 * y + dy)[channel]))
                        .sum();
                    assert_eq!(u32::from(half.pixel(x, y)[channel]), (sum + 2) / 4);
                }
            }
        }
    }

    #[test]
    fn both_filters_keep_a_flat_image_flat_at_any_size() {
        let mut image = ImageRgb8::new(13, 9);
        image.data.fill(201);
        for how in [Resample::Area, Resample::Lanczos] {
            for (width, height) in [(1, 1), (4, 3), (13, 9), (29, 40)] {
                let resized = image.resized(width, height, how);
                assert_eq!(resized.data, vec![201; (width * height * 3) as usize], "{how:?} {width}x{height}");
            }
        }
    }

    #[test]
    fn luma_weighs_channels_as_opencv_does() {
        let image = ImageRgb8 { width: 2, height: 1, data: vec![255, 0, 0, 10, 20, 30] };
        let luma = image.luma();
        assert!((luma[0] - 76.245).abs() < 1e-4 && (luma[1] - (2.99 + 11.74 + 3.42)).abs() < 1e-5);
    }

    #[test]
    fn luminance_adds_up_light_and_not_codes() {
        let image = ImageRgb8 { width: 3, height: 1, data: vec![0, 0, 255, 255, 0, 0, 77, 77, 77] };
        let luminance = image.luminance();
        // A blue as bright as a grey of 7.22 % of the light, where luma says 29 of 255.
        assert!((luminance[0] - 255.0 * srgb::encode(0.0722)).abs() < 1e-3 && luminance[0] > 75.0);
        assert!((luminance[1] - 255.0 * srgb::encode(0.2126)).abs() < 1e-3);
        assert!((luminance[2] - 77.0).abs() < 1e-2, "a grey is its own");
    }
}
