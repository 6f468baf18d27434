//! Several hosts recorded together: two emulated rigs whose clocks disagree, and two programs of which one is killed.

use std::{
    env, fs,
    io::{BufRead, BufReader, Read},
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Child, ChildStderr, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicI64, Ordering::SeqCst},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use erfgs_events::EventEncoding;
use erfgs_recorder::{
    Input, Options, Recorder, SessionFiles, SessionInfo,
    hosts::{HostEnd, HostLink, Hosts},
    live::{LivePage, Monitor, MonitorOptions, PageOptions},
};
use erfgs_session::{
    Session,
    source::{Counters, Description, Encoding, Outlet, Packet, Source, SourceError},
};
use tempfile::TempDir;

use super::{
    files::{erfgs, json},
    merge::support::{MS, START_NS, board, camera, description, part},
    rig::fail,
};
use crate::command_line::browser::Browser;

const SECONDS: i64 = 4;
/// The other host's clock is ahead by so much, and fast by so many millionths.
const AHEAD_NS: i64 = 7_000 * MS;
const FAST_PPM: f64 = 43.0;

fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(120), "waited too long for: {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

/// A device that sends what it would have sent by the time of its world, as its host's clock says.
struct Device {
    description: Description,
    packets: Vec<Packet>,
    /// Nanoseconds of the world until now; negative: it ends.
    world: Arc<AtomicI64>,
    clock: Arc<dyn Fn(i64) -> i64 + Send + Sync>,
    thread: Option<JoinHandle<()>>,
}

impl Source for Device {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        let (packets, world, clock) = (self.packets.clone(), Arc::clone(&self.world), Arc::clone(&self.clock));
        self.thread = Some(thread::spawn(move || {
            for packet in packets {
                let at_ns = packet.host_ns - START_NS;
                loop {
                    match world.load(SeqCst) {
                        ..0 => return,
                        now_ns if now_ns >= at_ns => break,
                        _ => thread::sleep(Duration::from_millis(1)),
                    }
                }
                outlet.send(Packet { host_ns: clock(at_ns), ..packet });
            }
        }));
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        if let Some(thread) = self.thread.take() {
            thread.join().map_err(|_| "the device's thread failed")?;
        }
        Ok(())
    }

    fn counters(&self) -> Counters {
        Counters::default()
    }
}

/// A host that runs, with the folder of its recordings.
struct Host {
    folder: TempDir,
    recorder: Arc<Recorder>,
    monitor: Arc<Monitor>,
}

impl Host {
    fn new(
        rig: &str,
        streams: Vec<(&str, Encoding, Vec<Packet>)>,
        world: &Arc<AtomicI64>,
        clock: impl Fn(i64) -> i64 + Send + Sync + 'static,
    ) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let clock: Arc<dyn Fn(i64) -> i64 + Send + Sync> = Arc::new(clock);
        let input = |(id, encoding, packets): (&str, Encoding, Vec<Packet>)| {
            let size = if encoding.is_events() { [1280, 720] } else { [0, 0] };
            let (world, clock) = (Arc::clone(world), Arc::clone(&clock));
            let device = Device { description: description(id, encoding, size), packets, world, clock, thread: None };
            Input { source: Box::new(device), queue_bytes: 16 << 20, stall_after: None }
        };
        let inputs: Vec<Input> = streams.into_iter().map(input).collect();
        let descriptions: Vec<_> = inputs.iter().map(|input| input.source.description().clone()).collect();
        let monitor = Monitor::new(&descriptions, MonitorOptions::default()).expect("a monitor");
        let options = Options {
            info: SessionInfo { rig: rig.into(), ..SessionInfo::default() },
            flush_every: Duration::from_millis(20),
            reserve_bytes: 0,
            folder: folder.path().into(),
            opener: Box::new(SessionFiles::default()),
            subscriber: Some(Arc::clone(&monitor) as _),
            before: None,
            after: None,
            rig_file: None,
        };
        let recorder = Arc::new(Recorder::new(inputs, options).expect("a recorder"));
        recorder.start_sources().expect("started");
        Self { folder, recorder, monitor }
    }

    /// Its page, behind a cable where this process has networks of its own.
    fn page(&self) -> Served {
        let (listener, cable) = match env::var_os(NETWORKS) {
            Some(_) => elsewhere(),
            None => (LivePage::listen("127.0.0.1:0".parse().expect("an address")).expect("free"), None),
        };
        let address = listener.local_addr().expect("an address");
        let options = PageOptions { address, names: Vec::new(), open: false };
        let (recorder, monitor) = (Arc::clone(&self.recorder), Arc::clone(&self.monitor));
        Served { page: LivePage::serve_at(listener, recorder, monitor, &options).expect("a page"), cable }
    }

    fn written(&self) -> Vec<u64> {
        self.recorder.status().streams.iter().map(|stream| stream.written).collect()
    }
}

