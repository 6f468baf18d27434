//! What grey and Bayer frames look like: from the values of a sensor to fractions of white, and to pictures.

use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use super::demosaic::demosaic;
use super::{BayerOrder, PixelFormat};
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
        let said = settings.get("raw");
        said.and_then(|raw| Self::deserialize(raw).ok())
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
    fn fractions(&self, encoding: PixelFormat, colour: usize) -> Vec<f32> {
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
fn code(response: Response, fraction: f32, white: f32) -> f32 {
    let coded = match response {
        Response::Linear => srgb::encode(fraction),
        Response::Srgb => fraction.clamp(0.0, 1.0),
    };
    (coded * white).round()
}

/// Levels of an 8-bit picture for linear light in steps of a 16384th: at the dark end, where the curve is steepest, a step
/// is a fifth of a level.
fn level_of_light() -> &'static [u8] {
    const STEPS: u16 = 1 << 14;
    static LEVELS: OnceLock<Vec<u8>> = OnceLock::new();
    LEVELS.get_or_init(|| {
        (0..=STEPS).map(|step| code(Response::Linear, f32::from(step) / f32::from(STEPS), 255.0) as u8).collect()
    })
}

/// A grey or Bayer frame in colour, as fractions of white (that of the sensor, before white balance).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Developed {
    pub response: Response,
    /// Rows of red, green, blue.
    pub rgb: Vec<f32>,
}

impl Developed {
    /// `values` holds `height` rows of `width` values, none above white.
    pub fn new(encoding: PixelFormat, look: &RawLook, width: usize, height: usize, values: &[u16]) -> Self {
        let rgb = match encoding {
            PixelFormat::Bayer(order, _) => {
                let fractions = std::array::from_fn(|colour| look.fractions(encoding, colour));
                demosaic(order, width, height, &balanced(order, width, values, &fractions))
            }
            _ => {
                let fractions = look.fractions(encoding, 1);
                values.iter().flat_map(|&value| [fractions[usize::from(value)]; 3]).collect()
            }
        };
        Self { response: look.response(encoding), rgb }
    }

    /// 8-bit levels.
    pub fn levels(&self) -> Vec<u8> {
        match self.response {
            Response::Linear => {
                let levels = level_of_light();
                let last = (levels.len() - 1) as f32;
                self.rgb.iter().map(|&light| levels[(light.clamp(0.0, 1.0) * last).round() as usize]).collect()
            }
            Response::Srgb => self.rgb.iter().map(|&value| code(Response::Srgb, value, 255.0) as u8).collect(),
        }
    }

    /// 16-bit levels.
    pub fn deep_levels(&self) -> Vec<u16> {
        self.rgb.iter().map(|&value| code(self.response, value, 65_535.0) as u16).collect()
    }

    /// Linear light; what is above white stays.
    pub fn light(self) -> Vec<f32> {
        match self.response {
            Response::Linear => self.rgb,
            Response::Srgb => self.rgb.into_iter().map(srgb::decode).collect(),
        }
    }
}

/// The mosaic as fractions of white, of each colour by its own table.
fn balanced(order: BayerOrder, width: usize, values: &[u16], fractions: &[Vec<f32>; 3]) -> Vec<f32> {
    let rows = values.chunks(width).enumerate();
    rows.flat_map(|(y, row)| {
        let tables = [order.colour(0, y), order.colour(1, y)].map(|colour| &fractions[colour]);
        row.iter().enumerate().map(move |(x, &value)| tables[x % 2][usize::from(value)])
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::Samples;

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
        // In linear light it may be more.
        let developed = Developed::new(RGGB12, &look, 2, 2, &[4095, 2095, 2095, 95]);
        assert_eq!(developed.rgb[0], 2.0);
    }

    #[test]
    fn the_table_of_levels_rounds_to_a_tenth_beyond_half_a_level() {
        let light: Vec<f32> = (0..=4095_u16).map(|value| f32::from(value) / 4095.0).collect();
        let developed = Developed { response: Response::Linear, rgb: light.clone() };
        let exact = light.iter().map(|&light| 255.0 * srgb::encode(light));
        let worst = std::iter::zip(developed.levels(), exact).map(|(level, exact)| (f32::from(level) - exact).abs());
        assert!(worst.fold(0.0, f32::max) < 0.61);
        assert_eq!(developed.deep_levels()[4095], 65_535);
    }

    #[test]
    fn what_makes_no_sense_is_told_with_what_would() {
        let told = |encoding, look: RawLook| look.problem(encoding).unwrap_or_default();
        let plain = RawLook::default();
        assert_eq!((told(RGGB12, plain), told(PixelFormat::Grey10, plain)), (String::new(), String::new()));
        assert!(told(PixelFormat::Mjpeg, plain).contains("not for mjpeg"));
        assert!(told(PixelFormat::Grey8, RawLook { black_level: 200.0, ..plain }).contains("0 to 127.5"));
        assert!(told(RGGB12, RawLook { white_balance: [0.0, 1.0, 1.0], ..plain }).contains("0.01 to 100"));
        assert!(
            told(PixelFormat::Grey8, RawLook { white_balance: [2.0, 1.0, 1.0], ..plain }).contains("for Bayer formats")
        );
        assert!(told(RGGB12, RawLook { black_level: f64::NAN, ..plain }).contains("NaN"));
    }
}
