//! From linear light to what a display, a frame and the trainer see.

use std::sync::LazyLock;

use glam::DVec3;

/// The sRGB transfer function: linear light in [0, 1] to the encoded value in [0, 1] (IEC 61966-2-1). Clamps.
#[must_use]
pub fn encode(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`encode`].
#[must_use]
pub fn decode(encoded: f64) -> f64 {
    let encoded = encoded.clamp(0.0, 1.0);
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// A linear colour as 8-bit sRGB.
#[must_use]
pub fn to_u8(linear: DVec3) -> [u8; 3] {
    linear.to_array().map(|channel| (encode(channel) * 255.0).round() as u8)
}

/// Luma of an RGB triple, BT.601 weights (as OpenCV's grey conversion and v2e use them).
#[must_use]
pub fn luma(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.299, 0.587, 0.114))
}

/// Luminance of linear light, 0 to 1 (sRGB's primaries).
#[must_use]
pub fn luminance(linear: DVec3) -> f64 {
    linear.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// v2e's "lin-log" response to a grey level in [0, 255]: the logarithm above `threshold`, the chord from 0 below it.
#[must_use]
pub fn lin_log(level: f64, threshold: f64) -> f64 {
    if level > threshold { level.ln() } else { level * threshold.ln() / threshold }
}

static DECODED: LazyLock<[f64; 256]> = LazyLock::new(|| std::array::from_fn(|level| decode(level as f64 / 255.0)));

/// The linear colour of a display colour `0xRRGGBB`.
pub(crate) fn hex(rgb: u32) -> DVec3 {
    let [_, red, green, blue] = rgb.to_be_bytes();
    DVec3::new(DECODED[usize::from(red)], DECODED[usize::from(green)], DECODED[usize::from(blue)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_and_decoding_are_inverse_and_keep_every_byte() {
        for level in 0..=255_u8 {
            let linear = decode(f64::from(level) / 255.0);
            assert_eq!(to_u8(DVec3::splat(linear)), [level; 3]);
        }
        assert!((encode(0.5) - 0.735_357).abs() < 1e-6);
    }

    #[test]
    fn lin_log_is_continuous_where_its_branches_meet() {
        assert!((lin_log(20.0, 20.0) - lin_log(20.0 + 1e-9, 20.0)).abs() < 1e-9);
        assert_eq!(lin_log(0.0, 20.0), 0.0);
        assert!((lin_log(255.0, 20.0) - 255.0_f64.ln()).abs() < 1e-12);
    }
}
