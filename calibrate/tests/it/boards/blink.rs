//! An event camera that looks at a board that blinks on a screen.

use erfgs_calibrate::{
    board::{EventBoard, LensModel, Target, detect, look, pictures, single},
    evidence::{Evidence, Moment},
};

#[path = "../common/blinking.rs"]
mod blinking;

#[test]
fn an_event_camera_is_calibrated_by_a_board_that_blinks() {
    let target: Target = "chessboard:8x5:0.03".parse().unwrap();
    let events = Some(EventBoard::Blinking { hz: 20.0 });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left.csv");
    std::fs::write(&path, "t,x,y,p\n0,1,1,1\n").unwrap();
    let seen = look(folder.path(), &target, events, &|_, _| {});
    // CSV does not say the sensor's size.
    assert!(seen.unwrap_err().to_string().contains("left.csv"));
    std::fs::remove_file(&path).unwrap();
    let raw = folder.path().join("left.raw");
    let mut file = b"% evt 2.0\n% format EVT2;height=240;width=320\n% end\n".to_vec();
    file.extend(blinking::as_evt2(&blinking::events([8, 5], 0.03, &blinking::camera())));
    std::fs::write(&raw, file).unwrap();
    let seen = look(folder.path(), &target, events, &|_, _| {}).unwrap();
    assert!(seen[0].events && seen[0].views.len() >= 7, "{} views", seen[0].views.len());
    // The picture for the report is the one that the board was found in.
    let view = &seen[0].views[3];
    let moment = Moment { name: view.instant.clone(), t_ns: None };
    let evidence = Evidence { moments: vec![moment], ..Evidence::default() };
    let shown = pictures(&seen, &target, events, &evidence, &[(0, 0)], None).unwrap();
    assert_eq!(detect(&shown[0].image, &target), view.corners);
    let found = single(&seen[0], &target, LensModel::Pinhole, true).unwrap();
    let i = found.bundle.cameras[0].intrinsics;
    assert!((i.fx - 300.0).abs() < 3.0 && (i.cx - 163.0).abs() < 3.0 && (i.cy - 118.0).abs() < 3.0, "{i:?}");
    assert!(found.bundle.rms_px(None).0 < 0.3, "{}", found.bundle.rms_px(None).0);
    let without = look(folder.path(), &target, Some(EventBoard::Blinking { hz: 31.0 }), &|_, _| {}).unwrap();
    assert!(without[0].views.is_empty(), "another rate is not the board's");
}
