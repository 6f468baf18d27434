use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::*;
use erfgs_events::{Event, Events, npz};
use erfgs_scene::{Distortion, ImageGrey8, ImageRgb8, Intrinsics, Modality, PointCloud, Pose};

mod plausible;

fn some_camera(name: &str, modality: Modality) -> Camera {
    let frame = |index: usize| Frame {
        file: layout::image(name, index),
        t_ns: index as i64 * 33_333_333,
        exposure_ns: [index as i64 * 33_333_333 - 1000, index as i64 * 33_333_333 + 1000],
        mask: (index == 1).then(|| layout::mask(name, index)),
    };
    let events = CameraEvents {
        file: layout::events(name),
        count: 2,
        threshold_on: 0.2,
        threshold_off: 0.25,
        lin_log_threshold: 20.0,
        linear_light: false,
        covers_ns: [0, 66_666_666],
        simulator: Some(serde_json::json!({ "mode": "parity" })),
    };
    Camera {
        name: name.to_owned(),
        modality,
        split: Split::Train,
        intrinsics: Intrinsics {
            width: 8,
            height: 6,
            fx: 7.5,
            fy: 7.25,
            cx: 4.1,
            cy: 2.9,
            distortion: Distortion::BrownConrady([0.1, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]),
        },
        world_to_camera: Pose::look_at(DVec3::new(1.0, -1.5, 2.0), DVec3::ZERO, DVec3::Y),
        pose_sigma: None,
        clock_sigma_s: None,
        frames: if modality.has_frames() { (0..3).map(frame).collect() } else { Vec::new() },
        events: modality.has_events().then_some(events),
    }
}

/// An RGB, an event and a both camera, a mask each where there are frames, points.
fn some_manifest() -> Manifest {
    let cameras = [("a", Modality::Rgb), ("b", Modality::Event), ("c", Modality::Both)];
    let cameras: Vec<Camera> = cameras.into_iter().map(|(name, modality)| some_camera(name, modality)).collect();
    Manifest {
        format: Manifest::FORMAT.to_owned(),
        version: Manifest::VERSION,
        name: "some".to_owned(),
        provenance: Provenance { importer: "stage".to_owned(), ..Provenance::default() },
        span_ns: [0, 66_666_666],
        seed: 7,
        linear_exposure: false,
        variant: vec![VariantStep::subsample(4)],
        points: Some(PointCloudFile {
            file: layout::POINTS.into(),
            count: 1,
            method: "random".to_owned(),
            parameters: std::collections::BTreeMap::new(),
        }),
        bodies: None,
        cameras,
        sha256: std::collections::BTreeMap::new(),
    }
}

/// The same with its files on disk.
fn some_dataset(root: &Path) -> Dataset {
    let manifest = some_manifest();
    let points = PointCloud { positions: vec![[0.0, 1.0, 2.0]], colours: vec![[1, 2, 3]] };
    points.write(&root.join(layout::POINTS)).unwrap();
    for camera in &manifest.cameras {
        for (index, frame) in camera.frames.iter().enumerate() {
            let mut image = ImageRgb8::new(8, 6);
            image.data[index] = 200;
            image.write_png(&root.join(&frame.file)).unwrap();
            if let Some(mask) = &frame.mask {
                let mut image = ImageGrey8::new(8, 6);
                image.data[5] = 255;
                image.write_png(&root.join(mask)).unwrap();
            }
        }
        if let Some(file) = &camera.events {
            let mut events = Events::new(8, 6);
            events.push(Event { t_us: 10, x: 7, y: 5, on: true });
            events.push(Event { t_us: 20, x: 0, y: 0, on: false });
            npz::write_events(&root.join(&file.file), &events).unwrap();
        }
    }
    Dataset::new(root, manifest)
}

