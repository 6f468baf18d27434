//! Ctrl-C and requests to terminate, during work that can be continued.
//!
//! The first asks the work to stop. A second Ctrl-C ends the program at once: there is somebody who does not want to wait. A
//! second request to terminate does not: job schedulers send it several times, and what is being saved is to be saved.

use std::sync::{
    Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, Ordering},
};

use anyhow::Context;

static STOP: AtomicBool = AtomicBool::new(false);
static LISTENING: Mutex<Listening> = Mutex::new(Listening { begun: false, what_follows: None });

struct Listening {
    begun: bool,
    /// What is said of the end, once there is work to be brought to one.
    what_follows: Option<&'static str>,
}

/// From now on the program ends at once with exit code 130 when it is asked to stop: there is nothing yet that would have to
/// be saved, and whoever started it is told that it can be started again.
pub fn stop_at_once() -> anyhow::Result<()> {
    begin(&mut listening())
}

/// Starts to listen for Ctrl-C and requests to terminate, and gives the flag that the work polls.
pub fn stop_flag(what_follows: &'static str) -> anyhow::Result<&'static AtomicBool> {
    let mut listening = listening();
    listening.what_follows = Some(what_follows);
    begin(&mut listening)?;
    Ok(&STOP)
}

fn listening() -> MutexGuard<'static, Listening> {
    LISTENING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn begin(listening: &mut Listening) -> anyhow::Result<()> {
    if !std::mem::replace(&mut listening.begun, true) {
        listen().context("cannot listen for Ctrl-C")?;
    }
    Ok(())
}

/// Somebody wants the program to end; `at_the_keyboard` says that it was Ctrl-C.
fn asked(at_the_keyboard: bool) {
    let Some(what_follows) = listening().what_follows else { std::process::exit(130) };
    match (STOP.swap(true, Ordering::SeqCst), at_the_keyboard) {
        (false, _) => eprintln!("\nstopping: {what_follows}; press Ctrl-C again to end at once"),
        (true, true) => std::process::exit(130),
        (true, false) => {}
    }
}

#[cfg(unix)]
fn listen() -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || signals.forever().for_each(|signal| asked(signal == SIGINT)))
        .map(drop)
}

#[cfg(not(unix))]
fn listen() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| asked(true))
}
