//! `erfgs calibrate`: a board, what is drawn of it, and the formats of other programs.

use std::path::Path;

use super::Folder;

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
    let said = folder.succeed("calibrate convert rig.json --to colmap --out model");
    assert!(said.contains("uncertainties"), "{said}");
    let back = folder.figures("calibrate convert model --to rig --out back.json");
    assert_eq!(back["cameras"], 2);
    let message = folder.fail(1, "calibrate convert rig.json --to kalibr --out camchain.yaml");
    assert!(message.contains("camera left"), "{message}");
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
    assert!(message.contains("against each other"), "{message}");
    let page = std::fs::read_to_string(folder.path("check.html")).unwrap();
    assert!(page.contains("moved against each other") && page.contains("Before and after"), "{page}");
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