#[test]
fn a_dataset_comes_back_with_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = some_dataset(&folder.path().join("ds"));
    dataset.hash_files().unwrap();
    assert_eq!(dataset.manifest.sha256.len(), 11, "6 frames, 2 masks, 2 event files, points");
    dataset.save().unwrap();
    let loaded = Dataset::load(&dataset.root).unwrap();
    assert_eq!(loaded, dataset);
    assert_eq!(Dataset::load(&dataset.root.join("dataset.json")).unwrap(), dataset);
    loaded.verify().unwrap();
    assert_eq!(loaded.sha256(), dataset.sha256());

    let camera = loaded.camera("c").unwrap();
    assert_eq!(loaded.read_image(camera, &camera.frames[2]).unwrap().data[2], 200);
    assert_eq!(loaded.read_mask(camera, &camera.frames[0]).unwrap(), None);
    assert_eq!(loaded.read_mask(camera, &camera.frames[1]).unwrap().unwrap().data[5], 255);
    assert_eq!(loaded.read_events(camera).unwrap().unwrap().t_us, [10, 20]);
    let mut times: Vec<i64> = Vec::new();
    let all = |events: &erfgs_events::Events| {
        times.extend(&events.t_us);
        Ok::<_, DatasetError>(())
    };
    assert!(loaded.read_event_pieces(camera, all).unwrap());
    assert_eq!(times, [10, 20]);
    let none = |_: &erfgs_events::Events| Err(DatasetError::PointCount { path: "p".into(), found: 0, named: 1 });
    assert!(!loaded.read_event_pieces(loaded.camera("a").unwrap(), none).unwrap());
    assert!(loaded.read_event_pieces(camera, none).is_err(), "what is refused ends it");
    assert_eq!(loaded.read_points().unwrap().unwrap().len(), 1);
    assert_eq!(loaded.read_events(loaded.camera("a").unwrap()).unwrap(), None);
}

#[test]
fn a_changed_file_and_a_missing_hash_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = some_dataset(folder.path());
    dataset.hash_files().unwrap();
    ImageRgb8::new(8, 6).write_png(&folder.path().join(layout::image("c", 1))).unwrap();
    let error = dataset.verify().unwrap_err();
    assert!(matches!(&error, DatasetError::Changed { path } if path.ends_with("images/c/00001.png")), "{error}");
    let sha256 = dataset.sha256();
    dataset.manifest.sha256.remove(&layout::image("a", 0));
    assert_ne!(dataset.sha256(), sha256);
    let error = dataset.verify().unwrap_err();
    assert!(matches!(&error, DatasetError::NoHash { path } if path.ends_with("images/a/00000.png")), "{error}");
}

/// What lies in a folder, and the points that the manifest there names.
fn found(root: &Path) -> (Vec<String>, Vec<[f32; 3]>) {
    let mut names: Vec<_> =
        std::fs::read_dir(root).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let dataset = Dataset::load(root).unwrap();
    dataset.verify().unwrap();
    (names, dataset.read_points().unwrap().unwrap().positions)
}

#[test]
fn points_and_the_manifest_that_names_them_are_replaced_as_one_whenever_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let mut dataset = some_dataset(root);
    dataset.hash_files().unwrap();
    dataset.save().unwrap();
    let (names, old) = found(root);
    let cloud = |x: f32| PointCloud { positions: vec![[x, 0.0, 0.0]; 2], colours: vec![[1, 2, 3]; 2] };

    // Nothing can be put over a folder that is not empty: the manifest does not come into its place.
    let (manifest, kept) = (root.join(Dataset::MANIFEST), root.join("kept.json"));
    let taken = |place: &Path| {
        std::fs::rename(place, &kept).unwrap();
        std::fs::create_dir_all(place.join("taken")).unwrap();
    };
    let given_back = |place: &Path| {
        std::fs::remove_dir_all(place).unwrap();
        std::fs::rename(&kept, place).unwrap();
    };
    let mut again = Dataset::load(root).unwrap();
    taken(&manifest);
    again.replace_points(&cloud(5.0), "random", [].into()).unwrap_err();
    given_back(&manifest);
    assert_eq!(again, dataset);
    assert_eq!(found(root), (names.clone(), old));

    // It is the points that do not, when the manifest names them under another name already.
    let points = root.join(layout::POINTS);
    taken(&points);
    again.replace_points(&cloud(6.0), "random", [].into()).unwrap_err();
    given_back(&points);
    let (there, between) = found(root);
    assert_eq!(between, cloud(6.0).positions);
    assert_eq!(there.len(), names.len() + 1);
    assert_eq!(Dataset::load(root).unwrap(), again);
    again.replace_points(&cloud(7.0), "random", [].into()).unwrap();
    assert_eq!(found(root), (names, cloud(7.0).positions));
}

