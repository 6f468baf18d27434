//! Recordings of ROS 2 as programs write them: read as they are meant, or refused by what is not understood.

use std::{io::Cursor, path::Path};

use erfgs_events::{CdEvent, Columns, Evt2Encoder, Evt3Encoder, Evt21Encoder};
use erfgs_session::container::Session;
use mcap::{Compression, records::MessageHeader};
use proptest::prelude::*;

const SIZE: [u32; 2] = [640, 480];
/// Since 1970, nanoseconds.
const BEGUN_NS: u64 = 1_744_000_000_000_000_000;
const SCHEMA: &str = "event_camera_msgs/msg/EventPacket";
const ENCODINGS: [&str; 6] = ["evt3", "evt2", "evt21", "libcaer", "libcaer_cmp", "mono"];

/// A message, field by field.
#[derive(Clone, Debug)]
struct Message {
    kind: [u8; 2],
    frame_id: String,
    size: [u32; 2],
    sequence: u64,
    base_ns: u64,
    encoding: String,
    is_big_endian: u8,
    events: Vec<u8>,
}

impl Message {
    /// As the CDR of ROS 2 lays it out.
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![self.kind[0], self.kind[1], 0, 0];
        let put = |bytes: &mut Vec<u8>, align: usize, field: &[u8]| {
            bytes.resize(4 + (bytes.len() - 4).next_multiple_of(align), 0);
            bytes.extend(field);
        };
        let text = |bytes: &mut Vec<u8>, text: &str| {
            put(bytes, 4, &(text.len() as u32 + 1).to_le_bytes());
            put(bytes, 1, &[text.as_bytes(), &[0]].concat());
        };
        put(&mut bytes, 4, &17_i32.to_le_bytes());
        put(&mut bytes, 4, &5_u32.to_le_bytes());
        text(&mut bytes, &self.frame_id);
        put(&mut bytes, 4, &self.size[1].to_le_bytes());
        put(&mut bytes, 4, &self.size[0].to_le_bytes());
        put(&mut bytes, 8, &self.sequence.to_le_bytes());
        put(&mut bytes, 8, &self.base_ns.to_le_bytes());
        text(&mut bytes, &self.encoding);
        put(&mut bytes, 1, &[self.is_big_endian]);
        put(&mut bytes, 4, &(self.events.len() as u32).to_le_bytes());
        put(&mut bytes, 1, &self.events);
        bytes
    }
}

/// Events as a driver packs them, `t_us` after the base.
fn words(encoding: &str, events: &[CdEvent]) -> Vec<u8> {
    let mut out = Vec::new();
    match encoding {
        "evt3" => {
            let mut encoder = Evt3Encoder::default();
            events.iter().for_each(|&event| encoder.event(event, &mut out).unwrap());
            encoder.finish(&mut out);
        }
        "evt2" => {
            let mut encoder = Evt2Encoder::default();
            events.iter().for_each(|&event| encoder.event(event, &mut out).unwrap());
        }
        "evt21" => {
            let mut encoder = Evt21Encoder::default();
            events.iter().for_each(|&event| encoder.event(event, &mut out).unwrap());
            encoder.finish(&mut out);
        }
        "mono" => out.extend(events.iter().flat_map(|&CdEvent { t_us, x, y, on }| {
            (u64::from(on) << 63 | u64::from(y) << 48 | u64::from(x) << 32 | (1000 * t_us)).to_le_bytes()
        })),
        "libcaer" => out.extend(events.iter().flat_map(|&CdEvent { t_us, x, y, on }| {
            (t_us << 32 | u64::from(x) << 17 | u64::from(y) << 2 | u64::from(on) << 1 | 1).to_le_bytes()
        })),
        _ => out.extend(events.iter().flat_map(|&CdEvent { t_us, x, y, on }| {
            let (high, low) = ((t_us >> 12) as u16, 0x1000 | (t_us & 0xFFF) as u16);
            [high, low, 0x2000 | x, 0x3000 | u16::from(on) << 11 | y].into_iter().flat_map(u16::to_le_bytes)
        })),
    }
    out
}

