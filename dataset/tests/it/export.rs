use erfgs_dataset::export::{self, Exported, export};
use erfgs_scene::PointCloud;

use super::*;

/// Three cameras of so many frames each, the middle one held out, with points.
fn dataset(folder: &Path, frames: u8) -> Dataset {
    let mut list = Vec::new();
    for camera in 0..3_u64 {
        for t in 0..frames {
            let file =
                if frames == 1 { format!("images/cam{camera}.png") } else { format!("images/cam{camera}/{t}.png") };
            write(folder.join(&file), &halves(16, 8, t, camera as u8));
            let to_world = pose(camera).inverse();
            let rotation = DMat3::from_quat(to_world.rotation);
            let columns = [rotation.x_axis, -rotation.y_axis, -rotation.z_axis, to_world.translation];
            let row = |at: usize| columns.map(|column| column[at]).to_vec();
            list.push(json!({
                "file_path": file, "time": f64::from(t) / f64::from(frames.max(2) - 1),
                "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            }));
        }
    }
    let file = json!({
        "camera_model": "OPENCV", "w": 16, "h": 8, "fl_x": 20.0, "fl_y": 21.0, "cx": 7.25, "cy": 4.5,
        "k1": 0.1, "k2": -0.02, "p1": 0.003, "p2": -0.004, "frames": list,
    });
    std::fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
    let options = ImportOptions { fps: Some(10.0), test_cameras: Some(vec!["cam1".into()]), ..Default::default() };
    let mut dataset = run(Layout::Nerfstudio, folder, &options, &folder.join("ds")).unwrap();
    let cloud = PointCloud {
        positions: (0..5).map(|i| [0.1 * i as f32, -0.5, 1.5]).collect(),
        colours: (0..5).map(|i| [i, 100, 200]).collect(),
    };
    dataset.set_points(&cloud, "colmap", Default::default()).unwrap();
    dataset.hash_files().unwrap();
    dataset.save().unwrap();
    dataset
}

/// Cameras, frames and images are the same, whatever the program that was in between.
fn assert_same(a: &Dataset, b: &Dataset) {
    assert_eq!(splits(a), splits(b));
    for (a_camera, b_camera) in a.manifest.cameras.iter().zip(&b.manifest.cameras) {
        assert_eq!(a_camera.intrinsics, b_camera.intrinsics);
        assert!(close(&a_camera.world_to_camera, &b_camera.world_to_camera), "{}", a_camera.name);
        let times = |camera: &Camera| camera.frames.iter().map(|frame| frame.t_ns).collect::<Vec<_>>();
        assert_eq!(times(a_camera), times(b_camera));
        for frame in 0..a_camera.frames.len() {
            assert_eq!(grey(a, a_camera, frame), grey(b, b_camera, frame));
        }
    }
}

#[test]
fn what_nerfstudio_gets_comes_back() {
    for frames in [1, 4] {
        let folder = tempfile::tempdir().unwrap();
        let dataset = dataset(folder.path(), frames);
        let out = folder.path().join("out");
        let exported = export(&dataset, export::Layout::Nerfstudio, &out, &mut |_| {}).unwrap();
        assert_eq!(exported, Exported { images: 3 * u64::from(frames), points: 5, notes: Vec::new() });
        let options = ImportOptions { fps: Some(10.0), ..Default::default() };
        let back = run(Layout::Nerfstudio, &out, &options, &folder.path().join("back")).unwrap();
        assert_same(&dataset, &back);
        assert_eq!(PointCloud::read(&out.join("points.ply")).unwrap().len(), 5);
        let file: Value = serde_json::from_slice(&std::fs::read(out.join("transforms.json")).unwrap()).unwrap();
        assert_eq!(file["ply_file_path"], "points.ply");
        assert_eq!(file["test_filenames"].as_array().map(Vec::len), Some(usize::from(frames)));
        assert_eq!(file["train_filenames"].as_array().map(Vec::len), Some(2 * usize::from(frames)));
    }
}

#[test]
fn what_colmap_gets_comes_back_with_its_points() {
    for frames in [1, 4] {
        let folder = tempfile::tempdir().unwrap();
        let dataset = dataset(folder.path(), frames);
        let out = folder.path().join("out");
        export(&dataset, export::Layout::Colmap, &out, &mut |_| {}).unwrap();
        let options = ImportOptions { fps: Some(10.0), test_cameras: Some(vec!["cam1".into()]), ..Default::default() };
        let back = run(Layout::Colmap, &out, &options, &folder.path().join("back")).unwrap();
        assert_same(&dataset, &back);
        assert_eq!(back.read_points().unwrap(), dataset.read_points().unwrap());
        let model = Model::read(&out.join("sparse/0")).unwrap();
        assert_eq!((model.cameras.len(), model.images.len()), (3, 3 * usize::from(frames)));
        assert!(model.images.values().all(|image| out.join("images").join(&image.name).is_file()));
        let table = std::fs::read_to_string(out.join("frames.csv")).unwrap();
        assert_eq!(table.lines().count(), 1 + 3 * usize::from(frames));
        assert!(table.lines().nth(1 + usize::from(frames)).unwrap().contains(",cam1,test,0,"), "{table}");
    }
}

/// `scripts/setup.sh --oracles` installs COLMAP for Python; the environment variable `ERFGS_ORACLES` names another one that has it.
#[test]
fn colmap_reads_one_rig_and_a_frame_for_each_instant() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = dataset(folder.path(), 4);
    // A camera that runs by itself took its last frame alone.
    dataset.manifest.cameras[2].frames[3].t_ns += 7_000_000;
    let out = folder.path().join("out");
    export(&dataset, export::Layout::Colmap, &out, &mut |_| {}).unwrap();
    let script = erfgs_recordings::root().join("tests/oracles/colmap_rig.py");
    let output = Command::new(erfgs_recordings::python()).arg(script).arg(out.join("sparse/0")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&found["rigs"], &found["registered"]), (&json!([[1, [2, 3]]]), &json!(12)));
    let instant =
        |cameras: &[u32], t: u32| -> Value { cameras.iter().map(|camera| format!("cam{camera}/{t:05}.png")).collect() };
    let all = [0, 1, 2];
    let expected = [instant(&all, 0), instant(&all, 1), instant(&all, 2), instant(&all[..2], 3), instant(&all[2..], 3)];
    assert_eq!(found["frames"], json!(expected));
    for camera in &dataset.manifest.cameras {
        let pose = camera.world_to_camera.matrix();
        for t in 0..4 {
            let rows: Vec<[f64; 4]> =
                serde_json::from_value(found["poses"][format!("{}/{t:05}.png", camera.name)].clone()).unwrap();
            let off = (0..3).flat_map(|row| (0..4).map(move |column| (row, column)));
            let off = off.map(|(row, column)| (rows[row][column] - pose.col(column)[row]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-12, "{}: {off}", camera.name);
        }
    }
}

#[test]
fn what_a_layout_has_no_place_for_is_said_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = dataset(folder.path(), 2);
    let camera = &mut dataset.manifest.cameras[0];
    camera.frames.clear();
    let out = folder.path().join("out");
    let exported = export(&dataset, export::Layout::Colmap, &out, &mut |_| {}).unwrap();
    assert_eq!((exported.images, exported.notes.len()), (4, 1));
    assert!(exported.notes[0].contains("no frames"), "{:?}", exported.notes);
    let again = export(&dataset, export::Layout::Colmap, &out, &mut |_| {}).unwrap_err();
    assert!(matches!(again, DatasetError::OutputExists { .. }), "{again}");
    // A lens that nerfstudio does not know is named with its camera, and nothing is left behind.
    dataset.manifest.cameras[1].intrinsics.distortion = Distortion::BrownConrady([0.1; 8]);
    let error = export(&dataset, export::Layout::Nerfstudio, &folder.path().join("other"), &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("cam1"), "{error}");
    assert!(!folder.path().join("other").exists());
    std::fs::remove_file(dataset.root.join(&dataset.manifest.cameras[2].frames[0].file)).unwrap();
    let error = export(&dataset, export::Layout::Colmap, &folder.path().join("other"), &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("cam2"), "{error}");
}
