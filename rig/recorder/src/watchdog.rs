//! The watchdog: a thread that looks at the streams, the writer and the disk several times a second, tells the user
//! what is wrong, and ends a recording before the disk is full.

use std::{
    sync::{Arc, TryLockError, atomic::Ordering::Relaxed},
    thread,
    time::{Duration, Instant},
};

use erfgs_session::source::Incident;

use erfgs_rig::host_time::host_ns;

use super::{
    host,
    queue::{Item, Queue},
    recorder::{Shared, Slot, lock},
    status::{DiskStatus, HeldStatus, Level, Status, StreamState, StreamStatus, blank},
};

/// Between two looks.
const LOOK: Duration = Duration::from_millis(200);
/// Between two status lines in the session file.
const STATUS: Duration = Duration::from_secs(1);
/// Between two readings of a device.
const READ: Duration = Duration::from_secs(2);
/// After this long without drops the next one is told again.
const QUIET: Duration = Duration::from_secs(5);

/// Looks until told to quit.
pub(super) fn watch(shared: &Shared) {
    let mut next_status = Instant::now();
    while !shared.quit.load(Relaxed) {
        refresh(shared);
        let status = Arc::clone(&lock(&shared.status));
        let (mut end, mut ended) = (None, false);
        if let Some(recording) = lock(&shared.recording).as_ref() {
            recording.progress.tell_news(&shared.log);
            if Instant::now() >= next_status {
                next_status = Instant::now() + STATUS;
                recording.queue.note(Item::Status(Arc::clone(&status)));
            }
            if recording.ends_at.is_some_and(|at| Instant::now() >= at) {
                ended = true;
            }
            if lock(&recording.progress.failure).is_some() {
                end = Some("writing the session file failed".to_owned());
            } else if status.disk.free == 0 && status.disk.total > 0 {
                end = Some(format!(
                    "the disk is full but for the reserve of {} MiB: free some space, or record to another disk",
                    shared.options.reserve_bytes >> 20
                ));
            }
        }
        if ended && end.is_none() {
            shared.end("the time after the trigger has passed");
        }
        if let Some(reason) = end {
            shared.end(&reason);
            lock(&shared.log).say(Level::Error, "", format!("the recording ended: {reason}"));
        }
        thread::park_timeout(LOOK);
    }
}

/// Reads the devices' own measurements, one device after the other; a device that hangs delays only this thread.
pub(super) fn read_devices(shared: &Shared) {
    while !shared.quit.load(Relaxed) {
        for slot in &shared.slots {
            let state = lock(&slot.watch).state;
            if !matches!(state, StreamState::Running | StreamState::Waiting) {
                continue;
            }
            let readings = lock(&slot.source).readings();
            lock(&slot.watch).readings = readings.into_iter().collect();
        }
        thread::park_timeout(READ);
    }
}

/// Brings the status up to date.
pub(super) fn refresh(shared: &Shared) {
    let _alone = lock(&shared.refreshing);
    let now = Instant::now();
    for slot in &shared.slots {
        look(shared, slot, now);
    }
    let mut recording = lock(&shared.recording);
    let streams = streams(shared, recording.as_ref().map(|recording| &*recording.queue));
    let arriving: f64 = streams.iter().map(|stream| stream.bytes_per_s).sum();
    let mut status = Status {
        rig: shared.options.info.rig.clone(),
        replay: shared.options.info.replay,
        host_ns: host_ns(),
        recording: recording.as_mut().map(super::recorder::RunningRecording::status),
        held: held(shared),
        finishing: lock(&shared.finishing).clone(),
        last: lock(&shared.last).clone(),
        disk: DiskStatus::default(),
        streams,
        messages: Vec::new(),
        unread: Vec::new(),
    };
    tell_drops(shared, &status.streams, recording.is_some(), now);
    drop(recording);
    if let Ok(space) = host::disk_space(&shared.options.folder) {
        let free = space.free.saturating_sub(shared.options.reserve_bytes);
        let seconds_left = (arriving >= 1.0).then(|| free as f64 / arriving);
        status.disk = DiskStatus { free, total: space.total, seconds_left };
    }
    if !status.replay {
        warn(shared, &status);
    }
    let log = lock(&shared.log);
    (status.messages, status.unread) = (log.messages(), log.unread());
    drop(log);
    *lock(&shared.status) = Arc::new(status);
}

