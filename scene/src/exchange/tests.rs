use crate::{Modality, Pose};
use erfgs_base::npy::NpyArray;
use glam::DVec3;

use super::*;

fn rig(distortion: Distortion) -> RigFile {
    let intrinsics = Intrinsics { width: 640, height: 480, fx: 500.25, fy: 501.5, cx: 318.75, cy: 244.125, distortion };
    let camera = |name: &str, eye: DVec3| {
        RigCamera::new(name, Modality::Rgb, intrinsics, Some(Pose::look_at(eye, DVec3::ZERO, DVec3::Y)))
    };
    let mut cameras = vec![camera("a", DVec3::new(0.0, 0.1, -2.0)), camera("b", DVec3::new(1.5, -0.2, -1.0))];
    cameras.push(camera("c", DVec3::new(-1.5, 0.4, -1.2)));
    RigFile::new("wand", true, cameras)
}

/// What any format must keep: where a point of the world is seen.
fn same_pictures(a: &RigFile, b: &RigFile, tolerance: f64) {
    assert_eq!(a.cameras.len(), b.cameras.len());
    // A camchain's world is its first camera.
    let world = |rig: &RigFile, point: DVec3| rig.cameras[0].pose.unwrap().inverse().transform(point);
    for (one, other) in a.cameras.iter().zip(&b.cameras) {
        for point in [DVec3::new(0.1, 0.2, 2.0), DVec3::new(-0.3, -0.1, 1.7), DVec3::new(0.0, 0.3, 2.4)] {
            let see = |rig: &RigFile, camera: &RigCamera| {
                camera.intrinsics.project(camera.pose.unwrap().transform(world(rig, point))).unwrap()
            };
            let (left, right) = (see(a, one), see(b, other));
            assert!((left - right).length() < tolerance, "{}: {left} {right}", one.name);
        }
    }
}

#[test]
fn rigs_come_back_from_every_format_that_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let lenses = [
        Distortion::None,
        Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.0, 0.0, 0.0, 0.0]),
        Distortion::KannalaBrandt([0.05, -0.01, 1e-3, 0.0]),
    ];
    for distortion in lenses {
        let rig = rig(distortion);
        for (format, name) in [
            (Format::Colmap, "model"),
            (Format::Kalibr, "camchain.yaml"),
            (Format::OpenCv, "opencv"),
            (Format::Nerfstudio, "transforms.json"),
            (Format::Pose2sim, "Calib.toml"),
            (Format::Rig, "rig.json"),
        ] {
            let path = folder.path().join(name);
            write(&rig, format, &path).unwrap();
            let read = read(&path).unwrap();
            let names: Vec<&str> = read.cameras.iter().map(|camera| camera.name.as_str()).collect();
            assert_eq!(names, ["a", "b", "c"], "{format}");
            same_pictures(&rig, &read, 1e-8);
        }
    }
}

#[test]
fn ros_keeps_intrinsics_and_says_that_it_has_no_poses() {
    let folder = tempfile::tempdir().unwrap();
    for distortion in [
        Distortion::None,
        Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.0, 0.0, 0.0]),
        Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.1, 0.02, 1e-3]),
        Distortion::KannalaBrandt([0.05, -0.01, 1e-3, 2e-4]),
    ] {
        let (rig, path) = (rig(distortion), folder.path().join("camera_info"));
        let lost = write(&rig, Format::Ros, &path).unwrap().join("\n");
        assert!(lost.contains("no poses"), "{lost}");
        for found in [read(&path).unwrap(), read(&path.join("a.yaml")).unwrap()] {
            assert_eq!((found.method.as_str(), found.cameras[0].name.as_str()), ("ros", "a"));
            for (one, other) in found.cameras.iter().zip(&rig.cameras) {
                assert_eq!((one.intrinsics, one.pose), (other.intrinsics, None));
            }
        }
    }
}

