//! Counts the events of a file of any format.
//!
//! usage: count FILE

use std::{env, error::Error, path::Path};

use erfgs_events::{CdEvent, EventFile, Sink};

/// What is known of the events so far.
#[derive(Default)]
struct Count {
    on: u64,
    off: u64,
    span_us: Option<[u64; 2]>,
}

impl Sink for Count {
    fn event(&mut self, event: CdEvent) {
        *if event.on { &mut self.on } else { &mut self.off } += 1;
        let [first, last] = self.span_us.unwrap_or([event.t_us; 2]);
        self.span_us = Some([first.min(event.t_us), last.max(event.t_us)]);
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args().nth(1).ok_or("usage: count FILE")?;
    let file = EventFile::open(Path::new(&path))?;
    let mut count = Count::default();
    let anomalies = file.decode(&mut count)?;
    println!("{}: {} ON, {} OFF", file.format.name(), count.on, count.off);
    if let Some([first, last]) = count.span_us {
        println!("{:.6} s from the first to the last", (last - first) as f64 * 1e-6);
    }
    if !anomalies.is_empty() {
        println!("skipped: {anomalies}");
    }
    Ok(())
}
