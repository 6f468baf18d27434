//! Pictures in and out of the page: reading, error maps, details, data URIs.

use std::{io::Cursor, path::Path};

use erfgs_page::picture;
use erfgs_scene::image::{ImageRgb8, jpeg};
use image::{
    ExtendedColorType, ImageEncoder, RgbImage,
    codecs::png::PngEncoder,
    imageops::{self, FilterType},
};

/// Larger pictures are reduced to this width in the page, pixels.
const MAX_WIDTH: u32 = 800;
/// The URI of a picture that cannot be encoded, which no picture is that `read` lets through; the page would show a gap.
const NOTHING: &str = "data:,";
/// The error that the brightest colour of a map stands for, 8-bit steps.
pub(super) const FULL_ERROR: u8 = 64;
/// Colours of an error map at equal steps of the error, from none to [`FULL_ERROR`].
const ERROR_COLOURS: [[u8; 3]; 8] = [
    [0, 0, 4],
    [40, 11, 84],
    [101, 21, 110],
    [159, 42, 99],
    [212, 72, 66],
    [245, 125, 21],
    [250, 193, 39],
    [252, 255, 164],
];

/// A picture, or what is wrong with it.
pub(super) fn read(path: &Path) -> Result<RgbImage, String> {
    let failed = |error: &dyn std::fmt::Display| format!("'{}' could not be shown: {error}", path.display());
    let ImageRgb8 { width, height, data } = ImageRgb8::read(path).map_err(|error| failed(&error))?;
    let picture = RgbImage::from_raw(width, height, data).filter(|picture| !picture.is_empty());
    picture.ok_or_else(|| failed(&"it has no pixels"))
}

/// The largest channel difference of two pictures of one size, pixel by pixel, 8-bit steps.
pub(super) fn errors(a: &RgbImage, b: &RgbImage) -> Vec<u8> {
    let largest =
        |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| a.0.iter().zip(b.0).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0);
    a.pixels().zip(b.pixels()).map(largest).collect()
}

/// The errors as colours.
pub(super) fn error_map(width: u32, height: u32, errors: &[u8]) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let error = errors.get((y * width + x) as usize).copied().unwrap_or(0);
        image::Rgb(colour(f32::from(error) / f32::from(FULL_ERROR)))
    })
}

fn colour(share: f32) -> [u8; 3] {
    let at = share.clamp(0.0, 1.0) * (ERROR_COLOURS.len() - 1) as f32;
    let below = (at as usize).min(ERROR_COLOURS.len() - 2);
    let mix = at - below as f32;
    std::array::from_fn(|c| {
        let (low, high) = (f32::from(ERROR_COLOURS[below][c]), f32::from(ERROR_COLOURS[below + 1][c]));
        (low + mix * (high - low)).round() as u8
    })
}

/// The colours as a CSS gradient, for the legend.
pub(super) fn gradient() -> String {
    let stops: Vec<String> = ERROR_COLOURS.iter().map(|[r, g, b]| format!("rgb({r} {g} {b})")).collect();
    format!("linear-gradient(to right, {})", stops.join(", "))
}

/// Where a window of `width` x `height` pixels sees the largest sum of `weights` (of a picture of `size`), with what it
/// sees in its middle where the border allows.
pub(super) fn densest_window(weights: &[f64], size: (u32, u32), width: u32, height: u32) -> (u32, u32) {
    let (w, h) = (size.0 as usize, size.1 as usize);
    // Sums over the rectangle above and left of each corner.
    let mut sums = vec![0.0; (w + 1) * (h + 1)];
    for y in 0..h {
        let mut row = 0.0;
        for x in 0..w {
            row += weights.get(y * w + x).copied().unwrap_or(0.0);
            sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
        }
    }
    let (width, height) = (width.min(size.0) as usize, height.min(size.1) as usize);
    let mut best = (f64::NEG_INFINITY, (0, 0));
    for y in 0..=h - height {
        for x in 0..=w - width {
            let at = |x: usize, y: usize| sums[y * (w + 1) + x];
            let sum = at(x + width, y + height) - at(x, y + height) - at(x + width, y) + at(x, y);
            if sum > best.0 {
                best = (sum, (x as u32, y as u32));
            }
        }
    }
    centred(weights, size, best.1, (width as u32, height as u32))
}

