//! The transfer function of sRGB (IEC 61966-2-1): how linear light is coded in pictures.

/// The code of linear light; both 0 to 1, what lies outside is cut.
#[must_use]
pub fn encode(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The linear light of a code; negative codes are cut.
#[must_use]
pub fn decode(code: f32) -> f32 {
    let code = code.max(0.0);
    if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_known_light_come_out_and_back() {
        // 18 % grey is 117.6 of 255, half of white 187.5.
        for (linear, code) in [(0.0, 0.0), (0.001, 0.012_92), (0.18, 0.461_36), (0.5, 0.735_36), (1.0, 1.0)] {
            assert!((encode(linear) - code).abs() < 1e-5 && (decode(code) - linear).abs() < 1e-5, "{linear}");
        }
        assert_eq!((encode(-1.0), encode(7.0), decode(-1.0)), (0.0, encode(1.0), 0.0));
    }
}
