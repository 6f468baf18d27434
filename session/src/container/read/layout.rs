//! Which channel of a file carries what.

use std::collections::{BTreeMap, HashMap};

use bytes::Bytes;
use erfgs_base::names::FileNames;
use mcap::records::op;

use super::{chunk::RawMessage, parse::parse_record, unpack};
use crate::{
    container::{
        Entry, Stream, StreamTotals, Totals,
        foreign::ros::{self, EventPacket},
        packet,
        record::{CLOCK_PREFIX, DESCRIPTION_KEY, INCIDENT_TOPIC, STATE_SUFFIX, STATUS_TOPIC, plain_id},
    },
    source::{Description, Packet},
};

#[derive(Clone, Debug)]
enum Role {
    Packets(usize),
    Ros { topic: String, stream: Option<usize> },
    State,
    Status,
    Incidents,
    Clock(String),
    Other,
}

/// What a message is to us.
pub(in crate::container) enum Meaning {
    Entry(Entry),
    /// Of a channel that erfgs does not read.
    Foreign,
    /// Broken: what is wrong.
    Broken(String),
}

/// Bodies of the records that declare schemas and channels, by their numbers.
#[derive(Clone, Debug, Default)]
pub(in crate::container) struct Declarations {
    pub schemas: BTreeMap<u16, Vec<u8>>,
    pub channels: BTreeMap<u16, Vec<u8>>,
}

/// The channels of a file, as far as they are known.
#[derive(Clone, Debug, Default)]
pub(in crate::container) struct Layout {
    schemas: HashMap<u16, String>,
    roles: HashMap<u16, Role>,
    pub streams: Vec<Stream>,
    names: FileNames,
    /// Encodings of events that were met and that erfgs does not decode.
    pub unknown_encodings: Vec<String>,
    /// What was declared.
    pub declared: Declarations,
    /// What the index declares, for channels whose own declarations are lost.
    pub spare: Declarations,
}

impl Layout {
    /// A file of which this is known before it is read.
    pub fn of(declarations: &Declarations) -> Self {
        let mut layout = Self::default();
        for (opcode, records) in [(op::SCHEMA, &declarations.schemas), (op::CHANNEL, &declarations.channels)] {
            for body in records.values() {
                // What does not parse declares nothing.
                let _ = layout.learn(opcode, body);
            }
        }
        layout
    }

    /// Declares a channel as the index does, if it does.
    fn take_spare(&mut self, channel: u16) {
        let Some(body) = self.spare.channels.remove(&channel) else { return };
        let schema = body.get(2..4).map_or(0, |id| u16::from_le_bytes([id[0], id[1]]));
        if let Some(schema) = self.spare.schemas.get(&schema).cloned() {
            let _ = self.learn(op::SCHEMA, &schema);
        }
        let _ = self.learn(op::CHANNEL, &body);
    }

    /// Takes note of a schema or channel. Other records are let pass; `Err` says what is wrong.
    pub fn learn(&mut self, opcode: u8, body: &[u8]) -> Result<(), String> {
        match parse_record(opcode, body)? {
            mcap::records::Record::Schema { header, .. } => {
                // As with channels, what was said first holds: a repaired copy repeats that.
                self.declared.schemas.entry(header.id).or_insert_with(|| body.to_vec());
                self.schemas.entry(header.id).or_insert(header.name);
            }
            mcap::records::Record::Channel(channel) if !self.roles.contains_key(&channel.id) => {
                self.declared.channels.entry(channel.id).or_insert_with(|| body.to_vec());
                let role = self.role(&channel)?;
                self.roles.insert(channel.id, role);
            }
            _ => {}
        }
        Ok(())
    }

    fn role(&mut self, channel: &mcap::records::Channel) -> Result<Role, String> {
        let schema = self.schemas.get(&channel.schema_id).map_or("", String::as_str);
        if let Some(description) = channel.metadata.get(DESCRIPTION_KEY) {
            let description: Description = serde_json::from_str(description)
                .map_err(|error| format!("the description of {} does not parse: {error}", channel.topic))?;
            description.check().map_err(|wrong| format!("the description of {}: {wrong}", channel.topic))?;
            // The index at the end of a file repeats the channels.
            let known = self.streams.iter().position(|stream| stream.topic == channel.topic);
            return Ok(Role::Packets(known.unwrap_or_else(|| self.add(description, channel.topic.clone()))));
        }
        Ok(match channel.topic.as_str() {
            topic if schema == ros::SCHEMA_NAME && channel.message_encoding == "cdr" => {
                Role::Ros { topic: topic.to_owned(), stream: None }
            }
            _ if !schema.starts_with("erfgs.") => Role::Other,
            STATUS_TOPIC => Role::Status,
            INCIDENT_TOPIC => Role::Incidents,
            topic if topic.ends_with(STATE_SUFFIX) => Role::State,
            topic => match topic.strip_prefix(CLOCK_PREFIX) {
                Some(id) => Role::Clock(id.to_owned()),
                None => Role::Other,
            },
        })
    }

    fn add(&mut self, mut description: Description, topic: String) -> usize {
        description.id = self.names.give(&plain_id(&description.id));
        self.streams.push(Stream { description, topic, totals: StreamTotals::default() });
        self.streams.len() - 1
    }

    /// Whether the channel is declared.
    pub fn knows(&self, channel: u16) -> bool {
        self.roles.contains_key(&channel) || self.spare.channels.contains_key(&channel)
    }

