//! What all cameras saw, slice by slice on one clock.

use erfgs_events::EventRows;

use super::{FrameLook, ReadError, TimedFrame, follow::Follow};

/// Which slices.
#[derive(Clone, Debug)]
pub struct SliceOptions {
    /// The length of a slice, nanoseconds.
    pub length_ns: i64,
    /// The streams; `None` for those of all cameras.
    pub streams: Option<Vec<String>>,
    /// The first slice begins with it, and the last ends with it, nanoseconds of session time.
    pub span_ns: [i64; 2],
    /// How frames are decoded.
    pub look: FrameLook,
}

/// What cameras saw in a stretch of time.
#[derive(Debug)]
pub struct Slice {
    /// The stretch, nanoseconds of session time; its end belongs to the next.
    pub span_ns: [i64; 2],
    /// The streams, in the order asked for.
    pub parts: Vec<Part>,
}

/// What one camera saw in a stretch of time.
#[derive(Debug)]
pub struct Part {
    /// The stream.
    pub id: String,
    /// Its events, in the order of their times, microseconds of session time.
    pub events: EventRows,
    /// The frames whose exposures have their middles in the stretch, in their order.
    pub frames: Vec<TimedFrame>,
    /// Whether the stream may have events.
    pub has_events: bool,
    /// Whether the stream may have frames.
    pub has_frames: bool,
}

/// The slices of a recording, one after the other, those without anything included.
pub struct Slices {
    follow: Follow,
    length_ns: i64,
    next_ns: i64,
    end_ns: i64,
    late: u64,
}

impl Slices {
    pub(super) fn new(follow: Follow, options: &SliceOptions) -> Self {
        let [next_ns, end_ns] = options.span_ns;
        Self { follow, length_ns: options.length_ns, next_ns, end_ns, late: 0 }
    }

    /// What was passed over since this was asked last, a message each.
    pub fn take_damage(&mut self) -> Vec<String> {
        let late = std::mem::take(&mut self.late);
        let message =
            format!("{late} events or frames came too late for the slice that they belong to, and were left out");
        self.follow.take_damage().into_iter().chain((late > 0).then_some(message)).collect()
    }

    fn cut(&mut self, span_ns: [i64; 2]) -> Slice {
        let mut late = 0;
        let parts = self.follow.feeds.iter_mut().map(|feed| {
            // Where a slice ends within a microsecond, all events of that microsecond belong to it.
            let [from_us, to_us] = span_ns.map(|t_ns| t_ns.saturating_add(999).div_euclid(1000));
            late += feed.rows.take_before(from_us).len() as u64;
            let events = feed.rows.take_before(to_us);
            let mut frames: Vec<_> = std::iter::from_fn(|| feed.next_frame(span_ns[1])).collect();
            let met = frames.len();
            frames.retain(|frame| frame.exposure.mid_ns >= span_ns[0]);
            late += (met - frames.len()) as u64;
            frames.sort_by_key(|frame| frame.exposure.mid_ns);
            let (has_events, has_frames) = (feed.has_events(), feed.has_frames());
            Part { id: feed.id.clone(), events, frames, has_events, has_frames }
        });
        let parts = parts.collect();
        self.late += late;
        Slice { span_ns, parts }
    }
}

impl Iterator for Slices {
    type Item = Result<Slice, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next_ns >= self.end_ns {
            return None;
        }
        let end = self.next_ns.saturating_add(self.length_ns).min(self.end_ns);
        while !self.follow.has_seen(end) {
            if let Err(error) = self.follow.step() {
                return Some(Err(error));
            }
        }
        let span_ns = [self.next_ns, end];
        self.next_ns = end;
        Some(Ok(self.cut(span_ns)))
    }
}
