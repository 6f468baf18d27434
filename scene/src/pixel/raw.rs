//! What grey and Bayer frames look like: from the values of a sensor to fractions of white, and to pictures.

use serde::{Deserialize, Serialize};

use super::PixelFormat;
use crate::srgb;

/// How the values of grey and Bayer frames become a picture: the table `raw` of a camera in `RIG.toml`, and of its
/// settings in a recording. Recorded values stay as they are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RawLook {
    /// The value of black, in the steps of the format; it is subtracted.
    pub black_level: f64,
    /// Factors of red, green and blue (Bayer formats).
    pub white_balance: [f64; 3],
    /// What the values mean; without it linear light for Bayer formats, and codes for grey.
    pub response: Option<Response>,
}

/// What the values of a sensor mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Response {
    /// Light: pictures are coded with the curve of sRGB.
    Linear,
    /// Codes as in pictures: the camera has applied a curve, taken as that of sRGB.
    Srgb,
}

impl Default for RawLook {
    fn default() -> Self {
        Self { black_level: 0.0, white_balance: [1.0; 3], response: None }
    }
}

impl RawLook {
    /// What the settings of a recorded stream say, and the default where it says nothing that is understood.
    #[must_use]
    pub fn of_settings(settings: &serde_json::Map<String, serde_json::Value>, encoding: PixelFormat) -> Self {
        let raw = settings.get("raw");
        raw.and_then(|raw| Self::deserialize(raw).ok())
            .filter(|raw| raw.problem(encoding).is_none())
            .unwrap_or_default()
    }

    /// What is wrong with it for frames of an encoding, and what would do.
    #[must_use]
    pub fn problem(&self, encoding: PixelFormat) -> Option<String> {
        let Some(samples) = encoding.samples() else {
            return Some(format!("raw is for grey and Bayer formats, not for {encoding}; leave it out"));
        };
        let half = f64::from(samples.white()) / 2.0;
        if !(0.0..=half).contains(&self.black_level) {
            return Some(format!("raw.black_level is {}; for {encoding} it can be 0 to {half}", self.black_level));
        }
        if !self.white_balance.iter().all(|factor| (0.01..=100.0).contains(factor)) {
            return Some(format!("raw.white_balance is {:?}; its factors can be 0.01 to 100", self.white_balance));
        }
        if !matches!(encoding, PixelFormat::Bayer(..)) && self.white_balance != [1.0; 3] {
            return Some(format!("raw.white_balance is for Bayer formats, not for {encoding}; leave it out"));
        }
        None
    }

    /// What values of an encoding mean.
    #[must_use]
    pub fn response(&self, encoding: PixelFormat) -> Response {
        self.response.unwrap_or(match encoding {
            PixelFormat::Bayer(..) => Response::Linear,
            _ => Response::Srgb,
        })
    }

    /// For each value of an encoding what fraction of white it is, in one colour (0 red, 1 green, 2 blue). Black may lie
    /// above 0, so that fractions may be negative; factors may lift them above 1.
    pub(super) fn fractions(&self, encoding: PixelFormat, colour: usize) -> Vec<f32> {
        let white = encoding.samples().map_or(255, super::Samples::white);
        let factor = self.white_balance[colour] / (f64::from(white) - self.black_level);
        (0..=white).map(|value| ((f64::from(value) - self.black_level) * factor) as f32).collect()
    }

    /// For each value of an encoding its level in an 8-bit picture, in one colour (0 red, 1 green, 2 blue).
    #[must_use]
    pub fn levels(&self, encoding: PixelFormat, colour: usize) -> Vec<u8> {
        let response = self.response(encoding);
        self.fractions(encoding, colour).into_iter().map(|fraction| code(response, fraction, 255.0) as u8).collect()
    }
}

/// A fraction of white as a picture codes it, of `white` steps.
pub(super) fn code(response: Response, fraction: f32, white: f32) -> f32 {
    let coded = match response {
        Response::Linear => srgb::encode(fraction),
        Response::Srgb => fraction.clamp(0.0, 1.0),
    };
    (coded * white).round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::{BayerOrder, Samples};

    const RGGB12: PixelFormat = PixelFormat::Bayer(BayerOrder::Rggb, Samples::Bits12);

    #[test]
    fn grey_is_shown_as_it_comes_and_bayer_as_light() {
        let plain = RawLook::default();
        assert_eq!(plain.levels(PixelFormat::Grey8, 1), (0..=255).collect::<Vec<u8>>());
        let deep = plain.levels(PixelFormat::Grey10, 1);
        assert_eq!((deep.len(), deep[0], deep[4], deep[512], deep[1023]), (1024, 0, 1, 128, 255));
        // 18 % of white is level 118 of sRGB.
        assert_eq!(plain.levels(RGGB12, 0)[737], 118);
        let linear = RawLook { response: Some(Response::Linear), ..plain };
        assert_eq!(linear.levels(PixelFormat::Grey12, 1)[737], 118);
    }

    #[test]
    fn black_is_taken_off_before_the_white_balance() {
        let look = RawLook { black_level: 95.0, white_balance: [2.0, 1.0, 1.5], response: Some(Response::Srgb) };
        let level = |colour: usize, value: usize| look.levels(RGGB12, colour)[value];
        assert_eq!([level(0, 0), level(0, 95), level(1, 95), level(1, 4095)], [0, 0, 0, 255]);
        assert_eq!([level(0, 1095), level(1, 1095), level(2, 1095)], [128, 64, 96]);
        assert_eq!(level(0, 4095), 255, "white is the most there is");
    }

    #[test]
    fn what_makes_no_sense_is_told_with_what_would() {
        let problem = |encoding, look: RawLook| look.problem(encoding).unwrap_or_default();
        let plain = RawLook::default();
        assert_eq!((problem(RGGB12, plain), problem(PixelFormat::Grey10, plain)), (String::new(), String::new()));
        assert!(problem(PixelFormat::Mjpeg, plain).contains("not for mjpeg"));
        assert!(problem(PixelFormat::Grey8, RawLook { black_level: 200.0, ..plain }).contains("0 to 127.5"));
        assert!(problem(RGGB12, RawLook { white_balance: [0.0, 1.0, 1.0], ..plain }).contains("0.01 to 100"));
        assert!(
            problem(PixelFormat::Grey8, RawLook { white_balance: [2.0, 1.0, 1.0], ..plain })
                .contains("for Bayer formats")
        );
        assert!(problem(RGGB12, RawLook { black_level: f64::NAN, ..plain }).contains("NaN"));
    }
}
