//! A long take: trained in windows with one static set, and played one after another.

use std::{fs, path::Path};

use erfgs_splat::gaussians::{CORE, sh_stride};
use erfgs_stage::{EventOptions, FilmOptions, RigOptions, StageOptions, film, motion::Ball};
use erfgs_train::checkpoint::Checkpoint;

use super::{
    Folder,
    browser::Browser,
    view::{Served, compared},
};
use crate::recording;

const PLAN: &str = r#"
evaluate = false
[train]
iterations = "20+40"
[[take]]
session = "take.mcap"
rig = "rig.json"
from = 1.5
seconds = 0.4
window = 0.25
overlap = 0.1
import = ["--test", "test00"]
points = ["--method", "random", "--random-points", "400", "--moving", "4", "--moving-points", "400"]
"#;

/// Rows of the Gaussians that are a static set, or that stand still.
fn still(run: &Path, fixed_alone: bool) -> Vec<Vec<u32>> {
    let Checkpoint { population, fixed, .. } = Checkpoint::load(&run.join("checkpoint.bin")).expect("a checkpoint");
    let learned = population.gaussians;
    let from = if fixed_alone { learned.len() - fixed } else { learned.dynamic };
    let stride = sh_stride(learned.sh_degree);
    let row = |index: usize| {
        let values = learned.core[index * CORE..][..CORE].iter().chain(&learned.sh[index * stride..][..stride]);
        values.map(|value| value.to_bits()).collect()
    };
    (from..learned.len()).map(row).collect()
}

#[test]
fn windows_share_what_stands_still_and_are_played_one_after_another() {
    let folder = Folder::new();
    for file in ["take.mcap", "rig.json"] {
        fs::copy(recording::dataset::FILM.path().join(file), folder.path(file)).expect("copied");
    }
    fs::write(folder.path("long.toml"), PLAN).expect("a plan");
    let listing = folder.figures("sweep long.toml --dry-run --local");
    assert_eq!(
        (&listing["jobs"][0]["after"], &listing["jobs"][1]["after"]),
        (&().into(), &"take-w000-s0".into()),
        "{listing}"
    );
    // A field that moves everything has no such set.
    fs::write(folder.path("field.toml"), PLAN.replace("[train]\n", "[train]\npreset = \"paper\"\n")).expect("a plan");
    assert!(folder.figures("sweep field.toml --dry-run --local")["jobs"][1]["after"].is_null());
    fs::write(folder.path("each.toml"), format!("{PLAN}one_static_set = false\n")).expect("a plan");
    assert!(folder.figures("sweep each.toml --dry-run --local")["jobs"][1]["after"].is_null());
    assert!(folder.fail(1, "view long").contains("long"), "there is none yet");

    // Two at once: the second window waits for the first.
    let status = folder.figures("sweep long.toml --local --at-once 2");
    assert!(status["jobs"].as_array().expect("jobs").iter().all(|job| job["state"] == "done"), "{status}");
    let [first, second] = ["take-w000-s0", "take-w001-s0"].map(|run| folder.path("long/runs").join(run));
    let (of_first, taken_over) = (still(&first, false), still(&second, true));
    // After so few iterations the set is not like the frames in many places.
    assert!(4 * taken_over.len() > of_first.len(), "{} of {}", taken_over.len(), of_first.len());
    let known: std::collections::BTreeSet<_> = of_first.into_iter().collect();
    assert!(taken_over.iter().all(|row| known.contains(row)), "they are as they were, to the bit");
    let log = fs::read_to_string(folder.path("long/logs/take-w001-s0.log")).expect("a log");
    assert!(log.contains("of the static set agree with the frames"), "{log}");

    refused(&folder);
    played(&folder);
}

/// What a static set cannot be taken over from, or by.
fn refused(folder: &Folder) {
    let dataset = "long/datasets/take-w001";
    let first = "long/runs/take-w000-s0";
    let stderr = folder.fail(1, &format!("train {dataset} --static {first} --motion hexplane --out x -q"));
    assert!(stderr.contains("--motion free-time"), "{stderr}");
    let stderr = folder.fail(1, &format!("train {dataset} --static nowhere --out x -q"));
    assert!(stderr.contains("nowhere"), "{stderr}");
    folder.succeed(&format!(
        "train {dataset} --set dynamic.skip_static=false --motion hexplane --iterations 2+2 --out all -q"
    ));
    let stderr = folder.fail(1, &format!("train {dataset} --static all --out x -q"));
    assert!(stderr.contains("has no static Gaussians"), "{stderr}");
    // A run goes on with the set that it began with, and with no other.
    folder.succeed(&format!(
        "train {dataset} --static {first} --seed 0 --iterations 20+40 --out long/runs/take-w001-s0 --resume -q"
    ));
    let second = "long/runs/take-w001-s0";
    let stderr = folder.fail(2, &format!("train {dataset} --static {second} --seed 0 --out {second} --resume -q"));
    assert!(stderr.contains("static_set"), "{stderr}");
    assert!(folder.fail(2, "view long --take other").contains("take-s0"));
    // Of a take that is not done, what there is is shown.
    fs::rename(folder.path(second), folder.path("aside")).expect("moved");
    let output = folder.run("export long --to html --out part.html");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && stderr.contains("1 of 2 windows of take-s0"), "{stderr}");
    fs::rename(folder.path("aside"), folder.path(second)).expect("moved back");
    assert!(folder.fail(2, "export long --to e4d --out take.e4d").contains("--to html"));
}

