//! `erfgs record`: a rig into a session file.

mod hosts;

use std::{
    io::{IsTerminal, Write},
    net::{SocketAddr, TcpListener},
    path::{Path, PathBuf},
    sync::{Arc, OnceLock, Weak, atomic::Ordering},
    thread,
    time::{Duration, Instant},
};

use anyhow::Context;
use erfgs_recorder as record;
use erfgs_recorder::{
    Alarm, AlarmKind, Before, Input, Level, MachineFacts, Message, Options, RecordConfig, RecordError, Recorder,
    RigConfig, SessionFiles, SessionInfo, Status, Summary, folder_of,
    hosts::{HostView, Hosts},
    live::{LivePage, Monitor, MonitorOptions, PageOptions},
    preflight::{self, Finding, Plan, Verdict},
};
use erfgs_session::{container::Settings, source::Description};
use serde::Serialize;

use crate::{
    errors::{Stopped, Usage},
    interrupt,
    progress::duration,
    quick,
    terminal::{Terminal, bytes, table, thousands},
};

/// No recording lasts longer, seconds: 31 years.
const LONGEST_S: f64 = 1e9;
/// Between two status lines: on a terminal, elsewhere.
const LINE: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(10)];

/// Record a rig of cameras into a session file.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs record --example > RIG.toml              start from the annotated example
  erfgs record RIG.toml --out take1.mcap         until Ctrl-C
  erfgs record RIG.toml --out take1.mcap --seconds 30 --live
  erfgs record RIG.toml --out takes/ --wait --live 0.0.0.0:8100
  erfgs record RIG.toml --out takes/ --before 5 --after 2 --live       Enter or the page keeps the last 5 s and 2 s more
  erfgs record RIG.toml --out takes/ --before 1 --after 1 --on rate:4  as does a rise of an event camera's rate
  erfgs record RIG.toml --out boards.mcap --live --quick chessboard:9x6:0.025

Examples: several hosts with one trigger board
  erfgs record right.toml --out takes/ --wait --live 0.0.0.0:8100      on each of the others: it prints the link
  erfgs record left.toml --out take1.mcap --seconds 30 --with 'http://right:8100/?token=TOKEN'
  erfgs record left.toml --out takes/ --wait --live --with hosts.txt   one page for all; a link a line

With --live a web page shows every camera, rates, drops, clocks and the disk, and starts and stops recordings in the folder \
of --out. Every request needs a token, which is part of the printed link.

Exit codes: 0 recorded, 1 a device or the disk failed (what was recorded stays readable), 2 wrong usage, 130 stopped by \
Ctrl-C before --seconds were over. docs/guide/recording.md says what the numbers mean and what to do about drops.")]
pub struct Arguments {
    /// The rig: which devices, with which settings.
    #[arg(value_name = "RIG.toml", required_unless_present = "example")]
    rig: Option<PathBuf>,
    /// The session file to write; with --wait, the folder for recordings.
    #[arg(long, value_name = "S.mcap", required_unless_present = "example")]
    out: Option<PathBuf>,
    /// Stop after this many seconds.
    #[arg(long, value_name = "N", conflicts_with = "wait")]
    seconds: Option<f64>,
    /// Serve the live page.
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = "127.0.0.1:8100")]
    live: Option<SocketAddr>,
    /// A host name under which the live page may be opened, besides `localhost` and IP addresses.
    #[arg(long, value_name = "NAME", requires = "live")]
    live_name: Vec<String>,
    /// Let every user of this machine use the live page without a token: watch, start, stop and download.
    #[arg(long, requires = "live")]
    open: bool,
    /// Only show the cameras; record when the live page says so.
    #[arg(long, requires = "live")]
    wait: bool,
    /// Keep the last seconds in memory and write them only on a trigger: Enter, the live page or --on. Each recording starts
    /// with the kept seconds; its file in the folder --out is named after the rig and the time.
    #[arg(long, value_name = "SECONDS", value_parser = held, conflicts_with = "seconds")]
    before: Option<f64>,
    /// End such a recording this many seconds after its trigger. Default: it runs until the page or Enter stops it.
    #[arg(long, value_name = "SECONDS", value_parser = held, requires = "before")]
    after: Option<f64>,
    /// Record together with another host: the link of its live page (run it with --wait), or a file with one link a line,
    /// which hides the tokens from other users of this machine. May be given more than once. The other hosts start first and
    /// stop with this one; the page shows their cameras, too.
    #[arg(long, value_name = "URL", conflicts_with = "before")]
    with: Vec<hosts::With>,
    /// Another trigger of --before. rate:TIMES: the data rate of an event camera rises above TIMES its mean over the last
    /// two seconds. edge: the trigger input of an event camera rises. edge:ID: that of this camera. May be given twice.
    #[arg(long, value_name = "RISE", value_parser = alarm, requires = "before")]
    on: Vec<AlarmKind>,
    #[command(flatten)]
    quick: quick::QuickOptions,
    /// Measure the speed of the disk for this many seconds before the recording; 0 skips it.
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = disk_test, conflicts_with = "no_preflight")]
    disk_test: f64,
    /// Skip the checks of disk, buses and memory.
    #[arg(long)]
    no_preflight: bool,
    /// Print an annotated RIG.toml with every field, and do nothing else.
    #[arg(long, exclusive = true)]
    example: bool,
}