/// As `camera_calibration` writes it: its own order, and a name that is not the file's.
#[test]
fn a_camera_info_of_others_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ost.yaml");
    let text = "image_width: 640\nimage_height: 480\ncamera_name: narrow_stereo\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: \
                [438.8, 0.0, 305.6, 0.0, 437.3, 243.7, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob\n\
                distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.36, 0.11, 0.001, -0.0002, 0.0]\n\
                rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n\
                projection_matrix:\n  rows: 3\n  cols: 4\n  data: [393.7, 0.0, 322.8, 0.0, 0.0, 393.0, 241.1, 0.0, 0.0, 0.0, \
                1.0, 0.0]\n";
    std::fs::write(&path, text).unwrap();
    let camera = read(&path).unwrap().cameras.remove(0);
    let i = camera.intrinsics;
    assert_eq!((camera.name.as_str(), i.width, i.height), ("ost", 640, 480));
    assert_eq!((i.fx, i.fy, i.cx, i.cy), (438.8, 437.3, 306.1, 244.2));
    assert_eq!(i.distortion, Distortion::BrownConrady([-0.36, 0.11, 0.001, -0.0002, 0.0, 0.0, 0.0, 0.0]));
    std::fs::write(&path, text.replace("plumb_bob", "thin_prism")).unwrap();
    let message = read(&path).unwrap_err().to_string();
    assert!(message.contains("ost.yaml") && message.contains("thin_prism"), "{message}");
}

#[test]
fn longer_polynomials_go_where_they_fit_and_are_refused_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.001, 0.0, 0.0]));
    for (format, name) in [(Format::Colmap, "model"), (Format::OpenCv, "opencv")] {
        let path = folder.path().join(name);
        write(&rig, format, &path).unwrap();
        same_pictures(&rig, &read(&path).unwrap(), 1e-8);
    }
    for format in [Format::Kalibr, Format::Nerfstudio] {
        let message = write(&rig, format, &folder.path().join("x")).unwrap_err().to_string();
        assert!(message.starts_with("camera a"), "{message}");
    }
}

/// A reader that drops the third radial coefficient shows points some pixels elsewhere.
#[test]
fn a_third_radial_coefficient_goes_through_nerfstudio() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    let rig = rig(Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.5, 0.0, 0.0, 0.0]));
    write(&rig, Format::Nerfstudio, &path).unwrap();
    let read = read(&path).unwrap();
    same_pictures(&rig, &read, 1e-8);
    assert_eq!(read.cameras[0].intrinsics, rig.cameras[0].intrinsics);
}

#[test]
fn llff_is_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses_bounds.npy");
    let mut rig = rig(Distortion::None);
    for camera in &mut rig.cameras {
        let i = &mut camera.intrinsics;
        (i.fy, i.cx, i.cy) = (i.fx, 0.5 * f64::from(i.width), 0.5 * f64::from(i.height));
    }
    let lost = write(&rig, Format::Llff, &path).unwrap();
    assert!(lost.iter().any(|lost| lost.contains("names")), "{lost:?}");
    let found = read(&path).unwrap();
    same_pictures(&rig, &found, 1e-8);
    let names: Vec<&str> = found.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["cam00", "cam01", "cam02"]);
    assert!(found.warnings.iter().any(|warning| warning == llff::BOUNDS_LEFT_OUT), "{:?}", found.warnings);
    let mut values = NpyArray::decode(&std::fs::read(&path).unwrap()).unwrap().floats().unwrap();
    for (at, value, expected) in
        [(4, 1e30, "no size"), (9, 0.0, "no size"), (14, -1.0, "focal length is -1 px"), (0, f64::NAN, "finite")]
    {
        let before = std::mem::replace(&mut values[17 + at], value);
        std::fs::write(&path, erfgs_base::npy::encode(&[3, 17], values.iter().copied())).unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("cam01") && message.contains(expected), "{message}");
        values[17 + at] = before;
    }
}

