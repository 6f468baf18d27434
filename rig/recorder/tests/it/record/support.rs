//! Sources and sinks that do what a test tells them.

use std::{
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering::SeqCst},
        mpsc::{Receiver, Sender, channel},
    },
    thread,
    time::{Duration, Instant},
};

use bytes::Bytes;
use erfgs_events::EventEncoding;
use erfgs_hardware_mocks::usb::{
    Davis346, Davis346Options, Evk4, Evk4Options, evk4::Stimulus, scene::Pattern, scene::PatternFrames,
};
use erfgs_recorder::{Input, OpenSession, Options, Recorder, SessionInfo, SessionSink, SinkError, Status};
use erfgs_rig::{host_time::host_ns, usb::Bus};
use erfgs_session::source::{Counters, Description, Encoding, Incident, Outlet, Packet, Source, SourceError};

use super::bus::EmulatedBus;

/// Waits until `holds`; a test that waits longer than this fails.
pub fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(60), "waited too long for: {what}");
        thread::sleep(Duration::from_millis(2));
    }
}

pub fn packet(sequence: u64, bytes: usize) -> Packet {
    let payload = Bytes::from(vec![sequence as u8; bytes]);
    Packet { sequence, host_ns: host_ns(), discontinuity: false, damaged: false, stamp: None, payload }
}

/// What tests see of a source, and push through it.
#[derive(Clone, Default)]
pub struct Handle {
    pub outlet: Arc<Mutex<Option<Arc<dyn Outlet>>>>,
    pub lost: Arc<AtomicU64>,
}

impl Handle {
    pub fn send(&self, packet: Packet) -> bool {
        let outlet = self.outlet.lock().unwrap().clone().expect("the source is not started");
        outlet.send(packet)
    }

    pub fn report(&self, incident: Incident) {
        self.outlet.lock().unwrap().clone().expect("the source is not started").report(incident);
    }
}

/// A source that delivers what its handle is given.
pub struct Puppet {
    description: Description,
    handle: Handle,
    refuses: bool,
    journal: Arc<Mutex<Vec<String>>>,
}

impl Puppet {
    pub fn new(id: &str, start_order: i32) -> (Self, Handle) {
        let handle = Handle::default();
        let description = Description {
            id: id.into(),
            model: "puppet".into(),
            serial: String::new(),
            encoding: Encoding::Events(EventEncoding::Evt3),
            width: 640,
            height: 480,
            start_order,
            settings: serde_json::Map::new(),
        };
        (Self { description, handle: handle.clone(), refuses: false, journal: Arc::default() }, handle)
    }

    pub fn refusing(mut self) -> Self {
        self.refuses = true;
        self
    }

    pub fn journalled(mut self, journal: &Arc<Mutex<Vec<String>>>) -> Self {
        self.journal = Arc::clone(journal);
        self
    }

    pub fn input(self, queue_bytes: usize) -> Input {
        Input { source: Box::new(self), queue_bytes, stall_after: None }
    }
}

impl Source for Puppet {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        self.journal.lock().unwrap().push(format!("start {}", self.description.id));
        if self.refuses {
            return Err("the puppet does not want to".into());
        }
        *self.handle.outlet.lock().unwrap() = Some(outlet);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.journal.lock().unwrap().push(format!("stop {}", self.description.id));
        Ok(())
    }

    fn counters(&self) -> Counters {
        Counters { lost: self.handle.lost.load(SeqCst), ..Counters::default() }
    }
}

/// What a sink was given.
#[derive(Default)]
pub struct Shelf {
    pub packets: Vec<(usize, Packet)>,
    pub incidents: Vec<(Option<usize>, Incident)>,
    pub statuses: Vec<Status>,
    pub flushes: usize,
    pub finished: bool,
}

/// How a sink behaves.
#[derive(Default)]
pub struct Disk {
    pub shelf: Mutex<Shelf>,
    /// Packets wait for a token each.
    gate: Mutex<Option<Receiver<()>>>,
    /// After this many packets it is full; 0: never.
    pub room: AtomicU64,
    pub panics: AtomicBool,
}

