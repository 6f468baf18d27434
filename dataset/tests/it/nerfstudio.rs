use super::*;

pub(super) fn frame(file: &str, camera: u64, extra: Value) -> Value {
    let to_world = pose(camera).inverse();
    let rotation = DMat3::from_quat(to_world.rotation);
    let columns = [rotation.x_axis, -rotation.y_axis, -rotation.z_axis, to_world.translation];
    let row = |at: usize| columns.map(|column| column[at]).to_vec();
    let mut frame = json!({
        "file_path": file, "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    });
    frame.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    frame
}

#[test]
fn frames_of_one_pose_are_one_camera_with_times() {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = Vec::new();
    for camera in 0..2_u64 {
        for (t, time) in [0.0, 0.25, 1.0].into_iter().enumerate() {
            write(folder.path().join(format!("left{camera}/{t}.png")), &halves(16, 8, t as u8, camera as u8));
            let lens = if camera == 0 { json!({ "fl_x": 30.0, "k1": 0.5 }) } else { json!({}) };
            let mut extra = json!({ "time": time });
            extra.as_object_mut().unwrap().extend(lens.as_object().unwrap().clone());
            // The second camera's names lack their extension.
            let file = if camera == 0 { format!("left0/{t}.png") } else { format!("./left1/{t}") };
            frames.push(frame(&file, camera, extra));
        }
    }
    let file = json!({
        "camera_model": "OPENCV", "w": 16, "h": 8.0, "fl_x": 20.0, "fl_y": 21.0, "cx": 7.0, "cy": 4.5,
        "k1": 0.1, "k2": -0.02, "p1": 0.003, "p2": -0.004, "k3": 0.001, "frames": frames,
        "train_filenames": [], "test_filenames": ["./left1/0"],
    });
    std::fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
    let options = ImportOptions { fps: Some(10.0), ..Default::default() };
    let dataset = run(Layout::Nerfstudio, folder.path(), &options, &folder.path().join("ds")).unwrap();
    assert_eq!(splits(&dataset), [("left0", Split::Train), ("left1", Split::Test)]);
    for (camera, number) in dataset.manifest.cameras.iter().zip(0..) {
        assert!(close(&camera.world_to_camera, &pose(number)), "{:?}", camera.world_to_camera);
        // Three times at ten a second last 0.2 s; 0.25 lies a quarter of the way.
        assert_eq!(camera.frames.iter().map(|f| f.t_ns).collect::<Vec<_>>(), [0, 50_000_000, 200_000_000]);
        let k1 = if number == 0 { 0.5 } else { 0.1 };
        assert_eq!(
            camera.intrinsics,
            Intrinsics {
                width: 16,
                height: 8,
                fx: if number == 0 { 30.0 } else { 20.0 },
                fy: 21.0,
                cx: 7.0,
                cy: 4.5,
                distortion: Distortion::BrownConrady([k1, -0.02, 0.003, -0.004, 0.001, 0.0, 0.0, 0.0]),
            }
        );
        assert_eq!(grey(&dataset, camera, 2), [2, number as u8]);
    }
}

#[test]
fn fisheye_and_field_of_view_are_understood() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        write(folder.path().join(format!("{name}.png")), &halves(16, 8, 1, 2));
    }
    let lens = json!({ "camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k4": 0.2 });
    let file = json!({
        "camera_angle_x": 2.0 * (8.0_f64 / 25.0).atan(),
        "frames": [frame("a.png", 0, lens), frame("b.png", 1, json!({}))],
    });
    std::fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
    let out = folder.path().join("ds");
    let dataset = run(Layout::Nerfstudio, folder.path(), &ImportOptions::default(), &out).unwrap();
    assert_eq!(splits(&dataset), [("a", Split::Test), ("b", Split::Train)]);
    let [a, b] = [0, 1].map(|at| dataset.manifest.cameras[at].intrinsics);
    assert_eq!(a.distortion, Distortion::KannalaBrandt([0.1, 0.0, 0.0, 0.2]));
    assert!((b.fx - 25.0).abs() < 1e-12 && b.fy == b.fx && (b.cx, b.cy) == (8.0, 4.0));
}

