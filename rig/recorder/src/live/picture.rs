//! Pictures for the page: small, and cheap to make.

use erfgs_scene::image::jpeg;

/// Widest preview, pixels; of a camera that is enlarged.
pub(super) const WIDEST: u32 = 640;
pub(super) const WIDEST_LARGE: u32 = 1920;
/// Quality of previews.
const QUALITY: u8 = 80;

/// An 8-bit RGB picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
}

impl Picture {
    /// A picture whose pixel (column, row) is what `pixel` gives for the matching place of an image of `width` x
    /// `height`, made smaller by a whole factor where that is wider than `widest`.
    pub fn shrunk(width: u32, height: u32, widest: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Self {
        let step = width.div_ceil(widest).max(1);
        let (small_width, small_height) = (width / step, height / step);
        let mut rgb = Vec::with_capacity(3 * (small_width * small_height) as usize);
        for y in 0..small_height {
            for x in 0..small_width {
                rgb.extend_from_slice(&pixel(x * step, y * step));
            }
        }
        Self { width: small_width, height: small_height, rgb }
    }

    /// JPEG; `None` if the picture is empty.
    pub fn jpeg(&self) -> Option<Vec<u8>> {
        jpeg(&self.rgb, self.width, self.height, QUALITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_images_shrink_by_a_whole_factor() {
        let picture = Picture::shrunk(1920, 1080, WIDEST, |x, y| [(x / 8) as u8, (y / 8) as u8, 7]);
        assert_eq!((picture.width, picture.height), (640, 360));
        assert_eq!(picture.rgb[3 * (640 + 1)..][..3], [0, 0, 7]);
        assert_eq!(picture.rgb[3 * (100 * 640 + 600)..][..3], [225, 37, 7]);
        let large = Picture::shrunk(1920, 1080, WIDEST_LARGE, |x, y| [x as u8, y as u8, 7]);
        assert_eq!((large.width, large.height), (1920, 1080));
        assert!(picture.jpeg().is_some_and(|jpeg| jpeg.starts_with(&[0xff, 0xd8])));
    }
}
