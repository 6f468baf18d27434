use std::fs;

use crate::command_line::{Folder, blank::best_of_one_colour};

#[test]
fn a_film_becomes_two_runs_and_a_report_that_stands_alone() {
    let folder = Folder::with_stage("ds");
    for method in ["4dgs", "erf-gs"] {
        let trained = folder.figures(&format!(
            "train ds --method {method} --iterations 30+40 --seed 1 --set evaluation.log_every=10 \
             --set evaluation.every=35 --out {method}"
        ));
        assert_eq!(
            (trained["finished"].as_bool(), trained["iterations"].as_u64()),
            (Some(true), Some(70)),
            "{trained}"
        );
        let metrics = folder.figures(&format!("eval {method}"));
        // After these iterations both methods are 1.7 dB above a blank picture, and 2.0 dB where things move; seeds differ by 0.05 dB.
        let blank = best_of_one_colour(&folder.path(method));
        let [psnr, dpsnr] = ["psnr", "dpsnr"].map(|key| metrics[key].as_f64().expect("a figure"));
        assert!(psnr > blank[0] + 1.0 && dpsnr > blank[1] + 1.0, "{psnr} and {dpsnr} dB, blank {blank:?} dB");
        assert!(metrics["lpips"].is_null() && metrics["dpsnr_mask"] == "given", "{metrics}");
        for key in ["ssim", "train_psnr", "iterations", "train_seconds", "gaussians", "render_fps"] {
            assert!(metrics[key].as_f64() > Some(0.0), "{key} in {metrics}");
        }
        let written: serde_json::Value =
            serde_json::from_slice(&fs::read(folder.path(method).join("metrics.json")).expect("metrics"))
                .expect("JSON");
        assert_eq!(written, metrics);
    }
    let report = folder.figures("report 4dgs erf-gs --out report.html");
    assert_eq!(report["runs"].as_array().map(Vec::len), Some(2), "{report}");
    let page = fs::read_to_string(folder.path("report.html")).expect("the page");
    assert!(page.contains("erf-gs") && page.contains("4dgs") && page.contains("data:image/"), "pictures are inside");
    for outside in ["src=\"http", "href=\"http", "url(http", "@import", "<script src"] {
        assert!(!page.contains(outside), "{outside}");
    }
    let curve = fs::read_to_string(folder.path("erf-gs/curve.csv")).expect("the curve");
    assert!(curve.lines().count() > 6, "{curve}");
    let info = folder.figures("info erf-gs");
    assert_eq!((&info["kind"], &info["run"]["method"]), (&"run".into(), &"erf-gs".into()), "{info}");

    rendering_and_export(&folder);
}

fn rendering_and_export(folder: &Folder) {
    let files = |name: &str| fs::read_dir(folder.path(name)).expect("a folder").count();
    let still = folder.figures("render erf-gs --path camera test00 --times 0.1 --out still");
    assert_eq!((still["frames"].as_u64(), files("still")), (Some(1), 1), "{still}");
    folder.succeed("render erf-gs --path orbit --frames 3 --format exr --out orbit");
    assert_eq!(files("orbit"), 3);
    // Another film is never mixed with this one.
    let stderr = folder.fail(2, "render erf-gs --path orbit --frames 2 --format exr --out orbit");
    assert!(stderr.contains("00000.exr") && stderr.contains("--force"), "{stderr}");
    fs::write(folder.path("orbit/notes.txt"), "kept").expect("written");
    folder.succeed("render erf-gs --path orbit --frames 2 --format exr --out orbit --force");
    assert_eq!(files("orbit"), 3, "two pictures, and the notes");
    let video = folder.figures("render erf-gs --path orbit --times 0.05..0.2 --frames 4 --scale 0.5 --out turn.mp4");
    assert_eq!((video["width"].as_u64(), video["format"].as_str()), (Some(24), Some("mp4")), "{video}");
    assert!(fs::metadata(folder.path("turn.mp4")).expect("a video").len() > 500);
    fs::write(
        folder.path("keys.json"),
        r#"{"world_to_camera": [{"rotation_wxyz": [1, 0, 0, 0], "translation_m": [0, 1, 2]},
            {"rotation_wxyz": [1, 0, 0.1, 0], "translation_m": [0.2, 1, 2]}]}"#,
    )
    .expect("written");
    folder.succeed("render erf-gs --path keys.json --times 0..0.3 --frames 2 --out keyed");
    assert_eq!(files("keyed"), 2);

    let exported = folder.figures("export erf-gs --instants 3 --out splats");
    assert_eq!(exported.as_array().map(Vec::len), Some(4), "{exported}");
    let ply = fs::read(folder.path("splats/point_cloud_t/00002.ply")).expect("a point cloud");
    assert!(ply.starts_with(b"ply\nformat binary_little_endian 1.0\nelement vertex "));
    folder.fail(2, "export erf-gs --instants 2 --out splats");
    folder.succeed("export erf-gs --instants 2 --out splats --force");
    assert_eq!(files("splats/point_cloud_t"), 2, "none is of the export before");
}

#[test]
fn a_run_without_initial_points_makes_them() {
    let folder = Folder::with_stage("ds");
    let manifest = folder.path("ds/dataset.json");
    let mut dataset: serde_json::Value =
        serde_json::from_slice(&fs::read(&manifest).expect("a manifest")).expect("JSON");
    dataset.as_object_mut().expect("an object").remove("points");
    dataset["sha256"].as_object_mut().expect("an object").remove("points.ply");
    fs::write(&manifest, dataset.to_string()).expect("written");
    assert!(folder.figures("info ds")["points"].is_null());
    // Random points belong to the run; others are made once, for the dataset.
    folder.succeed("train ds --method 4dgs --init random --iterations 1+1 --no-evaluation --out random");
    assert!(folder.figures("info ds")["points"].is_null());
    folder.succeed("train ds --method 4dgs --init sweep --iterations 1+1 --no-evaluation --out swept");
    assert!(folder.figures("info ds")["points"].as_u64() > Some(0));
}