#[test]
fn what_is_wrong_is_named_with_the_frame() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path().join("a.png"), &halves(16, 8, 1, 2));
    let message = |file: Value| {
        let text = file.to_string().replace("\"BARE NaN\"", "NaN");
        std::fs::write(folder.path().join("transforms.json"), text).unwrap();
        refused(Layout::Nerfstudio, folder.path(), &ImportOptions::default())
    };
    let one = |extra: Value| json!({ "fl_x": 20.0, "frames": [frame("a.png", 0, extra)] });
    let has = |message: String, word: &str| assert!(message.contains("a.png") && message.contains(word), "{message}");
    has(message(one(json!({ "cx": "BARE NaN" }))), "principal point");
    has(message(one(json!({ "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0]] }))), "transform_matrix");
    has(message(one(json!({ "camera_model": "EQUIRECTANGULAR", "k1": 0.1 }))), "EQUIRECTANGULAR");
    has(message(one(json!({ "camera_model": "OPENCV", "k4": 0.1 }))), "k4");
    has(message(one(json!({ "time": "BARE NaN" }))), "time");
    has(message(json!({ "frames": [frame("a.png", 0, json!({}))] })), "fl_x");
    has(message(one(json!({ "w": 32, "h": 8 }))), "16 x 8");
    assert!(message(json!({ "fl_x": 20.0, "frames": [frame("no.png", 0, json!({}))] })).contains("no.png"));
    assert!(message(json!({ "frames": [] })).contains("no frames"));
    assert!(message(json!({ "frame": [] })).contains("transforms.json"));
}

/// What `erfgs calibrate convert` writes, every coefficient of the lens included.
#[test]
fn a_rig_written_for_nerfstudio_is_imported_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let lenses = [
        Distortion::None,
        Distortion::BrownConrady([0.1, -0.02, 0.003, -0.004, 0.0, 0.0, 0.0, 0.0]),
        Distortion::BrownConrady([0.1, -0.02, 0.003, -0.004, 0.005, 0.0, 0.0, 0.0]),
        Distortion::KannalaBrandt([0.0; 4]),
        Distortion::KannalaBrandt([0.1, -0.02, 0.003, -0.004]),
    ];
    let camera = |(number, distortion): (u64, Distortion)| {
        let name = format!("cam{number}");
        write(folder.path().join(format!("images/{name}.png")), &halves(16, 8, 1, 2));
        let intrinsics = Intrinsics { width: 16, height: 8, fx: 20.125, fy: 21.1, cx: 7.3, cy: 4.5, distortion };
        RigCamera::new(&name, Modality::Rgb, intrinsics, Some(pose(number)))
    };
    let rig = RigFile::new("wand", true, (0..).zip(lenses).map(camera).collect());
    exchange::write(&rig, Format::Nerfstudio, &folder.path().join("transforms.json")).unwrap();
    let options = ImportOptions::default();
    let dataset = run(Layout::Nerfstudio, folder.path(), &options, &folder.path().join("ds")).unwrap();
    assert_eq!(notes(Layout::Nerfstudio, folder.path(), &options), "");
    assert_eq!(dataset.manifest.cameras.len(), rig.cameras.len());
    for (imported, written) in dataset.manifest.cameras.iter().zip(&rig.cameras) {
        assert_eq!((&imported.name, imported.intrinsics), (&written.name, written.intrinsics));
        assert!(close(&imported.world_to_camera, &written.pose.unwrap()), "{}", written.name);
    }
    // And the rig's own reader says the same.
    let back = exchange::read(&folder.path().join("transforms.json")).unwrap();
    for (read, imported) in back.cameras.iter().zip(&dataset.manifest.cameras) {
        assert_eq!(
            (read.intrinsics, read.pose),
            (imported.intrinsics, Some(imported.world_to_camera)),
            "{}",
            read.name
        );
    }
}

#[test]
fn a_model_that_is_not_known_is_refused_even_without_coefficients() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path().join("a.png"), &halves(16, 8, 1, 2));
    for (keys, expected) in [
        (json!({ "camera_model": "EQUIRECTANGULAR" }), "EQUIRECTANGULAR"),
        (json!({ "k6": 0.1 }), "k6"),
        (json!({ "camera_model": "OPENCV_FISHEYE", "p2": 0.1 }), "p2"),
        (json!({ "w": 1e30, "h": 8 }), "a side of the picture"),
        (json!({ "w": 0, "h": 8 }), "a side of the picture"),
        (json!({ "w": 16 }), "w and h"),
    ] {
        let file = json!({ "fl_x": 20.0, "frames": [frame("a.png", 0, keys)] });
        std::fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
        let message = refused(Layout::Nerfstudio, folder.path(), &ImportOptions::default());
        assert!(message.contains("a.png") && message.contains(expected), "{message}");
    }
}

#[test]
fn what_is_not_taken_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let frames = [0_u64, 1].map(|number| {
        write(folder.path().join(format!("{number}.png")), &halves(16, 8, 1, 2));
        frame(&format!("{number}.png"), number, json!({ "time": number, "mask_path": "m.png" }))
    });
    let file = json!({ "fl_x": 20.0, "ply_file_path": "p.ply", "aabb_scale": 4, "frames": frames });
    std::fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
    let options = ImportOptions { frames: Some((1, 1)), ..Default::default() };
    let text = notes(Layout::Nerfstudio, folder.path(), &options);
    for word in ["mask_path", "ply_file_path", "left out: aabb_scale", "0: left out, it has no frame"] {
        assert!(text.contains(word), "{word}: {text}");
    }
}

