//! The whole chain as a user of a real rig goes it, with emulated devices: recordings of a screen, a wand and a performance,
//! and nothing else.

use std::path::Path;

use erfgs_dataset::Dataset;
use erfgs_emulated_rig::{Act, Plan, record};
use erfgs_scene::rig_file::RigFile;

use crate::recording::files::json;

fn figures(folder: &Path, words: &str) -> serde_json::Value {
    json(folder, &words.split_whitespace().chain(["--json"]).collect::<Vec<_>>())
}

#[test]
fn a_rig_that_nobody_knows_is_calibrated_and_what_it_saw_is_reconstructed() {
    let kept = tempfile::tempdir().expect("a folder");
    let folder = kept.path();
    let plan = Plan { performance_s: 0.15, wand_s: 4.0, ..Plan::small().expect("a plan") };
    for (act, name) in [(Act::Screen, "screen"), (Act::Wand, "wand"), (Act::Performance, "performance")] {
        record(&plan, act, &folder.join(name).with_extension("mcap"), &|_, _| {}).expect("a take");
    }
    figures(
        folder,
        "calibrate board screen.mcap --target chessboard:9x6:0.03 --blink 15 --intrinsics-only --out lenses.json",
    );
    figures(folder, "calibrate wand wand.mcap --wand 0.13+0.26 --led-hz 385,500,625 --rig lenses.json --out rig.json");
    let rig = RigFile::read(&folder.join("rig.json")).expect("a rig");
    let found: Vec<_> = plan
        .cameras
        .iter()
        .map(|camera| (camera, rig.cameras.iter().find(|other| other.name == camera.id).expect("it was calibrated")))
        .collect();
    let centre = |index: usize| found[index].1.pose.expect("a pose").centre();
    // By how much a camera's distance from the first one is wrong, metres.
    let wrong = |index: usize| {
        let apart = (found[index].0.place.centre() - found[0].0.place.centre()).length();
        ((centre(index) - centre(0)).length() - apart).abs()
    };
    for (index, (camera, calibrated)) in found.iter().enumerate() {
        // Pictures are 160 pixels wide here, so that a fiftieth of a pixel is 0.02 % of their focal lengths: bounds are five
        // times what is stated (0.1 px, 2 mm).
        let off = calibrated.intrinsics.fx / camera.lens.fx - 1.0;
        assert!(off.abs() < 0.005, "{}: focal length off by {:.2} %", camera.id, 100.0 * off);
        let wrong = wrong(index);
        assert!(wrong < 0.01, "{}: {:.1} mm from where it is", camera.id, 1e3 * wrong);
        // Event cameras and triggered cameras agree on when the wand was where.
        let late_us = 1e6 * calibrated.time_offset_s;
        let limit_us = if camera.id.starts_with("free") { 10_000.0 } else { 600.0 };
        assert!(late_us.abs() < limit_us, "{}: {late_us} us late", camera.id);
    }
    figures(
        folder,
        "dataset import session performance.mcap --rig rig.json --from 1.5 --seconds 0.15 --scale 0.5 --scale-of \
         event0=0.125 --test free0 --out recorded",
    );
    // What the calibration says of its own certainty goes along, and covers: distances from the first camera lie within five of their
    // standard deviations.
    let recorded = Dataset::load(&folder.join("recorded")).expect("a dataset");
    let spread = |name: &str| {
        let camera = recorded.manifest.cameras.iter().find(|camera| camera.name == name).expect("it recorded");
        let centre = camera.pose_sigma.expect("the calibration tells").centre_m;
        centre.iter().map(|sigma| sigma * sigma).sum::<f64>()
    };
    for (index, (camera, _)) in found.iter().enumerate().skip(1) {
        let wrong = wrong(index);
        let sigma = (spread(&camera.id) + spread(&found[0].0.id)).sqrt();
        assert!(wrong < 5.0 * sigma && sigma < 0.05, "{}: {wrong} m off, {sigma} m stated", camera.id);
    }
    // So does what it says of clocks: one trigger exposes all of these, so that they are late by the same.
    let clocks: Vec<[f64; 2]> = found
        .iter()
        .filter(|(camera, _)| camera.id.starts_with("rgb"))
        .map(|(camera, calibrated)| {
            let of = recorded.manifest.cameras.iter().find(|of| of.name == camera.id).expect("it recorded");
            [calibrated.time_offset_s, of.clock_sigma_s.expect("the calibration tells")]
        })
        .collect();
    for [[late, sigma], [other, other_sigma]] in clocks.windows(2).map(|pair| [pair[0], pair[1]]) {
        let sigma = sigma.hypot(other_sigma);
        assert!((late - other).abs() < 5.0 * sigma && sigma < 1e-3, "{clocks:?}");
    }
    let dataset = figures(folder, "dataset undistort recorded --out ds");
    assert!(dataset["events"].as_u64() > Some(10_000), "{dataset}");
    figures(folder, "dataset points ds");
    let [without, with] = ["4dgs", "erf-gs"].map(|method| {
        figures(folder, &format!("train ds --method {method} --iterations 100+100 --seed 1 --out {method}"));
        let metrics = figures(folder, &format!("eval {method}"));
        // A grey picture of this scene has about 14 dB.
        metrics["psnr"].as_f64().filter(|psnr| *psnr > 15.0).unwrap_or_else(|| panic!("{method}: {metrics}"))
    });
    // So few iterations show no gain; events in wrong units, or in wrong places, lose half a decibel and more.
    assert!(with > without - 0.3, "{with} dB with events, {without} dB without");
    figures(folder, "report 4dgs erf-gs --out report.html");
}
