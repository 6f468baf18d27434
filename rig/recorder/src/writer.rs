//! The writer thread: takes what waits and puts it into the session, flushing often enough that a killed process
//! loses less than a second.

use std::{
    collections::VecDeque,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU32, AtomicU64, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use super::{
    log::Log,
    queue::{Item, Queue},
    sink::{SessionSink, SinkError},
    status::Level,
};

/// What the writer tells while it works.
#[derive(Default)]
pub(super) struct Progress {
    /// Bytes of the session.
    pub bytes: AtomicU64,
    /// Files that it is in.
    pub files: AtomicU32,
    /// What the user should know of them.
    pub news: Mutex<Vec<(Level, String)>>,
    /// Longest that a write or flush took, microseconds.
    pub slowest_us: AtomicU64,
    /// Why it writes no more.
    pub failure: Mutex<Option<String>>,
}

impl Progress {
    /// Tells the user the news.
    pub fn tell_news(&self, log: &Mutex<Log>) {
        let news = std::mem::take(&mut *self.news.lock().unwrap_or_else(PoisonError::into_inner));
        for (level, text) in news {
            log.lock().unwrap_or_else(PoisonError::into_inner).say(level, "", text);
        }
    }
}

/// Writes until the queue is closed and empty, then completes the file. After the first error nothing is written, and
/// what arrives is counted as dropped by the writer.
pub(super) fn write(
    queue: &Queue,
    mut sink: Box<dyn SessionSink>,
    flush_every: Duration,
    progress: &Progress,
) -> Result<(), SinkError> {
    let mut batch = VecDeque::new();
    let mut failed: Option<SinkError> = None;
    let mut next_flush = Instant::now() + flush_every;
    let mut dirty = false;
    let fail = |failed: &mut Option<SinkError>, error: SinkError| {
        *progress.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
        *failed = Some(error);
    };
    loop {
        let open = queue.take(&mut batch, next_flush);
        while let Some(item) = batch.pop_front() {
            let begun = Instant::now();
            let done = if failed.is_some() { None } else { Some(put(sink.as_mut(), &item)) };
            if let Item::Packet { stream, packet } = &item
                && let Some(share) = queue.streams.get(*stream)
            {
                let count = if let Some(Ok(())) = done { &share.written } else { &share.unwritten };
                count.add(packet.payload.len());
                share.release(packet.payload.len());
            }
            dirty = true;
            if let Some(Err(error)) = done {
                fail(&mut failed, error);
            }
            // Within a long batch flushes must not wait for its end.
            if failed.is_none() && Instant::now() >= next_flush {
                if let Err(error) = sink.flush() {
                    fail(&mut failed, error);
                }
                next_flush = Instant::now() + flush_every;
                dirty = false;
            }
            progress.bytes.store(sink.bytes_written(), Relaxed);
            progress.files.store(sink.files(), Relaxed);
            progress.news.lock().unwrap_or_else(PoisonError::into_inner).append(&mut sink.news());
            progress.slowest_us.fetch_max(begun.elapsed().as_micros() as u64, Relaxed);
        }
        if Instant::now() >= next_flush {
            if dirty && failed.is_none() {
                if let Err(error) = sink.flush() {
                    fail(&mut failed, error);
                }
                dirty = false;
            }
            next_flush = Instant::now() + flush_every;
        }
        if !open {
            break;
        }
    }
    match failed {
        Some(error) => Err(error),
        None => sink.finish().map(|bytes| progress.bytes.store(bytes, Relaxed)).inspect_err(|error| {
            *progress.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
        }),
    }
}

fn put(sink: &mut dyn SessionSink, item: &Item) -> Result<(), SinkError> {
    match item {
        Item::Packet { stream, packet } => sink.packet(*stream, packet),
        Item::Incident { stream, host_ns, incident } => sink.incident(*stream, *host_ns, incident),
        Item::Status(status) => sink.status(status),
    }
}
