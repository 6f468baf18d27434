//! How much the recorder takes: event streams and MJPEG streams at a given rate through queue, writer and container
//! into a file.
//!
//! ```text
//! cargo run --release -p erfgs-lab --features studies --bin record_throughput -- OUT.mcap [SECONDS] [EVENT_MB_PER_S] [CAMERAS] [no-crc]
//! ```
//!
//! Every packet is copied once into memory of its own, as drivers do. Prints what was offered, written and dropped at each
//! stage, the most that waited in memory, and the processor time that recording took.

use std::{
    env,
    error::Error,
    fs,
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use bytes::Bytes;
use erfgs_events::EventEncoding;
use erfgs_recorder::{Input, Options, Recorder, SessionFiles, SessionInfo, folder_of};
use erfgs_rig::host_time::host_ns;
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::Settings,
    source::{Counters, Description, Encoding, Outlet, Packet, Source, SourceError},
};

/// Event cameras that share the rate.
const EVENT_CAMERAS: usize = 4;
/// Bytes of a transfer of events, and of a frame: 7.5 MB/s at 30 Hz, as 1080p MJPEG has.
const TRANSFER: usize = 128 << 10;
const FRAME: usize = 250_000;
const FRAMES_HZ: f64 = 30.0;

/// Sends packets of one size at a rate.
struct Load {
    description: Description,
    packet_bytes: usize,
    packets_hz: f64,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Load {
    fn input(id: String, encoding: Encoding, packet_bytes: usize, packets_hz: f64) -> Input {
        let description = Description {
            id,
            model: "load (no camera)".into(),
            serial: String::new(),
            encoding,
            width: 1280,
            height: 720,
            start_order: 0,
            settings: serde_json::Map::new(),
        };
        let source = Self { description, packet_bytes, packets_hz, quit: Arc::default(), thread: None };
        let queue_bytes = if encoding.is_events() { 256 << 20 } else { 64 << 20 };
        Input { source: Box::new(source), queue_bytes, stall_after: None }
    }
}

impl Source for Load {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        let (quit, packet_bytes, packets_hz) = (Arc::clone(&self.quit), self.packet_bytes, self.packets_hz);
        self.thread = Some(thread::spawn(move || {
            // Bytes that nothing compresses.
            let mut state = 0x9e37_79b9_7f4a_7c15_u64;
            let noise: Vec<u8> = std::iter::repeat_with(|| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            })
            .take(packet_bytes)
            .collect();
            let begun = Instant::now();
            for sequence in 0_u64.. {
                let due = Duration::from_secs_f64(sequence as f64 / packets_hz);
                thread::sleep(due.saturating_sub(begun.elapsed()));
                if quit.load(Relaxed) {
                    return;
                }
                let payload = Bytes::copy_from_slice(&noise);
                let (host_ns, stamp) = (host_ns(), None);
                outlet.send(Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp, payload });
            }
        }));
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.quit.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().map_err(|_| "the load's thread panicked")?;
        }
        Ok(())
    }

    fn counters(&self) -> Counters {
        Counters::default()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let number = |at: usize, default: f64| arguments.get(at).map_or(Ok(default), |text| text.parse());
    let out = PathBuf::from(
        arguments.first().ok_or("usage: record_throughput OUT.mcap [SECONDS] [EVENT_MB_PER_S] [CAMERAS]")?,
    );
    let (seconds, event_mb, cameras) = (number(1, 10.0)?, number(2, 400.0)?, number(3, 12.0)? as usize);
    let crc = !arguments.iter().any(|argument| argument == "no-crc");
    let events_hz = event_mb * 1e6 / EVENT_CAMERAS as f64 / TRANSFER as f64;
    let mut inputs: Vec<Input> = (0..EVENT_CAMERAS)
        .map(|index| Load::input(format!("event-{index}"), Encoding::Events(EventEncoding::Evt3), TRANSFER, events_hz))
        .collect();
    inputs.extend(
        (0..cameras)
            .map(|index| Load::input(format!("rgb-{index}"), Encoding::Frames(PixelFormat::Mjpeg), FRAME, FRAMES_HZ)),
    );
    let options = Options {
        info: SessionInfo { rig: "load".into(), ..SessionInfo::default() },
        flush_every: Duration::from_millis(500),
        reserve_bytes: 0,
        folder: folder_of(&out),
        opener: Box::new(SessionFiles { settings: Settings { crc, ..Settings::default() }, split: None }),
        subscriber: None,
        before: None,
        after: None,
        rig_file: None,
    };
    let recorder = Recorder::new(inputs, options)?;
    recorder.start_recording(&out)?;
    let before = processor_seconds();
    recorder.start_sources()?;
    let begun = Instant::now();
    thread::sleep(Duration::from_secs_f64(seconds));
    recorder.stop_sources();
    let delivered_s = begun.elapsed().as_secs_f64();
    let summary = recorder.stop_recording("the time was over")?;
    let total_s = begun.elapsed().as_secs_f64();
    let used = processor_seconds() - before;

    let sum = |of: fn(&erfgs_recorder::StreamStatus) -> u64| summary.streams.iter().map(of).sum::<u64>() as f64;
    let (written, dropped) = (sum(|stream| stream.written_bytes), sum(|stream| stream.drops.queue_bytes));
    println!("offered  {:8.1} MB/s for {delivered_s:.1} s", (written + dropped) / 1e6 / delivered_s);
    println!(
        "written  {:8.1} MB/s over {total_s:.1} s, until the last byte was handed to the system",
        written / 1e6 / total_s
    );
    println!(
        "dropped  {:8.1} MB in {} packets (queue), {} packets (writer)",
        dropped / 1e6,
        sum(|stream| stream.drops.queue),
        sum(|stream| stream.drops.writer)
    );
    println!(
        "waiting  {:8.1} MB at most, of {:.0} MB allowed",
        sum(|stream| stream.peak_waiting_bytes) / 1e6,
        sum(|stream| stream.queue_bytes) / 1e6
    );
    println!(
        "processor{:8.2} s for each GB written ({used:.1} s), the load's own copies included",
        used / (written / 1e9)
    );
    println!("memory   {:8.0} MB resident at most", peak_resident_mb());
    if let Some(failure) = summary.failure {
        return Err(failure.into());
    }
    Ok(())
}

/// Processor time of this process, user and system, seconds.
fn processor_seconds() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields 14 and 15, counted behind the name in parentheses; in hundredths of a second on Linux.
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |at: usize| fields.get(at).and_then(|field| field.parse::<f64>().ok()).unwrap_or(f64::NAN);
    (ticks(11) + ticks(12)) / 100.0
}

fn peak_resident_mb() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()).map_or(f64::NAN, |kb| kb / 1e3)
}