/// Says to a test that it is run with networks of its own.
const NETWORKS: &str = "ERFGS_TEST_NETWORKS";

/// Runs a test of this file again as a process that has networks of its own, where the system lets one, and says whether it did.
/// Elsewhere the hosts speak over the loopback.
fn ran_with_networks(test: &str) -> bool {
    if env::var_os(NETWORKS).is_some() {
        return false;
    }
    let mut can = Command::new("unshare");
    can.args(["-rn", "ip", "link", "set", "lo", "up"]).stdout(Stdio::null()).stderr(Stdio::null());
    if !can.status().is_ok_and(|status| status.success()) {
        return false;
    }
    let mut again = Command::new("unshare");
    again.arg("-rn").arg(env::current_exe().expect("this program"));
    again.args(["--exact", &format!("recording::hosts::{test}"), "--nocapture"]).env(NETWORKS, "1");
    let output = again.output().expect("unshare");
    let outputs = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success() && outputs[0].contains("1 passed"), "{}\n{}", outputs[0], outputs[1]);
    true
}

/// A page, and the end of its host's network cable at this side, if there is one.
struct Served {
    page: LivePage,
    cable: Option<String>,
}

impl Served {
    /// Pulls the cable: nothing is answered any more, and nothing refused.
    fn cut(self) -> Option<LivePage> {
        ip(&["link", "set", &self.cable?, "down"]);
        Some(self.page)
    }
}

fn ip(words: &[&str]) {
    assert!(Command::new("ip").args(words).status().expect("ip").success(), "ip {words:?}");
}

/// Listens in another network namespace, which a cable connects with this one: a socket stays in the namespace that it was made in.
#[cfg(target_os = "linux")]
fn elsewhere() -> (TcpListener, Option<String>) {
    let (thread_sender, thread_there) = mpsc::channel();
    let (connected, cable_there) = mpsc::channel::<String>();
    let there = thread::spawn(move || {
        nix::sched::unshare(nix::sched::CloneFlags::CLONE_NEWNET).expect("a network namespace");
        thread_sender.send(fs::read_link("/proc/thread-self").expect("a thread")).expect("told");
        let cable = cable_there.recv().expect("a cable");
        ip(&["addr", "add", "10.9.0.2/24", "dev", &cable]);
        ip(&["link", "set", &cable, "up"]);
        LivePage::listen("10.9.0.2:0".parse().expect("an address")).expect("free")
    });
    let thread_there = thread_there.recv().expect("a thread");
    let number = thread_there.file_name().and_then(|name| name.to_str()).expect("its number");
    ip(&["link", "add", "here", "type", "veth", "peer", "name", "there", "netns", number]);
    ip(&["addr", "add", "10.9.0.1/24", "dev", "here"]);
    ip(&["link", "set", "here", "up"]);
    connected.send("there".into()).expect("told");
    (there.join().expect("a listener"), Some("here".into()))
}

#[cfg(not(target_os = "linux"))]
fn elsewhere() -> (TcpListener, Option<String>) {
    unreachable!("there are network namespaces on Linux alone")
}

/// Two hosts before one board, whose pulses the event camera of each sees. The board is on the left one.
fn two_hosts(world: &Arc<AtomicI64>) -> [Host; 2] {
    let evt3 = Encoding::Events(EventEncoding::Evt3);
    let eye = |zero_ns, ppm| ("eye", evt3, camera(evt3, &[part(0, SECONDS, zero_ns, ppm)], false).0);
    let now_ns = erfgs_rig::host_time::host_ns();
    let left = vec![eye(-3_000 * MS, 90.0), ("board", Encoding::TriggerLines, board(SECONDS))];
    let left = Host::new("left", left, world, move |at_ns| now_ns + at_ns);
    let right = Host::new("right", vec![eye(-700 * MS, -60.0)], world, move |at_ns| {
        now_ns + AHEAD_NS + at_ns + (at_ns as f64 * FAST_PPM * 1e-6) as i64
    });
    [left, right]
}

