//! Frames, ground truth and whole films.

use std::{collections::BTreeMap, path::Path, process::Command};

use erfgs_dataset::{Dataset, Split};
use erfgs_scene::{Modality, PointCloud};
use erfgs_stage::{
    Act, FilmOptions, Flicker, RigOptions, Role, Stage, StageError, StageOptions, StageView, colour::encode, film,
    film::image, motion::Ball,
};
use glam::{DVec2, DVec3};

fn small() -> FilmOptions {
    FilmOptions {
        rig: RigOptions { width: 40, height: 30, rgb: 2, event: 1, test: 1, ..RigOptions::default() },
        duration_ns: 100_000_000,
        rgb_fps: 20.0,
        truth_points: 500,
        ..FilmOptions::default()
    }
}

fn files(folder: &Path, under: &Path, found: &mut BTreeMap<String, Vec<u8>>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, under, found);
        } else {
            found.insert(path.strip_prefix(under).unwrap().display().to_string(), std::fs::read(&path).unwrap());
        }
    }
}

#[test]
fn a_film_is_a_valid_dataset_with_disjoint_modalities() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("ds");
    let last = std::sync::Mutex::new((0, 0));
    let report = film(&out, &small(), &|progress| *last.lock().unwrap() = (progress.done, progress.total)).unwrap();
    let (done, total) = *last.lock().unwrap();
    assert_eq!(done, total);

    let dataset = Dataset::load(&out).unwrap();
    dataset.verify().unwrap();
    assert_eq!(dataset, report.dataset);
    let manifest = &dataset.manifest;
    assert!(manifest.linear_exposure && manifest.points.is_none());
    assert_eq!(manifest.cameras.len(), 4);
    let mut seen = Vec::new();
    for camera in &manifest.cameras {
        match (camera.split, camera.modality) {
            (Split::Train, Modality::Rgb) => {
                assert_eq!(camera.frames.iter().map(|f| f.t_ns).collect::<Vec<_>>(), [0, 50_000_000, 100_000_000]);
                for frame in &camera.frames {
                    assert_eq!(frame.exposure_ns[1] - frame.exposure_ns[0], 33_000_000);
                    assert!(frame.mask.is_none());
                    seen.push(frame.t_ns);
                }
            }
            (Split::Train, Modality::Event) => {
                let events = dataset.read_events(camera).unwrap().unwrap();
                assert!(camera.frames.is_empty() && events.len() > 200, "{} events", events.len());
            }
            (Split::Test, Modality::Rgb) => {
                assert_eq!(camera.frames.len(), 7);
                for frame in &camera.frames {
                    assert_eq!(frame.exposure_ns, [frame.t_ns; 2]);
                    let mask = dataset.read_mask(camera, frame).unwrap().unwrap();
                    let moving = mask.data.iter().filter(|&&value| value == 255).count();
                    assert!((20..600).contains(&moving), "{moving} moving pixels");
                }
                let unseen = camera.frames.iter().filter(|frame| !seen.contains(&frame.t_ns)).count();
                assert!(unseen >= 4, "held-out frames lie at times that no RGB frame saw");
            }
            other => panic!("unexpected camera {other:?}"),
        }
    }
    let points = PointCloud::read(&out.join("truth_points.ply")).unwrap();
    assert!(points.len() > 400);

    assert!(matches!(film(&out, &small(), &|_| {}), Err(StageError::NotEmpty { .. })));
    std::fs::remove_file(out.join(Dataset::MANIFEST)).unwrap();
    film(&out, &small(), &|_| {}).expect("a film without a manifest was interrupted: it is made again");
}

#[test]
fn films_are_the_same_bytes_whatever_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let films: Vec<BTreeMap<String, Vec<u8>>> = [1, 3]
        .into_iter()
        .map(|threads| {
            let out = folder.path().join(threads.to_string());
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| film(&out, &small(), &|_| {})).unwrap();
            let mut found = BTreeMap::new();
            files(&out, &out, &mut found);
            found
        })
        .collect();
    assert!(films[0].len() > 15);
    for (name, bytes) in &films[0] {
        assert!(films[1].get(name) == Some(bytes), "{name} differs");
    }
    assert_eq!(films[0].len(), films[1].len());
}

