//! A rig of emulated devices on this machine's clock, and how it is tested.

use std::{
    path::Path,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering::SeqCst},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use erfgs_hardware_mocks::{
    trigger::{Clock as BoardClock, Faults as BoardFaults, Line, PtyBoard},
    usb::{
        Davis346, Davis346Options, Evk4, Evk4Options, Fault, FaultKind, Faults, Plug, TriggerLine, U3v, U3vFaults,
        U3vOptions, UsbDevice,
        evk4::Stimulus,
        scene::{Pattern, PatternFrames},
    },
};
use erfgs_recorder::RigConfig;
use erfgs_rig::{host_time::host_ns, usb::Bus};
use erfgs_selftest::{Check, CheckName, Options, Report, Verdict, run};
use tempfile::TempDir;

use crate::bus::{Clock, EmulatedBus};

/// This machine's clock; drivers do not wait for sensors to settle, which are emulated.
struct Hasty;

impl Clock for Hasty {
    fn now_ns(&self) -> i64 {
        host_ns()
    }

    fn pass(&self, duration: Duration) {
        thread::sleep(duration.min(Duration::from_millis(2)));
    }
}

/// Event cameras hold back what they see for so long, so that the edges of a busy board still come in time.
const LATENCY_NS: i64 = 100_000_000;
/// Few transfers: the memory for them is this machine's.
const STREAM: &str = "stream = { transfers = 4, transfer_bytes = 65536 }";

/// Devices, the wires between them, and their rig file.
pub struct Bench {
    folder: TempDir,
    bus: Arc<EmulatedBus>,
    text: String,
    /// From the board to event cameras, and to frame cameras.
    pub events: TriggerLine,
    pub frames: TriggerLine,
    board: Option<(Arc<PtyBoard>, Arc<AtomicBool>, JoinHandle<()>)>,
}