    /// The topic of a channel whose packets are a stream.
    pub fn topic(&self, channel: u16) -> Option<&str> {
        match self.roles.get(&channel)? {
            Role::Packets(stream) => Some(&self.streams.get(*stream)?.topic),
            Role::Ros { topic, .. } => Some(topic),
            _ => None,
        }
    }

    /// Whether any channel is one that erfgs reads.
    pub fn is_known(&self) -> bool {
        self.roles.values().any(|role| !matches!(role, Role::Other))
    }

    /// What a message says.
    pub fn read(&mut self, message: &RawMessage) -> Meaning {
        fn json<T: serde::de::DeserializeOwned>(data: &Bytes, entry: impl FnOnce(T) -> Entry) -> Meaning {
            match serde_json::from_slice(data) {
                Ok(value) => Meaning::Entry(entry(value)),
                Err(error) => Meaning::Broken(format!("a message does not parse: {error}")),
            }
        }
        if !self.roles.contains_key(&message.channel) {
            self.take_spare(message.channel);
        }
        let Some(role) = self.roles.get(&message.channel) else {
            return Meaning::Broken(format!("a message belongs to channel {}, which is not declared", message.channel));
        };
        match role {
            Role::Packets(stream) => match packet::parse(&message.data) {
                Some(packet) => Meaning::Entry(Entry::Packet { stream: *stream, packet }),
                None => Meaning::Broken("a packet is shorter than its header says".into()),
            },
            Role::Ros { .. } => self.read_ros(message),
            Role::State => json(&message.data, Entry::DecoderState),
            Role::Status => json(&message.data, Entry::Status),
            Role::Incidents => json(&message.data, Entry::Incident),
            Role::Clock(stream) => {
                let stream = stream.clone();
                json(&message.data, |fit| Entry::Clock { stream, fit })
            }
            Role::Other => Meaning::Foreign,
        }
    }

    /// Counts an entry: a packet among those of its stream, all else in `totals`.
    pub fn count(&mut self, entry: Entry, totals: &mut Totals) {
        match entry {
            Entry::Packet { stream, packet } => self.streams[stream].totals.count(&packet),
            Entry::Status(status) => totals.status = Some(status),
            Entry::Incident(incident) => totals.note(incident),
            Entry::Clock { stream, fit } => drop(totals.clocks.insert(stream, fit)),
            Entry::DecoderState(_) => {}
        }
    }

    /// A packet of events of ROS 2. Its stream is known from the first one on.
    fn read_ros(&mut self, message: &RawMessage) -> Meaning {
        let unpacked = match unpack::message(&message.data) {
            Ok(unpacked) => unpacked,
            Err(what) => return Meaning::Broken(what),
        };
        let events = match EventPacket::parse(&unpacked) {
            Ok(events) => events,
            Err(what) => return Meaning::Broken(what),
        };
        let Some(Role::Ros { topic, stream }) = self.roles.get(&message.channel) else { return Meaning::Foreign };
        let stream = match *stream {
            Some(stream) => stream,
            None => {
                let Some(encoding) = events.known_encoding() else {
                    if !self.unknown_encodings.contains(&events.encoding) {
                        self.unknown_encodings.push(events.encoding);
                    }
                    return Meaning::Foreign;
                };
                let topic = topic.clone();
                let mut settings = serde_json::Map::new();
                settings.insert("frame_id".into(), events.frame_id.clone().into());
                settings.insert(ros::RECORDED_ENCODING.into(), events.encoding.clone().into());
                let description = Description {
                    id: topic.trim_matches('/').to_owned(),
                    model: "ROS 2 EventPacket".into(),
                    serial: String::new(),
                    encoding,
                    width: events.width,
                    height: events.height,
                    start_order: 0,
                    settings,
                };
                if let Err(wrong) = description.check() {
                    return Meaning::Broken(format!("an EventPacket of {topic}: {wrong}"));
                }
                let known = self.streams.iter().position(|stream| stream.topic == topic);
                let stream = known.unwrap_or_else(|| self.add(description, topic.clone()));
                self.roles.insert(message.channel, Role::Ros { topic, stream: Some(stream) });
                stream
            }
        };
        if let Some(what) = self.streams.get(stream).and_then(|stream| events.differs_from(&stream.description)) {
            return Meaning::Broken(what);
        }
        let (sequence, host_ns) = (events.sequence, i64::try_from(message.log_time).unwrap_or(i64::MAX));
        match events.words() {
            Ok(payload) => {
                let packet = Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload };
                Meaning::Entry(Entry::Packet { stream, packet })
            }
            Err(what) => Meaning::Broken(what),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
    }

    #[test]
    fn of_two_schemas_with_one_number_the_first_holds_and_is_the_one_that_is_repeated() {
        let schema = |name: &str| [&4_u16.to_le_bytes()[..], &text(name), &text("jsonschema"), &text("{}")].concat();
        let mut channel = [1_u16.to_le_bytes(), 4_u16.to_le_bytes()].concat();
        channel.extend([text(STATUS_TOPIC), text("json"), 0_u32.to_le_bytes().to_vec()].concat());
        let mut layout = Layout::default();
        for name in ["erfgs.Status", "erfgs.Incident"] {
            layout.learn(op::SCHEMA, &schema(name)).unwrap();
        }
        layout.learn(op::CHANNEL, &channel).unwrap();
        assert_eq!(layout.declared.schemas[&4], schema("erfgs.Status"));
        assert_eq!(layout.schemas[&4], "erfgs.Status");
        assert!(matches!(layout.roles[&1], Role::Status));
    }
}