/// Lets the world go on until `to_ns`.
fn pass(world: &AtomicI64, to_ns: i64) {
    while world.load(SeqCst) < to_ns {
        world.fetch_add(20 * MS, SeqCst);
        thread::sleep(Duration::from_millis(2));
    }
}

/// Two hosts that record, the left one leading, from before the first pulse on.
struct Together {
    world: Arc<AtomicI64>,
    left: Host,
    right: Host,
    page: Served,
    hosts: Hosts,
}

impl Together {
    /// Nothing where `test` was run again with networks of its own.
    fn begin(test: &str) -> Option<Self> {
        if ran_with_networks(test) {
            return None;
        }
        let world = Arc::new(AtomicI64::new(0));
        let [left, right] = two_hosts(&world);
        let page = right.page();
        let hosts = Hosts::connect(vec![HostLink::parse(&page.page.url()).expect("a link")]).expect("the other host");
        hosts.lead(&left.recorder);
        hosts.start(&left.recorder, &left.folder.path().join("take.mcap"), None).expect("all record");
        Some(Self { world, left, right, page, hosts })
    }
}

#[test]
fn rigs_whose_clocks_disagree_are_recorded_by_one_host_and_merged_by_the_pulses() {
    let test = "rigs_whose_clocks_disagree_are_recorded_by_one_host_and_merged_by_the_pulses";
    let Some(Together { world, left, right, page, hosts }) = Together::begin(test) else { return };
    pass(&world, (SECONDS * 1000 + 100) * MS);
    wait_until("all packets", || left.written()[0] == 4000 && right.written()[0] == 4000);
    hosts.stop(&left.recorder, "enough").expect("recorded");
    let (own, takes) = hosts.last().expect("a take");
    assert!(matches!(takes[0].end, HostEnd::Stopped(_)), "{takes:?}");

    // By the very words that it tells.
    let commands = erfgs_recorder::hosts::merge_commands(&own, &takes);
    let (command, fetch) = commands.split_last().expect("a command");
    // What lies on another host is fetched; here it is in another folder.
    assert_eq!(fetch.len(), usize::from(page.cable.is_some()), "{commands:?}");
    for scp in fetch {
        let [_, from, to] = scp.split(' ').collect::<Vec<_>>()[..] else { panic!("{scp}") };
        let from = Path::new(from.strip_prefix("10.9.0.2:").expect("the other host"));
        fs::copy(from, Path::new(to).join(from.file_name().expect("a file"))).expect("copied");
    }
    let mut words: Vec<&str> = command.split(' ').skip(1).collect();
    words.push("--json");
    let summary = json(left.folder.path(), &words);
    assert_eq!(summary["reference"].as_str(), own.to_str(), "{summary}");
    let of_right = &summary["sessions"].as_array().expect("sessions")[1];
    assert!(of_right["common"].as_u64() > Some(90), "{summary}");
    let ahead_s = of_right["calendar_s"].as_f64().expect("a figure");
    assert!((ahead_s - AHEAD_NS as f64 * 1e-9).abs() < 0.01, "{summary}");
    let streams: Vec<&str> =
        summary["streams"].as_array().expect("streams").iter().filter_map(|row| row["stream"].as_str()).collect();
    assert_eq!(streams, ["eye", "board", "take-right-eye"], "{summary}");
    let synced = json(left.folder.path(), &["sync", "take-merged.mcap", "--json"]);
    for row in synced["streams"].as_array().expect("streams") {
        assert_eq!(row["tier"], "hardware-triggered", "{synced}");
    }
    world.store(-1, SeqCst);
}

