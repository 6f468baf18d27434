use super::*;
use crate::{Distortion, Intrinsics, exchange};

/// A file of one frame, whose keys these are beside its pose and name.
fn one(keys: &str) -> String {
    let matrix = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]";
    format!("{{\"frames\": [{{\"file_path\": \"images/a.png\", \"transform_matrix\": {matrix}, {keys}}}]}}")
}

fn read_rig(text: &str) -> Result<RigFile, ExchangeError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    std::fs::write(&path, text).unwrap();
    exchange::read(&path)
}

const SIZE: &str = "\"w\": 640, \"h\": 480, \"fl_x\": 500.0";

fn distortion(keys: &str) -> Distortion {
    read_rig(&one(&format!("{SIZE}, {keys}"))).unwrap().cameras[0].intrinsics.distortion
}

fn refused(keys: &str) -> String {
    read_rig(&one(keys)).unwrap_err().to_string()
}

#[test]
fn every_radial_coefficient_is_kept_or_refused() {
    let k3 = Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.0, 0.0, 0.0]);
    let keys = "\"k1\": -0.2, \"k2\": 0.05, \"p1\": 1e-3, \"p2\": -2e-3, \"k3\": 0.01";
    assert_eq!(distortion(keys), k3);
    for model in ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV"] {
        assert_eq!(distortion(&format!("\"camera_model\": \"{model}\", {keys}")), k3, "{model}");
        assert_eq!(distortion(&format!("\"camera_model\": \"{model}\"")), Distortion::None, "{model}");
    }
    let full = "\"camera_model\": \"FULL_OPENCV\", \"k1\": 1, \"k2\": 2, \"p1\": 7, \"p2\": 8, \"k3\": 3, \"k4\": 4, \"k5\": 5, \"k6\": 6";
    assert_eq!(distortion(full), Distortion::BrownConrady([1.0, 2.0, 7.0, 8.0, 3.0, 4.0, 5.0, 6.0]));
    for fisheye in ["\"camera_model\": \"OPENCV_FISHEYE\"", "\"is_fisheye\": true"] {
        let keys = format!("{fisheye}, \"k1\": 0.1, \"k2\": 0.2, \"k3\": 0.3, \"k4\": 0.4");
        assert_eq!(distortion(&keys), Distortion::KannalaBrandt([0.1, 0.2, 0.3, 0.4]));
        assert_eq!(distortion(fisheye), Distortion::KannalaBrandt([0.0; 4]), "no pinhole");
    }
    for (keys, expected) in [("\"k4\": 0.1", "without k4"), ("\"camera_model\": \"OPENCV\", \"k6\": 0.1", "a k5 or k6")]
    {
        let message = refused(&format!("{SIZE}, {keys}"));
        assert!(message.contains("a.png") && message.contains("OPENCV") && message.contains(expected), "{message}");
    }
    let message = refused(&format!("{SIZE}, \"camera_model\": \"OPENCV_FISHEYE\", \"p1\": 0.1"));
    assert!(message.contains("p1"), "{message}");
}

#[test]
fn a_fourth_radial_coefficient_becomes_a_rational_lens_that_shows_the_same() {
    let lens = distortion("\"k1\": -0.25, \"k2\": 0.07, \"k3\": -0.02, \"k4\": 0.003, \"p1\": 0.001");
    let i = Intrinsics { width: 640, height: 480, fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, distortion: lens };
    for (x, y) in [(0.0, 0.0), (0.3, -0.2), (0.64, 0.48), (-0.64, 0.48), (0.0, 0.5)] {
        let s = x * x + y * y;
        let radial = 1.0 + s * (-0.25 + s * (0.07 + s * (-0.02 + s * 0.003)));
        // p1 as OpenCV has it.
        let wanted = [x * radial + 2.0 * 0.001 * x * y, y * radial + 0.001 * (s + 2.0 * y * y)];
        let found = i.project(glam::DVec3::new(x, y, 1.0)).unwrap();
        let off = glam::DVec2::new(320.0 + 500.0 * wanted[0], 240.0 + 500.0 * wanted[1]).distance(found);
        assert!(off < 0.05, "{x} {y}: {off} px");
    }
}