#[test]
fn what_becomes_of_a_camera_that_moves_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let imported = |frames: &[(u64, Option<f64>)]| {
        let frames = frames.iter().enumerate().map(|(at, (camera, time))| {
            write(folder.path().join(format!("train/r_{at:03}.png")), &halves(16, 8, 1, 2));
            let extra = time.map_or(json!({}), |time| json!({ "time": time }));
            // As D-NeRF has it: without the extension.
            frame(&format!("./train/r_{at:03}"), *camera, extra)
        });
        let file = json!({ "camera_angle_x": 0.7, "frames": frames.collect::<Vec<_>>() });
        std::fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
        let out = folder.path().join("ds");
        let dataset = run(Layout::Nerfstudio, folder.path(), &ImportOptions::default(), &out).unwrap();
        std::fs::remove_dir_all(out).unwrap();
        (notes(Layout::Nerfstudio, folder.path(), &ImportOptions::default()), dataset.manifest.cameras.len())
    };
    let (moving, cameras) = imported(&[(0, Some(0.0)), (1, Some(0.5)), (2, Some(1.0))]);
    assert!(moving.contains("3 frames have a pose and a time of their own") && cameras == 3, "{moving}");
    // Cameras that stand still, and images of one instant or of none that is told, of which a scene is made as well.
    for still in [
        vec![(0, Some(0.0)), (0, Some(1.0)), (1, Some(0.0)), (1, Some(1.0))],
        vec![(0, Some(0.5)), (1, Some(0.5)), (2, Some(0.5))],
        vec![(0, None), (1, None), (2, None)],
    ] {
        let (text, _) = imported(&still);
        assert!(!text.contains("of their own"), "{text}");
    }
}

#[test]
fn cameras_are_called_by_whatever_part_of_their_paths_tells_them_apart() {
    for (paths, names) in [
        (["images/left", "images/right", "images/top"], ["left", "right", "top"]),
        (["cam01/images", "cam02/images", "cam03/images"], ["cam01", "cam02", "cam03"]),
        (["rig/a/rgb/undistorted", "rig/b/rgb/undistorted", "rig/c/rgb/undistorted"], ["a", "b", "c"]),
        (["./a/rgb", "b/rgb", "./c/rgb"], ["a", "b", "c"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut frames = Vec::new();
        for (camera, path) in paths.iter().enumerate() {
            for t in 0..2_u64 {
                let file = format!("{path}/{t:04}.png");
                write(folder.path().join(&file), &halves(16, 8, t as u8, camera as u8));
                frames.push(frame(&file, camera as u64, json!({ "time": t })));
            }
        }
        let file = json!({ "w": 16, "h": 8, "fl_x": 20.0, "frames": frames });
        std::fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
        let options = ImportOptions { fps: Some(10.0), ..Default::default() };
        let dataset = run(Layout::Nerfstudio, folder.path(), &options, &folder.path().join("ds")).unwrap();
        let found: Vec<&str> = dataset.manifest.cameras.iter().map(|camera| camera.name.as_str()).collect();
        assert_eq!(found, names, "{paths:?}");
        for (number, camera) in dataset.manifest.cameras.iter().enumerate() {
            assert_eq!(grey(&dataset, camera, 1), [1, number as u8], "{paths:?}: the pictures of {}", camera.name);
        }
    }
}
