//! The live page over real connections: what it serves, and what it refuses.

use std::{
    io::{Read, Write},
    net::{SocketAddr, TcpStream},
    path::Path,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use erfgs_recorder::{
    Input, Level, Options, Pattern, PatternConfig, PatternKind, Recorder, SessionFiles, SessionInfo,
    live::{LivePage, Monitor, MonitorOptions, PageOptions},
};

/// An answer of the server.
pub struct Answer {
    pub code: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

/// Sends a request byte for byte as given and reads the answer to its end.
fn ask(address: SocketAddr, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
    let mut stream = TcpStream::connect(("127.0.0.1", address.port())).unwrap();
    let mut request = format!("{method} {path} HTTP/1.1\r\nconnection: close\r\ncontent-length: {}\r\n", body.len());
    if !headers.iter().any(|(name, _)| *name == "host") {
        request += &format!("host: 127.0.0.1:{}\r\n", address.port());
    }
    for (name, value) in headers {
        request += &format!("{name}: {value}\r\n");
    }
    stream.write_all(format!("{request}\r\n{body}").as_bytes()).unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").expect("an answer has a head");
    let head = String::from_utf8_lossy(&bytes[..end]).to_lowercase();
    let code = head.split(' ').nth(1).unwrap().parse().unwrap();
    Answer { code, head, body: bytes[end + 4..].to_vec() }
}

pub fn get(address: SocketAddr, path: &str) -> Answer {
    ask(address, "GET", path, &[], "")
}

pub fn post(address: SocketAddr, path: &str, body: &str) -> Answer {
    ask(address, "POST", path, &[("content-type", "application/json")], body)
}

/// A rig of two patterns, served.
pub fn serve(folder: &Path, address: &str) -> (Arc<Recorder>, LivePage) {
    let (recorder, monitor) = rig(folder, "lab", 0);
    let page = page(&recorder, monitor, address);
    (recorder, page)
}

/// The page of a rig, with a token where others could reach it.
pub fn page(recorder: &Arc<Recorder>, monitor: Arc<Monitor>, address: &str) -> LivePage {
    let options =
        PageOptions { address: address.parse().unwrap(), names: Vec::new(), open: address.starts_with("127") };
    LivePage::serve(Arc::clone(recorder), monitor, &options).unwrap()
}

/// A rig of two patterns that runs, on a disk of which so much is never used.
pub fn rig(folder: &Path, name: &str, reserve_bytes: u64) -> (Arc<Recorder>, Arc<Monitor>) {
    let input = |id: &str, delivers| {
        let config = PatternConfig { delivers, width: 160, height: 120, ..PatternConfig::default() };
        Input { source: Box::new(Pattern::open(id, config).unwrap()), queue_bytes: 16 << 20, stall_after: None }
    };
    let inputs = vec![input("wheel", PatternKind::Events), input("frames", PatternKind::Frames)];
    let descriptions: Vec<_> = inputs.iter().map(|input| input.source.description().clone()).collect();
    let monitor = Monitor::new(&descriptions, MonitorOptions::default()).unwrap();
    let options = Options {
        info: SessionInfo { rig: name.into(), ..SessionInfo::default() },
        flush_every: Duration::from_millis(50),
        reserve_bytes,
        folder: folder.into(),
        opener: Box::new(SessionFiles::default()),
        subscriber: Some(Arc::clone(&monitor) as _),
        before: None,
        after: None,
        rig_file: None,
    };
    let recorder = Arc::new(Recorder::new(inputs, options).unwrap());
    recorder.start_sources().unwrap();
    (recorder, monitor)
}

pub fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(60), "waited too long for: {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn the_page_needs_nothing_from_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let (_recorder, page) = serve(folder.path(), "127.0.0.1:0");
    for (path, kind) in [
        ("/", "text/html"),
        ("/style.css", "text/css"),
        ("/page.js", "text/javascript"),
        ("/playback.js", "text/javascript"),
        ("/settings.js", "text/javascript"),
    ] {
        let answer = get(page.address(), path);
        assert_eq!(answer.code, 200, "{path}");
        assert!(answer.head.contains(kind) && answer.head.contains("default-src 'none'"), "{}", answer.head);
        let text = answer.text();
        for elsewhere in ["http:", "https:", "src=\"//", "href=\"//", "@import", "innerHTML"] {
            assert!(!text.contains(elsewhere), "{path} has {elsewhere}");
        }
    }
    assert_eq!(get(page.address(), "/other").code, 404);
}

#[test]
fn numbers_and_previews_of_every_camera_are_served() {
    let folder = tempfile::tempdir().unwrap();
    let (_recorder, page) = serve(folder.path(), "127.0.0.1:0");
    for id in ["wheel", "frames"] {
        wait_until("a preview", || get(page.address(), &format!("/api/preview/{id}")).code == 200);
        let jpeg = get(page.address(), &format!("/api/preview/{id}")).body;
        assert!(jpeg.starts_with(&[0xff, 0xd8, 0xff]), "{id}");
    }
    assert_eq!(get(page.address(), "/api/preview/absent").code, 404);
    wait_until("rates", || {
        let numbers = get(page.address(), "/api/status").json();
        let streams = &numbers["status"]["streams"];
        streams[0]["events_per_s"].as_f64().is_some_and(|rate| rate > 1000.0)
            && streams[1]["packets_per_s"].as_f64().is_some_and(|rate| rate > 1.0)
            && streams[0]["clock"]["residual_p95_us"].is_number()
    });
    // The same numbers come as a stream of server-sent events.
    let mut stream = TcpStream::connect(page.address()).unwrap();
    write!(stream, "GET /api/stream HTTP/1.1\r\nhost: {}\r\n\r\n", page.address()).unwrap();
    let mut begin = [0; 600];
    stream.read_exact(&mut begin).unwrap();
    let begin = String::from_utf8_lossy(&begin);
    assert!(begin.contains("text/event-stream") && begin.contains("data: {\"status\""), "{begin}");
}

#[test]
fn warnings_stay_until_somebody_has_read_them() {
    let folder = tempfile::tempdir().unwrap();
    let (recorder, page) = serve(folder.path(), "127.0.0.1:0");
    recorder.say(Level::Warning, "wheel", "hot");
    recorder.say(Level::Info, "", "all is well");
    let unread = || get(page.address(), "/api/status").json()["status"]["unread"].clone();
    wait_until("the warning", || unread().as_array().unwrap().len() == 1);
    let number = unread()[0]["number"].as_u64().unwrap();
    assert_eq!((&unread()[0]["stream"], &unread()[0]["text"]), (&"wheel".into(), &"hot".into()));
    assert_eq!(post(page.address(), "/api/read", &format!("{{\"number\": {number}}}")).code, 200);
    wait_until("nothing to be read", || unread().as_array().unwrap().is_empty());
}

#[test]
fn cameras_are_enlarged_and_no_camera_is_steered_like_a_playback() {
    let folder = tempfile::tempdir().unwrap();
    let (_recorder, page) = serve(folder.path(), "127.0.0.1:0");
    let address = page.address();
    let large = || get(address, "/api/preview/wheel?large=true");
    wait_until("an enlarged preview", || large().code == 200);
    assert_eq!(post(address, "/api/span", "{\"us\": 2000}").json()["us"], 2000);
    assert_eq!(post(address, "/api/span", "{\"us\": 0}").json()["us"], 100);
    assert_eq!(post(address, "/api/span", "{\"us\": -1}").code, 422);
    let refused = post(address, "/api/playback", "\"pause\"");
    assert_eq!(refused.code, 409, "{}", refused.text());
    assert_eq!(post(address, "/api/playback", "\"eject\"").code, 422);
}

#[test]
fn recordings_start_and_stop_from_the_page_and_stay_in_their_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (recorder, page) = serve(folder.path(), "127.0.0.1:0");
    let address = page.address();
    assert_eq!(post(address, "/api/stop", "{}").code, 409);
    for name in ["../out", "/etc/out", "a/b", ".hidden"] {
        let answer = post(address, "/api/start", &format!("{{\"name\": \"{name}\"}}"));
        assert_eq!(answer.code, 400, "{name}: {}", answer.text());
    }
    assert!(!recorder.is_recording());
    assert_eq!(post(address, "/api/start", "{\"name\": \"take\"}").code, 200);
    assert_eq!(post(address, "/api/start", "{\"name\": \"other\"}").code, 409);
    wait_until("packets", || recorder.status().streams.iter().all(|stream| stream.written > 0));
    let summary = post(address, "/api/stop", "{}");
    assert_eq!((summary.code, &summary.json()["failure"]), (200, &serde_json::Value::Null));
    assert_eq!(post(address, "/api/start", "{\"name\": \"take\"}").code, 409, "recordings are never overwritten");
    let listed = get(address, "/api/recordings").json();
    assert_eq!(listed[0]["name"], "take.mcap");
    let downloaded = get(address, "/recordings/take.mcap");
    assert_eq!(downloaded.code, 200);
    assert_eq!(downloaded.body, std::fs::read(folder.path().join("take.mcap")).unwrap());
}

