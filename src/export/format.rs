//! What things are exported as.

use std::path::{Path, PathBuf};

use clap::ValueEnum as _;
use erfgs_dataset::export::Layout;
use erfgs_session::export::{EventsFormat, FramesFormat};

use super::{bridge, event_video::Pictures, scene::SceneFormat};

/// What a session is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Format {
    Raw,
    Dat,
    Aedat4,
    Csv,
    Npz,
    H5,
    Png,
    Exr,
    Mp4,
    Session,
    Foxglove,
    Rosbag2,
    Bias,
}

/// What `--to` names.
#[derive(Clone, Copy, Debug)]
pub(super) enum To {
    /// Streams of a session.
    Streams(Format),
    /// A dataset.
    Dataset(Layout),
    /// A run, as one file.
    Scene(SceneFormat),
    /// How the bodies of a run move.
    Motion,
}

/// What streams are written as.
pub(super) const STREAM_FORMATS: &str =
    "raw, dat, aedat4, csv, npz, h5, png, exr, mp4, session, foxglove, rosbag2 or bias";

/// The format that a word names.
pub(super) fn to(text: &str) -> Result<To, String> {
    match text {
        "colmap" => Ok(To::Dataset(Layout::Colmap)),
        "html" => Ok(To::Scene(SceneFormat::Html)),
        "e4d" => Ok(To::Scene(SceneFormat::E4d)),
        "4dgs" => Ok(To::Scene(SceneFormat::FourDgs)),
        "gltf" => Ok(To::Scene(SceneFormat::Gltf)),
        "spz" => Ok(To::Scene(SceneFormat::Spz)),
        "motion" => Ok(To::Motion),
        "nerfstudio" => Ok(To::Dataset(Layout::Nerfstudio)),
        _ => Format::from_str(text, false).map(To::Streams).map_err(|_| {
            format!(
                "{STREAM_FORMATS} for streams, colmap or nerfstudio for a dataset, html, e4d, 4dgs, gltf, spz or motion for a run"
            )
        }),
    }
}

/// What a format is one of.
pub(super) enum Kind {
    Events(EventsFormat),
    Frames(FramesFormat),
    /// Frames, and events as videos.
    Video,
    /// A session.
    Session,
    /// All of it, for the tools of others.
    Bridge(bridge::Tool),
    /// The biases of event cameras.
    Biases,
}

/// What events are written as in files with this extension; none where it is of no format of events.
pub fn events_format(extension: &str) -> Option<EventsFormat> {
    match Format::from_str(extension, false).ok()?.kind() {
        Kind::Events(format) => Some(format),
        _ => None,
    }
}

impl Format {
    pub fn extension(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Dat => "dat",
            Self::Aedat4 => "aedat4",
            Self::Csv => "csv",
            Self::Npz => "npz",
            Self::H5 => "h5",
            Self::Png => "png",
            Self::Exr => "exr",
            Self::Mp4 => "mp4",
            Self::Session | Self::Foxglove => "mcap",
            Self::Rosbag2 => "rosbag2",
            Self::Bias => "bias",
        }
    }

    /// What it is a format of.
    pub fn kind(self) -> Kind {
        match self {
            Self::Raw => Kind::Events(EventsFormat::Raw),
            Self::Dat => Kind::Events(EventsFormat::Dat),
            Self::Aedat4 => Kind::Events(EventsFormat::Aedat4),
            Self::Csv => Kind::Events(EventsFormat::Csv),
            Self::Npz => Kind::Events(EventsFormat::Npz),
            Self::H5 => Kind::Events(EventsFormat::Hdf5),
            Self::Png => Kind::Frames(FramesFormat::Png),
            Self::Exr => Kind::Frames(FramesFormat::Exr),
            Self::Mp4 => Kind::Video,
            Self::Session => Kind::Session,
            Self::Foxglove => Kind::Bridge(bridge::Tool::Foxglove),
            Self::Rosbag2 => Kind::Bridge(bridge::Tool::Rosbag2),
            Self::Bias => Kind::Biases,
        }
    }

    /// What of it shows events.
    pub fn pictures(self) -> Pictures {
        match self {
            Self::Mp4 => Pictures::Video,
            Self::Foxglove => Pictures::Steady,
            _ => Pictures::None,
        }
    }

    /// Whether a stream becomes a folder.
    pub fn is_folder(self) -> bool {
        matches!(self.kind(), Kind::Frames(format) if format.is_folder())
    }

    /// Files that an export to `out` may write, by which an earlier one is known.
    pub fn writes(self, out: &Path) -> Vec<PathBuf> {
        match self {
            Self::Png | Self::Exr => vec![out.join("frames.csv")],
            // A camera's times, and those of an event sensor.
            Self::Mp4 => vec![out.to_owned(), out.with_extension("csv"), out.with_extension("frames.csv")],
            _ => vec![out.to_owned()],
        }
    }
}
