//! The twin of the counts of events.

/// The signed count of each pixel from the events of some bins (pixel, and whether it is ON), where an ON and an OFF event change `step` of
/// a pixel and events that nothing caused add up to its `drift`.
#[must_use]
pub fn signed(
    bins: &[Vec<(usize, bool)>],
    pixels: usize,
    step: impl Fn(usize) -> [f64; 2],
    drift: impl Fn(usize) -> f64,
) -> Vec<f64> {
    let mut counts = vec![[0_i64; 2]; pixels];
    for &(pixel, on) in bins.iter().flatten() {
        counts[pixel][usize::from(!on)] += 1;
    }
    let signed = |(pixel, [on, off]): (usize, [i64; 2])| {
        let step = step(pixel);
        on as f64 * step[0] - off as f64 * step[1] - drift(pixel)
    };
    counts.into_iter().enumerate().map(signed).collect()
}
