//! How sharp a thing's events are, and how far its colours are apart, against the rate at which it may turn about an axis: for people
//! to look at.

use glam::DVec3;

use super::{
    contrast::{Window, contrasts},
    shades::Compared,
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
    pub fn new(spin: &Spin, compared: Option<&dyn Compared>, windows: &[&Window]) -> Option<Self> {
        let rate = [spin.rate, spin.looked_at].into_iter().find(|rate| *rate != DVec3::ZERO)?;
        let (axis, length) = (rate.normalize(), rate.length().max(LEAST));
        let [from, to] = FROM_TO.map(|end| end * length);
        let along = |at: usize| from + (to - from) * at as f64 / (RATES - 1) as f64;
        let rates: Vec<f64> = (0..RATES).map(along).collect();
        let about: Vec<DVec3> = rates.iter().map(|rate| *rate * axis).collect();
        let contrast = if windows.is_empty() { Vec::new() } else { of_greatest(contrasts(windows, &about)) };
        let apart = compared.map(|compared| of_greatest(compared.apart(&about))).unwrap_or_default();
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
        let spin = Spin { looked_at: DVec3::Y * 20.0, ..Spin::default() };
        let curve = Curve::new(&spin, None, &[]).unwrap();
        assert_eq!((curve.axis, curve.rates[0], curve.rates[60]), (DVec3::Y, -20.0, 40.0));
        assert!(curve.contrast.is_empty() && curve.apart.is_empty());
    }
}
