//! Microseconds of Python, nanoseconds of the libraries.

use pyo3::PyResult;
use pyo3::exceptions::PyValueError;

/// Microseconds of a time in nanoseconds, rounded down as the times of events are.
pub fn us(t_ns: i64) -> i64 {
    t_ns.div_euclid(1000)
}

/// Two times.
pub fn both_us(span_ns: [i64; 2]) -> (i64, i64) {
    (us(span_ns[0]), us(span_ns[1]))
}

/// Nanoseconds of a time in microseconds.
pub fn ns(t_us: i64) -> PyResult<i64> {
    t_us.checked_mul(1000).ok_or_else(|| {
        PyValueError::new_err(format!("{t_us} is no time: microseconds of session time are wanted, 292 years at most"))
    })
}

/// A span whose ends are those of `whole` where nothing is said.
pub fn span_ns(start_us: Option<i64>, end_us: Option<i64>, whole: [i64; 2]) -> PyResult<[i64; 2]> {
    let end = |given: Option<i64>, end| given.map_or(Ok(end), ns);
    Ok([end(start_us, whole[0])?, end(end_us, whole[1])?])
}