#[test]
fn the_seed_changes_the_room_and_the_rig() {
    let one = small().set_up().unwrap();
    let two = FilmOptions { seed: 2, ..small() }.set_up().unwrap();
    assert_ne!(one.1, two.1);
    // The room is what shows where nothing moves.
    let room = |stage: &Stage| -> Vec<Option<[f32; 3]>> {
        let view = StageView::new(stage, &one.1[0].intrinsics, &one.1[0].world_to_camera).unwrap();
        std::iter::zip(view.frame(0), view.mask(0)).map(|(colour, moving)| (!moving).then_some(colour)).collect()
    };
    let mut pixels = std::iter::zip(room(&one.0), room(&two.0));
    assert!(pixels.any(|(a, b)| a.zip(b).is_some_and(|(a, b)| a != b)));
}

#[test]
fn impossible_takes_are_typed_errors_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("ds");
    let good = small();
    for bad in [
        FilmOptions { rig: RigOptions { rgb: 0, event: 0, test: 0, ..good.rig.clone() }, ..good.clone() },
        FilmOptions { rig: RigOptions { width: 0, ..good.rig.clone() }, ..good.clone() },
        FilmOptions { duration_ns: -5, ..good.clone() },
        FilmOptions { duration_ns: i64::MAX, ..good.clone() },
        FilmOptions { exposure_ns: -1, ..good.clone() },
        FilmOptions { rgb_fps: 0.0, ..good.clone() },
        FilmOptions { rgb_fps: f64::NAN, ..good.clone() },
        FilmOptions { test_fps: 1e9, ..good.clone() },
    ] {
        let error = film(&out, &bad, &|_| {}).unwrap_err();
        assert!(error.to_string().len() > 20, "{error}");
        assert!(!out.exists(), "{error}");
    }
    let blocked = folder.path().join("file");
    std::fs::write(&blocked, "in the way").unwrap();
    assert!(matches!(film(&blocked, &good, &|_| {}), Err(StageError::Write { .. })));
}

#[test]
fn one_pixel_and_one_camera_make_a_film() {
    for role in [Role::Rgb, Role::Event, Role::Test] {
        let folder = tempfile::tempdir().unwrap();
        let count = |wanted| usize::from(role == wanted);
        let rig = RigOptions {
            width: 1,
            height: 1,
            rgb: count(Role::Rgb),
            event: count(Role::Event),
            test: count(Role::Test),
            ..RigOptions::default()
        };
        film(folder.path(), &FilmOptions { rig, ..small() }, &|_| {}).unwrap();
        Dataset::load(folder.path()).unwrap();
    }
}

#[test]
fn the_exposure_integral_converges_and_the_default_is_fine_enough() {
    let (stage, rig) = small().set_up().unwrap();
    let view = StageView::new(&stage, &rig[1].intrinsics, &rig[1].world_to_camera).unwrap();
    let shutter = [200_000_000, 233_000_000];
    let exact = view.exposure(shutter, 4096);
    let worst = |samples: u32| {
        let pairs = view.exposure(shutter, samples).into_iter().zip(&exact);
        let differences = pairs.flat_map(|(a, b)| a.into_iter().zip(*b));
        differences.map(|(a, b)| (encode(f64::from(a)) - encode(f64::from(b))).abs()).fold(0.0, f64::max)
    };
    let errors = [4, 16, 64, 256].map(worst);
    assert!(errors.windows(2).all(|pair| pair[1] < 0.6 * pair[0]), "{errors:?}");
    let default = worst(view.exposure_samples(shutter, 0.35));
    assert!(default < 4.0 / 255.0, "{default}");
    assert_eq!(view.exposure([5, 5], 7), view.frame(5));
    // The blur is real, but of what moves alone.
    let (sharp, blurred) = (image(&view, &view.frame(216_500_000)), image(&view, &exact));
    let changed = sharp.data.iter().zip(&blurred.data).filter(|(a, b)| a.abs_diff(**b) > 5).count();
    assert!((80..800).contains(&changed), "{changed} values changed");
}

