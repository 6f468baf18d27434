//! Recordings in each layout, made here, are imported and compared with what they were made from; recordings with
//! something wrong are refused by a message that names file and camera.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use erfgs_session::{
    Camera, Dataset, Distortion, ImageGrey8, ImageRgb8, Intrinsics, Pose, Split,
    colmap::{ColmapCamera, ColmapImage, Model},
    dataset::DatasetError,
    image::Resample,
    import::{ImportError, ImportOptions, Layout, import},
    npy,
};
use glam::{DMat3, DVec3};
use serde_json::{Value, json};

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
    import(layout, source, options, out, &mut |_| {})
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

mod panoptic {
    use super::*;

    fn meta(ids: &[u64]) -> Value {
        let matrix = |id: u64| {
            let rows = pose(id).matrix().transpose().to_cols_array_2d();
            json!(rows)
        };
        let k = |id: u64| json!([[20.0 + id as f64, 0.0, 7.5], [0.0, 21.0, 4.25], [0.0, 0.0, 1.0]]);
        let rows = |of: &dyn Fn(u64, u64) -> Value| -> Value {
            (10..14).map(|t| ids.iter().map(|&id| of(t, id)).collect::<Value>()).collect()
        };
        json!({
            "w": 16, "h": 8,
            "k": rows(&|_, id| k(id)),
            "w2c": rows(&|_, id| matrix(id)),
            "fn": rows(&|t, id| json!(format!("{id}/{t:06}.jpg"))),
            "cam_id": rows(&|_, id| json!(id)),
        })
    }

    fn recording(root: &Path) {
        for (name, ids) in [("train_meta.json", &[1, 12][..]), ("test_meta.json", &[0])] {
            std::fs::write(root.join(name), meta(ids).to_string()).unwrap();
            for id in ids {
                for t in 10..14_u8 {
                    // The layout calls them .jpg; the content decides.
                    write(root.join(format!("ims/{id}/{t:06}.jpg")), &halves(16, 8, t, 100 + *id as u8));
                    if *id != 0 {
                        let mut mask = ImageGrey8::new(16, 8);
                        mask.data.iter_mut().enumerate().for_each(|(i, value)| *value = u8::from(i % 16 >= 8));
                        mask.write_png(&root.join(format!("seg/{id}/{t:06}.png"))).unwrap();
                    }
                }
            }
        }
    }

    fn change(root: &Path, file: &str, change: impl FnOnce(&mut Value)) {
        let path = root.join(file);
        let mut value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        change(&mut value);
        // A string of this kind stands for Python's bare word.
        std::fs::write(path, value.to_string().replace("\"BARE NaN\"", "NaN")).unwrap();
    }

    #[test]
    fn frames_cameras_masks_and_times_are_imported() {
        let folder = tempfile::tempdir().unwrap();
        recording(folder.path());
        let options = ImportOptions { frames: Some((11, 13)), scale: Some(0.5), jobs: Some(2), ..Default::default() };
        let (mut done, mut total) = (0, 0);
        let out = folder.path().join("ds");
        let dataset = import(Layout::Panoptic, folder.path(), &options, &out, &mut |progress| {
            assert_eq!(progress.done, done + 1);
            (done, total) = (progress.done, progress.total);
        })
        .unwrap();
        assert_eq!((done, total), (9, 9));
        assert_eq!(Dataset::load(&out).unwrap(), dataset);
        dataset.verify().unwrap();
        assert_eq!(splits(&dataset), [("cam00", Split::Test), ("cam01", Split::Train), ("cam12", Split::Train)]);
        assert_eq!(dataset.manifest.span_ns, [0, 66_666_667]);
        assert_eq!(dataset.manifest.provenance.options["frames"], json!([11, 13]));
        for (camera, id) in dataset.manifest.cameras.iter().zip([0, 1, 12]) {
            let expected = Intrinsics {
                width: 8,
                height: 4,
                fx: (20.0 + id as f64) / 2.0,
                fy: 10.5,
                cx: 3.75,
                cy: 2.125,
                distortion: Distortion::None,
            };
            assert_eq!(camera.intrinsics, expected);
            assert!(close(&camera.world_to_camera, &pose(id)));
            assert_eq!(camera.frames.iter().map(|frame| frame.t_ns).collect::<Vec<_>>(), [0, 33_333_333, 66_666_667]);
            assert_eq!(grey(&dataset, camera, 2), [13, 100 + id as u8]);
            let mask = dataset.read_mask(camera, &camera.frames[1]).unwrap();
            assert_eq!(
                mask.map(|mask| mask.data[..8].to_vec()),
                (id != 0).then(|| vec![0, 0, 0, 0, 255, 255, 255, 255])
            );
        }
    }