#[test]
fn a_model_that_is_not_known_is_refused_by_name() {
    for model in ["EQUIRECTANGULAR", "FISHEYE624", "opencv"] {
        for coefficient in ["", ", \"k1\": 0.1"] {
            let message = refused(&format!("{SIZE}, \"camera_model\": \"{model}\"{coefficient}"));
            assert!(message.contains(model) && message.contains("a.png") && message.contains("undistort"), "{message}");
        }
    }
}

#[test]
fn numbers_that_no_camera_has_are_refused() {
    for (keys, expected) in [
        ("\"w\": 640, \"h\": 480, \"fl_x\": -500.0", "the focal length is"),
        ("\"w\": 640, \"h\": 480, \"fl_x\": NaN", "the focal length is"),
        ("\"w\": 640, \"h\": 480, \"fl_x\": Infinity", "the focal length is"),
        ("\"w\": 640, \"h\": 480, \"fl_x\": 500, \"fl_y\": 0", "the focal length is"),
        ("\"w\": 640, \"h\": 480, \"camera_angle_x\": 4.0", "field of view"),
        ("\"w\": 640, \"h\": 480, \"camera_angle_x\": 1e-320", "field of view"),
        ("\"w\": 0, \"h\": 480, \"fl_x\": 500", "a side of the picture"),
        ("\"w\": 1e30, \"h\": 480, \"fl_x\": 500", "a side of the picture"),
        ("\"w\": 640, \"h\": -480, \"fl_x\": 500", "a side of the picture"),
        ("\"w\": 640, \"h\": 480.5, \"fl_x\": 500", "a side of the picture"),
        ("\"w\": 640, \"fl_x\": 500", "w and h"),
        ("\"fl_x\": 500", "w and h"),
        ("\"w\": 640, \"h\": 480, \"fl_x\": 500, \"k1\": NaN", "not finite"),
        ("\"w\": 640, \"h\": 480, \"fl_x\": 500, \"cy\": -Infinity", "principal point"),
        ("\"w\": 640, \"h\": 480, \"fl_x\": 500, \"time\": NaN", "time"),
    ] {
        let message = refused(keys);
        assert!(message.contains("a.png") && message.contains(expected), "{keys}: {message}");
    }
    let sheared = one(SIZE).replace("[0, 1, 0, 0]", "[0, 2, 0, 0]");
    assert!(read_rig(&sheared).unwrap_err().to_string().contains("no rotation"));
    let projective = one(SIZE).replace("[0, 0, 0, 1]", "[0, 0, 0.5, 1]");
    assert!(read_rig(&projective).unwrap_err().to_string().contains("last row"));
    assert!(read_rig("{\"frames\": []}").unwrap_err().to_string().contains("no frames"));
    assert!(read_rig(&format!("{}1{}", "[".repeat(100_000), "]".repeat(100_000))).is_err());
}

#[test]
fn fields_of_view_give_both_focal_lengths() {
    let i = read_rig(&one("\"w\": 16, \"h\": 8, \"camera_angle_x\": 1.0, \"camera_angle_y\": 0.5")).unwrap().cameras[0]
        .intrinsics;
    assert!((i.fx - 8.0 / 0.5_f64.tan()).abs() < 1e-12 && (i.fy - 4.0 / 0.25_f64.tan()).abs() < 1e-12, "{i:?}");
    let i = read_rig(&one("\"w\": 16, \"h\": 8, \"camera_angle_x\": 1.0")).unwrap().cameras[0].intrinsics;
    assert_eq!((i.fy, i.cx, i.cy), (i.fx, 8.0, 4.0));
}