/// The problem that `spoil` makes, after checking that the message names the camera and the manifest.
fn problem(spoil: impl FnOnce(&mut Manifest)) -> Problem {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = some_dataset(folder.path());
    dataset.validate().unwrap();
    spoil(&mut dataset.manifest);
    let error = dataset.validate().unwrap_err();
    assert!(error.to_string().contains("dataset.json"), "{error}");
    match error {
        DatasetError::Manifest { problem, .. } => *problem,
        DatasetError::Camera { ref problem, ref camera, .. } => {
            assert!(error.to_string().contains(&format!("camera {camera}: ")), "{error}");
            (**problem).clone()
        }
        other => panic!("{other}"),
    }
}

#[test]
fn manifests_that_make_no_sense_are_refused() {
    use Problem as P;
    assert!(matches!(problem(|m| m.cameras.clear()), P::NoCameras));
    assert!(matches!(problem(|m| m.span_ns = [5, 5]), P::Span([5, 5])));
    assert!(matches!(problem(|m| m.cameras[1].name = "a".to_owned()), P::NameTwice));
    for name in ["", "..", "a/b", "a\\b", "a b"] {
        assert!(matches!(problem(|m| m.cameras[1].name = name.to_owned()), P::Name), "{name}");
    }
    assert!(matches!(problem(|m| m.cameras[0].modality = Modality::Both), P::Modality { events: false, .. }));
    assert!(matches!(problem(|m| m.cameras[2].modality = Modality::Event), P::Modality { frames: 3, .. }));
    assert!(matches!(problem(|m| m.cameras[0].frames.swap(0, 1)), P::Order { index: 1, .. }));
    assert!(matches!(problem(|m| m.span_ns[1] = 66_666_665), P::OutsideSpan { index: 2, .. }));
    assert!(matches!(problem(|m| m.cameras[0].frames[1].exposure_ns.swap(0, 1)), P::Exposure { index: 1, .. }));
    let events = |m: &mut Manifest, change: fn(&mut CameraEvents)| change(m.cameras[1].events.as_mut().unwrap());
    assert!(matches!(problem(|m| events(m, |e| e.covers_ns = [1, 0])), P::CameraEvents { .. }));
    assert!(matches!(problem(|m| m.cameras[2].frames[0].file = layout::image("a", 0)), P::FileTwice(_)));
    assert!(matches!(problem(|m| m.cameras[0].frames[2].file = "images/a/9.png".into()), P::MissingFile(_)));
    assert!(matches!(problem(|m| m.cameras[0].frames[1].mask = Some("no.png".into())), P::MissingFile(_)));
    assert!(matches!(problem(|m| events(m, |e| e.file = "events/no.npz".into())), P::MissingFile(_)));
    assert!(matches!(problem(|m| m.points.as_mut().unwrap().file = "no.ply".into()), P::MissingFile(_)));
}

#[test]
fn files_outside_the_folder_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("ds");
    let mut dataset = some_dataset(&root);
    std::fs::copy(root.join(layout::image("a", 0)), folder.path().join("out.png")).unwrap();
    let outside = [PathBuf::from("../out.png"), folder.path().join("out.png"), PathBuf::from("images/../../out.png")];
    for file in outside.into_iter().chain(["".into()]) {
        dataset.manifest.cameras[0].frames[0].file = file.clone();
        let camera = dataset.manifest.cameras[0].clone();
        let refused = |error| matches!(error, DatasetError::Outside { file: named } if named == file);
        assert!(refused(dataset.validate().unwrap_err()));
        assert!(refused(dataset.read_image(&camera, &camera.frames[0]).unwrap_err()));
        assert!(refused(dataset.hash_files().unwrap_err()));
    }
}

#[test]
fn images_of_another_size_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = some_dataset(folder.path());
    let camera = dataset.camera("c").unwrap();
    for file in [layout::image("c", 1), layout::mask("c", 1)] {
        ImageGrey8::new(8, 7).write_png(&folder.path().join(&file)).unwrap();
        let error = dataset.validate().unwrap_err();
        assert!(matches!(error, DatasetError::ImageSize { found: [8, 7], named: [8, 6], .. }), "{error}");
        assert!(error.to_string().contains("camera c") && error.to_string().contains("00001.png"), "{error}");
    }
    assert!(matches!(dataset.read_image(camera, &camera.frames[1]), Err(DatasetError::ImageSize { .. })));
    assert!(matches!(dataset.read_mask(camera, &camera.frames[1]), Err(DatasetError::ImageSize { .. })));
    std::fs::write(folder.path().join(layout::image("c", 1)), b"no image").unwrap();
    assert!(matches!(dataset.validate(), Err(DatasetError::Image { .. })));
}

