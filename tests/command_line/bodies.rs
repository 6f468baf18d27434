//! A run whose Gaussians bodies carry: in a browser, in files for others, in words.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

use erfgs_dataset::{Bodies, Body, BodyPose, Dataset, SurfacePoint};
use erfgs_run::RunFolder;
use erfgs_scene::ply::GaussianCloud;
use erfgs_splat::gpu::{AdapterChoice, Gpu};
use erfgs_train::{
    config::{Config, Method, MotionModel, Preset},
    scene::Scene,
    trainer::{Progress, TrainOptions, Trainer},
};
use glam::{DQuat, DVec3};

use super::{
    Folder,
    browser::Browser,
    page::{film_small, header},
    view::{Served, compared, open_container_shows},
};

/// The middle of what the cameras of the stage look at, metres.
const CENTRE: DVec3 = DVec3::new(0.0, -0.95, 0.25);
const SECONDS: f64 = 0.3;

/// A disc that turns four times a second, and a ball that flies past it and is not there at first and at last.
fn pose(name: &str, seconds: f64) -> (DVec3, DQuat) {
    match name {
        "disc" => (CENTRE, DQuat::from_rotation_z(25.0 * seconds)),
        _ => (CENTRE + DVec3::new(3.0 * (seconds - 0.15), 0.3, -0.2), DQuat::from_rotation_y(8.0 * seconds)),
    }
}

fn body(name: &str, span_s: [f64; 2]) -> Body {
    let nanoseconds = |seconds: f64| (1e9 * seconds).round() as i64;
    let poses = (0..=60).map(|k| span_s[0] + (span_s[1] - span_s[0]) * f64::from(k) / 60.0);
    let pose = |seconds: f64| {
        let (at, turn) = pose(name, seconds);
        BodyPose {
            t_ns: nanoseconds(seconds),
            translation_m: at.to_array(),
            rotation_wxyz: [turn.w, turn.x, turn.y, turn.z],
        }
    };
    let point = |k: i32| {
        let angle = 2.4 * f64::from(k);
        let (out, colour) = match name {
            // A half of it red.
            "disc" => {
                (DVec3::new(angle.cos(), angle.sin(), 0.0), if angle.sin() > 0.0 { [230, 40, 30] } else { [230; 3] })
            }
            _ => {
                let z = f64::from(2 * k - 119) / 120.0;
                let around = (1.0 - z * z).sqrt();
                (DVec3::new(around * angle.cos(), around * angle.sin(), z), [40, 60, 220])
            }
        };
        let normal = if name == "disc" { DVec3::Z } else { out };
        let place = if name == "disc" { 0.4 * (f64::from(k + 1) / 120.0).sqrt() * out } else { 0.15 * out };
        SurfacePoint { position_m: place.to_array(), normal: normal.to_array(), colour }
    };
    Body {
        name: name.into(),
        span_ns: span_s.map(nanoseconds),
        poses: poses.map(pose).collect(),
        points: (0..120).map(point).collect(),
        found_by: BTreeMap::new(),
    }
}

/// Two bodies for the dataset that is there.
pub fn give_bodies(dataset: &Path) {
    let mut dataset = Dataset::load(dataset).expect("a dataset");
    let start = dataset.manifest.span_ns[0];
    let mut bodies = vec![body("disc", [0.0, SECONDS]), body("<b>ball", [0.08, 0.22])];
    for body in &mut bodies {
        body.span_ns = body.span_ns.map(|t_ns| start + t_ns);
        body.poses.iter_mut().for_each(|pose| pose.t_ns += start);
    }
    dataset.set_bodies(&Bodies::new(bodies), BTreeMap::new()).expect("bodies");
    dataset.save().expect("a manifest");
}

