//! Frames as `sensor_msgs/msg/Image` has them: as the camera gave them, where ROS has a name for it.

use std::borrow::Cow;

use erfgs_scene::pixel::{BayerOrder, FrameFormat, PixelError, PixelFormat, check_size, frame_bytes};

/// Rows of pixels under ROS's name.
pub struct RosPixels<'a> {
    /// `mono8`, `bayer_rggb16`, `yuv422_yuy2`.
    pub encoding: &'static str,
    pub width: u32,
    pub height: u32,
    /// Bytes of a row.
    pub step: u32,
    pub data: Cow<'a, [u8]>,
}

impl<'a> RosPixels<'a> {
    /// A frame of a camera that sends arrays.
    ///
    /// # Errors
    /// If the frame is cut, or no picture can be so.
    pub fn of(format: &FrameFormat, payload: &'a [u8]) -> Result<Self, PixelError> {
        let FrameFormat { pixels, width, height, .. } = *format;
        check_size(pixels, width, height)?;
        let expected = frame_bytes(pixels, width, height).unwrap_or(payload.len());
        if payload.len() != expected {
            return Err(PixelError::Length { encoding: pixels, width, height, expected, found: payload.len() });
        }
        let (encoding, data) = match (name(pixels), pixels.samples()) {
            (Some(encoding), None) => (encoding, Cow::Borrowed(payload)),
            (Some(encoding), Some(samples)) if samples.bits() == 8 => (encoding, Cow::Borrowed(payload)),
            // In the upper bits, so that white is white whatever the camera's depth.
            (Some(encoding), Some(samples)) => {
                let shift = 16 - samples.bits();
                let words = samples.unpack(payload).into_iter().flat_map(|value| (value << shift).to_le_bytes());
                (encoding, words.collect())
            }
            (None, _) => ("rgb8", Cow::Owned(format.picture(payload)?.data)),
        };
        // Rows follow each other without padding.
        let step = (data.len() / (height as usize).max(1)) as u32;
        Ok(Self { encoding, width, height, step, data })
    }
}

/// ROS's name for pixels, in words of 16 bits where they have more than 8; `None` for those that it has no name for.
fn name(pixels: PixelFormat) -> Option<&'static str> {
    let deep = pixels.samples().is_some_and(|samples| samples.bits() > 8);
    Some(match pixels {
        PixelFormat::Rgb8 => "rgb8",
        PixelFormat::Bgr8 => "bgr8",
        PixelFormat::Yuyv => "yuv422_yuy2",
        PixelFormat::Uyvy => "yuv422",
        PixelFormat::Mjpeg | PixelFormat::Nv12 => return None,
        PixelFormat::Bayer(order, _) => {
            let names = match order {
                BayerOrder::Rggb => ["bayer_rggb8", "bayer_rggb16"],
                BayerOrder::Bggr => ["bayer_bggr8", "bayer_bggr16"],
                BayerOrder::Grbg => ["bayer_grbg8", "bayer_grbg16"],
                BayerOrder::Gbrg => ["bayer_gbrg8", "bayer_gbrg16"],
            };
            names[usize::from(deep)]
        }
        _ if deep => "mono16",
        _ => "mono8",
    })
}

#[cfg(test)]
mod tests {
    use erfgs_scene::pixel::Samples;

    use super::*;

    #[test]
    fn frames_keep_their_values_under_the_names_of_ros() {
        let picture = |pixels, payload: &[u8]| {
            let format = FrameFormat { pixels, width: 4, height: 2, look: Default::default() };
            let found =
                RosPixels::of(&format, payload).map(|found| (found.encoding, found.step, found.data.into_owned()));
            found.map_err(|error| error.to_string())
        };
        let grey: Vec<u8> = (0..8).collect();
        assert_eq!(picture(PixelFormat::Grey8, &grey), Ok(("mono8", 4, grey.clone())));
        let yuyv: Vec<u8> = (0..16).collect();
        assert_eq!(picture(PixelFormat::Yuyv, &yuyv), Ok(("yuv422_yuy2", 8, yuyv)));
        let values: Vec<u16> = (0..8).map(|n| 4095 - 3 * n).collect();
        let deep: Vec<u8> = values.iter().flat_map(|value| (value << 4).to_le_bytes()).collect();
        for samples in [Samples::Bits12, Samples::Packed12, Samples::Lsb12, Samples::Gev12] {
            let payload = samples.pack(&values);
            let found = picture(PixelFormat::Bayer(BayerOrder::Gbrg, samples), &payload);
            assert_eq!(found, Ok(("bayer_gbrg16", 8, deep.clone())), "{samples:?}");
        }
        let (encoding, step, data) = picture(PixelFormat::Nv12, &[128; 12]).unwrap();
        assert_eq!((encoding, step, data.len()), ("rgb8", 12, 24), "ROS has no name for it");
        let rgb: Vec<u8> = (0..24).collect();
        assert_eq!(picture(PixelFormat::Rgb8, &rgb), Ok(("rgb8", 12, rgb)));
        for pixels in PixelFormat::all().filter(|pixels| *pixels != PixelFormat::Mjpeg) {
            let payload = vec![7; frame_bytes(pixels, 4, 2).unwrap()];
            let (_, step, data) = picture(pixels, &payload).unwrap();
            assert_eq!(step as usize * 2, data.len(), "{pixels}");
            assert!(picture(pixels, &payload[1..]).unwrap_err().contains("cut, or damaged"), "{pixels}");
        }
    }
}
