//! The whole chain where something went wrong: cameras that drop out, pulses that are lost, a clock that jumps, a session that was cut
//! off, a calibration of another day, a camera that hangs upside down. Each ends in what is left and in words that say what is
//! lost, or in a refusal that names the camera.

use std::{f64::consts::PI, fs, path::Path, sync::LazyLock};

use erfgs_dataset::{Camera, Dataset};
use erfgs_emulated_rig::{Act, Fault, Plan, plan::Kind, record};
use erfgs_scene::Pose;
use glam::{DQuat, DVec3};

use crate::recording::{
    files::{erfgs, json},
    rig::fail,
};

/// When the cable of a camera is pulled, and when a clock jumps, seconds of the recording. The performance begins at 1.5 s.
const UNPLUGGED_S: f64 = 1.64;
const JUMP_S: f64 = 1.52;
/// What is imported.
const WINDOW: &str = "--from 1.4 --seconds 0.4";

/// A take in which much goes wrong, and the rig that recorded it.
static TAKE: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    let mut plan = Plan { performance_s: 0.2, ..Plan::small().expect("a plan") };
    // An event camera of 1280 x 720 pixels would take most of the time.
    plan.cameras.retain(|camera| camera.kind != Kind::Evk4);
    plan.faults = vec![
        Fault::ClockJump { camera: "davis".into(), at_s: JUMP_S, by_us: 5_000.0 },
        Fault::Unplugged { camera: "davis".into(), at_s: UNPLUGGED_S },
        Fault::Unplugged { camera: "rgb1".into(), at_s: UNPLUGGED_S },
        Fault::LostPulses { camera: "rgb2".into(), pulses: 31..33 },
        Fault::LostLines { pulses: 29..31 },
    ];
    record(&plan, Act::Performance, &folder.path().join("take.mcap"), &|_, _| {}).expect("a take");
    plan.rig_file("plan").write(&folder.path().join("rig.json")).expect("a rig");
    folder
});

/// A folder with the take and its rig.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for file in ["take.mcap", "rig.json"] {
        fs::copy(TAKE.path().join(file), folder.path().join(file)).expect("copied");
    }
    folder
}

/// What a command says on the standard error.
fn stderr_of(folder: &Path, words: &str) -> String {
    let output = erfgs(folder, &words.split(' ').collect::<Vec<_>>());
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "erfgs {words}\n{stderr}");
    stderr
}

fn camera<'a>(dataset: &'a Dataset, name: &str) -> &'a Camera {
    dataset.manifest.cameras.iter().find(|camera| camera.name == name).expect("it is there")
}

#[test]
fn of_cameras_that_drop_out_what_came_before_is_used_and_what_is_lost_is_said() {
    let kept = folder();
    let folder = kept.path();
    let stderr =
        stderr_of(folder, &format!("dataset import session take.mcap --rig rig.json {WINDOW} --test free0 --out ds"));
    for words in [
        "rgb1: 2 frames are missing between 1.669 s and ",
        "camera rgb1 was unplugged",
        "rgb2: 2 pulses between its first and its last frame gave no frame",
        "rgb2: 2 frames are missing between ",
        "davis: only its events from ",
        "the camera's clock restarts once: each part gets its own clock",
        "board: the lines of 2 pulses were lost; their times are interpolated",
    ] {
        assert!(stderr.contains(words), "{words}\n{stderr}");
    }
    let dataset = Dataset::load(&folder.join("ds")).expect("a dataset");
    let frames = |name: &str| camera(&dataset, name).frames.iter().map(|frame| frame.t_ns).collect::<Vec<_>>();
    // The pulses of whose lines two were lost.
    assert_eq!(frames("rgb0").len(), 8);
    assert_eq!((frames("rgb1").len(), frames("rgb2").len()), (6, 6));
    assert!(frames("rgb1").iter().chain(&frames("rgb2")).all(|t_ns| frames("rgb0").contains(t_ns)));
    // No events are not the same as a camera that saw none.
    let events = camera(&dataset, "davis").events.as_ref().expect("events");
    let zero_s = 1.64 - 1e-9 * events.covers_ns[1] as f64;
    assert!(events.covers_ns[0] == 0 && (1.39..1.42).contains(&zero_s), "{:?}", events.covers_ns);
    assert!(events.count > 10_000, "{}", events.count);
    // What is left is reconstructed.
    stderr_of(folder, "dataset points ds --method random");
    json(folder, &["train", "ds", "--iterations", "2+2", "--seed", "1", "--out", "run", "--json"]);
    let metrics = json(folder, &["eval", "run", "--json"]);
    assert!(metrics["psnr"].as_f64().is_some_and(f64::is_finite), "{metrics}");
}

