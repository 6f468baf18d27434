//! The packets of a file, made in a thread that waits for whoever takes them: formats whose libraries hand over whole files
//! are never held whole as packets.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use bytes::Bytes;

use super::{cut, pack, source::EventSource};
use crate::container::ContainerError;
use crate::source::Packet;
use erfgs_events::EventEncoding;
use erfgs_events::EventFormat;

/// Packets that wait.
const WAITING: usize = 16;
/// A packet is over after so much time, nanoseconds of host time,
pub(super) const PACKET_NS: i64 = 5_000_000;
/// or so many bytes.
pub(super) const PACKET_BYTES: usize = 64 << 10;

/// Packets, or the error that ends them.
pub(super) struct Packets(Receiver<Result<Packet, ContainerError>>);

/// Where packets go.
pub(super) struct Out {
    sender: SyncSender<Result<Packet, ContainerError>>,
    sequence: u64,
    /// Whether anybody still takes packets.
    wanted: bool,
}

impl Packets {
    /// Starts at the beginning of the file.
    pub fn start(source: EventSource, encoding: EventEncoding, first_us: u64) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let mut out = Out { sender: sender.clone(), sequence: 0, wanted: true };
        let thread = std::thread::Builder::new().name("erfgs-event-file".into()).spawn(move || {
            let done = match &source {
                EventSource::Stream(file) if matches!(file.format, EventFormat::Raw(_)) => {
                    cut::cut(file, first_us, &mut out)
                }
                _ => pack::pack(&source, encoding, first_us, &mut out),
            };
            if let Err(error) = done {
                let _ = out.sender.send(Err(error));
            }
        });
        if let Err(source) = thread {
            let _ = sender.try_send(Err(ContainerError::Thread { source }));
        }
        Self(receiver)
    }
}

impl Iterator for Packets {
    type Item = Result<Packet, ContainerError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.recv().ok()
    }
}

impl Out {
    /// Sends the next packet.
    pub fn send(&mut self, host_ns: i64, payload: Vec<u8>) {
        let packet = Packet {
            sequence: self.sequence,
            host_ns,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: Bytes::from(payload),
        };
        self.sequence += 1;
        self.wanted = self.wanted && self.sender.send(Ok(packet)).is_ok();
    }

    /// Whether to go on.
    pub fn is_wanted(&self) -> bool {
        self.wanted
    }
}
