//! Kills a recording process 200 times at random moments while it records, and reads what it leaves: everything that was
//! flushed is there, byte for byte and without gaps; at most the last second is missing; completed recordings are whole.
//!
//! The process is this program itself, started with `record`: the recorder and its file as in `erfgs record`, with sources
//! that need no device. It says on its standard output which files it begins, and what it flushed.

use std::{
    collections::BTreeMap,
    env, fs,
    io::{BufRead, BufReader, Read, Write},
    path::Path,
    process::{Command, ExitCode, Stdio},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::Duration,
};

use bytes::Bytes;
use erfgs_events::EventEncoding;
use erfgs_recorder::{
    Input, OpenSession, Options, Recorder, SessionFiles, SessionInfo, SessionSink, SinkError, Status,
};
use erfgs_rig::host_time::host_ns;
use erfgs_session::{
    container::{Entry, Session, Split, part_path, parts_beside, recover, recover_in_place},
    source::{Counters, Description, Encoding, Incident, Outlet, Packet, Source, SourceError},
};

const KILLS: u64 = 200;
const AT_ONCE: usize = 4;
const STREAMS: usize = 2;
const FLUSH: Duration = Duration::from_millis(250);
/// What a kill may cost, nanoseconds.
const LOSS_NS: i64 = 1_000_000_000;

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        [_, "record", folder, take_ms, part_ms] => {
            record(Path::new(folder), take_ms.parse().unwrap(), part_ms.parse().unwrap());
        }
        // Test runners ask for the list of tests.
        [_, rest @ ..] if rest.contains(&"--list") => println!("sessions_survive_200_kills: test"),
        _ => sessions_survive_200_kills(),
    }
    ExitCode::SUCCESS
}

// The process that is killed -----------------------------------------------------------------------------------------

/// Records one take after another, each `take_ms` long, in parts of `part_ms` (0: whole), until killed.
fn record(folder: &Path, take_ms: u64, part_ms: i64) {
    let inputs = (0..STREAMS).map(|stream| Input {
        source: Box::new(Ticker::new(stream)),
        queue_bytes: 64 << 20,
        stall_after: None,
    });
    let options = Options {
        info: SessionInfo::default(),
        flush_every: FLUSH,
        reserve_bytes: 0,
        folder: folder.into(),
        opener: Box::new(Telling((part_ms > 0).then_some(Split::Time(part_ms * 1_000_000)))),
        subscriber: None,
        before: None,
        after: None,
        rig_file: None,
    };
    let recorder = Recorder::new(inputs.collect(), options).unwrap();
    for take in 0.. {
        recorder.start_recording(&folder.join(format!("{take}.mcap"))).unwrap();
        if take == 0 {
            recorder.start_sources().unwrap();
        }
        thread::sleep(Duration::from_millis(take_ms));
        let summary = recorder.stop_recording("the take is over").unwrap();
        assert!(summary.failure.is_none() && summary.drops() == 0, "{summary:?}");
        tell(&format!("ended {take} {}\n", summary.streams.iter().map(|stream| stream.written).sum::<u64>()));
    }
}

/// One write, so that a kill cuts no line but the last.
fn tell(line: &str) {
    std::io::stdout().lock().write_all(line.as_bytes()).unwrap();
    std::io::stdout().flush().unwrap();
}

/// Delivers a packet every millisecond.
struct Ticker(Description);

impl Ticker {
    fn new(stream: usize) -> Self {
        Self(Description {
            id: format!("s{stream}"),
            model: "ticker".into(),
            serial: String::new(),
            encoding: Encoding::Events(EventEncoding::Evt3),
            width: 640,
            height: 480,
            start_order: 0,
            settings: serde_json::Map::new(),
        })
    }
}

fn payload(sequence: u64) -> Vec<u8> {
    sequence.to_le_bytes().repeat(1 + (sequence % 400) as usize)
}

impl Source for Ticker {
    fn description(&self) -> &Description {
        &self.0
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        thread::spawn(move || {
            for sequence in 0.. {
                let payload = Bytes::from(payload(sequence));
                let host_ns = host_ns();
                outlet.send(Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload });
                thread::sleep(Duration::from_millis(1));
            }
        });
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        Ok(())
    }

    fn counters(&self) -> Counters {
        Counters::default()
    }
}

/// Session files whose writer tells what it has written, and what it has flushed.
struct Telling(Option<Split>);

impl OpenSession for Telling {
    fn open(
        &self,
        path: &Path,
        info: &SessionInfo,
        streams: &[Description],
    ) -> Result<Box<dyn SessionSink>, SinkError> {
        let take = path.file_stem().unwrap().to_str().unwrap().to_owned();
        tell(&format!("begun {take}\n"));
        let sink = SessionFiles { split: self.0, ..SessionFiles::default() }.open(path, info, streams)?;
        Ok(Box::new(Teller { take, sink, last: [None; STREAMS] }))
    }
}

