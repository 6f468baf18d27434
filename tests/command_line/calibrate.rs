//! `erfgs calibrate`: a board, what is drawn of it, and the formats of other programs.

use std::path::Path;

use super::{Folder, browser::Browser};

const CHESSBOARD: &str = "--target chessboard:9x6:0.025";

/// A folder with pairs of pictures of a chessboard.
fn with_pairs() -> Folder {
    let folder = Folder::new();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("calibrate/tests/data/chessboards");
    super::copy(&from, &folder.path("pairs"));
    folder
}

#[test]
fn a_stereo_pair_is_calibrated_reported_and_converted() {
    let folder = with_pairs();
    let rig = folder.figures(&format!("calibrate board pairs {CHESSBOARD} --out rig.json"));
    assert!(rig["quality"]["rms_px"].as_f64().unwrap() < 0.22, "{rig}");
    assert_eq!([&rig["cameras"][0]["name"], &rig["cameras"][1]["name"]], ["left", "right"]);
    let page = std::fs::read_to_string(folder.path("rig.html")).unwrap();
    assert!(page.contains("Residuals of right") && page.contains("solver time"));
    let known = folder.figures(&format!("calibrate board pairs {CHESSBOARD} --rig rig.json --out again.json"));
    assert_eq!(known["cameras"][0]["intrinsics"], rig["cameras"][0]["intrinsics"]);
    let stdout = folder.succeed("calibrate convert rig.json --to colmap --out model");
    assert!(stdout.contains("uncertainties"), "{stdout}");
    let back = folder.figures("calibrate convert model --to rig --out back.json");
    assert_eq!(back["cameras"], 2);
    let message = folder.fail(1, "calibrate convert rig.json --to kalibr --out camchain.yaml");
    assert!(message.contains("camera left"), "{message}");
}

#[test]
fn a_report_is_read_at_a_desk_and_on_a_phone() {
    let folder = with_pairs();
    folder.succeed("calibrate board pairs --target chessboard:9x6:0.025 --out rig.json -q");
    let mut browser = Browser::unseen();
    browser.open(&format!("file://{}", folder.path("rig.html").display()));
    for (width, height) in [(1280, 800), (390, 844)] {
        browser.resize(width, height);
        // Nothing makes the page wider, and what a table has more can be scrolled to.
        browser.wait(&format!("innerWidth === {width} && document.documentElement.scrollWidth <= {width}"));
        let all = |of: &str, is: &str| format!("[...document.querySelectorAll('{of}')].every((e) => {is})");
        browser.wait(&all("table", "getComputedStyle(e.parentElement).overflowX === 'auto'"));
        browser.wait(&all("figure, .space, .plot", "e.getBoundingClientRect().right <= innerWidth"));
        // What is written in the drawings is large enough to be read, and pictures to see what bends.
        let on_screen = "parseFloat(getComputedStyle(e).fontSize) * e.ownerSVGElement.getScreenCTM().a >= 8.5";
        browser.wait(&all(".space text, .plot text", on_screen));
        browser.wait(&all(".two svg", "e.getBoundingClientRect().width >= 350"));
    }
    browser.wait("['.axis-x', '.axis-y', '.axis-z', '.scale', '.board'].every((part) => document.querySelector(`.space ${part}`))");
}

#[test]
fn wrong_targets_and_empty_folders_are_explained() {
    let folder = with_pairs();
    let message = folder.fail(2, "calibrate board pairs --target chessboard:9");
    assert!(message.contains("chessboard:9x6:0.025"), "{message}");
    let message = folder.fail(1, "calibrate board pairs --target chessboard:7x4:0.025");
    assert!(message.contains("camera left") && message.contains("0 of 13"), "{message}");
    std::fs::create_dir(folder.path("empty")).unwrap();
    let message = folder.fail(1, &format!("calibrate board empty {CHESSBOARD}"));
    assert!(message.contains("empty") && !folder.path("rig.json").exists(), "{message}");
}

#[test]
fn a_sessions_calibration_pictures_are_found_and_what_is_not_looked_at_is_said() {
    let folder = with_pairs();
    std::fs::create_dir(folder.path("session")).unwrap();
    std::fs::rename(folder.path("pairs"), folder.path("session/calibration_images")).unwrap();
    std::fs::write(folder.path("session/mouse1.mp4"), "a film of something else").unwrap();
    let output = folder.run(&format!("calibrate board session {CHESSBOARD} --out rig.json"));
    let stderr = String::from_utf8_lossy(&output.stderr);
    for word in [
        "looking for the board in session/calibration_images",
        "mouse1.mp4",
        "left: the board is seen in 13 of 13 frames of",
    ] {
        assert!(output.status.success() && stderr.contains(word), "{word}: {stderr}");
    }
    assert!(folder.fail(2, &format!("calibrate board session {CHESSBOARD} --clear")).contains("has no markers"));
}

