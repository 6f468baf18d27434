//! From transfers to packets: numbering, counting, marking gaps.

use std::sync::{
    Arc,
    atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    mpsc,
};

use bytes::Bytes;
use erfgs_session::source::{Counters, Outlet, Packet};

use crate::usb::{Arrival, Fault, Receiver};

/// What wakes the supervisor of a source.
#[derive(Debug)]
pub(super) enum Signal {
    /// The stream broke.
    Ended(Fault),
    /// The source is to stop.
    Stop,
}

/// The path of one source's data, across streams that break and come back.
#[derive(Default)]
pub(super) struct Feed {
    sequence: AtomicU64,
    /// The next packet does not follow the one before.
    gap: AtomicBool,
    packets: AtomicU64,
    bytes: AtomicU64,
    refused: AtomicU64,
    errors: AtomicU64,
    reconnections: AtomicU64,
    lost: AtomicU64,
}

impl Feed {
    /// Starts counting anew.
    pub(super) fn reset(&self) {
        for counter in
            [&self.sequence, &self.packets, &self.bytes, &self.refused, &self.errors, &self.reconnections, &self.lost]
        {
            counter.store(0, Relaxed);
        }
        self.gap.store(false, Relaxed);
    }

    /// What follows is not continuous with what was.
    pub(super) fn mark_gap(&self) {
        self.gap.store(true, Relaxed);
    }

    /// Notes that a stream broke.
    pub(super) fn broke(&self) {
        self.mark_gap();
        self.errors.fetch_add(1, Relaxed);
    }

    /// Notes that the camera was lost and is back.
    pub(super) fn reconnected(&self) {
        self.reconnections.fetch_add(1, Relaxed);
    }

    /// Packets so far.
    pub(super) fn packets(&self) -> u64 {
        self.packets.load(Relaxed)
    }

    /// Totals; `lost` is what the device itself counted, where it is known now.
    pub(super) fn counters(&self, lost: Option<u64>) -> Counters {
        if let Some(lost) = lost {
            self.lost.store(lost, Relaxed);
        }
        Counters {
            packets: self.packets.load(Relaxed),
            bytes: self.bytes.load(Relaxed),
            lost: self.lost.load(Relaxed),
            refused: self.refused.load(Relaxed),
            errors: self.errors.load(Relaxed),
            reconnections: self.reconnections.load(Relaxed),
        }
    }

    /// A receiver that makes packets of what arrives.
    pub(super) fn receiver(self: &Arc<Self>, outlet: Arc<dyn Outlet>, signals: mpsc::Sender<Signal>) -> Receiver {
        let feed = Arc::clone(self);
        Box::new(move |arrival| match arrival {
            Arrival::Data { host_ns, bytes } => {
                feed.packets.fetch_add(1, Relaxed);
                feed.bytes.fetch_add(bytes.len() as u64, Relaxed);
                let packet = Packet {
                    sequence: feed.sequence.fetch_add(1, Relaxed),
                    host_ns,
                    discontinuity: feed.gap.swap(false, Relaxed),
                    damaged: false,
                    stamp: None,
                    payload: Bytes::copy_from_slice(bytes),
                };
                if !outlet.send(packet) {
                    feed.refused.fetch_add(1, Relaxed);
                    feed.gap.store(true, Relaxed);
                }
            }
            // Nobody listens only when the source has stopped.
            Arrival::Ended(fault) => {
                let _ = signals.send(Signal::Ended(fault));
            }
        })
    }
}
