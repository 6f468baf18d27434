use std::{
    path::{Path, PathBuf},
    process::Command,
};

use erfgs_base::random;
use erfgs_calibrate::board::{BoardOptions, Corner, Target, calibrate, detect, look};
use erfgs_recordings::python;
use erfgs_scene::{Distortion, ImageRgb8, Intrinsics};
use glam::{DVec2, DVec3};
use serde_json::Value;

use super::scene::{Rays, Sheet, errors, light, photograph, summary};

fn target() -> Target {
    "aprilgrid:6x6:0.088:0.3".parse().unwrap()
}

fn sheet() -> Sheet {
    Sheet::of(&target(), 0.0088)
}

/// A camera with the distortion of a wide lens.
pub(super) fn camera() -> Intrinsics {
    Intrinsics {
        width: 640,
        height: 480,
        fx: 520.0,
        fy: 522.0,
        cx: 325.0,
        cy: 236.0,
        distortion: Distortion::BrownConrady([-0.28, 0.09, 0.0006, -0.0004, 0.0, 0.0, 0.0, 0.0]),
    }
}

#[test]
fn corners_are_exact_near_and_far_tilted_blurred_and_through_a_fisheye() {
    let fisheye = Intrinsics {
        fx: 260.0,
        fy: 260.0,
        distortion: Distortion::KannalaBrandt([0.02, -0.005, 0.001, 0.0]),
        ..camera()
    };
    let mut wrong = Vec::new();
    for (what, camera, place, turn, blur, least, most_rms) in [
        ("facing", camera(), DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO, 0.7, 144, 0.08),
        ("turned by a quarter", camera(), DVec3::new(0.02, 0.0, 1.1), DVec3::new(0.1, 0.2, 1.57), 0.7, 144, 0.08),
        ("upside down", camera(), DVec3::new(0.0, 0.03, 1.3), DVec3::new(0.1, 0.0, 3.1), 0.7, 144, 0.09),
        ("tilted by 55 degrees", camera(), DVec3::new(0.05, 0.0, 1.2), DVec3::new(0.2, 0.96, 0.1), 0.7, 130, 0.11),
        ("far, tags of 18 pixels", camera(), DVec3::new(0.1, 0.1, 2.5), DVec3::new(0.3, -0.3, 0.1), 0.5, 110, 0.14),
        ("out of focus", camera(), DVec3::new(0.0, 0.0, 1.0), DVec3::new(-0.3, 0.3, 0.0), 2.5, 138, 0.2),
        ("fisheye", fisheye, DVec3::new(0.05, 0.0, 0.5), DVec3::new(0.1, 0.4, 0.0), 0.7, 140, 0.08),
    ] {
        let sheet = sheet();
        let pose = sheet.pose(place, turn);
        let picture = photograph(&light::<5>(&sheet, &camera, &pose, blur), [640, 480], 3.0, 1);
        keep(&picture, what);
        let corners = detect(&picture, &target());
        let (rms, worst) = summary(&errors(&corners, &target(), &camera, &pose));
        println!("{what}: {} corners, {rms:.3} px rms, {worst:.2} at worst", corners.len());
        if corners.len() < least || rms > most_rms || worst > 0.8 {
            wrong.push(what);
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// For looking at: the pictures go where `ERFGS_KEEP` says.
fn keep(picture: &ImageRgb8, what: &str) {
    if let Some(folder) = std::env::var_os("ERFGS_KEEP") {
        picture.write_png(&PathBuf::from(folder).join(format!("{what}.png"))).unwrap();
    }
}

/// Corners that lie within the picture, by `margin` pixels.
fn within(camera: &Intrinsics, pose: &erfgs_scene::Pose, margin: f64) -> Vec<(u32, DVec2)> {
    let at = |id| Some((id, camera.project(pose.transform(target().point(id)?))?));
    let inside =
        |at: DVec2| at.cmpgt(DVec2::splat(margin)).all() && at.cmplt(DVec2::new(640.0 - margin, 480.0 - margin)).all();
    (0..144).filter_map(at).filter(|(_, at)| inside(*at)).collect()
}

#[test]
fn a_board_that_leaves_the_picture_or_is_covered_gives_what_is_left_of_it() {
    let (sheet, camera) = (sheet(), camera());
    for (case, place) in [DVec3::new(0.35, 0.25, 0.8), DVec3::new(-0.4, 0.1, 0.9)].into_iter().enumerate() {
        let pose = sheet.pose(place, DVec3::new(0.2, -0.3, 0.3));
        let mut picture = photograph(&light::<5>(&sheet, &camera, &pose, 0.7), [640, 480], 3.0, 2);
        // Three hands before it.
        let covers: Vec<[f64; 3]> = (0..3)
            .map(|n| {
                let draw = |of, from, to| random::range(random::key(5, &[case as u64, n, of]), from, to);
                [draw(0, 100.0, 540.0), draw(1, 80.0, 400.0), draw(2, 20.0, 50.0)]
            })
            .collect();
        let covered = |at: DVec2, by: f64| covers.iter().any(|[x, y, r]| at.distance(DVec2::new(*x, *y)) < r + by);
        for (index, pixel) in picture.data.chunks_exact_mut(3).enumerate() {
            if covered(DVec2::new((index % 640) as f64, (index / 640) as f64), 0.0) {
                pixel.fill(if index / 640 % 40 < 20 { 150 } else { 90 });
            }
        }
        keep(&picture, &format!("covered {case}"));
        let visible: Vec<_> = within(&camera, &pose, 8.0).into_iter().filter(|(_, at)| !covered(*at, 6.0)).collect();
        let corners = detect(&picture, &target());
        let (rms, worst) = summary(&errors(&corners, &target(), &camera, &pose));
        println!("{} of {} corners, {rms:.3} px rms, {worst:.2} at worst", corners.len(), visible.len());
        assert!(10 * corners.len() >= 9 * visible.len(), "{} of {}", corners.len(), visible.len());
        // A corner at the edge of a hand is pulled towards it.
        assert!(rms < 0.15 && worst < 1.5, "{rms} {worst}");
    }
}

#[test]
fn tags_that_contradict_their_neighbours_change_no_corner() {
    let (mut sheet, camera) = (sheet(), camera());
    // Tags 7, 14 and 22 say that they are 25, 2 and 31, and another 22 lies where 33 should.
    let width = 6 * 13 + 9;
    let code = |sheet: &Sheet, tag: usize| {
        let (x, y) = (6 + tag % 6 * 13, 6 + (5 - tag / 6) * 13);
        (0..100).map(|i| sheet.black[(y + i / 10) * width + x + i % 10]).collect::<Vec<_>>()
    };
    let codes: Vec<_> = [(7, 25), (14, 2), (22, 31), (33, 22)].map(|(at, tag)| (at, code(&sheet, tag))).into();
    for (at, code) in codes {
        let (x, y) = (6 + at % 6 * 13, 6 + (5 - at / 6) * 13);
        (0..100).for_each(|i| sheet.black[(y + i / 10) * width + x + i % 10] = code[i]);
    }
    let pose = sheet.pose(DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.4, 0.3, 0.2));
    let corners = detect(&photograph(&light::<5>(&sheet, &camera, &pose, 0.7), [640, 480], 3.0, 3), &target());
    let (rms, worst) = summary(&errors(&corners, &target(), &camera, &pose));
    println!("{} corners, {rms:.3} px rms, {worst:.2} at worst", corners.len());
    assert!(corners.len() >= 140 && worst < 0.3, "{} {worst}", corners.len());
}

#[test]
fn pictures_without_the_board_give_no_corner() {
    let camera = camera();
    let other: Target = "chessboard:9x6:0.03".parse().unwrap();
    let board = Sheet::of(&other, 0.03);
    let pose = board.pose(DVec3::new(0.0, 0.0, 0.5), DVec3::new(0.2, 0.3, 0.1));
    let picture = photograph(&light::<5>(&board, &camera, &pose, 0.7), [640, 480], 3.0, 4);
    assert_eq!(detect(&picture, &target()), []);
    assert_eq!(detect(&photograph(&vec![128.0; 640 * 480], [640, 480], 40.0, 5), &target()), []);
}

/// The tags that OpenCV finds in a picture: number, and corners from above left, clockwise, in OpenCV's convention.
fn opencv(picture: &Path, border: usize) -> Value {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(python())
        .arg(here.join("tests/it/boards/tags.py"))
        .arg(picture)
        .arg(border.to_string())
        .output()
        .unwrap();
    assert!(output.status.success(), "OpenCV failed:\n{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn opencv_reads_the_tags_that_are_printed_where_and_as_kalibr_has_them() {
    let sheet = sheet();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.png");
    let scale = 12;
    sheet.picture(scale).write_png(&path).unwrap();
    let tags = opencv(&path, 2);
    let tags = tags.as_array().unwrap();
    assert_eq!(tags.len(), 36);
    for tag in tags {
        let id = tag["id"].as_u64().unwrap() as u32;
        let first = id / 6 * 24 + id % 6 * 2;
        // OpenCV draws the family's tags upside down: what it calls above left is below right as Kalibr prints them.
        for (name, ours) in [first + 1, first, first + 12, first + 13].into_iter().enumerate() {
            let theirs: [f64; 2] = serde_json::from_value(tag["corners"][name].clone()).unwrap();
            let theirs = DVec2::from_array(theirs) + 0.5;
            let off = theirs.distance(sheet.in_picture(ours, scale));
            assert!(off < 2.0, "tag {id}, corner {name}: {off} px");
        }
    }
}

#[test]
fn a_camera_is_calibrated_from_pictures_within_its_standard_deviations() {
    let (sheet, truth) = (sheet(), camera());
    let rays = Rays::<5>::of(&truth);
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("left")).unwrap();
    for view in 0..14_u64 {
        let draw = |of, from, to| random::range(random::key(8, &[view, of]), from, to);
        let place = DVec3::new(draw(0, -0.25, 0.25), draw(1, -0.2, 0.2), draw(2, 0.8, 1.4));
        let turn = DVec3::new(draw(3, -0.7, 0.7), draw(4, -0.7, 0.7), draw(5, -0.4, 0.4));
        let picture = photograph(&rays.light(&sheet, &sheet.pose(place, turn), 0.7), [640, 480], 4.0, view);
        picture.write_png(&folder.path().join(format!("left/{view:02}.png"))).unwrap();
    }
    let seen = look(folder.path(), &target(), None, &|_, _| {}).unwrap();
    assert_eq!((seen[0].frames, seen[0].views.len()), (14, 14));
    let (rig, _) = calibrate(&seen, &target(), &BoardOptions::default(), &|_, _, _| {}).unwrap();
    let camera = &rig.cameras[0];
    println!(
        "rms {:.3} px, {} observations, {} left out",
        camera.rms_px.unwrap(),
        camera.observations,
        camera.outliers
    );
    assert!(camera.rms_px.unwrap() < 0.1, "{:?}", camera.rms_px);
    let sigma = &camera.sigma.as_ref().unwrap().intrinsics;
    let of = |i: &Intrinsics| {
        let Distortion::BrownConrady([k1, k2, p1, p2, ..]) = i.distortion else { panic!("{i:?}") };
        [("fx", i.fx), ("fy", i.fy), ("cx", i.cx), ("cy", i.cy), ("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2)]
    };
    let mut squares = 0.0;
    for ((name, found), (_, true_value)) in of(&camera.intrinsics).into_iter().zip(of(&truth)) {
        let sigma = sigma[name].unwrap();
        let off = (found - true_value) / sigma;
        println!("  {name}: {found:.5} ± {sigma:.5}, truth {true_value:.5}: {off:+.2}");
        assert!(off.abs() < 3.0, "{name} is off by {off} standard deviations");
        squares += off * off;
    }
    assert!(squares < 20.0, "chi squared {squares} of 8 parameters");
}

#[test]
fn corners_keep_their_numbers_when_the_picture_is_upside_down() {
    let sheet = sheet();
    let upright = sheet.picture(8);
    let mut turned = upright.clone();
    let pixels = turned.data.len() / 3;
    for index in 0..pixels {
        turned.data[3 * index..][..3].copy_from_slice(&upright.data[3 * (pixels - 1 - index)..][..3]);
    }
    let size = DVec2::new(f64::from(upright.width), f64::from(upright.height));
    let (a, b) = (detect(&upright, &target()), detect(&turned, &target()));
    assert_eq!((a.len(), b.len()), (144, 144));
    let far = |a: &Corner, b: &Corner| (a.id, (size - a.pixel).distance(b.pixel) < 0.2) == (b.id, true);
    assert!(a.iter().zip(&b).all(|(a, b)| far(a, b)));
}
