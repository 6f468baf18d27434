//! Picture files, decoded as they are stored.

use std::{fs::File, io::BufReader, path::Path};

use erfgs_base::FileError;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits, metadata::Orientation};

use super::ImageError;

/// The picture in a file.
pub(super) fn decode(path: &Path) -> Result<DynamicImage, ImageError> {
    let decoder = decoder(path)?;
    // No more memory than the crate allows by itself, whatever the header says.
    let decoded = Limits::default().reserve(decoder.total_bytes()).and_then(|()| DynamicImage::from_decoder(decoder));
    decoded.map_err(|source| ImageError::Decode { path: path.to_owned(), source: Box::new(source) })
}

/// Width and height of an image file, pixels; reads no more than its header.
///
/// # Errors
/// If the file is missing or no image, or is to be shown turned.
pub fn size(path: &Path) -> Result<[u32; 2], ImageError> {
    let (width, height) = decoder(path)?.dimensions();
    Ok([width, height])
}

/// What decodes a file. A picture that is to be shown turned is refused: whether the lenses and poses that belong to it are of the
/// stored picture (as COLMAP takes it) or of the shown one (as OpenCV does) nobody knows here, and half a turn shows in no size.
fn decoder(path: &Path) -> Result<impl ImageDecoder, ImageError> {
    let wrong = |source| ImageError::Decode { path: path.to_owned(), source: Box::new(source) };
    let io = FileError::when("read image", path);
    // The content decides what the format is: folders of frames with a wrong extension are common.
    let reader: ImageReader<BufReader<File>> =
        ImageReader::open(path).map_err(&io)?.with_guessed_format().map_err(&io)?;
    let mut decoder = reader.into_decoder().map_err(wrong)?;
    let how = match decoder.orientation().map_err(wrong)? {
        Orientation::NoTransforms => return Ok(decoder),
        Orientation::Rotate90 => "by 90 degrees clockwise",
        Orientation::Rotate180 => "by 180 degrees",
        Orientation::Rotate270 => "by 90 degrees counter-clockwise",
        Orientation::FlipHorizontal
        | Orientation::FlipVertical
        | Orientation::Rotate90FlipH
        | Orientation::Rotate270FlipH => "and mirrored",
    };
    Err(ImageError::Turned { path: path.to_owned(), how })
}

#[cfg(test)]
mod tests {
    use image::{
        ExtendedColorType, ImageEncoder,
        codecs::{jpeg::JpegEncoder, png::PngEncoder},
    };

    use super::*;
    use crate::{ImageGrey8, ImageRgb8, image::Reading};

    /// EXIF data that says nothing but an orientation: a TIFF header and one entry.
    fn exif(orientation: u8, little: bool) -> Vec<u8> {
        let short = |value: u16| if little { value.to_le_bytes() } else { value.to_be_bytes() };
        let long = |value: u32| if little { value.to_le_bytes() } else { value.to_be_bytes() };
        let mut bytes = if little { b"II".to_vec() } else { b"MM".to_vec() };
        bytes.extend(short(42));
        bytes.extend(long(8));
        bytes.extend(short(1));
        bytes.extend(short(0x0112));
        bytes.extend(short(3));
        bytes.extend(long(1));
        bytes.extend(short(u16::from(orientation)));
        bytes.extend([0; 6]);
        bytes
    }

    #[test]
    fn pictures_that_are_to_be_shown_turned_are_refused_by_name_however_they_are_read() {
        let folder = tempfile::tempdir().unwrap();
        for (name, is_png) in [("a.png", true), ("b.jpg", false)] {
            let path = folder.path().join(name);
            for (orientation, little) in (0..=9).flat_map(|orientation| [(orientation, false), (orientation, true)]) {
                let (mut bytes, pixels) = (Vec::new(), vec![90; 16 * 8 * 3]);
                if is_png {
                    let mut encoder = PngEncoder::new(&mut bytes);
                    encoder.set_exif_metadata(exif(orientation, little)).unwrap();
                    encoder.write_image(&pixels, 16, 8, ExtendedColorType::Rgb8).unwrap();
                } else {
                    let mut encoder = JpegEncoder::new(&mut bytes);
                    encoder.set_exif_metadata(exif(orientation, little)).unwrap();
                    encoder.write_image(&pixels, 16, 8, ExtendedColorType::Rgb8).unwrap();
                }
                std::fs::write(&path, bytes).unwrap();
                let is_turned = (2..=8).contains(&orientation);
                for error in [
                    ImageRgb8::read(&path).err(),
                    ImageRgb8::read_as(&path, Reading::default()).err(),
                    ImageGrey8::read(&path).err(),
                    size(&path).err(),
                ] {
                    assert_eq!(error.is_some(), is_turned, "{name}, {orientation}: {error:?}");
                    let message = error.map(|error| error.to_string()).unwrap_or_default();
                    assert!(!is_turned || message.contains(name) && message.contains("EXIF"), "{message}");
                }
            }
        }
    }
}