#[test]
fn what_a_format_says_beyond_a_rig_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(Distortion::None);
    let warnings = |path: &Path| read(path).unwrap().warnings.join("\n");

    let model = folder.path().join("model");
    write(&rig, Format::Colmap, &model).unwrap();
    assert!(!warnings(&model).contains("points"), "{}", warnings(&model));
    std::fs::write(model.join("points3D.txt"), "7 0.1 0.2 0.3 9 8 7 1.5\n").unwrap();
    assert!(warnings(&model).contains("1 points"), "{}", warnings(&model));

    let chain = folder.path().join("camchain.yaml");
    write(&rig, Format::Kalibr, &chain).unwrap();
    let text = std::fs::read_to_string(&chain).unwrap();
    assert_eq!(warnings(&chain), "");
    std::fs::write(&chain, text.replacen("  camera_model", "  timeshift_cam_imu: 0.01\n  camera_model", 1)).unwrap();
    assert!(warnings(&chain).contains("timeshift_cam_imu"), "{}", warnings(&chain));
    for (from, to, expected) in [
        ("cam1:", "cam4:", "cam2 follows a gap"),
        ("[640, 480]", "[1e30, 480]", "a side of the picture is 1e30"),
        ("[500.25,", "[-500.25,", "focal length is -500.25"),
        ("pinhole", "omni", "omni"),
        ("distortion_model: radtan", "distortion_model: fov", "fov"),
        ("[0.0, 0.0, 0.0, 0.0]\n  distortion_model: radtan", "[0.1, 0.0, 0.0, 0.0]", "no distortion_model"),
    ] {
        std::fs::write(&chain, text.replacen(from, to, 1)).unwrap();
        let message = read(&chain).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("camchain.yaml"), "{message}");
    }

    let matrices = folder.path().join("opencv");
    write(&rig, Format::OpenCv, &matrices).unwrap();
    assert_eq!(warnings(&matrices), "");
    let (path, text) = (matrices.join("b.yaml"), std::fs::read_to_string(matrices.join("b.yaml")).unwrap());
    std::fs::write(&path, format!("{text}avg_reprojection_error: 0.2\n")).unwrap();
    assert!(
        warnings(&matrices).contains("b: not known here and left out: avg_reprojection_error"),
        "{}",
        warnings(&matrices)
    );
    for (from, to, expected) in
        [("T: ", "t: ", "R and T"), ("500.25, 0.0", "500.25, 0.1", "skew"), ("640", "70000", "image_width")]
    {
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let message = read(&matrices).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("b.yaml"), "{message}");
    }
    // As OpenCV's calibration programs say which lens it is.
    let fisheye = text.replace("distortion_model: plumb_bob", "fisheye_model: 1");
    let fisheye = fisheye.replace("cols: 5", "cols: 4").replace("[0.0, 0.0, 0.0, 0.0, 0.0]", "[0.1, 0.0, 0.0, 0.2]");
    std::fs::write(&path, &fisheye).unwrap();
    let lens = |text: &str| {
        std::fs::write(&path, text).unwrap();
        read(&path).map(|rig| rig.cameras[0].intrinsics.distortion).map_err(|error| error.to_string())
    };
    for key in ["fisheye_model: 1", "fisheye: true", "isFisheye: 1", "fisheye_model: 1\ndistortion_model: fisheye"] {
        let text = fisheye.replace("fisheye_model: 1", key);
        assert_eq!(lens(&text), Ok(Distortion::KannalaBrandt([0.1, 0.0, 0.0, 0.2])), "{key}");
    }
    for key in [
        "fisheye_model: 2",
        "fisheye: maybe",
        "distortion_model: 7",
        "fisheye: 1\ndistortion_model: plumb_bob",
        "fisheye: 1\nfisheye_model: 0",
    ] {
        let message = lens(&fisheye.replace("fisheye_model: 1", key)).unwrap_err();
        assert!(message.contains("distortion_model") && message.contains("b.yaml"), "{key}: {message}");
    }
}

const ALL: [(Format, &str); 8] = [
    (Format::Colmap, "model"),
    (Format::Kalibr, "camchain.yaml"),
    (Format::OpenCv, "opencv"),
    (Format::Ros, "ros"),
    (Format::Nerfstudio, "transforms.json"),
    (Format::Llff, "poses_bounds.npy"),
    (Format::Caliscope, "camera_array.toml"),
    (Format::Pose2sim, "Calib.toml"),
];

#[test]
fn names_that_are_no_files_stay_in_the_folder_and_apart() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig(Distortion::None);
    for (camera, name) in rig.cameras.iter_mut().zip(["../../x", "..\\..\\x", "a b\n c"]) {
        camera.name = name.into();
    }
    for (format, name) in ALL {
        let out = folder.path().join("a/b").join(name);
        std::fs::create_dir_all(out.parent().unwrap()).unwrap();
        let lost = write(&rig, format, &out).unwrap().join("\n");
        assert!(lost.contains("../../x: it is called _.._.._x there"), "{format}: {lost}");
        let read = read(&out).unwrap();
        let names: BTreeSet<&str> = read.cameras.iter().map(|camera| camera.name.as_str()).collect();
        assert_eq!(names.len(), 3, "{format}: {names:?}");
        assert!(names.iter().all(|name| !name.contains([' ', '/', '\\', '\n'])), "{format}: {names:?}");
    }
    let beside: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(beside, ["a"]);
}