#[test]
fn no_path_outside_the_recording_folder_is_reachable() {
    let above = tempfile::tempdir().unwrap();
    let folder = above.path().join("recordings");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(above.path().join("secret.mcap"), b"secret").unwrap();
    std::fs::write(folder.join("notes.txt"), b"secret").unwrap();
    std::os::unix::fs::symlink(above.path().join("secret.mcap"), folder.join("link.mcap")).unwrap();
    let (_recorder, page) = serve(&folder, "127.0.0.1:0");
    for path in [
        "/recordings/../secret.mcap",
        "/recordings/..%2fsecret.mcap",
        "/recordings/%2e%2e%2fsecret.mcap",
        "/recordings/..%5csecret.mcap",
        "/recordings/%252e%252e%252fsecret.mcap",
        "/recordings//etc/passwd",
        "/recordings/%2fetc%2fpasswd",
        "/recordings/notes.txt",
        "/recordings/link.mcap",
        "/recordings/",
        "/../secret.mcap",
        "/api/preview/..%2f..%2fsecret.mcap",
    ] {
        let answer = get(page.address(), path);
        assert!((400..500).contains(&answer.code), "{path}: {}", answer.code);
        assert!(!answer.text().contains("secret\n") && answer.text() != "secret", "{path}");
    }
}