#[test]
fn a_host_that_crashes_costs_its_own_streams_only() {
    let test = "a_host_that_crashes_costs_its_own_streams_only";
    let Some(Together { world, left, right, page, hosts }) = Together::begin(test) else { return };
    pass(&world, 2_000 * MS);
    // What a crash would leave: its session as it is on the disk now, and nobody who answers.
    let there = right.folder.path().join("take-right.mcap");
    let left_behind = left.folder.path().join("take-right.mcap");
    wait_until("most of it is on the disk", || {
        fs::copy(&there, &left_behind).expect("copied");
        let session = Session::open(&left_behind).expect("a session that runs can be read");
        session.summary().streams[0].totals.packets > 1500
    });
    let _silent = page.cut();
    pass(&world, (SECONDS * 1000 + 100) * MS);
    wait_until("all packets of the other", || left.written()[0] == 4000);
    hosts.stop(&left.recorder, "enough").expect("recorded");
    let (own, takes) = hosts.last().expect("a take");
    assert!(matches!(takes[0].end, HostEnd::Unknown { .. }), "{takes:?}");
    assert_eq!(takes[0].path, there);

    let merged = ["merge", own.to_str().expect("a path"), "take-right.mcap", "--out", "merged.mcap", "--json"];
    let summary = json(left.folder.path(), &merged);
    assert_eq!(summary["cut_off"], serde_json::json!(["take-right.mcap"]), "{summary}");
    let packets = |at: usize| summary["streams"][at]["packets"].as_u64().expect("a count");
    assert!(packets(0) == 4000 && (1500..4000).contains(&packets(2)), "{summary}");
    world.store(-1, SeqCst);
}

/// `erfgs record` of a rig of patterns that waits for a page to start it.
struct Waiting {
    process: Child,
    link: String,
    /// Kept open, so that the program can write there.
    _stderr: BufReader<ChildStderr>,
}

impl Waiting {
    fn start(folder: &Path, more: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_erfgs"))
            .current_dir(folder)
            .args(["record", "rig.toml", "--out", "takes", "--wait", "--no-preflight", "--live", "127.0.0.1:0"])
            .args(more)
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("erfgs runs");
        let mut stderr = BufReader::new(process.stderr.take().expect("stderr"));
        let link = stderr
            .by_ref()
            .lines()
            .map_while(Result::ok)
            .find_map(|line| line.split_once("live page: ").map(|(_, link)| link.to_owned()));
        Self { process, link: link.expect("a link"), _stderr: stderr }
    }