#[test]
fn two_cameras_of_one_name_and_rigs_without_cameras_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut same = rig(Distortion::None);
    same.cameras[1].name = "a".into();
    let empty = RigFile::new("wand", true, Vec::new());
    for (format, name) in ALL.into_iter().chain([(Format::Rig, "rig.json")]) {
        let out = folder.path().join(name);
        let message = write(&same, format, &out).unwrap_err().to_string();
        assert!(message.contains("two cameras are called a"), "{message}");
        assert!(matches!(write(&empty, format, &out), Err(ExchangeError::Empty)), "{format}");
        assert!(!out.exists(), "{format}");
    }
}

#[test]
fn caliscope_and_pose2sim_come_back_and_are_read_as_they_write() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig(Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.0, 0.0, 0.0]));
    for (number, camera) in [4, 0, 7].into_iter().zip(&mut rig.cameras) {
        camera.name = format!("cam_{number}");
    }
    rig.cameras[2].pose = None;
    for format in [Format::Caliscope, Format::Pose2sim] {
        let path = folder.path().join("rig.toml");
        write(&rig, format, &path).unwrap();
        let found = read(&path).unwrap();
        assert_eq!(found.warnings, Vec::<String>::new());
        for camera in &rig.cameras {
            let other = found.camera(&camera.name).unwrap();
            assert_eq!(other.intrinsics, camera.intrinsics, "{format}");
            assert_eq!(other.pose.is_some(), camera.pose.is_some());
            if let (Some(a), Some(b)) = (camera.pose, other.pose) {
                assert!((a.centre() - b.centre()).length() < 1e-12 && a.rotation.angle_between(b.rotation) < 1e-7);
            }
        }
    }
    // As pose2sim writes it.
    let text = "[int_cam01]\nname = \"cam01\"\nsize = [ 1088.0, 1920.0]\nmatrix = [ [ 1681.5, 0.0, 544.0], [ 0.0, 1682.5, 960.0], \
                [ 0.0, 0.0, 1.0]]\ndistortions = [ -0.05, 0.01, 0.0, 0.0]\nrotation = [ 1.5, -0.5, 0.5]\ntranslation = [ 0.8, \
                -0.5, 5.25]\nfisheye = false\n\n[metadata]\nadjusted = false\nerror = 0.3\n";
    let path = folder.path().join("Calib.toml");
    std::fs::write(&path, text).unwrap();
    let camera = read(&path).unwrap().cameras.remove(0);
    assert_eq!((camera.name.as_str(), camera.intrinsics.height, camera.intrinsics.cx), ("cam01", 1920, 544.5));
    assert_eq!(camera.pose.unwrap().translation, DVec3::new(0.8, -0.5, 5.25));
    for (from, to, expected) in [
        ("1088.0", "-3", "side"),
        ("1681.5", "nan", "no numbers"),
        ("matrix", "m", "no camera with a matrix"),
        ("[ 1.5, -0.5, 0.5]", "[ 1.5, -0.5]", "rotation and translation"),
        ("[ -0.05, 0.01, 0.0, 0.0]", "[1,2,3,4,5,6,7,8,9]", "9 distortion"),
        ("size = [", "size = ", "Calib.toml"),
    ] {
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("Calib.toml"), "{from}: {message}");
    }
}

#[test]
fn what_no_other_format_holds_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig(Distortion::None);
    assert_eq!(write(&rig, Format::Pose2sim, &folder.path().join("m.toml")).unwrap(), Vec::<String>::new());
    for format in [Format::Colmap, Format::Nerfstudio, Format::Llff] {
        let lost = write(&rig, format, &folder.path().join(format!("{format}"))).unwrap().join("\n");
        assert!(lost.contains("does not say that its unit is the metre"), "{format}: {lost}");
    }
    rig.metric = false;
    rig.cameras[0].modality = Modality::Event;
    rig.cameras[1].rms_px = Some(0.3);
    rig.cameras[2].warnings.push("it moved".into());
    let lost = write(&rig, Format::Colmap, &folder.path().join("m")).unwrap().join("\n");
    for word in ["event cameras", "how good", "warnings", "metre"] {
        assert!(lost.contains(word), "{word}: {lost}");
    }
}

