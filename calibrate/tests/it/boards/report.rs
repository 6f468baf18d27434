use erfgs_calibrate::{
    board::{BoardOptions, calibrate, look, look_session, pictures},
    report::{page, telling},
};
use erfgs_session::container::Session;

use super::{
    chessboards::{folder, target},
    session::record,
};

/// The two numbers before and after a word, wherever it stands in the page.
fn bends(page: &str) -> Vec<[f64; 2]> {
    page.split("straight lines by ")
        .skip(1)
        .map(|text| {
            let words: Vec<&str> = text.split([' ', ',']).collect();
            [words[0], words[4]].map(|word| word.parse().unwrap())
        })
        .collect()
}

#[test]
fn the_report_shows_pictures_that_are_straight_without_distortion_and_points_on_their_lines() {
    let seen = look(&folder(), &target(), None, &|_, _| {}).unwrap();
    let (rig, mut evidence) = calibrate(&seen, &target(), &BoardOptions::default(), &|_, _, _| {}).unwrap();
    let wanted = telling(&rig, &evidence);
    assert_eq!((wanted.len(), wanted[0].1), (2, wanted[1].1), "both at one instant");
    evidence.pictures = pictures(&seen, &target(), None, &evidence, &wanted, None).unwrap();
    assert!(evidence.pictures.iter().all(|picture| picture.found.len() == 54));
    let page = page(&rig, &evidence);
    assert_eq!(page.matches("data:image/jpeg").count(), 4, "each as it is and undistorted");
    assert_eq!(page.matches("<use href=\"#picture-").count(), 2);
    assert!(page.contains("left → right") && page.len() < 1_000_000, "{} bytes", page.len());
    let bends = bends(&page);
    assert_eq!(bends.len(), 2);
    for [before, after] in bends {
        assert!(before > 0.5 && after < 0.3 * before, "{before} {after}");
    }
}

#[test]
fn the_report_of_a_session_shows_its_frames() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("s.mcap");
    record(&path);
    let seen = look_session(&mut Session::open(&path).unwrap(), &target(), None, None, &|_, _| {}).unwrap();
    let (rig, evidence) = calibrate(&seen, &target(), &BoardOptions::default(), &|_, _, _| {}).unwrap();
    let wanted = telling(&rig, &evidence);
    let of_session = pictures(&seen, &target(), None, &evidence, &wanted, None).unwrap();
    assert_eq!(of_session.iter().map(|picture| picture.camera).collect::<Vec<_>>(), [0, 1]);
    let files = look(&folder(), &target(), None, &|_, _| {}).unwrap();
    for picture in &of_session {
        // The JPEG file that was recorded as this packet.
        let moment = &evidence.moments[picture.placement.unwrap()].name;
        let view = seen[picture.camera].views.iter().find(|view| view.instant == *moment).unwrap();
        let file = &files[picture.camera].views[view.frame as usize].file;
        assert_eq!(picture.image, erfgs_scene::ImageRgb8::read(file).unwrap());
    }
    std::fs::remove_file(&path).unwrap();
    let error = pictures(&seen, &target(), None, &evidence, &wanted, None).unwrap_err().to_string();
    assert!(error.contains("s.mcap"), "{error}");
}