#[test]
fn backs_that_cannot_be_told_from_the_front_are_refused() {
    let folder = with_pairs();
    let grid = "--target aprilgrid:6x6:0.088:0.3";
    let message = folder.fail(2, &format!("calibrate board pairs {grid} --back aprilgrid:4x4:0.1:0.3:first=30"));
    assert!(message.contains("aprilgrid:4x4:0.1:0.3:first=36"), "{message}");
    let message = folder.fail(2, &format!("calibrate board pairs {CHESSBOARD} --back chessboard:8x5:0.025"));
    assert!(message.contains("has no markers"), "{message}");
    let message = folder.fail(2, &format!("calibrate board pairs {grid} --back-thickness 5"));
    assert!(message.contains("--back <TARGET>"), "{message}");
    let back = "--back aprilgrid:6x6:0.088:0.3:first=36";
    let message = folder.fail(2, &format!("calibrate board pairs {grid} {back} --blink 15"));
    assert!(message.contains("--blink"), "{message}");
    let message = folder.fail(1, &format!("calibrate board pairs {grid} {back} --back-thickness 5"));
    assert!(message.contains("0 of 13") && message.contains("first=36 on its back"), "{message}");
}

#[test]
fn boards_are_drawn_in_every_form() {
    let folder = Folder::new();
    for out in ["board.svg", "board.pdf", "board.html"] {
        folder.succeed(&format!("calibrate target charuco:5x7:0.03:0.0225:DICT_4X4_50 --out {out}"));
        assert!(folder.path(out).metadata().unwrap().len() > 2000, "{out}");
    }
    let message = folder.fail(2, "calibrate target chessboard:9x6:0.02 --out board.png");
    assert!(message.contains(".svg"), "{message}");
}

#[test]
fn a_check_passes_on_the_same_pictures_and_tells_when_cameras_moved() {
    let folder = with_pairs();
    folder.succeed(&format!("calibrate board pairs {CHESSBOARD} --out rig.json"));
    folder.succeed(&format!("calibrate check rig.json pairs {CHESSBOARD}"));
    let mut rig: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.path("rig.json")).unwrap()).unwrap();
    rig["cameras"][1]["pose"]["translation_m"][0] = (-0.09).into();
    std::fs::write(folder.path("moved.json"), rig.to_string()).unwrap();
    let message = folder.fail(1, "calibrate check rig.json moved.json");
    assert!(message.contains("too few agree"), "{message}");
    let page = std::fs::read_to_string(folder.path("check.html")).unwrap();
    assert!(page.contains("Cameras moved relative to each other") && page.contains("Before and after"), "{page}");
    assert!(folder.fail(2, "calibrate check rig.json pairs").contains("--target"));
}

#[test]
fn a_transforms_json_keeps_its_lens_or_is_refused_by_name() {
    let folder = Folder::new();
    let write = |model: &str| {
        let frame = serde_json::json!({
            "file_path": "images/a.png", "camera_model": model, "w": 640, "h": 480, "fl_x": 500.0, "k1": -0.2, "k3": 0.01,
            "mask_path": "a_mask.png",
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]],
        });
        let file = serde_json::json!({ "frames": [frame] });
        std::fs::write(folder.path("transforms.json"), file.to_string()).unwrap();
    };
    write("OPENCV");
    folder.succeed("calibrate convert transforms.json --to rig --out rig.json");
    let rig: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.path("rig.json")).unwrap()).unwrap();
    let lens = &rig["cameras"][0]["intrinsics"]["distortion"]["brown_conrady"];
    assert_eq!(*lens, serde_json::json!([-0.2, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0]));
    assert!(rig["warnings"].to_string().contains("mask_path"), "{rig}");
    write("EQUIRECTANGULAR");
    let message = folder.fail(1, "calibrate convert transforms.json --to rig --out rig.json");
    assert!(message.contains("a.png") && message.contains("EQUIRECTANGULAR"), "{message}");
}

