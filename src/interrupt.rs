//! Ctrl-C during work that can be continued: the first press asks the work to stop, the second ends the program.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;

static STOP: AtomicBool = AtomicBool::new(false);

/// Starts to listen for Ctrl-C (and for a request to terminate), and gives the flag that the work polls.
pub fn stop_flag(what_follows: &'static str) -> anyhow::Result<&'static AtomicBool> {
    ctrlc::set_handler(move || {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
        eprintln!("\nstopping: {what_follows}; press Ctrl-C again to end at once");
    })
    .context("cannot listen for Ctrl-C")?;
    Ok(&STOP)
}
