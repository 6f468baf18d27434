//! `erfgs view`: what it serves, to whom, and whether a browser shows what the trainer would.

use std::{
    io::{BufRead, BufReader},
    process::Stdio,
    sync::mpsc,
    time::{Duration, Instant},
};

use super::{
    Folder,
    browser::Browser,
    page::{Page, Program, film_small, header, lines},
};

/// The page of runs, until it is dropped.
pub struct Served {
    _program: Program,
    pub page: Page,
    /// Lines on stderr.
    stderr: mpsc::Receiver<String>,
}

impl Served {
    pub fn start(folder: &Folder, words: &str) -> Self {
        let words = format!("view {words} --address 127.0.0.1:0 --no-browser --json");
        let mut command = folder.command(&words);
        let mut program = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("erfgs starts");
        let mut stdout = BufReader::new(program.stdout.take().expect("stdout"));
        let stderr = lines(program.stderr.take().expect("stderr"));
        let program = Program(program);
        let mut text = String::new();
        while !text.trim_end().ends_with("\n}") {
            let bytes = stdout.read_line(&mut text).expect("stdout");
            assert!(bytes > 0, "it ended: {text} {:?}", stderr.iter().collect::<Vec<_>>());
        }
        let figures: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert!(figures["models"][0]["gaussians"].as_u64().expect("a count") > 0);
        Self { _program: program, page: Page { link: figures["link"].as_str().expect("a link").to_owned() }, stderr }
    }
}

/// PSNR (dB) and mode of `count` pictures that a browser compared.
pub fn compared(served: &Served, count: usize) -> Vec<(String, f64)> {
    let until = Instant::now() + Duration::from_secs(300);
    let mut found = Vec::new();
    let mut all = Vec::new();
    while found.len() < count {
        let left = until.saturating_duration_since(Instant::now());
        let line =
            served.stderr.recv_timeout(left).unwrap_or_else(|_| panic!("only {found:?} of {count}; it said {all:?}"));
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
    // Paths through knots; parabolas are those of the exported page. Lives reach from a frame to the next, since the page is looked
    // at between frames, when nothing was born there yet.
    let explicit = "free-time --set free_time.knots=2 --set free_time.first_life=1 --set free_time.least_life=0.5";
    for (motion, run) in [(explicit, "explicit"), ("hexplane", "field")] {
        folder.succeed(&format!("train ds --out {run} --motion {motion} --iterations 20+20 -q"));
    }
    let served = Served::start(&folder, "explicit field");
    the_server_answers_its_user_alone(&served.page);
    let mut browser = Browser::start();
    browser.open(&format!("{}&check=2&renderer=webgpu", served.page.link));
    // Two runs, two cameras each, exactly and fast.
    for (mode, psnr) in compared(&served, 8) {
        let least = if mode == "tiles" { 60.0 } else { 45.0 };
        assert!(psnr > least, "{mode}: {psnr} dB");
    }
    the_page_shows_more_than_the_picture(&folder, &served, &mut browser);
    scenes_are_shown_as_they_come_and_damaged_ones_are_refused(&mut browser);
    the_order_is_the_same_whoever_sorts(&mut browser);
    the_picture_fits_its_place_and_comes_back_after_the_device_was_lost(&mut browser);
    a_page_that_is_hidden_rests(&mut browser);
    // Where the browser has no graphics processor, it is sent pictures: JPEG, which costs a little.
    browser.open(&format!("{}&check=1&renderer=server", served.page.link));
    for (mode, psnr) in compared(&served, 4) {
        assert!(psnr > 30.0, "{mode}, sent: {psnr} dB");
    }
}

/// On a software renderer the page sorts by itself.
fn the_order_is_the_same_whoever_sorts(browser: &mut Browser) {
    let seen = browser.evaluate(
        "(async () => {
           const at = (name) => import(new URL(`file/js/${name}`, location.href));
           const [{ open, onProcessor }, { SceneReader }, { Viewer }, { sorted }, source] =
             await Promise.all(['gpu.js', 'scene.js', 'viewer.js', 'sort.js', 'source.js'].map(at));
           const gpu = await open(navigator.gpu);
           const found = gpu.onProcessor;
           const bytes = new Uint8Array(await (await fetch('api/scene/0')).arrayBuffer());
           const reader = new SceneReader(bytes.length);
           reader.push(bytes);
           const scene = await reader.better(Infinity);
           const texts = { train: (name) => source.text(`train/${name}`), own: (name) => source.text(`wgsl/${name}`) };
           const viewer = await Viewer.make(gpu, texts, scene, 'rgba8unorm');
           await viewer.sorter.prepare();
           const view = { ...scene.header.cameras[0], near: 0.2 };
           const pictures = [];
           // Two that overlap take turns.
           for (const here of [true, false]) {
             gpu.onProcessor = here;
             pictures.push(...await Promise.all([0.3, 0.8].map((t01) => viewer.pixels(view, t01, { mode: 'quads', near: 0.2 }))));
           }
           const same = (a, b) => a.length === b.length && a.every((value, k) => value === b[k]);
           return {
             found,
             same: [same(pictures[0], pictures[2]), same(pictures[1], pictures[3]), same(pictures[0], pictures[1])],
             bright: pictures[0].filter((value, k) => k % 4 < 3 && value > 60).length,
             order: [...sorted(Uint32Array.of(3, 65535, 0, 3, 1), 16)],
             other: onProcessor({ info: { vendor: 'nvidia', architecture: 'hopper', device: '', description: '' } }),
           };
         })()",
    );
    assert_eq!(seen["found"], true, "{seen}");
    assert_eq!(seen["same"], serde_json::json!([true, true, false]), "{seen}");
    assert!(seen["bright"].as_u64() > Some(500), "{seen}");
    assert_eq!(seen["order"], serde_json::json!([2, 4, 0, 3, 1]));
    assert_eq!(seen["other"], false);
}

