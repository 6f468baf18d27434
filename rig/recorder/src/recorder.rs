//! The recorder: sources started in order, one recording at a time, and a watchdog thread over both.

use std::{
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant, SystemTime},
};

use erfgs_session::source::{Counters, Description, Incident, Source};

use erfgs_rig::host_time::host_ns;

use super::{
    adjust::AdjustError,
    concerns::Concerns,
    error::RecordError,
    gate::{Before, Gate},
    log::Log,
    meter::Meter,
    names,
    queue::{Item, Queue},
    sink::{OpenSession, SessionInfo, SinkError},
    status::{Level, Message, RecordingStatus, Status, StreamState, Summary},
    stream_outlet::StreamOutlet,
    stream_queue::StreamQueue,
    subscriber::Subscriber,
    watchdog,
    writer::{self, Progress},
};

/// One stream and how it is looked after.
pub struct Input {
    /// The device.
    pub source: Box<dyn Source>,
    /// Bytes that may wait in memory for the disk.
    pub queue_bytes: usize,
    /// After this long without a packet the stream counts as stalled; `None` where silence is normal.
    pub stall_after: Option<Duration>,
}

/// How to record.
pub struct Options {
    /// Name of the rig and its configuration, for the session file.
    pub info: SessionInfo,
    /// How often the file is brought into a readable state; at most a second.
    pub flush_every: Duration,
    /// Free bytes of the disk at which a recording ends in good order.
    pub reserve_bytes: u64,
    /// Folder of the recordings.
    pub folder: PathBuf,
    /// Opens session files.
    pub opener: Box<dyn OpenSession>,
    /// Who is shown every packet as it passes.
    pub subscriber: Option<Arc<dyn Subscriber>>,
    /// How much of the past is held while nothing is recorded: recordings begin with it.
    pub before: Option<Before>,
    /// How long a recording goes on that was begun to keep the past; `None` until it is stopped.
    pub after: Option<Duration>,
    /// The file that the rig was read from.
    pub rig_file: Option<PathBuf>,
}

/// A stream at work.
pub(super) struct Slot {
    pub description: Description,
    pub source: Mutex<Box<dyn Source>>,
    pub outlet: Arc<StreamOutlet>,
    pub queue_bytes: usize,
    pub stall_after: Option<Duration>,
    /// Settings that were changed since it was opened.
    pub adjusted: Mutex<serde_json::Map<String, serde_json::Value>>,
    /// What the watchdog knows of it.
    pub watch: Mutex<Watch>,
}

#[derive(Default)]
pub(super) struct Watch {
    pub state: StreamState,
    pub counters: Counters,
    /// The counters when the recording started.
    pub baseline: Counters,
    pub readings: std::collections::BTreeMap<String, f64>,
    pub meter: Meter,
    pub started: Option<Instant>,
    pub drops_seen: u64,
    pub drop_seen_at: Option<Instant>,
}

impl Watch {
    /// The source does not run any more, or never did.
    fn stop(&mut self) {
        self.state = StreamState::Stopped;
        self.started = None;
    }
}

/// The recording that runs.
pub(super) struct RunningRecording {
    pub path: PathBuf,
    pub queue: Arc<Queue>,
    pub progress: Arc<Progress>,
    pub started: Instant,
    /// How much of the past it began with, seconds.
    pub past_s: f64,
    pub meter: Meter,
    /// When it ends by itself.
    pub ends_at: Option<Instant>,
    writer: JoinHandle<Result<(), SinkError>>,
}

