//! Recordings in each layout, made here, are imported and compared with what they were made from; recordings with
//! something wrong are refused by a message that names file and camera.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use erfgs_base::npy;
use erfgs_dataset::{
    Camera, Dataset, DatasetError, Split,
    import::{ImportError, ImportOptions, Imported, Layout, import},
};
use erfgs_recordings::shared;
use erfgs_scene::{
    Distortion, ImageGrey8, ImageRgb8, Intrinsics, Modality, Pose,
    colmap::{ColmapCamera, ColmapImage, Model, Point3d},
    exchange::{self, Format},
    image::{Reading, Resample},
    rig_file::{RigCamera, RigFile},
};
use glam::{DMat3, DVec3};
use serde_json::{Value, json};

mod colmap;
mod export;
mod left_open;
mod nerfstudio;
mod neu3d;
mod panoptic;

/// An image whose left half is `left` and whose right half is `right` grey.
fn halves(width: u32, height: u32, left: u8, right: u8) -> ImageRgb8 {
    let mut image = ImageRgb8::new(width, height);
    for (index, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        pixel.fill(if (index as u32 % width) < width / 2 { left } else { right });
    }
    image
}

fn write(path: PathBuf, image: &ImageRgb8) {
    image.write_png(&path).unwrap();
}

/// The pose of camera `number` of every recording here: on a circle, looking at the origin, y down.
fn pose(number: u64) -> Pose {
    let angle = number as f64 * 0.7;
    Pose::look_at(DVec3::new(3.0 * angle.cos(), -1.0, 3.0 * angle.sin()), DVec3::ZERO, DVec3::Y)
}

fn close(a: &Pose, b: &Pose) -> bool {
    (a.rotation.dot(b.rotation).abs() - 1.0).abs() < 1e-12 && a.translation.distance(b.translation) < 1e-12
}

fn run(layout: Layout, source: &Path, options: &ImportOptions, out: &Path) -> Result<Dataset, ImportError> {
    import(layout, source, options, out, &mut |_| {}).map(|imported| imported.dataset)
}

/// The notes of an import, one in a line.
fn notes(layout: Layout, source: &Path, options: &ImportOptions) -> String {
    let folder = tempfile::tempdir().unwrap();
    let Imported { notes, .. } = import(layout, source, options, &folder.path().join("ds"), &mut |_| {}).unwrap();
    notes.join("\n")
}

/// The message of an import that must fail, and must leave nothing behind.
fn refused(layout: Layout, source: &Path, options: &ImportOptions) -> String {
    let folder = tempfile::tempdir().unwrap();
    let error = run(layout, source, options, &folder.path().join("ds")).unwrap_err();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "something is left behind");
    error.to_string()
}

fn grey(dataset: &Dataset, camera: &Camera, frame: usize) -> [u8; 2] {
    let image = dataset.read_image(camera, &camera.frames[frame]).unwrap();
    [image.pixel(0, 0)[0], image.pixel(image.width - 1, 0)[0]]
}

fn splits(dataset: &Dataset) -> Vec<(&str, Split)> {
    dataset.manifest.cameras.iter().map(|camera| (camera.name.as_str(), camera.split)).collect()
}

/// LLFF's rows for cameras of 16 x 8 pixels.
fn poses_bounds(numbers: &[u64]) -> Vec<u8> {
    let mut values = Vec::new();
    for &number in numbers {
        let to_world = pose(number).inverse();
        let rotation = DMat3::from_quat(to_world.rotation);
        let columns = [rotation.y_axis, rotation.x_axis, -rotation.z_axis, to_world.translation];
        for (row, last) in [8.0, 16.0, 20.0 + number as f64].into_iter().enumerate() {
            values.extend(columns.map(|column| column[row]));
            values.push(last);
        }
        values.extend([0.1, 10.0]);
    }
    npy::encode(&[numbers.len(), 17], values.into_iter())
}