/// Messages of the same events; those of a driver of Prophesee's are one stream of words.
fn messages(encoding: &str, events: &[CdEvent], at_a_time: usize, frame_id: &str, first: u64) -> Vec<Message> {
    let message = |(sequence, events): (u64, Vec<u8>)| Message {
        kind: [0, 1],
        frame_id: frame_id.to_owned(),
        size: SIZE,
        sequence,
        base_ns: BEGUN_NS,
        encoding: encoding.to_owned(),
        is_big_endian: 0,
        events,
    };
    let pieces: Vec<Vec<u8>> = match encoding {
        // Whole words of all: they do not end with the message.
        "evt3" | "evt2" | "evt21" => words(encoding, events).chunks(8 * at_a_time).map(<[u8]>::to_vec).collect(),
        _ => events.chunks(at_a_time).map(|events| words(encoding, events)).collect(),
    };
    (first..).zip(pieces).map(message).collect()
}

/// How the messages lie in a file.
#[derive(Clone, Copy, Debug)]
enum File {
    Mcap(Option<Compression>),
    #[cfg(feature = "rosbag2")]
    Sqlite {
        packed: bool,
    },
}

fn files() -> impl Strategy<Value = File> {
    let compressions = [None, Some(Compression::Lz4), Some(Compression::Zstd)];
    #[cfg_attr(not(feature = "rosbag2"), expect(unused_mut, reason = "nothing is added without SQLite"))]
    let mut files = compressions.map(File::Mcap).to_vec();
    #[cfg(feature = "rosbag2")]
    files.extend([true, false].map(|packed| File::Sqlite { packed }));
    prop::sample::select(files)
}

impl File {
    fn write(self, folder: &Path, schema: &str, coding: &str, messages: &[Vec<u8>]) -> std::path::PathBuf {
        let time = |at: usize| BEGUN_NS + at as u64 * 1_000_000;
        match self {
            Self::Mcap(compression) => {
                let path = folder.join("bag.mcap");
                let mut bytes = Vec::new();
                let options = mcap::WriteOptions::new().compression(compression).chunk_size(Some(300));
                let mut writer = options.create(Cursor::new(&mut bytes)).unwrap();
                let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
                let channel = writer.add_channel(schema, "/camera/events", coding, &Default::default()).unwrap();
                for (at, message) in messages.iter().enumerate() {
                    let log_time = time(at);
                    let header = MessageHeader { channel_id: channel, sequence: 0, log_time, publish_time: log_time };
                    writer.write_to_known_channel(&header, message).unwrap();
                }
                writer.finish().unwrap();
                drop(writer);
                std::fs::write(&path, bytes).unwrap();
                path
            }
            #[cfg(feature = "rosbag2")]
            Self::Sqlite { packed } => {
                let path = folder.join("bag.db3");
                let bag = rusqlite::Connection::open(&path).unwrap();
                bag.execute_batch(
                    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
                     CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);",
                )
                .unwrap();
                let topic = rusqlite::params![schema, coding];
                bag.execute("INSERT INTO topics VALUES (3, '/camera/events', ?1, ?2)", topic).unwrap();
                for (at, message) in messages.iter().enumerate() {
                    let level = ruzstd::encoding::CompressionLevel::Fastest;
                    let data =
                        if packed { ruzstd::encoding::compress_to_vec(&message[..], level) } else { message.clone() };
                    let row = rusqlite::params![time(at) as i64, data];
                    bag.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (3, ?1, ?2)", row).unwrap();
                }
                path
            }
        }
    }
}

/// What a file gives: its events, those that lie outside of its sensor, and what is said of its damage.
fn read(path: &Path) -> Result<(Vec<CdEvent>, u64, String), String> {
    let mut session = Session::open(path).map_err(|error| error.to_string())?;
    let mut columns = Columns::default();
    let Some(decoded) = session.decode_events(0, None, &mut columns, |_| {}).map_err(|error| error.to_string())? else {
        let summary = session.summary();
        return Err(format!("{} {}", summary.unknown_encodings.join(" "), summary.damage.join(" ")));
    };
    assert!(columns.len() <= 1000);
    let damage = [session.summary().damage.join(" "), decoded.damage.join(" ")].join(" ");
    Ok((columns.iter().collect(), decoded.anomalies.outside, damage))
}

fn events() -> impl Strategy<Value = Vec<CdEvent>> {
    let one = (1..900_u64, 0..640_u16, 0..480_u16, any::<bool>());
    proptest::collection::vec(one, 2..60).prop_map(|rows| {
        let mut t_us = 0;
        let event = |(step, x, y, on)| {
            t_us += step;
            CdEvent { t_us, x, y, on }
        };
        rows.into_iter().map(event).collect()
    })
}

