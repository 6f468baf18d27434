//! A page that erfgs serves, asked without a browser.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    process::{Child, ChildStderr},
    sync::mpsc,
    time::Duration,
};

use super::Folder;

/// A page, by the link that was printed.
pub struct Page {
    pub link: String,
}

impl Page {
    /// Host and port, and the token.
    pub fn parts(&self) -> (&str, &str) {
        self.link.strip_prefix("http://").and_then(|link| link.split_once("/?token=")).expect("a link with a token")
    }

    /// Status and body of the answer to a request with these further headers.
    pub fn ask(&self, method: &str, path: &str, headers: &str, body: &[u8]) -> (u16, Vec<u8>) {
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
    pub fn known(&self, method: &str, path: &str) -> (u16, Vec<u8>) {
        let (_, token) = self.parts();
        self.ask(method, path, &format!("Authorization: Bearer {token}\r\n"), &[])
    }

    /// What stands at `path`, for who knows the token.
    pub fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.known("GET", path)
    }

    /// JSON that stands at `path`.
    pub fn json(&self, path: &str) -> serde_json::Value {
        let (status, body) = self.get(path);
        assert_eq!(status, 200, "{path}: {}", String::from_utf8_lossy(&body));
        serde_json::from_slice(&body).expect("JSON")
    }
}

/// The lines of stderr as they come.
pub fn lines(stderr: ChildStderr) -> mpsc::Receiver<String> {
    let mut stderr = BufReader::new(stderr);
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let mut line = String::new();
        while stderr.read_line(&mut line).is_ok_and(|bytes| bytes > 0) {
            let _ = sender.send(std::mem::take(&mut line));
        }
    });
    receiver
}

/// A program that ends with its test.
pub struct Program(pub Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The header of a scene file.
pub fn header(scene: &[u8]) -> serde_json::Value {
    assert!(scene.starts_with(b"ERFGS4D2"));
    let length = u32::from_le_bytes(scene[8..12].try_into().expect("four bytes")) as usize;
    serde_json::from_slice(&scene[12..12 + length]).expect("JSON")
}

/// `ds` in the folder: something moves before six cameras, and its hull is known.
pub fn film_small(folder: &Folder) {
    film_of(folder, "ds", [64, 48]);
}

/// The same with images of another size.
pub fn film_of(folder: &Folder, dataset: &str, [width, height]: [u32; 2]) {
    use erfgs_stage::{EventOptions, FilmOptions, RigOptions, StageOptions, film};
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width, height, rgb: 6, event: 2, test: 1, ..RigOptions::default() },
        events: EventOptions::default(),
        duration_ns: 300_000_000,
        rgb_fps: 20.0,
        test_fps: 20.0,
        truth_points: 0,
        truth: true,
        ..FilmOptions::default()
    };
    film(&folder.path(dataset), &options, &|_| {}).expect("a film");
    folder.succeed(&format!(
        "dataset points {dataset} --method random --random-points 400 --moving 4 --moving-points 400"
    ));
}
