//! An MCAP file that is being written, topic by topic as they first have a message.

use std::{
    collections::{BTreeMap, HashMap},
    io::Write,
    path::{Path, PathBuf},
};

use mcap::{
    records::MessageHeader,
    write::{NoSeek, Writer},
};

use crate::BridgeError;

/// What the messages of a topic are.
#[derive(Clone, Debug)]
pub struct Schema {
    /// Its name: `foxglove.CompressedImage`.
    pub name: &'static str,
    /// How the schema is written: `protobuf`, `ros2msg`.
    pub encoding: &'static str,
    /// The schema.
    pub data: Vec<u8>,
    /// How the messages are: `protobuf`, `cdr`.
    pub messages: &'static str,
}

/// What was written of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenTopic {
    /// Its name.
    pub topic: String,
    /// The name of its schema.
    pub schema: &'static str,
    /// How many messages it has.
    pub messages: u64,
}

/// The file.
pub struct Log<W: Write> {
    path: PathBuf,
    writer: Writer<NoSeek<W>>,
    channels: HashMap<String, usize>,
    /// What was written so far, in the order of the topics' first messages, and the numbers of their channels.
    topics: Vec<(WrittenTopic, u16)>,
    /// The first and the last log time, nanoseconds since 1970.
    span_ns: Option<[u64; 2]>,
}

/// What was written.
pub struct FinishedLog {
    pub topics: Vec<WrittenTopic>,
    /// The first and the last log time, nanoseconds since 1970.
    pub span_ns: Option<[u64; 2]>,
}

impl<W: Write> Log<W> {
    /// Begins a file; `path` names it in errors.
    pub fn begin(out: W, path: &Path, profile: &str) -> Result<Self, BridgeError> {
        let failed = BridgeError::record(path);
        // What is compressed already does not get smaller.
        let writer = mcap::WriteOptions::new()
            .compression(None)
            .profile(profile)
            .library(concat!("erfgs ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(4 << 20))
            .disable_seeking(true)
            .create(NoSeek::new(out))
            .map_err(failed)?;
        Ok(Self { path: path.to_owned(), writer, channels: HashMap::new(), topics: Vec::new(), span_ns: None })
    }

    /// Writes a message; `metadata` is asked for where it is the first of its topic.
    pub fn write(
        &mut self,
        (topic, schema): (&str, &Schema),
        (log_ns, sequence): (u64, u32),
        message: &[u8],
        metadata: impl FnOnce() -> BTreeMap<String, String>,
    ) -> Result<(), BridgeError> {
        let failed = BridgeError::record(&self.path);
        let at = match self.channels.get(topic) {
            Some(&at) => at,
            None => {
                let schema_id = self.writer.add_schema(schema.name, schema.encoding, &schema.data).map_err(&failed)?;
                let channel = self.writer.add_channel(schema_id, topic, schema.messages, &metadata());
                let written = WrittenTopic { topic: topic.to_owned(), schema: schema.name, messages: 0 };
                self.topics.push((written, channel.map_err(&failed)?));
                self.channels.insert(topic.to_owned(), self.topics.len() - 1);
                self.topics.len() - 1
            }
        };
        let (written, channel) = &mut self.topics[at];
        let header = MessageHeader { channel_id: *channel, sequence, log_time: log_ns, publish_time: log_ns };
        self.writer.write_to_known_channel(&header, message).map_err(failed)?;
        written.messages += 1;
        let [first, last] = self.span_ns.unwrap_or([log_ns; 2]);
        self.span_ns = Some([first.min(log_ns), last.max(log_ns)]);
        Ok(())
    }

    /// Ends the file.
    pub fn finish(mut self) -> Result<FinishedLog, BridgeError> {
        self.writer.finish().map_err(BridgeError::record(&self.path))?;
        let topics = self.topics.into_iter().map(|(topic, _)| topic).collect();
        Ok(FinishedLog { topics, span_ns: self.span_ns })
    }
}
