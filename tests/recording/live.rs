//! The live page of recordings that are played.

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::Path,
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex},
    thread,
    time::Duration,
};

use erfgs_events::EventEncoding;
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Encoding, Packet},
};

use crate::{
    command_line::browser::Browser,
    recording::{
        files::{self, description},
        rig::recorded,
    },
};

#[path = "../../calibrate/tests/it/common/blinking.rs"]
mod blinking;

/// A session that is played again and again with its page.
struct Played {
    process: Child,
    address: String,
    /// What the program said since; a thread reads it, so that the program never waits to say it.
    output: Arc<Mutex<String>>,
}

impl Played {
    fn start(folder: &Path, session: &str, more: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_erfgs"))
            .current_dir(folder)
            .args(["replay", session, "--live", "127.0.0.1:0", "--open", "--loop"])
            .args(more)
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("erfgs runs");
        let mut stderr = BufReader::new(process.stderr.take().expect("stderr")).lines();
        let address = stderr.by_ref().map_while(Result::ok).find_map(|line| {
            let (_, rest) = line.split_once("live page: http://")?;
            Some(rest.split(['/', ' ']).next()?.to_owned())
        });
        let output = Arc::new(Mutex::new(String::new()));
        thread::spawn({
            let output = Arc::clone(&output);
            move || stderr.map_while(Result::ok).for_each(|line| *output.lock().expect("the words") += &(line + "\n"))
        });
        Self { process, address: address.expect("an address"), output }
    }

    fn get(&self, path: &str) -> Vec<u8> {
        let mut stream = TcpStream::connect(&self.address).expect("a connection");
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.address).expect("sent");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("an answer");
        answer
    }

    /// Asks until it holds, for two minutes at most.
    fn comes_to(&self, holds: impl Fn(&Self) -> bool) -> bool {
        (0..2400).any(|_| {
            thread::sleep(Duration::from_millis(50));
            holds(self)
        })
    }

    fn status(&self) -> serde_json::Value {
        let answer = self.get("/api/status");
        let from = answer.iter().position(|byte| *byte == b'{').expect("JSON");
        let to = answer.iter().rposition(|byte| *byte == b'}').expect("JSON");
        serde_json::from_slice(&answer[from..=to]).expect("JSON")
    }
}

