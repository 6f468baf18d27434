//! Writes a session with one stream of events, as a driver of another camera would, and reads it again.
//!
//! usage: write NEW.mcap

use std::{env, error::Error, path::Path};

use erfgs_events::{Columns, EventEncoding};
use erfgs_session::{
    Session, SessionWriter,
    container::{SessionStart, Settings},
    source::{Description, Packet},
};

/// When the recording begins, nanoseconds of the host's monotonic clock.
const START_NS: i64 = 5_000_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args().nth(1).ok_or("usage: write NEW.mcap")?;
    let path = Path::new(&path);
    let start = SessionStart { host_ns: START_NS, program: "example 1.0".into(), ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default())?;
    let camera = writer.add_stream(&Description {
        id: "ev0".into(),
        model: "a camera of mine".into(),
        serial: "1".into(),
        encoding: EventEncoding::Evt3.into(),
        width: 1280,
        height: 720,
        start_order: 0,
        settings: Default::default(),
    })?;
    for sequence in 0..100 {
        // The time (high and low word), row 7, an event that rose in column 5, one that fell in column 9.
        let words = [0x8000, 0x6000 + sequence as u16, 0x0007, 0x2805, 0x2009].map(u16::to_le_bytes).concat();
        writer.packet(
            camera,
            &Packet {
                sequence,
                host_ns: START_NS + 1_000_000 * sequence as i64,
                discontinuity: false,
                damaged: false,
                stamp: None,
                payload: words.into(),
            },
        )?;
    }
    writer.finish()?;

    let mut session = Session::open(path)?;
    let (stream, _) = session.stream("ev0")?;
    let mut events = Columns::default();
    session.decode_events(stream, None, &mut events, |_bytes| {})?;
    println!("{}: {} events", path.display(), events.len());
    Ok(())
}