#[test]
fn a_lamp_that_flickers_is_seen_by_short_exposures_where_it_shines() {
    let (steady, rig) = small().set_up().unwrap();
    let flicker = Some(Flicker { hz: 100.0, depth: 0.5 });
    let flickering = Stage::new(StageOptions { flicker, ..steady.options.clone() });
    let [steady, flickering] =
        [&steady, &flickering].map(|stage| StageView::new(stage, &rig[1].intrinsics, &rig[1].world_to_camera).unwrap());
    let exposure = |view: &StageView<'_>, shutter| view.exposure(shutter, view.exposure_samples(shutter, 0.35));
    // A whole number of periods gathers the mean light where nothing moves.
    let whole = [200_000_000, 220_000_000];
    let moves = [0, 5, 10, 15, 20].map(|ms| steady.mask(200_000_000 + 1_000_000 * ms));
    for (pixel, (a, b)) in exposure(&flickering, whole).iter().zip(exposure(&steady, whole)).enumerate() {
        let moves = moves.iter().any(|mask| mask[pixel]);
        assert!(moves || a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} and {b:?}");
    }
    // At its brightest the lamp gives half as much again, and ambient light what it always does.
    let peak = [202_500_000; 2];
    let brighter: Vec<f64> = (exposure(&flickering, peak).iter().zip(exposure(&steady, peak)))
        .map(|(a, b)| f64::from(a[1]) / f64::from(b[1]))
        .collect();
    assert!(brighter.iter().all(|share| (0.999..1.5).contains(share)));
    let lit = brighter.iter().filter(|share| **share > 1.2).count();
    let shaded = brighter.iter().filter(|share| **share < 1.01).count();
    assert!(lit > 300 && shaded > 10, "{lit} and {shaded} of {}", brighter.len());
    assert_eq!(flickering.frame(202_500_000), steady.frame(202_500_000), "what is held out is steady");
    let refused = film(Path::new("nowhere"), &flickering_by(2.0), &|_| ()).unwrap_err().to_string();
    assert!(refused.contains("depth of the lamp's flicker"), "{refused}");
}

fn flickering_by(depth: f64) -> FilmOptions {
    let stage = StageOptions { flicker: Some(Flicker { hz: 100.0, depth }), ..StageOptions::default() };
    FilmOptions { stage, ..small() }
}

#[test]
fn depth_agrees_between_viewpoints_and_follows_the_ball() {
    let stage = Stage::new(StageOptions::default());
    let rig =
        RigOptions { width: 80, height: 60, rgb: 3, event: 0, test: 0, ..RigOptions::default() }.cameras(1).unwrap();
    let views: Vec<StageView<'_>> =
        rig.iter().map(|camera| StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap()).collect();
    let t_ns = 250_000_000;
    let depths: Vec<Vec<f32>> = views.iter().map(|view| view.depth(t_ns)).collect();
    let thrown = Ball::default();
    let ball = thrown.centre(0.25);
    let (mut looks, mut farther) = (0, 0);
    for (from, to) in [(0, 1), (1, 2), (2, 0), (1, 0)] {
        let (a, b) = (&rig[from], &rig[to]);
        for (pixel, &depth) in depths[from].iter().enumerate() {
            let place = DVec2::new((pixel % 80) as f64 + 0.5, (pixel / 80) as f64 + 0.5);
            let world = a.world_to_camera.inverse().transform(a.intrinsics.unproject_pinhole(place, f64::from(depth)));
            assert!(
                (-1.96..1.96).contains(&world.x) && world.y < 0.01 && world.z < 1.56,
                "{world} lies outside the room"
            );
            let seen = b.world_to_camera.transform(world);
            let at = b.intrinsics.project_pinhole(seen);
            if seen.z > 0.1 && at.cmpgt(DVec2::ONE).all() && at.cmplt(DVec2::new(79.0, 59.0)).all() {
                looks += 1;
                // What the other camera sees there is this point or something before it.
                farther += u32::from(f64::from(depths[to][at.y as usize * 80 + at.x as usize]) > seen.z + 0.12);
            }
        }
        let seen = a.world_to_camera.transform(ball);
        let at = a.intrinsics.project_pinhole(seen);
        let front = f64::from(depths[from][at.y as usize * 80 + at.x as usize]);
        assert!((front - (seen.z - thrown.radius)).abs() < 0.02, "{front} and {}", seen.z);
    }
    assert!(looks > 5000 && f64::from(farther) < 0.04 * f64::from(looks), "{farther} of {looks}");
}

