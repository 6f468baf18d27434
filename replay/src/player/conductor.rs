//! The thread that reads a recording and sends every packet when its time has come.

use std::time::{Duration, Instant};

use erfgs_session::{
    container::{ContainerError, Entry, Recording},
    source::{Packet, StampClock},
};

use super::control::{Shared, Speed, Step};

/// The longest sleep, after which orders are looked at again in any case.
const NAP: Duration = Duration::from_millis(100);
/// How long to wait before a packet is offered again.
const RETRY: Duration = Duration::from_micros(200);
/// Between the end of a round and the start of the next.
const GAP_NS: i64 = 10_000_000;
/// A jump of a paused playback begins so much earlier, so that whoever looks has pictures of where it stands.
const BEFORE_NS: i64 = 200_000_000;

/// Recorded time against real time.
struct Pace {
    speed: Speed,
    /// A moment and the recorded time at it.
    anchor: Option<(Instant, i64)>,
}

impl Pace {
    /// How long until a recorded time is due.
    fn until(&mut self, speed: Speed, recorded_ns: i64) -> Option<Duration> {
        let Speed::Times(times) = speed else { return None };
        if self.speed != speed {
            (self.speed, self.anchor) = (speed, None);
        }
        let &mut (anchor, anchor_ns) = self.anchor.get_or_insert((Instant::now(), recorded_ns));
        let seconds = recorded_ns.saturating_sub(anchor_ns).max(0) as f64 * 1e-9 / times.max(1e-6);
        let due = anchor.checked_add(Duration::try_from_secs_f64(seconds).ok()?)?;
        due.checked_duration_since(Instant::now())
    }
}

/// What is carried from one round to the next.
struct Streams {
    /// What is added to recorded host times.
    shift_ns: i64,
    /// The last host time that was sent.
    last_ns: i64,
    /// For each stream: what is added to sequence numbers, the next number to send, and whether its next packet comes
    /// after a jump.
    streams: Vec<(u64, u64, bool)>,
}

enum Ended {
    Stopped,
    Jump,
    End,
    /// There was nothing to play.
    Nothing,
}

/// Plays until the end, or until all sources are stopped.
pub(super) fn conduct(mut recording: Recording, shared: &Shared) {
    let count = recording.summary().streams.len();
    let now = now_ns();
    let mut streams = Streams { shift_ns: 0, last_ns: now - GAP_NS, streams: vec![(0, 0, false); count] };
    let mut jumps = shared.orders().jumps;
    let mut from_ns = shared.orders().options.seek_ns;
    let mut first = true;
    shared.set_finished(false);
    loop {
        match round(&mut recording, shared, &mut streams, jumps, from_ns, first) {
            Ok(Ended::Stopped) => return,
            Ok(Ended::Jump) => {}
            Ok(Ended::End) if shared.orders().options.repeat => from_ns = shared.orders().options.seek_ns,
            Ok(Ended::End | Ended::Nothing) => {
                shared.set_finished(true);
                while shared.orders().jumps == jumps {
                    if shared.all_stopped() {
                        return;
                    }
                    shared.wait(NAP);
                }
                shared.set_finished(false);
            }
            Err(error) => {
                shared.fail(error.to_string());
                shared.set_finished(true);
                return;
            }
        }
        let orders = shared.orders();
        if orders.jumps != jumps {
            let before_ns = if orders.paused { BEFORE_NS } else { 0 };
            (jumps, from_ns) = (orders.jumps, orders.target_ns.saturating_sub(before_ns));
        }
        first = false;
    }
}

