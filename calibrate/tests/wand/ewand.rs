//! eWand's recording of four cameras.

use std::path::{Path, PathBuf};

use erfgs_calibrate::wand::{WandOptions, calibrate, read_points};

/// The folder of real recordings, where there is one.
fn shared() -> PathBuf {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    std::env::var_os("ERFGS_SHARED").map_or_else(beside, PathBuf::from)
}

#[test]
fn a_recorded_rig_measures_wands_that_took_no_part() {
    let folder = shared().join("data/ewand_wand_4cam_points");
    if !folder.exists() {
        eprintln!("{} is not there: nothing checked", folder.display());
        return;
    }
    let cameras = read_points(&folder).unwrap();
    let (rig, evidence) = calibrate(&cameras, &WandOptions::new("0.13+0.26".parse().unwrap())).unwrap();
    let quality = rig.quality.as_ref().unwrap();
    eprintln!("{quality:#?}");
    eprintln!("{:#?}", rig.warnings);
    for table in &evidence.tables {
        eprintln!("{}\n{:?}", table.title, table.head);
        for row in &table.rows {
            eprintln!("{row:?}");
        }
    }
    for camera in &rig.cameras {
        eprintln!("{} {:?} {:?} {:?}", camera.name, camera.intrinsics, camera.pose.unwrap().centre(), camera.warnings);
    }
    for pass in &evidence.passes {
        let last = pass.steps.last().unwrap();
        eprintln!(
            "{}: {} steps, {:.3} s, cost {:.2}, rms {:.3}",
            pass.name,
            pass.steps.len(),
            last.seconds,
            last.cost,
            last.rms_px
        );
    }
}
