//! What goes wrong inside the camera, on demand. What goes wrong on its cable is the business of a [`Plug`](crate::usb::Plug).

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

/// Faults of a camera. Blocks are counted from 0 since the acquisition began, as their ids are; commands since it was powered up.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct U3vFaults {
    /// Packets (block, packet of the payload) that are lost between sensor and bus.
    pub lost_packets: BTreeSet<(u64, u32)>,
    /// Blocks (block, bytes) whose payload ends after so many bytes, and whose trailer says so.
    pub truncated: BTreeSet<(u64, u32)>,
    /// Blocks whose leader is never sent.
    pub without_leader: BTreeSet<u64>,
    /// Blocks whose trailer is never sent.
    pub without_trailer: BTreeSet<u64>,
    /// Blocks of which nothing is sent.
    pub lost_blocks: BTreeSet<u64>,
    /// From this block on nothing is sent until the next acquisition begins; the camera goes on answering.
    pub stuck_from: Option<u64>,
    /// Commands that are never answered.
    pub lost_answers: BTreeSet<u64>,
    /// Commands whose answer the camera puts off first.
    pub late_answers: BTreeSet<u64>,
}
