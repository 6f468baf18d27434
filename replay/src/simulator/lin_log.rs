//! From grey levels to what a pixel responds to.

use super::{Luma, SimulatorConfig};

/// v2e's `lin_log`: the natural logarithm above grey level 20, below it the line through the origin and (20, ln 20).
/// `x` is a grey level, 0 to 255. Computed in `f64`, rounded to 1e-8 and then to `f32`, as v2e does, so that adding and
/// subtracting the same contrast gives back the same value.
#[must_use]
pub fn lin_log(x: f64) -> f32 {
    const THRESHOLD: f64 = SimulatorConfig::LIN_LOG_THRESHOLD;
    const ROUNDING: f64 = 1e8;
    let y = if x <= THRESHOLD { x * (1.0 / THRESHOLD * THRESHOLD.ln()) } else { x.ln() };
    ((y * ROUNDING).round_ties_even() / ROUNDING) as f32
}

/// Linear light, 0 to 1, of an sRGB-encoded value, 0 to 1 (IEC 61966-2-1).
#[must_use]
pub fn linear_of_srgb(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB-encoded value, 0 to 1, of linear light, 0 to 1 (IEC 61966-2-1).
#[must_use]
pub fn srgb_of_linear(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The response to light of all pixels: grey levels to intensity and to log intensity.
pub(super) struct Response {
    linear_light: bool,
    log: [f32; 256],
    intensity: [f64; 256],
}

impl Response {
    pub(super) fn new(linear_light: bool) -> Self {
        let level = |x: usize| grey(linear_light, x as f64);
        let log = std::array::from_fn(|x| lin_log(level(x)));
        Self { linear_light, log, intensity: std::array::from_fn(|x| intensity(level(x))) }
    }

    /// Log intensity of the pixels from `start` on.
    pub(super) fn log(&self, luma: Luma<'_>, start: usize, out: &mut [f32]) {
        match luma {
            Luma::U8(levels) => {
                for (out, &x) in out.iter_mut().zip(&levels[start..]) {
                    *out = self.log[usize::from(x)];
                }
            }
            Luma::F32(levels) => {
                for (out, &x) in out.iter_mut().zip(&levels[start..]) {
                    *out = lin_log(grey(self.linear_light, f64::from(x)));
                }
            }
        }
    }

    /// `of` the intensity of each grey level.
    pub(super) fn tabulate(&self, of: impl Fn(f64) -> f32) -> [f32; 256] {
        self.intensity.map(of)
    }

    /// v2e's `inten01` of the pixels from `start` on: intensity with an offset that keeps a black pixel's bandwidth above
    /// zero, 0.073 to 1.
    pub(super) fn intensity(&self, luma: Luma<'_>, start: usize, out: &mut [f64]) {
        match luma {
            Luma::U8(levels) => {
                for (out, &x) in out.iter_mut().zip(&levels[start..]) {
                    *out = self.intensity[usize::from(x)];
                }
            }
            Luma::F32(levels) => {
                for (out, &x) in out.iter_mut().zip(&levels[start..]) {
                    *out = intensity(grey(self.linear_light, f64::from(x)));
                }
            }
        }
    }
}

fn grey(linear_light: bool, level: f64) -> f64 {
    if linear_light { 255.0 * linear_of_srgb(level / 255.0) } else { level }
}

fn intensity(level: f64) -> f64 {
    (level + 20.0) / 275.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lin_log_is_continuous_and_linear_below_twenty() {
        assert_eq!(lin_log(0.0), 0.0);
        assert_eq!(lin_log(10.0), (20f64.ln() / 2.0) as f32);
        assert!((lin_log(20.0) - lin_log(20.000_001)).abs() < 1e-6);
        assert!((f64::from(lin_log(255.0)) - 255f64.ln()).abs() < 1e-6);
    }

    #[test]
    fn srgb_round_trip_is_the_identity() {
        for level in 0..=255 {
            let encoded = f64::from(level) / 255.0;
            assert!((srgb_of_linear(linear_of_srgb(encoded)) - encoded).abs() < 1e-7);
        }
    }

    #[test]
    fn whole_levels_respond_alike_as_bytes_and_as_floats() {
        let bytes: Vec<u8> = (0..=255).collect();
        let floats: Vec<f32> = bytes.iter().map(|&x| f32::from(x)).collect();
        for linear_light in [false, true] {
            let response = Response::new(linear_light);
            let (mut a, mut b) = ([0.0; 256], [0.0; 256]);
            response.log(Luma::U8(&bytes), 0, &mut a);
            response.log(Luma::F32(&floats), 0, &mut b);
            assert_eq!(a, b);
            let (mut a, mut b) = ([0.0; 256], [0.0; 256]);
            response.intensity(Luma::U8(&bytes), 0, &mut a);
            response.intensity(Luma::F32(&floats), 0, &mut b);
            assert_eq!(a, b);
            assert!((a[0] - 20.0 / 275.0).abs() < 1e-12 && (a[255] - 1.0).abs() < 1e-12);
        }
    }
}
