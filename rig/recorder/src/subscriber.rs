//! Who looks at packets as they pass.

use erfgs_session::source::Packet;

use super::status::StreamStatus;

/// Someone who looks at packets as they pass: previews, event rates, clocks. Is called by the threads that deliver, and
/// must return at once.
pub trait Subscriber: Send + Sync {
    /// A packet of stream `stream` passes.
    fn packet(&self, stream: usize, packet: &Packet);

    /// Completes the status of stream `stream` with what was seen.
    fn annotate(&self, stream: usize, status: &mut StreamStatus);
}