pub(super) struct Shared {
    pub slots: Vec<Slot>,
    pub gate: Arc<Gate>,
    pub options: Options,
    pub log: Arc<Mutex<Log>>,
    pub concerns: Mutex<Concerns>,
    pub recording: Mutex<Option<RunningRecording>>,
    /// The session file that is being completed.
    pub finishing: Mutex<Option<PathBuf>>,
    /// Held while a recording ends, so that whoever ends it too waits.
    ending: Mutex<()>,
    pub last: Mutex<Option<Summary>>,
    pub status: Mutex<Arc<Status>>,
    /// Held while the status is brought up to date, so that an older one never takes the place of a newer one.
    pub refreshing: Mutex<()>,
    pub quit: AtomicBool,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A rig that can be watched and recorded. All methods may be called from any thread.
pub struct Recorder {
    shared: Arc<Shared>,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

impl Recorder {
    /// Takes the streams of a rig. Nothing starts yet.
    ///
    /// # Errors
    /// If there are none, or two have one name.
    pub fn new(inputs: Vec<Input>, options: Options) -> Result<Self, RecordError> {
        if inputs.is_empty() {
            return Err(RecordError::NoDevices);
        }
        let log = Arc::new(Mutex::new(Log::default()));
        let gate = Arc::new(Gate::new(inputs.len(), options.before));
        let mut slots: Vec<Slot> = Vec::new();
        for (stream, input) in inputs.into_iter().enumerate() {
            let description = input.source.description().clone();
            let id = &description.id;
            if !is_id(id) {
                return Err(RecordError::BadId(id.clone()));
            }
            if slots.iter().any(|slot| slot.description.id == *id) {
                return Err(RecordError::DuplicateId(id.clone()));
            }
            let outlet = Arc::new(StreamOutlet::new(
                stream,
                id,
                Arc::clone(&gate),
                options.subscriber.clone(),
                Arc::clone(&log),
            ));
            slots.push(Slot {
                description,
                source: Mutex::new(input.source),
                outlet,
                queue_bytes: input.queue_bytes,
                stall_after: input.stall_after,
                adjusted: Mutex::default(),
                watch: Mutex::default(),
            });
        }
        let shared = Arc::new(Shared {
            slots,
            gate,
            options,
            log,
            concerns: Mutex::default(),
            recording: Mutex::new(None),
            finishing: Mutex::new(None),
            ending: Mutex::new(()),
            last: Mutex::new(None),
            status: Mutex::default(),
            refreshing: Mutex::new(()),
            quit: AtomicBool::new(false),
        });
        watchdog::refresh(&shared);
        let spawn = |name: &'static str, work: fn(&Shared)| {
            let shared = Arc::clone(&shared);
            let thread = thread::Builder::new().name(name.into()).spawn(move || work(&shared));
            thread.map_err(|source| RecordError::Thread { name, source })
        };
        let threads = vec![spawn("watchdog", watchdog::watch)?, spawn("readings", watchdog::read_devices)?];
        Ok(Self { shared, threads: Mutex::new(threads) })
    }

    /// What the streams are, in the order of the rig.
    pub fn descriptions(&self) -> impl Iterator<Item = &Description> {
        self.shared.slots.iter().map(|slot| &slot.description)
    }

    /// How long a recording goes on that is begun to keep the past.
    #[must_use]
    pub fn after(&self) -> Option<Duration> {
        self.shared.options.after
    }

    /// The file that the rig was read from.
    pub(super) fn rig_file(&self) -> Option<&Path> {
        self.shared.options.rig_file.as_deref()
    }

    /// The device of this name.
    pub(super) fn slot(&self, id: &str) -> Result<&Slot, AdjustError> {
        let slot = self.shared.slots.iter().find(|slot| slot.description.id == id);
        slot.ok_or_else(|| AdjustError::Unknown(id.to_owned()))
    }

    /// Folder of the recordings.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.shared.options.folder
    }

    /// Starts all sources, in order of their [`Description::start_order`].
    ///
    /// # Errors
    /// If a device refuses; those that were started are stopped again.
    pub fn start_sources(&self) -> Result<(), RecordError> {
        for (done, &index) in self.start_order().iter().enumerate() {
            let slot = &self.shared.slots[index];
            {
                let mut watch = lock(&slot.watch);
                watch.started = Some(Instant::now());
                watch.state = StreamState::Waiting;
            }
            let started = lock(&slot.source).start(Arc::clone(&slot.outlet) as _);
            if let Err(source) = started {
                lock(&slot.watch).stop();
                self.stop_in_order(self.start_order().into_iter().take(done).rev());
                let (id, model) = (slot.description.id.clone(), slot.description.model.clone());
                return Err(RecordError::Start { id, model, source });
            }
        }
        Ok(())
    }

    /// Stops all sources, in reverse order.
    pub fn stop_sources(&self) {
        self.stop_in_order(self.start_order().into_iter().rev());
    }

