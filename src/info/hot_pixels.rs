//! `erfgs info --hot-pixels`: the pixels of event cameras that send events whatever they look at.

use std::path::Path;

use erfgs_events::{EventFileHints, HotPixel, PixelActivity};
use erfgs_session::container::Recording;
use serde::Serialize;

use crate::terminal::{Terminal, table, thousands};

/// How many pixels cameras can mask, by a word of their model, and the name of the setting.
const MASKED: [(&str, usize, &str); 2] = [("EVK", 64, "masked_pixels"), ("DAVIS346", 8, "events.masked_pixels")];
/// So many are listed for people.
const LISTED: usize = 20;

#[derive(Serialize)]
struct Found {
    stream: String,
    model: String,
    hot_pixels: Vec<HotPixel>,
}

/// Of each stream of a session or an event file.
pub fn run(path: &Path, hints: &EventFileHints, terminal: &Terminal) -> anyhow::Result<()> {
    let mut recording = Recording::open_with(path, hints)?;
    let mut found = Vec::new();
    for stream in 0..recording.summary().streams.len() {
        let summary = &recording.summary().streams[stream];
        let (description, total) = (summary.description.clone(), summary.totals.bytes);
        if !description.encoding.is_events() {
            continue;
        }
        let [width, height] = [description.width, description.height].map(|pixels| pixels as usize);
        let mut activity = PixelActivity::new(width, height);
        let progress = terminal.progress(&format!("reading {}", description.id));
        recording.decode_events(stream, &mut activity, |done| progress.update(done, total, "bytes"))?;
        let hot_pixels = activity.hot_pixels();
        found.push(Found { stream: description.id, model: description.model, hot_pixels });
    }
    if found.is_empty() {
        anyhow::bail!("{} has no events", path.display());
    }
    terminal.result(&found, || found.iter().map(Found::text).collect::<Vec<_>>().join("\n"))
}

impl Found {
    fn text(&self) -> String {
        let Self { stream, model, hot_pixels } = self;
        if hot_pixels.is_empty() {
            return format!("{stream}: no hot pixels");
        }
        let head = ["x", "y", "events", "a second"].map(String::from).to_vec();
        let row = |pixel: &HotPixel| {
            let &HotPixel { x, y, events, rate_hz } = pixel;
            vec![x.to_string(), y.to_string(), thousands(events.into()), format!("{rate_hz:.1}")]
        };
        let rows: Vec<_> = std::iter::once(head).chain(hot_pixels.iter().take(LISTED).map(row)).collect();
        let mut text = format!("{stream}: {} hot pixels\n{}", thousands(hot_pixels.len() as u64), table(&rows));
        if hot_pixels.len() > LISTED {
            text.push_str(&format!("and {} others (--json has all)\n", thousands((hot_pixels.len() - LISTED) as u64)));
        }
        if let Some((_, most, setting)) = MASKED.iter().find(|(word, ..)| model.contains(word)) {
            let places = hot_pixels.iter().take(*most).map(|pixel| format!("[{}, {}]", pixel.x, pixel.y));
            let places = places.collect::<Vec<_>>().join(", ");
            text.push_str(&format!(
                "The camera masks up to {most} of them by this line of RIG.toml:\n{setting} = [{places}]\n"
            ));
        }
        text
    }
}