/// The page's reader, with the scene that the page shows.
fn scenes_are_shown_as_they_come_and_damaged_ones_are_refused(browser: &mut Browser) {
    let with_reader = |body: &str| {
        format!(
            "(async () => {{
              const {{ SceneReader }} = await import(new URL('file/js/scene.js', location.href));
              const bytes = new Uint8Array(await (await fetch('api/scene/0')).arrayBuffer());
              const read = async (bytes) => {{
                const reader = new SceneReader(bytes.length);
                reader.push(bytes);
                reader.end();
                return reader.better(Infinity);
              }};
              {body}
            }})()"
        )
    };
    let seen = browser.evaluate(&with_reader(
        "const reader = new SceneReader(bytes.length);
         const seen = [];
         for (let at = 0, best = 0; at < bytes.length; at += 500) {
           reader.push(bytes.subarray(at, at + 500));
           if (reader.best > best) {
             const scene = await reader.better();
             best = reader.best;
             seen.push({ share: reader.share, count: scene.count, dynamic: scene.dynamic, whole: scene.whole,
               rows: [scene.core, scene.sh, scene.rows].map((rows) => rows?.length ?? 0) });
           }
         }
         const all = await read(bytes);
         const { core } = all;
         const opacity = (k) => 1 / (1 + Math.exp(-core[12 * k + 10]));
         return { seen, same: seen.at(-1).rows[0] === core.length, opacities: Array.from({ length: all.count }, (_, k) => opacity(k)) };",
    ));
    let steps = seen["seen"].as_array().expect("steps");
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    // The header, an eighth, half, all.
    assert_eq!(steps.len(), 4, "{steps:?}");
    let count = number(&steps[3]["count"]);
    let shares: Vec<f64> = steps.iter().map(|step| number(&step["count"]) / count).collect();
    assert!(shares[0] == 0.0 && (0.125..0.13).contains(&shares[1]) && (0.5..0.51).contains(&shares[2]), "{shares:?}");
    // The header is large in so small a scene.
    let bytes: Vec<f64> = steps.iter().map(|step| number(&step["share"])).collect();
    assert!(bytes[1] - bytes[0] < 0.2 && bytes[2] < 0.8, "{bytes:?}");
    for step in steps {
        assert_eq!(number(&step["rows"][0]), 12.0 * number(&step["count"]), "{step}");
        assert!(number(&step["rows"][2]) >= 8.0 * number(&step["dynamic"]), "{step}");
    }
    assert_eq!((&steps[2]["whole"], &steps[3]["whole"], &seen["same"]), (&false.into(), &true.into(), &true.into()));

    let messages = browser.evaluate(&with_reader(
        "const said = {};
         const attempt = async (bytes) => {
           const what = await read(bytes).then((scene) => (scene.core.length === 12 * scene.count ? 'a scene' : 'another'), (error) => error.message);
           said[what] = (said[what] ?? 0) + 1;
         };
         for (let k = 0; k < 40; k++) await attempt(bytes.slice(0, Math.floor(bytes.length * k / 40)));
         for (let k = 0; k < 400; k++) {
           const changed = bytes.slice();
           changed[(k * 7919) % 4000] ^= 1 << k % 8;
           await attempt(changed);
         }
         return said;",
    ));
    let messages = messages.as_object().expect("what was said");
    let known = ["a scene", "The scene is cut off", "The scene is damaged", "This is no scene of erfgs"];
    assert!(messages.keys().all(|what| known.iter().any(|known| what.starts_with(known))), "{messages:?}");
    assert!(known[1..].iter().all(|known| messages.keys().any(|what| what.starts_with(known))), "{messages:?}");
}

