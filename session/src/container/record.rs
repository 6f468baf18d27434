//! What a session holds beside packets: who recorded it, totals, status, incidents.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{
    clock::ClockFit,
    source::{Counters, Encoding, Incident},
};

/// Version of the format that this program writes.
pub const VERSION: u32 = 1;

/// When and with what a session was recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SessionStart {
    /// `CLOCK_MONOTONIC` when the recording started, nanoseconds: the zero of the session clock.
    pub host_ns: i64,
    /// Time since 1970 at that moment, nanoseconds.
    pub epoch_ns: i64,
    /// The program and its version.
    pub program: String,
    /// The machine: kernel, name, whatever helps to understand the recording later.
    pub machine: BTreeMap<String, String>,
}

impl SessionStart {
    /// As the entries of a metadata record.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let mut metadata = BTreeMap::from([
            ("version".to_owned(), VERSION.to_string()),
            ("host_ns".to_owned(), self.host_ns.to_string()),
            ("epoch_ns".to_owned(), self.epoch_ns.to_string()),
            ("program".to_owned(), self.program.clone()),
        ]);
        metadata.extend(self.machine.iter().map(|(key, value)| (format!("machine.{key}"), value.clone())));
        metadata
    }

    /// From the entries of a metadata record; `None` if they are not complete.
    #[must_use]
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        let number = |key: &str| metadata.get(key)?.parse().ok();
        Some(Self {
            host_ns: number("host_ns")?,
            epoch_ns: number("epoch_ns")?,
            program: metadata.get("program")?.clone(),
            machine: metadata
                .iter()
                .filter_map(|(key, value)| Some((key.strip_prefix("machine.")?.to_owned(), value.clone())))
                .collect(),
        })
    }

    /// Nanoseconds since 1970 for a host time: what MCAP calls the log time.
    #[must_use]
    pub fn log_time(&self, host_ns: i64) -> u64 {
        self.epoch_ns.saturating_add(host_ns.saturating_sub(self.host_ns)).max(0).cast_unsigned()
    }

    /// Nanoseconds on the session clock for a host time.
    #[must_use]
    pub fn session_ns(&self, host_ns: i64) -> i64 {
        host_ns.saturating_sub(self.host_ns)
    }
}

/// What was recorded of one stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StreamTotals {
    /// Packets in the file.
    pub packets: u64,
    /// Bytes of their payloads.
    pub bytes: u64,
    /// Host time of the first packet, nanoseconds.
    pub first_host_ns: Option<i64>,
    /// Host time of the last packet, nanoseconds.
    pub last_host_ns: Option<i64>,
    /// Packets that the sequence numbers show as missing.
    pub missing: u64,
    /// Packets before which data was lost or cut.
    pub discontinuities: u64,
    /// Packets that are marked as damaged.
    pub damaged: u64,
    /// The sequence number that should come next.
    pub next_sequence: u64,
    /// The sequence number of the first packet; absent where an earlier program counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_sequence: Option<u64>,
}

impl StreamTotals {
    /// Mean packets a second, from the first to the last; `None` where they span no time.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let span_ns = self.last_host_ns?.saturating_sub(self.first_host_ns?);
        (span_ns > 0).then(|| self.packets.saturating_sub(1) as f64 / (span_ns as f64 * 1e-9))
    }

    /// Counts a packet.
    pub fn count(&mut self, packet: &crate::source::Packet) {
        self.packets += 1;
        self.bytes += packet.payload.len() as u64;
        self.first_host_ns.get_or_insert(packet.host_ns);
        self.first_sequence.get_or_insert(packet.sequence);
        self.last_host_ns = Some(packet.host_ns);
        // A take of a rig that runs begins with any number.
        let next = if self.packets == 1 { packet.sequence } else { self.next_sequence };
        // A damaged file may jump back and forth.
        self.missing = self.missing.saturating_add(packet.sequence.saturating_sub(next));
        self.discontinuities += u64::from(packet.discontinuity);
        self.damaged += u64::from(packet.damaged);
        self.next_sequence = packet.sequence.saturating_add(1);
    }

    /// Counts what follows in the session's next file.
    pub(super) fn go_on(&mut self, next: &Self) {
        if next.packets == 0 {
            return;
        }
        if let (true, Some(first)) = (self.packets > 0, next.first_sequence) {
            self.missing = self.missing.saturating_add(first.saturating_sub(self.next_sequence));
        }
        self.packets = self.packets.saturating_add(next.packets);
        self.bytes = self.bytes.saturating_add(next.bytes);
        self.first_host_ns = self.first_host_ns.or(next.first_host_ns);
        self.last_host_ns = next.last_host_ns.or(self.last_host_ns);
        self.missing = self.missing.saturating_add(next.missing);
        self.discontinuities = self.discontinuities.saturating_add(next.discontinuities);
        self.damaged = self.damaged.saturating_add(next.damaged);
        self.next_sequence = next.next_sequence;
        self.first_sequence = self.first_sequence.or(next.first_sequence);
    }
}

