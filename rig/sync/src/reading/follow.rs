//! Reads a recording once, from a place on, for several of its streams.

use erfgs_session::{
    Recording,
    container::{ContainerError, Entry},
};

use super::{ReadError, arrived_after, feed::Feed};

type Messages = Box<dyn Iterator<Item = Result<Entry, ContainerError>> + Send>;

/// A recording that is being read.
pub(super) struct Follow {
    messages: Messages,
    start_ns: i64,
    /// The streams that are wanted, in the order asked for.
    pub feeds: Vec<Feed>,
    /// The latest arrival, session nanoseconds.
    arrived_ns: i64,
    over: bool,
    damage: Vec<String>,
}

impl Follow {
    pub fn start(recording: Recording, mut feeds: Vec<Feed>, span_ns: [i64; 2]) -> Self {
        if let Recording::Session(session) = &recording {
            let streams = &session.summary().streams;
            feeds.iter_mut().for_each(|feed| feed.ends_as(&streams[feed.stream].totals));
        }
        let start_ns = recording.summary().start.host_ns;
        let from: Option<Vec<i64>> = feeds.iter().map(|feed| feed.first_host_ns(start_ns)).collect();
        let from = from.map(|from| from.into_iter().min().unwrap_or(i64::MAX));
        let over = span_ns[0] >= span_ns[1] || from == Some(i64::MAX);
        let messages = recording.into_messages(from);
        Self { messages, start_ns, feeds, arrived_ns: i64::MIN, over, damage: Vec::new() }
    }

    /// Reads one message.
    pub fn step(&mut self) -> Result<(), ReadError> {
        match self.messages.next() {
            None => {
                self.feeds.iter_mut().for_each(Feed::finish);
                self.over = true;
            }
            Some(Ok(Entry::Packet { stream, packet })) => {
                self.arrived_ns = self.arrived_ns.max(packet.host_ns.saturating_sub(self.start_ns));
                for feed in self.feeds.iter_mut().filter(|feed| feed.stream == stream) {
                    feed.take(&packet);
                }
            }
            Some(Ok(_)) => {}
            Some(Err(error @ ContainerError::Damaged { .. })) => self.damage.push(error.to_string()),
            Some(Err(error)) => {
                self.over = true;
                return Err(error.into());
            }
        }
        Ok(())
    }

    /// Whether all that was seen before a session time was met.
    pub fn has_seen(&self, t_ns: i64) -> bool {
        self.over || self.arrived_ns > arrived_after(t_ns) || self.feeds.iter().all(|feed| feed.has_seen(t_ns))
    }

    /// What was passed over since this was asked last.
    pub fn take_damage(&mut self) -> Vec<String> {
        let of_feeds: Vec<String> = self.feeds.iter_mut().flat_map(Feed::take_damage).collect();
        self.damage.drain(..).chain(of_feeds).collect()
    }
}