fn drawn(browser: &mut Browser) -> u64 {
    let count = browser.evaluate("document.body.dataset.drawn");
    count.as_str().and_then(|count| count.parse().ok()).expect("a count")
}

fn a_page_that_is_hidden_rests(browser: &mut Browser) {
    let before = drawn(browser);
    browser.evaluate("document.getElementById('play').click()");
    browser.wait(&format!("document.body.dataset.drawn > {}", before + 1));
    browser.hide(|browser| {
        // A picture that was begun is ended.
        browser.wait("document.hidden && !document.body.dataset.busy");
        let (count, time) = (drawn(browser), browser.evaluate("location.hash"));
        // That nothing happens is seen by time alone.
        std::thread::sleep(Duration::from_secs(2));
        assert_eq!((drawn(browser), browser.evaluate("location.hash")), (count, time));
    });
    let before = drawn(browser);
    browser.wait(&format!("!document.hidden && document.body.dataset.drawn > {}", before + 1));
    browser.wait("document.getElementById('trouble').hidden");
    browser.evaluate("document.getElementById('play').click()");
}

fn the_picture_fits_its_place_and_comes_back_after_the_device_was_lost(browser: &mut Browser) {
    let fits = "document.getElementById('frame').clientHeight <= document.getElementById('stage').clientHeight";
    browser.wait(fits);
    let before = browser.evaluate("document.getElementById('stage').clientHeight");
    browser.evaluate("document.querySelector('#more summary').click()");
    browser.wait(&format!("document.getElementById('stage').clientHeight < {before} && {fits}"));
    browser.crash_gpu();
    let before = drawn(browser);
    let turn = "document.getElementById('stage').dispatchEvent(new WheelEvent('wheel', { deltaY: 50 }))";
    browser.wait(&format!("({turn}, document.body.dataset.drawn > {})", before + 2));
    browser.wait("document.getElementById('trouble').hidden");
    // It is no black picture.
    let picture = browser.screenshot();
    assert!(picture.pixels().filter(|pixel| pixel.0.iter().any(|&value| value > 90)).count() > 1000);
}

