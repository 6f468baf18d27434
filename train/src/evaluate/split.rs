//! When a held-out frame was taken: while a training frame was exposed, between two, or where no frame looks any more.

use crate::scene::Scene;

/// When, as seen from the frames that supervise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// While a training frame was exposed.
    AtFrame,
    /// Between exposures, where frames before and after it know what there was.
    Between,
    /// Before the first exposure or after the last.
    Outside,
}

/// When `t01` is. Frames of an instant count a thousandth of an interval around it.
pub fn when(scene: &Scene, t01: f64) -> When {
    let near = 1e-3 / scene.intervals();
    let exposures = || scene.frames.iter().map(|frame| frame.exposure);
    if exposures().any(|[start, end]| t01 >= start - near && t01 <= end + near) {
        return When::AtFrame;
    }
    let first = exposures().map(|[start, _]| start).fold(f64::INFINITY, f64::min);
    let last = exposures().map(|[_, end]| end).fold(f64::NEG_INFINITY, f64::max);
    if t01 > first && t01 < last { When::Between } else { When::Outside }
}