impl Drop for Played {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_recording_is_shown_on_the_live_page() {
    let (kept, summary) = recorded();
    let page = Played::start(kept.path(), "take.mcap", &[]);
    assert!(String::from_utf8_lossy(&page.get("/")).contains("Start recording"));
    let shows = page.comes_to(|page| {
        let answer = page.get("/api/preview/camera");
        answer.starts_with(b"HTTP/1.1 200") && answer.windows(3).any(|bytes| bytes == [0xff, 0xd8, 0xff])
    });
    assert!(
        shows,
        "no picture of the camera\n{}\n{summary}\n{}",
        page.status(),
        page.output.lock().expect("the words")
    );
    assert_eq!(page.status()["guidance"], serde_json::json!([]));
    // By its pixels: previews in their own shape, and rates that are drawn.
    let mut browser = Browser::unseen();
    browser.open(&format!("http://{}/", page.address));
    browser.wait(
        "[...document.querySelectorAll('.view img')].some((image) => image.naturalWidth > 0 && \
         Math.abs(image.clientWidth / image.clientHeight - image.naturalWidth / image.naturalHeight) < 0.05)",
    );
    browser.wait(
        "[...document.querySelectorAll('.spark')].some((canvas) => canvas.width > 0 && \
         canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value > 0))",
    );
    browser.wait("document.getElementById('link').textContent.includes('replay') && document.title.includes('replay')");
    browser.wait("[...document.querySelectorAll('.badge')].some((badge) => badge.textContent === 'replay')");
}

#[test]
fn a_playback_is_paused_sought_stepped_and_slowed_on_its_page() {
    let folder = tempfile::tempdir().expect("a folder");
    files::write_session(folder.path());
    let page = Played::start(folder.path(), "s.mcap", &[]);
    let mut browser = Browser::unseen();
    browser.open(&format!("http://{}/", page.address));
    browser.resize(390, 844);
    let of = |page: &Played, what: &str| page.status()["playback"][what].clone();
    browser.wait(
        "!$('player').hidden && $('length').textContent.startsWith('/ 0:02.6') && $('position').value !== '0:00.000'",
    );
    // Nothing of the page is wider than a phone.
    browser.wait("document.documentElement.scrollWidth <= 390");
    browser.evaluate("$('play').click()");
    browser.wait("$('play').textContent === 'Play'");
    assert_eq!(of(&page, "paused"), true);
    browser.evaluate("$('seek').value = 1500000; $('seek').dispatchEvent(new Event('input'))");
    browser.wait("$('position').value === '0:01.500'");
    // The pictures stand as long as nothing moves: what was there just before is seen.
    let bright = "(() => { const image = cards.get('ev0').image; const canvas = document.createElement('canvas'); \
                  [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight]; const context = canvas.getContext('2d'); \
                  context.drawImage(image, 0, 0); return context.getImageData(0, 0, canvas.width, canvas.height).data\
                  .filter((value, at) => at % 4 === 0 && value > 150).length; })()";
    browser.wait(&format!("{bright} > 100"));
    thread::sleep(Duration::from_millis(600));
    // While the next picture comes there is none to be read.
    browser.wait(&format!("(() => {{ window.bright = {bright}; return true; }})()"));
    assert!(browser.evaluate("window.bright").as_u64() > Some(100), "the picture of a playback that stands faded");
    browser.evaluate("document.querySelector('[data-step=\"1\"]').click()");
    browser.wait("$('position').value === '0:01.501'");
    browser.evaluate("document.querySelector('[data-frame=on]').click()");
    let frame_ns =
        (0..).map(|pulse| files::pulse_ns(pulse) + files::EXPOSURE_NS + 9_000_000).find(|&at| at > 1_501_000_000);
    let frame_ns = frame_ns.expect("a frame");
    assert!(page.comes_to(|page| of(page, "position_ns") == frame_ns), "{}", of(&page, "position_ns"));
    browser.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft', bubbles: true }))");
    assert!(page.comes_to(|page| of(page, "position_ns") == frame_ns - 1_000_000), "{}", of(&page, "position_ns"));
    browser.evaluate("$('speed').value = '0.01'; $('speed').dispatchEvent(new Event('change'))");
    assert!(page.comes_to(|page| of(page, "speed") == 0.01));
    browser.evaluate("$('play').click()");
    assert!(page.comes_to(|page| of(page, "paused") == false && of(page, "position_ns").as_i64() > Some(frame_ns)));
    // How much of the past pictures of events show, and a camera in its full size.
    browser.evaluate("$('span').value = '5000'; $('span').dispatchEvent(new Event('change'))");
    assert!(page.comes_to(|page| page.status()["span_us"] == 5000));
    browser.evaluate("cards.get('ev0').image.click()");
    browser.wait("$('large').open && $('large-image').naturalWidth === 1280 && $('large-image').naturalHeight === 720");
    browser.evaluate("$('large-close').click()");
    browser.wait("!$('large').open");
}

#[test]
fn a_recording_that_is_played_again_and_again_has_a_sane_clock() {
    let folder = tempfile::tempdir().expect("a folder");
    files::write_session(folder.path());
    // Shorter than a second: nothing else tells that the device's time went back.
    let cut = ["export", "s.mcap", "--to", "session", "--until", "0.7", "--out", "short.mcap", "--json"];
    files::json(folder.path(), &cut);
    let page = Played::start(folder.path(), "short.mcap", &["--speed", "8"]);
    let clock = |page: &Played| page.status()["status"]["streams"][0]["clock"].clone();
    // Some rounds at eight times the speed.
    let begun = std::time::Instant::now();
    while begun.elapsed() < Duration::from_secs(2) {
        if let Some(ppm) = clock(&page)["rate_ppm"].as_f64() {
            assert!(ppm.abs() < 2000.0, "{}", clock(&page));
        }
        thread::sleep(Duration::from_millis(20));
    }
}

/// The left pictures of a chessboard, five a second.
fn write_boards(path: &Path) {
    let pictures = Path::new(env!("CARGO_MANIFEST_DIR")).join("calibrate/tests/data/chessboards");
    let start =
        SessionStart { host_ns: 7_000_000_000, epoch_ns: 0, program: "test".into(), machine: Default::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).expect("written");
    let description = description("left", Encoding::Frames(PixelFormat::Mjpeg), [640, 480], serde_json::json!({}));
    let stream = writer.add_stream(&description).expect("a stream");
    let files = (1..=14).map(|number| pictures.join(format!("left{number:02}.jpg"))).filter(|file| file.exists());
    for (sequence, file) in (0..).zip(files) {
        let packet = Packet {
            sequence,
            host_ns: 7_000_000_000 + sequence as i64 * 200_000_000,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: fs::read(file).expect("read").into(),
        };
        writer.packet(stream, &packet).expect("written");
    }
    writer.finish().expect("written");
}

#[test]
fn a_board_is_calibrated_while_it_is_played() {
    let folder = tempfile::tempdir().expect("a folder");
    write_boards(&folder.path().join("boards.mcap"));
    let page = Played::start(folder.path(), "boards.mcap", &["--quick", "chessboard:9x6:0.025"]);
    let error_px = |page: &Played| {
        let status = page.status();
        let guidance = &status["guidance"][0];
        let figures = guidance["figures"].as_array()?;
        let figure = |name: &str| figures.iter().find(|figure| figure[0] == name)?[1].as_str();
        assert_eq!(guidance["id"], "left");
        let views: usize = figure("board")?.rsplit(' ').nth(1)?.parse().ok()?;
        // Of the thirteen pictures two are much alike.
        (views >= 11).then_some(())?;
        let covered = guidance["coverage"].as_array()?.iter().filter(|cell| **cell != 0).count();
        assert!(covered > 40, "{covered} of 96 cells");
        assert!(!guidance["advice"].as_str()?.is_empty());
        figure("error")?.strip_suffix(" px")?.parse::<f64>().ok()
    };
    let fits = page.comes_to(|page| error_px(page).is_some_and(|error| error < 0.25));
    assert!(fits, "{}", page.status()["guidance"]);
}

/// An event camera before a screen, as a recorded session: the file's packets hold 20 ms each.
fn write_blinking(path: &Path) {
    let start =
        SessionStart { host_ns: 7_000_000_000, epoch_ns: 0, program: "test".into(), machine: Default::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).expect("written");
    let description = description("ev", Encoding::Events(EventEncoding::Evt2), [320, 240], serde_json::json!({}));
    let stream = writer.add_stream(&description).expect("a stream");
    let events = blinking::events([8, 5], 0.03, &blinking::camera());
    for (sequence, part) in (0..).zip(events.chunk_by(|a, b| a.t_us / 20_000 == b.t_us / 20_000)) {
        let packet = Packet {
            sequence,
            host_ns: 7_000_000_000 + (part[part.len() - 1].t_us + 100) * 1000,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: blinking::as_evt2(part).into(),
        };
        writer.packet(stream, &packet).expect("written");
    }
    writer.finish().expect("written");
}

#[test]
fn an_event_camera_is_calibrated_while_it_looks_at_a_board_that_blinks() {
    let folder = tempfile::tempdir().expect("a folder");
    write_blinking(&folder.path().join("screen.mcap"));
    let options = ["--quick", "chessboard:8x5:0.03", "--quick-lens", "pinhole", "--quick-blink", "20"];
    let page = Played::start(folder.path(), "screen.mcap", &options);
    let focal_px = |page: &Played| {
        let status = page.status();
        let guidance = &status["guidance"][0];
        assert_eq!(guidance["id"], "ev");
        let figures = guidance["figures"].as_array()?;
        let figure = figures.iter().find(|figure| figure[0] == "focal length")?[1].as_str()?;
        figure.split(' ').next()?.parse::<f64>().ok()
    };
    let fits = page.comes_to(|page| focal_px(page).is_some_and(|focal| (focal - 300.0).abs() < 6.0));
    assert!(fits, "{}", page.status()["guidance"]);
}

#[test]
fn a_board_is_looked_for_only_where_there_is_a_page_to_tell() {
    let (kept, _) = recorded();
    let message = crate::recording::rig::fail(kept.path(), 2, "replay take.mcap --quick chessboard:9x6:0.025");
    assert!(message.contains("--live"), "{message}");
}
