//! Pictures as files.

use erfgs_scene::image::{self, PngSamples};
use erfgs_sync::reading::{Picture, Samples};

/// What a picture shows.
pub enum Shown {
    /// What a camera sent as a JPEG image.
    Jpeg(Vec<u8>),
    /// A frame of any other camera.
    Frame(Picture),
    /// Events, as rows of red, green and blue; columns and rows.
    Events(Vec<u8>, [u32; 2]),
}

impl Shown {
    /// The format and the file; `None` where a picture has no pixels, or more than a format holds.
    pub fn coded(&self, jpeg: Option<u8>) -> Option<(&'static str, Vec<u8>)> {
        match self {
            Self::Jpeg(file) => Some(("jpeg", file.clone())),
            Self::Events(rgb, [width, height]) => Some(("png", image::png(PngSamples::Rgb8(rgb), *width, *height)?)),
            Self::Frame(picture) => {
                let as_jpeg = jpeg.zip(colours(picture));
                match as_jpeg {
                    Some((quality, rgb)) => Some(("jpeg", image::jpeg(&rgb, picture.width, picture.height, quality)?)),
                    None => Some(("png", png(picture)?)),
                }
            }
        }
    }
}

fn png(picture: &Picture) -> Option<Vec<u8>> {
    let samples = match (&picture.samples, picture.channels) {
        (Samples::Bits8(data), 1) => PngSamples::Grey8(data),
        (Samples::Bits8(data), _) => PngSamples::Rgb8(data),
        (Samples::Bits16(data), 1) => PngSamples::Grey16(data),
        (Samples::Bits16(data), _) => PngSamples::Rgb16(data),
    };
    image::png(samples, picture.width, picture.height)
}

/// The picture in colours of 8 bits; `None` where it has more.
fn colours(picture: &Picture) -> Option<Vec<u8>> {
    match &picture.samples {
        Samples::Bits8(data) if picture.channels == 1 => Some(data.iter().flat_map(|&level| [level; 3]).collect()),
        Samples::Bits8(data) => Some(data.clone()),
        Samples::Bits16(_) => None,
    }
}
