//! Frames of any encoding as pictures.

use super::{FrameFormat, PixelError, PixelFormat, RawLook, check_size, developed::Developed, frame_bytes, jpeg, yuv};
use crate::{
    image::{ImageRgb8, ImageRgb16},
    srgb,
};

/// Linear light: `data` holds `height` rows of `width` pixels of red, green, blue, 1 for white.
#[derive(Clone, Debug, PartialEq)]
pub struct LightRgb {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height * 3` values; below 0 under the black level, above 1 where the white balance lifts them.
    pub data: Vec<f32>,
}

/// Decodes one frame of which no more is known. A JPEG image may have another size than the stream: its own is taken.
///
/// # Errors
/// If the frame is cut or damaged.
pub fn decode(encoding: PixelFormat, width: u32, height: u32, payload: &[u8]) -> Result<ImageRgb8, PixelError> {
    decode_as(encoding, width, height, &RawLook::default(), payload)
}

impl FrameFormat {
    /// Decodes a frame, with the black level and white balance of its stream. A JPEG image may have another size than the
    /// stream: its own is taken.
    ///
    /// # Errors
    /// If the frame is cut or damaged.
    pub fn picture(&self, payload: &[u8]) -> Result<ImageRgb8, PixelError> {
        decode_as(self.pixels, self.width, self.height, &self.look, payload)
    }

    /// As [`FrameFormat::picture`], with 16 bits a colour: all that [`is_deep`](super::is_deep) frames have.
    ///
    /// # Errors
    /// As [`FrameFormat::picture`].
    pub fn deep_picture(&self, payload: &[u8]) -> Result<ImageRgb16, PixelError> {
        match self.developed(payload)? {
            Some(developed) => Ok(ImageRgb16 { width: self.width, height: self.height, data: developed.deep_levels() }),
            None => {
                let ImageRgb8 { width, height, data } = self.picture(payload)?;
                Ok(ImageRgb16 { width, height, data: data.into_iter().map(|level| 257 * u16::from(level)).collect() })
            }
        }
    }

    /// As [`FrameFormat::picture`], in linear light, nothing cut or rounded.
    ///
    /// # Errors
    /// As [`FrameFormat::picture`].
    pub fn light(&self, payload: &[u8]) -> Result<LightRgb, PixelError> {
        match self.developed(payload)? {
            Some(developed) => Ok(LightRgb { width: self.width, height: self.height, data: developed.light() }),
            None => {
                let table: Vec<f32> = (0..=255_u8).map(|level| srgb::decode(f32::from(level) / 255.0)).collect();
                let ImageRgb8 { width, height, data } = self.picture(payload)?;
                Ok(LightRgb { width, height, data: data.into_iter().map(|level| table[usize::from(level)]).collect() })
            }
        }
    }

    /// A frame of one value a pixel; `None` for other formats.
    fn developed(&self, payload: &[u8]) -> Result<Option<Developed>, PixelError> {
        let Self { pixels, width, height, ref look } = *self;
        let Some(samples) = pixels.samples() else { return Ok(None) };
        check_frame(pixels, width, height, payload)?;
        let values = samples.unpack(payload);
        Ok(Some(Developed::new(pixels, look, width as usize, height as usize, &values)))
    }
}

/// Size and length.
fn check_frame(encoding: PixelFormat, width: u32, height: u32, payload: &[u8]) -> Result<(), PixelError> {
    check_size(encoding, width, height)?;
    let expected = frame_bytes(encoding, width, height).unwrap_or(payload.len());
    if payload.len() != expected {
        return Err(PixelError::Length { encoding, width, height, expected, found: payload.len() });
    }
    Ok(())
}

fn decode_as(
    encoding: PixelFormat,
    width: u32,
    height: u32,
    look: &RawLook,
    payload: &[u8],
) -> Result<ImageRgb8, PixelError> {
    if encoding == PixelFormat::Mjpeg {
        return jpeg::decode(payload);
    }
    check_frame(encoding, width, height, payload)?;
    let (columns, rows) = (width as usize, height as usize);
    let data = match (encoding, encoding.samples()) {
        (PixelFormat::Bayer(..), Some(samples)) => {
            Developed::new(encoding, look, columns, rows, &samples.unpack(payload)).levels()
        }
        (_, Some(samples)) => {
            let levels = look.levels(encoding, 1);
            samples.unpack(payload).into_iter().flat_map(|value| [levels[usize::from(value)]; 3]).collect()
        }
        (PixelFormat::Yuyv, _) => yuv::yuyv(payload),
        (PixelFormat::Uyvy, _) => yuv::uyvy(payload),
        (PixelFormat::Nv12, _) => yuv::nv12(columns, rows, payload),
        (PixelFormat::Bgr8, _) => payload.chunks_exact(3).flat_map(|p| [p[2], p[1], p[0]]).collect(),
        _ => payload.to_vec(),
    };
    Ok(ImageRgb8 { width, height, data })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::pixel::{BayerOrder, Samples};

    /// Encodings whose frames have a fixed size.
    fn fixed() -> Vec<PixelFormat> {
        PixelFormat::all().filter(|&encoding| encoding != PixelFormat::Mjpeg).collect()
    }

    fn stream(encoding: PixelFormat, [width, height]: [u32; 2], settings: serde_json::Value) -> FrameFormat {
        let serde_json::Value::Object(settings) = settings else { panic!("an object is wanted") };
        FrameFormat { pixels: encoding, width, height, look: RawLook::of_settings(&settings, encoding) }
    }

    fn pixels(encoding: PixelFormat, width: u32, height: u32, payload: &[u8]) -> Vec<u8> {
        decode(encoding, width, height, payload).unwrap().data
    }

    #[test]
    fn the_colour_bars_of_bt_601_come_out_as_rgb() {
        // 100 % bars: Y, Cb, Cr as in ITU-R BT.601, table of the 8-bit values.
        let bars = [
            ([235, 128, 128], [255, 255, 255]),
            ([210, 16, 146], [255, 255, 0]),
            ([170, 166, 16], [0, 255, 255]),
            ([145, 54, 34], [0, 255, 0]),
            ([106, 202, 222], [255, 0, 255]),
            ([81, 90, 240], [255, 0, 0]),
            ([41, 240, 110], [0, 0, 255]),
            ([16, 128, 128], [0, 0, 0]),
        ];
        for ([y, u, v], expected) in bars {
            let close = |found: &[u8]| found.iter().zip(expected).all(|(a, b): (&u8, u8)| a.abs_diff(b) <= 2);
            let yuyv = pixels(PixelFormat::Yuyv, 2, 1, &[y, u, y, v]);
            assert!(yuyv.chunks(3).all(close), "{yuyv:?} is not {expected:?}");
            assert_eq!(pixels(PixelFormat::Uyvy, 2, 1, &[u, y, v, y]), yuyv);
            let nv12 = pixels(PixelFormat::Nv12, 2, 2, &[y, y, y, y, u, v]);
            assert!(nv12.chunks(3).all(close), "{nv12:?} is not {expected:?}");
        }
    }

    #[test]
    fn chroma_of_nv12_belongs_to_its_two_by_two_pixels() {
        let luma = [81; 16];
        // Red at the left, blue-ish elsewhere, in the lower half only.
        let chroma = [128, 128, 128, 128, 90, 240, 240, 110];
        let data = pixels(PixelFormat::Nv12, 4, 4, &[&luma[..], &chroma].concat());
        let pixel = |x: usize, y: usize| &data[3 * (4 * y + x)..][..3];
        assert_eq!(pixel(0, 0), pixel(3, 1));
        assert!(pixel(0, 2)[0] > 250 && pixel(1, 3)[0] > 250);
        assert!(pixel(2, 2)[2] > 250 && pixel(3, 3)[2] > 250);
    }

    #[test]
    fn deep_grey_keeps_its_upper_bits() {
        assert_eq!(pixels(PixelFormat::Grey10, 2, 1, &[0xff, 0x03, 0x04, 0x00]), [255, 255, 255, 1, 1, 1]);
        assert_eq!(pixels(PixelFormat::Grey12, 2, 1, &[0xff, 0x0f, 0x10, 0x00]), [255, 255, 255, 1, 1, 1]);
        assert_eq!(pixels(PixelFormat::Grey10, 1, 1, &[0xff, 0xff]), [255; 3], "stray upper bits are no wrap");
    }

    #[test]
    fn packed_grey_is_what_it_was_in_words() {
        let values: Vec<u16> = (0..32).map(|at| at * 31).collect();
        for (words, packed) in
            [(PixelFormat::Grey10, PixelFormat::Grey10Packed), (PixelFormat::Grey12, PixelFormat::Grey12Packed)]
        {
            let [a, b] = [words, packed].map(|encoding| encoding.samples().unwrap().pack(&values));
            assert!(b.len() < a.len());
            assert_eq!(pixels(words, 8, 4, &a), pixels(packed, 8, 4, &b));
        }
        assert_eq!(pixels(PixelFormat::Bgr8, 1, 1, &[1, 2, 3]), [3, 2, 1]);
    }

    #[test]
    fn a_sheet_of_one_colour_has_that_colour_in_every_order_and_layout() {
        // Half, a quarter and an eighth of white, as light.
        let light = [0.5_f32, 0.25, 0.125];
        let expected = light.map(|light| (255.0 * srgb::encode(light)).round() as u8);
        for encoding in fixed() {
            let PixelFormat::Bayer(order, samples) = encoding else { continue };
            let value = |at: usize| (light[order.colour(at % 8, at / 8)] * f32::from(samples.white())).round() as u16;
            let payload = samples.pack(&(0..48).map(value).collect::<Vec<_>>());
            for pixel in pixels(encoding, 8, 6, &payload).chunks(3) {
                let off = std::iter::zip(pixel, expected).map(|(level, expected)| level.abs_diff(expected)).max();
                assert!(off <= Some(1), "{encoding}: {pixel:?} is not {expected:?}");
            }
        }
    }

    #[test]
    fn the_recorded_black_level_and_white_balance_are_applied() {
        let encoding = PixelFormat::Bayer(BayerOrder::Bggr, Samples::Bits10);
        let raw = serde_json::json!({"raw": {"black_level": 23, "white_balance": [2.0, 1.0, 4.0], "response": "srgb"}});
        let balanced = stream(encoding, [4, 2], raw);
        // Grey as the sensor sees it: less red, and blue still less.
        let row = |first: u16, second: u16| [first, second, first, second];
        let payload = Samples::Bits10.pack(&[row(23 + 100, 23 + 400), row(23 + 400, 23 + 200)].concat());
        assert_eq!(balanced.picture(&payload).unwrap().data, [102; 24]);
        assert_eq!(balanced.deep_picture(&payload).unwrap().data, [26_214; 24]);
        let linear = balanced.light(&payload).unwrap().data;
        assert!(linear.iter().all(|&light| (light - srgb::decode(0.4)).abs() < 1e-6), "{linear:?}");
        // What is not understood counts as not said.
        let odd = stream(encoding, [4, 2], serde_json::json!({"raw": {"gamma": 3}}));
        assert_eq!(odd.picture(&payload).unwrap(), decode(encoding, 4, 2, &payload).unwrap());
    }

    #[test]
    fn cut_frames_are_refused_with_both_lengths() {
        for encoding in fixed() {
            let whole = vec![0; frame_bytes(encoding, 4, 2).unwrap()];
            assert!(decode(encoding, 4, 2, &whole).is_ok());
            let error = decode(encoding, 4, 2, &whole[1..]).unwrap_err().to_string();
            assert!(error.contains(&format!("has {} bytes, this one {}", whole.len(), whole.len() - 1)), "{error}");
        }
        assert!(matches!(decode(PixelFormat::Yuyv, 3, 1, &[0; 6]), Err(PixelError::Size { .. })));
        assert!(matches!(decode(PixelFormat::Nv12, 2, 1, &[0; 3]), Err(PixelError::Size { .. })));
        assert!(decode(PixelFormat::Mjpeg, 2, 1, b"").is_err());
        let refused = |encoding, width, height| check_size(encoding, width, height).unwrap_err().to_string();
        assert!(refused(PixelFormat::Grey10Packed, 6, 2).contains("6 x 2 pixels cannot be grey10p: four columns"));
        assert!(
            refused(PixelFormat::Bayer(BayerOrder::Rggb, Samples::Packed12), 5, 4).contains("two columns are packed")
        );
        assert!(refused(PixelFormat::Bayer(BayerOrder::Rggb, Samples::Bits8), 5, 1).contains("repeat every two"));
        assert!(refused(PixelFormat::Rgb8, 0, 1).contains("1 to 65535"));
    }

    proptest! {
        #[test]
        fn every_frame_of_the_right_length_is_decoded(
            encoding in prop::sample::select(fixed()),
            (width, height) in (1..4u32, 1..6u32),
            byte in any::<u8>(),
        ) {
            let payload = vec![byte; frame_bytes(encoding, 4 * width, 2 * height).unwrap()];
            let image = decode(encoding, 4 * width, 2 * height, &payload).unwrap();
            prop_assert_eq!(image.data.len(), 3 * 8 * (width * height) as usize);
            let frames = stream(encoding, [4 * width, 2 * height], serde_json::json!({}));
            prop_assert_eq!(&frames.picture(&payload).unwrap(), &image);
            let deep = frames.deep_picture(&payload).unwrap();
            let near = |(&deep, &level): (&u16, &u8)| u16::abs_diff(deep / 257, level.into()) <= 1;
            prop_assert!(deep.data.iter().zip(&image.data).all(near));
            prop_assert_eq!(frames.light(&payload).unwrap().data.len(), image.data.len());
        }
    }
}