/// The state of the recorder at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Host time, nanoseconds.
    pub host_ns: i64,
    /// Bytes handed to the file so far.
    pub written_bytes: u64,
    /// Bytes free on the disk; absent where the system does not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disk_free_bytes: Option<u64>,
    /// Every stream, by its id.
    pub streams: BTreeMap<String, StreamStatus>,
}

/// The state of one stream at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StreamStatus {
    /// The source's own counters.
    pub counters: Counters,
    /// What each stage behind the source dropped, by the name of the stage: `queue`, `writer`.
    pub dropped: BTreeMap<String, u64>,
    /// Measurements of the device: temperature, event-rate controller counts; `None` where one is not a number.
    pub readings: BTreeMap<String, Option<f64>>,
}

/// Something that happened to a stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IncidentEntry {
    /// The stream; empty for the recorder itself.
    pub stream: String,
    /// Host time, nanoseconds.
    pub host_ns: i64,
    /// What it was.
    #[serde(flatten)]
    pub incident: Incident,
}

/// What a session holds in sum, as its last metadata record says it, so that nobody need read the whole file to know.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Totals {
    /// Every stream, by its id.
    pub streams: BTreeMap<String, StreamTotals>,
    /// The last status.
    pub status: Option<Status>,
    /// The first incidents, [`Totals::MAX_INCIDENTS`] at most.
    pub incidents: Vec<IncidentEntry>,
    /// How many incidents there are.
    pub incident_count: u64,
    /// The last clock fit of every stream that has one, by its id.
    pub clocks: BTreeMap<String, ClockFit>,
    /// Whether the session goes on in another file.
    pub continues: bool,
}

impl Totals {
    /// So many incidents are listed; the others are counted.
    pub const MAX_INCIDENTS: usize = 1000;

    /// Takes note of an incident.
    pub fn note(&mut self, incident: IncidentEntry) {
        self.incident_count += 1;
        if self.incidents.len() < Self::MAX_INCIDENTS {
            self.incidents.push(incident);
        }
    }

    /// As the entries of a metadata record: JSON by name.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let mut metadata = BTreeMap::from([
            ("incidents".to_owned(), json_text(&self.incidents)),
            ("incident_count".to_owned(), self.incident_count.to_string()),
        ]);
        if let Some(status) = &self.status {
            metadata.insert("status".to_owned(), json_text(status));
        }
        metadata.extend(self.streams.iter().map(|(id, totals)| (format!("stream.{id}"), json_text(totals))));
        metadata.extend(self.clocks.iter().map(|(id, fit)| (format!("clock.{id}"), json_text(fit))));
        if self.continues {
            metadata.insert("continues".to_owned(), "true".to_owned());
        }
        metadata
    }

    /// Takes note of what the session's next file says beside its streams.
    pub(super) fn go_on(&mut self, next: &Self) {
        if next.status.is_some() {
            self.status.clone_from(&next.status);
        }
        let room = Self::MAX_INCIDENTS.saturating_sub(self.incidents.len());
        self.incidents.extend(next.incidents.iter().take(room).cloned());
        self.incident_count = self.incident_count.saturating_add(next.incident_count);
        self.clocks.extend(next.clocks.iter().map(|(id, fit)| (id.clone(), fit.clone())));
        self.continues = next.continues;
    }

    /// From the entries of a metadata record.
    ///
    /// # Errors
    /// If an entry does not parse.
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, serde_json::Error> {
        let mut totals = Self::default();
        for (key, value) in metadata {
            match key.split_once('.') {
                Some(("stream", id)) => drop(totals.streams.insert(id.to_owned(), serde_json::from_str(value)?)),
                Some(("clock", id)) => drop(totals.clocks.insert(id.to_owned(), serde_json::from_str(value)?)),
                Some(_) => {}
                None => match key.as_str() {
                    "status" => totals.status = Some(serde_json::from_str(value)?),
                    "incidents" => totals.incidents = serde_json::from_str(value)?,
                    "continues" => totals.continues = serde_json::from_str(value)?,
                    "incident_count" => totals.incident_count = serde_json::from_str(value)?,
                    _ => {}
                },
            }
        }
        Ok(totals)
    }
}