struct Teller {
    take: String,
    sink: Box<dyn SessionSink>,
    last: [Option<u64>; STREAMS],
}

impl SessionSink for Teller {
    fn packet(&mut self, stream: usize, packet: &Packet) -> Result<(), SinkError> {
        self.sink.packet(stream, packet)?;
        self.last[stream] = Some(packet.sequence);
        tell(&format!("taken {} {}\n", self.take, packet.host_ns));
        Ok(())
    }

    fn incident(&mut self, stream: Option<usize>, host_ns: i64, incident: &Incident) -> Result<(), SinkError> {
        self.sink.incident(stream, host_ns, incident)
    }

    fn status(&mut self, status: &Status) -> Result<(), SinkError> {
        self.sink.status(status)
    }

    fn flush(&mut self) -> Result<(), SinkError> {
        self.sink.flush()?;
        for (stream, last) in self.last.iter().enumerate() {
            if let Some(last) = last {
                tell(&format!("flushed {} {stream} {last}\n", self.take));
            }
        }
        Ok(())
    }

    fn bytes_written(&self) -> u64 {
        self.sink.bytes_written()
    }

    fn finish(self: Box<Self>) -> Result<u64, SinkError> {
        self.sink.finish()
    }
}

// The one that kills and reads ---------------------------------------------------------------------------------------

/// What the process said of one take.
#[derive(Debug, Default)]
struct Progress {
    flushed: [Option<u64>; STREAMS],
    first_ns: Option<i64>,
    taken_ns: Option<i64>,
    ended: Option<u64>,
}

/// What came of the kills.
#[derive(Debug, Default)]
struct Found {
    worst_ns: i64,
    recovered: u64,
    whole: u64,
    empty: u64,
    parts: usize,
}

fn sessions_survive_200_kills() {
    // Several at a time, as they mostly wait.
    let (next, found) = (AtomicU64::new(0), Mutex::new(Found::default()));
    thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                loop {
                    let kill = next.fetch_add(1, Ordering::Relaxed);
                    if kill >= KILLS {
                        return;
                    }
                    kill_and_look(kill, &found);
                }
            });
        }
    });
    let Found { worst_ns, recovered, whole, empty, parts } = found.into_inner().unwrap();
    println!(
        "{KILLS} kills: {recovered} takes recovered, {whole} completed ones whole, {empty} files without a byte, {parts} further parts; at most {:.0} ms lost",
        worst_ns as f64 / 1e6
    );
    assert!(parts as u64 > KILLS, "too few files were changed to mean anything");
    assert!(recovered >= KILLS * 2 / 3, "too few kills hit a recording to mean anything");
}

fn kill_and_look(kill: u64, found: &Mutex<Found>) {
    let folder = tempfile::tempdir().unwrap();
    // Most kills come within a tenth of a second of the first file's beginning, one of sixteen after more than one;
    // half of the processes complete a take every few milliseconds, so that kills hit beginnings and ends too.
    let random = kill.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
    let after_ms = if kill % 16 == 7 { 1100 + random % 500 } else { random % 100 };
    let take_ms = if kill.is_multiple_of(2) { "25" } else { "60000" };
    // A third of them change files every few milliseconds.
    let part_ms = if kill % 3 == 2 { 3 } else { 0 };
    let takes = record_and_kill(folder.path(), take_ms, part_ms, Duration::from_millis(after_ms));
    let is_first = |name: String| name.matches('.').count() == 1;
    let names = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let files = names.filter(|name| is_first(name.clone())).count();
    let last = takes.keys().next_back().unwrap();
    assert!(files as u64 == last + 1 || files as u64 == *last, "kill {kill}: {files} files, {last} was begun last");
    for (take, progress) in &takes {
        let path = folder.path().join(format!("{take}.mcap"));
        // Killed between saying so and making the file, or between that and its first bytes.
        if progress.taken_ns.is_none() && fs::metadata(&path).map_or(0, |file| file.len()) == 0 {
            assert_eq!(take, last);
            found.lock().unwrap().empty += 1;
            continue;
        }
        let loss = if part_ms > 0 { check_parts(&path, progress) } else { check(&path, progress) };
        let loss = loss.unwrap_or_else(|wrong| panic!("kill {kill}, take {take}: {wrong}\n{progress:?}"));
        let mut found = found.lock().unwrap();
        found.parts += parts_beside(&path).unwrap().len();
        found.worst_ns = found.worst_ns.max(loss);
        *if progress.ended.is_some() { &mut found.whole } else { &mut found.recovered } += 1;
    }
}