#[test]
fn nvidia_scenes_are_read_by_time_and_camera() {
    let folder = tempfile::tempdir().unwrap();
    let dense = folder.path().join("dense");
    for t in 0..3_u8 {
        for camera in 1..=5_u8 {
            write(dense.join(format!("mv_images/{t:05}/cam{camera:02}.jpg")), &halves(16, 8, t, camera));
        }
        let mut mask = ImageGrey8::new(16, 8);
        mask.data[0] = 1;
        mask.write_png(&dense.join(format!("mv_masks/{t:05}/cam02.png"))).unwrap();
    }
    // The packaging's poses go round the cameras twice.
    let poses = dense.join("poses_bounds.npy");
    std::fs::write(&poses, poses_bounds(&[1, 2, 3, 4, 5, 1, 2, 3, 4, 5])).unwrap();
    let options = ImportOptions { frames: Some((1, 2)), ..Default::default() };
    let dataset = run(Layout::Nvidia, folder.path(), &options, &folder.path().join("ds")).unwrap();
    let test: Vec<&str> = dataset.cameras(Split::Test).map(|camera| camera.name.as_str()).collect();
    assert_eq!((dataset.manifest.cameras.len(), test), (5, vec!["cam04"]));
    for (camera, number) in dataset.manifest.cameras.iter().zip(1..) {
        assert!(close(&camera.world_to_camera, &pose(number)));
        assert_eq!(grey(&dataset, camera, 1), [2, number as u8]);
        assert_eq!(camera.frames[1].t_ns, 66_666_667);
        let mask = dataset.read_mask(camera, &camera.frames[0]).unwrap();
        assert_eq!(mask.map(|mask| mask.data[..2].to_vec()), (number == 2).then(|| vec![255, 0]));
    }

    let notes = notes(Layout::Nvidia, folder.path(), &options);
    assert!(notes.contains("bounds"), "{notes}");

    let message = || refused(Layout::Nvidia, folder.path(), &options);
    std::fs::write(&poses, poses_bounds(&[1, 2, 3, 4, 5, 1, 2, 9, 4, 5])).unwrap();
    assert!(message().contains("camera cam03") && message().contains("differ"), "{}", message());
    std::fs::write(&poses, poses_bounds(&[1, 2, 3, 4])).unwrap();
    assert!(message().contains("4 poses, but there are 5 cameras"), "{}", message());
    std::fs::write(&poses, poses_bounds(&[1, 2, 3, 4, 5])).unwrap();
    std::fs::remove_file(dense.join("mv_images/00002/cam03.jpg")).unwrap();
    assert!(message().contains("camera cam03") && message().contains("00002"), "{}", message());
}

#[test]
fn the_real_panoptic_recording_is_imported() {
    let Some(source) = shared("data/panoptic_basketball") else { return };
    let folder = tempfile::tempdir().unwrap();
    let options = ImportOptions { frames: Some((40, 41)), scale: Some(0.5), ..Default::default() };
    let dataset = run(Layout::Panoptic, &source, &options, &folder.path().join("ds")).unwrap();
    assert_eq!(dataset.manifest.cameras.len(), 31);
    let test: Vec<&str> = dataset.cameras(Split::Test).map(|camera| camera.name.as_str()).collect();
    assert_eq!(test, ["cam00", "cam10", "cam15", "cam30"]);
    let camera = dataset.camera("cam01").unwrap();
    let Intrinsics { width, height, cx, .. } = camera.intrinsics;
    assert!((width, height) == (320, 180) && (cx - 318.337_333_333_333_3 / 2.0).abs() < 1e-9);
    assert!(camera.frames.iter().all(|frame| frame.mask.is_some()));
    // All cameras stand on the dome of 5.5 m diameter and look inwards, at the middle of the room.
    for camera in &dataset.manifest.cameras {
        let middle = DVec3::new(0.0, -1.2, 0.0);
        let distance = camera.world_to_camera.centre().distance(middle);
        assert!((2.5..3.0).contains(&distance), "{}: {distance} m", camera.name);
        let seen = camera.intrinsics.project_pinhole(camera.world_to_camera.transform(middle));
        assert!((0.0..320.0).contains(&seen.x) && (0.0..180.0).contains(&seen.y), "{}: {seen}", camera.name);
    }
    let message = refused(Layout::Panoptic, &source, &ImportOptions::default());
    assert!(message.contains("--frames 40..84"), "{message}");
}