fn held(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok().filter(|seconds| (0.01..=3600.0).contains(seconds));
    seconds.ok_or_else(|| "write 0.01 to 3600 seconds".into())
}

fn alarm(text: &str) -> Result<AlarmKind, String> {
    let wrong = || "write rate:TIMES with a number above 1, edge, or edge:ID".to_owned();
    match text.split_once(':') {
        None if text == "edge" => Ok(AlarmKind::Edge(None)),
        Some(("edge", id)) if record::is_id(id) => Ok(AlarmKind::Edge(Some(id.to_owned()))),
        Some(("rate", times)) => {
            let times = times.parse::<f64>().ok().filter(|times| *times > 1.0 && times.is_finite());
            times.map(AlarmKind::Rate).ok_or_else(wrong)
        }
        _ => Err(wrong()),
    }
}

fn disk_test(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok().filter(|seconds| (0.0..=60.0).contains(seconds));
    seconds.ok_or_else(|| "write 0 to 60 seconds".into())
}

/// Records.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    if arguments.example {
        return terminal
            .result(&serde_json::json!({ "example": RigConfig::EXAMPLE }), || RigConfig::EXAMPLE.to_owned());
    }
    let (Some(rig), Some(out)) = (&arguments.rig, &arguments.out) else {
        return Err(Usage("give a RIG.toml and --out".into()).into());
    };
    if let Some(seconds) = arguments.seconds.filter(|seconds| !(*seconds > 0.0 && *seconds < LONGEST_S)) {
        let what = format!("--seconds {seconds}: write a number above 0 and below {LONGEST_S}, or leave it out");
        return Err(Usage(what).into());
    }
    let waits = arguments.wait || arguments.before.is_some();
    named_as_it_will_be(out, waits)?;
    let folder = if waits { out.clone() } else { folder_of(out) };
    if !waits && out.exists() {
        return Err(Usage(format!("'{}' exists already: recordings are never overwritten", out.display())).into());
    }
    let path = rig;
    let rig = RigConfig::load(path)?;
    if rig.devices.is_empty() {
        let path = path.display();
        let what = format!(
            "{path} names no devices: add [[evk4]], [[davis346]], [[camera]] or others (erfgs record --example)"
        );
        return Err(Usage(what).into());
    }
    let listener = arguments.live.map(LivePage::listen).transpose()?;
    let hosts = hosts::connect(&arguments.with, terminal)?;
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder '{}'", folder.display()))?;
    terminal.note(format!("opening {} devices", rig.devices.len()));
    let inputs = record::open(&rig)?;
    let streams: Vec<Description> = inputs.iter().map(|input| input.source.description().clone()).collect();
    let findings =
        if arguments.no_preflight { Vec::new() } else { check(arguments, terminal, &rig, &inputs, &streams, &folder)? };
    let share = if arguments.live.is_some() { 0.25 } else { 0.05 };
    let monitor = Monitor::new(&streams, MonitorOptions { share, ..MonitorOptions::default() })?;
    arguments.quick.start(&streams, &monitor)?;
    let mut options = options(&rig.record, info(&rig, &findings), folder, &monitor);
    options.before = arguments.before.map(|seconds| before(&rig.record, seconds));
    options.after = arguments.after.map(Duration::from_secs_f64);
    options.rig_file = Some(path.clone());
    let told = Arc::new(OnceLock::new());
    if !arguments.on.is_empty() {
        if let Some(id) = unknown(&arguments.on, &streams) {
            return Err(Usage(format!("--on edge:{id}: the rig has no event camera of that name")).into());
        }
        options.subscriber = Some(Arc::new(Alarm::new(
            &streams,
            arguments.on.clone(),
            options.subscriber.take(),
            keep_on_alarm(&told),
        )?));
    }
    let recorder = Arc::new(Recorder::new(inputs, options)?);
    let _ = told.set(Arc::downgrade(&recorder));
    if let Some(hosts) = &hosts {
        hosts.lead(&recorder);
    }
    record_until_told(arguments, terminal, &recorder, monitor, listener, hosts, out)
}

