//! Cameras placed by wand in a rig that is calibrated already and stays as it is.

use erfgs_calibrate::wand::{KnownRig, Scale, WandCamera, WandError, WandOptions, calibrate};
use erfgs_scene::rig_file::{RigCamera, RigFile, Sigma};
use erfgs_scene::{Modality, Pose};

use crate::wand::rig::{self, Station};

/// The RGB cameras of the mixed rig where they are, made larger by `factor`, and one more that sees no wand.
fn known_rig_of(stations: &[Station], cameras: &[WandCamera], factor: f64) -> RigFile {
    let entry = |(station, camera): (&Station, &WandCamera)| {
        let pose = Pose { translation: station.pose.translation * factor, ..station.pose };
        let mut entry = RigCamera::new(&camera.name, station.modality, station.intrinsics, Some(pose));
        entry.sigma = Some(Sigma { centre_m: [Some(1e-3 * factor); 3], ..Sigma::default() });
        entry
    };
    let frames = stations.iter().zip(cameras).filter(|(station, _)| station.modality == Modality::Rgb);
    let mut entries: Vec<RigCamera> = frames.map(entry).collect();
    entries.push(RigCamera { name: "elsewhere".into(), ..entries[0].clone() });
    entries.push(RigCamera { name: "without-pose".into(), pose: None, ..entries[0].clone() });
    RigFile::new("sfm", true, entries)
}

/// Distances of the event cameras from where they are, millimetres, and the turns, degrees; nothing is aligned.
fn errors(found: &RigFile, stations: &[Station]) -> Vec<(f64, f64)> {
    let event = |(index, station): (usize, &Station)| {
        let pose = found.camera(&format!("event{index}"))?.pose?;
        let turn = (pose.rotation * station.pose.rotation.conjugate()).to_scaled_axis().length();
        Some((1e3 * pose.centre().distance(station.pose.centre()), turn.to_degrees()))
    };
    stations.iter().enumerate().filter_map(event).collect()
}

#[test]
fn event_cameras_are_placed_in_the_frame_of_a_rig_that_stays() {
    let stations = rig::mixed();
    let mut cameras = rig::observe(&stations, &rig::wands(200, 1), 1, |_, _| true);
    let known = known_rig_of(&stations, &cameras, 1.0);
    // The rig's intrinsics count for its cameras; the event cameras' focal lengths are found.
    rig::spoil_focal(&mut cameras, 0.002, 1);
    let options = WandOptions { known: Some(KnownRig::new(known.clone())), ..rig::options() };
    let (found, evidence) = calibrate(&cameras, &options).unwrap();
    let errors = errors(&found, &stations);
    assert_eq!(errors.len(), 6);
    assert!(errors.iter().all(|(mm, deg)| *mm < 2.5 && *deg < 0.02), "{errors:?}");
    for camera in known.cameras.iter().filter(|camera| camera.pose.is_some()) {
        let after = found.camera(&camera.name).unwrap();
        assert_eq!((after.pose, after.intrinsics), (camera.pose, camera.intrinsics), "{}", camera.name);
        assert_eq!(after.sigma.as_ref().unwrap().centre_m, camera.sigma.as_ref().unwrap().centre_m);
        assert!(after.warnings.is_empty(), "{:?}", after.warnings);
    }
    assert_eq!(found.cameras.len(), 15, "14 and the one that saw nothing, without the one that has no pose");
    let quality = found.quality.as_ref().unwrap();
    assert!((quality.measures["rig_length_over_wand"] - 1.0).abs() < 2e-4, "{:?}", quality.measures);
    assert!((quality.variance_factor - 1.0).abs() < 0.06, "{}", quality.variance_factor);
    assert!(evidence.held_out.len() > 100);
    // Their standard deviations are those within the rig.
    let event = found.camera("event1").unwrap();
    let sigma_mm = 1e3 * event.sigma.as_ref().unwrap().centre_m[2].unwrap();
    assert!((0.05..1.5).contains(&sigma_mm), "{sigma_mm}");
}

