//! Records the only EVK4 for ten seconds into a session and prints the event rate of each.
//!
//! usage: record_evk4 NEW.mcap

use std::{
    env,
    error::Error,
    path::Path,
    sync::{Arc, mpsc},
    time::{Duration, Instant},
};

use erfgs_events::{CdEvent, Decoder, Evt3Decoder, SensorSize, Sink};
use erfgs_rig::{
    event::{Evk4Config, Evk4Source},
    host_time,
    usb::LibusbBus,
};
use erfgs_session::{
    SessionWriter,
    container::{SessionStart, Settings},
    source::{Incident, Outlet, Packet, Source},
};

/// Where the packets go. It never blocks, or the camera would lose events.
struct Queue(mpsc::SyncSender<Packet>);

impl Outlet for Queue {
    fn send(&self, packet: Packet) -> bool {
        self.0.try_send(packet).is_ok()
    }

    fn report(&self, incident: Incident) {
        eprintln!("{incident:?}");
    }
}

/// Counts events.
struct Count(u64);

impl Sink for Count {
    fn event(&mut self, _event: CdEvent) {
        self.0 += 1;
    }
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let path = env::args().nth(1).ok_or("usage: record_evk4 NEW.mcap")?;
    let (queue, packets) = mpsc::sync_channel(1024);
    let mut camera = Evk4Source::open(Arc::new(LibusbBus), "ev0", Evk4Config::default())?;
    let about = camera.description().clone();
    let start =
        SessionStart { host_ns: host_time::host_ns(), program: "example 1.0".into(), ..SessionStart::default() };
    let mut writer = SessionWriter::create(Path::new(&path), start, "", Settings::default())?;
    let stream = writer.add_stream(&about)?;

    let mut decoder = Evt3Decoder::new(Some(SensorSize { width: about.width as u16, height: about.height as u16 }));
    let mut events = Count(0);
    camera.start(Arc::new(Queue(queue)))?;
    let begun = Instant::now();
    for second in 1..=10 {
        while let Some(left) = Duration::from_secs(second).checked_sub(begun.elapsed()) {
            let Ok(packet) = packets.recv_timeout(left) else { break };
            decoder.decode(&packet.payload, &mut events);
            writer.packet(stream, &packet)?;
        }
        println!("{second} s: {} events a second", std::mem::take(&mut events.0));
    }
    camera.stop()?;
    for packet in packets.try_iter() {
        writer.packet(stream, &packet)?;
    }
    writer.finish()?;
    println!("{path}: {:?}", camera.counters());
    Ok(())
}
