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
    .unwrap()
    .dataset;
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
        assert_eq!(mask.map(|mask| mask.data[..8].to_vec()), (id != 0).then(|| vec![0, 0, 0, 0, 255, 255, 255, 255]));
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
    names(train(nan), &["camera cam12", "train_meta.json", "NaN", "plausible"]);
    names(train(|meta| meta["w2c"][2][0][0][3] = json!(9.0)), &["camera cam01", "moves", "frame 12"]);
    names(train(|meta| drop(meta["k"].as_array_mut().unwrap().pop())), &["train_meta.json", "[3, 4, 4, 4]"]);
    names(train(|meta| drop(meta["fn"][1].as_array_mut().unwrap().pop())), &["[2, 2, 1, 2]", "frame 1"]);
    names(train(|meta| (0..4).for_each(|t| meta["cam_id"][t][0] = json!(0))), &["camera cam00", "for testing"]);
    names(train(|meta| meta["cam_id"][3][0] = json!(5)), &["camera cam01", "frame 13 is missing"]);
    names(
        train(|meta| (0..4).for_each(|t| meta["k"][t][0][0][0] = json!(-4))),
        &["camera cam01", "the focal length is -4 px"],
    );
    let back = |meta: &mut Value| meta["fn"][1][0] = json!("1/000009.jpg");
    names(train(back), &["train_meta.json", "frame 9 of camera 1 behind frame 10"]);
    let sheared = |meta: &mut Value| (0..4).for_each(|t| meta["w2c"][t][0][0][0] = json!(2.0));
    names(train(sheared), &["camera cam01", "no rotation"]);

    let with = |options: ImportOptions| spoilt(&|_| (), &options);
    names(with(ImportOptions { frames: Some((9, 12)), ..all.clone() }), &["9..12", "10..13"]);
    names(with(ImportOptions { frames: Some((12, 11)), ..all.clone() }), &["backwards"]);
    names(with(ImportOptions { fps: Some(0.0), ..all.clone() }), &["--fps"]);
    names(with(ImportOptions { scale: Some(f64::NAN), ..all.clone() }), &["--scale"]);
}