/// How much of the past is held.
fn before(record: &RecordConfig, seconds: f64) -> Before {
    Before { span: Duration::from_secs_f64(seconds), bytes: record.before_mib << 20 }
}

/// A stream that an alarm names and that is no event camera of the rig.
fn unknown<'a>(kinds: &'a [AlarmKind], streams: &[Description]) -> Option<&'a str> {
    let known = |id: &str| streams.iter().any(|stream| stream.id == id && stream.encoding.is_events());
    kinds.iter().find_map(|kind| match kind {
        AlarmKind::Edge(Some(id)) if !known(id) => Some(id.as_str()),
        _ => None,
    })
}

/// Called with a stream and what was detected in it.
type OnAlarm = Box<dyn Fn(&str, &str) + Send>;

/// Keeps the past of a recorder, once there is one, at an alarm.
fn keep_on_alarm(recorder: &Arc<OnceLock<Weak<Recorder>>>) -> OnAlarm {
    let recorder = Arc::clone(recorder);
    Box::new(move |stream, what| {
        let Some(recorder) = recorder.get().and_then(Weak::upgrade) else { return };
        match recorder.keep_past(recorder.after()) {
            Ok(_) => recorder.say(Level::Info, stream, format!("{what}: the past is kept")),
            // A recording that runs keeps it anyway.
            Err(RecordError::Busy(_)) => {}
            Err(error) => recorder.say(Level::Error, stream, error.to_string()),
        }
    })
}

/// Enter keeps the past; where a recording runs without an end, it ends it.
fn keep_at_enter(recorder: &Arc<Recorder>) -> std::io::Result<()> {
    let recorder = Arc::downgrade(recorder);
    // Nothing waits for this thread: it ends with its input, or with the program.
    thread::Builder::new().name("enter".into()).spawn(move || {
        for line in std::io::stdin().lines() {
            let (Ok(_), Some(recorder)) = (line, recorder.upgrade()) else { return };
            if recorder.is_recording() && recorder.after().is_none() {
                let _ = recorder.stop_recording("stopped by Enter");
            } else if let Err(error) = recorder.keep_past(recorder.after()) {
                recorder.say(Level::Error, "", error.to_string());
            }
        }
    })?;
    Ok(())
}

/// Refuses a name that would surprise: a folder that looks like a session, or a session that no command would take for one.
fn named_as_it_will_be(out: &Path, is_folder: bool) -> Result<(), Usage> {
    let is_session = out.extension().is_some_and(|extension| extension == "mcap");
    let shown = out.display();
    match (is_folder, is_session) {
        (true, true) if !out.is_dir() => {
            let folder = out.with_extension("");
            Err(Usage(format!(
                "with --wait and --before, --out is a folder, and '{shown}' is the name of a session: write --out {}",
                folder.display()
            )))
        }
        (false, false) => {
            let named = out.with_extension("mcap");
            Err(Usage(format!("'{shown}' is not named as a session: write --out {}", named.display())))
        }
        _ => Ok(()),
    }
}

fn info(rig: &RigConfig, findings: &[Finding]) -> SessionInfo {
    let warnings = findings.iter().filter(|finding| finding.verdict > Verdict::Good);
    SessionInfo {
        rig: rig.name.clone(),
        replay: false,
        configuration: rig.text.clone(),
        program: concat!("erfgs ", env!("CARGO_PKG_VERSION")).into(),
        machine: MachineFacts::gather(),
        warnings: warnings.map(|finding| format!("{}: {}", finding.check, finding.says)).collect(),
        begin_host_ns: None,
    }
}

/// How `record` has it: into session files in `folder`, watched by `monitor`.
pub fn options(record: &RecordConfig, info: SessionInfo, folder: PathBuf, monitor: &Arc<Monitor>) -> Options {
    let settings = Settings { chunk_bytes: record.chunk_mib << 20, crc: record.checksums, ..Settings::default() };
    Options {
        info,
        flush_every: Duration::from_millis(record.flush_ms),
        reserve_bytes: record.reserve_mib << 20,
        folder,
        opener: Box::new(SessionFiles { settings }),
        subscriber: Some(Arc::clone(monitor) as _),
        before: None,
        after: None,
        rig_file: None,
    }
}