#[test]
fn what_is_left_out_is_said() {
    let text = one(&format!("{SIZE}, \"mask_path\": \"m.png\", \"time\": 0.5, \"sharpness\": 9"));
    let text =
        text.replacen('{', "{\"applied_scale\": 2, \"ply_file_path\": \"p.ply\", \"test_filenames\": [\"x\"], ", 1);
    let warnings = read_rig(&text).unwrap().warnings.join("\n");
    for word in ["mask_path", "applied_scale", "ply_file_path", "times", "test with", "left out: sharpness"] {
        assert!(warnings.contains(word), "{word}: {warnings}");
    }
    assert_eq!(read_rig(&one(SIZE)).unwrap().warnings.len(), 1, "the unit alone");
}

/// A file of frames `(file, place, time)`, and the rig that it is.
fn rig_of(frames: &[(&str, f64, Option<f64>)]) -> RigFile {
    let frames = frames.iter().map(|(file, place, time)| {
        let time = time.map_or(String::new(), |time| format!(", \"time\": {time}"));
        let matrix = format!("[[1, 0, 0, {place:?}], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]");
        format!("{{\"file_path\": \"{file}\", \"transform_matrix\": {matrix}{time}}}")
    });
    let frames = frames.collect::<Vec<_>>().join(", ");
    read_rig(&format!("{{{SIZE}, \"frames\": [{frames}]}}")).unwrap()
}

#[test]
fn frames_of_one_pose_are_one_camera_of_the_rig_and_a_camera_that_moves_is_told() {
    let names = |rig: &RigFile| rig.cameras.iter().map(|camera| camera.name.clone()).collect::<Vec<_>>();
    let [t0, t1] = [Some(0.0), Some(1.0)];
    let still = rig_of(&[("a/0.png", 0.0, t0), ("b/0.png", 1.0, t0), ("a/1.png", 0.0, t1), ("b/1.png", 1.0, t1)]);
    assert_eq!(names(&still), ["a", "b"]);
    // All in one folder: nothing but a number tells them apart.
    let mixed = rig_of(&[("0.png", 0.0, t0), ("1.png", 1.0, t0), ("2.png", 0.0, t1), ("3.png", 1.0, t1)]);
    assert_eq!(names(&mixed).iter().collect::<BTreeSet<_>>().len(), 2, "{:?}", names(&mixed));
    let alone = rig_of(&[("images/a.png", 0.0, None), ("images/b.png", 1.0, None)]);
    assert_eq!(names(&alone), ["a", "b"]);
    let moving = rig_of(&[("r/0.png", 0.0, t0), ("r/1.png", 0.5, Some(0.5)), ("r/2.png", 1.0, t1)]);
    assert_eq!(names(&moving), ["0", "1", "2"]);
    for (rig, moves) in [(still, false), (mixed, false), (alone, false), (moving, true)] {
        let warnings = rig.warnings.join("; ");
        assert_eq!(warnings.contains("a camera that moves"), moves, "{warnings}");
    }
}

