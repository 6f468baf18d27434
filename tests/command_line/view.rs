//! `erfgs view`: what it serves, to whom, and whether a browser shows what the trainer would.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    process::{Child, Stdio},
    sync::mpsc,
    time::{Duration, Instant},
};

use erfgs_stage::{EventOptions, FilmOptions, RigOptions, StageOptions, film};

use super::{Folder, browser::Browser};

/// `ds` in the folder: something moves before six cameras, and its hull is known.
fn film_small(folder: &Folder) {
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 64, height: 48, rgb: 6, event: 2, test: 1, ..RigOptions::default() },
        events: EventOptions::default(),
        duration_ns: 300_000_000,
        rgb_fps: 20.0,
        test_fps: 20.0,
        truth_points: 0,
        ..FilmOptions::default()
    };
    film(&folder.path("ds"), &options, &|_| {}).expect("a film");
    folder.succeed("dataset points ds --method random --random-points 400 --moving 4 --moving-points 400");
}

/// The page of a run, until it is dropped.
struct Served {
    program: Child,
    link: String,
    /// Lines on stderr.
    said: mpsc::Receiver<String>,
}

impl Served {
    fn start(folder: &Folder, words: &str) -> Self {
        let words = format!("view {words} --address 127.0.0.1:0 --no-browser --json");
        let mut command = folder.command(&words);
        let mut program = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("erfgs starts");
        let mut stderr = BufReader::new(program.stderr.take().expect("stderr"));
        let mut stdout = BufReader::new(program.stdout.take().expect("stdout"));
        let (say, said) = mpsc::channel();
        std::thread::spawn(move || {
            let mut line = String::new();
            while stderr.read_line(&mut line).is_ok_and(|bytes| bytes > 0) {
                let _ = say.send(std::mem::take(&mut line));
            }
        });
        let mut text = String::new();
        while !text.trim_end().ends_with("\n}") {
            let bytes = stdout.read_line(&mut text).expect("stdout");
            assert!(bytes > 0, "it ended: {text} {:?}", said.iter().collect::<Vec<_>>());
        }
        let figures: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert!(figures["models"][0]["gaussians"].as_u64().expect("a count") > 0);
        Self { program, link: figures["link"].as_str().expect("a link").to_owned(), said }
    }

    /// Host and port, and the token.
    fn parts(&self) -> (&str, &str) {
        self.link.strip_prefix("http://").and_then(|link| link.split_once("/?token=")).expect("a link with a token")
    }

    /// Status and body of the answer to a request with these further headers.
    fn ask(&self, method: &str, path: &str, headers: &str, body: &[u8]) -> (u16, Vec<u8>) {
        let (host, _) = self.parts();
        let mut stream = TcpStream::connect(host).expect("the page listens");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a time limit");
        let length = body.len();
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Length: {length}\r\n{headers}\r\n"
        )
        .and_then(|()| stream.write_all(body))
        .expect("the request is taken");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("an answer");
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("headers") + 4;
        let status = std::str::from_utf8(&answer[9..12]).expect("a status").parse().expect("a number");
        (status, answer.split_off(end))
    }

    /// As [`Self::ask`], by who knows the token.
    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        let (_, token) = self.parts();
        self.ask("GET", path, &format!("Authorization: Bearer {token}\r\n"), &[])
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

/// PSNR (dB) and mode of `count` pictures that a browser compared.
fn compared(served: &Served, count: usize) -> Vec<(String, f64)> {
    let until = Instant::now() + Duration::from_secs(300);
    let mut found = Vec::new();
    let mut all = Vec::new();
    while found.len() < count {
        let left = until.saturating_duration_since(Instant::now());
        let line =
            served.said.recv_timeout(left).unwrap_or_else(|_| panic!("only {found:?} of {count}; it said {all:?}"));
        // `cam0 at 0.25, tiles: 93.1 dB against this machine's rendering, 1 of 255 at most`
        if let Some((mode, rest)) = line.split_once(": ").and_then(|(who, rest)| Some((who.rsplit_once(", ")?.1, rest)))
        {
            let psnr = rest.split(' ').next().and_then(|number| number.parse().ok());
            found.extend(psnr.map(|psnr| (mode.to_owned(), psnr)));
        }
        all.push(line);
    }
    found
}

