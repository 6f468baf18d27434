//! Recordings of rosbag2 in SQLite (`.db3`), as ROS 2 wrote them before it took MCAP: read as the MCAP file with the same
//! messages, which lies in a temporary file while it is open.
//!
//! Tables `topics` (id, name, type, serialization_format) and `messages` (topic_id, timestamp in nanoseconds, data).

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufWriter, Seek},
    path::Path,
};

use mcap::records::MessageHeader;
use rusqlite::{Connection, OpenFlags};

use super::ros;
use crate::container::ContainerError;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
enum Wrong {
    #[error("{0}")]
    Sqlite(#[from] rusqlite::Error),
    #[error("its copy in the folder for temporary files cannot be written: {0}; set TMPDIR to a folder with room")]
    Write(#[from] std::io::Error),
    #[error("its copy cannot be written: {0}")]
    Mcap(#[from] mcap::McapError),
    #[error("it has no topic of {wanted}; its topics are of: {found}", wanted = ros::SCHEMA_NAME)]
    Topics { found: String },
    #[error(
        "its events are serialized as '{format}', and erfgs reads cdr alone: record them anew, or ros2 bag convert"
    )]
    Format { format: String },
    #[error("a message at {timestamp} has no time since 1970")]
    Time { timestamp: i64 },
}

/// The messages of the recording `path` that hold events, as MCAP.
///
/// # Errors
/// If it is no recording of rosbag2, has no events, or there is no room for the copy.
pub(in crate::container) fn as_mcap(path: &Path) -> Result<File, ContainerError> {
    convert(path).map_err(|source| ContainerError::Rosbag2 { path: path.to_owned(), source: Box::new(source) })
}

fn convert(path: &Path) -> Result<File, Wrong> {
    let connection =
        Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX)?;
    // The file may be anybody's. SQLite itself holds no value of more than 1 GB.
    connection.pragma_update(None, "trusted_schema", false)?;
    connection.pragma_update(None, "cell_size_check", true)?;
    let file = tempfile::tempfile()?;
    let options = mcap::WriteOptions::new().compression(None).profile("ros2").library("erfgs, of rosbag2's SQLite");
    let mut writer = options.create(BufWriter::new(file))?;
    let (mut channels, mut types) = (BTreeMap::new(), Vec::new());
    let mut topics = connection.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
    let mut rows = topics.query([])?;
    while let Some(row) = rows.next()? {
        let (id, name): (i64, String) = (row.get(0)?, row.get(1)?);
        let (kind, format): (String, String) = (row.get(2)?, row.get(3)?);
        if kind == ros::SCHEMA_NAME {
            if format != "cdr" {
                return Err(Wrong::Format { format });
            }
            let schema = writer.add_schema(&kind, "ros2msg", b"")?;
            channels.insert(id, writer.add_channel(schema, &name, &format, &BTreeMap::new())?);
        } else if !types.contains(&kind) {
            types.push(kind);
        }
    }
    if channels.is_empty() {
        types.truncate(20);
        return Err(Wrong::Topics { found: if types.is_empty() { "none".into() } else { types.join(", ") } });
    }
    let mut messages = connection.prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY id")?;
    let mut rows = messages.query([])?;
    let mut sequence = 0;
    while let Some(row) = rows.next()? {
        let Some(&channel_id) = channels.get(&row.get::<_, i64>(0)?) else { continue };
        let timestamp: i64 = row.get(1)?;
        let log_time = u64::try_from(timestamp).map_err(|_| Wrong::Time { timestamp })?;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, row.get_ref(2)?.as_blob().map_err(rusqlite::Error::from)?)?;
        sequence = sequence.wrapping_add(1);
    }
    writer.finish()?;
    let mut file = writer.into_inner().into_inner().map_err(std::io::IntoInnerError::into_error)?;
    file.rewind()?;
    Ok(file)
}