    #[test]
    fn test_cameras_are_chosen_by_name_or_number() {
        let folder = tempfile::tempdir().unwrap();
        recording(folder.path());
        let test_cameras = Some(vec!["cam01".to_owned(), "12".to_owned()]);
        let mut options = ImportOptions { test_cameras, resample: Resample::Lanczos, ..Default::default() };
        let dataset = run(Layout::Panoptic, folder.path(), &options, &folder.path().join("ds")).unwrap();
        assert_eq!(splits(&dataset), [("cam00", Split::Train), ("cam01", Split::Test), ("cam12", Split::Test)]);
        options.test_cameras = Some(vec!["cam02".to_owned()]);
        let message = refused(Layout::Panoptic, folder.path(), &options);
        assert!(message.contains("cam02") && message.contains("cam00, cam01, cam12"), "{message}");
    }

    #[test]
    fn a_dataset_is_not_written_over() {
        let folder = tempfile::tempdir().unwrap();
        recording(folder.path());
        let error = run(Layout::Panoptic, folder.path(), &ImportOptions::default(), folder.path()).unwrap_err();
        assert!(matches!(error, ImportError::Dataset(DatasetError::OutputExists { .. })), "{error}");
        let empty = folder.path().join("empty");
        std::fs::create_dir(&empty).unwrap();
        run(Layout::Panoptic, folder.path(), &ImportOptions::default(), &empty).unwrap();
        assert!(empty.join("dataset.json").is_file());
    }

    #[test]
    fn what_is_wrong_is_named_with_file_and_camera() {
        let spoilt = |spoil: &dyn Fn(&Path), options: &ImportOptions| {
            let folder = tempfile::tempdir().unwrap();
            recording(folder.path());
            spoil(folder.path());
            refused(Layout::Panoptic, folder.path(), options)
        };
        let all = ImportOptions::default();
        let names = |message: String, words: &[&str]| {
            assert!(words.iter().all(|word| message.contains(word)), "{message}");
        };
        names(spoilt(&|root| std::fs::remove_file(root.join("test_meta.json")).unwrap(), &all), &["test_meta.json"]);
        let missing = |root: &Path| std::fs::remove_file(root.join("ims/12/000010.jpg")).unwrap();
        names(spoilt(&missing, &all), &["camera cam12", "ims/12/000010.jpg", "--frames 11..13"]);
        let missing = |root: &Path| std::fs::remove_file(root.join("seg/1/000012.png")).unwrap();
        names(spoilt(&missing, &all), &["camera cam01", "seg/1/000012.png"]);
        let cut = |root: &Path| {
            let path = root.join("ims/1/000013.jpg");
            let bytes = std::fs::read(&path).unwrap();
            std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
        };
        names(spoilt(&cut, &all), &["camera cam01", "ims/1/000013.jpg"]);
        let small = |root: &Path| write(root.join("ims/1/000012.jpg"), &halves(16, 9, 0, 0));
        names(spoilt(&small, &all), &["camera cam01", "ims/1/000012.jpg", "16 x 9"]);

        let train = |spoil: fn(&mut Value)| spoilt(&|root| change(root, "train_meta.json", spoil), &all);
        let nan = |meta: &mut Value| (0..4).for_each(|t| meta["w2c"][t][1][1][3] = json!("BARE NaN"));
        names(train(nan), &["camera cam12", "train_meta.json", "not finite"]);
        names(train(|meta| meta["w2c"][2][0][0][3] = json!(9.0)), &["camera cam01", "moves", "frame 12"]);
        names(train(|meta| drop(meta["k"].as_array_mut().unwrap().pop())), &["train_meta.json", "[3, 4, 4, 4]"]);
        names(train(|meta| drop(meta["fn"][1].as_array_mut().unwrap().pop())), &["[2, 2, 1, 2]", "frame 1"]);
        names(train(|meta| (0..4).for_each(|t| meta["cam_id"][t][0] = json!(0))), &["camera cam00", "for testing"]);
        names(train(|meta| meta["cam_id"][3][0] = json!(5)), &["camera cam01", "frame 13 is missing"]);
        names(train(|meta| (0..4).for_each(|t| meta["k"][t][0][0][0] = json!(-4))), &["camera cam01", "no pinhole"]);
        let sheared = |meta: &mut Value| (0..4).for_each(|t| meta["w2c"][t][0][0][0] = json!(2.0));
        names(train(sheared), &["camera cam01", "no rotation"]);

        let with = |options: ImportOptions| spoilt(&|_| (), &options);
        names(with(ImportOptions { frames: Some((9, 12)), ..all.clone() }), &["9..12", "10..13"]);
        names(with(ImportOptions { frames: Some((12, 11)), ..all.clone() }), &["backwards"]);
        names(with(ImportOptions { fps: Some(0.0), ..all.clone() }), &["--fps"]);
        names(with(ImportOptions { scale: Some(f64::NAN), ..all.clone() }), &["--scale"]);
    }
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

mod neu3d {
    use super::*;

