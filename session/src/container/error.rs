//! What can go wrong with a session file.

use std::{
    io,
    path::{Path, PathBuf},
};

use super::MAX_PART;

/// An error of reading, writing or repairing a session.
#[derive(Debug, thiserror::Error)]
pub enum ContainerError {
    /// A repair in place was ended before it had removed what it keeps meanwhile.
    #[error(
        "{kept} exists already: it holds what an earlier repair of {path} cut off, which was ended too soon. Move it away and repair \
         again; remove it once the session is whole (`erfgs info --check`)",
        path = path.display(),
        kept = kept.display()
    )]
    RepairCutOff {
        /// The session.
        path: PathBuf,
        /// What is kept.
        kept: PathBuf,
    },
    /// The file to write is there already.
    #[error("{path} exists already; give another name or move it away", path = path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The file system refused to open or create the file.
    #[error("cannot {what} {path}: {source}; check that the folder exists and that you may use it", path = path.display())]
    Open {
        /// `open` or `create`.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Writing failed. Whole chunks that were written before stay readable.
    #[error(
        "cannot write to {path} after {offset} bytes: {source}; the data before stays readable (`erfgs info`), and `erfgs recover` \
         repairs the file once there is room",
        path = path.display()
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// How many bytes of the file were handed to the system before.
        offset: u64,
        /// Why.
        source: io::Error,
    },
    /// Writing a file failed that appears whole or not at all.
    #[error("cannot write {path}: {source}; free some space, or choose another disk", path = path.display())]
    NotWritten {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Reading failed.
    #[error("cannot read {path} at byte {offset}: {source}; check the disk and its cable", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// Why.
        source: io::Error,
    },
    /// The file is empty.
    #[error("{path} is empty: the recording did not start, or its content is lost", path = path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file is not MCAP.
    #[error("{path} is not an MCAP file: it has other first bytes; `erfgs info` lists the formats that erfgs reads", path = path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// A range of a recording in which nothing arrived.
    #[error("{path} has no data from {from_s} s to {to_s} s; `erfgs info` shows its length", path = path.display())]
    NothingWithin {
        /// The file.
        path: PathBuf,
        /// Start of the range, seconds.
        from_s: f64,
        /// Its end, seconds.
        to_s: f64,
    },
    /// The file is MCAP, but nothing that erfgs recorded.
    #[error("{path} is an MCAP file, but not a session of erfgs: {what}", path = path.display())]
    NotASession {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: &'static str,
    },
    /// A newer program wrote the file.
    #[error("{path} has version {version} of the session format and this program knows version {known}; update erfgs", path = path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// The version found.
        version: String,
        /// The version known.
        known: u32,
    },
    /// A file that is not the last of a session in parts is not there.
    #[error(
        "{path} is missing: the session goes on in {later}; move it beside the others. If it is lost, move the files behind it into \
         another folder: what lies before it can be read then, and each of the others by itself",
        path = path.display(), later = later.display()
    )]
    MissingPart {
        /// The file.
        path: PathBuf,
        /// The file behind it, which is there.
        later: PathBuf,
    },
    /// A file is named as a part of a session, and is none.
    #[error(
        "{path} is named as a part of the session that begins in {first}, but {what}; give it another name, or move it away",
        path = path.display(), first = first.display()
    )]
    ForeignPart {
        /// The file.
        path: PathBuf,
        /// The first file of the session.
        first: PathBuf,
        /// What it is instead.
        what: String,
    },
    /// A session that is written cannot go on in another file.
    #[error("the session in {path} cannot go on in another file: it was not begun in parts, or has {MAX_PART} of them", path = path.display())]
    NotInParts {
        /// The file.
        path: PathBuf,
    },
    /// A record is broken where the file is not merely cut off.
    #[error("{path} is damaged at byte {offset}: {what}; `erfgs recover` saves the intact part", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the record starts.
        offset: u64,
        /// What is wrong with it.
        what: String,
    },
    /// A file is damaged where it cannot be repaired in place.
    #[error(
        "{path} is damaged in {places} places before its end and cannot be repaired in place; \
         `erfgs recover {path} --out NEW` copies the intact part",
        path = path.display()
    )]
    DamagedWithin {
        /// The file.
        path: PathBuf,
        /// How many chunks are damaged.
        places: usize,
    },
    /// All that a file holds is damaged.
    #[error("nothing can be saved from {path}: all of its data is damaged, in {places} places", path = path.display())]
    NothingWhole {
        /// The file.
        path: PathBuf,
        /// How many places are damaged.
        places: usize,
    },
    /// What a repair wrote is not what it read.
    #[error(
        "the repaired copy of {path} differs from what was read: {what}. The copy was deleted and the recording is unchanged; please \
         report this, and check the disk",
        path = path.display()
    )]
    NotAsRead {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A chunk is compressed in a way that is not supported.
    #[error(
        "{path} holds a chunk at byte {offset} that is compressed with {compression:?}; erfgs reads \"lz4\" and \"zstd\", which \
         the program that wrote the file may offer to compress with",
        path = path.display()
    )]
    Compression {
        /// The file.
        path: PathBuf,
        /// Where the chunk starts.
        offset: u64,
        /// What the chunk is compressed with, as it says (the first 40 characters).
        compression: String,
    },
    /// Two streams of one session have the same name.
    #[error("two streams of the session in {path} are called '{id}'; give each its own id in the rig's configuration", path = path.display())]
    DuplicateStream {
        /// The file.
        path: PathBuf,
        /// The name.
        id: String,
    },
    /// A stream's name has characters that topics cannot have.
    #[error("'{id}' cannot name a stream of {path}: use letters, digits, '-' and '_'", path = path.display())]
    StreamName {
        /// The file.
        path: PathBuf,
        /// The name.
        id: String,
    },
    /// The session has no such stream.
    #[error("{path} has no stream '{id}'; it has {known}", path = path.display())]
    UnknownStream {
        /// The file.
        path: PathBuf,
        /// The name asked for.
        id: String,
        /// The names that there are.
        known: String,
    },
    /// An event file cannot be read, or not as a recording.
    #[error("{source}", source = in_context(path, source.as_ref()))]
    EventFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A folder of rosbag2 is not one recording.
    #[error("{path} is a folder of rosbag2, and {what}", path = path.display())]
    BagFolder {
        /// The folder.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A recording of rosbag2 in SQLite cannot be read.
    #[error("cannot read {path} as a recording of rosbag2: {source}", path = path.display())]
    Rosbag2 {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Nothing of an event file can be read.
    #[error("nothing in {path} can be read: {found}; `erfgs info {path}` shows the assumed format", path = path.display())]
    NothingReadable {
        /// The file.
        path: PathBuf,
        /// How many items are wrong, and in which way.
        found: String,
    },
    /// An event file has a time that a recording cannot have.
    #[error(
        "{path} has an event at {t_us} µs, before zero, where no recording begins; add a constant to `t`",
        path = path.display()
    )]
    BeforeZero {
        /// The file.
        path: PathBuf,
        /// The time.
        t_us: i64,
    },
    /// No thread can be had.
    #[error("cannot start a reader thread: {source}; close other programs")]
    Thread {
        /// Why.
        source: io::Error,
    },
    /// A payload is longer than a message can say.
    #[error("a packet of stream '{id}' has {bytes} bytes; a session takes less than 4 GiB in one packet")]
    TooLong {
        /// The stream.
        id: String,
        /// Its length.
        bytes: usize,
    },
}

/// The message of an error about a file, which names the file.
fn in_context(path: &Path, error: &dyn std::error::Error) -> String {
    let (name, message) = (path.display().to_string(), error.to_string());
    if message.contains(&name) { message } else { format!("{name} {message}") }
}

impl ContainerError {
    /// An error of an event file.
    pub(super) fn event_file(path: &Path, error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self::EventFile { path: path.to_owned(), source: error.into() }
    }

    /// An error of the MCAP writer, as an error of writing `path`.
    pub(super) fn writing(path: &Path, offset: u64, error: mcap::McapError) -> Self {
        let source = match error {
            mcap::McapError::Io(source) => source,
            other => io::Error::other(other),
        };
        Self::Write { path: path.to_owned(), offset, source }
    }
}