#[test]
fn a_rig_without_scale_gets_the_wands_and_a_metric_rig_keeps_its_own() {
    let stations = rig::mixed();
    let cameras = rig::observe(&stations, &rig::wands(150, 2), 2, |_, _| true);
    let mut known = known_rig_of(&stations, &cameras, 3.7);
    known.metric = false;
    let options = WandOptions { known: Some(KnownRig::new(known.clone())), ..rig::options() };
    let (found, _) = calibrate(&cameras, &options).unwrap();
    assert!(found.metric);
    let seen = errors(&found, &stations);
    assert!(seen.iter().all(|(mm, deg)| *mm < 2.5 && *deg < 0.02), "{seen:?}");
    let kept = found.camera("elsewhere").unwrap();
    assert!(kept.pose.unwrap().centre().distance(stations[0].pose.centre()) < 1e-3, "made smaller with the others");
    assert!((kept.sigma.as_ref().unwrap().centre_m[0].unwrap() - 1e-3).abs() < 1e-6);

    // A rig that is 1 % too large and says that it is metric: its lengths hold, and the difference is told.
    let large = known_rig_of(&stations, &cameras, 1.01);
    let options = WandOptions { known: Some(KnownRig::new(large.clone())), ..rig::options() };
    let (found, _) = calibrate(&cameras, &options).unwrap();
    assert!(
        found.warnings.iter().any(|warning| warning.contains("+1.0") && warning.contains("gaps")),
        "{:?}",
        found.warnings
    );
    let larger: Vec<Station> = stations
        .iter()
        .map(|station| Station {
            pose: Pose { translation: station.pose.translation * 1.01, ..station.pose },
            ..station.clone()
        })
        .collect();
    assert!(errors(&found, &larger).iter().all(|(mm, _)| *mm < 2.5), "{:?}", errors(&found, &larger));
    // Or the wand's, where it is asked for.
    let options = WandOptions { known: Some(KnownRig { rig: large, scale: Scale::Wand }), ..rig::options() };
    let (found, _) = calibrate(&cameras, &options).unwrap();
    assert!(errors(&found, &stations).iter().all(|(mm, _)| *mm < 2.5), "{:?}", errors(&found, &stations));
}

#[test]
fn a_kept_camera_that_was_moved_is_named() {
    let stations = rig::mixed();
    let cameras = rig::observe(&stations, &rig::wands(150, 3), 3, |_, _| true);
    let mut known = known_rig_of(&stations, &cameras, 1.0);
    let moved = known.cameras[3].pose.as_mut().unwrap();
    moved.translation.x += 0.05;
    let name = known.cameras[3].name.clone();
    let options = WandOptions { known: Some(KnownRig::new(known)), ..rig::options() };
    let (found, _) = calibrate(&cameras, &options).unwrap();
    for camera in &found.cameras {
        let warned = camera.warnings.iter().any(|warning| warning.contains("has it been moved?"));
        assert_eq!(warned, camera.name == name, "{}: {:?}", camera.name, camera.warnings);
    }
    assert!(errors(&found, &stations).iter().all(|(mm, _)| *mm < 4.0), "{:?}", errors(&found, &stations));
}

#[test]
fn a_frame_that_cannot_hold_is_refused() {
    let stations = rig::mixed();
    let cameras = rig::observe(&stations, &rig::wands(60, 4), 4, |_, _| true);
    let known = known_rig_of(&stations, &cameras, 1.0);
    let refused = |cameras: &[WandCamera], rig: KnownRig| {
        calibrate(cameras, &WandOptions { known: Some(rig), ..rig::options() }).map(|_| ()).unwrap_err()
    };
    let mut strange = known.clone();
    strange.cameras.iter_mut().for_each(|camera| camera.name.push('x'));
    let error = refused(&cameras, KnownRig::new(strange));
    assert!(matches!(&error, WandError::NoneKept { cameras } if cameras.len() == 14), "{error}");
    let frames: Vec<WandCamera> = cameras.iter().filter(|c| c.name.starts_with("rgb")).cloned().collect();
    assert!(refused(&frames, KnownRig::new(known.clone())).to_string().contains("have a pose in the rig"));
    let without = RigFile { metric: false, ..known };
    let error = refused(&cameras, KnownRig { rig: without.clone(), scale: Scale::Rig });
    assert!(error.to_string().contains("--scale-from wand"), "{error}");
    // Two cameras of it that never see the wand together tell no scale.
    let two = |camera: usize, wand: usize| {
        (camera % 2 == 1 && camera != 13)
            || (camera == 0 && wand.is_multiple_of(2))
            || (camera == 2 && !wand.is_multiple_of(2))
    };
    let apart = rig::observe(&stations, &rig::wands(60, 4), 4, two);
    let error = refused(&apart, KnownRig::new(without));
    assert!(error.to_string().contains("scale"), "{error}");
}
