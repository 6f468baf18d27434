//! Records a rig for some seconds with the recorder alone, without the application and without the live page: what the
//! guest's show runs (`scripts/guest/jobs/show.sh`).
//!
//! usage: record_seconds RIG.toml SESSION.mcap SECONDS

use std::{
    error::Error,
    path::Path,
    thread,
    time::{Duration, Instant},
};

use erfgs_rig::record::{self, MachineFacts, Mcap, Options, Recorder, RigConfig, SessionInfo, folder_of};
use erfgs_session::container::Settings;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [rig, session, seconds] = &arguments[..] else {
        return Err("usage: record_seconds RIG.toml SESSION.mcap SECONDS".into());
    };
    let (session, seconds) = (Path::new(session), Duration::from_secs_f64(seconds.parse()?));
    let rig = RigConfig::load(Path::new(rig))?;
    let settings =
        Settings { chunk_bytes: rig.record.chunk_mib << 20, crc: rig.record.checksums, ..Settings::default() };
    let options = Options {
        info: SessionInfo {
            rig: rig.name.clone(),
            configuration: rig.text.clone(),
            program: "record_seconds".into(),
            machine: MachineFacts::gather(),
            warnings: Vec::new(),
        },
        flush_every: Duration::from_millis(rig.record.flush_ms),
        reserve_bytes: rig.record.reserve_mib << 20,
        folder: folder_of(session),
        opener: Box::new(Mcap { settings }),
        tap: None,
    };
    let recorder = Recorder::new(record::open(&rig)?, options)?;
    recorder.start_recording(session)?;
    recorder.start_sources()?;
    let begun = Instant::now();
    let mut told = 0;
    while begun.elapsed() < seconds && recorder.is_recording() {
        thread::sleep(Duration::from_millis(100));
        for message in recorder.messages() {
            if message.number <= told {
                continue;
            }
            told = message.number;
            println!("{:.1} s: {} {}", begun.elapsed().as_secs_f64(), message.stream, message.text);
        }
    }
    recorder.stop_sources();
    let summary = recorder.stop_recording("the time was over")?;
    for stream in &summary.streams {
        let drops = stream.drops;
        println!(
            "{}: {} packets, {} bytes, {} dropped",
            stream.id,
            stream.written,
            stream.written_bytes,
            drops.driver + drops.queue + drops.writer
        );
    }
    Ok(())
}