    /// A video of `count` frames of 16 x 8 pixels, each a little brighter than the one before.
    fn video(path: &Path, count: u32) {
        let frames: Vec<u8> =
            (0..count).flat_map(|t| halves(16, 8, 40 + 10 * t as u8, 40 + 10 * t as u8).data).collect();
        let raw = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(raw.path(), frames).unwrap();
        let status = Command::new("ffmpeg")
            .args(["-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "16x8", "-r", "30", "-i"])
            .arg(raw.path())
            .args(["-c:v", "mpeg4", "-q:v", "1"])
            .arg(path)
            .status()
            .expect("ffmpeg is installed by scripts/setup.sh");
        assert!(status.success());
    }

    #[test]
    fn videos_are_decoded_with_their_own_poses() {
        let folder = tempfile::tempdir().unwrap();
        // Camera 1 was taken out of the recording: rows follow the names that are left.
        for number in [0, 2] {
            video(&folder.path().join(format!("cam{number:02}.mp4")), 6);
        }
        std::fs::write(folder.path().join("poses_bounds.npy"), poses_bounds(&[0, 2])).unwrap();
        let options = ImportOptions { frames: Some((2, 4)), ..Default::default() };
        let dataset = run(Layout::Neu3d, folder.path(), &options, &folder.path().join("ds")).unwrap();
        assert_eq!(splits(&dataset), [("cam00", Split::Test), ("cam02", Split::Train)]);
        for (camera, number) in dataset.manifest.cameras.iter().zip([0, 2]) {
            assert!(close(&camera.world_to_camera, &pose(number)), "{:?}", camera.world_to_camera);
            let Intrinsics { fx, fy, cx, cy, .. } = camera.intrinsics;
            assert_eq!([fx, fy, cx, cy], [20.0 + number as f64, 20.0 + number as f64, 8.0, 4.0]);
            assert_eq!(camera.frames.iter().map(|frame| frame.t_ns).collect::<Vec<_>>(), [0, 33_333_333, 66_666_667]);
            for index in 0..3 {
                let [value, _] = grey(&dataset, camera, index);
                assert!(value.abs_diff(60 + 10 * index as u8) <= 3, "frame {index} is {value}");
            }
        }
        let message = refused(Layout::Neu3d, folder.path(), &ImportOptions { frames: Some((4, 6)), ..options.clone() });
        assert!(message.contains("camera cam0") && message.contains("6 (0..5)"), "{message}");

        video(&folder.path().join("cam02.mp4.new.mp4"), 5);
        std::fs::rename(folder.path().join("cam02.mp4.new.mp4"), folder.path().join("cam02.mp4")).unwrap();
        let message = refused(Layout::Neu3d, folder.path(), &ImportOptions::default());
        assert!(message.contains("camera cam02") && message.contains("has 5 frames"), "{message}");
        std::fs::write(folder.path().join("cam02.mp4"), b"no video").unwrap();
        let message = refused(Layout::Neu3d, folder.path(), &ImportOptions::default());
        assert!(message.contains("camera cam02: ffmpeg cannot decode"), "{message}");
    }

    #[test]
    fn folders_of_images_are_taken_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for (camera, inner) in [("cam00", "images/"), ("cam01", "")] {
            for t in 0..11_u8 {
                // Half the size of the poses, and names whose order is not that of the alphabet.
                write(folder.path().join(format!("{camera}/{inner}{t}.png")), &halves(8, 4, t, 2 * t));
            }
        }
        let poses = folder.path().join("poses_bounds.npy");
        std::fs::write(&poses, poses_bounds(&[0, 1])).unwrap();
        let dataset = run(Layout::Neu3d, folder.path(), &ImportOptions::default(), &folder.path().join("ds")).unwrap();
        let camera = dataset.camera("cam01").unwrap();
        assert_eq!((camera.frames.len(), grey(&dataset, camera, 10)), (11, [10, 20]));
        assert_eq!(
            camera.intrinsics,
            Intrinsics { width: 8, height: 4, fx: 10.5, fy: 10.5, cx: 4.0, cy: 2.0, distortion: Distortion::None }
        );
        std::fs::remove_dir_all(folder.path().join("ds")).unwrap();

        let message = || refused(Layout::Neu3d, folder.path(), &ImportOptions::default());
        std::fs::write(&poses, poses_bounds(&[0, 1, 2])).unwrap();
        assert!(message().contains("3 poses, but there are 2 cameras (cam00, cam01)"), "{}", message());
        let whole = poses_bounds(&[0, 1]);
        for length in 0..whole.len() {
            std::fs::write(&poses, &whole[..length]).unwrap();
            assert!(message().contains("poses_bounds.npy"), "{}", message());
        }
        let mut nan = whole.clone();
        let row = whole.len() - 17 * 8;
        nan[row..row + 8].copy_from_slice(&f64::NAN.to_le_bytes());
        std::fs::write(&poses, nan).unwrap();
        assert!(message().contains("camera cam01") && message().contains("not finite"), "{}", message());
        std::fs::remove_file(folder.path().join("cam01/7.png")).unwrap();
        std::fs::write(&poses, whole).unwrap();
        assert!(message().contains("camera cam01") && message().contains("10 images"), "{}", message());
        std::fs::remove_file(&poses).unwrap();
        assert!(message().contains("poses_bounds.npy is missing"), "{}", message());
    }
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

    let message = || refused(Layout::Nvidia, folder.path(), &options);
    std::fs::write(&poses, poses_bounds(&[1, 2, 3, 4, 5, 1, 2, 9, 4, 5])).unwrap();
    assert!(message().contains("camera cam03") && message().contains("differ"), "{}", message());
    std::fs::write(&poses, poses_bounds(&[1, 2, 3, 4])).unwrap();
    assert!(message().contains("4 poses, but there are 5 cameras"), "{}", message());
    std::fs::write(&poses, poses_bounds(&[1, 2, 3, 4, 5])).unwrap();
    std::fs::remove_file(dense.join("mv_images/00002/cam03.jpg")).unwrap();
    assert!(message().contains("camera cam03") && message().contains("00002"), "{}", message());
}

mod nerfstudio {
    use super::*;

    fn frame(file: &str, camera: u64, extra: Value) -> Value {
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
        let has =
            |message: String, word: &str| assert!(message.contains("a.png") && message.contains(word), "{message}");
        has(message(one(json!({ "cx": "BARE NaN" }))), "not finite");
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
}

mod colmap {
    use super::*;

    fn intrinsics() -> Intrinsics {
        let distortion = Distortion::BrownConrady([0.1, -0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        Intrinsics { width: 16, height: 8, fx: 20.0, fy: 21.0, cx: 7.0, cy: 4.5, distortion }
    }

    fn model(names: &[(&str, u64)]) -> Model {
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
}

#[test]
fn the_real_panoptic_recording_is_imported() {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let shared = std::env::var_os("ERFGS_SHARED").map_or_else(|| workspace.join("../shared"), PathBuf::from);
    let source = shared.join("data/panoptic_basketball");
    if !source.is_dir() {
        eprintln!("{} is not there: nothing to compare with", source.display());
        return;
    }
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
