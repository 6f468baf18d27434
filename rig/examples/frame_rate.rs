//! Opens the only frame camera and prints the intervals at which its frames arrive, for a hundred frames.
//!
//! usage: frame_rate

use std::{
    error::Error,
    sync::{Arc, mpsc},
    time::Duration,
};

use erfgs_rig::frame::{self, FrameConfig};
use erfgs_session::source::{Incident, Outlet, Packet};

/// Where the frames go.
struct Queue(mpsc::SyncSender<Packet>);

impl Outlet for Queue {
    fn send(&self, packet: Packet) -> bool {
        self.0.try_send(packet).is_ok()
    }

    fn report(&self, incident: Incident) {
        eprintln!("{incident:?}");
    }
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let config = FrameConfig { id: "cam0".into(), width: 640, height: 480, ..FrameConfig::default() };
    let mut camera = frame::open(&config)?;
    println!("{}: {:?}", camera.description().model, camera.description().settings);
    let (queue, frames) = mpsc::sync_channel(64);
    camera.start(Arc::new(Queue(queue)))?;
    let mut before: Option<i64> = None;
    for _ in 0..100 {
        let frame = frames.recv_timeout(Duration::from_secs(5))?;
        if let Some(before) = before {
            let interval_ms = (frame.host_ns - before) as f64 * 1e-6;
            println!("frame {}: {interval_ms:.2} ms, {} bytes", frame.sequence, frame.payload.len());
        }
        before = Some(frame.host_ns);
    }
    camera.stop()?;
    println!("{:?}", camera.counters());
    Ok(())
}
