//! How sharp a thing's events are, and how far its colours are apart, against the rate at which it may turn about an axis: for people
//! to look at.

use glam::DVec3;
use serde_json::Value;

use super::{
    contrast::{Window, contrasts},
    shades::Shades,
    spin::Spin,
};

/// Rates of a curve, and from where to where it goes, in rates that were found.
const RATES: usize = 61;
const FROM_TO: [f64; 2] = [-1.0, 2.0];
/// It goes at least so far, radians per second.
const LEAST: f64 = 10.0;

/// A curve over rates about an axis.
#[derive(Clone, Debug)]
pub struct Curve {
    /// The axis, in the world.
    pub axis: DVec3,
    /// Rates, radians per second.
    pub rates: Vec<f64>,
    /// The mean contrast of events, the greatest 1; empty without events.
    pub contrast: Vec<f64>,
    /// How far colours of frames are apart, the farthest 1; empty where they are not compared.
    pub apart: Vec<f64>,
}

impl Curve {
    /// Along the axis that was found, or else that of the best rate that was looked at; none where nothing was.
    pub fn new(spin: &Spin, shades: Option<&Shades<'_>>, windows: &[&Window]) -> Option<Self> {
        let noted = |name: &str| serde_json::from_value(spin.found_by.get(name).unwrap_or(&Value::Null).clone()).ok();
        let looked_at = ["rate_by_events_rad_s", "rate_by_frames_rad_s"].into_iter().filter_map(noted);
        let rates = std::iter::once(spin.rate).chain(looked_at.map(|rate: [f64; 3]| DVec3::from(rate)));
        let rate = rates.into_iter().find(|rate| rate.length() > 1e-6)?;
        let (axis, length) = (rate.normalize(), rate.length().max(LEAST));
        let [from, to] = FROM_TO.map(|end| end * length);
        let along = |at: usize| from + (to - from) * at as f64 / (RATES - 1) as f64;
        let rates: Vec<f64> = (0..RATES).map(along).collect();
        let about: Vec<DVec3> = rates.iter().map(|rate| *rate * axis).collect();
        let contrast = if windows.is_empty() { Vec::new() } else { of_greatest(contrasts(windows, &about)) };
        let apart = shades.map(|shades| of_greatest(shades.apart(&about))).unwrap_or_default();
        Some(Self { axis, rates, contrast, apart })
    }
}

fn of_greatest(values: Vec<f64>) -> Vec<f64> {
    let greatest = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    values.into_iter().map(|value| value / greatest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_no_curve_about_no_axis_and_one_about_what_was_looked_at() {
        assert!(Curve::new(&Spin::default(), None, &[]).is_none());
        let found_by = [("rate_by_events_rad_s".to_owned(), serde_json::json!([0.0, 20.0, 0.0]))].into();
        let curve = Curve::new(&Spin { rate: DVec3::ZERO, found_by }, None, &[]).unwrap();
        assert_eq!((curve.axis, curve.rates[0], curve.rates[60]), (DVec3::Y, -20.0, 40.0));
        assert!(curve.contrast.is_empty() && curve.apart.is_empty());
    }
}
