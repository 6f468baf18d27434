//! Windows of a long take, which a page shows one after another.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::scene_file::{Header, HeaderEvents};

/// Which part of a take a model is of, in seconds on one line of time that all windows share.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Window {
    /// What the take is called.
    pub take: String,
    /// Where the model's own line of time begins.
    pub begins: f64,
    /// From when on the model is shown...
    pub from: f64,
    /// ...and until when.
    pub until: f64,
}

/// What a page is told of a window before it loads it.
#[derive(Debug, Serialize)]
pub(crate) struct AboutWindow {
    #[serde(flatten)]
    window: Window,
    /// Of the model's own line of time.
    span_ns: [i64; 2],
    /// The frames of each camera that takes any: time, start and end of exposure, in [0, 1] of that line.
    frames: BTreeMap<String, Vec<[f64; 3]>>,
    events: HeaderEvents,
}

impl AboutWindow {
    pub fn of(window: &Window, header: &Header) -> Self {
        let takes_frames = header.cameras.iter().filter(|camera| !camera.frames.is_empty());
        let frames = takes_frames.map(|camera| (camera.name.clone(), camera.frames.clone())).collect();
        Self { window: window.clone(), span_ns: header.span_ns, frames, events: header.events.clone() }
    }
}
