//! An emulated EVK4 that sees the pattern, and what is found of it in the packets.

use std::sync::{Arc, Mutex};

use erfgs_events::{CdEvent, Decoder, Edge, EventEncoding, SensorSize, Sink, StreamDecoder};
use erfgs_hardware_mocks::usb::{Evk4 as Model, Evk4Options, Fault, Faults, Plug, evk4::Stimulus, scene::Pattern};
use erfgs_rig::event::{EventError, Evk4Config, Evk4Source};
use erfgs_session::source::Source;

use super::{Bucket, EmulatedBus};

/// Events a second.
const RATE: u64 = 400_000;

pub fn pattern() -> Pattern {
    Pattern::new(1280, 720, RATE)
}

pub fn model(options: Evk4Options) -> Model {
    Model::new(options, Stimulus::Scene(Box::new(pattern())))
}

pub type Camera = Arc<Mutex<Plug<Model>>>;

/// A bus with one camera, whose transfers fail as `faults` says.
pub fn one(options: Evk4Options, faults: Vec<Fault>) -> (Arc<EmulatedBus>, Camera) {
    let bus = Arc::new(EmulatedBus::default());
    let camera = Arc::new(Mutex::new(Plug::new(model(options), &Faults { schedule: faults, ..Faults::default() })));
    bus.add(camera.clone());
    (bus, camera)
}

pub fn open(bus: &Arc<EmulatedBus>, config: Evk4Config) -> Result<Evk4Source, EventError> {
    Evk4Source::open(bus.clone(), "left", config)
}

pub fn register(camera: &Camera, address: u32) -> u32 {
    camera.lock().unwrap().device().register(address)
}

/// Everything that a decoder finds.
#[derive(Default)]
pub struct Found {
    pub events: Vec<CdEvent>,
    pub edges: Vec<Edge>,
}

impl Sink for Found {
    fn event(&mut self, event: CdEvent) {
        self.events.push(event);
    }

    fn edge(&mut self, edge: Edge) {
        self.edges.push(edge);
    }
}

/// Decodes the packets of a bucket in runs between discontinuities.
pub fn decode(bucket: &Bucket, encoding: EventEncoding) -> Vec<Found> {
    let size = SensorSize { width: 1280, height: 720 };
    let mut runs = vec![Found::default()];
    let mut decoder = StreamDecoder::new(encoding, Some(size));
    for packet in bucket.packets.lock().unwrap().iter() {
        if packet.discontinuity {
            decoder = StreamDecoder::new(encoding, Some(size));
            runs.push(Found::default());
        }
        decoder.decode(&packet.payload, runs.last_mut().unwrap());
    }
    runs
}

/// The events of a run are the pattern's, with none missing, twice or displaced.
pub fn assert_complete(run: &Found) {
    let pattern = pattern();
    let first = pattern.first_at(run.events.first().expect("events").t_us);
    for (event, k) in run.events.iter().zip(first..) {
        assert_eq!(*event, pattern.event(k), "event {k}, from {first} on");
    }
}

/// Starts, lets at least `bytes` arrive, stops.
pub fn record(source: &mut Evk4Source, bytes: usize) -> Arc<Bucket> {
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(bytes);
    source.stop().unwrap();
    bucket
}
