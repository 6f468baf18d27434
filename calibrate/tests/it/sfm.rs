//! Calibration from images of a small textured room, through COLMAP, which `scripts/setup.sh` installs.

use crate::room as common;

use std::path::Path;

use erfgs_calibrate::{
    colmap::{ColmapProgram, RunError},
    report::page,
    sfm::{
        CameraView, KnownIntrinsics, RegisterOptions, Setting, SfmError, SfmOptions,
        align::{Tolerance, align},
        read_model_views, read_views, register, sfm,
    },
};
use erfgs_dataset::Dataset;
use erfgs_scene::rig_file::{RigCamera, RigFile};
use erfgs_scene::{Modality, Pose, image::ImageGrey8};

/// The room, without the cameras that have no images.
fn room(folder: &Path, count: usize) -> Dataset {
    let mut dataset = common::film_at(folder, count, &[0]);
    dataset.manifest.cameras.truncate(count);
    dataset.manifest.span_ns = [0, 1];
    dataset.save().unwrap();
    dataset
}

fn options() -> SfmOptions {
    // Two are enough in a room where nothing repeats, and larger images would show no more of it.
    let first = Setting { enlarge: 1.25, ..SfmOptions::default().settings[0] };
    let second = Setting { enlarge: 1.0, peak_threshold: 0.004, ..first };
    SfmOptions { settings: vec![first, second], ..SfmOptions::default() }
}

/// How cameras are added, from images as they are.
fn adding() -> RegisterOptions {
    let options = RegisterOptions::default();
    RegisterOptions { setting: Setting { enlarge: 1.0, ..options.setting }, ..options }
}

/// Greatest distance of a camera from where it is, metres, after a similarity; and the similarity's scale.
fn worst(rig: &RigFile, dataset: &Dataset) -> (f64, f64) {
    let found: Vec<Option<Pose>> = rig.cameras.iter().map(|camera| camera.pose).collect();
    let truth: Vec<Option<Pose>> =
        rig.cameras.iter().map(|camera| dataset.camera(&camera.name).map(|c| c.world_to_camera)).collect();
    let over = align(&found, &truth, Tolerance { centre: 1e9, angle: 10.0 }).unwrap();
    let pairs = found.iter().flatten().zip(truth.iter().flatten());
    (pairs.map(|(a, b)| over.similarity.difference(a, b).0).fold(0.0, f64::max), over.similarity.scale)
}

#[test]
fn a_rig_is_found_from_its_images_and_a_camera_is_added_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = room(folder.path(), 7);
    let views = read_views(folder.path(), 0, &KnownIntrinsics::Dataset).unwrap();
    let centre = |index: usize| dataset.manifest.cameras[index].world_to_camera.centre();
    let metres = centre(0).distance(centre(6));
    let options = SfmOptions { scale: Some(("view_0".into(), "view_6".into(), metres)), ..options() };
    let (rig, evidence) = sfm(&views, &options, folder.path(), &|_, _, _| {}).unwrap();
    assert_eq!(rig.cameras.len(), 7);
    assert!(rig.metric && rig.method == "sfm");
    let (worst_m, scale) = worst(&rig, &dataset);
    assert!(worst_m < 0.01, "{worst_m} m");
    assert!((scale - 1.0).abs() < 0.01, "{scale}");
    for camera in &rig.cameras {
        assert!(camera.warnings.is_empty(), "{}: {:?}", camera.name, camera.warnings);
        assert!(camera.rms_px.unwrap() < 0.6 && camera.observations > 60);
    }
    assert_eq!(evidence.tables[1].rows.len(), 7);
    assert!(!evidence.residuals.is_empty() && !evidence.passes.is_empty());
    assert_eq!(evidence.pictures.len(), 7);
    let page = page(&rig, &evidence);
    assert!(page.matches("data:image/jpeg").count() == 7 && page.matches("<use").count() >= 8, "a neighbour for each");

    // The fifth camera is taken out and comes back, in the rig's own frame.
    let mut six = rig.clone();
    let taken = six.cameras.remove(4);
    let model = read_model_views(folder.path(), 0, &six).unwrap();
    assert_eq!(model.len(), 6);
    let new = [views[4].clone()];
    let (seven, evidence) = register(&six, &model, &new, &adding(), folder.path(), &|_, _, _| {}).unwrap();
    let back = seven.camera("view_4").unwrap();
    let apart = back.pose.unwrap().centre().distance(taken.pose.unwrap().centre());
    assert!(apart < 0.01, "{apart} m");
    assert_eq!(evidence.pictures.iter().map(|picture| picture.camera).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
    assert_eq!(seven.cameras[..6], six.cameras[..], "the others stay");

    // An image of something else is not registered anywhere.
    let noise = |index: u64| (erfgs_base::random::key(3, &[index]) >> 56) as u8;
    let mut other = views[4].clone();
    other.image.data = (0..other.image.data.len() as u64).map(|index| noise(index / 7)).collect();
    let refused = register(&six, &model[1..5], &[other], &adding(), folder.path(), &|_, _, _| {});
    assert!(matches!(refused, Err(SfmError::Unregistered { .. })), "{:?}", refused.map(|(rig, _)| rig.cameras.len()));
}