/// Cameras, velocities and events over the picture, other looks, parts of the scene, errors on the line of time, and a path that
/// `erfgs render` takes.
fn the_page_shows_more_than_the_picture(folder: &Folder, served: &Served, browser: &mut Browser) {
    browser.open(&format!("{}&renderer=webgpu#t=0.15", served.page.link));
    browser.wait("document.body?.dataset.drawn > 0");
    // Waits until the page has drawn what was asked for by a change of `id`.
    let change = |browser: &mut Browser, id: &str, how: &str| {
        let drawn = browser.evaluate("document.body.dataset.drawn");
        let element = format!("document.getElementById('{id}')");
        browser.evaluate(&format!("{element}.{how}; {element}.dispatchEvent(new Event('input'))"));
        browser.wait(&format!("document.body.dataset.drawn > {}", drawn.as_str().expect("a count")));
    };
    let painted = "(() => { const c = document.getElementById('overlay'); \
                   const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
                   let n = 0; for (let i = 3; i < p.length; i += 4) n += p[i] > 0; return n; })()";
    assert_eq!(browser.evaluate(painted), 0);
    // From far away, all cameras are in view.
    browser.evaluate("document.getElementById('stage').dispatchEvent(new WheelEvent('wheel', { deltaY: 1000 }))");
    for id in ["cameras", "velocities"] {
        change(browser, id, "checked = true");
        browser.wait(&format!("{painted} > 20"));
        change(browser, id, "checked = false");
        browser.wait(&format!("{painted} === 0"));
    }
    assert_eq!(browser.evaluate("document.querySelectorAll('.body').length"), 0, "there are no bodies");
    // Pictures of other looks and parts differ from each other.
    let mut pictures = vec![browser.screenshot()];
    for (id, value) in [("look", "depth"), ("look", "ellipsoids"), ("layer", "move"), ("layer", "stand")] {
        // Those that move are faint here, and no ellipsoids for a part of their lives.
        if id == "layer" {
            change(browser, "look", "value = 'colours'");
        }
        change(browser, id, &format!("value = '{value}'"));
        let picture = browser.screenshot();
        let stage = |picture: &image::RgbImage| {
            let (width, height) = picture.dimensions();
            image::imageops::crop_imm(picture, 0, height / 10, width, height / 2).to_image().into_raw()
        };
        assert!(pictures.iter().all(|other| stage(other) != stage(&picture)), "{id} {value} changes nothing");
        pictures.push(picture);
    }
    let camera = "document.getElementById('camera')";
    let event = format!("[...{camera}.options].find((option) => option.text.includes('(event'))?.value");
    browser.evaluate(&format!("{camera}.value = {event}; {camera}.dispatchEvent(new Event('change'))"));
    browser.wait("!document.getElementById('eventslabel').hidden");
    change(browser, "events", "value = '100'");
    browser.wait(&format!("{painted} > 20"));

    // Two key frames, at two instants; the file is caught where the browser would save it.
    browser.evaluate("URL.createObjectURL = (blob) => { blob.text().then((text) => { document.body.dataset.file = text; }); return '#'; }");
    for (name, time) in [("test00", "0.05"), ("rgb00", "0.2")] {
        browser.evaluate(&format!("{camera}.value = '{name}'; {camera}.dispatchEvent(new Event('change'))"));
        let field = "document.getElementById('time')";
        browser.evaluate(&format!("{field}.value = '{time}'; {field}.dispatchEvent(new Event('change'))"));
        browser.evaluate("document.getElementById('addkey').click()");
    }
    browser.evaluate("document.getElementById('savepath').click()");
    browser.wait("document.body.dataset.file");
    let file = browser.evaluate("document.body.dataset.file");
    let path: serde_json::Value = serde_json::from_str(file.as_str().expect("a text")).expect("JSON");
    let times = [0, 1].map(|key| path["times_s"][key].as_f64().expect("a time"));
    assert!((times[0] - 0.05).abs() < 1e-6 && (times[1] - 0.2).abs() < 1e-6, "{times:?}");
    let manifest = std::fs::read(folder.path("ds/dataset.json")).expect("a manifest");
    let manifest: serde_json::Value = serde_json::from_slice(&manifest).expect("JSON");
    let of = manifest["cameras"].as_array().expect("cameras").iter().find(|camera| camera["name"] == "test00");
    let place = |pose: &serde_json::Value| [0, 1, 2].map(|axis| pose["translation_m"][axis].as_f64().expect("metres"));
    let (saved, known) = (place(&path["world_to_camera"][0]), place(&of.expect("test00")["world_to_camera"]));
    assert!(saved.iter().zip(known).all(|(saved, known)| (saved - known).abs() < 1e-4), "{saved:?} {known:?}");
    std::fs::write(folder.path("path.json"), path.to_string()).expect("a file");
    let rendered = folder.figures("render explicit --path path.json --frames 3 --scale 0.1 --out walk");
    assert_eq!(rendered["frames"], 3);
    let stderr = folder.fail(2, "render explicit --path path.json --times 0.1 --frames 3 --out other");
    assert!(stderr.contains("times of its own"), "{stderr}");
    assert_eq!(browser.evaluate("document.getElementById('trouble').textContent"), "");
}