impl Disk {
    /// From now on a packet is written for each token.
    pub fn gated(self: &Arc<Self>) -> Sender<()> {
        let (tokens, gate) = channel();
        *self.gate.lock().unwrap() = Some(gate);
        tokens
    }

    pub fn sequences(&self, stream: usize) -> Vec<u64> {
        let shelf = self.shelf.lock().unwrap();
        shelf.packets.iter().filter(|(of, _)| *of == stream).map(|(_, packet)| packet.sequence).collect()
    }
}

pub struct Opener(pub Arc<Disk>);

impl OpenSession for Opener {
    fn open(&self, path: &Path, _: &SessionInfo, _: &[Description]) -> Result<Box<dyn SessionSink>, SinkError> {
        Ok(Box::new(DiskSink { disk: Arc::clone(&self.0), path: path.into() }))
    }
}

struct DiskSink {
    disk: Arc<Disk>,
    path: PathBuf,
}

impl SessionSink for DiskSink {
    fn packet(&mut self, stream: usize, packet: &Packet) -> Result<(), SinkError> {
        assert!(!self.disk.panics.load(SeqCst), "the disk sink panics as told");
        if let Some(gate) = self.disk.gate.lock().unwrap().as_ref() {
            // Whoever drops the tokens opens the gate.
            let _ = gate.recv();
        }
        let mut shelf = self.disk.shelf.lock().unwrap();
        let room = self.disk.room.load(SeqCst);
        if room > 0 && shelf.packets.len() as u64 >= room {
            return Err(SinkError::Full(self.path.clone()));
        }
        shelf.packets.push((stream, packet.clone()));
        Ok(())
    }

    fn incident(&mut self, stream: Option<usize>, _: i64, incident: &Incident) -> Result<(), SinkError> {
        self.disk.shelf.lock().unwrap().incidents.push((stream, incident.clone()));
        Ok(())
    }

    fn status(&mut self, status: &Status) -> Result<(), SinkError> {
        self.disk.shelf.lock().unwrap().statuses.push(status.clone());
        Ok(())
    }

    fn flush(&mut self) -> Result<(), SinkError> {
        self.disk.shelf.lock().unwrap().flushes += 1;
        Ok(())
    }

    fn bytes_written(&self) -> u64 {
        0
    }

    fn finish(self: Box<Self>) -> Result<u64, SinkError> {
        self.disk.shelf.lock().unwrap().finished = true;
        Ok(0)
    }
}

/// A bus with an EVK4 and a DAVIS346, which see patterns.
pub fn evk4_and_davis346() -> Arc<dyn Bus> {
    let bus = EmulatedBus::default();
    let evk4 = Evk4::new(Evk4Options::default(), Stimulus::Scene(Box::new(Pattern::new(1280, 720, 100_000))));
    bus.add(Arc::new(Mutex::new(evk4)));
    let davis = Davis346::new(
        Davis346Options::default(),
        Box::new(Pattern::new(346, 260, 50_000)),
        Box::new(PatternFrames::new()),
    );
    bus.add(Arc::new(Mutex::new(davis)));
    Arc::new(bus)
}

pub fn options(opener: impl OpenSession + 'static) -> Options {
    Options {
        info: SessionInfo { rig: "test".into(), ..SessionInfo::default() },
        flush_every: Duration::from_millis(5),
        reserve_bytes: 0,
        folder: std::env::temp_dir(),
        opener: Box::new(opener),
        subscriber: None,
        before: None,
        after: None,
        rig_file: None,
    }
}

/// A recorder of one puppet onto a disk of the test's.
pub fn one(queue_bytes: usize) -> (Recorder, Handle, Arc<Disk>) {
    let (puppet, handle) = Puppet::new("one", 0);
    let disk = Arc::new(Disk::default());
    let recorder = Recorder::new(vec![puppet.input(queue_bytes)], options(Opener(Arc::clone(&disk)))).unwrap();
    (recorder, handle, disk)
}