    fn token(&self) -> &str {
        self.link.split_once("token=").expect("a token").1
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A folder with a rig of this name.
fn rig_folder(name: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = format!(
        "[rig]\nname = \"{name}\"\n[record]\nflush_ms = 50\n[[pattern]]\nid = \"{name}-eye\"\nwidth = 160\nheight = 120\n"
    );
    fs::write(folder.path().join("rig.toml"), rig).expect("written");
    folder
}

fn holds(folder: &Path, secret: &str) -> bool {
    let paths = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let bytes = |path: PathBuf| fs::read(path).unwrap_or_default();
    paths
        .filter(|path| path.is_file())
        .map(bytes)
        .any(|bytes| bytes.windows(secret.len()).any(|window| window == secret.as_bytes()))
}

#[test]
fn two_programs_record_as_one_and_the_loss_of_one_is_told() {
    let [left, right] = ["left", "right"].map(rig_folder);
    let mut other = Waiting::start(right.path(), &[]);
    let secrets = tempfile::tempdir().expect("a folder");
    let links = secrets.path().join("hosts.txt");
    fs::write(&links, format!("# the other host\n{}\n", other.link)).expect("written");
    let links = links.to_str().expect("a path");
    let token = other.token().to_owned();

    let record = |out: &str, seconds: &str, more: &[&str]| {
        let words = ["record", "rig.toml", "--out", out, "--seconds", seconds, "--no-preflight", "--with", links];
        let done = erfgs(left.path(), &[&words[..], more].concat());
        let [stdout, stderr] = [&done.stdout, &done.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        assert!(!stdout.contains(&token) && !stderr.contains(&token), "{stdout}\n{stderr}");
        (done.status.code(), stdout, stderr)
    };
    let (code, stdout, stderr) = record("take1.mcap", "1", &["--json"]);
    assert_eq!(code, Some(0), "{stderr}");
    let summary: serde_json::Value = serde_json::from_str(&stdout).expect("JSON");
    let there = right.path().canonicalize().expect("a folder").join("takes/take1-right.mcap");
    assert_eq!(
        (&summary["hosts"][0]["end"], summary["hosts"][0]["path"].as_str()),
        (&"stopped".into(), there.to_str())
    );
    let merge = format!("erfgs merge take1.mcap {} --out take1-merged.mcap", there.display());
    assert_eq!(summary["merge"], serde_json::json!([merge]));
    for (folder, session) in [(left.path(), "take1.mcap"), (right.path(), "takes/take1-right.mcap")] {
        let info = json(folder, &["info", session, "--json"]);
        assert_eq!(info["complete"], true, "{info}");
    }
    // Patterns see no board.
    let stderr = fail(left.path(), 1, merge.strip_prefix("erfgs ").expect("a command"));
    assert!(stderr.contains("holds no pulses of a trigger board"), "{stderr}");

    // Killed in the middle, as by a power cut.
    let killed = thread::spawn({
        let (session, own) = (right.path().join("takes/take2-right.mcap"), left.path().join("take2.mcap"));
        move || {
            wait_until("all record", || own.exists());
            wait_until("some of it is on the disk", || fs::metadata(&session).is_ok_and(|about| about.len() > 20_000));
            other.process.kill().expect("killed");
            other
        }
    });
    let (code, stdout, stderr) = record("take2.mcap", "5", &[]);
    assert!(code == Some(1) && stderr.contains("cannot be reached"), "{stderr}");
    let other = killed.join().expect("killed");
    let name = other.link.trim_start_matches("http://").split('/').next().expect("a host");
    assert!(stderr.contains(&format!("{name}: cannot be reached")), "{stderr}");
    assert!(stderr.contains(&format!("did not record to the end: {name}")), "{stderr}");
    assert!(stdout.contains("takes/take2-right.mcap' there holds") && stdout.contains("erfgs merge"), "{stdout}");
    let info = json(left.path(), &["info", "take2.mcap", "--json"]);
    assert_eq!(info["complete"], true, "{info}");
    let info = json(right.path(), &["info", "takes/take2-right.mcap", "--json"]);
    assert_eq!(info["complete"], false, "{info}");

    // It is refused before anything is made here.
    let (code, _, stderr) = record("take3.mcap", "1", &[]);
    assert!(code == Some(1) && stderr.contains(name) && stderr.contains("--wait --live"), "{stderr}");
    assert!(!left.path().join("take3.mcap").exists());
    let stderr = fail(left.path(), 2, &format!("record rig.toml --out take3.mcap --with https://a/?token={token}"));
    assert!(stderr.contains("plain http") && !stderr.contains(&token), "{stderr}");
    for folder in [left.path(), right.path(), &right.path().join("takes")] {
        assert!(!holds(folder, &token), "{}", folder.display());
    }
}

#[test]
fn one_page_has_the_cameras_of_two_hosts() {
    let [left, right] = ["left", "right"].map(rig_folder);
    let other = Waiting::start(right.path(), &[]);
    let own = Waiting::start(left.path(), &["--with", &other.link]);
    let name = other.link.trim_start_matches("http://").split('/').next().expect("a host").to_owned();
    let mut browser = Browser::unseen();
    browser.open(&own.link);
    browser.wait("$('link').textContent === '2 streams of 2 hosts, live'");
    browser.wait(&format!("cards.get('{name} right-eye').image.naturalWidth > 0"));
    browser.wait("cards.get('left-eye').image.naturalWidth > 0");
    browser.evaluate("$('name').value = 'take'; $('button').click()");
    // Both lamps, and the time that goes on.
    let counts = |text: &str| format!("/^\\d+:\\d\\d ·/.test({text}) && !{text}.startsWith('0:00')");
    browser.wait(&format!("document.body.classList.contains('recording') && {}", counts("$('state').textContent")));
    browser.wait(&counts("document.querySelector('#hosts .doing').textContent"));
    browser.evaluate(&format!("cards.get('{name} right-eye').image.click()"));
    browser.wait("$('large').open && $('large-image').naturalWidth === 160");
    browser.evaluate("$('large-close').click()");
    browser.evaluate("$('button').click()");
    browser.wait("!document.body.classList.contains('recording') && $('button').textContent === 'Start recording'");
    browser.wait(
        "[...document.querySelectorAll('#messages li')].some((item) => item.textContent.includes('erfgs merge'))",
    );
    for session in [left.path().join("takes/take.mcap"), right.path().join("takes/take-right.mcap")] {
        assert!(Session::open(&session).expect("a session").summary().complete, "{}", session.display());
    }
    drop(other);
    browser.wait("document.querySelector('.host.lost .doing').textContent === 'lost'");
    browser.wait("$('link').textContent.endsWith('1 lost')");
    browser.resize(390, 844);
    browser.wait("document.documentElement.scrollWidth <= 390");
}
