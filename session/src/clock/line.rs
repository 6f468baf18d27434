//! Lines through samples of two clocks: by least squares for errors of either sign, and as the lower envelope for delays.
//!
//! All arithmetic is on small numbers: ticks from the middle of the samples, and of the session time what the nominal
//! rate does not explain already. Hours of a clock that is off by 500 ppm leave seconds there, which f64 holds to 1 ns
//! and better.

use super::fit::{ClockFit, Evidence, FitError, Residuals, Sample};

/// So far off a crystal is at most, parts per million. A slope beyond comes from samples that lie too close together, and the nominal rate is
/// the better guess; or from a ceramic resonator.
pub const CRYSTAL_PPM: f64 = 1e3;
/// So far off a ceramic resonator is at most, parts per million, such as an Arduino Uno has: 0.5 %, and what warmth adds. Clocks that are
/// farther off are not fitted.
pub const RESONATOR_PPM: f64 = 1e4;
/// A resonator is believed in where its rate explains so many times what scatters about the line, from so many samples on.
const CLEAR: f64 = 10.0;
const FEWEST_CLEAR: usize = 8;

/// How outliers are kept from a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Robust {
    /// The robust start looks at so many samples at most, evenly chosen; its work grows with their square. A few are enough
    /// where three in ten are wrong (docs/results/precision.md).
    pub start_samples: usize,
    /// Samples farther from the line than so many times the median distance are outliers. For a normal distribution, of
    /// which the median distance is 0.67 standard deviations, one sample in 10^8 is farther than 9 times.
    pub outlier_factor: f64,
}

impl Default for Robust {
    fn default() -> Self {
        Self { start_samples: 51, outlier_factor: 9.0 }
    }
}

/// Samples in small numbers.
struct Centred {
    origin: Sample,
    nominal: f64,
    /// Ticks from the origin, and nanoseconds that the nominal rate leaves unexplained.
    points: Vec<(f64, f64)>,
}

/// `y = offset + slope * x` on the points.
#[derive(Clone, Copy, Debug, Default)]
struct Line {
    offset: f64,
    slope: f64,
}

impl Line {
    fn distance(&self, (x, y): (f64, f64)) -> f64 {
        y - self.offset - self.slope * x
    }
}

impl Centred {
    fn new(samples: &[Sample], nominal_ns_per_tick: f64) -> Result<Self, FitError> {
        let mut ticks: Vec<Sample> = samples.to_vec();
        if ticks.is_empty() {
            return Err(FitError::NoSamples);
        }
        let middle = ticks.len() / 2;
        let origin = *ticks.select_nth_unstable_by_key(middle, |sample| sample.ticks).1;
        let points = samples
            .iter()
            .map(|sample| {
                let x = (i128::from(sample.ticks) - i128::from(origin.ticks)) as f64;
                let y = (i128::from(sample.session_ns) - i128::from(origin.session_ns)) as f64;
                (x, y - x * nominal_ns_per_tick)
            })
            .collect();
        Ok(Self { origin, nominal: nominal_ns_per_tick, points })
    }

    /// Whether a clock can have a rate that was found from `points`.
    fn is_plausible(&self, slope: f64, points: &[(f64, f64)]) -> bool {
        let off_ppm = 1e6 * slope.abs() / self.nominal.abs();
        if off_ppm.is_nan() || off_ppm > RESONATOR_PPM {
            return false;
        }
        if off_ppm <= CRYSTAL_PPM {
            return true;
        }
        let spread = |values: Vec<f64>| {
            let middle = median(values.clone());
            median(values.into_iter().map(|value| (value - middle).abs()).collect())
        };
        let explained = slope.abs() * spread(points.iter().map(|point| point.0).collect());
        let left = spread(points.iter().map(|point| point.1 - slope * point.0).collect());
        points.len() >= FEWEST_CLEAR && explained > CLEAR * left.max(self.nominal.abs())
    }

    /// The line, or one of nominal rate through the median if its rate cannot be.
    fn plausible(&self, line: Line, points: &[(f64, f64)]) -> Line {
        if self.is_plausible(line.slope, points) {
            return line;
        }
        Line { offset: median(points.iter().map(|point| point.1).collect()), slope: 0.0 }
    }

    fn fit(&self, line: Line, evidence: Evidence, inliers: &[(f64, f64)]) -> ClockFit {
        let distances = inliers.iter().map(|&point| line.distance(point).abs()).collect();
        let bound = |pick: fn(f64, f64) -> f64| {
            let x = inliers.iter().map(|point| point.0).reduce(pick).unwrap_or(0.0);
            self.origin.ticks.saturating_add(x as i64)
        };
        ClockFit {
            evidence,
            origin_ticks: self.origin.ticks,
            origin_ns: self.origin.session_ns.saturating_add(line.offset.round() as i64),
            ns_per_tick: self.nominal + line.slope,
            window_ticks: [bound(f64::min), bound(f64::max)],
            residuals: Residuals::of(distances),
            samples: inliers.len() as u64,
            outliers: (self.points.len() - inliers.len()) as u64,
        }
    }

