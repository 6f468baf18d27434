//! Events as pictures.

use erfgs_session::{Events, ImageRgb8};

/// ON minus OFF events of each pixel with `from_us <= t < to_us`, row-major.
#[must_use]
pub fn signed_counts(events: &Events, from_us: i64, to_us: i64) -> Vec<i32> {
    let mut counts = vec![0; events.width as usize * events.height as usize];
    for index in events.between(from_us, to_us) {
        let event = events.get(index);
        if let Some(count) = counts.get_mut(usize::from(event.y) * events.width as usize + usize::from(event.x)) {
            *count += if event.on { 1 } else { -1 };
        }
    }
    counts
}

/// Signed counts as a picture: white where nothing happened, red for ON, blue for OFF, full colour at `full` events.
#[must_use]
pub fn picture(counts: &[i32], width: u32, height: u32, full: f32) -> ImageRgb8 {
    todo!("{counts:?} {width} {height} {full}")
}
