//! A frame camera that films the stage, without a driver.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use bytes::Bytes;
use erfgs_rig::host_time::host_ns;
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::source::{
    Counters, Description, Encoding, FrameStamp, Outlet, Packet, Source, SourceError, StampClock, StampPoint,
};

/// Frames a second.
pub const RATE_HZ: i64 = 30;

/// See the module.
pub struct StageCamera {
    description: Description,
    frames: Arc<[Bytes]>,
    quit: Arc<AtomicBool>,
    counters: Arc<Mutex<Counters>>,
    thread: Option<JoinHandle<()>>,
}

impl StageCamera {
    /// Shows these pictures again and again.
    pub fn new(id: &str, frames: Vec<Vec<u8>>, [width, height]: [u32; 2]) -> Self {
        let mut settings = serde_json::Map::new();
        settings.insert("rate_hz".into(), RATE_HZ.into());
        let description = Description {
            id: id.into(),
            model: "stage camera (emulated, no driver)".into(),
            serial: String::new(),
            encoding: Encoding::Frames(PixelFormat::Mjpeg),
            width,
            height,
            start_order: 10,
            settings,
        };
        let frames = frames.into_iter().map(Bytes::from).collect();
        Self { description, frames, quit: Arc::default(), counters: Arc::default(), thread: None }
    }
}

impl Source for StageCamera {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        let (frames, quit, counters) = (Arc::clone(&self.frames), Arc::clone(&self.quit), Arc::clone(&self.counters));
        quit.store(false, Relaxed);
        self.thread = Some(thread::Builder::new().spawn(move || {
            let begun = host_ns();
            for sequence in 0_u32.. {
                let due = begun + i64::from(sequence) * 1_000_000_000 / RATE_HZ;
                thread::sleep(Duration::from_nanos(u64::try_from(due - host_ns()).unwrap_or(0)));
                if quit.load(Relaxed) {
                    return;
                }
                let payload = frames[sequence as usize % frames.len()].clone();
                let stamp = FrameStamp {
                    kernel_ns: due,
                    clock: StampClock::Monotonic,
                    point: StampPoint::EndOfFrame,
                    sequence,
                };
                let mut counters = counters.lock().unwrap_or_else(PoisonError::into_inner);
                counters.packets += 1;
                counters.bytes += payload.len() as u64;
                drop(counters);
                outlet.send(Packet {
                    sequence: sequence.into(),
                    host_ns: host_ns(),
                    discontinuity: false,
                    damaged: false,
                    stamp: Some(stamp),
                    payload,
                });
            }
        })?);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.quit.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().map_err(|_| "the camera's thread panicked")?;
        }
        Ok(())
    }

    fn counters(&self) -> Counters {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
