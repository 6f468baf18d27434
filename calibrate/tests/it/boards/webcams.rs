use std::{collections::BTreeMap, path::Path, sync::OnceLock};

use erfgs_calibrate::board::{BoardDetections, BoardOptions, BoardView, Corner, Target, calibrate, look};
use erfgs_recordings::shared;
use erfgs_scene::{
    Distortion, Intrinsics, Pose,
    rig_file::{RigFile, Sigma},
};
use glam::{DMat3, DVec2, DVec3};

use crate::halves::{differences, in_deviations};

/// The reference: intrinsics (OpenCV's pixel convention) and world-to-camera poses.
fn reference(file: &Path) -> BTreeMap<String, (Intrinsics, Pose)> {
    let table: toml::Table = std::fs::read_to_string(file).unwrap().parse().unwrap();
    let numbers = |value: &toml::Value| -> Vec<f64> { value.clone().try_into().unwrap() };
    let rows = |value: &toml::Value| -> Vec<f64> { value.as_array().unwrap().iter().flat_map(numbers).collect() };
    let camera = |(id, camera): (&String, &toml::Value)| {
        let (m, d) = (rows(&camera["matrix"]), numbers(&camera["distortions"]));
        let intrinsics = Intrinsics {
            width: 1280,
            height: 720,
            fx: m[0],
            fy: m[4],
            cx: m[2] + 0.5,
            cy: m[5] + 0.5,
            distortion: Distortion::BrownConrady([d[0], d[1], d[2], d[3], d[4], 0.0, 0.0, 0.0]),
        };
        let rotation = DMat3::from_cols_slice(&rows(&camera["rotation"])).transpose();
        let pose = Pose::from_matrix(rotation, DVec3::from_slice(&numbers(&camera["translation"])));
        (format!("cam_{id}"), (intrinsics, pose))
    };
    table["cameras"].as_table().unwrap().iter().map(camera).collect()
}

/// The corners that the reference was computed from, as views.
fn their_corners(file: &Path) -> Vec<BoardDetections> {
    let text = std::fs::read_to_string(file).unwrap();
    let mut views: BTreeMap<(String, u32), Vec<Corner>> = BTreeMap::new();
    for line in text.lines().skip(1) {
        // sync_index,cam_id,frame_index,frame_time,object_id,keypoint_id,img_loc_x,img_loc_y,...
        let cells: Vec<&str> = line.split(',').collect();
        let number = |index: usize| cells[index].parse::<f64>().unwrap();
        let pixel = DVec2::new(number(6) + 0.5, number(7) + 0.5);
        let view = views.entry((format!("cam_{}", cells[1]), cells[0].parse().unwrap())).or_default();
        view.push(Corner { id: cells[5].parse().unwrap(), pixel });
    }
    let mut cameras: BTreeMap<String, Vec<BoardView>> = BTreeMap::new();
    for ((camera, instant), corners) in views {
        let view = BoardView { instant: instant.to_string(), time_s: None, file: file.into(), frame: 0, corners };
        cameras.entry(camera).or_default().push(view);
    }
    let seen = |(camera, views): (String, Vec<BoardView>)| BoardDetections {
        camera,
        events: false,
        size: [1280, 720],
        frames: 57,
        views,
        ..BoardDetections::default()
    };
    cameras.into_iter().map(seen).collect()
}

/// The board, and the videos in which it was found, by whichever test comes first.
fn watched(source: &Path) -> &'static (Target, Vec<BoardDetections>) {
    static WATCHED: OnceLock<(Target, Vec<BoardDetections>)> = OnceLock::new();
    WATCHED.get_or_init(|| {
        let target: Target = "charuco:4x5:0.054:0.0405:DICT_4X4_1000:inverted".parse().unwrap();
        let videos = look(&source.join("calibration/extrinsic"), &target, None, &|_, _| {}).unwrap();
        (target, videos)
    })
}

#[test]
fn four_free_running_webcams_and_a_waved_board() {
    let Some(source) = shared("data/caliscope_sessions/post_optimization") else { return };
    let (target, videos) = watched(&source);
    // Of the camera that sees the board most from the side 277 corners were found before, and OpenCV finds 425.
    let least = [(50, 670), (40, 530), (45, 630), (34, 390)];
    for (seen, (views, least)) in videos.iter().zip(least) {
        let corners: usize = seen.views.iter().map(|view| view.corners.len()).sum();
        println!("{}: {} views, {corners} corners", seen.camera, seen.views.len());
        assert!(seen.views.len() >= views && corners >= least, "{}: {} views", seen.camera, seen.views.len());
    }
    let mut untimed = videos.clone();
    untimed.iter_mut().flat_map(|seen| &mut seen.views).for_each(|view| view.time_s = None);
    let reference = reference(&source.join("camera_array.toml"));
    let known = reference.iter().map(|(name, (intrinsics, _))| (name.clone(), *intrinsics)).collect();
    let plain = BoardOptions { known, ..BoardOptions::default() };
    let timed = BoardOptions { time_offsets: true, ..plain.clone() };
    let theirs = their_corners(&source.join("calibration/extrinsic/xy.csv"));
    let (mut rms, mut out) = (Vec::new(), Vec::new());
    for (what, seen, options, most_mm, most_deg) in [
        ("the reference's corners", &theirs, &plain, 12.0, 1.0),
        ("our corners", &untimed, &plain, 14.0, 0.8),
        // The webcams deliver their frames up to a tenth of a second apart; the reference takes them for simultaneous.
        ("our corners, time offsets estimated", videos, &timed, 20.0, 1.0),
    ] {
        let (rig, _) = calibrate(seen, target, options, &|_, _, _| {}).unwrap();
        let world = reference["cam_0"].1;
        rms.push(rig.quality.as_ref().unwrap().rms_px);
        out.push(rig.cameras.iter().map(|camera| camera.outliers).sum::<usize>());
        if options.time_offsets {
            assert_offsets(&rig);
        }
        println!("{what}: rms {:.3} px", rms[rms.len() - 1]);
        for camera in &rig.cameras {
            let (_, pose) = reference[&camera.name];
            // Both with the first camera as the world.
            let centre = world.transform(pose.centre());
            let rotation = pose.rotation * world.rotation.conjugate();
            let found = camera.pose.unwrap();
            let off = (found.centre() - centre).length() * 1e3;
            let turned = found.rotation.angle_between(rotation).to_degrees();
            println!(
                "  {}: {off:.2} mm of {:.0}, {turned:.3} deg, rms {:.3} px, {} corners, {} left out, offset {:.1} ms",
                camera.name,
                centre.length() * 1e3,
                camera.rms_px.unwrap(),
                camera.observations,
                camera.outliers,
                camera.time_offset_s * 1e3,
            );
            assert!(off < most_mm && turned < most_deg, "{}: {off} mm, {turned} deg", camera.name);
        }
    }
    // Corners that contradicted the others take part, and less is left over all the same.
    assert!(rms[2] < 0.9 * rms[1] && out[2] < 60 && out[1] > 100, "time offsets explain what is left: {rms:?} {out:?}");
}