#[test]
fn what_is_written_is_read_with_every_coefficient() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    let distortion = Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.0, 0.0, 0.0]);
    let intrinsics = Intrinsics { width: 640, height: 480, fx: 500.25, fy: 501.5, cx: 318.75, cy: 244.125, distortion };
    let pose = Pose::look_at(DVec3::new(0.3, 0.1, -2.0), DVec3::ZERO, DVec3::Y);
    let rig = RigFile::new("wand", true, vec![RigCamera::new("a", Modality::Rgb, intrinsics, Some(pose))]);
    exchange::write(&rig, exchange::Format::Nerfstudio, &path).unwrap();
    let of_all = || -> Option<String> {
        let file: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        file["camera_model"].as_str().map(str::to_owned)
    };
    assert_eq!(of_all().as_deref(), Some("OPENCV"), "where programs look for it that know one for all images");
    let read = Transforms::read(&path).unwrap();
    let frame = &read.frames[0];
    assert_eq!((frame.file.as_str(), frame.lens.size()), ("images/a.png", Some([640, 480])));
    assert_eq!(frame.lens.intrinsics([640, 480]), intrinsics);
    assert!((frame.pose.translation - pose.translation).length() < 1e-12 && read.notes.is_empty(), "{frame:?}");

    let mut two = rig.clone();
    let fisheye = Intrinsics { distortion: Distortion::KannalaBrandt([0.01, 0.0, 0.0, 0.0]), ..intrinsics };
    two.cameras.push(RigCamera::new("b", Modality::Rgb, fisheye, Some(pose)));
    exchange::write(&two, exchange::Format::Nerfstudio, &path).unwrap();
    assert_eq!(of_all(), None, "none fits all");
    assert_eq!(Transforms::read(&path).unwrap().frames[1].lens.intrinsics([640, 480]), fisheye);
}

/// A file with keys for all frames and one frame with its own.
fn both(file: &str, frame: &str) -> Result<Intrinsics, String> {
    let text = one(frame).replacen('{', &format!("{{{file}, "), 1);
    read_rig(&text).map(|rig| rig.cameras[0].intrinsics).map_err(|error| error.to_string())
}

/// Every way of telling a focal length in the frame comes before every way of it in the file.
#[test]
fn a_frames_own_intrinsics_come_before_the_files_whatever_they_are_told_by() {
    let (w, h) = (640.0_f64, 480.0_f64);
    let angle = |side: f64, focal: f64| 2.0 * (0.5 * side / focal).atan();
    let ways = |x: f64, y: f64| {
        [
            format!("\"fl_x\": {x}, \"fl_y\": {y}"),
            format!("\"camera_angle_x\": {}, \"camera_angle_y\": {}", angle(w, x), angle(h, y)),
            format!("\"camera_angle_x\": {}, \"fl_y\": {y}", angle(w, x)),
            format!(
                "\"fl_x\": {x}, \"fl_y\": {y}, \"camera_angle_x\": {}, \"camera_angle_y\": {}",
                angle(w, x),
                angle(h, y)
            ),
        ]
    };
    let rest = "\"w\": 640, \"h\": 480, \"cx\": 310, \"cy\": 250, \"k1\": 0.1, \"p1\": 0.01";
    for file in ways(500.0, 510.0) {
        let of_file = both(&format!("{rest}, {file}"), "\"time\": 0").unwrap();
        assert!((of_file.fx - 500.0).abs() < 1e-9 && (of_file.fy - 510.0).abs() < 1e-9, "{file}: {of_file:?}");
        for frame in ways(600.0, 620.0) {
            let i = both(&format!("{rest}, {file}"), &format!("{frame}, \"cx\": 300, \"k1\": -0.2")).unwrap();
            assert!((i.fx - 600.0).abs() < 1e-9 && (i.fy - 620.0).abs() < 1e-9, "{file} {frame}: {i:?}");
            assert_eq!((i.cx, i.cy), (300.0, 250.0));
            assert_eq!(i.distortion, Distortion::BrownConrady([-0.2, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0]));
        }
        // Of one axis alone, where the other is the file's.
        let i = both(&format!("{rest}, {file}"), "\"fl_y\": 620").unwrap();
        assert!((i.fx - 500.0).abs() < 1e-9 && i.fy == 620.0, "{file}: {i:?}");
        let i = both(&format!("{rest}, {file}"), &format!("\"camera_angle_y\": {}", angle(h, 620.0))).unwrap();
        assert!((i.fx - 500.0).abs() < 1e-9 && (i.fy - 620.0).abs() < 1e-9, "{file}: {i:?}");
    }
    // The file tells one axis: pixels of the frame are square.
    let square = both(&format!("{rest}, \"camera_angle_x\": 1.0"), "\"fl_x\": 600").unwrap();
    assert_eq!((square.fx, square.fy), (600.0, 600.0));
}