    fn start_order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.shared.slots.len()).collect();
        order.sort_by_key(|&index| self.shared.slots[index].description.start_order);
        order
    }

    fn stop_in_order(&self, order: impl Iterator<Item = usize>) {
        for index in order {
            let slot = &self.shared.slots[index];
            let mut source = lock(&slot.source);
            if let Err(error) = source.stop() {
                self.say(Level::Warning, &slot.description.id, format!("did not stop cleanly: {error}"));
            }
            let mut watch = lock(&slot.watch);
            watch.counters = source.counters();
            watch.stop();
        }
    }

    /// Starts to record into the new file `path`: what is held of the past, and what comes.
    ///
    /// # Errors
    /// If a recording runs, or the file exists or cannot be written.
    pub fn start_recording(&self, path: &Path) -> Result<(), RecordError> {
        self.start_recording_for(path, None)
    }

    /// As [`Recorder::start_recording`]; the recording ends by itself after so long.
    ///
    /// # Errors
    /// As there.
    pub fn start_recording_for(&self, path: &Path, length: Option<Duration>) -> Result<(), RecordError> {
        let shared = &self.shared;
        let mut recording = lock(&shared.recording);
        if let Some(running) = recording.as_ref() {
            return Err(RecordError::Busy(running.path.display().to_string()));
        }
        if let Some(path) = lock(&shared.finishing).as_ref() {
            return Err(RecordError::Busy(path.display().to_string()));
        }
        // As they are now: settings may have been changed.
        let now = |slot: &Slot| lock(&slot.source).description().clone();
        let descriptions: Vec<Description> = shared.slots.iter().map(now).collect();
        let held = shared.gate.held().unwrap_or_default();
        let info = SessionInfo { begin_host_ns: held.first_host_ns, ..shared.options.info.clone() };
        let sink = shared.options.opener.open(path, &info, &descriptions)?;
        for slot in &shared.slots {
            let mut watch = lock(&slot.watch);
            watch.baseline = watch.counters;
            (watch.drops_seen, watch.drop_seen_at) = (0, None);
        }
        let limits = |held: &[usize]| {
            let stream = |(slot, held): (&Slot, &usize)| StreamQueue::new(slot.queue_bytes + held);
            Queue::new(shared.slots.iter().zip(held).map(stream).collect())
        };
        let queue = shared.gate.record(limits);
        let progress = Arc::new(Progress::default());
        let name = "session-writer";
        let flush_every = shared.options.flush_every.min(Duration::from_secs(1));
        let writer = thread::Builder::new().name(name.into()).spawn({
            let (queue, progress) = (Arc::clone(&queue), Arc::clone(&progress));
            move || writer::write(&queue, sink, flush_every, &progress)
        });
        let writer = match writer {
            Ok(writer) => writer,
            Err(source) => {
                shared.gate.rest();
                return Err(RecordError::Thread { name, source });
            }
        };
        let (path, started, meter) = (path.to_path_buf(), Instant::now(), Meter::default());
        let past_s = match (held.first_host_ns, held.last_host_ns) {
            (Some(first), Some(last)) => last.saturating_sub(first) as f64 * 1e-9,
            _ => 0.0,
        };
        let before = if past_s > 0.0 { format!(", with the last {past_s:.2} s") } else { String::new() };
        self.say(Level::Info, "", format!("recording into '{}'{before}", path.display()));
        let ends_at = length.map(|length| started + length);
        *recording = Some(RunningRecording { path, queue, progress, started, past_s, meter, ends_at, writer });
        drop(recording);
        // Who asks next is told so.
        watchdog::refresh(shared);
        Ok(())
    }

    /// Keeps what is held of the past in a new file in the folder of the recordings, called by the rig and the time, and
    /// goes on for `after`, or until it is stopped. Where that was done already and runs, it goes on for so long from now.
    ///
    /// # Errors
    /// As [`Recorder::start_recording`].
    pub fn keep_past(&self, after: Option<Duration>) -> Result<PathBuf, RecordError> {
        if let Some(running) = lock(&self.shared.recording).as_mut() {
            let (Some(ends_at), Some(after)) = (running.ends_at.as_mut(), after) else {
                return Err(RecordError::Busy(running.path.display().to_string()));
            };
            *ends_at = (*ends_at).max(Instant::now() + after);
            return Ok(running.path.clone());
        }
        let path = names::fresh(self.folder(), &self.shared.options.info.rig, SystemTime::now());
        self.start_recording_for(&path, after)?;
        Ok(path)
    }

    /// Ends the recording: what waits is written, the file completed. `reason` says why, for the user.
    ///
    /// # Errors
    /// If none runs (any more: one that is being completed is waited for, see [`Recorder::last`]). A failure of the disk is no error here but in the summary: what was recorded stays.
    pub fn stop_recording(&self, reason: &str) -> Result<Summary, RecordError> {
        self.shared.end(reason).ok_or(RecordError::NotRecording)
    }

    /// The state at this moment (a fifth of a second ago, at most).
    #[must_use]
    pub fn status(&self) -> Arc<Status> {
        Arc::clone(&lock(&self.shared.status))
    }

    /// Whether a recording runs, or is being completed.
    #[must_use]
    pub fn is_recording(&self) -> bool {
        lock(&self.shared.recording).is_some() || lock(&self.shared.finishing).is_some()
    }

    /// How the last recording ended.
    #[must_use]
    pub fn last(&self) -> Option<Summary> {
        lock(&self.shared.last).clone()
    }

    /// Tells the user something.
    pub fn say(&self, level: Level, stream: &str, text: impl Into<String>) {
        lock(&self.shared.log).say(level, stream, text);
    }

    /// Somebody has read the warning of this number: see [`Status::unread`].
    pub fn mark_read(&self, number: u64) {
        lock(&self.shared.log).mark_read(number);
    }

    /// The latest messages, oldest first.
    #[must_use]
    pub fn messages(&self) -> Vec<Message> {
        lock(&self.shared.log).messages()
    }
}

