//! Units of files: what they say, what is given, and what can hardly be metres.

use std::path::{Path, PathBuf};

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::{Modality, Pose};

/// Cameras in a row, so far apart in metres.
fn rig(apart: f64) -> RigFile {
    let intrinsics =
        Intrinsics { width: 64, height: 48, fx: 50.0, fy: 51.0, cx: 32.5, cy: 24.0, distortion: Distortion::None };
    let camera = |at: u32| {
        let pose = Pose { translation: DVec3::new(apart * f64::from(at), 0.1, 0.0), ..Pose::IDENTITY };
        RigCamera::new(&format!("cam_{at}"), Modality::Rgb, intrinsics, Some(pose))
    };
    RigFile::new("board", true, (0..3).map(camera).collect())
}

const FORMATS: [(Format, &str); 4] = [
    (Format::Kalibr, "camchain.yaml"),
    (Format::OpenCv, "opencv"),
    (Format::Caliscope, "camera_array.toml"),
    (Format::Pose2sim, "Calib.toml"),
];

/// The rig in files of a format whose lengths are in `unit`, which they say where `says` is true.
fn written(folder: &Path, (format, name): (Format, &str), rig: &RigFile, unit: Unit, says: bool) -> PathBuf {
    let out = folder.join(name);
    let mut rig = rig.clone();
    rig.scale(1.0 / unit.metres());
    write(&rig, format, &out).unwrap();
    let files: Vec<PathBuf> = match out.is_dir() {
        true => std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect(),
        false => vec![out.clone()],
    };
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let silent: String =
            text.lines().filter(|line| !line.starts_with("unit")).map(|line| format!("{line}\n")).collect();
        let line = match (says, format) {
            (false, _) => String::new(),
            (true, Format::Kalibr | Format::OpenCv) => format!("unit: {unit}\n"),
            (true, _) => format!("[metadata]\nunits = \"{unit}\"\n"),
        };
        // A table of TOML begins once.
        let silent = if says { silent.replace("[metadata]\nadjusted = false\nerror = 0.0\n", "") } else { silent };
        std::fs::write(&file, silent + &line).unwrap();
    }
    out
}

fn span(rig: &RigFile) -> f64 {
    (rig.cameras[2].pose.unwrap().centre() - rig.cameras[0].pose.unwrap().centre()).length()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn lengths_become_metres_or_are_refused_with_what_was_seen(
        apart in 0.05..8.0_f64,
        unit in prop::sample::select(vec![Unit::Metre, Unit::Centimetre, Unit::Millimetre, Unit::Inch]),
        format in prop::sample::select(FORMATS.to_vec()),
        says in any::<bool>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let out = written(folder.path(), format, &rig(apart), unit, says);
        let given = read_in(&out, Some(unit)).unwrap();
        prop_assert!(given.metric && (span(&given) - 2.0 * apart).abs() < 1e-9 * apart.max(1.0));
        let found = read(&out);
        if says {
            prop_assert_eq!(found.unwrap(), given);
            let other = if unit == Unit::Metre { Unit::Millimetre } else { Unit::Metre };
            prop_assert!(read_in(&out, Some(other)).unwrap_err().to_string().contains("it says that its unit is"));
            return Ok(());
        }
        let as_metres = 2.0 * apart / unit.metres();
        match found {
            // Formats that do not fix a unit say that metres were taken.
            Ok(found) => {
                prop_assert!(as_metres <= 20.0 + 1e-9 && (span(&found) - as_metres).abs() < 1e-6);
                let is_warned = found.warnings.iter().any(|warning| warning.contains("--units") && warning.contains(&format!("{as_metres:.3} m")));
                prop_assert_eq!(is_warned, matches!(format.0, Format::OpenCv | Format::Pose2sim), "{:?}", found.warnings);
            }
            Err(error) => {
                let message = error.to_string();
                prop_assert!(as_metres > 20.0 - 1e-9, "{message}");
                prop_assert!(message.contains(&format!("{as_metres:.3} m")) && message.contains("cam_0") && message.contains("cam_2"), "{message}");
                prop_assert!(message.contains(&format!("--units {unit}")), "{message}");
            }
        }
    }
}

#[test]
fn a_camera_431_metres_away_and_units_that_contradict_each_other_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut one = rig(1.0);
    one.cameras.truncate(1);
    one.cameras[0].pose.as_mut().unwrap().translation = DVec3::new(0.0, 0.0, 0.431);
    let out = written(folder.path(), FORMATS[1], &one, Unit::Millimetre, false);
    let message = read(&out).unwrap_err().to_string();
    assert!(
        message.contains("431.000 m") && message.contains("the origin") && message.contains("--units mm (0.431 m)"),
        "{message}"
    );

    let out = written(folder.path(), FORMATS[1], &rig(1.0), Unit::Millimetre, true);
    let file = out.join("cam_1.yaml");
    let text = std::fs::read_to_string(&file).unwrap();
    for (to, expected) in
        [("unit: cm\n", "cam_1.yaml"), ("", "cam_1.yaml"), ("unit: furlong\n", "furlong"), ("units: 7\n", "no word")]
    {
        std::fs::write(&file, text.replace("unit: mm\n", to)).unwrap();
        let message = read(&out).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn formats_without_a_scale_and_our_own_take_the_unit_that_is_given() {
    let folder = tempfile::tempdir().unwrap();
    for (format, name) in
        [(Format::Colmap, "model"), (Format::Nerfstudio, "transforms.json"), (Format::Llff, "poses_bounds.npy")]
    {
        let out = folder.path().join(name);
        let mut rig = rig(0.5);
        rig.scale(1e3);
        write(&rig, format, &out).unwrap();
        assert!(!read(&out).unwrap().metric);
        let found = read_in(&out, Some(Unit::Millimetre)).unwrap();
        assert!(found.metric && (span(&found) - 1.0).abs() < 1e-9, "{format}");
    }
    let out = folder.path().join("rig.json");
    rig(0.5).write(&out).unwrap();
    assert!(read_in(&out, Some(Unit::Millimetre)).unwrap_err().to_string().contains("its unit is m"));
    assert_eq!(read_in(&out, Some(Unit::Metre)).unwrap(), rig(0.5));
}

/// caliscope's board has a unit, which is not that of the poses.
#[test]
fn the_unit_of_a_board_is_not_that_of_the_rig() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("config.toml");
    write(&rig(0.5), Format::Caliscope, &out).unwrap();
    let text = std::fs::read_to_string(&out).unwrap();
    std::fs::write(&out, text + "[charuco]\nunits = \"inch\"\n").unwrap();
    assert!((span(&read(&out).unwrap()) - 1.0).abs() < 1e-9);
}