/// The window moved so that the centre of weight of what it sees lies in its middle.
fn centred(weights: &[f64], size: (u32, u32), at: (u32, u32), window: (u32, u32)) -> (u32, u32) {
    let (mut sum, mut sum_x, mut sum_y) = (0.0, 0.0, 0.0);
    for y in at.1..at.1 + window.1 {
        for x in at.0..at.0 + window.0 {
            let weight = weights.get((y * size.0 + x) as usize).copied().unwrap_or(0.0);
            sum += weight;
            sum_x += weight * (f64::from(x) + 0.5);
            sum_y += weight * (f64::from(y) + 0.5);
        }
    }
    if sum <= 0.0 {
        return at;
    }
    let corner = |centre: f64, window: u32, size: u32| {
        (centre - f64::from(window) / 2.0).round().clamp(0.0, f64::from(size - window)) as u32
    };
    (corner(sum_x / sum, window.0, size.0), corner(sum_y / sum, window.1, size.1))
}

/// A part of a picture.
pub(super) fn detail(picture: &RgbImage, at: (u32, u32), width: u32, height: u32) -> RgbImage {
    imageops::crop_imm(picture, at.0, at.1, width, height).to_image()
}

/// A photograph as a data URI, reduced if it is large.
pub(super) fn photograph(picture: &RgbImage) -> String {
    let picture = reduced(picture);
    let bytes = jpeg(picture.as_raw(), picture.width(), picture.height(), 92);
    bytes.map_or_else(|| NOTHING.into(), |bytes| picture::data_uri("image/jpeg", &bytes))
}

/// A picture that must be exact (an error map, a detail) as a data URI, reduced if it is large.
pub(super) fn exact(picture: &RgbImage) -> String {
    let picture = reduced(picture);
    let mut bytes = Cursor::new(Vec::new());
    let encoder = PngEncoder::new(&mut bytes);
    let written = encoder.write_image(picture.as_raw(), picture.width(), picture.height(), ExtendedColorType::Rgb8);
    if written.is_ok() { picture::data_uri("image/png", &bytes.into_inner()) } else { NOTHING.into() }
}

fn reduced(picture: &RgbImage) -> std::borrow::Cow<'_, RgbImage> {
    if picture.width() <= MAX_WIDTH {
        return std::borrow::Cow::Borrowed(picture);
    }
    let height = (u64::from(picture.height()) * u64::from(MAX_WIDTH) / u64::from(picture.width())).max(1) as u32;
    std::borrow::Cow::Owned(imageops::resize(picture, MAX_WIDTH, height, FilterType::Triangle))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_goes_where_the_errors_are() {
        let mut weights = vec![0.0; 20 * 10];
        weights[7 * 20 + 15] = 3.0;
        weights[20 + 2] = 1.0;
        let (x, y) = densest_window(&weights, (20, 10), 5, 4);
        assert_eq!((x, y), (13, 6), "the largest error in the middle");
        assert_eq!(densest_window(&weights, (20, 10), 50, 50), (0, 0), "a window larger than the picture");
    }

    #[test]
    fn error_colours_run_from_black_to_the_brightest() {
        assert_eq!(colour(0.0), ERROR_COLOURS[0]);
        assert_eq!(colour(1.0), ERROR_COLOURS[7]);
        assert_eq!(colour(9.0), ERROR_COLOURS[7]);
        let a = RgbImage::from_pixel(2, 1, image::Rgb([10, 20, 30]));
        let b = RgbImage::from_pixel(2, 1, image::Rgb([12, 11, 30]));
        assert_eq!(errors(&a, &b), [9, 9]);
    }

    #[test]
    fn a_file_that_is_no_picture_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.png");
        std::fs::write(&path, b"\x89PNG\r\n\x1a\nnot really").unwrap();
        assert!(read(&path).unwrap_err().contains("broken.png"));
        assert!(read(&folder.path().join("absent.png")).unwrap_err().contains("absent.png"));
    }
}
