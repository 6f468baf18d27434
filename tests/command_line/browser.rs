//! Chromium without a screen, told over the pipe of its DevTools what to do: no driver is needed.

use std::{
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Write},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use serde_json::{Value, json};

/// Longer than this nothing takes that a test waits for.
const PATIENCE: Duration = Duration::from_secs(180);

/// A browser with WebGPU on the processor, until it is dropped.
pub struct Browser {
    program: Child,
    to: File,
    from: BufReader<File>,
    /// The page that is open, and the tab that it is in.
    session: Option<String>,
    tab: Value,
    calls: u64,
    _folder: tempfile::TempDir,
}

impl Browser {
    /// One in whose screenshots there is what WebGPU draws.
    pub fn start() -> Self {
        Self::start_with("")
    }

    /// One in whose screenshots that is missing, and which takes half as much of a processor.
    pub fn unseen() -> Self {
        Self::start_with("--disable-gpu-compositing --disable-gpu-rasterization")
    }

    fn start_with(flags: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name).display().to_string();
        let [to, from] = [path("to"), path("from")];
        let made = Command::new("mkfifo").args([&to, &from]).status().expect("mkfifo");
        assert!(made.success(), "mkfifo: {made}");
        // The flags with which Chromium has WebGPU and shows it without a graphics processor. It reads what it is told from
        // descriptor 3 and answers on 4.
        let script = "exec chromium --no-sandbox --headless=new --enable-unsafe-webgpu --enable-features=Vulkan \
            --use-vulkan=swiftshader --use-angle=swiftshader --no-first-run --disable-extensions --window-size=640,480 $4 \
            --remote-debugging-pipe --user-data-dir=\"$3\" about:blank 3<\"$1\" 4>\"$2\"";
        let mut command = Command::new("bash");
        command.args(["-c", script, "chromium", &to, &from, &path("profile"), flags]);
        // Its own software renderer is the one that was tried.
        command.env_remove("VK_DRIVER_FILES").env_remove("VK_ICD_FILENAMES");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        assert!(
            Command::new("chromium").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok(),
            "chromium: scripts/setup.sh --browser"
        );
        let program = command.spawn().expect("bash");
        let to = OpenOptions::new().write(true).open(to).expect("a pipe");
        let from = BufReader::new(File::open(from).expect("a pipe"));
        Self { program, to, from, session: None, tab: Value::Null, calls: 0, _folder: folder }
    }

    /// Opens a page in place of the one that is open.
    pub fn open(&mut self, url: &str) {
        self.session = None;
        let target = self.call("Target.createTarget", &json!({ "url": url }))["targetId"].clone();
        let attached = self.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }));
        self.session = attached["sessionId"].as_str().map(str::to_owned);
        self.tab = target;
    }

    /// Has another tab before the page while `meanwhile` looks at it.
    pub fn hide(&mut self, meanwhile: impl FnOnce(&mut Self)) {
        let session = self.session.take();
        let other = self.call("Target.createTarget", &json!({ "url": "about:blank" }))["targetId"].clone();
        self.session.clone_from(&session);
        meanwhile(self);
        self.session = None;
        self.call("Target.closeTarget", &json!({ "targetId": other }));
        let tab = self.tab.clone();
        self.call("Target.activateTarget", &json!({ "targetId": tab }));
        self.session = session;
    }

    /// The value of an expression on the page.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", &parameters);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// Waits until an expression on the page is true. What cannot be evaluated yet, for the page is not there or not whole, is not.
    pub fn wait(&mut self, expression: &str) {
        let until = Instant::now() + PATIENCE;
        let tried = format!("(() => {{ try {{ return Boolean({expression}); }} catch {{ return false; }} }})()");
        let parameters = json!({ "expression": tried, "returnByValue": true });
        while !self.ask("Runtime.evaluate", &parameters).is_ok_and(|answer| answer["result"]["value"] == json!(true)) {
            if Instant::now() > until {
                let text = self.evaluate("document.body.innerText");
                panic!("{expression} does not come true; the page says {text}");
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Gives the page another size, pixels.
    pub fn resize(&mut self, width: u32, height: u32) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600 });
        self.call("Emulation.setDeviceMetricsOverride", &size);
    }

    /// Ends the process that draws, as a driver does that fails; the browser starts another.
    pub fn crash_gpu(&mut self) {
        let session = self.session.take();
        // The call itself may not be answered.
        let _ = self.ask("Browser.crashGpuProcess", &json!({}));
        self.session = session;
    }

    /// What the page looks like.
    pub fn screenshot(&mut self) -> image::RgbImage {
        let answer = self.call("Page.captureScreenshot", &json!({}));
        let png = from_base64(answer["data"].as_str().expect("a picture"));
        image::load_from_memory(&png).expect("a PNG").to_rgb8()
    }

    /// Calls a method of the DevTools protocol, which must succeed, and gives its result.
    fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.ask(method, parameters).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// Calls a method of the DevTools protocol and gives its result, or what the browser says against it.
    fn ask(&mut self, method: &str, parameters: &Value) -> Result<Value, Value> {
        self.calls += 1;
        let mut message = json!({ "id": self.calls, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        self.to.write_all(format!("{message}\0").as_bytes()).expect("the browser listens");
        loop {
            let mut answer = Vec::new();
            let bytes = self.from.read_until(0, &mut answer).expect("the browser answers");
            assert!(bytes > 0, "the browser ended while it was asked to {method}");
            let answer: Value = serde_json::from_slice(&answer[..bytes - 1]).expect("JSON");
            // Between answers it tells of events.
            if answer["id"] == self.calls {
                let error = &answer["error"];
                return if error.is_null() { Ok(answer["result"].clone()) } else { Err(error.clone()) };
            }
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn from_base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut word, mut bits) = (0_u32, 0);
    for digit in text.bytes().filter_map(|byte| DIGITS.iter().position(|&own| own == byte)) {
        word = word << 6 | digit as u32;
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            bytes.push((word >> bits) as u8);
            word &= (1 << bits) - 1;
        }
    }
    bytes
}