/// As OpenCV's and Anipose's programs write what was calibrated with a board in millimetres.
#[test]
fn rigs_in_millimetres_are_refused_until_their_unit_is_said() {
    let folder = Folder::new();
    let camera = |name: &str, x: f64| {
        format!(
            "[{name}]\nname = \"{name}\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
             distortions = [-0.1, 0.0, 0.0, 0.0, 0.0]\nrotation = [0.0, 0.0, 0.0]\ntranslation = [{x:?}, 0.0, 0.0]\n\n"
        )
    };
    let text = camera("A", 0.0) + &camera("B", 431.0) + "[metadata]\nadjusted = false\nerror = 0.4\n";
    std::fs::write(folder.path("calibration.toml"), &text).unwrap();
    let message = folder.fail(1, "calibrate convert calibration.toml --to rig --out rig.json");
    assert!(message.contains("431.000 m") && message.contains("--units mm (0.431 m)"), "{message}");
    let message = folder.fail(1, "calibrate merge calibration.toml calibration.toml --out rig.json");
    assert!(message.contains("calibrate convert calibration.toml --to rig --units"), "{message}");
    folder.succeed("calibrate convert calibration.toml --to rig --units mm --out rig.json");
    let rig: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.path("rig.json")).unwrap()).unwrap();
    assert_eq!((&rig["metric"], &rig["cameras"][1]["pose"]["translation_m"][0]), (&true.into(), &0.431.into()));
    assert!(folder.fail(2, "calibrate convert calibration.toml --to rig --units mm --metres").contains("--metres"));
    assert!(
        folder.fail(2, "calibrate convert calibration.toml --to rig --units parsec").contains("m, cm, mm and inch")
    );
}

#[test]
fn one_camera_with_its_lens_given_is_no_panic_and_other_sizes_and_names_are_refused() {
    let folder = with_pairs();
    folder.succeed(&format!("calibrate board pairs {CHESSBOARD} --without right --intrinsics-only --out left.json"));
    std::fs::create_dir(folder.path("one")).unwrap();
    for entry in std::fs::read_dir(folder.path("pairs")).unwrap().map(|entry| entry.unwrap()) {
        if entry.file_name().to_string_lossy().starts_with("left0") {
            std::fs::copy(entry.path(), folder.path("one").join(entry.file_name())).unwrap();
        }
    }
    std::fs::write(folder.path("one/left99.png"), "no picture").unwrap();
    let rig = folder.figures(&format!("calibrate board one {CHESSBOARD} --rig left.json --out again.json"));
    assert!(rig["cameras"][0]["rms_px"].as_f64().unwrap() < 0.25 && rig["cameras"][0]["pose"].is_null(), "{rig}");
    let warnings = rig["cameras"][0]["warnings"].to_string();
    assert!(warnings.contains("1 pictures could not be read") && warnings.contains("left99.png"), "{warnings}");
    let mut lens: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path("left.json")).unwrap()).unwrap();
    let mut with = |key: &str, value: serde_json::Value| {
        match key {
            "name" => lens["cameras"][0]["name"] = value,
            key => lens["cameras"][0]["intrinsics"][key] = value,
        }
        std::fs::write(folder.path("other.json"), lens.to_string()).unwrap();
        folder.fail(1, &format!("calibrate board one {CHESSBOARD} --rig other.json --out none.json"))
    };
    assert!(with("width", 1280.into()).contains("1280x480"));
    assert!(with("name", "front".into()).contains("front"));
    assert!(!folder.path("none.json").exists());
}

#[test]
fn pairs_in_folders_belong_together_by_their_numbers_and_lenses_are_kept_where_nothing_does() {
    let folder = with_pairs();
    for entry in std::fs::read_dir(folder.path("pairs")).unwrap().map(|entry| entry.unwrap()) {
        let name = entry.file_name().into_string().unwrap();
        let camera = if name.starts_with("left") { "left" } else { "right" };
        for into in [format!("sorted/{camera}"), format!("apart/{camera}")] {
            std::fs::create_dir_all(folder.path(&into)).unwrap();
            std::fs::copy(entry.path(), folder.path(&into).join(&name)).unwrap();
        }
    }
    for number in ["01", "02", "03", "04", "05", "06"] {
        std::fs::remove_file(folder.path(&format!("apart/left/left{number}.jpg"))).unwrap();
    }
    for number in ["07", "08", "09", "11", "12", "13", "14"] {
        std::fs::remove_file(folder.path(&format!("apart/right/right{number}.jpg"))).unwrap();
    }
    let rig = folder.figures(&format!("calibrate board sorted {CHESSBOARD} --out rig.json --origin 1"));
    assert!(rig["cameras"][1]["pose"].is_object() && rig["cameras"][0]["pose"]["translation_m"][2] != 0.0, "{rig}");
    let message = folder.fail(1, &format!("calibrate board apart {CHESSBOARD} --out lenses.json"));
    assert!(message.contains("lenses.json holds the intrinsics alone"), "{message}");
    let lenses: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path("lenses.json")).unwrap()).unwrap();
    assert_eq!(lenses["cameras"].as_array().unwrap().len(), 2);
    // With the lenses of one and the places of another, there is a rig again.
    let merged = folder.figures("calibrate merge lenses.json rig.json --out merged.json");
    assert!(merged["cameras"][1]["pose"].is_object(), "{merged}");
}

