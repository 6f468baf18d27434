//! A recording for the tools of others: Foxglove, Rerun, ROS 2.

use std::path::{Path, PathBuf};

use erfgs_bridge::{
    Written,
    foxglove::{self, FoxgloveChoice},
    rosbag2::{self, Rosbag2Choice},
};
use erfgs_scene::rig_file::RigFile;
use erfgs_session::container::Recording;
use erfgs_sync::reading::TimedRecording;
use serde::Serialize;

use super::{Arguments, Format, Kind, not_input};
use crate::{
    errors::{Usage, not_over},
    terminal::{Terminal, bytes, thousands},
};

/// The tools.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    /// Foxglove, and Rerun.
    Foxglove,
    /// ROS 2.
    Rosbag2,
}

/// What is written beside the streams, and how.
#[derive(Debug, clap::Args)]
pub struct BridgeOptions {
    /// The rig file with the cameras' lenses and poses (rig.json); a stream and a camera of one name are one.
    #[arg(long, value_name = "RIG.json", help_heading = "For other tools (foxglove, rosbag2)")]
    rig: Option<PathBuf>,
    /// Write frames that the camera did not send as JPEG images as such, of this quality (1 to 100; foxglove). Default: as PNG, which keeps all their bits.
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100), help_heading = "For other tools (foxglove, rosbag2)")]
    jpeg: Option<u8>,
}

impl BridgeOptions {
    /// Refuses what is given for another format.
    pub fn fits(&self, kind: Kind) -> Result<(), Usage> {
        let tool = if let Kind::Bridge(tool) = kind { Some(tool) } else { None };
        if self.rig.is_some() && tool.is_none() {
            return Err(Usage("--rig is for other tools: --to foxglove or rosbag2".into()));
        }
        if self.jpeg.is_some() && tool != Some(Tool::Foxglove) {
            return Err(Usage("--jpeg is for --to foxglove".into()));
        }
        Ok(())
    }
}

#[derive(Serialize)]
struct Exported {
    path: PathBuf,
    bytes: u64,
    topics: Vec<ExportedTopic>,
    /// What the user should know.
    notes: Vec<String>,
}

#[derive(Serialize)]
struct ExportedTopic {
    topic: String,
    schema: &'static str,
    messages: u64,
}

/// Writes the file or the folder and lists its topics.
pub fn export(
    recording: Recording,
    tool: Tool,
    span_ns: Option<[i64; 2]>,
    arguments: &Arguments,
    terminal: &Terminal,
) -> anyhow::Result<()> {
    let out = place(recording.path(), tool, arguments)?;
    let streams = match &arguments.stream {
        Some(id) => Some(vec![recording.stream(id)?.1.description.id.clone()]),
        None => None,
    };
    let rig = arguments.bridge.rig.as_deref().map(RigFile::read).transpose()?;
    let mut recording = TimedRecording::from(recording);
    let fitting = terminal.progress("fitting clocks");
    recording.fit_clocks(|done, total| fitting.update(done, total, "bytes"))?;
    drop(fitting);
    recording.take_notes().iter().for_each(|note| terminal.note(note.to_string()));
    let progress = terminal.progress("exporting");
    let seconds = |done: u64, total: u64| progress.update(done / 1_000_000_000, total / 1_000_000_000, "seconds");
    let (rig, bits) = (rig.as_ref(), arguments.bits);
    let written = match tool {
        Tool::Foxglove => {
            let (events, jpeg) = (arguments.video.steady(), arguments.bridge.jpeg);
            let choice = FoxgloveChoice { streams, span_ns, rig, events, jpeg, bits };
            foxglove::write(&mut recording, &choice, &out, seconds)?
        }
        Tool::Rosbag2 => {
            let choice = Rosbag2Choice { streams, span_ns, rig, bits };
            rosbag2::write(&mut recording, &choice, &out, seconds)?
        }
    };
    drop(progress);
    let Written { topics, notes, damage } = written;
    notes.iter().for_each(|note| terminal.note(note));
    let topic = |topic: erfgs_bridge::WrittenTopic| ExportedTopic {
        topic: topic.topic,
        schema: topic.schema,
        messages: topic.messages,
    };
    let topics = topics.into_iter().map(topic).collect();
    let exported = Exported { bytes: size(&out), path: out, topics, notes };
    terminal.result(&exported, || {
        let line = |topic: &ExportedTopic| {
            format!("\n{}: {} messages, {}", topic.topic, thousands(topic.messages), topic.schema)
        };
        let lines: String = exported.topics.iter().map(line).collect();
        format!("{}: {}{lines}", exported.path.display(), bytes(exported.bytes))
    })?;
    super::complain(recording.recording(), &damage)
}

/// Where to write to, if that can be.
fn place(input: &Path, tool: Tool, arguments: &Arguments) -> Result<PathBuf, Usage> {
    let out = arguments.out.clone().unwrap_or_else(|| match tool {
        Tool::Foxglove => input.with_extension("foxglove.mcap"),
        Tool::Rosbag2 => input.with_extension("rosbag2"),
    });
    match tool {
        Tool::Foxglove => {
            let extension = Format::Foxglove.extension();
            if out.extension().is_none_or(|named| named != extension) {
                let named = out.with_extension(extension);
                let what = format!("'{}' is not named as an MCAP file: write --out {}", out.display(), named.display());
                return Err(Usage(what));
            }
            not_input(&out, input)?;
            not_over(&out, arguments.force)?;
        }
        Tool::Rosbag2 if arguments.force => {
            return Err(Usage("--force is not for rosbag2: a bag is a folder, which must be new or empty".into()));
        }
        Tool::Rosbag2 => {}
    }
    arguments.video.fits(if tool == Tool::Foxglove { Format::Foxglove } else { Format::Rosbag2 }.pictures())?;
    Ok(out)
}

/// Bytes of a file, or of the files in a folder.
fn size(path: &Path) -> u64 {
    let of_file = |path: &Path| std::fs::metadata(path).map_or(0, |file| file.len());
    match std::fs::read_dir(path) {
        Ok(files) => files.flatten().map(|file| of_file(&file.path())).sum(),
        Err(_) => of_file(path),
    }
}
