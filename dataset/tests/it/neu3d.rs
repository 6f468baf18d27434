use super::*;

/// A video of `count` frames of 16 x 8 pixels, each a little brighter than the one before.
fn video(path: &Path, count: u32) {
    let frames: Vec<u8> = (0..count).flat_map(|t| halves(16, 8, 40 + 10 * t as u8, 40 + 10 * t as u8).data).collect();
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
