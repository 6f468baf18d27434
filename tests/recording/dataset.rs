//! What a rig recorded, made into a dataset: the film of the stage must come back from its session.

use std::{fs, path::Path, sync::LazyLock};

use erfgs_dataset::{Dataset, Split};
use erfgs_scene::Modality;
use erfgs_stage::{EventOptions, FilmOptions, RigOptions, StageOptions, film};

use crate::recording::{files::json, rig::fail};

#[path = "../../examples/film_session/record.rs"]
mod record;

/// The film, its session and its rig file.
pub static FILM: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 64, height: 48, rgb: 4, event: 2, test: 1, ..RigOptions::default() },
        events: EventOptions::default(),
        duration_ns: 400_000_000,
        rgb_fps: 20.0,
        test_fps: 20.0,
        exposure_ns: 8_000_000,
        truth_points: 0,
        ..FilmOptions::default()
    };
    let film = film(&folder.path().join("film"), &options, &|_| {}).expect("a film");
    record::write(&film.dataset, &folder.path().join("take.mcap")).expect("a session");
    record::rig(&film.dataset).write(&folder.path().join("rig.json")).expect("a rig");
    folder
});

fn import(folder: &Path, more: &str) -> Dataset {
    for file in ["take.mcap", "rig.json"] {
        fs::copy(FILM.path().join(file), folder.join(file)).expect("copied");
    }
    let words: Vec<&str> = "dataset import session take.mcap --rig rig.json --out ds --json"
        .split(' ')
        .chain(more.split_whitespace())
        .collect();
    json(folder, &words);
    Dataset::load(&folder.join("ds")).expect("a dataset")
}

#[test]
fn a_recorded_take_becomes_the_dataset_that_was_filmed() {
    let folder = tempfile::tempdir().expect("a folder");
    let found = import(folder.path(), "--test test00");
    let film = Dataset::load(&FILM.path().join("film")).expect("the film");
    assert_eq!(found.manifest.cameras.len(), film.manifest.cameras.len());
    assert!(found.manifest.linear_exposure && found.manifest.provenance.importer == "session");
    // The first exposure begins at 0; the film's first label is its middle.
    let shift = 4_000_000;
    for (camera, filmed) in found.manifest.cameras.iter().zip(&film.manifest.cameras) {
        assert_eq!((&camera.name, camera.modality, camera.split), (&filmed.name, filmed.modality, filmed.split));
        assert_eq!(camera.intrinsics, filmed.intrinsics);
        assert!(camera.world_to_camera.centre().distance(filmed.world_to_camera.centre()) < 1e-12);
        assert_eq!(camera.frames.len(), filmed.frames.len(), "{}", camera.name);
        for (frame, original) in camera.frames.iter().zip(&filmed.frames) {
            assert!(
                (frame.t_ns - shift - original.t_ns).abs() < 50_000,
                "{}: {} {}",
                camera.name,
                frame.t_ns,
                original.t_ns
            );
            let length = |[open, close]: [i64; 2]| close - open;
            assert_eq!(length(frame.exposure_ns), length(original.exposure_ns));
            assert_eq!(
                found.read_image(camera, frame).expect("an image"),
                film.read_image(filmed, original).expect("an image")
            );
        }
        let (events, original) = (found.read_events(camera).expect("read"), film.read_events(filmed).expect("read"));
        assert_eq!(events.is_some(), filmed.modality == Modality::Event);
        let (Some(events), Some(original)) = (events, original) else { continue };
        let span_us = found.manifest.span_ns[1] / 1000;
        // At the ends of the span, what lies within the clocks' errors of it may fall out.
        let expected = original.between(-shift / 1000, span_us - shift / 1000).len();
        assert!(events.len().abs_diff(expected) <= expected / 200, "{} of {expected}", events.len());
        let first = original.iter().position(|event| event.t_us >= original.t_us[0] + 5000).expect("later events");
        let wanted = original.get(first);
        let close = events.iter().any(|event| {
            (event.x, event.y, event.on) == (wanted.x, wanted.y, wanted.on)
                && (event.t_us - shift / 1000 - wanted.t_us).abs() < 50
        });
        assert!(close, "{wanted:?}");
    }
    // Triggered cameras and the freely running one share the instants.
    let times = |name: &str| found.camera(name).expect("a camera").frames.iter().map(|f| f.t_ns).collect::<Vec<_>>();
    assert_eq!(times("rgb00"), times("rgb03"));
    assert_eq!(times("rgb00"), times("test00"));
    json(folder.path(), &["dataset", "check", "ds", "--json"]);
}

#[test]
fn a_window_is_cut_out_and_scaled_with_its_events() {
    let folder = tempfile::tempdir().expect("a folder");
    // The take begins a second and a half after the recording.
    let found = import(folder.path(), "--from 1.58 --seconds 0.24 --every 2 --scale 0.5 --threshold 0.2,0.3");
    let frames = &found.camera("rgb01").expect("a camera").frames;
    assert_eq!(frames.len(), 3, "of five frames each second one");
    assert!(found.manifest.span_ns[1].abs_diff(208_000_000) < 100_000, "{:?}", found.manifest.span_ns);
    let camera = found.camera("event00").expect("a camera");
    assert_eq!((camera.intrinsics.width, camera.intrinsics.height), (32, 24));
    let file = camera.events.as_ref().expect("events");
    assert!((file.threshold_on - 0.05).abs() < 1e-12 && (file.threshold_off - 0.075).abs() < 1e-12);
    let events = found.read_events(camera).expect("read").expect("events");
    assert!(events.len() > 100 && events.x.iter().all(|x| *x < 32) && events.y.iter().all(|y| *y < 24));
    assert!(events.t_us.is_sorted() && events.t_us[0] >= 0);
    // One of the five cameras with frames is held out.
    assert_eq!(found.cameras(Split::Test).count(), 1);
}

#[test]
fn what_does_not_fit_a_session_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for file in ["take.mcap", "rig.json"] {
        fs::copy(FILM.path().join(file), path.join(file)).expect("copied");
    }
    let other = fs::read_to_string(path.join("rig.json")).expect("text").replace("\"width\": 64", "\"width\": 60");
    fs::write(path.join("small.json"), other).expect("written");
    let renamed = fs::read_to_string(path.join("rig.json")).expect("text").replace("\"name\": \"", "\"name\": \"x");
    fs::write(path.join("renamed.json"), renamed).expect("written");
    for (code, words, hint) in [
        (1, "dataset import session take.mcap --out ds", "--rig"),
        (1, "dataset import session take.mcap --rig small.json --out ds", "calibrate it at the recorded size"),
        (1, "dataset import session take.mcap --rig renamed.json --out ds", "xrgb00"),
        (1, "dataset import session take.mcap --rig rig.json --from 100 --seconds 1 --out ds", "another window"),
        (1, "dataset import session take.mcap --rig rig.json --scale 0.7 --out ds", "one half"),
        (1, "dataset import session take.mcap --rig rig.json --frames 1..2 --out ds", "--every"),
        (1, "dataset import session take.mcap --rig rig.json --test nobody --out ds", "nobody"),
        (1, "dataset import session rig.json --rig rig.json --out ds", "rig.json"),
        (2, "dataset import session take.mcap --rig rig.json --threshold 9 --out ds", "0.22,0.25"),
        (1, "dataset import panoptic . --rig rig.json --out ds", "--rig"),
    ] {
        let stderr = fail(path, code, words);
        assert!(stderr.contains(hint), "erfgs {words}: {stderr}");
        assert!(!path.join("ds").exists(), "erfgs {words}");
    }
}
