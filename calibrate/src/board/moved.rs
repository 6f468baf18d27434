//! How far a board has moved across an image.

use super::Corner;

/// Root mean square distance between the corners of two views, pixels; infinite where fewer than half of the corners that
/// are seen `after` were seen `before`. Both are in the order of the numbers.
pub(super) fn moved_px(before: &[Corner], after: &[Corner]) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    let mut known = before.iter().peekable();
    for corner in after {
        while known.next_if(|other| other.id < corner.id).is_some() {}
        if let Some(same) = known.next_if(|other| other.id == corner.id) {
            sum += same.pixel.distance_squared(corner.pixel);
            count += 1;
        }
    }
    if count == 0 || 2 * count < after.len() { f64::INFINITY } else { (sum / count as f64).sqrt() }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    #[test]
    fn corners_are_compared_by_their_numbers() {
        let view = |list: &[(u32, f64)]| -> Vec<Corner> {
            list.iter().map(|&(id, x)| Corner { id, pixel: DVec2::new(x, 5.0) }).collect()
        };
        let before = view(&[(1, 10.0), (2, 20.0), (5, 50.0)]);
        let off = moved_px(&before, &view(&[(0, 1.0), (1, 13.0), (5, 54.0)]));
        assert!((off - 12.5_f64.sqrt()).abs() < 1e-12, "{off}");
        assert_eq!(moved_px(&before, &view(&[(0, 1.0), (3, 2.0), (5, 50.0)])), f64::INFINITY, "one of three");
        assert_eq!(moved_px(&before, &[]), f64::INFINITY);
    }
}
