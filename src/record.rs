//! `erfgs record`: a rig into a session file.

mod arguments;
mod hosts;
mod past;
mod screen;

use std::{
    net::TcpListener,
    path::{Path, PathBuf},
    sync::{Arc, OnceLock, atomic::Ordering},
    thread,
    time::{Duration, Instant},
};

use erfgs_base::FileError;
use erfgs_recorder as record;
use erfgs_recorder::{
    Alarm, Input, MachineFacts, Options, RecordConfig, Recorder, RigConfig, SessionFiles, SessionInfo, folder_of,
    hosts::Hosts,
    live::{LivePage, Monitor, MonitorOptions, PageOptions},
    preflight::{self, Finding, Plan, Verdict},
};
use erfgs_session::{
    container::{Settings, Split, parts_beside},
    source::Description,
};

pub use self::arguments::Arguments;

use self::{
    past::{before, keep_at_enter, keep_on_alarm, unknown},
    screen::{Recorded, Screen, report},
};
use crate::{
    errors::{Stopped, Usage},
    interrupt,
    terminal::Terminal,
};

/// No recording lasts longer, seconds: 31 years.
const LONGEST_S: f64 = 1e9;

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
        return Err(exists(out).into());
    }
    if !waits && arguments.split.is_some() {
        // A folder that is not there yet holds none.
        if let Some((_, part)) = parts_beside(out).ok().and_then(|parts| parts.into_iter().next()) {
            return Err(exists(&part).into());
        }
    }
    let path = rig;
    let rig = load_rig(path)?;
    let listener = arguments.live.map(LivePage::listen).transpose()?;
    let hosts = hosts::connect(&arguments.with, terminal)?;
    std::fs::create_dir_all(&folder).map_err(FileError::when("make the folder", &folder))?;
    terminal.note(format!("opening {} devices", rig.devices.len()));
    let inputs = record::open(&rig)?;
    let streams: Vec<Description> = inputs.iter().map(|input| input.source.description().clone()).collect();
    let findings =
        if arguments.no_preflight { Vec::new() } else { check(arguments, terminal, &rig, &inputs, &streams, &folder)? };
    let share = if arguments.live.is_some() { 0.25 } else { 0.05 };
    let monitor = Monitor::new(&streams, MonitorOptions { share, ..MonitorOptions::default() })?;
    arguments.quick.start(&streams, &monitor)?;
    let mut options = options(&rig.record, info(&rig, &findings), folder, &monitor, arguments.split);
    options.before = arguments.before.map(|seconds| before(&rig.record, seconds));
    options.after = arguments.after.map(Duration::from_secs_f64);
    options.rig_file = Some(path.clone());
    let started = Arc::new(OnceLock::new());
    if !arguments.on.is_empty() {
        if let Some(id) = unknown(&arguments.on, &streams) {
            return Err(Usage(format!("--on edge:{id}: the rig has no event camera of that name")).into());
        }
        options.subscriber = Some(Arc::new(Alarm::new(
            &streams,
            arguments.on.clone(),
            options.subscriber.take(),
            keep_on_alarm(&started),
        )?));
    }
    let recorder = Arc::new(Recorder::new(inputs, options)?);
    let _ = started.set(Arc::downgrade(&recorder));
    if let Some(hosts) = &hosts {
        hosts.lead(&recorder);
    }
    record_until_stopped(arguments, terminal, &recorder, monitor, listener, hosts, out)
}

fn exists(file: &Path) -> Usage {
    Usage(format!("'{}' exists already: recordings are never overwritten", file.display()))
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

/// How `record` has it: into session files in `folder`, watched by `monitor`, in parts by `split`.
pub fn options(
    record: &RecordConfig,
    info: SessionInfo,
    folder: PathBuf,
    monitor: &Arc<Monitor>,
    split: Option<Split>,
) -> Options {
    let settings = Settings { chunk_bytes: record.chunk_mib << 20, crc: record.checksums, ..Settings::default() };
    Options {
        info,
        flush_every: Duration::from_millis(record.flush_ms),
        reserve_bytes: record.reserve_mib << 20,
        folder,
        opener: Box::new(SessionFiles { settings, split }),
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

fn record_until_stopped(
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

/// A rig that names devices.
pub fn load_rig(path: &Path) -> anyhow::Result<RigConfig> {
    let rig = RigConfig::load(path)?;
    if rig.devices.is_empty() {
        let path = path.display();
        let what = format!(
            "{path} names no devices: add [[evk4]], [[davis346]], [[camera]] or others (erfgs record --example)"
        );
        return Err(Usage(what).into());
    }
    Ok(rig)
}