    /// A line that bears almost half of the samples lying anywhere: for every sample the median of the slopes to all
    /// others, of these the median (Siegel's repeated medians).
    fn robust(&self, robust: &Robust) -> Line {
        let count = self.points.len();
        let step = count.div_ceil(robust.start_samples.max(1)).max(1);
        // The middle of each run, so that the ends are not favoured.
        let chosen: Vec<(f64, f64)> = self.points.iter().copied().skip((step - 1) / 2).step_by(step).collect();
        let slopes = chosen.iter().filter_map(|&(x, y)| {
            let to_others: Vec<f64> =
                chosen.iter().filter(|other| other.0 != x).map(|other| (other.1 - y) / (other.0 - x)).collect();
            (!to_others.is_empty()).then(|| median(to_others))
        });
        let slope = median(slopes.collect());
        let offset = median(chosen.iter().map(|&(x, y)| y - slope * x).collect());
        self.plausible(Line { offset, slope }, &chosen)
    }

    /// The least-squares line through `points`.
    fn least_squares(&self, points: &[(f64, f64)]) -> Line {
        let count = points.len() as f64;
        let mean_x = points.iter().map(|point| point.0).sum::<f64>() / count;
        let mean_y = points.iter().map(|point| point.1).sum::<f64>() / count;
        let (mut xx, mut xy) = (0.0, 0.0);
        for &(x, y) in points {
            xx += (x - mean_x) * (x - mean_x);
            xy += (x - mean_x) * (y - mean_y);
        }
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        self.plausible(Line { offset: mean_y - slope * mean_x, slope }, points)
    }
}

/// Fits a line to samples with errors of either sign, such as matched edges, by least squares without outliers; up to 40 %
/// of the samples may be outliers. `nominal_ns_per_tick` is what a tick should be.
///
/// # Errors
/// Without samples. One sample, or several at one tick, give the nominal rate.
pub fn fit_line(
    samples: &[Sample],
    nominal_ns_per_tick: f64,
    evidence: Evidence,
    robust: &Robust,
) -> Result<ClockFit, FitError> {
    let centred = Centred::new(samples, nominal_ns_per_tick)?;
    let mut line = centred.robust(robust);
    let mut inliers = centred.points.clone();
    for _ in 0..4 {
        let typical = median(centred.points.iter().map(|&point| line.distance(point).abs()).collect());
        // Time stamps are whole ticks, so that a distance of a tick is none.
        let limit = (robust.outlier_factor * typical).max(nominal_ns_per_tick.abs());
        inliers = centred.points.iter().copied().filter(|&point| line.distance(point).abs() <= limit).collect();
        line = centred.least_squares(&inliers);
    }
    Ok(centred.fit(line, evidence, &inliers))
}

/// Fits the highest line that no sample lies below, measured at the samples' mean: the line of least delay for samples
/// that come late, never early. Samples that lie far below all others (damaged device times) are set aside.
///
/// # Errors
/// Without samples. One sample, or several at one tick, give the nominal rate.
pub fn fit_lower_envelope(
    samples: &[Sample],
    nominal_ns_per_tick: f64,
    evidence: Evidence,
    robust: &Robust,
) -> Result<ClockFit, FitError> {
    let centred = Centred::new(samples, nominal_ns_per_tick)?;
    let start = centred.robust(robust);
    let typical = median(centred.points.iter().map(|&point| start.distance(point).abs()).collect());
    let limit = (robust.outlier_factor * typical).max(nominal_ns_per_tick.abs());
    let inliers: Vec<(f64, f64)> =
        centred.points.iter().copied().filter(|&point| start.distance(point) >= -limit).collect();
    let mean_x = inliers.iter().map(|point| point.0).sum::<f64>() / inliers.len() as f64;
    let hull = lower_hull(inliers.clone());
    // The line of least total delay lies on the edge of the hull above which the mean lies.
    let edge = hull.windows(2).find(|edge| edge[0].0 <= mean_x && mean_x <= edge[1].0);
    let slope = edge.map_or(0.0, |edge| (edge[1].1 - edge[0].1) / (edge[1].0 - edge[0].0));
    let slope = if centred.is_plausible(slope, &inliers) { slope } else { start.slope };
    // On the edge the lowest distance is that of its ends; for another slope, that of the sample that limits it.
    let offset = inliers.iter().map(|&(x, y)| y - slope * x).fold(f64::INFINITY, f64::min);
    Ok(centred.fit(Line { offset, slope }, evidence, &inliers))
}

/// The lower convex hull from left to right (Andrew's monotone chain); of several points at one x, the lowest.
fn lower_hull(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    points.dedup_by_key(|point| point.0);
    let mut hull: Vec<(f64, f64)> = Vec::new();
    for point in points {
        while let [.., a, b] = hull[..] {
            let turn = (b.0 - a.0) * (point.1 - a.1) - (b.1 - a.1) * (point.0 - a.0);
            if turn > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(point);
    }
    hull
}

/// The median; 0 of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if below.len() > middle || values.len() % 2 == 1 {
        return upper;
    }
    let lower = values[..middle].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (lower + upper) / 2.0
}
