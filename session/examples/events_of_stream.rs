//! Decodes the events of one stream of a recording and prints the busiest pixel.
//!
//! usage: events_of_stream FILE STREAM

use std::{collections::HashMap, env, error::Error, path::Path};

use erfgs_events::{CdEvent, Sink};
use erfgs_session::Recording;

/// Events of each pixel.
#[derive(Default)]
struct Pixels(HashMap<[u16; 2], u64>);

impl Sink for Pixels {
    fn event(&mut self, event: CdEvent) {
        *self.0.entry([event.x, event.y]).or_default() += 1;
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = env::args().skip(1);
    let (Some(path), Some(id)) = (words.next(), words.next()) else {
        return Err("usage: events_of_stream FILE STREAM".into());
    };
    let mut recording = Recording::open(Path::new(&path), None)?;
    let (stream, _) = recording.stream(&id)?;
    let mut pixels = Pixels::default();
    let decoded = recording.decode_events(stream, &mut pixels, |_bytes| {})?;
    if decoded.is_none() {
        return Err(format!("stream '{id}' has no events").into());
    }
    let total: u64 = pixels.0.values().sum();
    println!("{total} events in {} pixels", pixels.0.len());
    if let Some(([x, y], events)) = pixels.0.into_iter().max_by_key(|&(_, events)| events) {
        println!("busiest pixel: ({x}, {y}) with {events} events");
    }
    Ok(())
}
