//! What cannot be solved is refused, and the refusal names what is missing.

use erfgs_calibrate::wand::{WandError, WandOptions, calibrate};
use glam::DVec3;

use crate::wand::rig;

#[test]
fn a_camera_that_saw_nothing_is_named_and_may_be_left_out() {
    let stations = rig::arc(4, 50.0, |_| false);
    let cameras = rig::observe(&stations, &rig::wands(40, 1), 1, |camera, _| camera != 2);
    let error = calibrate(&cameras, &rig::options()).unwrap_err();
    assert!(matches!(&error, WandError::Unseen { cameras } if cameras == &["rgb2"]), "{error}");
    assert!(error.to_string().starts_with("camera rgb2 never saw the wand"), "{error}");
    let options = WandOptions { without: vec!["rgb2".into()], ..rig::options() };
    let (found, _) = calibrate(&cameras, &options).unwrap();
    assert_eq!(found.cameras.len(), 3);
}

#[test]
fn groups_with_nothing_in_common_are_named() {
    let stations = rig::arc(6, 60.0, |i| i == 4);
    let cameras = rig::observe(&stations, &rig::wands(90, 2), 2, |camera, wand| (camera < 3) == (wand % 2 == 0));
    let error = calibrate(&cameras, &rig::options()).unwrap_err().to_string();
    assert!(error.contains("2 groups") && error.contains("[rgb0, rgb1, rgb2] and [rgb3, event4, rgb5]"), "{error}");
    assert!(error.contains("share is 0 placements"), "{error}");
}

#[test]
fn a_camera_with_too_few_placements_is_named() {
    let stations = rig::arc(4, 50.0, |_| false);
    let cameras = rig::observe(&stations, &rig::wands(60, 3), 3, |camera, wand| camera != 1 || wand < 3);
    let error = calibrate(&cameras, &rig::options()).unwrap_err();
    assert!(matches!(&error, WandError::TooFew { camera, found: 3, .. } if camera == "rgb1"), "{error}");
    // Cameras that never see it together.
    let cameras = rig::observe(&stations, &rig::wands(60, 3), 3, |camera, wand| camera == wand % 4);
    assert!(matches!(calibrate(&cameras, &rig::options()), Err(WandError::TooFew { found: 0, .. })));
}

#[test]
fn noise_instead_of_wands_is_refused() {
    let stations = rig::arc(3, 50.0, |_| false);
    let mut cameras = rig::observe(&stations, &rig::wands(60, 4), 4, |_, _| true);
    // What the second camera saw belongs to other instants.
    let count = cameras[1].sightings.len();
    for index in 0..count {
        cameras[1].sightings[index].leds = cameras[0].sightings[(index * 7 + 13) % count].leds;
    }
    let error = calibrate(&cameras, &rig::options()).unwrap_err().to_string();
    assert!(error.contains("[rgb0, rgb2] and [rgb1]"), "{error}");
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let stations = rig::arc(3, 50.0, |_| false);
    let cameras = rig::observe(&stations, &rig::wands(30, 5), 5, |_, _| true);
    let refused = |options: WandOptions| calibrate(&cameras, &options).unwrap_err().to_string();
    assert!(refused(WandOptions { hold_out: 1.0, ..rig::options() }).contains("held out"));
    assert!(refused(WandOptions { focal_sigma: 0.0, ..rig::options() }).contains("focal"));
    assert!(refused(WandOptions { without: vec!["x".into()], ..rig::options() }).contains("'x'"));
    assert!(refused(WandOptions { reference: Some("y".into()), ..rig::options() }).contains("'y'"));
    let all_but_one = vec!["rgb0".into(), "rgb2".into()];
    assert!(refused(WandOptions { without: all_but_one, ..rig::options() }).contains("only one"));
    assert!(matches!(calibrate(&[], &rig::options()), Err(WandError::TooFewCameras { cameras: 0 })));
}

#[test]
fn a_wand_that_rests_determines_nothing_and_the_camera_is_named() {
    let stations = rig::arc(4, 50.0, |_| false);
    let refused = |wands: &[(DVec3, DVec3)], sees: &dyn Fn(usize, usize) -> bool| {
        let error = calibrate(&rig::observe(&stations, wands, 1, sees), &rig::options()).unwrap_err();
        assert!(matches!(error, WandError::Open { .. }), "{error}");
        error.to_string()
    };
    let rest = rig::wands(1, 1)[0];
    // Noise alone would tell how the cameras are turned about the wand, to 8 degrees or so.
    let message = refused(&[rest; 60], &|_, _| true);
    assert!(message.contains("how rgb0 stands to the others"), "{message}");
    // Before one of them it rests, and is waved where the others alone see it.
    let wands = [rig::wands(60, 51), vec![rest; 60]].concat();
    let message = refused(&wands, &|camera, wand| camera != 3 || wand >= 60);
    assert!(
        message.contains("the pose of rgb3 (centre ±") && message.contains("wave the wand where that camera"),
        "{message}"
    );
    let message = refused(&wands, &|camera, wand| camera != 0 || wand >= 60);
    assert!(message.contains("how rgb0 stands to the others"), "{message}");
    // Along one line is not enough, either; in one plane, and about one point, is: `extreme.rs`.
    let line: Vec<_> = rig::wands(60, 1).iter().map(|(middle, _)| (DVec3::X * middle.x, DVec3::X)).collect();
    refused(&line, &|_, _| true);
}
