//! What should be known of the import of a session.

use std::fmt;

/// What an import of a session left out, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SessionNote {
    /// The rig file has no camera of a stream's name.
    NoCamera {
        /// The stream.
        stream: String,
    },
    /// The rig file has no pose of a stream's camera.
    NoPose {
        /// The stream.
        stream: String,
    },
    /// The session has no stream of a camera's name.
    NoStream {
        /// The camera.
        camera: String,
    },
    /// A stream's frames have no colours and those of others do.
    NoColours {
        /// The stream.
        stream: String,
    },
    /// No part of a stream of events is dated.
    NoClock {
        /// The stream.
        stream: String,
    },
    /// Events of pixels that send some whatever they look at are left out.
    HotPixels {
        /// The stream.
        stream: String,
        /// How many.
        pixels: u64,
        /// The hottest, column and row, and its events a second.
        hottest: ([u16; 2], u64),
    },
    /// A stream has nothing within the window.
    Nothing {
        /// The stream.
        stream: String,
    },
    /// Frames that a camera should have taken are not there.
    NoFrames {
        /// The stream.
        stream: String,
        /// About how many.
        frames: u64,
        /// Between which times of the recording, nanoseconds.
        between: [i64; 2],
        /// What the recording says of it.
        why: Option<String>,
    },
    /// Exposures overlapped, which those of one sensor do not, and were shortened.
    Overlaps {
        /// The stream.
        stream: String,
        /// How many, also beyond what is imported.
        frames: u64,
        /// The longest of them, nanoseconds.
        longest_ns: i64,
        /// The shortest time between two of them, nanoseconds.
        apart_ns: i64,
    },
    /// An event camera was there, or its time is known, for a part only.
    EventsOfPart {
        /// The stream.
        stream: String,
        /// The part that is used, nanoseconds of the recording.
        part: [i64; 2],
        /// What is imported.
        of: [i64; 2],
        /// What the recording says of it.
        why: Option<String>,
    },
    /// A part of the file cannot be read.
    Damage {
        /// The stream that was read.
        stream: String,
        /// What is wrong.
        what: String,
    },
    /// Frames that should be there are damaged or not in the file.
    LostFrames {
        /// The stream.
        stream: String,
        /// How many.
        frames: usize,
    },
}

impl fmt::Display for SessionNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoCamera { stream } => write!(f, "{stream}: left out, the rig file has no camera of this name"),
            Self::NoPose { stream } => write!(f, "{stream}: left out, the rig file has no pose of it"),
            Self::NoStream { camera } => write!(f, "{camera}: the session has no stream of this camera"),
            Self::NoColours { stream } => {
                write!(f, "{stream}: left out, because it has no colour and other cameras do (--grey takes it)")
            }
            Self::NoClock { stream } => write!(f, "{stream}: left out, its clock is not fitted to the session's"),
            Self::HotPixels { stream, pixels, hottest: ([x, y], hz) } => {
                let are = if *pixels == 1 { "a hot pixel is".to_owned() } else { format!("{pixels} hot pixels are") };
                let most = if *pixels == 1 { "" } else { " the hottest" };
                write!(
                    f,
                    "{stream}: events of {are} left out,{most} at ({x}, {y}) with {hz} a second (--keep-hot-pixels takes them)"
                )
            }
            Self::Nothing { stream } => write!(f, "{stream}: left out, it recorded nothing within the window"),
            Self::NoFrames { stream, frames, between, why } => {
                let [from, to] = between.map(seconds);
                let frames = if *frames == 1 { "a frame is".to_owned() } else { format!("{frames} frames are") };
                write!(f, "{stream}: {frames} missing between {from:.3} s and {to:.3} s of the recording")?;
                because(f, why.as_deref())
            }
            Self::Overlaps { stream, frames, longest_ns, apart_ns } => {
                let [longest_ms, apart_ms] = [longest_ns, apart_ns].map(|ns| 1e3 * seconds(*ns));
                write!(
                    f,
                    "{stream}: the recording has exposures of up to {longest_ms:.3} ms where frames are {apart_ms:.3} ms apart, which one \
                     sensor cannot do: {frames} are taken to end where the next one begins. The camera did not expose as long as it was \
                     set to, or its frames were stamped unevenly"
                )
            }
            Self::EventsOfPart { stream, part, of, why } => {
                let ([from, to], [first, last]) = (part.map(seconds), of.map(seconds));
                write!(
                    f,
                    "{stream}: only its events from {from:.3} s to {to:.3} s of the recording are used (of {first:.3} s to {last:.3} \
                     s): the rest has gaps"
                )?;
                because(f, why.as_deref())
            }
            Self::Damage { stream, what } => write!(f, "{stream}: damaged: {what}"),
            Self::LostFrames { stream, frames } => {
                write!(f, "{stream}: {frames} frames are damaged or missing in the file")
            }
        }
    }
}

fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}

/// What the recording says of it, if it does.
fn because(f: &mut fmt::Formatter<'_>, why: Option<&str>) -> fmt::Result {
    why.map_or(Ok(()), |why| write!(f, " (the recording says: {why})"))
}