impl Bench {
    pub fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            bus: Arc::new(EmulatedBus::new(Arc::new(Hasty))),
            text: String::new(),
            events: TriggerLine::new(),
            frames: TriggerLine::new(),
            board: None,
        }
    }

    fn plug(&self, device: impl UsbDevice + 'static, cable: &[(u64, FaultKind)]) {
        let schedule = cable.iter().map(|(at_ms, kind)| Fault { at_ms: *at_ms, kind: kind.clone() }).collect();
        let faults = Faults { schedule, ..Faults::default() };
        self.bus.add(Arc::new(Mutex::new(Plug::new(device, &faults))));
    }

    /// A table of the rig file.
    pub fn write(&mut self, table: &str) {
        self.text.push_str(table);
        self.text.push('\n');
    }

    /// The rig file asks for another device than the one that is there.
    pub fn rename(&mut self, from: &str, to: &str) {
        assert!(self.text.contains(from));
        self.text = self.text.replace(from, to);
    }

    /// Another program has the devices.
    pub fn hold(&self) -> Vec<erfgs_recorder::Input> {
        let rig = RigConfig::parse(&self.text, Path::new("RIG.toml")).unwrap();
        erfgs_recorder::open_on(&rig, &(Arc::clone(&self.bus) as Arc<dyn Bus>)).unwrap()
    }

    /// An EVK4 at a wire, that sees a pattern.
    pub fn evk4(&mut self, id: &str, serial: u32, options: Evk4Options, cable: &[(u64, FaultKind)]) {
        self.write(&format!("[[evk4]]\nid = \"{id}\"\nserial = \"{serial:08x}\"\n{STREAM}"));
        let options = Evk4Options { serial, latency_ns: LATENCY_NS, ..options };
        self.plug(Evk4::new(options, Stimulus::Scene(Box::new(Pattern::new(1280, 720, 50_000)))), cable);
    }

    /// A DAVIS346 at a wire, that sees patterns.
    pub fn davis(&mut self, id: &str, more: &str, options: Davis346Options, cable: &[(u64, FaultKind)]) {
        self.write(&format!("[[davis346]]\nid = \"{id}\"\nframes = {{ enabled = false }}\n{STREAM}\n{more}"));
        let options = Davis346Options { latency_ns: LATENCY_NS, ..options };
        let pictures = Box::new(PatternFrames::new());
        self.plug(Davis346::new(options, Box::new(Pattern::new(346, 260, 20_000)), pictures), cable);
    }

    /// A USB3 Vision camera of 40 frames a second.
    pub fn u3v(&mut self, id: &str, more: &str, genicam: &str, options: U3vOptions, cable: &[(u64, FaultKind)]) {
        self.write(&format!(
            "[[camera]]\nid = \"{id}\"\ncamera = \"{}\"\nbackend = \"u3v\"\nformat = \"grey8\"\nwidth = 64\nheight = 48\n\
             rate_hz = 40.0\nexposure_us = 2000\n{more}\n[camera.genicam]\ntransfers = 8\n{genicam}",
            options.serial
        ));
        self.plug(U3v::new(options, Box::new(PatternFrames::default())), cable);
    }

    /// A free USB3 Vision camera with faults.
    pub fn free(&mut self, faults: U3vFaults, cable: &[(u64, FaultKind)]) {
        self.u3v("free", "", "", U3vOptions { faults, ..U3vOptions::default() }, cable);
    }

    /// A USB3 Vision camera that waits for the board.
    pub fn triggered(&mut self) {
        let options =
            U3vOptions { serial: "U3V00077".into(), trigger: Some(self.frames.clone()), ..U3vOptions::default() };
        self.u3v("mono", "triggered = true", "trigger_line = \"Line0\"", options, &[]);
    }

    /// A trigger board of 40 pulses a second. `wire`: what becomes of its edges on the way, `true` for one that rises.
    pub fn board(&mut self, clock: BoardClock, faults: BoardFaults, wire: fn(bool) -> Option<bool>) {
        let port = self.folder.path().join("board");
        self.write(&format!(
            "[[trigger]]\nid = \"board\"\nport = \"{}\"\nrate_hz = 40.0\nexposure_us = 3000.0",
            port.display()
        ));
        let board = Arc::new(PtyBoard::plug(&port, clock, faults).unwrap());
        // A moment after it has power: what comes over the wires a bit late comes to all alike.
        let plugged_ns = host_ns();
        let stop = Arc::new(AtomicBool::new(false));
        let (events, frames) = (self.events.clone(), self.frames.clone());
        let (of_thread, stopping) = (Arc::clone(&board), Arc::clone(&stop));
        let thread = thread::spawn(move || {
            while !stopping.load(SeqCst) {
                for edge in of_thread.with(|board| board.take_edges()) {
                    let at_ns = plugged_ns + edge.at_ns;
                    match edge.line {
                        Line::Events => wire(edge.rising).into_iter().for_each(|rising| events.push(at_ns, rising)),
                        Line::Frame(1) => frames.push(at_ns, edge.rising),
                        Line::Frame(_) => {}
                    }
                }
                thread::sleep(Duration::from_millis(1));
            }
        });
        self.board = Some((board, stop, thread));
    }

    pub fn sound_board(&mut self, faults: BoardFaults) {
        self.board(BoardClock { ppm: -38.0, drift_ppm_per_minute: 0.2 }, faults, Some);
    }

    /// Tests the rig, with recordings of so many milliseconds.
    pub fn test(self, milliseconds: u64) -> Tested {
        let rig = RigConfig::parse(&self.text, Path::new("RIG.toml")).unwrap();
        let Self { folder, bus, board, .. } = self;
        let bus: Arc<dyn Bus> = bus;
        let never = AtomicBool::new(false);
        let options = Options { length: Duration::from_millis(milliseconds), keep: None, stop: &never };
        let report = run(&rig, &bus, &options, &mut |_| {}).unwrap();
        if let Some((board, stop, thread)) = board {
            stop.store(true, SeqCst);
            thread.join().unwrap();
            drop(board);
        }
        Tested { report, _folder: folder }
    }
}

/// A rig that was tested.
pub struct Tested {
    pub report: Report,
    _folder: TempDir,
}

/// A device, a check of it, and its verdict.
pub type Complaint = (String, CheckName, Verdict);

/// What is not right.
pub fn complaints(checks: &[Check]) -> Vec<Complaint> {
    let bad = checks.iter().filter(|check| check.verdict > Verdict::Ok);
    bad.map(|check| (check.device.clone(), check.check, check.verdict)).collect()
}

/// What a check says of a device.
pub fn check_of<'a>(checks: &'a [Check], device: &str, name: CheckName) -> Option<&'a Check> {
    checks.iter().find(|check| (check.device.as_str(), check.check) == (device, name))
}

impl Tested {
    pub fn complaints(&self) -> Vec<Complaint> {
        complaints(&self.report.checks)
    }

    pub fn verdict(&self, device: &str, name: CheckName) -> Option<Verdict> {
        check_of(&self.report.checks, device, name).map(|check| check.verdict)
    }

    pub fn found(&self, device: &str, name: CheckName) -> &str {
        check_of(&self.report.checks, device, name).map_or("", |check| check.found.as_str())
    }

    /// All lines, for a message of a test that fails.
    pub fn lines(&self) -> String {
        let line = |check: &Check| {
            format!("{} {} {}: {}\n", check.verdict.name(), check.device, check.check.name(), check.found)
        };
        self.report.checks.iter().map(line).collect()
    }

    /// Exactly these checks complain, of `device`.
    pub fn complain(&self, device: &str, expected: &[(CheckName, Verdict)]) {
        let expected: Vec<Complaint> =
            expected.iter().map(|(check, verdict)| (device.to_owned(), *check, *verdict)).collect();
        assert_eq!(self.complaints(), expected, "\n{}", self.lines());
    }
}
