//! A recording as a bag of ROS 2: a folder with `metadata.yaml` and an MCAP file of messages.
//!
//! Messages come in the order of the recording, and their log time is the arrival of what they hold. Their stamp is the time on the
//! session's clock: of events that of the first in a packet, of frames the middle of the exposure.

mod definitions;
mod events;
mod messages;
mod metadata;
mod names;
mod pixels;

use std::{
    collections::{BTreeMap, HashMap},
    io::Write,
    path::Path,
};

use erfgs_base::atomic;
use erfgs_scene::{
    pixel::{self, FrameFormat, PixelFormat},
    rig_file::RigFile,
};
use erfgs_session::{
    clock::Exposure,
    container::{ContainerError, Entry, SessionStart},
    export::sensor_samples,
    source::{Description, LATE_NS, Packet},
};
use erfgs_sync::reading::TimedRecording;

use self::{
    events::{Held, Reading},
    messages::Head,
    names::RosNames,
    pixels::RosPixels,
};
use crate::{
    BridgeError, Written,
    log::{FinishedLog, Log, Schema},
    rig::Placed,
};

/// The topic of poses that do not change.
const TRANSFORMS: &str = "/tf_static";

/// What is written.
#[derive(Clone, Debug, Default)]
pub struct Rosbag2Choice<'a> {
    /// The streams; `None` for those of all cameras.
    pub streams: Option<Vec<String>>,
    /// What arrived within these session times, nanoseconds, the last one included; `None` for all.
    pub span_ns: Option<[i64; 2]>,
    /// Where the cameras stand, and their lenses.
    pub rig: Option<&'a RigFile>,
    /// How many bits of samples of 16 count (AEDAT 4), where that is said.
    pub bits: Option<u8>,
}

/// Writes a recording to the folder `out`, which must be new or empty, and appears whole or not at all. `progress` is called with the
/// nanoseconds of the recording that are done, and all of them.
///
/// # Errors
/// If the recording cannot be read or has nothing to write, the rig file is of others, events do not fit, or the folder cannot be
/// written.
pub fn write(
    recording: &mut TimedRecording,
    choice: &Rosbag2Choice<'_>,
    out: &Path,
    mut progress: impl FnMut(u64, u64),
) -> Result<Written, BridgeError> {
    let descriptions = crate::described(recording, choice.streams.as_deref())?;
    let rig = Placed::find(choice.rig, &descriptions.iter().collect::<Vec<_>>())?;
    let folder = atomic::NewFolder::begin(out).map_err(|source| match source.kind() {
        std::io::ErrorKind::AlreadyExists => BridgeError::Exists { path: out.to_owned() },
        _ => BridgeError::writing(out)(source),
    })?;
    let file = format!("{}_0.mcap", out.file_name().unwrap_or("bag".as_ref()).to_string_lossy());
    let named = out.join(&file);
    let (log, damage, notes) = atomic::try_write_with(
        &folder.path().join(&file),
        |sink| messages(recording, choice, (&descriptions, &rig), (sink, &named), &mut progress),
        BridgeError::writing(&named),
    )?;
    if log.topics.iter().all(|topic| topic.topic == TRANSFORMS) {
        return Err(BridgeError::Nothing { path: recording.recording().path().to_owned() });
    }
    let text = metadata::text(&file, &log);
    let description = out.join("metadata.yaml");
    let written = atomic::write(&folder.path().join("metadata.yaml"), text.as_bytes());
    written.map_err(BridgeError::writing(&description))?;
    folder.finish().map_err(BridgeError::writing(out))?;
    Ok(Written { topics: log.topics, notes: rig.notes.into_iter().chain(notes).collect(), damage })
}

