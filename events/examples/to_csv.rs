//! Writes the events of a file of any format as lines `t,x,y,on` to the standard output.
//!
//! usage: to_csv FILE > EVENTS.csv

use std::{
    env,
    error::Error,
    io::{self, Write},
    path::Path,
};

use erfgs_events::{CSV_HEADER, CdEvent, CsvEncoder, EventFile, Sink};

/// Lines that wait to be written, and the first error of writing.
struct Lines<W> {
    out: W,
    waiting: Vec<u8>,
    failed: Option<io::Error>,
}

impl<W: Write> Lines<W> {
    fn flush(&mut self) {
        if self.failed.is_none() {
            self.failed = self.out.write_all(&self.waiting).err();
        }
        self.waiting.clear();
    }
}

impl<W: Write> Sink for Lines<W> {
    fn event(&mut self, event: CdEvent) {
        CsvEncoder.event(event, &mut self.waiting);
        if self.waiting.len() > 1 << 16 {
            self.flush();
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args().nth(1).ok_or("usage: to_csv FILE > EVENTS.csv")?;
    let file = EventFile::open(Path::new(&path))?;
    let mut lines = Lines { out: io::stdout().lock(), waiting: CSV_HEADER.to_vec(), failed: None };
    let anomalies = file.decode(&mut lines)?;
    lines.flush();
    if let Some(error) = lines.failed {
        return Err(error.into());
    }
    if !anomalies.is_empty() {
        eprintln!("skipped: {anomalies}");
    }
    Ok(())
}