#[test]
fn counts_are_compared_with_the_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = some_dataset(folder.path());
    dataset.manifest.cameras[1].events.as_mut().unwrap().count = 3;
    dataset.manifest.points.as_mut().unwrap().count = 9;
    let error = dataset.read_events(&dataset.manifest.cameras[1]).unwrap_err();
    assert!(matches!(error, DatasetError::EventCount { found: 2, named: 3, .. }), "{error}");
    let error = dataset.read_event_pieces(&dataset.manifest.cameras[1], |_| Ok(())).unwrap_err();
    assert!(matches!(error, DatasetError::EventCount { found: 2, named: 3, .. }), "{error}");
    assert!(matches!(dataset.read_points(), Err(DatasetError::PointCount { found: 1, named: 9, .. })));
}

#[test]
fn another_version_and_no_manifest_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(Dataset::load(folder.path()), Err(DatasetError::NotADataset { .. })));
    let dataset = some_dataset(folder.path());
    dataset.save().unwrap();
    let path = folder.path().join("dataset.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("\"version\": 1,", "\"version\": 2, \"new\": true,")).unwrap();
    assert!(matches!(Dataset::load(folder.path()), Err(DatasetError::Version { version: 2, .. })));
    for length in (0..text.trim_end().len()).step_by(31) {
        std::fs::write(&path, &text[..length]).unwrap();
        assert!(matches!(Dataset::load(folder.path()), Err(DatasetError::Json { .. })), "{length}");
    }
}

#[test]
fn saving_leaves_no_temporary_file() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = some_dataset(folder.path());
    dataset.save().unwrap();
    dataset.save().unwrap();
    let hidden = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().starts_with('.');
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().map(Result::unwrap).filter(hidden).count(), 0);
}

proptest! {
    #[test]
    fn every_number_of_a_manifest_comes_back_exactly(
        numbers in prop::array::uniform12(prop::num::f64::NORMAL | prop::num::f64::ZERO | prop::num::f64::SUBNORMAL),
        times in prop::array::uniform4(any::<i64>()),
        seed in any::<u64>(),
        name in "\\PC{0,12}",
        fisheye in any::<bool>(),
    ) {
        let mut camera = some_camera("a", Modality::Both);
        let [a, b, c, d, e, f, g, h, i, j, k, l] = numbers;
        camera.world_to_camera = Pose { rotation: DQuat::from_xyzw(a, b, c, d), translation: DVec3::new(e, f, g) };
        let distortion = if fisheye { Distortion::KannalaBrandt([h, i, j, k]) } else { Distortion::None };
        camera.intrinsics = Intrinsics { fx: i, fy: j, cx: k, cy: l, distortion, ..camera.intrinsics };
        camera.frames[0].t_ns = times[0];
        camera.frames[0].exposure_ns = [times[1], times[2]];
        camera.events.as_mut().unwrap().threshold_on = l;
        let mut manifest = some_manifest();
        manifest.cameras.push(camera);
        manifest.seed = seed;
        manifest.span_ns[1] = times[3];
        manifest.name = name;
        let text = serde_json::to_string_pretty(&manifest).unwrap();
        prop_assert_eq!(serde_json::from_str::<Manifest>(&text).unwrap(), manifest);
    }
}

#[test]
fn the_documented_example_is_a_manifest() {
    let page = include_str!("../../docs/reference/dataset.md");
    let example = page.split("```json\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    let manifest: Manifest = serde_json::from_str(example).unwrap();
    assert_eq!((manifest.format.as_str(), manifest.version), (Manifest::FORMAT, Manifest::VERSION));
    // Nothing in the example is misspelt: each of its fields is one that is written.
    let (documented, written): (serde_json::Value, _) =
        (serde_json::from_str(example).unwrap(), serde_json::to_value(&manifest).unwrap());
    assert_eq!(documented, written);
    for lens in [r#"{"brown_conrady": [1, 2, 3, 4, 5, 6, 7, 8]}"#, r#"{"kannala_brandt": [1, 2, 3, 4]}"#] {
        assert!(serde_json::from_str::<Distortion>(lens).is_ok(), "{lens}");
    }
}