#[test]
fn unknown_intrinsics_are_found_with_the_poses() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = room(folder.path(), 7);
    let views = read_views(folder.path(), 0, &KnownIntrinsics::Unknown).unwrap();
    let (rig, _) = sfm(&views, &options(), folder.path(), &|_, _, _| {}).unwrap();
    assert!(!rig.metric);
    let (worst_m, _) = worst(&rig, &dataset);
    assert!(worst_m < 0.15, "{worst_m} m");
    for camera in &rig.cameras {
        let focal = camera.intrinsics.fx;
        assert!((focal / 230.0 - 1.0).abs() < 0.1, "{}: {focal}", camera.name);
        assert!(camera.sigma.as_ref().unwrap().intrinsics.contains_key("fx"));
    }
}

#[test]
fn images_of_nothing_are_refused_and_so_is_what_does_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, width: u32| {
        let mut image = ImageGrey8::new(width, 40);
        image.data.iter_mut().enumerate().for_each(|(index, value)| *value = (index % 251) as u8);
        image.write_png(&folder.path().join(name)).unwrap();
    };
    write("a.png", 60);
    write("b.png", 60);
    let few = read_views(folder.path(), 0, &KnownIntrinsics::Unknown).unwrap_err();
    assert!(matches!(few, SfmError::TooFewViews { found: 2, .. }), "{few}");
    write("c.png", 64);
    let views: Vec<CameraView> = read_views(folder.path(), 0, &KnownIntrinsics::Unknown).unwrap();
    assert_eq!(views.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c"]);

    let k = erfgs_scene::Intrinsics {
        width: 60,
        height: 40,
        fx: 50.0,
        fy: 50.0,
        cx: 30.0,
        cy: 20.0,
        distortion: erfgs_scene::Distortion::None,
    };
    let camera = |name: &str| RigCamera::new(name, Modality::Rgb, k, None);
    let rig = RigFile::new("board", true, vec![camera("a"), camera("b"), camera("c")]);
    let size = read_views(folder.path(), 0, &KnownIntrinsics::Rig(&rig, Path::new("r.json"))).unwrap_err().to_string();
    assert!(size.contains("camera c") && size.contains("64 x 40"), "{size}");
    let rig = RigFile::new("board", true, vec![camera("a"), camera("b")]);
    let missing =
        read_views(folder.path(), 0, &KnownIntrinsics::Rig(&rig, Path::new("r.json"))).unwrap_err().to_string();
    assert!(missing.contains("camera c") && missing.contains("r.json"), "{missing}");

    let program = ColmapProgram::Binary("no/such/colmap".into());
    let options = SfmOptions { colmap: program, ..SfmOptions::default() };
    let missing = sfm(&views, &options, folder.path(), &|_, _, _| {}).unwrap_err();
    assert!(matches!(missing, SfmError::Colmap(RunError::Missing { .. })), "{missing}");
    let options = SfmOptions { scale: Some(("a".into(), "x".into(), 1.0)), ..SfmOptions::default() };
    let scale = sfm(&views, &options, folder.path(), &|_, _, _| {}).unwrap_err().to_string();
    assert!(scale.contains("'x'") && scale.contains("a, b, c"), "{scale}");
    let none = sfm(&views, &SfmOptions::default(), folder.path(), &|_, _, _| {}).unwrap_err();
    assert!(matches!(none, SfmError::NoModel { views: 3, .. }), "{none}");
}