#[test]
fn a_session_that_was_cut_off_is_imported_as_far_as_it_goes() {
    let kept = folder();
    let folder = kept.path();
    let bytes = fs::read(folder.join("take.mcap")).expect("a take");
    fs::write(folder.join("cut.mcap"), &bytes[..bytes.len() * 4 / 5]).expect("written");
    let words = "dataset import session cut.mcap --rig rig.json --from 0.5 --seconds 1.2 --test free0 --out cut";
    let stderr = fail(folder, 1, words);
    assert!(stderr.contains("cut.mcap was cut off: it ends at 1."), "{stderr}");
    assert!(stderr.contains("the intact part was imported") && stderr.contains("it was not ended"), "{stderr}");
    let [cut, whole] = [("cut.mcap", "cut"), ("take.mcap", "whole")].map(|(file, out)| {
        if out == "whole" {
            let words = format!(
                "dataset import session {file} --rig rig.json --from 0.5 --seconds 1.2 --test free0 --out {out}"
            );
            stderr_of(folder, &words);
        }
        Dataset::load(&folder.join(out)).expect("a dataset")
    });
    let (some, all) = (&camera(&cut, "rgb0").frames, &camera(&whole, "rgb0").frames);
    assert!(some.len() > 5 && some.len() < all.len(), "{} of {}", some.len(), all.len());
    assert!(some.iter().zip(all).all(|(frame, same)| (frame.t_ns - same.t_ns).abs() < 1_000_000));
    // What lies behind the cut is refused, with the reason.
    let stderr = fail(folder, 1, "dataset import session cut.mcap --rig rig.json --from 1.9 --out none");
    assert!(stderr.contains("it was not ended") && stderr.contains("recorded anything between"), "{stderr}");
}

#[test]
fn a_calibration_that_does_not_fit_what_cameras_see_is_refused_by_name() {
    let kept = folder();
    let folder = kept.path();
    stderr_of(folder, &format!("dataset import session take.mcap --rig rig.json {WINDOW} --test free0 --out good"));
    let turned = |pose: &Pose, by: DVec3, moved: DVec3| {
        let turn = DQuat::from_scaled_axis(by);
        Pose { rotation: (turn * pose.rotation).normalize(), translation: turn * pose.translation + moved }
    };
    let wrong = |out: &str, change: &dyn Fn(&str, &Pose) -> Pose| {
        let mut dataset = Dataset::load(&folder.join("good")).expect("a dataset");
        for camera in &mut dataset.manifest.cameras {
            camera.world_to_camera = change(&camera.name, &camera.world_to_camera);
        }
        dataset.save().expect("saved");
        fail(folder, 1, out)
    };
    let original = fs::read(folder.join("good/dataset.json")).expect("a manifest");
    let moved = wrong("dataset check good", &|name, pose| match name {
        "rgb2" => turned(pose, DVec3::ZERO, DVec3::X * 0.05),
        _ => *pose,
    });
    assert!(moved.contains("while rgb0, rgb1, rgb3, free0 fit each other: rgb2 sees"), "{moved}");
    assert!(moved.contains("--without rgb2") && !moved.contains("upside down"), "{moved}");
    fs::write(folder.join("good/dataset.json"), &original).expect("restored");
    let hung = wrong("dataset points good", &|name, pose| match name {
        "free0" => turned(pose, DVec3::Z * PI, DVec3::ZERO),
        _ => *pose,
    });
    assert!(hung.contains("free0 sees") && hung.contains("°: upside down"), "{hung}");
    fs::write(folder.join("good/dataset.json"), &original).expect("restored");
    let hung = wrong("dataset points good --method random", &|name, pose| match name {
        "davis" => turned(pose, DVec3::Z * PI, DVec3::ZERO),
        _ => *pose,
    });
    // Nothing is said of the other cameras: they are where they should be.
    assert!(hung.contains("error: davis hangs upside down") && !folder.join("good/points.ply").exists(), "{hung}");
    fs::write(folder.join("good/dataset.json"), &original).expect("restored");
    let other_day = wrong("dataset check good", &|name, pose| {
        let seed = name.bytes().map(f64::from).sum::<f64>();
        turned(
            pose,
            0.01 * DVec3::new(seed.sin(), seed.cos(), 0.0),
            0.05 * DVec3::new((2.0 * seed).cos(), seed.sin(), 0.0),
        )
    });
    assert!(other_day.contains("too few fit each other") && other_day.contains("Calibrate again;"), "{other_day}");
    // What a user knows better can be taken, and a camera be left out.
    stderr_of(folder, "dataset points good --method random --trust-poses");
    let words = format!(
        "dataset import session take.mcap --rig rig.json {WINDOW} --without rgb1 --without davis --out without"
    );
    stderr_of(folder, &words);
    let dataset = Dataset::load(&folder.join("without")).expect("a dataset");
    assert_eq!(
        dataset.manifest.cameras.iter().map(|camera| camera.name.as_str()).collect::<Vec<_>>(),
        ["rgb0", "rgb2", "rgb3", "free0"]
    );
}