/// Who has no token, or asks for what is not there, is refused and told why.
fn the_server_answers_its_user_alone(served: &Page) {
    assert_eq!(served.ask("GET", "/", "", &[]).0, 401);
    assert_eq!(served.ask("GET", "/api/scene/0", "Cookie: erfgs_token=0\r\n", &[]).0, 401);
    assert_eq!(served.get("/").0, 200);
    let models = served.json("/api/models");
    let (status, scene) = served.get("/api/scene/1");
    assert_eq!((status, scene.len() as u64), (200, models[1]["bytes"].as_u64().expect("a size")));
    let header = header(&scene);
    // Nothing is trained here.
    assert_eq!((served.get("/api/training").0, served.known("POST", "/api/training/stop").0), (404, 404));
    assert_eq!(served.json("/api/errors/0"), serde_json::json!([]), "nothing was evaluated");
    for path in ["/api/events/0/none?from=0&to=1", "/api/events/9/none?from=0&to=1"] {
        assert_eq!(served.get(path).0, 404, "{path}");
    }
    for path in
        ["/api/scene/2", "/file/js/none.js", "/file/../Cargo.toml", "/file/train/none.wgsl", "/api/frame/0/none/0"]
    {
        assert_eq!(served.get(path).0, 404, "{path}");
    }
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
    assert!(page.contains("id=\"scene0.0\"") && !page.contains("src=\""), "it needs nothing else");
    let stderr = folder.fail(2, "export run --to html --out one.html");
    assert!(stderr.contains("--force"), "{stderr}");
    folder.succeed("export run --to html --out one.html --force");
    let stderr = folder.fail(2, "export one.html --to html --out two.html");
    assert!(stderr.contains("is no run"), "{stderr}");
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
    scene_files_keep_what_is_seen(&folder);
    // The report has the same page in a frame, which loads when it is opened.
    folder.succeed("report run --out report.html");
    let whole = std::fs::metadata(folder.path("report.html")).expect("a page").len();
    browser.open(&format!("file://{}", folder.path("report.html").display()));
    let frame = "document.querySelector('iframe.view').contentDocument";
    browser.wait(&format!("{frame}.readyState === 'complete' && !{frame}.body.dataset.drawn"));
    browser
        .evaluate("document.querySelector('#walk summary').click(); document.getElementById('walk').scrollIntoView()");
    browser.wait(&format!("{frame}.body?.dataset.drawn > 0"));
    folder.succeed("report run --no-view --out report.html");
    assert!(std::fs::metadata(folder.path("report.html")).expect("a page").len() < whole);
}