#[test]
fn other_sites_and_other_names_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (recorder, page) = serve(folder.path(), "127.0.0.1:0");
    let address = page.address();
    assert_eq!(ask(address, "GET", "/api/status", &[("host", "rebound.example")], "").code, 403);
    let json = ("content-type", "application/json");
    assert_eq!(ask(address, "POST", "/api/start", &[json, ("origin", "http://evil.example")], "{}").code, 403);
    // What a form of another site can send without asking is no JSON.
    assert_eq!(ask(address, "POST", "/api/start", &[("content-type", "text/plain")], "{}").code, 415);
    assert_eq!(ask(address, "GET", "/api/start", &[], "").code, 405);
    assert!(!recorder.is_recording());
}

#[test]
fn who_has_no_token_gets_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (_recorder, page) = serve(folder.path(), "0.0.0.0:0");
    let address = page.address();
    let token = page.url().split_once("token=").expect("the address has the token").1.to_owned();
    let paths =
        ["/", "/page.js", "/api/status", "/api/stream", "/api/preview/wheel", "/api/recordings", "/recordings/a.mcap"];
    for path in paths {
        assert_eq!(get(address, path).code, 401, "{path}");
    }
    assert_eq!(post(address, "/api/start", "{}").code, 401);
    assert_eq!(get(address, "/?token=0123456789abcdef0123456789abcdef").code, 401);
    // The token is traded for a cookie, and leaves the address bar.
    let answer = get(address, &format!("/?token={token}"));
    let place = answer.head.split_once("location: ").expect("a place").1.lines().next().unwrap_or_default().trim();
    assert!(answer.code == 303 && answer.head.contains(&format!("path={place}")), "{}", answer.head);
    assert!(answer.head.contains("httponly") && answer.head.contains("samesite=strict"), "{}", answer.head);
    let cookie = format!("erfgs_token_{}={token}", address.port());
    assert_eq!(ask(address, "GET", "/", &[("cookie", &cookie)], "").code, 200);
    for path in ["", "page.js", "api/status"] {
        assert_eq!(ask(address, "GET", &format!("{place}{path}"), &[("cookie", &cookie)], "").code, 200, "{path}");
        assert_eq!(get(address, &format!("{place}{path}")).code, 401, "{path}");
    }
    assert_eq!(ask(address, "GET", "/api/status", &[("cookie", &cookie)], "").code, 200);
}
