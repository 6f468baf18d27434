//! Frames of cameras.

use erfgs_scene::{
    image,
    pixel::{self, PixelFormat},
};

use super::Seeds;

/// A frame of 8 x 4 pixels in each encoding; as JPEG with tables and, as cameras send it, without.
pub fn put(seeds: &mut Seeds) {
    let levels: Vec<u8> = (0..8 * 4 * 3).map(|n| (n * 37) as u8).collect();
    for (index, format) in PixelFormat::all().enumerate() {
        let head = [index as u8, 8, 4, 20 | (index as u8 & 1) << 6, 0, 0];
        let Some(bytes) = pixel::frame_bytes(format, 8, 4) else { continue };
        seeds.put("frames", &[&head[..], &levels[..bytes]].concat());
    }
    let mjpeg = PixelFormat::all().position(|format| format == PixelFormat::Mjpeg).unwrap_or_default();
    let jpeg = image::jpeg(&levels, 8, 4, 75).unwrap();
    let is_table = |at: &usize| jpeg[*at..].starts_with(&[0xff, 0xc4]);
    let tables = (0..jpeg.len()).find(is_table).unwrap_or_default();
    let scan = (tables..jpeg.len()).find(|&at| jpeg[at..].starts_with(&[0xff, 0xda])).unwrap_or_default();
    let bare = [&jpeg[..tables], &jpeg[scan..]].concat();
    for jpeg in [&jpeg, &bare] {
        seeds.put("frames", &[&[mjpeg as u8, 8, 4, 128, 0, 0], &jpeg[..]].concat());
    }
}