/// From the first event on: the round of the clock in which a message begins is the reader's business.
fn since_first(events: &[CdEvent]) -> Vec<CdEvent> {
    let first = events.first().map_or(0, |event| event.t_us);
    events.iter().map(|event| CdEvent { t_us: event.t_us - first, ..*event }).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn every_way_to_write_the_same_events_gives_them(
        events in events(),
        encoding in prop::sample::select(&ENCODINGS[..]),
        at_a_time in 1..30_usize,
        frame_id in prop::sample::select(vec!["", "a", "optical_frame", "caméra/links", "frame with blanks"]),
        first in prop::sample::select(vec![0, 7, u64::from(u32::MAX)]),
        file in files(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let messages = messages(encoding, &events, at_a_time, frame_id, first);
        let bytes: Vec<Vec<u8>> = messages.iter().map(Message::bytes).collect();
        let path = file.write(folder.path(), SCHEMA, "cdr", &bytes);
        let (found, outside, damage) = read(&path).unwrap();
        prop_assert_eq!((outside, damage.trim()), (0, ""));
        prop_assert_eq!(since_first(&found), since_first(&events));
    }

    #[test]
    fn what_is_not_understood_is_named(
        events in events(),
        encoding in prop::sample::select(&ENCODINGS[..]),
        file in files(),
        which in 0..9_usize,
        at in any::<prop::sample::Index>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let mut messages = messages(encoding, &events, 4, "frame", 0);
        let at = at.index(messages.len());
        let later = at > 0;
        let (mut schema, mut coding) = (SCHEMA, "cdr");
        let message = &mut messages[at];
        let expected = match which {
            0 => { message.kind = [0, 0]; "little-endian CDR" }
            1 => { message.is_big_endian = 1; "is_bigendian" }
            2 if later => { message.size = [320, 240]; "320 x 240" }
            3 if later => { message.encoding = if encoding == "evt2" { "evt3".into() } else { "evt2".into() }; "in a topic of" }
            4 if later => { message.encoding = "trigger".into(); "'trigger'" }
            5 => { messages.iter_mut().for_each(|message| message.encoding = "raw2".into()); "raw2" }
            6 if ["mono", "libcaer", "libcaer_cmp"].contains(&encoding) => { message.events.pop(); "no whole words" }
            7 if ["mono", "libcaer"].contains(&encoding) => {
                message.events.extend(words(encoding, &[CdEvent { t_us: 5000, x: 2500, y: 3, on: true }]));
                "(2500, 3)"
            }
            8 => { coding = "json"; if matches!(file, File::Mcap(_)) { SCHEMA } else { "'json'" } }
            _ => { schema = "dvs_msgs/msg/EventArray"; SCHEMA }
        };
        let bytes: Vec<Vec<u8>> = messages.iter().map(Message::bytes).collect();
        let path = file.write(folder.path(), schema, coding, &bytes);
        match read(&path) {
            Ok((found, _, damage)) => {
                prop_assert!(damage.contains(expected), "{which} {at}: {damage:?}");
                prop_assert!(found.len() < events.len(), "{which}");
            }
            Err(error) => prop_assert!(error.contains(expected), "{which}: {error}"),
        }
    }

    #[test]
    fn events_outside_of_the_sensor_are_counted_and_a_size_that_is_not_said_loses_none(
        events in events(),
        encoding in prop::sample::select(&ENCODINGS[..]),
        size in prop::sample::select(vec![[0, 0], [320, 240], [640, 480], [1280, 720]]),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let mut messages = messages(encoding, &events, 5, "frame", 0);
        messages.iter_mut().for_each(|message| message.size = size);
        let bytes: Vec<Vec<u8>> = messages.iter().map(Message::bytes).collect();
        let (found, outside, damage) = read(&File::Mcap(None).write(folder.path(), SCHEMA, "cdr", &bytes)).unwrap();
        let is_inside = |event: &&CdEvent| size == [0; 2] || u32::from(event.x) < size[0] && u32::from(event.y) < size[1];
        let inside = events.iter().filter(is_inside).count();
        prop_assert_eq!((found.len(), outside as usize, damage.trim()), (inside, events.len() - inside, ""));
    }
}
