//! Clear boards, which cameras see from either side.

use std::path::Path;

use erfgs_base::random;
use erfgs_calibrate::board::{BoardDetections, BoardError, BoardOptions, LensModel, Plate, Target, calibrate, look};
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::DVec3;

use super::scene::{Rays, Sheet, errors, photograph, summary};

const LENS: Intrinsics =
    Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 322.0, cy: 238.0, distortion: Distortion::None };
const INSTANTS: u64 = 6;
/// Two cameras before the board, and two behind it, degrees on a ring.
const ANGLES: [f64; 4] = [-25.0, 25.0, 155.0, 205.0];

fn target() -> Target {
    "aprilgrid:4x3:0.08:0.3".parse().unwrap()
}

fn place(angle: f64) -> Pose {
    let angle = angle.to_radians();
    Pose::look_at(DVec3::new(angle.sin(), -0.15, -angle.cos()) * 1.2, DVec3::ZERO, DVec3::Y)
}

/// How the board is held at an instant, in the world.
fn held(sheet: &Sheet, instant: u64) -> Pose {
    let vector = |of: u64, scale: f64| {
        let part = |axis| random::range(random::key(23, &[instant, of, axis]), -scale, scale);
        DVec3::new(part(0), part(1), part(2))
    };
    sheet.pose(vector(0, 0.08), vector(1, 0.5))
}

/// Pictures of the board by all cameras, each in a folder of its own.
fn film(folder: &Path) {
    let (sheet, rays) = (Sheet::of(&target(), 0.008), Rays::<2>::of(&LENS));
    for (number, angle) in (0..).zip(ANGLES) {
        for instant in 0..INSTANTS {
            let pose = held(&sheet, instant).then(&place(angle));
            let light = rays.light(&sheet, &pose, 0.7);
            let picture = photograph(&light, [LENS.width, LENS.height], 3.0, 100 * number + instant);
            picture.write_png(&folder.join(format!("cam{number}/{instant:02}.png"))).unwrap();
        }
    }
}

fn solve(seen: &[BoardDetections], plate: &Plate) -> Result<erfgs_scene::rig_file::RigFile, BoardError> {
    let known = (0..4).map(|number| (format!("cam{number}"), LENS)).collect();
    let options = BoardOptions { model: LensModel::Pinhole, known, ..BoardOptions::default() };
    calibrate(seen, plate, &options, &|_, _, _| {}).map(|(rig, _)| rig)
}

#[test]
fn a_clear_board_ties_cameras_on_either_side_and_is_named_where_nobody_said_that_it_is_clear() {
    let folder = tempfile::tempdir().unwrap();
    film(folder.path());
    let clear = Plate::clear(target()).unwrap();
    let seen = look(folder.path(), &clear, None, &|_, _| {}).unwrap();
    let sheet = Sheet::of(&target(), 0.008);
    for (seen, angle) in seen.iter().zip(ANGLES) {
        assert!(seen.views.len() >= 5, "{}: {} of {INSTANTS}", seen.camera, seen.views.len());
        assert_eq!(seen.source, folder.path().join(&seen.camera));
        for view in &seen.views {
            let pose = held(&sheet, view.instant.parse().unwrap()).then(&place(angle));
            let (rms, worst) = summary(&errors(&view.corners, &target(), &LENS, &pose));
            assert!(rms < 0.2 && worst < 1.0, "{} {}: {rms} px, {worst} at worst", seen.camera, view.instant);
        }
    }
    let rig = solve(&seen, &clear).unwrap();
    let world = place(ANGLES[0]);
    for (camera, angle) in rig.cameras.iter().zip(ANGLES) {
        let truth = world.inverse().then(&place(angle));
        let off = camera.pose.unwrap().centre().distance(truth.centre());
        assert!(off < 3e-3, "{}: {off} m", camera.name);
    }

    // The same pictures of a board that is not known to be clear: what is before it is seen, and what is behind it named.
    let opaque: Plate = (&target()).into();
    let seen = look(folder.path(), &opaque, None, &|_, _| {}).unwrap();
    assert!(seen[..2].iter().all(|seen| seen.views.len() >= 5 && seen.mirror_hint(&opaque).is_none()));
    for seen in &seen[2..] {
        let [found, tried] = seen.mirrored;
        assert!(
            seen.views.is_empty() && tried == INSTANTS as usize && found >= 5,
            "{}: {found} of {tried}",
            seen.camera
        );
        let message = solve(std::slice::from_ref(seen), &opaque).unwrap_err().to_string();
        for word in ["0 of 6 frames", "--clear", &format!("{found} of {tried}"), &seen.camera, "mirror"] {
            assert!(message.contains(word), "{word}: {message}");
        }
    }
}

#[test]
fn a_chessboard_does_not_tell_from_which_side_it_is_seen() {
    let message = Plate::clear("chessboard:9x6:0.025".parse().unwrap()).unwrap_err().to_string();
    assert!(message.contains("chessboard:9x6:0.025 has no markers"), "{message}");
}
