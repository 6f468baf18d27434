//! What a recording leaves open is asked for or said, and what it says is taken.

use super::*;

/// A video of frames of 16 x 8 pixels at this rate; `keep` chooses frames by ffmpeg's expression and leaves their times.
fn video(path: &Path, frames: u8, rate: &str, keep: &str) {
    let raw = tempfile::NamedTempFile::new().unwrap();
    let pixels: Vec<u8> = (0..frames).flat_map(|t| halves(16, 8, 40 + 5 * t, 40 + 5 * t).data).collect();
    std::fs::write(raw.path(), pixels).unwrap();
    let status = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "16x8", "-r", rate, "-i"])
        .arg(raw.path())
        .args(["-vf", &format!("select='{keep}'"), "-vsync", "vfr", "-c:v", "mpeg4", "-q:v", "1", "-bf", "2"])
        .arg(path)
        .status()
        .expect("ffmpeg is installed by scripts/setup.sh");
    assert!(status.success());
}

fn times(dataset: &Dataset, camera: usize) -> Vec<i64> {
    dataset.manifest.cameras[camera].frames.iter().map(|frame| (frame.t_ns + 500) / 1000).collect()
}

#[test]
fn frames_of_videos_are_where_the_videos_say() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path();
    std::fs::write(source.join("poses_bounds.npy"), poses_bounds(&[0, 1])).unwrap();
    let both = |a: [&str; 2], b: [&str; 2]| {
        video(&source.join("cam00.mp4"), 12, a[0], a[1]);
        video(&source.join("cam01.mp4"), 12, b[0], b[1]);
    };
    let import = |options: &ImportOptions| {
        let out = tempfile::tempdir().unwrap();
        run(Layout::Neu3d, source, options, &out.path().join("ds"))
    };
    let given = ImportOptions { fps: Some(20.0), ..Default::default() };
    for (rate, step_ns) in [
        ("60", 1e9 / 60.0),
        ("15", 1e9 / 15.0),
        ("30000/1001", 1001e6 / 30.0),
        ("25", 4e7),
        ("120", 1e9 / 120.0),
        ("1", 1e9),
    ] {
        both([rate, "1"], [rate, "1"]);
        let dataset = import(&ImportOptions::default()).unwrap();
        for camera in 0..2 {
            let expected: Vec<i64> = (0..12).map(|n| ((n as f64 * step_ns).round() as i64 + 500) / 1000).collect();
            assert_eq!(times(&dataset, camera), expected, "{rate}");
        }
        assert!(notes(Layout::Neu3d, source, &ImportOptions::default()).contains("as the videos say"));
        assert_eq!(times(&import(&given).unwrap(), 1)[1], 50_000, "--fps overrules");
    }
    // Frames 3, 4 and 7 are missing, and the times of the others are kept.
    let uneven = ["30", "not(eq(n,3)+eq(n,4)+eq(n,7))"];
    both(uneven, uneven);
    let dataset = import(&ImportOptions::default()).unwrap();
    assert_eq!(times(&dataset, 1), [0, 33_333, 66_667, 166_667, 200_000, 266_667, 300_000, 333_333, 366_667]);
    let part = import(&ImportOptions { frames: Some((2, 4)), ..Default::default() }).unwrap();
    assert_eq!(times(&part, 0), [0, 100_000, 133_333]);
    for (a, b) in [(["60", "1"], ["30", "1"]), (["30", "1"], ["29", "1"]), (uneven, ["30", "lt(n,9)"])] {
        both(a, b);
        let message = refused(Layout::Neu3d, source, &ImportOptions::default());
        assert!(message.contains("camera cam01") && message.contains("--fps"), "{message}");
        import(&given).unwrap();
    }
    // Folders of frames have the times of the videos that lie beside them.
    both(["50", "1"], ["50", "1"]);
    for (camera, t) in (0..2).flat_map(|camera| (0..12_u8).map(move |t| (camera, t))) {
        write(source.join(format!("cam0{camera}/{t}.png")), &halves(16, 8, t, t));
    }
    assert_eq!(times(&import(&ImportOptions::default()).unwrap(), 0)[1], 20_000);
    for camera in 0..2 {
        std::fs::remove_file(source.join(format!("cam0{camera}.mp4"))).unwrap();
    }
    assert_eq!(times(&import(&ImportOptions::default()).unwrap(), 0)[1], 33_333);
    let text = notes(Layout::Neu3d, source, &ImportOptions::default());
    assert!(text.contains("cam00 and 1 others: 12 frames") && text.contains("0.png, 1.png, ... 11.png"), "{text}");
    assert!(text.contains("30 frames a second are assumed, --fps"), "{text}");
}