impl Drop for Recorder {
    /// Ends what runs.
    fn drop(&mut self) {
        self.shared.quit.store(true, Relaxed);
        self.stop_sources();
        self.shared.end("the recorder was closed");
        for thread in lock(&self.threads).drain(..) {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

impl Shared {
    /// Ends the recording, if one runs.
    pub fn end(&self, reason: &str) -> Option<Summary> {
        let _alone = lock(&self.ending);
        let recording = {
            let mut running = lock(&self.recording);
            let recording = running.take()?;
            *lock(&self.finishing) = Some(recording.path.clone());
            recording
        };
        self.gate.rest();
        let seconds = recording.past_s + recording.started.elapsed().as_secs_f64();
        let host_ns = host_ns();
        let streams = watchdog::streams(self, Some(&recording.queue));
        recording.queue.note(Item::Status(Arc::new(Status { host_ns, streams, ..Status::clone(&lock(&self.status)) })));
        let incident = Incident::Ended { reason: reason.to_owned() };
        recording.queue.note(Item::Incident { stream: None, host_ns, incident });
        recording.queue.close();
        let failure = match recording.writer.join() {
            Ok(Ok(())) => None,
            Ok(Err(error)) => Some(error.to_string()),
            Err(_) => Some(format!("the writer of '{}' panicked: this is a bug of erfgs", recording.path.display())),
        };
        recording.progress.tell_news(&self.log);
        let mut summary = Summary {
            seconds,
            files: recording.progress.files.load(Relaxed).max(1),
            bytes: recording.progress.bytes.load(Relaxed),
            reason: reason.to_owned(),
            failure,
            streams: watchdog::streams(self, Some(&recording.queue)),
            path: recording.path,
        };
        if summary.failure.is_some() {
            summary.count_what_is_there();
        }
        let text = match &summary.failure {
            Some(failure) => (Level::Error, failure.clone()),
            None => (Level::Info, format!("recorded {seconds:.1} s into '{}': {reason}", summary.path.display())),
        };
        lock(&self.log).say(text.0, "", text.1);
        *lock(&self.last) = Some(summary.clone());
        *lock(&self.finishing) = None;
        watchdog::refresh(self);
        Some(summary)
    }
}

impl RunningRecording {
    pub fn status(&mut self) -> RecordingStatus {
        let bytes = self.progress.bytes.load(Relaxed);
        RecordingStatus {
            path: self.path.clone(),
            seconds: self.past_s + self.started.elapsed().as_secs_f64(),
            bytes,
            files: self.progress.files.load(Relaxed).max(1),
            bytes_per_s: self.meter.rates(Instant::now(), [bytes, 0])[0],
            slowest_write_ms: self.progress.slowest_us.load(Relaxed) as f64 / 1e3,
        }
    }
}

/// Whether `id` can name a stream: in topics, addresses and file names.
#[must_use]
pub fn is_id(id: &str) -> bool {
    (1..=64).contains(&id.len()) && id.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_')
}