#[test]
fn a_run_with_bodies_is_shown_exported_and_described() {
    let folder = Folder::new();
    film_small(&folder);
    let stderr = folder.fail(1, "train ds --out none --motion bodies --iterations 2+2 -q");
    assert!(stderr.contains("erfgs dataset bodies"), "{stderr}");
    give_bodies(&folder.path("ds"));
    let described = folder.succeed("info ds");
    assert!(described.contains("disc: in view from 0.000 to 0.300 s, 120 points"), "{described}");
    let ball = &folder.figures("info ds")["bodies"][1];
    assert_eq!((&ball["name"], &ball["in_view_s"]), (&"<b>ball".into(), &serde_json::json!([0.08, 0.22])));
    // It flies at 3 m/s.
    assert!((ball["speed_m_s"].as_f64().expect("a speed") - 3.0).abs() < 1e-6, "{ball}");
    // Events add Gaussians that no body carries.
    let free = "--set eds.from=5 --set eds.every=1 --set eds.until=1.0 --set eds.min_events=1 --set eds.tolerance_px=8 \
                --set eds.depths=64 --set free_time.knots=2 --set bodies.trial=0 --set bodies.spacing_px=0";
    folder.succeed(&format!("train ds --out run --motion bodies --iterations 20+30 {free} -q"));
    let info = folder.succeed("info run");
    assert!(info.contains("bodies") && info.contains("2: disc, <b>ball"), "{info}");
    assert_eq!(folder.figures("info run")["run"]["bodies"], serde_json::json!(["disc", "<b>ball"]));

    // ERF-GS takes what bodies there are, unless it is told not to; the baseline stays what it is.
    for (out, how, carried) in
        [("auto", "erf-gs", 2), ("free", "erf-gs --motion free-time", 0), ("baseline", "4dgs", 0)]
    {
        folder.succeed(&format!("train ds --out {out} --method {how} --iterations 2+2 --set bodies.trial=0 -q"));
        let names = &folder.figures(&format!("info {out}"))["run"]["bodies"];
        assert_eq!(names.as_array().map_or(0, Vec::len), carried, "{how}: {names}");
    }

    let packed = folder.figures("export run --to e4d --out packed.e4d");
    assert!(packed["psnr_db"].as_f64().expect("dB") > 45.0, "{packed}");
    let exact = folder.figures("export run --to e4d --exact --out exact.e4d");
    assert!(packed["bytes"].as_u64() < exact["bytes"].as_u64());
    bodies_turn_in_clouds(&folder);
    motion_is_as_the_bodies_move(&folder);
    let gltf = folder.figures("export run --to gltf --at 0.15 --out scene.glb");
    assert!(gltf["gaussians"].as_u64() > Some(200), "{gltf}");
    let open = folder.figures("export run --to 4dgs --out scene.4dgs");
    assert!(open["gaussians"].as_u64() > Some(1000), "{open}");
    // The ball appears within a few samples of its way.
    open_container_shows(&folder, "scene.4dgs", "splats", 0.08);
    folder.succeed("export run --to html --out one.html");

    let served = Served::start(&folder, "run packed.e4d");
    let scene = header(&served.page.get("/api/scene/0").1);
    assert_eq!((&scene["motion"]["kind"], &scene["only_server"]), (&"bodies".into(), &serde_json::Value::Null));
    let mut browser = Browser::start();
    browser.open(&format!("{}&renderer=webgpu#t=0.15", served.page.link));
    browser.wait("document.body?.dataset.shown === 'all'");
    the_page_tells_bodies_apart(&mut browser);
    drop(served);
    let served = Served::start(&folder, "run");
    browser.open(&format!("{}&check=2&renderer=webgpu", served.page.link));
    for (mode, psnr) in compared(&served, 4) {
        let least = if mode == "tiles" { 60.0 } else { 45.0 };
        assert!(psnr > least, "{mode}: {psnr} dB");
    }
    // Opened from a disk, too.
    browser.open(&format!("file://{}#t=0.15", folder.path("one.html").display()));
    browser.wait("document.body?.dataset.shown === 'all' && document.querySelectorAll('.body').length === 3");
    assert_eq!(browser.evaluate("document.getElementById('trouble').textContent"), "");
}

/// A trainer by bodies on the frames of the film alone, as it stands after its coarse stage of five iterations, and where it writes its run.
fn trainer<'a>(gpu: &'a Gpu, folder: &Folder, assignments: &[&str]) -> (Trainer<'a>, RunFolder) {
    let mut config = Config::preset(Method::FourDgs, Preset::Default);
    (config.motion, config.coarse_iterations, config.fine_iterations) = (MotionModel::Bodies, 5, 8);
    config.bodies.trial = 0;
    config.evaluation.leave_alone();
    config.evaluation.log_every = u32::MAX;
    assignments.iter().for_each(|assignment| config.set(assignment).expect("a setting"));
    let dataset = Dataset::load(&folder.path("ds")).expect("a dataset");
    config.settle(&dataset, false).expect("settings");
    let scene = Scene::load(dataset, &config, false).expect("a scene");
    let options = TrainOptions { evaluate: false, ..TrainOptions::default() };
    let mut trainer = Trainer::new(gpu, scene, config, &options).expect("a trainer");
    let run = RunFolder::new(folder.path(&format!("run-{}", assignments.join("-"))));
    let coarse = AtomicBool::new(false);
    let mut watch = |now: &Progress| coarse.store(now.iteration >= 4, Ordering::Relaxed);
    trainer.run(&run, &options, &coarse, &mut watch).expect("a coarse stage");
    (trainer, run)
}

