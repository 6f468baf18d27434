//! Ctrl-C and requests to terminate.
//!
//! Where there is nothing to save, the program ends at once, without leaving intermediate files or children. Work that can be
//! continued is asked to stop. A second Ctrl-C ends the program at once: there is somebody who does not want to wait. A
//! second request to terminate does not: job schedulers send it several times, and what is being saved is to be saved.

use std::sync::{
    Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, Ordering},
};

use anyhow::Context;
use erfgs_base::ending;

static STOP: AtomicBool = AtomicBool::new(false);
static LISTENING: Mutex<Listening> = Mutex::new(Listening { begun: false, what_follows: None });

struct Listening {
    begun: bool,
    /// What is said of the end, once there is work to be brought to one.
    what_follows: Option<&'static str>,
}

/// From now on the program ends at once with exit code 130 when it is asked to stop, after it has removed what is not whole yet:
/// there is nothing that would have to be saved, and whoever started it is told that it can be started again.
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
    let Some(what_follows) = listening().what_follows else { end() };
    match (STOP.swap(true, Ordering::SeqCst), at_the_keyboard) {
        (false, _) => eprintln!("\nstopping: {what_follows}; press Ctrl-C again to end at once"),
        (true, true) => end(),
        (true, false) => {}
    }
}

fn end() -> ! {
    ending::clear();
    std::process::exit(130)
}

#[cfg(unix)]
fn listen() -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let mut wanted = vec![SIGINT, SIGTERM];
    // `nohup` has it ignored, so that work goes on when a terminal is closed.
    if !is_ignored(SIGHUP) {
        wanted.push(SIGHUP);
    }
    let mut signals = signal_hook::iterator::Signals::new(wanted)?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || signals.forever().for_each(|signal| asked(signal == SIGINT)))
        .map(drop)
}

/// Whether this process was started with a signal ignored. Known on Linux.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    ignored(&std::fs::read_to_string("/proc/self/status").unwrap_or_default()) & (1 << (signal - 1)) != 0
}

/// The signals that are ignored, the first as the lowest bit, by `/proc/PID/status`.
#[cfg(unix)]
fn ignored(status: &str) -> u64 {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

#[cfg(all(test, unix))]
mod tests {
    #[test]
    fn ignored_signals_are_read_from_the_status_of_a_process() {
        assert_eq!(super::ignored("Name:\terfgs\nSigBlk:\tff\nSigIgn:\t0000000000001001\nSigCgt:\t0\n"), 0x1001);
        assert_eq!(super::ignored(""), 0);
    }
}

#[cfg(not(unix))]
fn listen() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| asked(true))
}
