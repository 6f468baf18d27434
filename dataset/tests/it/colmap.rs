use super::*;

fn intrinsics() -> Intrinsics {
    let distortion = Distortion::BrownConrady([0.1, -0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    Intrinsics { width: 16, height: 8, fx: 20.0, fy: 21.0, cx: 7.0, cy: 4.5, distortion }
}

pub(super) fn model(names: &[(&str, u64)]) -> Model {
    let mut model = Model::default();
    model.cameras.insert(1, ColmapCamera::from_intrinsics(&intrinsics()));
    for (id, (name, number)) in names.iter().enumerate() {
        let image = ColmapImage { pose: pose(*number), camera: 1, name: (*name).to_owned(), points: Vec::new() };
        model.images.insert(id as u32 + 1, image);
    }
    model
}

#[test]
fn a_folder_for_each_camera_gives_all_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    for (camera, value) in [("east", 1), ("west", 2)] {
        for t in 0..4_u8 {
            write(folder.path().join(format!("images/{camera}/{t:04}.png")), &halves(16, 8, t, value));
        }
    }
    // Two registered images of one camera that agree, one of the other.
    let sparse = folder.path().join("sparse/0");
    model(&[("east/0000.png", 0), ("east/0002.png", 0), ("west/0001.png", 1)]).write_binary(&sparse).unwrap();
    let test_cameras = Some(vec!["west".to_owned()]);
    let options = ImportOptions { frames: Some((1, 3)), test_cameras, fps: Some(50.0), ..Default::default() };
    let dataset = run(Layout::Colmap, folder.path(), &options, &folder.path().join("ds")).unwrap();
    assert_eq!(splits(&dataset), [("east", Split::Train), ("west", Split::Test)]);
    assert_eq!(dataset.manifest.span_ns, [0, 40_000_000]);
    for (camera, number) in dataset.manifest.cameras.iter().zip(0..) {
        assert_eq!(camera.intrinsics, intrinsics());
        assert!(close(&camera.world_to_camera, &pose(number)));
        assert_eq!(grey(&dataset, camera, 0), [1, number as u8 + 1]);
    }

    let message = || refused(Layout::Colmap, folder.path(), &ImportOptions::default());
    std::fs::remove_file(folder.path().join("images/west/0003.png")).unwrap();
    assert!(message().contains("camera west") && message().contains("3 images"), "{}", message());
    model(&[("east/0000.png", 0), ("east/0002.png", 3), ("west/0001.png", 1)]).write_text(&sparse).unwrap();
    assert!(message().contains("camera east") && message().contains("only static cameras"), "{}", message());
    model(&[("north/0000.png", 0)]).write_text(&sparse).unwrap();
    assert!(message().contains("camera north") && message().contains("images/north/0000.png"), "{}", message());
    std::fs::remove_file(sparse.join("cameras.txt")).unwrap();
    assert!(message().contains("sparse/0"), "{}", message());
}

#[test]
fn one_image_for_each_camera_gives_one_instant() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        write(folder.path().join(format!("images/{name}.png")), &halves(16, 8, 1, 2));
    }
    model(&[("a.png", 0), ("b.png", 1)]).write_text(&folder.path().join("sparse")).unwrap();
    let out = folder.path().join("ds");
    let dataset = run(Layout::Colmap, folder.path(), &ImportOptions::default(), &out).unwrap();
    assert_eq!(splits(&dataset), [("a", Split::Test), ("b", Split::Train)]);
    assert_eq!(dataset.manifest.span_ns, [0, 33_333_333]);
    assert!(dataset.manifest.cameras.iter().all(|camera| camera.frames.len() == 1));
}

#[test]
fn points_are_taken_and_cameras_without_images_in_the_model_are_said_to_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        write(folder.path().join(format!("images/{name}.png")), &halves(16, 8, 1, 2));
    }
    let mut model = model(&[("a.png", 0), ("b.png", 1)]);
    let sparse = folder.path().join("sparse/0");
    model.write_binary(&sparse).unwrap();
    let import_notes = || notes(Layout::Colmap, folder.path(), &ImportOptions::default());
    assert_eq!(import_notes(), "");
    let point = Point3d { position: DVec3::ONE, colour: [1, 2, 3], error: 0.5, track: Vec::new() };
    model.points.insert(8, Point3d { position: DVec3::splat(1e300), ..point.clone() });
    model.points.insert(7, point);
    model.write_binary(&sparse).unwrap();
    write(folder.path().join("images/c.png"), &halves(16, 8, 1, 2));
    write(folder.path().join("images/north/0.png"), &halves(16, 8, 1, 2));
    let text = import_notes();
    assert!(
        text.contains("from the model: 1.") && text.contains("held-out") && text.contains("of the model left out: 1,"),
        "{text}"
    );
    assert!(text.contains("c.png: left out") && text.contains("north: left out"), "{text}");
    let out = folder.path().join("ds");
    let dataset = run(Layout::Colmap, folder.path(), &ImportOptions::default(), &out).unwrap();
    let points = Dataset::load(&out).unwrap().read_points().unwrap().expect("points");
    assert_eq!((points.positions, points.colours), (vec![[1.0; 3]], vec![[1, 2, 3]]));
    assert_eq!(dataset.manifest.points.as_ref().map(|file| file.method.as_str()), Some("colmap"));
    dataset.verify().unwrap();
    model.cameras.insert(1, ColmapCamera { parameters: vec![-1.0; 8], ..ColmapCamera::from_intrinsics(&intrinsics()) });
    model.write_binary(&sparse).unwrap();
    let message = refused(Layout::Colmap, folder.path(), &ImportOptions::default());
    assert!(message.contains("camera a") && message.contains("the focal length is"), "{message}");
}