/// Plays from a session time to the end.
fn round(
    recording: &mut Recording,
    shared: &Shared,
    streams: &mut Streams,
    jumps: u64,
    from_ns: i64,
    first: bool,
) -> Result<Ended, ContainerError> {
    shared.forget_damage();
    let summary = recording.summary();
    let start_ns = summary.start.host_ns;
    let seek = from_ns > 0;
    let from = seek.then(|| start_ns.saturating_add(from_ns));
    let ids: Vec<String> = summary.streams.iter().map(|stream| stream.description.id.clone()).collect();
    for (shift, next, jumped) in &mut streams.streams {
        (*shift, *jumped) = (*next, seek || !first);
    }
    let mut pace = Pace { speed: shared.orders().options.speed, anchor: None };
    let mut begun = false;
    let mut first_sequences: Vec<Option<u64>> = vec![None; ids.len()];
    for entry in recording.messages(from) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Ok(Entry::Status(status)) => {
                shared.note_status(status);
                continue;
            }
            Ok(Entry::Incident(entry)) => {
                if let Some(stream) = ids.iter().position(|id| *id == entry.stream) {
                    shared.report(stream, entry.incident);
                }
                continue;
            }
            Ok(_) => continue,
            Err(error @ ContainerError::Damaged { .. }) => {
                shared.pass_over(error.to_string());
                continue;
            }
            Err(error) => return Err(error),
        };
        if stream >= ids.len() {
            continue;
        }
        if !begun {
            streams.shift_ns = streams.last_ns.saturating_add(GAP_NS).saturating_sub(packet.host_ns);
            begun = true;
        }
        let recorded_ns = packet.host_ns;
        let base = *first_sequences[stream].get_or_insert(if seek || !first { packet.sequence } else { 0 });
        let packet = streams.moved(stream, packet, base);
        loop {
            let orders = shared.orders();
            if shared.all_stopped() {
                return Ok(Ended::Stopped);
            }
            if orders.jumps != jumps {
                return Ok(Ended::Jump);
            }
            let speed = if orders.paused {
                pace.anchor = None;
                match orders.step {
                    Step::Nothing => {
                        shared.wait(NAP);
                        continue;
                    }
                    Step::UpTo(to_ns) if recorded_ns > start_ns.saturating_add(to_ns) => {
                        shared.stand_at(start_ns.saturating_add(to_ns));
                        shared.wait(NAP);
                        continue;
                    }
                    Step::UpTo(_) | Step::Packet(_) => {}
                }
                Speed::Max
            } else {
                orders.options.speed
            };
            if let Some(wait) = pace.until(speed, recorded_ns) {
                shared.wait(wait.min(NAP));
                continue;
            }
            if shared.send(stream, &packet, recorded_ns) {
                shared.stepped(Step::Packet(stream));
                break;
            }
            if speed != Speed::Max {
                shared.refused(stream);
                break;
            }
            shared.wait(RETRY);
        }
    }
    // A step ends with the recording.
    shared.stepped(shared.orders().step);
    Ok(if begun { Ended::End } else { Ended::Nothing })
}

impl Streams {
    /// The packet as it is sent: in the time of the playback, numbered on from the packets before.
    fn moved(&mut self, stream: usize, packet: Packet, base: u64) -> Packet {
        let (shift, next, jumped) = &mut self.streams[stream];
        let sequence = shift.saturating_add(packet.sequence.saturating_sub(base));
        *next = sequence.saturating_add(1);
        let discontinuity = packet.discontinuity || std::mem::take(jumped);
        let host_ns = packet.host_ns.saturating_add(self.shift_ns);
        self.last_ns = self.last_ns.max(host_ns);
        let stamp = packet.stamp.map(|mut stamp| {
            if stamp.clock == StampClock::Monotonic {
                stamp.kernel_ns = stamp.kernel_ns.saturating_add(self.shift_ns);
            }
            stamp
        });
        Packet { sequence, host_ns, discontinuity, stamp, ..packet }
    }
}

/// The host's monotonic clock, nanoseconds.
#[cfg(unix)]
pub(super) fn now_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec)
}

/// A monotonic clock, nanoseconds.
#[cfg(not(unix))]
pub(super) fn now_ns() -> i64 {
    use std::sync::LazyLock;
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    i64::try_from(START.elapsed().as_nanos()).unwrap_or(i64::MAX)
}
