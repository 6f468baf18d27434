//! The frames of one stream, one by one.

use super::{ReadError, TimedFrame, follow::Follow};

/// The frames of a stream within a span, in the order of the recording.
pub struct Frames {
    follow: Follow,
    end_ns: i64,
}

impl Frames {
    pub(super) fn new(follow: Follow, end_ns: i64) -> Self {
        Self { follow, end_ns }
    }

    /// What was passed over since this was asked last, a message each.
    pub fn take_damage(&mut self) -> Vec<String> {
        self.follow.take_damage()
    }
}

impl Iterator for Frames {
    type Item = Result<TimedFrame, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let feed = self.follow.feeds.first_mut()?;
            if let Some(frame) = feed.next_frame(i64::MAX) {
                return Some(Ok(frame));
            }
            if self.follow.has_seen(self.end_ns) {
                return None;
            }
            if let Err(error) = self.follow.step() {
                return Some(Err(error));
            }
        }
    }
}