#[test]
fn lengths_that_cannot_be_metres_are_asked_about() {
    let folder = with_pairs();
    let message = folder.fail(2, "calibrate board pairs --target chessboard:9x6:25");
    assert!(message.contains("if it is millimetres, write 0.025"), "{message}");
    let message = folder.fail(2, "calibrate wand pairs --wand 130+260");
    assert!(message.contains("if it is millimetres, write 0.26"), "{message}");
    let message = folder.fail(2, "calibrate sfm pairs --scale-from left:right:1250");
    assert!(message.contains("if it is millimetres, write 1.25"), "{message}");
}

#[test]
fn a_camera_called_as_a_path_is_written_below_the_output_alone() {
    let folder = with_pairs();
    let lens = serde_json::json!({ "width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "distortion": "none" });
    let pose = serde_json::json!({ "rotation_wxyz": [1.0, 0.0, 0.0, 0.0], "translation_m": [0.0, 0.0, 0.0] });
    let camera = |name: &str| serde_json::json!({ "name": name, "modality": "rgb", "intrinsics": lens, "pose": pose });
    let write = |cameras: &[serde_json::Value]| {
        let rig = serde_json::json!({ "format": "erfgs-rig", "version": 1, "method": "board", "metric": true, "cameras": cameras });
        std::fs::write(folder.path("rig.json"), rig.to_string()).unwrap();
    };
    write(&[camera("../../x"), camera("a b")]);
    for format in ["colmap", "kalibr", "opencv", "ros", "nerfstudio", "llff", "caliscope", "pose2sim"] {
        let stdout = folder.succeed(&format!("calibrate convert rig.json --to {format} --out out/{format}"));
        assert!(stdout.contains("it is called _.._.._x there"), "{format}: {stdout}");
    }
    let images = std::fs::read_to_string(folder.path("out/colmap/images.txt")).unwrap();
    assert!(images.contains("_.._.._x.png") && images.contains("a_b.png"), "{images}");
    let back = folder.figures("calibrate convert out/colmap --to rig --metres --out back.json");
    assert_eq!(back["cameras"], 2);
    let rig = std::fs::read_to_string(folder.path("back.json")).unwrap();
    assert!(rig.contains("\"metric\": true"), "{rig}");
    write(&[]);
    assert!(folder.fail(1, "calibrate convert rig.json --to opencv --out none").contains("no camera"));
    write(&[camera("a"), camera("a")]);
    assert!(folder.fail(1, "calibrate convert rig.json --to colmap --out none").contains("two cameras are called a"));
    assert!(!folder.path("none").exists());
}

#[test]
fn cameras_are_placed_by_points_that_were_clicked() {
    let folder = Folder::new();
    let lens = serde_json::json!({ "width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "distortion": "none" });
    let camera = serde_json::json!({ "name": "a", "modality": "rgb", "intrinsics": lens });
    let rig = serde_json::json!({ "format": "erfgs-rig", "version": 1, "method": "board", "metric": true, "cameras": [camera] });
    std::fs::write(folder.path("lenses.json"), rig.to_string()).unwrap();
    // A camera three metres before the origin.
    let points =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 1.0], [-1.0, 0.5, 0.5], [0.5, -0.5, 1.0]];
    let line = |[x, y, z]: [f64; 3]| {
        format!("a,{},{},{x},{y},{z}\n", 320.0 + 500.0 * x / (z + 3.0), 240.0 + 500.0 * y / (z + 3.0))
    };
    std::fs::write(folder.path("p.csv"), format!("camera,u,v,x,y,z\n{}", points.map(line).concat())).unwrap();
    let rig = folder.figures("calibrate points p.csv --rig lenses.json --out rig.json");
    let along = rig["cameras"][0]["pose"]["translation_m"][2].as_f64().unwrap();
    assert!((along - 3.0).abs() < 1e-6, "{rig}");
    assert!(folder.fail(1, "calibrate points lenses.json --rig lenses.json").contains("camera,u,v,x,y,z"));
}