fn record_and_kill(folder: &Path, take_ms: &str, part_ms: i64, after: Duration) -> BTreeMap<u64, Progress> {
    let mut child = Command::new(env::current_exe().unwrap())
        .args(["record", folder.to_str().unwrap(), take_ms, &part_ms.to_string()])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let mut text = String::new();
    stdout.read_line(&mut text).unwrap();
    let reader = thread::spawn(move || {
        stdout.read_to_string(&mut text).unwrap();
        text
    });
    thread::sleep(after);
    // SIGKILL.
    child.kill().unwrap();
    let status = child.wait().unwrap();
    assert!(status.code().is_none(), "the recorder ended by itself: {status}");
    let text = reader.join().unwrap();
    let mut takes: BTreeMap<u64, Progress> = BTreeMap::new();
    let complete = text.rsplit_once('\n').map_or("", |(complete, _)| complete);
    for line in complete.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let take = takes.entry(words[1].parse().unwrap()).or_default();
        match words[0] {
            "begun" => {}
            "taken" => {
                take.taken_ns = Some(words[2].parse().unwrap());
                take.first_ns = take.first_ns.or(take.taken_ns);
            }
            "flushed" => take.flushed[words[2].parse::<usize>().unwrap()] = Some(words[3].parse().unwrap()),
            "ended" => take.ended = Some(words[2].parse().unwrap()),
            other => panic!("unexpected line: {other}"),
        }
    }
    takes
}

/// Repairs and reads a take.
fn check(path: &Path, progress: &Progress) -> Result<i64, String> {
    let repaired = path.with_extension("repaired.mcap");
    let done = recover(path, &repaired).map_err(|error| error.to_string())?;
    if progress.ended.is_some() && !done.was_whole {
        return Err("a completed take needed repair".into());
    }
    let loss = read(if done.was_whole { path } else { &repaired }, progress, true);
    fs::remove_file(&repaired).ok();
    loss
}

/// Reads a take in parts as it was left, repairs its files, and reads it again.
fn check_parts(first: &Path, progress: &Progress) -> Result<i64, String> {
    let loss = read(first, progress, progress.ended.is_some())?;
    let files = parts_beside(first).map_err(|error| error.to_string())?.len() as u32;
    for part in 0..=files {
        let path = part_path(first, part);
        match recover_in_place(&path) {
            Ok(done) if progress.ended.is_some() && !done.was_whole => {
                return Err("a completed take needed repair".into());
            }
            Ok(_) => {}
            // Killed before anything was in it.
            Err(_) if part == files && part > 0 => fs::remove_file(&path).map_err(|error| error.to_string())?,
            Err(error) => return Err(error.to_string()),
        }
    }
    let again = read(first, progress, false)?;
    if again == loss { Ok(loss) } else { Err(format!("{again} ns are lost after the repair, {loss} before")) }
}

/// Reads a take. Gives the time between the last packet that the writer took and the last one in the file.
fn read(path: &Path, progress: &Progress, complete: bool) -> Result<i64, String> {
    let mut session = Session::open(path).map_err(|error| error.to_string())?;
    if complete && !session.summary().complete {
        return Err(format!("the take is not complete: {:?}", session.summary().faults()));
    }
    let (mut next, mut count, mut last_ns) = ([None; STREAMS], 0, i64::MIN);
    for entry in session.messages(None) {
        let Entry::Packet { stream, packet } = entry.map_err(|error| error.to_string())? else { continue };
        if next[stream].is_some_and(|next| next != packet.sequence) {
            return Err(format!("stream {stream} has a gap before packet {}", packet.sequence));
        }
        if packet.payload != payload(packet.sequence) {
            return Err(format!("packet {} of stream {stream} is damaged", packet.sequence));
        }
        next[stream] = Some(packet.sequence + 1);
        last_ns = last_ns.max(packet.host_ns);
        count += 1;
    }
    for (stream, flushed) in progress.flushed.iter().enumerate() {
        if flushed.is_some_and(|flushed| next[stream].is_none_or(|next| next <= flushed)) {
            return Err(format!("stream {stream} lacks flushed packets: it ends before {:?}", next[stream]));
        }
    }
    if progress.ended.is_some_and(|ended| ended != count) {
        return Err(format!("{count} packets are in a completed take"));
    }
    let Some(taken_ns) = progress.taken_ns else { return Ok(0) };
    let loss = taken_ns - if count > 0 { last_ns } else { progress.first_ns.unwrap_or(taken_ns) };
    if loss > LOSS_NS { Err(format!("{loss} ns are lost")) } else { Ok(loss) }
}
