//! How fast sessions are written and read, with and without checksums, to memory-backed files and through a sink that
//! takes everything: `cargo bench -p erfgs-session --bench container [-- MIB]`.

use std::{
    io::{self, Write},
    path::Path,
    time::Instant,
};

use erfgs_events::EventEncoding;
use erfgs_session::{
    container::{Entry, Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, Packet},
};

/// Takes everything and keeps nothing.
struct Nowhere;

impl Write for Nowhere {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn description() -> Description {
    Description {
        id: "ev0".into(),
        model: "bench".into(),
        serial: String::new(),
        encoding: Encoding::Events(EventEncoding::Evt3),
        width: 1280,
        height: 720,
        start_order: 0,
        settings: serde_json::Map::new(),
    }
}

/// Writes `mib` MiB in packets of 128 KiB, as an event camera's transfers are; gives MB/s and the sink.
fn write<W: Write>(sink: W, mib: u64, crc: bool) -> (f64, W) {
    let payload: Vec<u8> = (0..128 << 10_u32).map(|i: u32| i.wrapping_mul(2_654_435_761).to_le_bytes()[3]).collect();
    let payload = bytes::Bytes::from(payload);
    let settings = Settings { crc, ..Settings::default() };
    let begun = Instant::now();
    let mut writer = SessionWriter::new(sink, Path::new("bench"), SessionStart::default(), "", settings).unwrap();
    let stream = writer.add_stream(&description()).unwrap();
    for sequence in 0..mib * 8 {
        let packet = Packet {
            sequence,
            host_ns: sequence as i64 * 300_000,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: payload.clone(),
        };
        writer.packet(stream, &packet).unwrap();
    }
    let finished = writer.finish().unwrap();
    (finished.bytes as f64 / 1e6 / begun.elapsed().as_secs_f64(), finished.sink)
}

fn main() {
    let mib = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(1024);
    for crc in [false, true] {
        let best = |run: &mut dyn FnMut() -> f64| (0..3).map(|_| run()).fold(0.0, f64::max);
        let nowhere = best(&mut || write(Nowhere, mib, crc).0);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bench.mcap");
        let to_file = best(&mut || write(std::fs::File::create(&path).unwrap(), mib, crc).0);
        let read = best(&mut || {
            let begun = Instant::now();
            let mut session = Session::open(&path).unwrap();
            let mut bytes = 0;
            for entry in session.messages(None) {
                if let Entry::Packet { packet, .. } = entry.unwrap() {
                    bytes += packet.payload.len();
                }
            }
            bytes as f64 / 1e6 / begun.elapsed().as_secs_f64()
        });
        println!("crc {crc}: written to nowhere {nowhere:.0} MB/s, to a file {to_file:.0} MB/s, read {read:.0} MB/s");
    }
}
