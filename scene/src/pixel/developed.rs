//! Grey and Bayer frames developed into colour.

use std::sync::OnceLock;

use super::{BayerOrder, PixelFormat, RawLook, Response, demosaic::demosaic, raw::code};
use crate::srgb;

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

    #[test]
    fn light_above_white_stays() {
        let look = RawLook { black_level: 95.0, white_balance: [2.0, 1.0, 1.5], response: Some(Response::Srgb) };
        let rggb12 = PixelFormat::Bayer(BayerOrder::Rggb, Samples::Bits12);
        let developed = Developed::new(rggb12, &look, 2, 2, &[4095, 2095, 2095, 95]);
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
}