#[test]
fn llff_says_what_it_drops_and_cameras_without_poses_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses_bounds.npy");
    let mut rig = rig(Distortion::KannalaBrandt([0.01; 4]));
    let lost = write(&rig, Format::Llff, &path).unwrap().join("\n");
    assert!(lost.contains("distortion") && lost.contains("bounds"), "{lost}");
    let array = NpyArray::decode(&std::fs::read(&path).unwrap()).unwrap();
    let values = array.floats().unwrap();
    assert_eq!(array.shape, [3, 17]);
    // The centre is the fourth column; the third points back, away from what is looked at.
    assert!((DVec3::new(values[3], values[8], values[13]) - DVec3::new(0.0, 0.1, -2.0)).length() < 1e-12);
    assert!(values[12] < -0.9, "{}", values[12]);
    rig.cameras[1].pose = None;
    assert!(write(&rig, Format::Colmap, &folder.path().join("m")).unwrap_err().to_string().contains("camera b"));
}

#[test]
fn broken_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("camchain.yaml", "cam0: {camera_model: omni}"),
        ("camchain.yaml", "a: [1"),
        ("transforms.json", "{\"frames\": [{}]}"),
        ("rig.json", "{}"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains(name), "{name}");
    }
    assert!(read(&folder.path().join("nothing")).is_err());
}

/// A camchain of cameras with these topics.
fn camchain(topics: &[&str]) -> String {
    let camera = |(at, topic): (usize, &&str)| {
        let pose =
            if at == 0 { "" } else { "  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n" };
        format!(
            "cam{at}:\n{pose}  camera_model: pinhole\n  distortion_model: none\n  intrinsics: [9, 9, 8, 4]\n  resolution: [16, 8]\n  \
             rostopic: {topic}\n"
        )
    };
    topics.iter().enumerate().map(camera).collect()
}

#[test]
fn cameras_of_a_camchain_are_called_by_what_tells_their_topics_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camchain.yaml");
    for (topics, names) in [
        (["/stereo/left/image_raw", "/stereo/right/image_raw"], ["left", "right"]),
        (["/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"], ["infra1", "infra2"]),
        (["/rig/image/a", "/rig/image/b"], ["a", "b"]),
        (["/east/image_raw", "/west/image_raw"], ["east", "west"]),
    ] {
        for mark in ["", "\u{feff}"] {
            std::fs::write(&path, format!("{mark}{}", camchain(&topics))).unwrap();
            let rig = read(&path).unwrap();
            assert_eq!(rig.cameras.iter().map(|camera| camera.name.as_str()).collect::<Vec<_>>(), names);
        }
    }
    std::fs::write(&path, camchain(&["/x/y", "/x/y"])).unwrap();
    assert!(read(&path).unwrap().warnings.iter().any(|warning| warning.contains("several cameras are called x_y")));
}

/// Where folders tell the images of cameras apart, and files with and without a byte order mark.
#[test]
fn files_with_a_byte_order_mark_are_read_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for (format, name) in ALL.into_iter().chain([(Format::Rig, "rig.json")]) {
        let out = folder.path().join(name);
        write(&rig(Distortion::None), format, &out).unwrap();
        let plain = read(&out);
        let files: Vec<std::path::PathBuf> = if out.is_dir() {
            std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect()
        } else {
            vec![out.clone()]
        };
        for file in files {
            let bytes = std::fs::read(&file).unwrap();
            if std::str::from_utf8(&bytes).is_ok() {
                std::fs::write(&file, [b"\xef\xbb\xbf".to_vec(), bytes].concat()).unwrap();
            }
        }
        let marked = read(&out);
        assert_eq!(plain.as_ref().ok(), marked.as_ref().ok(), "{format}: {marked:?}");
    }
}