/// Names of frames as recorders and tools make them.
const NAMES: [fn(u8) -> String; 5] = [
    |n| format!("{}.{:06}", 1_305_031_102 + u32::from(n) / 4, 100_000 + u32::from(n) % 4 * 250_000),
    |n| format!("img_2024-05-01_12-00-{:02}-{:03}", n / 4, u32::from(n) % 4 * 250),
    |n| format!("frame{n}_cam2"),
    |n| format!("{n}"),
    |n| format!("{n:05}_v3"),
];

#[test]
fn frames_are_in_the_order_of_all_numbers_in_their_names_in_every_layout() {
    for name in NAMES {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path();
        let mut list = Vec::new();
        for t in (0..12_u8).rev() {
            for camera in 0..2 {
                let image = halves(16, 8, 10 * t, 10 * t);
                write(source.join(format!("cam0{camera}/{}.png", name(t))), &image);
                write(source.join(format!("images/cam0{camera}/{}.png", name(t))), &image);
                write(source.join(format!("mv_images/{}/cam0{camera}.png", name(t))), &image);
                list.push(nerfstudio::frame(&format!("cam0{camera}/{}.png", name(t)), camera, json!({})));
            }
        }
        std::fs::write(source.join("poses_bounds.npy"), poses_bounds(&[0, 1])).unwrap();
        std::fs::write(source.join("transforms.json"), json!({ "fl_x": 20.0, "frames": list }).to_string()).unwrap();
        let first = [0, 1].map(|camera| format!("cam0{camera}/{}.png", name(0)));
        let names = [(first[0].as_str(), 0), (first[1].as_str(), 1)];
        colmap::model(&names).write_binary(&source.join("sparse/0")).unwrap();
        for layout in [Layout::Neu3d, Layout::Nvidia, Layout::Nerfstudio, Layout::Colmap] {
            let out = source.join("ds");
            let dataset = run(layout, source, &ImportOptions::default(), &out).unwrap();
            for camera in &dataset.manifest.cameras {
                let found: Vec<u8> = (0..12).map(|frame| grey(&dataset, camera, frame)[0]).collect();
                assert_eq!(found, (0..12).map(|t| 10 * t).collect::<Vec<u8>>(), "{layout:?} {}", name(1));
            }
            if name(1).starts_with("130") || name(1).starts_with("img_2024") {
                let quarters: Vec<i64> = (0..12).map(|t| 250_000 * t).collect();
                assert_eq!(times(&dataset, 1), quarters, "{layout:?} {}", name(1));
            }
            std::fs::remove_dir_all(out).unwrap();
            let text = notes(layout, source, &ImportOptions::default());
            let last = format!("... {}", name(11));
            assert!(text.contains(&name(0)) && text.contains(&last) && text.contains("frames a second"), "{text}");
        }
    }
}

