//! Every number of a manifest, plausible and not.

use super::*;
use erfgs_base::plausible::Implausible;

type Set = fn(&mut Manifest, f64);

/// What it is called, what sets it, and the least and the greatest that a rig has: powers of ten, with a sign.
const NUMBERS: [(&str, Set, [f64; 2]); 14] = [
    ("the focal length", |m, v| m.cameras[0].intrinsics.fx = 8.0 * v, [-1.0, 4.0]),
    ("the focal length", |m, v| m.cameras[2].intrinsics.fy = 8.0 * v, [-1.0, 4.0]),
    ("the principal point", |m, v| m.cameras[0].intrinsics.cx = v, [-6.0, 4.0]),
    ("the principal point", |m, v| m.cameras[1].intrinsics.cy = -v, [-6.0, 4.0]),
    ("a distortion coefficient", |m, v| lens(m)[0] = v, [-9.0, 2.0]),
    ("a distortion coefficient", |m, v| lens(m)[7] = -v, [-9.0, 2.0]),
    ("a coordinate of a position", |m, v| m.cameras[2].world_to_camera.translation.y = v, [-7.0, 5.0]),
    ("a standard deviation of a place", |m, v| sigma(m).centre_m[1] = v, [-9.0, 2.0]),
    ("a standard deviation of a turn", |m, v| sigma(m).rotation_deg[2] = v, [-9.0, 2.5]),
    ("a standard deviation of a time", |m, v| m.cameras[0].clock_sigma_s = Some(v), [-9.0, 2.0]),
    ("a contrast threshold", |m, v| events(m).threshold_on = v, [-3.0, 0.5]),
    ("a contrast threshold", |m, v| events(m).threshold_off = v, [-3.0, 0.5]),
    ("the lin-log threshold", |m, v| events(m).lin_log_threshold = v, [0.1, 2.3]),
    (
        "the length of the rotation's quaternion",
        |m, v| m.cameras[1].world_to_camera.rotation = DQuat::IDENTITY * v,
        [0.0, 0.0],
    ),
];

fn lens(manifest: &mut Manifest) -> &mut [f64; 8] {
    let distortion = &mut manifest.cameras[0].intrinsics.distortion;
    *distortion = Distortion::BrownConrady([0.0; 8]);
    match distortion {
        Distortion::BrownConrady(k) => k,
        _ => unreachable!(),
    }
}

fn sigma(manifest: &mut Manifest) -> &mut PoseSigma {
    let zero = PoseSigma { centre_m: [0.0; 3], rotation_deg: [0.0; 3] };
    manifest.cameras[2].pose_sigma.insert(zero)
}

fn events(manifest: &mut Manifest) -> &mut CameraEvents {
    manifest.cameras[1].events.as_mut().unwrap()
}

/// A dataset whose manifest is changed and never read again.
struct Trial {
    _folder: tempfile::TempDir,
    dataset: Dataset,
}

impl Trial {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let dataset = some_dataset(folder.path());
        Self { _folder: folder, dataset }
    }

    fn after(&self, change: impl FnOnce(&mut Manifest)) -> Result<(), DatasetError> {
        let mut dataset = self.dataset.clone();
        change(&mut dataset.manifest);
        dataset.validate()
    }

    /// What is implausible after a change; the message names the manifest and is short.
    fn refused(&self, change: impl FnOnce(&mut Manifest)) -> Implausible {
        let error = self.after(change).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("dataset.json") && text.contains("plausible") && text.len() < 500, "{text}");
        let (DatasetError::Camera { problem, .. } | DatasetError::Manifest { problem, .. }) = error else {
            panic!("{text}")
        };
        match *problem {
            Problem::Implausible(wrong) | Problem::Frame { wrong, .. } | Problem::Sensor { wrong, .. } => wrong,
            other => panic!("{other}"),
        }
    }
}

#[test]
fn numbers_that_rigs_have_pass_and_others_are_named() {
    let trial = Trial::new();
    for (name, set, [least, most]) in NUMBERS {
        for step in 0..=16 {
            let value = 10.0_f64.powf(least + (most - least) * f64::from(step) / 16.0);
            let checked = trial.after(|manifest| set(manifest, value));
            assert!(checked.is_ok(), "{name} = {value}: {checked:?}");
        }
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, 1e150, -1e308, 9e18] {
            assert_eq!(trial.refused(|manifest| set(manifest, value)).quantity.name, name, "{value}");
        }
    }
    // What cannot be below zero, and what cannot be zero.
    for (name, set, _) in NUMBERS.into_iter().filter(|(name, ..)| name.starts_with("a standard")) {
        assert_eq!(trial.refused(|manifest| set(manifest, -1e-3)).quantity.name, name);
        assert!(trial.after(|manifest| set(manifest, 0.0)).is_ok());
    }
    for value in [0.0, -1.0] {
        for (name, set, _) in
            NUMBERS.into_iter().filter(|(name, ..)| name.contains("focal") || name.contains("threshold"))
        {
            assert_eq!(trial.refused(|manifest| set(manifest, value)).quantity.name, name);
        }
    }
    assert_eq!(
        trial.refused(|manifest| events(manifest).lin_log_threshold = 1.0).quantity.name,
        "the lin-log threshold"
    );
}