/// The checks before a recording.
fn check(
    arguments: &Arguments,
    terminal: &Terminal,
    rig: &RigConfig,
    inputs: &[Input],
    streams: &[Description],
    folder: &Path,
) -> anyhow::Result<Vec<Finding>> {
    let plan = Plan {
        streams,
        folder,
        duration: arguments.seconds.map(Duration::from_secs_f64),
        reserve_bytes: rig.record.reserve_mib << 20,
        queue_bytes: inputs.iter().map(|input| input.queue_bytes as u64).sum::<u64>()
            + arguments.before.map_or(0, |seconds| before(&rig.record, seconds).bytes),
        disk_test: Duration::from_secs_f64(arguments.disk_test),
    };
    let findings = preflight::check(&plan);
    for finding in &findings {
        let mark = match finding.verdict {
            Verdict::Good => "ok     ",
            Verdict::Warning => "WARNING",
            Verdict::Refusal => "REFUSED",
        };
        let remedy = if finding.remedy.is_empty() { String::new() } else { format!(". {}", capital(&finding.remedy)) };
        terminal.note(format!("{mark} {}: {}{remedy}", finding.check, finding.says));
    }
    if preflight::worst(&findings) == Verdict::Refusal {
        anyhow::bail!("this rig would lose data (see above); --no-preflight records anyway");
    }
    Ok(findings)
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn record_until_told(
    arguments: &Arguments,
    terminal: &Terminal,
    recorder: &Arc<Recorder>,
    monitor: Arc<Monitor>,
    listener: Option<TcpListener>,
    hosts: Option<Arc<Hosts>>,
    out: &Path,
) -> anyhow::Result<()> {
    let stop = interrupt::stop_flag("the session is being completed")?;
    let page = match (arguments.live, listener) {
        (Some(address), Some(listener)) => {
            let options = PageOptions { address, names: arguments.live_name.clone(), open: arguments.open };
            Some(LivePage::serve_at(listener, Arc::clone(recorder), monitor, &options)?)
        }
        _ => None,
    };
    if let Some(page) = &page {
        terminal.note(format!("live page: {}", page.url()));
        if let Some(hosts) = &hosts {
            page.lead(Arc::clone(hosts));
        }
    }
    let hosts = hosts.as_deref();
    if let Some(seconds) = arguments.before {
        terminal.note(format!("the last {seconds} s are held in memory: Enter keeps them"));
        keep_at_enter(recorder)?;
    } else if !arguments.wait {
        match hosts {
            Some(hosts) => hosts.start(recorder, out, arguments.seconds.map(Duration::from_secs_f64))?,
            None => recorder.start_recording(out)?,
        }
    }
    let end = |reason| match hosts {
        Some(hosts) => hosts.stop(recorder, reason),
        None => recorder.stop_recording(reason),
    };
    if let Err(error) = recorder.start_sources() {
        // A file without a packet would only be in the way of the next try.
        let empty = end("a device did not start");
        if let Ok(summary) = empty
            && summary.streams.iter().all(|stream| stream.written == 0)
        {
            let _ = std::fs::remove_file(&summary.path);
        }
        return Err(error.into());
    }
    let begun = Instant::now();
    let mut screen = Screen::new(terminal);
    let timed_out = || arguments.seconds.is_some_and(|seconds| begun.elapsed().as_secs_f64() >= seconds);
    // With the page the cameras stay on after a recording, for the next one.
    let stays = (page.is_some() && arguments.seconds.is_none()) || arguments.before.is_some();
    let goes_on = || stays || recorder.is_recording();
    while !stop.load(Ordering::SeqCst) && !timed_out() && goes_on() {
        screen.show(&recorder.status(), &hosts.map(Hosts::views).unwrap_or_default());
        thread::sleep(Duration::from_millis(50));
    }
    let stopped = stop.load(Ordering::SeqCst);
    screen.clear();
    // Stopped sources first: what they still delivered is in the file.
    let recorded = recorder.is_recording();
    recorder.stop_sources();
    let reason = if stopped { "stopped by Ctrl-C" } else { "the time was over" };
    let summary = end(reason).ok().or_else(|| recorder.last());
    screen.messages(&recorder.messages());
    drop(page);
    let Some(summary) = summary else {
        terminal.note("nothing was recorded");
        return Ok(());
    };
    let others = hosts.map(hosts::Others::of);
    terminal.result(&Recorded { summary: &summary, others: others.as_ref() }, || {
        report(&summary) + &others.as_ref().map(hosts::Others::report).unwrap_or_default()
    })?;
    if let Some(failure) = &summary.failure {
        anyhow::bail!("{failure}");
    }
    if !recorded && !stays {
        anyhow::bail!("the recording ended early: {}", summary.reason);
    }
    if stopped && arguments.seconds.is_some() && !timed_out() {
        return Err(Stopped(format!("stopped; '{}' is complete up to here", summary.path.display())).into());
    }
    others.map_or(Ok(()), |others| others.fault())
}

/// What is told with `--json`.
#[derive(Serialize)]
struct Recorded<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    #[serde(flatten)]
    others: Option<&'a hosts::Others>,
}