/// JSON of what is made of numbers, strings and maps with string keys, which always has one.
pub(super) fn json_text(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|error| format!("\"{error}\""))
}

/// `id` as that of a stream can be: ASCII letters and digits, `-` and `_`. Writers refuse any other; in a file that is read,
/// whoever wrote it may have chosen any.
#[must_use]
pub fn plain_id(id: &str) -> String {
    let plain = id.replace(|c: char| !c.is_ascii_alphanumeric() && !matches!(c, '-' | '_'), "-");
    if plain.is_empty() { "stream".into() } else { plain }
}

/// The topic of a stream's packets.
#[must_use]
pub fn topic(id: &str, encoding: Encoding) -> String {
    match encoding {
        Encoding::TriggerLines => format!("/trigger/{id}/raw"),
        events if events.is_events() => format!("/event/{id}/raw"),
        frames => format!("/frame/{id}/{frames}"),
    }
}

/// Topic of [`Status`].
pub const STATUS_TOPIC: &str = "/status";
/// Topic of [`IncidentEntry`].
pub const INCIDENT_TOPIC: &str = "/incidents";

/// What the topics of clock fits start with.
pub const CLOCK_PREFIX: &str = "/clock/";
/// What the topics of decoder states end with.
pub const STATE_SUFFIX: &str = "/state";

/// Topic of a stream's clock fits.
#[must_use]
pub fn clock_topic(id: &str) -> String {
    format!("{CLOCK_PREFIX}{id}")
}

/// Topic of the states of a stream's decoder.
#[must_use]
pub fn state_topic(id: &str) -> String {
    format!("/event/{id}{STATE_SUFFIX}")
}

/// Name of the metadata record with [`SessionStart`].
pub const SESSION_METADATA: &str = "erfgs.session";
/// Name of the metadata record with the [`Totals`], written last.
pub const TOTALS_METADATA: &str = "erfgs.totals";
/// Key of a channel's metadata that holds the stream's description as JSON.
pub const DESCRIPTION_KEY: &str = "erfgs.description";
/// Name of the attachment with the rig's configuration.
pub const RIG_ATTACHMENT: &str = "rig.toml";

#[cfg(test)]
mod tests {
    use super::*;

    fn totals(sequences: &[u64]) -> StreamTotals {
        let mut totals = StreamTotals::default();
        for &sequence in sequences {
            totals.count(&crate::source::Packet {
                sequence,
                host_ns: 0,
                discontinuity: false,
                damaged: false,
                stamp: None,
                payload: bytes::Bytes::new(),
            });
        }
        totals
    }

    #[test]
    fn sequence_numbers_that_jump_to_and_fro_are_counted_without_an_overflow() {
        let totals = totals(&[0, u64::MAX, 0, u64::MAX]);
        assert_eq!((totals.packets, totals.missing, totals.next_sequence), (4, u64::MAX, u64::MAX));
    }

    #[test]
    fn what_was_sent_before_the_first_packet_is_not_missing() {
        let totals = totals(&[119, 120, 123]);
        assert_eq!((totals.packets, totals.missing, totals.next_sequence), (3, 2, 124));
    }
}