/// Writes the messages; gives what was passed over, too, and what the user should know.
fn messages(
    recording: &mut TimedRecording,
    choice: &Rosbag2Choice<'_>,
    (descriptions, rig): (&[Description], &Placed<'_>),
    (sink, path): (impl Write, &Path),
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(FinishedLog, Vec<String>, Vec<String>), BridgeError> {
    let start = recording.recording().summary().start.clone();
    let end_ns = recording.span_ns()[1];
    let [from, to] = choice.span_ns.unwrap_or([i64::MIN, i64::MAX]);
    let mut begin_ns = choice.span_ns.map(|[from, _]| from.saturating_add(start.host_ns));
    let mut streams = HashMap::new();
    let mut names = RosNames::default();
    for description in descriptions {
        let (at, _) = recording.recording().stream(&description.id)?;
        let (stream, from_host_ns) = Stream::new(recording, (at, description), choice, (&mut names, rig))?;
        begin_ns = begin_ns.and_then(|begin| stream.begins(begin, from_host_ns));
        streams.insert(at, stream);
    }
    let log = Log::begin(sink, path, "ros2")?;
    let mut bag = Bag { log, start, rig, schemas: Schemas::new(), begun: false };
    let mut damage = Vec::new();
    for entry in recording.recording().again()?.into_messages(begin_ns) {
        match entry {
            Ok(Entry::Packet { stream, packet }) => {
                let arrived_ns = bag.start.session_ns(packet.host_ns);
                if arrived_ns > to.saturating_add(LATE_NS) {
                    break;
                }
                let done = arrived_ns.clamp(0, end_ns) as u64;
                progress(done, end_ns.max(1) as u64);
                if let Some(stream) = streams.get_mut(&stream).filter(|_| arrived_ns <= to) {
                    bag.packet(stream, &packet, arrived_ns >= from)?;
                }
            }
            Ok(_) => {}
            Err(error @ ContainerError::Damaged { .. }) => damage.push(error.to_string()),
            Err(error) => return Err(error.into()),
        }
    }
    let mut streams: Vec<Stream> = streams.into_values().collect();
    streams.sort_by(|a, b| a.id.cmp(&b.id));
    damage.extend(streams.iter().flat_map(Stream::damage));
    let notes = streams.iter().flat_map(Stream::notes).collect();
    Ok((bag.log.finish()?, damage, notes))
}

/// What is written of a stream.
struct Stream {
    id: String,
    /// What the names of its topics begin with.
    topic: String,
    size: [u32; 2],
    offset_ns: i64,
    kind: Kind,
    frames: u32,
    damaged: u64,
    /// Messages that no clock dates, and that have their arrival instead.
    undated: u64,
}

enum Kind {
    Events { reading: Box<Reading>, bits: u8 },
    Camera { format: FrameFormat, exposures: HashMap<u64, Exposure> },
}

impl Stream {
    /// The stream, and from which host time on its decoder wants packets: `None` for the beginning.
    fn new(
        recording: &mut TimedRecording,
        (at, description): (usize, &Description),
        choice: &Rosbag2Choice<'_>,
        (names, rig): (&mut RosNames, &Placed<'_>),
    ) -> Result<(Self, Option<i64>), BridgeError> {
        let (id, encoding) = (description.id.clone(), description.encoding);
        let (kind, from_host_ns) = match description.frame_format() {
            Some(format) => (Kind::Camera { format, exposures: recording.exposures(&id)? }, None),
            None => {
                let begun = recording.decoder(at, choice.span_ns.map(|[from, _]| from))?;
                let begun = begun.ok_or_else(|| BridgeError::NoCamera { id: id.clone() })?;
                let bits = if encoding.has_sensor_frames() { recording.bits(at, choice.bits)? } else { 16 };
                let (from_host_ns, dater) = (begun.host_ns, recording.dater(&id)?);
                let as_sent = encoding.events() == Some(erfgs_events::EventEncoding::Evt3);
                (Kind::Events { reading: Box::new(Reading::new(begun, dater, as_sent)), bits }, from_host_ns)
            }
        };
        let (topic, size) = (format!("/{}", names.give(&id)), [description.width, description.height]);
        let offset_ns = rig.offset_ns(&id);
        Ok((Self { id, topic, size, offset_ns, kind, frames: 0, damaged: 0, undated: 0 }, from_host_ns))
    }

    /// From which host time on packets are to be read, where `begin` is that of the others.
    fn begins(&self, begin: i64, from_host_ns: Option<i64>) -> Option<i64> {
        match self.kind {
            Kind::Camera { .. } => Some(begin),
            Kind::Events { .. } => from_host_ns.map(|from| from.min(begin)),
        }
    }

    fn damage(&self) -> Vec<String> {
        let id = &self.id;
        let late = if let Kind::Events { reading, .. } = &self.kind { reading.late_edges() } else { 0 };
        let frames = (self.damaged > 0)
            .then(|| format!("{} frames of stream '{id}' were left out: they are cut or damaged", self.damaged));
        let edges = (late > 0)
            .then(|| format!("{late} edges of stream '{id}' were left out: they come behind events that are later"));
        frames.into_iter().chain(edges).collect()
    }

    fn notes(&self) -> Vec<String> {
        let (undated, id) = (self.undated, &self.id);
        let shift_us = if let Kind::Events { reading, .. } = &self.kind { reading.shift_us() } else { 0 };
        let arrival = (undated > 0).then(|| {
            format!("{undated} messages of stream '{id}' have their arrival as stamp: no clock dates them (`erfgs sync` says why)")
        });
        let shift = (shift_us > 0).then(|| {
            format!(
                "the events' own times of stream '{id}' are {shift_us} us less in the bag: EVT 3 holds 24 bits of them"
            )
        });
        arrival.into_iter().chain(shift).collect()
    }
}

/// The definitions of all messages.
struct Schemas {
    events: Schema,
    image: Schema,
    compressed: Schema,
    info: Schema,
}

impl Schemas {
    fn new() -> Self {
        Self {
            events: definitions::event_packet(),
            image: definitions::image(),
            compressed: definitions::compressed_image(),
            info: definitions::camera_info(),
        }
    }
}

/// The file that is being written.
struct Bag<'a, W: Write> {
    log: Log<W>,
    start: SessionStart,
    rig: &'a Placed<'a>,
    schemas: Schemas,
    begun: bool,
}

/// A picture that becomes a message.
enum Frame<'a> {
    Array(&'a FrameFormat, &'a [u8]),
    File(&'a [u8]),
}

impl<W: Write> Bag<'_, W> {
    /// Writes what a packet holds, if it is wanted.
    fn packet(&mut self, stream: &mut Stream, packet: &Packet, wanted: bool) -> Result<(), BridgeError> {
        let Stream { kind, .. } = stream;
        match kind {
            Kind::Events { reading, bits } => {
                let held = reading.take(packet, wanted);
                let held = held.map_err(|source| BridgeError::Unfit { id: stream.id.clone(), source })?;
                let (Some(held), bits) = (held, *bits) else { return Ok(()) };
                self.events(stream, packet, held, bits)
            }
            Kind::Camera { .. } if !wanted => Ok(()),
            Kind::Camera { format, exposures } => {
                let (format, mid_ns) = (*format, exposures.get(&packet.sequence).map(|exposure| exposure.mid_ns));
                if packet.damaged {
                    stream.damaged += 1;
                    return Ok(());
                }
                let file = (format.pixels == PixelFormat::Mjpeg).then(|| pixel::with_huffman_tables(&packet.payload));
                let frame = file.as_ref().map_or(Frame::Array(&format, &packet.payload), |file| Frame::File(file));
                self.frame(stream, (packet.host_ns, mid_ns), frame)
            }
        }
    }

    fn events(&mut self, stream: &mut Stream, packet: &Packet, held: Held, bits: u8) -> Result<(), BridgeError> {
        let Held { first_ns, words, frames, seen } = held;
        let log_ns = self.start.log_time(packet.host_ns);
        self.begin_once(log_ns)?;
        let stamp_ns = self.stamp(stream, packet.host_ns, first_ns);
        stream.undated += u64::from(seen && first_ns.is_none());
        let head = Head { stamp_ns, frame_id: &stream.id };
        let words = words.as_deref().unwrap_or(&packet.payload);
        let message = messages::event_packet(head, stream.size, packet.sequence, words);
        let (topic, sequence) = (format!("{}/events", stream.topic), packet.sequence as u32);
        self.log.write((&topic, &self.schemas.events), (log_ns, sequence), &message, || offered(&topic))?;
        self.info(stream, (log_ns, sequence), head)?;
        for (mut frame, mid_ns) in frames {
            frame.bits = if frame.bits == 16 { bits } else { frame.bits };
            let (encoding, payload) = sensor_samples(&frame);
            let Some(pixels) = encoding.frames() else { continue };
            let (width, height) = (frame.width.into(), frame.height.into());
            let format = FrameFormat { pixels, width, height, look: Default::default() };
            self.frame(stream, (packet.host_ns, mid_ns), Frame::Array(&format, &payload))?;
        }
        Ok(())
    }

    /// Writes a picture and the lens that it came through.
    fn frame(
        &mut self,
        stream: &mut Stream,
        (host_ns, mid_ns): (i64, Option<i64>),
        frame: Frame<'_>,
    ) -> Result<(), BridgeError> {
        let log_ns = self.start.log_time(host_ns);
        self.begin_once(log_ns)?;
        let stamp_ns = self.stamp(stream, host_ns, mid_ns);
        let head = Head { stamp_ns, frame_id: &stream.id };
        let (topic, schema, message) = match frame {
            Frame::Array(format, payload) => match RosPixels::of(format, payload) {
                Ok(pixels) => {
                    (format!("{}/image_raw", stream.topic), &self.schemas.image, messages::image(head, &pixels))
                }
                Err(_) => {
                    stream.damaged += 1;
                    return Ok(());
                }
            },
            Frame::File(file) if pixel::decode(PixelFormat::Mjpeg, 0, 0, file).is_err() => {
                stream.damaged += 1;
                return Ok(());
            }
            Frame::File(file) => {
                let topic = format!("{}/image_raw/compressed", stream.topic);
                (topic, &self.schemas.compressed, messages::compressed_image(head, file))
            }
        };
        let at = (log_ns, stream.frames);
        self.log.write((&topic, schema), at, &message, || offered(&topic))?;
        self.info(stream, at, head)?;
        stream.undated += u64::from(mid_ns.is_none());
        stream.frames = stream.frames.wrapping_add(1);
        Ok(())
    }

    /// Nanoseconds since 1970 of what was seen at a session time, or else arrived.
    fn stamp(&self, stream: &Stream, host_ns: i64, session_ns: Option<i64>) -> u64 {
        let session_ns = session_ns.unwrap_or_else(|| self.start.session_ns(host_ns));
        let host_ns = self.start.host_ns.saturating_add(session_ns).saturating_add(stream.offset_ns);
        self.start.log_time(host_ns)
    }

    fn info(&mut self, stream: &Stream, at: (u64, u32), head: Head<'_>) -> Result<(), BridgeError> {
        let Some(camera) = self.rig.camera(&stream.id) else { return Ok(()) };
        let (topic, message) = (format!("{}/camera_info", stream.topic), messages::camera_info(head, camera));
        self.log.write((&topic, &self.schemas.info), at, &message, || offered(&topic))
    }

    /// Writes poses before the first message.
    fn begin_once(&mut self, log_ns: u64) -> Result<(), BridgeError> {
        if std::mem::replace(&mut self.begun, true) {
            return Ok(());
        }
        let Some(message) = messages::transforms(log_ns, self.rig) else { return Ok(()) };
        self.log.write((TRANSFORMS, &definitions::transforms()), (log_ns, 0), &message, || offered(TRANSFORMS))
    }
}

/// What a channel says of its topic.
fn offered(topic: &str) -> BTreeMap<String, String> {
    BTreeMap::from([("offered_qos_profiles".to_owned(), metadata::offered_qos(topic).to_owned())])
}
