use std::fs;

use serde_json::Value;

use crate::command_line::Folder;

#[test]
fn wrong_usage_ends_with_code_2_and_says_what_is_right() {
    let folder = Folder::with_stage("ds");
    for (words, hint) in [
        ("", "Usage"),
        ("trian ds", "train"),
        ("train ds", "--out"),
        ("train ds --out run --iterations many", "3000+14000"),
        ("train ds --out run --set density.evry=3", "density.evry"),
        ("train ds --out run --set batch=0", "batch"),
        ("train ds --out run --set earl.weight=nan", "earl.weight"),
        ("train ds --out run --set density.max_gaussians=1000000000", "0 to 1e8"),
        ("train ds --out run --set learning_rate.scale=-0.1", "learning_rate.scale"),
        ("train ds --out run --iterations 1000000000+5", "coarse_iterations"),
        ("replay s.mcap --seek 1e300", "plausible"),
        ("info a.dat --size 65535x65535", "plausible"),
        ("calibrate check a.json b.json --shift nan", "0 to 1000000"),
        ("train ds --out run --deterministic --minutes 3", "--minutes"),
        ("dataset import panoptic x --frames 84..40 --out y", "ends before it starts"),
        ("dataset import tape x --out y", "session"),
        ("dataset points ds --method guess", "colmap"),
        ("simulate x.npz --fps 30 --threshold 0 --out y.npz", "threshold_on"),
        ("render run --path camera --out x", "--path camera 03"),
        ("render run --out x.mp4 --format png", ".mp4"),
        ("info nowhere", "nowhere"),
        ("export ds --to colmap --size 64x48 --out o", "--size is for an event file"),
        ("export ds --to colmap --from 1 --out o", "--from"),
        ("export ds --to nerfstudio --exact --out o", "--exact"),
        ("export ds --to nerfstudio --fps 3 --out o", "--fps"),
        ("export ds --columns x,y,p,t --out o", "--columns is for an event file"),
        ("export ds/events/event00.npz --to csv --instants 3", "--instants is for a run"),
        ("export ds/events/event00.npz --to csv --at 0.1", "--at"),
        ("info ds --columns x,y,p,t", "--columns is for events as text"),
        ("info a.csv --columns x,y,p", "lacks t"),
    ] {
        let stderr = folder.fail(2, words);
        assert!(stderr.contains(hint), "erfgs {words}: {stderr}");
    }
    let stderr = folder.fail(1, "dataset import panoptic x --fps 0 --out y");
    assert!(stderr.contains("--fps") && stderr.contains("a rate is 0 Hz"), "{stderr}");
    assert!(!folder.path("run").exists(), "nothing is begun");
}

#[test]
fn every_command_explains_itself_with_examples() {
    let folder = Folder::new();
    for command in [
        "dataset import",
        "dataset variant",
        "dataset points",
        "dataset check",
        "dataset undistort",
        "simulate",
        "train",
        "eval",
        "render",
        "export",
        "import",
        "replay",
        "recover",
        "merge",
        "sweep",
        "info",
        "report",
        "doctor",
        "bench simulate",
        "bench raster",
        "bench train",
    ] {
        let help = folder.succeed(&format!("{command} --help"));
        assert!(help.contains("Example") && help.contains(&format!("erfgs {command}")), "{command}: {help}");
        assert!(help.contains("--json"), "{command}");
    }
}

#[test]
fn what_is_missing_is_named() {
    let folder = Folder::with_stage("ds");
    fs::create_dir(folder.path("empty")).expect("a folder");
    for (words, hint) in [
        ("train nowhere --out run", "nowhere"),
        ("train empty --out run", "erfgs dataset import"),
        ("eval empty", "run.json"),
        ("report empty --out r.html", "run.json"),
        ("dataset import panoptic empty --out out", "empty"),
        ("dataset import colmap nowhere --out out", "nowhere"),
        ("simulate nowhere.npz --fps 30 --out y.npz", "nowhere.npz"),
        ("doctor --adapter no-such-adapter", "no-such-adapter"),
        ("train ds --out run --adapter no-such-adapter", "no-such-adapter"),
    ] {
        let stderr = folder.fail(1, words);
        assert!(stderr.contains(hint), "erfgs {words}: {stderr}");
    }
}

/// Changes the manifest of a dataset.
fn edit(folder: &Folder, change: impl FnOnce(&mut Value)) {
    let path = folder.path("ds/dataset.json");
    let mut manifest: Value = serde_json::from_slice(&fs::read(&path).expect("a manifest")).expect("JSON");
    change(&mut manifest);
    fs::write(path, manifest.to_string()).expect("written");
}

#[test]
fn a_damaged_dataset_is_refused_with_file_and_camera() {
    type Damage = fn(&Folder);
    let cases: [(Damage, &str); 7] = [
        (|f| fs::write(f.path("ds/dataset.json"), "{\"format\": ").expect("written"), "dataset.json"),
        (|f| edit(f, |m| m["version"] = 99.into()), "version 99"),
        (|f| edit(f, |m| m["cameras"][1]["world_to_camera"]["translation_m"][0] = Value::Null), "dataset.json"),
        (|f| edit(f, |m| m["cameras"][1]["intrinsics"]["fx"] = (-3).into()), "rgb01"),
        (|f| edit(f, |m| m["cameras"][0]["frames"][0]["file"] = "../../outside.png".into()), "outside.png"),
        (|f| fs::write(f.path("ds/images/rgb02/00001.png"), b"no picture").expect("written"), "rgb02"),
        (|f| fs::remove_file(f.path("ds/events/event01.npz")).expect("removed"), "event01"),
    ];
    for (damage, hint) in cases {
        let folder = Folder::with_stage("ds");
        folder.succeed("dataset check ds");
        damage(&folder);
        for words in ["dataset check ds", "train ds --iterations 1+1 --out run"] {
            let stderr = folder.fail(1, words);
            assert!(stderr.contains(hint), "erfgs {words}: {stderr} (should name {hint})");
        }
    }
}
