//! Lists the streams of a recording: a session, a recording of ROS 2 or an event file of another program.
//!
//! usage: open_any FILE

use std::{env, error::Error, path::Path};

use erfgs_session::{Recording, container::Entry};

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args().nth(1).ok_or("usage: open_any FILE")?;
    let mut recording = Recording::open(Path::new(&path), None)?;
    let summary = recording.summary();
    for fault in summary.faults() {
        println!("{fault}");
    }
    let streams: Vec<String> = summary
        .streams
        .iter()
        .map(|stream| {
            let about = &stream.description;
            format!("{} ({}, {}, {} x {})", about.id, about.model, about.encoding, about.width, about.height)
        })
        .collect();
    let mut totals = vec![(0_u64, 0_u64); streams.len()];
    for entry in recording.messages(None) {
        if let Entry::Packet { stream, packet } = entry? {
            totals[stream].0 += 1;
            totals[stream].1 += packet.payload.len() as u64;
        }
    }
    for (stream, (packets, bytes)) in streams.iter().zip(totals) {
        println!("{stream}: {packets} packets, {bytes} bytes");
    }
    Ok(())
}
