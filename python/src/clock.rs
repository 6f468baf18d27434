//! How a stream is tied to the session's clock.

use erfgs_session::clock::{Clock as Fit, Epoch};
use erfgs_sync::{StreamSync, Tier};
use numpy::{IntoPyArray, PyArrayLike1};
use pyo3::{exceptions::PyValueError, prelude::*};

use crate::times;

/// The clock of a stream and how well it is known. Residuals are distances of samples from the clock, microseconds.
#[pyclass(frozen, module = "erfgs")]
pub struct Clock(StreamSync);

/// A stretch of a stream in which its device's clock ran without a break.
#[pyclass(frozen, module = "erfgs")]
pub struct ClockPart {
    id: String,
    epoch: Epoch,
}

impl From<StreamSync> for Clock {
    fn from(sync: StreamSync) -> Self {
        Self(sync)
    }
}

fn tier(tier: Tier) -> &'static str {
    match tier {
        Tier::Strobe => "strobe",
        Tier::HardwareTriggered => "hardware-triggered",
        Tier::Flash => "flash",
        Tier::FreeRunning => "free-running",
    }
}

impl Clock {
    /// (p50, p95, max) of the worst part, nanoseconds.
    fn residuals_ns(&self) -> [f64; 3] {
        let rows = self.0.rows();
        let worst =
            rows.iter().map(|row| row.residuals).max_by(|a, b| a.p95_ns.total_cmp(&b.p95_ns)).unwrap_or_default();
        [worst.p50_ns, worst.p95_ns, worst.max_ns]
    }
}

#[pymethods]
impl Clock {
    /// The stream.
    #[getter]
    fn stream(&self) -> String {
        self.0.id.clone()
    }

    /// How the stream is tied to the session's clock, of several parts the worst: "strobe", "hardware-triggered", "flash" or
    /// "free-running".
    #[getter]
    fn tier(&self) -> &'static str {
        tier(self.0.tier)
    }

    /// On how many edges, arrivals or frames it rests.
    #[getter]
    fn samples(&self) -> u64 {
        self.0.rows().iter().map(|row| row.samples).sum()
    }

    /// Half of the samples lie closer, microseconds.
    #[getter]
    fn p50(&self) -> f64 {
        1e-3 * self.residuals_ns()[0]
    }

    /// 95 of 100 samples lie closer, microseconds.
    #[getter]
    fn p95(&self) -> f64 {
        1e-3 * self.residuals_ns()[1]
    }

    /// The farthest sample that was not set aside, microseconds.
    #[getter]
    fn max(&self) -> f64 {
        1e-3 * self.residuals_ns()[2]
    }

    /// Frames that belong to no pulse of the trigger board, and so have no time; 0 for event cameras.
    #[getter]
    fn undated_frames(&self) -> u64 {
        self.0.exposures.as_ref().map_or(0, |exposures| exposures.unmatched)
    }

    /// What is not as it should be: what was lost, and what cannot be relied on.
    #[getter]
    fn faults(&self) -> Vec<String> {
        self.0.faults.clone()
    }

    /// What else should be known.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }

    /// The parts between breaks of the device's clock, in the order of the stream; none for frame cameras, which have no ticks.
    #[getter]
    fn parts(&self) -> Vec<ClockPart> {
        let parts = self.0.epochs.as_slice().iter();
        parts.map(|epoch| ClockPart { id: self.0.id.clone(), epoch: epoch.clone() }).collect()
    }

    fn __repr__(&self) -> String {
        let [p50, p95, max] = self.residuals_ns().map(|ns| 1e-3 * ns);
        let (id, tier) = (&self.0.id, tier(self.0.tier));
        format!("<erfgs.Clock of {id}: {tier}, residuals {p50:.2} / {p95:.2} / {max:.2} µs (50 %, 95 %, all)>")
    }
}

impl ClockPart {
    fn fit(&self) -> PyResult<&Fit> {
        let fit = self.epoch.clock.as_ref();
        fit.ok_or_else(|| PyValueError::new_err(format!("nothing dates this part of stream '{}'", self.id)))
    }
}

#[pymethods]
impl ClockPart {
    /// When its first packet arrived, microseconds of session time.
    #[getter]
    fn arrived(&self) -> i64 {
        times::us(self.epoch.arrived_ns)
    }

    /// Whether anything dates it.
    #[getter]
    fn is_dated(&self) -> bool {
        self.epoch.clock.is_some()
    }

    /// By how much the device's clock is slower than it should be, parts per million.
    #[getter]
    fn rate_ppm(&self) -> PyResult<f64> {
        Ok(self.fit()?.rate_error_ppm())
    }

    /// How it is tied to the session's clock: "strobe", "hardware-triggered", "flash" or "free-running".
    #[getter]
    fn tier(&self) -> PyResult<&'static str> {
        Ok(tier(Tier::of(self.fit()?)))
    }

    /// (50 %, 95 %, all) of the samples lie closer, microseconds.
    #[getter]
    fn residuals(&self) -> PyResult<(f64, f64, f64)> {
        let found = self.fit()?.residuals;
        Ok((1e-3 * found.p50_ns, 1e-3 * found.p95_ns, 1e-3 * found.max_ns))
    }

    /// Session times of device times (`events(..., clock="device")["t"]`, ticks; of event cameras microseconds), both int64 of shape
    /// (n,); microseconds, rounded down.
    fn to_session<'py>(&self, py: Python<'py>, ticks: PyArrayLike1<'py, i64>) -> PyResult<Bound<'py, PyAny>> {
        let fit = self.fit()?;
        let ticks = ticks.as_array();
        Ok(ticks.mapv(|tick| times::us(fit.session_ns(tick))).into_pyarray(py).into_any())
    }
}