#[test]
fn a_browser_shows_what_the_trainer_would() {
    let folder = Folder::new();
    film_small(&folder);
    for (motion, run) in [("free-time", "explicit"), ("hexplane", "field")] {
        folder.succeed(&format!("train ds --out {run} --motion {motion} --iterations 20+20 -q"));
    }
    let served = Served::start(&folder, "explicit field");
    the_server_answers_its_user_alone(&served);
    let mut browser = Browser::start();
    browser.open(&format!("{}&check=2&renderer=webgpu", served.link));
    // Two runs, two cameras each, exactly and fast.
    for (mode, psnr) in compared(&served, 8) {
        let least = if mode == "tiles" { 60.0 } else { 45.0 };
        assert!(psnr > least, "{mode}: {psnr} dB");
    }
    // Where the browser has no graphics processor, it is sent pictures: JPEG, which costs a little.
    browser.open(&format!("{}&check=1&renderer=server", served.link));
    for (mode, psnr) in compared(&served, 4) {
        assert!(psnr > 30.0, "{mode}, sent: {psnr} dB");
    }
}

/// Who has no token, or asks for what is not there, is refused and told why.
fn the_server_answers_its_user_alone(served: &Served) {
    assert_eq!(served.ask("GET", "/", "", &[]).0, 401);
    assert_eq!(served.ask("GET", "/api/scene/0", "Cookie: erfgs_token=0\r\n", &[]).0, 401);
    assert_eq!(served.get("/").0, 200);
    let (status, models) = served.get("/api/models");
    assert_eq!(status, 200);
    let models: serde_json::Value = serde_json::from_slice(&models).expect("JSON");
    let (status, scene) = served.get("/api/scene/1");
    assert_eq!((status, scene.len() as u64), (200, models[1]["bytes"].as_u64().expect("a size")));
    assert!(scene.starts_with(b"ERFGS4D1"));
    for path in
        ["/api/scene/2", "/file/js/none.js", "/file/../Cargo.toml", "/file/train/none.wgsl", "/api/frame/0/none/0"]
    {
        assert_eq!(served.get(path).0, 404, "{path}");
    }
    let header: serde_json::Value =
        serde_json::from_slice(&scene[12..12 + u32::from_le_bytes(scene[8..12].try_into().expect("four")) as usize])
            .expect("JSON");
    let camera = header["cameras"]
        .as_array()
        .expect("cameras")
        .iter()
        .find(|camera| !camera["frames"].as_array().expect("frames").is_empty());
    let camera = camera.expect("a camera with frames")["name"].as_str().expect("a name");
    assert!(served.get(&format!("/api/frame/0/{camera}/0")).1.starts_with(b"\x89PNG"));
    for path in [format!("/api/frame/0/{camera}/9999"), "/api/frame/0/..%2F..%2Fdataset.json/0".into()] {
        assert_eq!(served.get(&path).0, 404, "{path}");
    }
    for query in ["", "t01=0.5", "t01=2&view={}", "t01=0.5&view=%7B%7D", "t01=NaN&view=0"] {
        let (status, why) = served.get(&format!("/api/render/0?{query}"));
        assert!((400..500).contains(&status) && !why.is_empty(), "{query}: {status}");
    }
}

#[test]
fn a_run_becomes_a_page_of_one_file() {
    let folder = Folder::new();
    film_small(&folder);
    folder.succeed("train ds --out run --iterations 20+20 -q");
    folder.succeed("export run --to html --out one.html");
    let page = std::fs::read_to_string(folder.path("one.html")).expect("a page");
    assert!(page.contains("id=\"scene0\"") && !page.contains("src=\""), "it needs nothing else");
    let said = folder.fail(2, "export run --to html --out one.html");
    assert!(said.contains("--force"), "{said}");
    folder.succeed("export run --to html --out one.html --force");
    let said = folder.fail(2, "export one.html --to html --out two.html");
    assert!(said.contains("is no run"), "{said}");
    // Opened from the disk it draws: the page is not of one colour.
    let mut browser = Browser::start();
    browser.open(&format!("file://{}#t=0.1", folder.path("one.html").display()));
    browser.wait("document.body?.dataset.drawn > 0");
    let picture = browser.screenshot();
    let (width, height) = picture.dimensions();
    let at = |x: u32, y: u32| picture.get_pixel(x * width / 16, y * height / 16).0;
    let seen: std::collections::BTreeSet<[u8; 3]> = (4..12).flat_map(|x| (3..9).map(move |y| at(x, y))).collect();
    assert!(seen.len() > 10, "{} colours", seen.len());
    // Time goes on, stops, and is in the link with the camera.
    assert_eq!(browser.evaluate("document.getElementById('time').value"), "0.100");
    browser.evaluate("document.getElementById('play').click()");
    browser.wait(
        "Number(document.getElementById('time').value) > 0.12 || Number(document.getElementById('time').value) < 0.1",
    );
    browser.evaluate("document.getElementById('play').click()");
    let camera = "document.getElementById('camera')";
    browser.evaluate(&format!("{camera}.selectedIndex = 2; {camera}.dispatchEvent(new Event('change'))"));
    browser.wait(&format!("location.hash.includes('camera=' + {camera}.value) && location.hash.includes('t=0.')"));
    assert_eq!(browser.evaluate("document.getElementById('trouble').textContent"), "");
}