#[test]
fn frames_that_lack_by_their_numbers_are_not_closed_up_and_cameras_that_tell_other_times_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path();
    std::fs::write(source.join("poses_bounds.npy"), poses_bounds(&[0, 1])).unwrap();
    let both = |names: [&[&str]; 2]| {
        for (camera, names) in ["cam00", "cam01"].into_iter().zip(names) {
            let _ = std::fs::remove_dir_all(source.join(camera));
            for name in names {
                write(source.join(format!("{camera}/{name}.png")), &halves(16, 8, 1, 2));
            }
        }
    };
    let without_4 = ["f_1", "f_2", "f_3", "f_5", "f_6"].as_slice();
    both([without_4, without_4]);
    let plain = ImportOptions::default();
    let given = ImportOptions { fps: Some(20.0), ..Default::default() };
    let import = |options: &ImportOptions| {
        let out = tempfile::tempdir().unwrap();
        run(Layout::Neu3d, source, options, &out.path().join("ds"))
    };
    assert_eq!(times(&import(&plain).unwrap(), 1), [0, 33_333, 66_667, 133_333, 166_667]);
    assert_eq!(times(&import(&given).unwrap(), 1), [0, 50_000, 100_000, 200_000, 250_000]);
    assert!(notes(Layout::Neu3d, source, &plain).contains("1 are missing by the numbers in their names"));
    both([without_4, &["f_1", "f_2", "f_4", "f_5", "f_6"]]);
    let message = refused(Layout::Neu3d, source, &plain);
    assert!(message.contains("camera cam01") && message.contains("not those of camera cam00"), "{message}");
    // A camera that began a frame later, and one of another rate.
    let at_10 = ["1305031102.1", "1305031102.2", "1305031102.3"].as_slice();
    for other in [&["1305031102.2", "1305031102.3", "1305031102.4"], &["1305031102.1", "1305031102.3", "1305031102.5"]]
    {
        both([at_10, other]);
        let message = refused(Layout::Neu3d, source, &plain);
        assert!(
            message.contains("tell other times than those of camera cam00") && message.contains("--fps"),
            "{message}"
        );
        assert_eq!(times(&import(&given).unwrap(), 1), [0, 50_000, 100_000]);
    }
    // A jitter of a tenth of a frame is none.
    both([at_10, &["1305031102.11", "1305031102.20", "1305031102.29"]]);
    let dataset = import(&plain).unwrap();
    assert_eq!([0, 1].map(|camera| times(&dataset, camera)), [0, 1].map(|_| vec![0, 100_000, 200_000]));
}

#[test]
fn an_order_in_doubt_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path();
    std::fs::write(source.join("poses_bounds.npy"), poses_bounds(&[0, 1])).unwrap();
    for names in [["1", "01"], ["2.9", "2.867"], ["31-04-2024", "01-05-2024"], ["left_1", "right_1"]] {
        for camera in ["cam00", "cam01"] {
            let _ = std::fs::remove_dir_all(source.join(camera));
            for name in names {
                write(source.join(format!("{camera}/{name}.png")), &halves(16, 8, 1, 2));
            }
        }
        let message = refused(Layout::Neu3d, source, &ImportOptions::default());
        assert!(message.contains("is ambiguous") && names.iter().all(|name| message.contains(name)), "{message}");
    }
    // Rows of poses go by the names of cameras.
    for camera in ["cam00", "cam01"] {
        std::fs::remove_dir_all(source.join(camera)).unwrap();
    }
    for camera in ["cam2", "cam10"] {
        write(source.join(format!("{camera}/1.png")), &halves(16, 8, 1, 2));
    }
    let message = refused(Layout::Neu3d, source, &ImportOptions::default());
    assert!(message.contains("cam10") && message.contains("order of the rows"), "{message}");
    // A list without times and without numbers.
    for name in ["b", "a"] {
        write(source.join(format!("x/{name}.png")), &halves(16, 8, 1, 2));
    }
    let list = ["x/b.png", "x/a.png"].map(|file| nerfstudio::frame(file, 0, json!({})));
    std::fs::write(source.join("transforms.json"), json!({ "fl_x": 20.0, "frames": list }).to_string()).unwrap();
    let message = refused(Layout::Nerfstudio, source, &ImportOptions::default());
    assert!(message.contains("give all of them a `time`"), "{message}");
}