/// What a recording holds, for humans.
fn report(summary: &Summary) -> String {
    let head = ["stream", "packets", "data", "dropped by driver", "queue", "writer", "most in memory"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for stream in &summary.streams {
        rows.push(vec![
            stream.id.clone(),
            thousands(stream.written),
            bytes(stream.written_bytes),
            thousands(stream.drops.driver),
            thousands(stream.drops.queue),
            thousands(stream.drops.writer),
            bytes(stream.peak_waiting_bytes),
        ]);
    }
    format!(
        "{}\n{}: {}, {}; {}\n",
        table(&rows),
        summary.path.display(),
        duration(summary.seconds),
        bytes(summary.bytes),
        summary.reason
    )
}

/// Status line and messages on stderr.
struct Screen {
    quiet: bool,
    is_terminal: bool,
    last_line: Option<Instant>,
    last_message: u64,
}

impl Screen {
    fn new(terminal: &Terminal) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        Self { quiet: terminal.is_quiet(), is_terminal, last_line: None, last_message: 0 }
    }

    fn show(&mut self, status: &Status, hosts: &[HostView]) {
        self.messages(&status.messages);
        let between = LINE[usize::from(!self.is_terminal)];
        if self.quiet || self.last_line.is_some_and(|at| at.elapsed() < between) {
            return;
        }
        self.last_line = Some(Instant::now());
        let line = line(status) + &hosts::line(hosts);
        if self.is_terminal {
            eprint!("\r\x1b[2K{line}");
            let _ = std::io::stderr().flush();
        } else {
            eprintln!("{line}");
        }
    }

    /// Prints messages that are new.
    fn messages(&mut self, messages: &[Message]) {
        let shown = self.last_message;
        for message in messages.iter().filter(|message| message.number > shown) {
            if !self.quiet || message.level == Level::Error {
                self.clear();
                let who = if message.stream.is_empty() { String::new() } else { format!("{}: ", message.stream) };
                let mark = match message.level {
                    Level::Info => "",
                    Level::Warning => "warning: ",
                    Level::Error => "ERROR: ",
                };
                eprintln!("{mark}{who}{}", message.text);
            }
        }
        self.last_message = messages.last().map_or(self.last_message, |message| message.number);
    }

    fn clear(&mut self) {
        if self.is_terminal && !self.quiet {
            eprint!("\r\x1b[2K");
        }
        self.last_line = None;
    }
}

/// `recording 12.0 s | 1.2 GiB at 412.0 MB/s | 14 streams | 21.3 Mev/s | queue 3 % | dropped 0 | disk 52 min left`
fn line(status: &Status) -> String {
    let mut parts = match &status.recording {
        Some(recording) => vec![
            format!("recording {}", duration(recording.seconds)),
            format!("{} at {:.1} MB/s", bytes(recording.bytes), recording.bytes_per_s / 1e6),
        ],
        None if status.finishing.is_some() => vec!["writing what waits".to_owned()],
        None => {
            let held = status.held.map(|held| {
                format!("holding {:.1} of {:.1} s in {}", held.seconds, held.of_seconds, bytes(held.bytes))
            });
            let what = held.unwrap_or_else(|| "not recording".to_owned());
            vec![what, format!("{:.1} MB/s", status.bytes_per_s() / 1e6)]
        }
    };
    let running = status.streams.iter().filter(|stream| stream.state == record::StreamState::Running).count();
    parts.push(format!("{running} of {} streams", status.streams.len()));
    let events: f64 = status.streams.iter().filter_map(|stream| stream.events_per_s).sum();
    if events > 0.0 {
        parts.push(format!("{:.1} Mev/s", events / 1e6));
    }
    let full = |stream: &record::StreamStatus| stream.waiting_bytes as f64 / stream.queue_bytes.max(1) as f64;
    let fullest = status.streams.iter().map(full).fold(0.0, f64::max);
    parts.push(format!("queue {:.0} %", 100.0 * fullest));
    parts.push(format!("dropped {}", thousands(status.drops())));
    if let Some(seconds) = status.disk.seconds_left {
        parts.push(format!("disk {} left", duration(seconds)));
    }
    parts.join(" | ")
}