#[test]
fn exposures_take_several_renderings_where_things_move_alone() {
    let folder = Folder::new();
    film_small(&folder);
    give_bodies(&folder.path("ds"));
    let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
    for (exposure, expected) in [(1, 8), (4, 8 * 4 + 2)] {
        let (mut trainer, run) = trainer(&gpu, &folder, &[&format!("bodies.exposure={exposure}")]);
        trainer.times.start();
        let options = TrainOptions { evaluate: false, ..TrainOptions::default() };
        trainer.run(&run, &options, &AtomicBool::new(false), &mut |_: &Progress| {}).expect("a fine stage");
        // Two of the eight samples look at what stands still, too.
        let renderings = trainer.times.stages().find(|(stage, ..)| *stage == "raster forward").map(|(.., calls)| calls);
        assert_eq!(renderings, Some(expected), "{exposure} renderings of an exposure");
    }
}

#[test]
fn bodies_start_with_as_many_gaussians_as_cameras_can_tell_apart() {
    let folder = Folder::new();
    film_small(&folder);
    give_bodies(&folder.path("ds"));
    let carried = |spacing: &str| {
        let mut config = Config { motion: MotionModel::Bodies, ..Config::default() };
        config.set(spacing).expect("a setting");
        let dataset = Dataset::load(&folder.path("ds")).expect("a dataset");
        let scene = Scene::load(dataset, &config, false).expect("a scene");
        scene.bodies(&config).expect("bodies").gaussians.len()
    };
    // Two of 120 points each.
    assert_eq!(carried("bodies.spacing_px=0"), 240);
    assert_eq!(carried("bodies.spacing_px=0.01"), 240);
    for far in [3.0, 50.0, 1000.0] {
        let few = carried(&format!("bodies.spacing_px={far}"));
        assert!((96..200).contains(&few), "{few} Gaussians {far} pixels apart");
    }
}

/// The bodies of the stage as they truly move, and one that flies where there is nothing.
fn give_true_bodies_and_a_ghost(dataset: &Path) {
    let text = std::fs::read(dataset.join("truth/bodies.json")).expect("the truth");
    let mut bodies: Bodies = serde_json::from_slice(&text).expect("bodies");
    let mut ghost = body("disc", [0.0, SECONDS]);
    ghost.name = "ghost".into();
    ghost.points.iter_mut().for_each(|point| point.colour = [250, 0, 250]);
    ghost.poses.iter_mut().for_each(|pose| pose.translation_m[0] += 4.0 * (1e-9 * pose.t_ns as f64 - 0.15));
    bodies.bodies.push(ghost);
    let mut dataset = Dataset::load(dataset).expect("a dataset");
    dataset.set_bodies(&bodies, BTreeMap::new()).expect("bodies");
    dataset.save().expect("a manifest");
}

#[test]
fn a_trial_tells_bodies_from_what_is_none_and_is_made_once() {
    let folder = Folder::new();
    film_small(&folder);
    give_true_bodies_and_a_ghost(&folder.path("ds"));
    let unknown =
        folder.fail(1, "train ds --out none --motion bodies --iterations 10+10 --set bodies.free=[\"rope\"] -q");
    assert!(unknown.contains("'rope'") && unknown.contains("ghost"), "{unknown}");
    let bodies = Dataset::load(&folder.path("ds")).expect("a dataset").read_bodies().expect("bodies").expect("some");
    let names: Vec<&str> = bodies.bodies.iter().map(|body| body.name.as_str()).collect();
    let all = serde_json::to_string(&names).expect("JSON");
    let refused =
        folder.fail(1, &format!("train ds --out none --motion bodies --iterations 10+10 --set bodies.free={all} -q"));
    assert!(refused.contains("all bodies") && refused.contains("free-time"), "{refused}");
    let train = "train ds --out run --motion bodies --iterations 60+240 --seed 3 --no-evaluation --resume";
    let output = folder.run(train);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && stderr.contains("trial of 60 iterations"), "{stderr}");
    let trial: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path("run/trial.json")).expect("a trial")).expect("JSON");
    let carries = |name: &str| {
        let all = trial["bodies"].as_array().expect("bodies");
        let of = all.iter().find(|tried| tried["body"] == name).unwrap_or_else(|| panic!("{name} in {trial}"));
        of["carries"].as_bool().expect("whether it does")
    };
    assert!(!carries("ghost") && carries("fan"), "{trial}");
    let info = folder.figures("info run");
    let names: Vec<&str> =
        info["run"]["bodies"].as_array().expect("names").iter().filter_map(serde_json::Value::as_str).collect();
    assert!(names.contains(&"fan") && !names.contains(&"ghost"), "{names:?}");
    let left_out = info["run"]["left_out"].to_string();
    assert!(left_out.contains("ghost"), "{left_out}");
    // The time that it took is of the training.
    let rows = std::fs::read_to_string(folder.path("run/curve.csv")).expect("a curve");
    let last = rows.lines().last().expect("a row").split(',').nth(2).and_then(|value| value.parse::<f64>().ok());
    assert!(last > trial["seconds"].as_f64(), "{rows}");
    // The same command ends at once, as its trial is known.
    let again = String::from_utf8_lossy(&folder.run(train).stderr).into_owned();
    assert!(again.contains("nothing is left to do"), "{again}");
}