#[test]
fn transparency_and_depth_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path();
    let list = [0, 1].map(|camera| nerfstudio::frame(&format!("{camera}.png"), camera, json!({})));
    std::fs::write(source.join("transforms.json"), json!({ "fl_x": 20.0, "frames": list }).to_string()).unwrap();
    let import = |reading: Reading| {
        let out = tempfile::tempdir().unwrap();
        let options = ImportOptions { reading, ..Default::default() };
        let dataset = run(Layout::Nerfstudio, source, &options, &out.path().join("ds"))?;
        Ok::<_, ImportError>(grey(&dataset, &dataset.manifest.cameras[1], 0))
    };
    let save = |camera: u64, pixel: &dyn Fn(u32) -> [u16; 4], deep: bool| {
        let path = source.join(format!("{camera}.png"));
        if deep {
            image::ImageBuffer::from_fn(16, 8, |x, _| image::Luma([pixel(x)[0]])).save(path).unwrap();
        } else {
            image::ImageBuffer::from_fn(16, 8, |x, _| image::Rgba(pixel(x).map(|v| v as u8))).save(path).unwrap();
        }
    };
    save(0, &|_| [9, 9, 9, 255], false);
    save(1, &|x| if x < 8 { [255, 0, 255, 0] } else { [10, 20, 40, 255] }, false);
    let message = import(Reading::default()).unwrap_err().to_string();
    assert!(message.contains("camera 1") && message.contains("--background"), "{message}");
    for background in [0, 255] {
        let reading = Reading { background: Some([background; 3]), ..Default::default() };
        assert_eq!(import(reading).unwrap(), [background, 10]);
    }
    for bits in [10, 12] {
        let white = (1 << bits) - 1;
        save(0, &|_| [white / 3, 0, 0, 0], true);
        save(1, &|x| if x < 8 { [0; 4] } else { [white, 0, 0, 0] }, true);
        let message = import(Reading::default()).unwrap_err().to_string();
        assert!(message.contains(&format!("the largest is {white}")) && message.contains("--bits"), "{message}");
        assert_eq!(import(Reading { bits: Some(bits), ..Default::default() }).unwrap(), [0, 255]);
        assert_eq!(import(Reading { bits: Some(16), ..Default::default() }).unwrap()[0], 0);
        // One bright picture shows that all bits count, of the dark ones, too.
        save(0, &|_| [60_000, 0, 0, 0], true);
        assert_eq!(import(Reading::default()).unwrap(), [0, ((u32::from(white) * 255 + 32_767) / 65_535) as u8]);
    }
}

#[test]
fn of_videos_of_16_bits_it_is_asked_how_many_count() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path();
    std::fs::write(source.join("poses_bounds.npy"), poses_bounds(&[0, 1])).unwrap();
    let film = |camera: u8, level: u16| {
        let light = format!("color=black:s=16x8:r=10,format=gray16le,geq=lum={level}");
        let status = Command::new("ffmpeg")
            .args(["-v", "error", "-y", "-f", "lavfi", "-i", &light, "-frames:v", "3"])
            .args(["-pix_fmt", "gray16le", "-c:v", "ffv1", "-f", "matroska"])
            .arg(source.join(format!("cam0{camera}.mp4")))
            .status()
            .expect("ffmpeg is installed by scripts/setup.sh");
        assert!(status.success());
    };
    let import = |bits: Option<u8>| {
        let out = tempfile::tempdir().unwrap();
        let options = ImportOptions { reading: Reading { bits, ..Default::default() }, ..Default::default() };
        let dataset = run(Layout::Neu3d, source, &options, &out.path().join("ds"))?;
        Ok::<_, ImportError>([0, 1].map(|camera| grey(&dataset, &dataset.manifest.cameras[camera], 0)[0]))
    };
    for (bits, white) in [(10, 1023), (12, 4095)] {
        film(0, white / 2);
        film(1, white);
        let message = import(None).unwrap_err().to_string();
        assert!(message.contains("--bits") && message.contains("the largest is"), "{message}");
        let [half, full] = import(Some(bits)).unwrap();
        assert!(half.abs_diff(127) <= 1 && full >= 254, "{bits}: {half} {full}");
    }
    // One bright video shows that all bits count, of the dark one, too.
    film(0, 50_000);
    assert!(import(None).unwrap()[0].abs_diff(195) <= 1);
}
