//! The pause between two looks for a lost camera.

use std::{
    thread,
    time::{Duration, Instant},
};

/// How often a lost camera is looked for.
const RETRY_EVERY: Duration = Duration::from_millis(500);

/// Waits until the camera is to be looked for again, or the owner stops.
pub fn pause(stopping: impl Fn() -> bool) {
    let begun = Instant::now();
    while begun.elapsed() < RETRY_EVERY && !stopping() {
        thread::sleep(RETRY_EVERY / 10);
    }
}