/// The table of their motion says how they move. They have been taught for so short a time that they move as they did at first.
fn motion_is_as_the_bodies_move(folder: &Folder) {
    let told = folder.figures("export run --to motion --out motion.csv");
    assert!(told["bodies"][0]["gaussians"].as_u64() > Some(50), "{told}");
    let fastest = |body: usize, what: &str| told["bodies"][body][what].as_f64().expect("a rate");
    assert!((fastest(0, "fastest_rad_s") - 25.0).abs() < 2.0 && fastest(0, "fastest_m_s") < 0.5, "{told}");
    assert!((fastest(1, "fastest_m_s") - 3.0).abs() < 0.5, "{told}");
    let table = std::fs::read_to_string(folder.path("motion.csv")).expect("a table");
    let mut lines = table.lines();
    let columns: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let column = |name: &str| columns.iter().position(|column| *column == name).expect("a column");
    let (mut seen, mut last_s) = ([0; 2], [0.0; 2]);
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |name: &str| fields[column(name)].parse::<f64>().expect("a number");
        let index = ["disc", "<b>ball"].iter().position(|name| *name == fields[0]).expect("a body");
        let (place, turn) = pose(fields[0], number("t_s"));
        let found = DVec3::new(number("x_m"), number("y_m"), number("z_m"));
        let turned = DQuat::from_xyzw(number("qx"), number("qy"), number("qz"), number("qw"));
        assert!(found.distance(place) < 0.02 && turned.angle_between(turn) < 0.1, "{line}");
        let rate = DVec3::new(number("wx_rad_s"), number("wy_rad_s"), number("wz_rad_s"));
        let truly = if index == 0 { 25.0 * DVec3::Z } else { 8.0 * DVec3::Y };
        assert!(rate.distance(truly) < 4.0, "{line}");
        assert!(number("bends_m") < 0.02, "{line}");
        seen[index] += 1;
        last_s[index] = number("t_s");
    }
    // 250 a second; the ball is not there at first and at last.
    assert!(seen[0] == 76 && (25..50).contains(&seen[1]) && last_s[1] < 0.25, "{seen:?} {last_s:?}");
    assert!(folder.fail(2, "export free --to motion").contains("--motion bodies"));
    assert!(folder.fail(2, "export run --to motion --out motion.csv").contains("--force"));
    assert!(folder.fail(2, "export run --to motion --at 0.1").contains("gltf"));
}

/// Gaussians of the files at instants stand and turn as their body did between these: what was learned since changes that little.
fn bodies_turn_in_clouds(folder: &Folder) {
    folder.succeed("export run --instants 4 --out splats");
    let cloud = |instant: usize| {
        GaussianCloud::read(&folder.path(&format!("splats/point_cloud_t/{instant:05}.ply"))).expect("a cloud")
    };
    let (before, after) = (cloud(1), cloud(2));
    let (from, to) = (pose("disc", 0.1), pose("disc", 0.2));
    let turn = to.1 * from.1.inverse();
    let quaternion = |[w, x, y, z]: [f32; 4]| DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into()).normalize();
    let place = |at: [f32; 3]| DVec3::from(at.map(f64::from));
    let mut followed = 0;
    for index in 0..before.len() {
        let at = place(before.positions[index]) - from.0;
        // Those of the disc, but its middle.
        if at.z.abs() > 0.02 || !(0.15..0.5).contains(&at.length()) {
            continue;
        }
        let off = place(after.positions[index]) - to.0 - turn * at;
        if off.length() > 0.03 {
            continue;
        }
        let turned = quaternion(after.rotations[index]) * quaternion(before.rotations[index]).inverse();
        assert!(turned.angle_between(turn) < 0.1, "Gaussian {index} turned by {turned}, not by {turn}");
        followed += 1;
    }
    assert!(followed > 60, "{followed} Gaussians go where the disc does");
}