#[test]
fn a_frames_own_model_takes_no_coefficients_of_another() {
    let file = format!("{SIZE}, \"camera_model\": \"OPENCV\", \"k1\": 0.1, \"k2\": 0.2, \"p1\": 0.01");
    for fisheye in ["\"camera_model\": \"OPENCV_FISHEYE\"", "\"is_fisheye\": true"] {
        let own = both(&file, &format!("{fisheye}, \"k1\": 0.3")).unwrap();
        assert_eq!(own.distortion, Distortion::KannalaBrandt([0.3, 0.0, 0.0, 0.0]));
        let message = both(&file, fisheye).unwrap_err();
        assert!(
            message.contains("OPENCV_FISHEYE") && message.contains("k1 of the file") && message.contains("a.png"),
            "{message}"
        );
        let plain = both(&format!("{SIZE}, {fisheye}"), "\"camera_model\": \"OPENCV\"").unwrap();
        assert_eq!(plain.distortion, Distortion::None, "the frame is no fisheye, whatever the file is");
    }
    let same = both(&file, "\"camera_model\": \"OPENCV\", \"k1\": 0.3").unwrap();
    assert_eq!(same.distortion, Distortion::BrownConrady([0.3, 0.2, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0]));
}

#[test]
fn a_frame_of_another_size_takes_no_pixels_of_the_file() {
    let file = format!("{SIZE}, \"cx\": 310, \"cy\": 250");
    let message = both(&file, "\"w\": 320, \"h\": 240").unwrap_err();
    assert!(message.contains("fl_x, cx, cy") && message.contains("a.png"), "{message}");
    let i = both(&file, "\"w\": 320, \"h\": 240, \"fl_x\": 250, \"cx\": 155, \"cy\": 125").unwrap();
    assert_eq!((i.width, i.fx, i.fy, i.cx, i.cy), (320, 250.0, 250.0, 155.0, 125.0));
    // An angle holds for any size.
    let i = both("\"w\": 640, \"h\": 480, \"camera_angle_x\": 1.0", "\"w\": 320, \"h\": 240").unwrap();
    assert!((i.fx - 160.0 / 0.5_f64.tan()).abs() < 1e-9 && i.cx == 160.0);
}

#[test]
fn a_list_of_coefficients_is_taken_as_if_they_were_named() {
    let list = "\"distortion_params\": [-0.2, 0.05, 0.01, 0, 1e-3, -2e-3]";
    let named = "\"k1\": -0.2, \"k2\": 0.05, \"k3\": 0.01, \"k4\": 0, \"p1\": 1e-3, \"p2\": -2e-3";
    let lens = Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.0, 0.0, 0.0]);
    assert_eq!(distortion(list), lens);
    assert_eq!(distortion(&format!("{list}, {named}")), lens);
    // Of the file, and of the frame before it.
    let of_file = |frame: &str| one(frame).replacen('{', &format!("{{{list}, {SIZE}, "), 1);
    assert_eq!(read_rig(&of_file("\"time\": 0")).unwrap().cameras[0].intrinsics.distortion, lens);
    let straight = of_file("\"distortion_params\": [0, 0, 0, 0, 0, 0]");
    assert_eq!(read_rig(&straight).unwrap().cameras[0].intrinsics.distortion, Distortion::None);
    for (keys, expected) in [
        (format!("{list}, \"k1\": 0.3"), "k1 and distortion_params contradict"),
        ("\"distortion_params\": [0.1, 0.2]".into(), "has 2 numbers"),
        ("\"distortion_params\": [0.1, 0, 0, 0.1, 0, 0], \"camera_model\": \"OPENCV\"".into(), "k4"),
    ] {
        let message = refused(&format!("{SIZE}, {keys}"));
        assert!(message.contains("a.png") && message.contains(expected), "{message}");
    }
}