/// Looks at one stream: its state, and what its driver counts.
fn look(shared: &Shared, slot: &Slot, now: Instant) {
    // A device that is being started, read or stopped is asked the next time.
    let counters = match slot.source.try_lock() {
        Ok(source) => Some(source.counters()),
        Err(TryLockError::Poisoned(source)) => Some(source.into_inner().counters()),
        Err(TryLockError::WouldBlock) => None,
    };
    let mut watch = lock(&slot.watch);
    if let Some(counters) = counters {
        watch.counters = counters;
    }
    let Some(started) = watch.started else { return };
    let last_ns = slot.outlet.last_ns.load(Relaxed);
    let silent = match last_ns {
        0 => now.saturating_duration_since(started),
        _ => Duration::from_nanos(u64::try_from(host_ns() - last_ns).unwrap_or(0))
            .min(now.saturating_duration_since(started)),
    };
    let before = watch.state;
    watch.state = if slot.outlet.lost.load(Relaxed) {
        StreamState::Lost
    } else if slot.stall_after.is_some_and(|limit| silent > limit) {
        StreamState::Stalled
    } else if last_ns == 0 {
        StreamState::Waiting
    } else {
        StreamState::Running
    };
    let after = watch.state;
    drop(watch);
    let id = &slot.description.id;
    match (before, after) {
        (StreamState::Stalled, StreamState::Running) => {
            lock(&shared.log).say(Level::Info, id, "data come again");
        }
        (StreamState::Stalled, _) | (_, StreamState::Stopped | StreamState::Waiting | StreamState::Running) => {}
        (_, StreamState::Stalled) => {
            let message = format!(
                "no data for {:.1} s: check the cable, the lens cap and the trigger; unplug and replug the device if \
                 it does not come back",
                silent.as_secs_f64()
            );
            lock(&shared.log).say(Level::Warning, id, message.as_str());
            slot.outlet.note(Incident::Warning { message });
        }
        (_, StreamState::Lost) => {}
    }
}

/// The streams as they are now.
pub(super) fn streams(shared: &Shared, queue: Option<&Queue>) -> Vec<StreamStatus> {
    let now = Instant::now();
    let stream = |(index, slot): (usize, &Slot)| {
        let mut status = blank(&slot.description);
        let mut watch = lock(&slot.watch);
        let totals = [slot.outlet.arrived.packets(), slot.outlet.arrived.bytes()];
        [status.packets_per_s, status.bytes_per_s] = watch.meter.rates(now, totals);
        status.state = watch.state;
        status.counters = watch.counters;
        status.readings = watch.readings.clone();
        status.queue_bytes = slot.queue_bytes as u64;
        let driver = watch.counters.lost;
        drop(watch);
        status.drops.driver = driver;
        if let Some(share) = queue.and_then(|queue| queue.streams.get(index)) {
            let baseline = lock(&slot.watch).baseline.lost;
            status.drops = share.drops(driver.saturating_sub(baseline));
            let (waiting, peak) = share.waiting();
            (status.waiting_bytes, status.peak_waiting_bytes) = (waiting as u64, peak as u64);
            (status.written, status.written_bytes) = (share.written.packets(), share.written.bytes());
        }
        if let Some(subscriber) = &shared.options.subscriber {
            subscriber.annotate(index, &mut status);
        }
        status
    };
    shared.slots.iter().enumerate().map(stream).collect()
}

/// What is held of the past.
fn held(shared: &Shared) -> Option<HeldStatus> {
    let (before, held) = (shared.options.before?, shared.gate.held()?);
    let span_ns = held.last_host_ns.unwrap_or(0).saturating_sub(held.first_host_ns.unwrap_or(0));
    Some(HeldStatus {
        seconds: span_ns as f64 * 1e-9,
        of_seconds: before.span.as_secs_f64(),
        bytes: held.bytes,
        of_bytes: before.bytes,
    })
}

/// Tells the user of a disk that runs full and of clocks that cannot be trusted, when that begins.
fn warn(shared: &Shared, status: &Status) {
    for (stream, text) in lock(&shared.concerns).of(status) {
        if let Some(slot) = shared.slots.iter().find(|slot| slot.description.id == stream) {
            slot.outlet.note(Incident::Warning { message: text.clone() });
        }
        lock(&shared.log).say(Level::Warning, &stream, text);
    }
}

/// Tells the user of drops when they begin.
fn tell_drops(shared: &Shared, streams: &[StreamStatus], recording: bool, now: Instant) {
    for (slot, stream) in shared.slots.iter().zip(streams) {
        let mut watch = lock(&slot.watch);
        let total = stream.drops.total();
        if total <= watch.drops_seen {
            watch.drops_seen = total;
            continue;
        }
        let begins = watch.drop_seen_at.is_none_or(|at| now.saturating_duration_since(at) >= QUIET);
        let old = std::mem::replace(&mut watch.drops_seen, total);
        watch.drop_seen_at = Some(now);
        drop(watch);
        if !begins || !recording {
            continue;
        }
        let drops = stream.drops;
        let text = if drops.writer > 0 {
            format!("{} packets were not written: the session file takes no more", drops.writer)
        } else if drops.queue > 0 {
            format!(
                "{} packets dropped: the disk is slower than the data and the queue of {} MiB is full. Record to a \
                 faster disk, lower the data rate, or raise queue_mib",
                drops.queue,
                stream.queue_bytes >> 20
            )
        } else {
            format!(
                "{} packets lost before they reached the program: spread the cameras over more USB controllers, or \
                 lower their rates",
                total - old
            )
        };
        lock(&shared.log).say(Level::Error, &slot.description.id, text.as_str());
        slot.outlet.note(Incident::Warning { message: text });
    }
}