#[test]
fn sizes_that_no_sensor_has_are_refused_before_anything_is_made_of_them() {
    let trial = Trial::new();
    let sized = |size: [u32; 2]| {
        trial.refused(|manifest| {
            let intrinsics = &mut manifest.cameras[1].intrinsics;
            [intrinsics.width, intrinsics.height] = size;
            (intrinsics.fx, intrinsics.fy) = (7e4, 7e4);
        })
    };
    for size in [[65_535, 65_535], [u32::MAX, 1], [40_000, 40_000], [0, 6], [8, 0]] {
        let name = sized(size).quantity.name;
        assert!(name.contains("the picture"), "{size:?}: {name}");
    }
}

proptest! {
    #[test]
    fn exposures_of_minutes_and_spans_of_days_pass_and_others_do_not(
        exposure_s in (-6.0..1.7_f64).prop_map(|power| 10.0_f64.powf(power)),
        hours in 0.05..700.0_f64,
        since_s in -1e9..3e9_f64,
        nonsense in prop::sample::select(vec![i64::MIN, -9_007_199_254_740_992, -700_000_000_000, i64::MIN + 1]),
    ) {
        let trial = Trial::new();
        let start = (since_s * 1e9) as i64;
        let end = start + (hours * 3.6e12) as i64;
        let set = |m: &mut Manifest| {
            m.span_ns = [start, end];
            for camera in &mut m.cameras {
                for (at, frame) in camera.frames.iter_mut().enumerate() {
                    frame.t_ns = start + at as i64 * (exposure_s * 1e9) as i64;
                    frame.exposure_ns = [frame.t_ns - (exposure_s * 1e9) as i64, frame.t_ns];
                }
                if let Some(events) = &mut camera.events {
                    events.covers_ns = [start, end];
                }
            }
        };
        let checked = trial.after(set);
        prop_assert!(checked.is_ok(), "{:?}", checked);
        // An exposure of 104 days, and one from before all times.
        let long = trial.refused(|m| { set(m); m.cameras[0].frames[0].exposure_ns[0] = start.saturating_add(nonsense); });
        prop_assert!(long.quantity.name.contains("an exposure"), "{}", long);
        let before = trial.refused(|m| { set(m); m.cameras[0].frames[0].exposure_ns[0] = start - 61_000_000_000; });
        prop_assert!(before.quantity.name.contains("out of the recording"), "{}", before);
        let span = trial.refused(|m| { set(m); m.span_ns[0] = nonsense.saturating_sub(4_000_000_000_000_000_000); });
        prop_assert_eq!(span.quantity.name, "a time");
        let long = trial.refused(|m| { set(m); m.span_ns[1] = start + 3_000_000_000_000_000; });
        prop_assert_eq!(long.quantity.name, "the length of the recording");
        let covers = trial.refused(|m| { set(m); events(m).covers_ns[0] = i64::MIN; });
        prop_assert_eq!(covers.quantity.name, "a time");
        let covers = trial.refused(|m| { set(m); events(m).covers_ns[0] = start - 3_000_000_000_000_000; });
        prop_assert_eq!(covers.quantity.name, "the length of the recording");
    }
}

proptest! {
    #[test]
    fn exposures_that_overlap_are_named_but_where_blur_was_simulated(
        interval_ns in 50_000..1_000_000_000_i64,
        share in 0.0..5.0_f64,
        label in 0.0..=1.0_f64,
        camera in prop::sample::select(vec![0, 2_usize]),
    ) {
        let trial = Trial::new();
        // An exposure that is longer than the interval by a share of it.
        let length_ns = ((1.0 + share) * interval_ns as f64) as i64;
        let set = |m: &mut Manifest| {
            m.span_ns = [0, 4 * interval_ns];
            for (at, frame) in m.cameras[camera].frames.iter_mut().enumerate() {
                let open = at as i64 * interval_ns;
                frame.t_ns = open + (label * interval_ns as f64) as i64;
                frame.exposure_ns = [open, open + length_ns];
            }
            let other = &mut m.cameras[2 - camera].frames;
            *other = other.iter().map(|frame| Frame { t_ns: 0, exposure_ns: [0, 10], ..frame.clone() }).take(1).collect();
            m.cameras[1].events.as_mut().unwrap().covers_ns = m.span_ns;
        };
        if share < 0.099 {
            prop_assert!(trial.after(set).is_ok());
        } else if share > 0.101 {
            let wrong = trial.refused(set);
            prop_assert!(wrong.quantity.name.contains("overlap") && (wrong.value - share).abs() < 2e-3, "{}", wrong);
            let step = VariantStep { step: VariantStep::BLUR.into(), parameters: std::collections::BTreeMap::new() };
            let blurred = trial.after(|m| { set(m); m.variant.push(step); });
            prop_assert!(blurred.is_ok(), "{:?}", blurred);
        }
    }
}

#[test]
fn a_point_that_is_nowhere_is_named_with_its_file() {
    let trial = Trial::new();
    let path = trial.dataset.root.join(layout::POINTS);
    for (position, good) in [([1e6, -3.0, 0.0], true), ([0.0, 9e18, 0.0], false), ([0.0, 0.0, f32::MAX], false)] {
        PointCloud { positions: vec![position], colours: vec![[0; 3]] }.write(&path).unwrap();
        let read = trial.dataset.read_points();
        assert_eq!(read.is_ok(), good, "{position:?}");
        if let Err(error) = read {
            let text = error.to_string();
            assert!(text.contains("points.ply") && text.contains("point 0") && text.contains("plausible"), "{text}");
        }
    }
}
