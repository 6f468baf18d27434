//! Opens an emulated event camera through libusb, as a recorder does, and checks that every event of its pattern arrives,
//! twice: stopped and started again in between.
//!
//! usage: follow_pattern evk4|davis346 SERIAL RATE_HZ SECONDS
//! SECONDS are those of the camera's clock. `scripts/emulation.sh host` runs it against `erfgs-usbd`.

use std::{
    env,
    error::Error,
    process::ExitCode,
    sync::{
        Arc,
        mpsc::{Receiver, Sender, channel},
    },
    time::{Duration, Instant},
};

use erfgs_events::{CdEvent, Decoder, Edge, SensorSize, Sink, StreamDecoder};
use erfgs_rig::{
    event::{Davis346Config, Davis346Source, Evk4Config, Evk4Source, StreamConfig, davis346, list},
    usb::LibusbBus,
};
use erfgs_session::source::{Incident, Outlet, Packet, Source};

/// The longest that this machine may take for one run.
const PATIENCE: Duration = Duration::from_secs(90);

struct Queue(Sender<Packet>);

impl Outlet for Queue {
    fn send(&self, packet: Packet) -> bool {
        self.0.send(packet).is_ok()
    }

    fn report(&self, incident: Incident) {
        println!("{incident:?}");
    }
}

/// Compares events with the pattern of `hardware-mocks/src/usb/scene/pattern.rs`.
struct Follower {
    rate_hz: u64,
    size: SensorSize,
    first: Option<(u64, u64)>,
    last_us: u64,
    events: u64,
    edges: u64,
    wrong: u64,
}

impl Sink for Follower {
    fn event(&mut self, event: CdEvent) {
        let (first, _) = *self.first.get_or_insert(((event.t_us * self.rate_hz).div_ceil(1_000_000), event.t_us));
        let k = first + self.events;
        let (width, height) = (u64::from(self.size.width), u64::from(self.size.height));
        let (t_us, x, y) = (k * 1_000_000 / self.rate_hz, (k % width) as u16, (k / width % height) as u16);
        let expected = CdEvent { t_us, x, y, on: k & 32 != 0 };
        if event != expected {
            self.wrong += 1;
            if self.wrong < 10 {
                println!("event {k} is {event:?} and should be {expected:?}");
            }
        }
        self.events += 1;
        self.last_us = event.t_us;
    }

    fn edge(&mut self, _edge: Edge) {
        self.edges += 1;
    }
}

/// Streams `seconds` of the camera's time; whether all of it was as it should be.
fn follow(source: &mut dyn Source, rate_hz: u64, seconds: f64) -> Result<bool, Box<dyn Error + Send + Sync>> {
    let description = source.description().clone();
    let size = SensorSize { width: description.width as u16, height: description.height as u16 };
    let mut decoder = StreamDecoder::new(description.encoding.events().ok_or("no decoder of this format")?, Some(size));
    let mut follower = Follower { rate_hz, size, first: None, last_us: 0, events: 0, edges: 0, wrong: 0 };
    let (give, take): (_, Receiver<Packet>) = channel();
    source.start(Arc::new(Queue(give)))?;
    let end = Instant::now() + PATIENCE;
    let (mut bytes, mut next, mut in_order) = (0, 0, true);
    let passed = |follower: &Follower| {
        follower.first.map_or(0.0, |(_, first_us)| follower.last_us.saturating_sub(first_us) as f64 * 1e-6)
    };
    while passed(&follower) < seconds && Instant::now() < end {
        let Ok(packet) = take.recv_timeout(Duration::from_secs(5)) else { break };
        in_order &= packet.sequence == next && !packet.discontinuity;
        next += 1;
        bytes += packet.payload.len();
        decoder.decode(&packet.payload, &mut follower);
    }
    println!("readings while it streams: {:?}", source.readings());
    source.stop()?;
    for packet in take.try_iter() {
        bytes += packet.payload.len();
        decoder.decode(&packet.payload, &mut follower);
    }
    decoder.finish(&mut follower);
    let counters = source.counters();
    println!(
        "{} {}: {} events and {} edges over {:.2} s, {} wrong; {counters:?}",
        description.model,
        description.serial,
        follower.events,
        follower.edges,
        passed(&follower),
        follower.wrong
    );
    let whole = counters.bytes == bytes as u64 && (counters.refused, counters.errors, counters.lost) == (0, 0, 0);
    Ok(follower.wrong == 0 && in_order && whole && passed(&follower) >= seconds && follower.edges > 0)
}

fn run(kind: &str, serial: &str, rate_hz: u64, seconds: f64) -> Result<bool, Box<dyn Error + Send + Sync>> {
    for device in list()? {
        println!("{device:?}");
    }
    let stream = StreamConfig { transfers: 8, ..StreamConfig::default() };
    let opening = Instant::now();
    let mut source: Box<dyn Source> = match kind {
        "evk4" => {
            let config = Evk4Config { serial: serial.into(), stream, ..Evk4Config::default() };
            Box::new(Evk4Source::open(Arc::new(LibusbBus), "camera", config)?)
        }
        "davis346" => {
            // Nothing that drops events or changes their times.
            let config = Davis346Config {
                serial: serial.into(),
                events: davis346::Events { background_activity_us: 0, ..davis346::Events::default() },
                timestamps: davis346::Timestamps::Keep,
                stream,
                ..Davis346Config::default()
            };
            Box::new(Davis346Source::open(Arc::new(LibusbBus), "camera", config)?)
        }
        other => return Err(format!("no such kind: {other}").into()),
    };
    println!("opened after {:.2} s: {}", opening.elapsed().as_secs_f64(), serde_json::to_string(source.description())?);
    let first = follow(source.as_mut(), rate_hz, seconds)?;
    let second = follow(source.as_mut(), rate_hz, seconds)?;
    Ok(first && second)
}

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let outcome = match &arguments[..] {
        [kind, serial, rate, seconds] => match (rate.parse(), seconds.parse()) {
            (Ok(rate), Ok(seconds)) => run(kind, serial, rate, seconds),
            _ => Err("RATE_HZ and SECONDS are numbers".into()),
        },
        _ => Err("usage: follow_pattern evk4|davis346 SERIAL RATE_HZ SECONDS".into()),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("follow_pattern: {error}");
            ExitCode::FAILURE
        }
    }
}