#[test]
fn truth_points_lie_on_surfaces_that_their_camera_sees() {
    let (stage, rig) = small().set_up().unwrap();
    let camera = &rig[0];
    let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
    let cloud = erfgs_stage::truth_points(&view, 0, 800, 3);
    let depth = view.depth(0);
    let agree = cloud.positions.iter().filter(|position| {
        let seen = camera.world_to_camera.transform(DVec3::from(position.map(f64::from)));
        let at = camera.intrinsics.project_pinhole(seen);
        let pixel = at.y as usize * 40 + at.x as usize;
        (f64::from(depth[pixel]) - seen.z).abs() < 0.1
    });
    assert!(agree.count() > 680);
}

#[test]
fn the_command_films_and_explains_what_it_cannot() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_erfgs-stage")).args(arguments).current_dir(folder.path()).output().unwrap()
    };
    let film = [
        "film",
        "--out",
        "ds",
        "--size",
        "16x12",
        "--rgb",
        "1",
        "--event",
        "1",
        "--test",
        "1",
        "--duration-ms",
        "40",
        "--json",
    ];
    let output = run(&film);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let figures: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(figures["rgb_frames"], 1);
    Dataset::load(&folder.path().join("ds")).unwrap();

    let again = run(&film);
    assert!(!again.status.success());
    assert!(String::from_utf8_lossy(&again.stderr).contains("not empty"));

    let negative = run(&["film", "--out", "other", "--duration-ms", "-1"]);
    assert!(!negative.status.success());
    assert!(String::from_utf8_lossy(&negative.stderr).contains("duration"));

    let odd = run(&["film", "--out", "other", "--act", "juggle"]);
    assert!(String::from_utf8_lossy(&odd.stderr).contains("choose from fan, throw"));

    let unknown = run(&["frame", "--camera", "rgb77", "--t-ms", "0", "--out", "a.png"]);
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("rgb00"));

    let frame = ["frame", "--camera", "0", "--t-ms", "-20", "--exposure-ms", "5", "--size", "16x12"];
    let output = run(&[&frame[..], &["--out", "a.png", "--mask", "m.png", "--depth", "d.f32"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(std::fs::metadata(folder.path().join("d.f32")).unwrap().len(), 16 * 12 * 4);
}

#[test]
fn the_take_without_acts_is_what_it_always_was() {
    let (stage, rig) = small().set_up().unwrap();
    let view = StageView::new(&stage, &rig[1].intrinsics, &rig[1].world_to_camera).unwrap();
    let picture = image(&view, &view.exposure([200_000_000, 233_000_000], 40));
    let sum: u64 = picture.data.iter().zip(1..).map(|(&value, place): (&u8, u64)| place * u64::from(value)).sum();
    assert_eq!(sum, 782_798_265, "figures of the documentation were measured on this take");
    // Its truth is told when it is asked for, and changes nothing else.
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, truth: bool| {
        let out = folder.path().join(name);
        let dataset = film(&out, &FilmOptions { truth, ..small() }, &|_| {}).unwrap().dataset;
        assert_eq!(out.join("truth").exists(), truth);
        dataset.manifest
    };
    assert_eq!(of("plain", false), of("told", true));
    let text = std::fs::read(folder.path().join("told/truth/bodies.json")).unwrap();
    let bodies: erfgs_dataset::Bodies = serde_json::from_slice(&text).unwrap();
    bodies.check().unwrap();
    let names: Vec<&str> = bodies.bodies.iter().map(|body| body.name.as_str()).collect();
    assert_eq!(names, ["ball", "fan", "pendulum"]);
}

#[test]
fn acts_are_filmed_with_their_truth_and_an_ideal_rig_sees_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let mut options = small();
    options.stage.acts = vec![Act::Squash, Act::Fan];
    options.seed = 4;
    let of = |name: &str, options: &FilmOptions| film(&folder.path().join(name), options, &|_| {}).unwrap().dataset;
    let (usual, again) = (of("usual", &options), of("again", &options));
    let ideal = of("ideal", &options.clone().ceiling());
    assert_eq!(usual.manifest, again.manifest, "the same seed gives the same bytes");
    assert_eq!(usual.manifest.provenance.options["acts"], serde_json::json!(["squash", "fan"]));
    let held_out = |dataset: &Dataset| -> Vec<String> {
        let frames = dataset.cameras(Split::Test).flat_map(|camera| camera.frames.clone());
        frames.map(|frame| dataset.manifest.sha256[&frame.file].clone()).collect()
    };
    assert_eq!(held_out(&usual), held_out(&ideal));
    let sharp: Vec<_> = ideal.cameras(Split::Train).collect();
    assert!(sharp.len() == 2 && sharp.iter().all(|camera| camera.frames.len() == 17));
    assert!(sharp[0].frames.iter().all(|frame| frame.exposure_ns == [frame.t_ns; 2]));
    let truth = folder.path().join("usual/truth");
    let names: serde_json::Value = serde_json::from_slice(&std::fs::read(truth.join("labels.json")).unwrap()).unwrap();
    assert_eq!(names[0]["name"], "soft-ball");
    assert_eq!((&names[0]["rigid"], &names[1]["label"]), (&false.into(), &2.into()));
    let labels = erfgs_scene::ImageGrey8::read(&truth.join("labels/test00/00003.png")).unwrap();
    assert!(labels.data.contains(&1) && labels.data.iter().all(|label| *label <= 2));
    // Places of what bends move as fast as they say.
    let array = |name: &str| {
        let bytes = std::fs::read(truth.join("bending/soft-ball").join(name)).unwrap();
        erfgs_base::npy::NpyArray::decode(&bytes).unwrap().floats().unwrap()
    };
    let (positions, velocities) = (array("position_m.npy"), array("velocity_m_s.npy"));
    let (a_frame, step) = (positions.len() / 7, 1.0 / 60.0);
    for at in (0..a_frame).step_by(17) {
        let moved = (positions[a_frame + at] - positions[at]) / step;
        let mean = 0.5 * (velocities[a_frame + at] + velocities[at]);
        assert!((moved - mean).abs() < 1.5, "{moved} and {mean} m/s");
    }
}

#[test]
fn in_an_empty_room_nothing_moves() {
    let folder = tempfile::tempdir().unwrap();
    let mut options = small();
    options.stage.empty = true;
    options.events.shot_hz = 0.0;
    options.events.leak_hz = 0.0;
    let dataset = film(&folder.path().join("ds"), &options, &|_| {}).unwrap().dataset;
    for camera in &dataset.manifest.cameras {
        match dataset.read_events(camera).unwrap() {
            Some(events) => assert!(events.is_empty(), "{} sees {} events", camera.name, events.len()),
            None => {
                let first = dataset.read_image(camera, &camera.frames[0]).unwrap();
                for frame in &camera.frames {
                    assert!(dataset.read_image(camera, frame).unwrap() == first, "{} sees a change", camera.name);
                    let mask = dataset.read_mask(camera, frame).unwrap();
                    assert!(mask.is_none_or(|mask| mask.data.iter().all(|value| *value == 0)));
                }
            }
        }
    }
}
