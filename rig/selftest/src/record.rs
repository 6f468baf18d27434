//! A recording of some devices, made for the test.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

use erfgs_recorder::{Input, Options, RecordError, Recorder, RigConfig, SessionFiles, SessionInfo};
use erfgs_rig::host_time::host_ns;
use erfgs_session::{Session, source::Source};

use crate::{
    error::SelftestError,
    observe::{Recording, observe},
    shared::SharedSource,
};

/// Space of the disk that the test leaves free, bytes.
const RESERVE_BYTES: u64 = 64 << 20;
/// How often progress is reported.
const TURN: Duration = Duration::from_millis(50);

/// A device that is open.
pub struct Opened {
    pub source: SharedSource,
    pub queue_bytes: usize,
}

/// What became of a recording.
pub enum Outcome {
    /// It was made, and the devices measured this of themselves meanwhile.
    Recorded(Box<Recording>, Vec<BTreeMap<String, f64>>),
    /// A device did not start.
    NotStarted {
        /// Which.
        device: String,
        /// What its driver says.
        reason: String,
    },
}

/// Records devices for so long into a session at `path`. `progress` is called with the share of it that is done.
pub fn record(
    rig: &RigConfig,
    devices: &[&Opened],
    path: &Path,
    length: Duration,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(f64),
) -> Result<Outcome, SelftestError> {
    let inputs = devices.iter().map(|device| Input {
        source: Box::new(device.source.clone()),
        queue_bytes: device.queue_bytes,
        stall_after: None,
    });
    let recorder = Recorder::new(inputs.collect(), options(rig, path))?;
    recorder.start_recording(path)?;
    match recorder.start_sources() {
        Ok(()) => {}
        Err(RecordError::Start { id, source, .. }) => {
            drop(recorder);
            let _ = std::fs::remove_file(path);
            return Ok(Outcome::NotStarted { device: id, reason: source.to_string() });
        }
        Err(error) => return Err(error.into()),
    }
    let begun = Instant::now();
    while begun.elapsed() < length && recorder.is_recording() {
        if stop.load(Ordering::SeqCst) {
            return Err(SelftestError::Stopped);
        }
        progress((begun.elapsed().as_secs_f64() / length.as_secs_f64()).min(1.0));
        thread::sleep(TURN.min(length.saturating_sub(begun.elapsed())));
    }
    // While they run: what they count is known by it, too.
    let readings = |device: &&Opened| {
        let readings = device.source.clone().readings();
        readings.into_iter().filter(|(_, value)| value.is_finite()).collect()
    };
    let readings = devices.iter().map(readings).collect();
    let ended_ns = host_ns();
    recorder.stop_sources();
    let summary = recorder.stop_recording("the test is over").ok().or_else(|| recorder.last());
    let ended = |failure| SelftestError::Ended { path: path.to_owned(), failure };
    let Some(summary) = summary else { return Err(ended("nothing was recorded".into())) };
    if let Some(failure) = summary.failure {
        return Err(ended(failure));
    }
    let recording = observe(&mut Session::open(path)?, Some(ended_ns))?;
    Ok(Outcome::Recorded(Box::new(recording), readings))
}

fn options(rig: &RigConfig, path: &Path) -> Options {
    Options {
        info: SessionInfo {
            rig: rig.name.clone(),
            configuration: rig.text.clone(),
            program: concat!("erfgs ", env!("CARGO_PKG_VERSION")).into(),
            ..SessionInfo::default()
        },
        flush_every: Duration::from_millis(rig.record.flush_ms),
        reserve_bytes: RESERVE_BYTES,
        folder: erfgs_recorder::folder_of(path),
        opener: Box::new(SessionFiles::default()),
        subscriber: None,
        before: None,
        after: None,
        rig_file: None,
    }
}