/// The scene alone: packed or to the bit, for `erfgs view`, and in the open container.
fn scene_files_keep_what_is_seen(folder: &Folder) {
    let packed = folder.figures("export run --to e4d --out packed.e4d");
    let exact = folder.figures("export run --to e4d --exact --out exact.e4d");
    let size = |figures: &serde_json::Value| figures["bytes"].as_u64().expect("a size");
    // The header is half of so small a scene.
    assert!(2 * size(&packed) < size(&exact), "{packed} {exact}");
    assert!(packed["psnr_db"].as_f64().expect("dB") > 40.0, "{packed}");
    let served = Served::start(folder, "packed.e4d exact.e4d");
    let headers = [0, 1].map(|model| header(&served.page.get(&format!("/api/scene/{model}")).1));
    assert_eq!(headers[0]["count"], headers[1]["count"]);
    assert_eq!(served.page.json("/api/models")[0]["from_run"], false);
    // What only a run has is refused with its reason.
    assert_eq!(served.page.get("/api/frame/0/cam0/0").0, 404);
    let mut view = headers[0]["cameras"][0].clone();
    for other in ["name", "split", "modality", "near", "frames"] {
        view.as_object_mut().expect("a camera").remove(other);
    }
    let view = view.to_string();
    let view: String = view.bytes().map(|byte| format!("%{byte:02x}")).collect();
    let (status, why) = served.page.get(&format!("/api/render/0?t01=0.5&view={view}"));
    assert!(status == 400 && String::from_utf8_lossy(&why).contains("scene file"), "{}", String::from_utf8_lossy(&why));
    drop(served);
    for (damaged, what) in [(&b"no scene"[..], "unpack"), (&[], "unpack")] {
        std::fs::write(folder.path("bad.e4d"), damaged).expect("a file");
        let stderr = folder.fail(1, "view bad.e4d --no-browser --address 127.0.0.1:0");
        assert!(stderr.contains("bad.e4d") && stderr.contains(what), "{stderr}");
    }

    let gltf = folder.figures("export run --to gltf --at 0.1 --out scene.glb");
    assert!(gltf["gaussians"].as_u64().expect("a count") <= headers[0]["count"].as_u64().expect("a count"), "{gltf}");
    assert!(std::fs::read(folder.path("scene.glb")).expect("a file").starts_with(b"glTF\x02\0\0\0"));
    let spz = folder.figures("export run --to spz --at 0.1 --out scene.spz");
    assert_eq!(spz["gaussians"], gltf["gaussians"]);
    assert!(4 * spz["bytes"].as_u64().expect("a size") < gltf["bytes"].as_u64().expect("a size"), "{spz} {gltf}");
    assert!(folder.fail(2, "export run --to spz --exact --out b.spz").contains("their own coding"));
    assert!(folder.fail(2, "export run --to gltf --at 99 --out b.glb").contains("behind the end"));
    assert!(folder.fail(2, "export run --to e4d --at 0.1 --out b.e4d").contains("--at"));
    let open = folder.figures("export run --to 4dgs --out scene.4dgs");
    assert!(folder.fail(2, "export run --to 4dgs --exact --out b.4dgs").contains("--exact"));
    folder.succeed("export run --instants 4 --out splats");
    let scene = open_container_shows(folder, "scene.4dgs", "splats", 0.02);
    assert_eq!(scene, open["gaussians"].as_u64().expect("a count"));
}

/// What is well seen in clouds at four instants is seen in a file of the open container, too, as opaque but for so much. Gives how many Gaussians that has.
pub fn open_container_shows(folder: &Folder, file: &str, clouds: &str, most_faded: f32) -> u64 {
    let scene = fourdgs::read_path(folder.path(file)).expect("a scene");
    for instant in 0..4 {
        let t = scene.header.duration_sec * f64::from(instant) / 3.0;
        let there = scene.gaussians.state_at(t, scene.header.cutoff);
        let path = folder.path(&format!("{clouds}/point_cloud_t/{instant:05}.ply"));
        let cloud = erfgs_scene::ply::GaussianCloud::read(&path).expect("a cloud");
        // What is well seen in one is in the other, at the same place but for a share of its size, and as opaque.
        for index in 0..cloud.len() {
            let opacity = 1.0 / (1.0 + (-cloud.opacity_logits[index]).exp());
            let ([x, y, z], size) = (cloud.positions[index], cloud.log_scales[index].map(f32::exp));
            let most = 0.01 + 0.3 * size.into_iter().fold(0.0, f32::max);
            let off = (0..there.count()).map(|k| {
                let centre = &there.centers[3 * k..];
                let away = (centre[0] - x).hypot(centre[1] - y).hypot(centre[2] - z);
                (away / most).max((there.opacity[k] - opacity).abs() / most_faded)
            });
            let off = off.fold(f32::INFINITY, f32::min);
            assert!(opacity < 0.3 || off < 1.0, "{t} s: {off} from {x} {y} {z} of opacity {opacity}");
        }
    }
    scene.gaussians.count() as u64
}