/// The page of the take, from a disk and served.
fn played(folder: &Folder) {
    let mut browser = Browser::unseen();
    let window = |number: u32| format!("document.body?.dataset.window === '{number}'");
    let go = |browser: &mut Browser, seconds: f64| {
        let time = "document.getElementById('time')";
        browser.evaluate(&format!("{time}.value = {seconds}; {time}.dispatchEvent(new Event('change'))"));
    };
    browser.open(&format!("file://{}#t=0.05", folder.path("long/takes/take-s0.html").display()));
    browser.wait(&window(0));
    let seconds = browser.evaluate("Number(document.getElementById('time').max)").as_f64().expect("a length");
    assert!((0.35..0.42).contains(&seconds), "{seconds} s");
    go(&mut browser, 0.3);
    browser.wait(&window(1));
    go(&mut browser, 0.1);
    browser.wait(&window(0));

    let served = Served::start(folder, "long");
    let models = served.page.json("/api/models");
    let of = |number: usize, what: &str| models[number]["window"][what].as_f64().expect("seconds");
    assert!((of(0, "until") - of(1, "from")).abs() < 1e-9 && of(1, "from") > of(1, "begins"), "{models}");
    // What is rendered at an instant is what the window shows that the page does.
    let at = of(1, "begins") - of(0, "from") + 0.15;
    folder.succeed(&format!("render long --path camera rgb00 --times {at} --out of-take -q"));
    folder.succeed("render long/runs/take-w001-s0 --path camera rgb00 --times 0.15 --out of-run -q");
    let picture = |of: &str| fs::read(folder.path(of).join("00000.png")).expect("a picture");
    assert!(picture("of-take") == picture("of-run"));
    browser.open(&format!("{}&check=1&renderer=webgpu", served.page.link));
    for (mode, psnr) in compared(&served, 4) {
        let least = if mode == "tiles" { 60.0 } else { 45.0 };
        assert!(psnr > least, "{mode}: {psnr} dB");
    }
    // Frames are those of the window that is seen, also where the server draws.
    for renderer in ["webgpu", "server"] {
        browser.open(&format!("{}&renderer={renderer}#t=0.35&camera=rgb00", served.page.link));
        browser.wait(&window(1));
        let mode = "document.getElementById('recordedmode')";
        browser.evaluate(&format!("{mode}.value = 'over'; {mode}.dispatchEvent(new Event('input'))"));
        let source = "(document.getElementById('recorded').getAttribute('src') ?? '')";
        browser.wait(&format!("{source}.startsWith('api/frame/1/rgb00/')"));
        go(&mut browser, 0.0);
        browser.wait(&format!("{source} === 'api/frame/0/rgb00/0'"));
        browser.wait(&window(0));
        browser.wait("document.getElementById('trouble').hidden");
    }
}

/// A static set of a moment in which all that moves hung in the air.
#[test]
fn what_no_longer_stands_where_it_stood_is_learned_anew() {
    let folder = Folder::new();
    let stage = StageOptions { samples_per_axis: 1, ..StageOptions::default() };
    let options = FilmOptions {
        stage,
        rig: RigOptions { width: 96, height: 72, rgb: 6, event: 1, test: 1, ..RigOptions::default() },
        events: EventOptions::default(),
        duration_ns: 250_000_000,
        rgb_fps: 20.0,
        exposure_ns: 5_000_000,
        truth_points: 0,
        ..FilmOptions::default()
    };
    film(&folder.path("ds"), &options, &|_| {}).expect("a film");
    folder.succeed("dataset variant ds --subsample 100 --out instant");
    folder.succeed("dataset points instant --method sweep");
    folder.succeed("dataset points ds --method random --random-points 400 --moving 4 --moving-points 400");
    folder.succeed("train instant --motion still --iterations 200+10 --no-evaluation --out frozen -q");
    folder.succeed("train ds --static frozen --iterations 10 --no-evaluation --out run -q");
    let ball = Ball::default();
    let centre = ball.centre(0.0).as_vec3();
    let in_the_ball = |rows: &[Vec<u32>]| {
        let place = |row: &Vec<u32>| glam::Vec3::from_array([0, 1, 2].map(|axis| f32::from_bits(row[axis])));
        rows.iter().filter(|row| place(row).distance(centre) < 1.2 * ball.radius as f32).count()
    };
    let (frozen, kept) = (still(&folder.path("frozen"), false), still(&folder.path("run"), true));
    assert!(in_the_ball(&frozen) > 8, "it was there");
    assert_eq!(in_the_ball(&kept), 0, "and is not any more");
    assert!(10 * kept.len() > 7 * frozen.len(), "{} of {} stay", kept.len(), frozen.len());
}