/// Colours and one body alone change the picture and can be chosen by name; velocities are drawn.
fn the_page_tells_bodies_apart(browser: &mut Browser) {
    let names = browser.evaluate("[...document.querySelectorAll('#layer .body')].map((option) => option.text)");
    assert_eq!(names, serde_json::json!(["disc alone", "<b>ball alone"]));
    assert_eq!(browser.evaluate("document.querySelector('#look .body').value"), "bodies");
    let change = |browser: &mut Browser, id: &str, how: &str| {
        let drawn = browser.evaluate("document.body.dataset.drawn");
        let element = format!("document.getElementById('{id}')");
        browser.evaluate(&format!("{element}.{how}; {element}.dispatchEvent(new Event('input'))"));
        browser.wait(&format!("document.body.dataset.drawn > {}", drawn.as_str().expect("a count")));
    };
    let stage = |browser: &mut Browser| {
        let picture = browser.screenshot();
        let (width, height) = picture.dimensions();
        image::imageops::crop_imm(&picture, 0, height / 10, width, height / 2).to_image().into_raw()
    };
    let mut pictures = vec![stage(browser)];
    for (id, value) in [("look", "bodies"), ("layer", "body:disc"), ("layer", "body:<b>ball"), ("mode", "tiles")] {
        change(browser, id, &format!("value = '{value}'"));
        let picture = stage(browser);
        // Drawn exactly, a thing of one colour looks as if drawn fast.
        assert!(id == "mode" || pictures.iter().all(|other| *other != picture), "{id} {value} changes nothing");
        pictures.push(picture);
    }
    change(browser, "layer", "value = 'all'");
    change(browser, "velocities", "checked = true");
    browser.wait(
        "(() => { const c = document.getElementById('overlay'); \
         const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
         let n = 0; for (let i = 3; i < p.length; i += 4) n += p[i] > 0; return n > 100; })()",
    );
    // Where arrows begin and where the kernels draw are computed apart from each other.
    let seen = browser.evaluate(
        "(async () => {
           const at = (name) => import(new URL(`file/js/${name}`, location.href));
           const [{ open }, { SceneReader }, { Bodies }, { placeOf, posesAt }, source] =
             await Promise.all(['gpu.js', 'scene.js', 'bodies.js', 'carried.js', 'source.js'].map(at));
           const gpu = await open(navigator.gpu);
           const bytes = new Uint8Array(await (await fetch('api/scene/0')).arrayBuffer());
           const reader = new SceneReader(bytes.length);
           reader.push(bytes);
           const scene = await reader.better(Infinity);
           const texts = { train: (name) => source.text(`train/${name}`) };
           const motion = await Bodies.make(gpu, texts, { ...scene, core: gpu.storageFrom(scene.core) });
           let [worst, carried] = [0, 0];
           for (const t01 of [0, 0.4, 1]) {
             const commands = gpu.commands();
             motion.record(commands, { ...scene, core: gpu.storageFrom(scene.core) }, t01);
             commands.submit();
             const deltas = await gpu.read(motion.deltas, Float32Array, 12 * scene.dynamic);
             const poses = posesAt(scene, t01);
             for (let k = 0; k < scene.dynamic; k++) {
               if (!scene.hangs[5 * k]) continue;
               carried += 1;
               const place = placeOf(scene, poses, k);
               worst = Math.max(worst, ...[0, 1, 2].map((i) => Math.abs(scene.core[12 * k + i] + deltas[12 * k + i] - place[i])));
             }
           }
           return { worst, carried, free: scene.dynamic - carried / 3 };
         })()",
    );
    assert!(seen["worst"].as_f64() < Some(1e-5) && seen["carried"].as_u64() > Some(600), "{seen}");
    assert!(seen["free"].as_f64() > Some(0.0), "all are carried, and none is free in time: {seen}");
    assert_eq!(browser.evaluate("document.getElementById('trouble').textContent"), "");
}
