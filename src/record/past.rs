//! The past that is held in memory, and what keeps it: an alarm, or Enter.

use std::{
    sync::{Arc, OnceLock, Weak},
    thread,
    time::Duration,
};

use erfgs_recorder::{AlarmKind, Before, Level, RecordConfig, RecordError, Recorder};
use erfgs_session::source::Description;

/// How much of the past is held.
pub(super) fn before(record: &RecordConfig, seconds: f64) -> Before {
    Before { span: Duration::from_secs_f64(seconds), bytes: record.before_mib << 20 }
}

/// A stream that an alarm names and that is no event camera of the rig.
pub(super) fn unknown<'a>(kinds: &'a [AlarmKind], streams: &[Description]) -> Option<&'a str> {
    let known = |id: &str| streams.iter().any(|stream| stream.id == id && stream.encoding.is_events());
    kinds.iter().find_map(|kind| match kind {
        AlarmKind::Edge(Some(id)) if !known(id) => Some(id.as_str()),
        _ => None,
    })
}

/// Called with a stream and what was detected in it.
pub(super) type OnAlarm = Box<dyn Fn(&str, &str) + Send>;

/// Keeps the past of a recorder, once there is one, at an alarm.
pub(super) fn keep_on_alarm(recorder: &Arc<OnceLock<Weak<Recorder>>>) -> OnAlarm {
    let recorder = Arc::clone(recorder);
    Box::new(move |stream, what| {
        let Some(recorder) = recorder.get().and_then(Weak::upgrade) else { return };
        match recorder.keep_past(recorder.after()) {
            Ok(_) => recorder.say(Level::Info, stream, format!("{what}: the past is kept")),
            // A recording that runs keeps it anyway.
            Err(RecordError::Busy(_)) => {}
            Err(error) => recorder.say(Level::Error, stream, error.to_string()),
        }
    })
}

/// Enter keeps the past; where a recording runs without an end, it ends it.
pub(super) fn keep_at_enter(recorder: &Arc<Recorder>) -> std::io::Result<()> {
    let recorder = Arc::downgrade(recorder);
    // Nothing waits for this thread: it ends with its input, or with the program.
    thread::Builder::new().name("enter".into()).spawn(move || {
        for line in std::io::stdin().lines() {
            let (Ok(_), Some(recorder)) = (line, recorder.upgrade()) else { return };
            if recorder.is_recording() && recorder.after().is_none() {
                let _ = recorder.stop_recording("stopped by Enter");
            } else if let Err(error) = recorder.keep_past(recorder.after()) {
                recorder.say(Level::Error, "", error.to_string());
            }
        }
    })?;
    Ok(())
}
