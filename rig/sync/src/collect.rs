//! From a session file to the synchronisation of its streams.

use std::io::{Read, Seek};

use erfgs_events::{Decoder, StreamDecoder};
use erfgs_session::{
    container::{ContainerError, Entry, Session, hand_over},
    source::{Description, Encoding, FrameStamp, Packet, StampClock},
};

use super::{
    board::BoardLines,
    camera_clock::{Stamped, settle},
    events::Stretches,
    frames::Arrived,
    lamp::brightness,
    report::{Synchronisation, VERSION},
    streams,
};

/// What to look for in a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SyncOptions {
    /// Look for the flashes of a lamp that event cameras and free-running cameras saw, which gives the lags of the
    /// latter (tier C). Every frame of those is decoded for it.
    pub flash: bool,
}

/// What is gathered of an event camera.
pub(super) struct Events {
    /// `None` if erfgs cannot decode the stream.
    pub decoder: Option<StreamDecoder>,
    pub stretches: Stretches,
    /// Packets so far.
    packets: u64,
}

/// What is gathered of a frame camera.
#[derive(Default)]
pub(super) struct Frames {
    pub arrived: Vec<Arrived>,
    /// Stamps of the camera's own clock, where frames have them.
    camera: Vec<Option<Stamped>>,
    /// The frames as they were exposed, counted: what the kernel counted as lost leaves a gap.
    pub counts: Vec<u64>,
    /// The packet before and the kernel's count of it.
    before: Option<(u64, Option<u32>)>,
    /// The mean level of each frame, if a lamp is looked for.
    pub brightness: Option<Vec<Option<f64>>>,
}

impl Frames {
    /// Puts the camera's own times in the place of arrivals, as far as its clock can be had.
    fn settle(&mut self) {
        for (frame, time) in self.arrived.iter_mut().zip(settle(&self.camera)) {
            frame.stamp_ns = time.unwrap_or(frame.stamp_ns);
        }
    }

    fn count(&mut self, packet: &Packet) {
        let kernel = packet.stamp.map(|stamp| stamp.sequence);
        let step = self.before.map_or(0, |(sequence, before)| {
            let packets = packet.sequence.saturating_sub(sequence).max(1);
            // A driver that counts backwards has started anew.
            let counted = kernel.zip(before).map(|(now, before)| now.wrapping_sub(before));
            counted.filter(|&n| n > 0 && n < u32::MAX / 2 && !packet.discontinuity).map_or(packets, u64::from)
        });
        self.before = Some((packet.sequence, kernel));
        self.counts.push(self.counts.last().map_or(0, |last| last.saturating_add(step)));
    }
}

pub(super) enum Gathered {
    Events(Box<Events>),
    Frames(Frames),
    Board(BoardLines),
}

/// Reads a session through and fits all its clocks. `progress` is called with the bytes of payload read so far.
///
/// # Errors
/// If the session cannot be read. Damaged places are passed over; the session's summary tells them.
pub fn synchronise<R: Read + Seek>(
    session: &mut Session<R>,
    options: SyncOptions,
    mut progress: impl FnMut(u64),
) -> Result<Synchronisation, ContainerError> {
    let gathered = gather_all(session, options, &mut progress)?;
    let name = session.path().file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let streams = &session.summary().streams;
    Ok(Synchronisation { version: VERSION, session: name, streams: streams::fit_all(streams, gathered) })
}

/// Reads a session through, and gathers what its clocks can be fitted to: for each stream, in their order.
pub(super) fn gather_all<R: Read + Seek>(
    session: &mut Session<R>,
    options: SyncOptions,
    progress: &mut impl FnMut(u64),
) -> Result<Vec<Gathered>, ContainerError> {
    let streams = session.summary().streams.clone();
    let start_ns = session.summary().start.host_ns;
    let mut gathered = Vec::new();
    for (index, stream) in streams.iter().enumerate() {
        let decoder = session.decoder_from(index, None)?.map(|begun| begun.decoder);
        gathered.push(gather(&stream.description, decoder, options));
    }
    let mut bytes = 0;
    for entry in session.messages(None) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Err(error @ (ContainerError::Read { .. } | ContainerError::Compression { .. })) => return Err(error),
            Ok(_) | Err(_) => continue,
        };
        bytes += packet.payload.len() as u64;
        if let (Some(gathered), Some(stream)) = (gathered.get_mut(stream), streams.get(stream)) {
            gathered.take(&stream.description, &packet, start_ns);
        }
        progress(bytes);
    }
    for gathered in &mut gathered {
        if let Gathered::Frames(frames) = gathered {
            frames.settle();
        }
    }
    Ok(gathered)
}

fn gather(description: &Description, decoder: Option<StreamDecoder>, options: SyncOptions) -> Gathered {
    match description.encoding {
        Encoding::TriggerLines => Gathered::Board(BoardLines::default()),
        encoding if encoding.is_events() => {
            Gathered::Events(Box::new(Events { decoder, stretches: Stretches::new(options.flash), packets: 0 }))
        }
        _ => {
            let looks = options.flash && !description.is_triggered();
            Gathered::Frames(Frames { brightness: looks.then(Vec::new), ..Frames::default() })
        }
    }
}

impl Gathered {
    fn take(&mut self, description: &Description, packet: &Packet, start_ns: i64) {
        let arrival_ns = packet.host_ns.saturating_sub(start_ns);
        match self {
            Self::Board(lines) => lines.take(packet, start_ns),
            Self::Frames(frames) => {
                let stamp = packet.stamp.filter(|stamp| stamp.clock == StampClock::Monotonic);
                let stamp_ns = stamp.map_or(arrival_ns, |stamp| stamp.kernel_ns.saturating_sub(start_ns));
                let camera = packet.stamp.filter(|stamp| stamp.clock == StampClock::Camera);
                let stamped =
                    |stamp: FrameStamp| Stamped { camera_ns: stamp.kernel_ns, arrival_ns, anew: packet.discontinuity };
                frames.camera.push(camera.map(stamped));
                frames.count(packet);
                frames.arrived.push(Arrived { sequence: packet.sequence, stamp_ns });
                if let Some(levels) = &mut frames.brightness {
                    levels.push(brightness(description, &packet.payload));
                }
            }
            Self::Events(events) => {
                let Some(decoder) = &mut events.decoder else { return };
                // As `Session::decode_events` does it: the ticks must be the same.
                hand_over(decoder, packet, events.packets > 0);
                events.packets += 1;
                events.stretches.begin(packet.sequence, arrival_ns);
                decoder.decode(&packet.payload, &mut events.stretches);
                events.stretches.end();
            }
        }
    }
}
