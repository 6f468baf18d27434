//! Learning rates over a stage.

/// A learning rate that falls exponentially from the first to the last value.
#[must_use]
pub fn decayed(rate: [f32; 2], progress: f64) -> f32 {
    let (first, last) = (f64::from(rate[0]), f64::from(rate[1]));
    if first <= 0.0 || last <= 0.0 {
        return (first + (last - first) * progress) as f32;
    }
    (first * (last / first).powf(progress.clamp(0.0, 1.0))) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_falls_evenly_in_its_logarithm() {
        assert!((decayed([1e-2, 1e-4], 0.5) - 1e-3).abs() < 1e-9);
        assert_eq!(decayed([1e-2, 1e-4], 2.0), 1e-4);
    }
}