/// What an independent fit of the board's path gives, milliseconds, and what the frames' own scatter leaves open of it.
const OFFSETS_MS: [[f64; 2]; 4] = [[0.0, 1e-6], [-105.0, 20.0], [33.0, 15.0], [27.0, 15.0]];

fn assert_offsets(rig: &RigFile) {
    for (camera, [offset_ms, open_ms]) in rig.cameras.iter().zip(OFFSETS_MS) {
        let found_ms = 1e3 * camera.time_offset_s;
        assert!((found_ms - offset_ms).abs() < open_ms, "{}: {found_ms} ms, and not {offset_ms}", camera.name);
    }
}

#[test]
fn without_lenses_the_same_recording_makes_a_rig_since_offsets_are_tried_by_themselves() {
    let Some(source) = shared("data/caliscope_sessions/post_optimization") else { return };
    let (target, videos) = watched(&source);
    let (rig, _) = calibrate(videos, target, &BoardOptions::default(), &|_, _, _| {}).unwrap();
    println!("{:#?}", rig.warnings);
    assert!(rig.warnings.iter().any(|warning| warning.contains("do not run together")), "{:?}", rig.warnings);
    assert_offsets(&rig);
    let reference = reference(&source.join("camera_array.toml"));
    for camera in &rig.cameras {
        let (theirs, sigma) = (reference[&camera.name].0.fx, camera.sigma.as_ref().unwrap().intrinsics["fx"].unwrap());
        println!("{}: fx {:.0} ± {sigma:.0} px, the reference's {theirs:.0}", camera.name, camera.intrinsics.fx);
        assert!((camera.intrinsics.fx - theirs).abs() < 0.05 * theirs, "{}", camera.name);
    }
}

#[test]
fn parts_of_a_recording_by_free_running_webcams_agree_within_their_deviations() {
    let Some(source) = shared("data/caliscope_sessions/post_optimization") else { return };
    let (target, videos) = watched(&source);
    let reference = reference(&source.join("camera_array.toml"));
    let known = reference.iter().map(|(name, (intrinsics, _))| (name.clone(), *intrinsics)).collect();
    let options = BoardOptions { known, time_offsets: true, ..BoardOptions::default() };
    let of = |wanted: &dyn Fn(usize) -> bool| {
        let part = |seen: &BoardDetections| {
            let views = seen.views.iter().filter(|view| wanted(view.instant.parse().unwrap()));
            BoardDetections { views: views.cloned().collect(), ..seen.clone() }
        };
        let part: Vec<BoardDetections> = videos.iter().map(part).collect();
        calibrate(&part, target, &options, &|_, _, _| {}).unwrap().0
    };
    // Of instants 35 to 91, every other; every other of 8 and of 4 stretches; the first half and the second. In these the board was
    // held elsewhere, so that what the given lenses leave over is not the same: no part of the one tells of it.
    for (stretches, limit) in [(58, 1.5), (8, 1.5), (4, 1.5), (2, 2.5)] {
        let [one, other] = [0, 1].map(|odd| of(&|instant| (instant - 35) * stretches / 58 % 2 == odd));
        let [rms, _] = in_deviations(&format!("every other of {stretches}"), &differences(&one, &other));
        assert!(rms < limit, "{stretches}: {rms}");
    }
    let (whole, world) = (of(&|_| true), reference["cam_0"].1);
    let mut theirs = whole.clone();
    for camera in &mut theirs.cameras {
        // With the first camera as the world, and no deviations of its own.
        let pose = reference[&camera.name].1;
        let rotation = pose.rotation * world.rotation.conjugate();
        camera.pose = Some(Pose { rotation, translation: pose.translation - rotation * world.translation });
        camera.sigma = Some(Sigma { centre_m: [Some(0.0); 3], rotation_deg: [Some(0.0); 3], ..Sigma::default() });
    }
    in_deviations("the reference, which has no time offsets", &differences(&whole, &theirs));
}