/// As OpenCV writes it, whatever was calibrated: fourteen coefficients, zeros as `0.`, lists over several lines.
#[test]
fn fourteen_coefficients_of_opencv_are_a_lens_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let opencv = |key: &str, k: &str| {
        let count = k.split(',').count();
        format!(
            "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
             data: [ 5.0025e+02, 0., 3.1875e+02, 0., 5.015e+02,\n       2.4412e+02, 0., 0., 1. ]\n{key}: !!opencv-matrix\n   rows: 1\n   \
             cols: {count}\n   dt: d\n   data: [ {k} ]\n"
        )
    };
    // Python programs dump arrays as lists of lists.
    let python = |key: &str, k: &str| {
        format!(
            "image_width: 640\nimage_height: 480\ncamera_matrix: [[500.25, 0, 318.75], [0, 501.5, 244.12], [0, 0, 1]]\n{key}: [[{k}]]\n"
        )
    };
    let toml = |key: &str, k: &str| {
        format!(
            "[cam_0]\nname = \"a\"\nsize = [640, 480]\nmatrix = [[500.25, 0.0, 318.75], [0.0, 501.5, 244.12], [0.0, 0.0, 1.0]]\n{key} = \
             [{k}]\nrotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n"
        )
    };
    type Text<'a> = &'a dyn Fn(&str, &str) -> String;
    let formats: [(&str, Text<'_>, &[&str]); 3] = [
        ("a.yml", &opencv, &["distortion_coefficients", "dist_coeffs", "distCoeffs", "D"]),
        ("b.yaml", &python, &["distortion_coefficients", "dist_coeff", "dist"]),
        ("c.toml", &toml, &["distortions", "dist_coeffs"]),
    ];
    let terms = ["-0.21", "0.06", "1.0e-03", "-0.002", "0.013", "0.02", "-0.01", "0.003"];
    for (name, text, keys) in formats {
        let path = folder.path().join(name);
        for key in keys {
            for (count, used) in [(4, 4), (5, 5), (8, 8), (12, 5), (12, 8), (14, 4), (14, 5), (14, 8), (14, 0), (5, 0)]
            {
                let zero = if name == "c.toml" { "0.0" } else { "0." };
                let k: Vec<&str> = (0..count).map(|at| if at < used { terms[at] } else { zero }).collect();
                std::fs::write(&path, text(key, &k.join(", "))).unwrap();
                let rig = read(&path).unwrap();
                let wanted: [f64; 8] =
                    std::array::from_fn(|at| if at < used { terms[at].parse().unwrap() } else { 0.0 });
                let wanted = if used == 0 { Distortion::None } else { Distortion::BrownConrady(wanted) };
                assert_eq!(rig.cameras[0].intrinsics.distortion, wanted, "{name}: {count} {key}");
                assert!(!rig.warnings.iter().any(|warning| warning.contains("left out")), "{:?}", rig.warnings);
            }
            let k = format!("{}, 0.0, 0.25", terms.join(", "));
            std::fs::write(&path, text(key, &k)).unwrap();
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains("s2 = 0.25") && message.contains(name), "{message}");
        }
    }
    let twice = opencv("dist_coeffs", "0.1, 0., 0., 0.") + "D: [0.2, 0, 0, 0]\n";
    std::fs::write(folder.path().join("a.yml"), twice).unwrap();
    let message = read(&folder.path().join("a.yml")).unwrap_err().to_string();
    assert!(message.contains("dist_coeffs and as D"), "{message}");
}

/// Kalibr's models have four coefficients; programs that write all vectors equally long put zeros behind.
#[test]
fn zeros_behind_a_camchains_coefficients_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camchain.yaml");
    for (model, lens) in [
        ("radtan", Distortion::BrownConrady([0.1, 0.2, 0.3, 0.4, 0.0, 0.0, 0.0, 0.0])),
        ("equidistant", Distortion::KannalaBrandt([0.1, 0.2, 0.3, 0.4])),
    ] {
        for (more, is_read) in [("", true), (", 0.0", true), (", 0, 0.0, 0.0, 0.0", true), (", 0.5", false)] {
            let lines = format!("distortion_model: {model}\n  distortion_coeffs: [0.1, 0.2, 0.3, 0.4{more}]");
            std::fs::write(&path, camchain(&["/a"]).replace("distortion_model: none", &lines)).unwrap();
            match read(&path) {
                Ok(rig) => assert!(is_read && rig.cameras[0].intrinsics.distortion == lens, "{model} {more}"),
                Err(error) => {
                    let message = error.to_string();
                    assert!(!is_read && message.contains(model) && message.contains("cam0"), "{message}");
                }
            }
        }
    }
}
