use glam::DQuat;
use proptest::prelude::*;

use super::*;

const BINARY: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];
const TEXT: [&str; 3] = ["cameras.txt", "images.txt", "points3D.txt"];

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![-1e3..1e3, prop::num::f64::NORMAL, Just(0.0), Just(-0.1)]
}

fn camera() -> impl Strategy<Value = ColmapCamera> {
    (prop::sample::select(CameraModel::ALL.to_vec()), 1..9000_u64, 1..9000_u64, prop::collection::vec(number(), 16))
        .prop_map(|(model, width, height, mut parameters)| {
            parameters.truncate(model.parameters());
            ColmapCamera { model, width, height, parameters }
        })
}

/// A model whose references hold: every keypoint that sees a point stands in that point's track.
fn model() -> impl Strategy<Value = Model> {
    let rotation = prop::array::uniform4(-1.0..1.0).prop_filter_map("short", |[w, x, y, z]: [f64; 4]| {
        let q = DQuat::from_xyzw(x, y, z, w);
        (q.length() > 0.1).then(|| q.normalize())
    });
    let keypoint = (number(), number(), prop::option::of(0..4_usize));
    let image =
        (rotation, prop::array::uniform3(number()), "[a-z0-9_]{1,8}/[a-z0-9]{1,8}[.]png", any::<prop::sample::Index>());
    let images = prop::collection::vec((image, prop::collection::vec(keypoint, 0..5)), 0..4);
    let point = (prop::array::uniform3(number()), any::<[u8; 3]>(), number());
    (prop::collection::vec(camera(), 1..4), images, prop::collection::vec(point, 0..5)).prop_map(
        |(cameras, images, points)| {
            let cameras = cameras.into_iter().enumerate().map(|(i, camera)| (i as u32 * 3 + 1, camera)).collect();
            let mut model = Model { cameras, ..Model::default() };
            let points = points.into_iter().enumerate().map(|(i, (position, colour, error))| {
                (i as u64 * 1000, Point3d { position: position.into(), colour, error, track: Vec::new() })
            });
            model.points = points.collect();
            for (index, ((rotation, translation, name, camera), keypoints)) in images.into_iter().enumerate() {
                let (id, mut points) = (index as u32 + 7, Vec::new());
                for (x, y, point) in keypoints {
                    let point3d = point.map(|point| point as u64 * 1000).filter(|id| model.points.contains_key(id));
                    if let Some(point) = point3d.and_then(|id| model.points.get_mut(&id)) {
                        point.track.push(Observation { image: id, point2d: points.len() as u32 });
                    }
                    points.push(Point2d { position: DVec2::new(x, y), point3d });
                }
                let pose = Pose { rotation, translation: translation.into() };
                let camera = *camera.get(&model.cameras.keys().copied().collect::<Vec<_>>());
                model.images.insert(id, ColmapImage { pose, camera, name, points });
            }
            model
        },
    )
}

fn small_model() -> Model {
    let intrinsics = Intrinsics {
        width: 640,
        height: 360,
        fx: 465.5,
        fy: 464.4,
        cx: 318.25,
        cy: 186.8,
        distortion: Distortion::KannalaBrandt([0.1, -0.02, 0.003, 0.0]),
    };
    let pose = Pose::look_at(DVec3::new(1.0, -1.0, 2.5), DVec3::ZERO, DVec3::Y);
    let points = vec![
        Point2d { position: DVec2::new(12.5, 99.25), point3d: Some(42) },
        Point2d { position: DVec2::new(0.5, 1.0), point3d: None },
    ];
    let track = vec![Observation { image: 3, point2d: 0 }];
    let point = Point3d { position: DVec3::new(0.1, 0.2, 0.3), colour: [1, 2, 255], error: 0.5, track };
    Model {
        cameras: [(9, ColmapCamera::from_intrinsics(&intrinsics))].into(),
        images: [(3, ColmapImage { pose, camera: 9, name: "cam00/000040.png".to_owned(), points })].into(),
        points: [(42, point)].into(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn models_come_back_from_both_forms(model in model()) {
        let folder = tempfile::tempdir().unwrap();
        model.write_binary(folder.path()).unwrap();
        prop_assert_eq!(&Model::read(folder.path()).unwrap(), &model);
        model.write_text(folder.path()).unwrap();
        prop_assert!(!folder.path().join("cameras.bin").exists(), "the other form would be stale");
        prop_assert_eq!(&Model::read(folder.path()).unwrap(), &model);
    }

    #[test]
    fn a_damaged_byte_never_panics(file in 0..6_usize, at in any::<prop::sample::Index>(), value in any::<u8>()) {
        let folder = tempfile::tempdir().unwrap();
        if file < 3 { small_model().write_binary(folder.path()) } else { small_model().write_text(folder.path()) }.unwrap();
        let path = folder.path().join(BINARY.iter().chain(&TEXT).nth(file).unwrap());
        let mut bytes = std::fs::read(&path).unwrap();
        let at = at.index(bytes.len());
        bytes[at] = value;
        std::fs::write(&path, bytes).unwrap();
        let _ = Model::read(folder.path());
    }

    /// Where they see points: the longer models with zeros where the shorter ones end.
    #[test]
    fn models_with_zero_terms_are_the_lenses_that_they_are_then(k in prop::array::uniform4(0.001..0.1_f64)) {
        let [k1, k2, k3, k4] = k;
        let fisheye = |k| Distortion::KannalaBrandt(k);
        let of = |model: CameraModel, parameters: &[f64]| {
            ColmapCamera { model, width: 640, height: 480, parameters: parameters.to_vec() }.intrinsics()
        };
        let (one, two) = ([500.0, 320.0, 240.0], [500.0, 501.0, 320.0, 240.0]);
        for (model, extra, lens) in [
            (CameraModel::SimpleFisheye, &[][..], fisheye([0.0; 4])),
            (CameraModel::Fisheye, &[], fisheye([0.0; 4])),
            (CameraModel::SimpleRadialFisheye, &[k1], fisheye([k1, 0.0, 0.0, 0.0])),
            (CameraModel::RadialFisheye, &[k1, k2], fisheye([k1, k2, 0.0, 0.0])),
            (CameraModel::ThinPrismFisheye, &[k1, k2, 0.0, 0.0, k3, k4, 0.0, 0.0], fisheye(k)),
            (CameraModel::RadTanThinPrismFisheye, &[k1, k2, k3, k4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], fisheye(k)),
            (CameraModel::Fov, &[0.0], Distortion::None),
            (CameraModel::FullOpenCv, &[k1, k2, k3, k4, 0.0, 0.0, 0.0, 0.0],
                Distortion::BrownConrady([k1, k2, k3, k4, 0.0, 0.0, 0.0, 0.0])),
        ] {
            let start = if model.has_one_focal_length() { &one[..] } else { &two };
            let all = [start, extra].concat();
            prop_assert_eq!(of(model, &all).unwrap().distortion, lens, "{}", model.name());
            // A term that no lens of ours has.
            if matches!(model, CameraModel::ThinPrismFisheye | CameraModel::RadTanThinPrismFisheye | CameraModel::Fov) {
                let mut all = all;
                *all.last_mut().unwrap() = k1;
                let message = of(model, &all).unwrap_err().to_string();
                prop_assert!(message.contains(model.name()) && message.contains("OPENCV_FISHEYE"), "{message}");
            }
        }
    }

    #[test]
    fn intrinsics_come_back_through_the_smallest_model(k in prop::array::uniform8(0.001..1.0_f64), lens in 0..4) {
        let distortion = match lens {
            0 => Distortion::None,
            1 => Distortion::BrownConrady([k[0], k[1], k[2], k[3], 0.0, 0.0, 0.0, 0.0]),
            2 => Distortion::BrownConrady(k),
            _ => Distortion::KannalaBrandt([k[0], k[1], k[2], k[3]]),
        };
        let intrinsics = Intrinsics { width: 640, height: 480, fx: 500.0, fy: 510.0, cx: 320.5, cy: 239.0, distortion };
        let camera = ColmapCamera::from_intrinsics(&intrinsics);
        let expected =
            [CameraModel::Pinhole, CameraModel::OpenCv, CameraModel::FullOpenCv, CameraModel::OpenCvFisheye];
        prop_assert_eq!(camera.model, expected[lens as usize]);
        prop_assert_eq!(camera.intrinsics().unwrap(), intrinsics);
    }
}

#[test]
fn a_file_cut_short_anywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    for names in [BINARY, TEXT] {
        let write = || match names {
            BINARY => small_model().write_binary(folder.path()).unwrap(),
            _ => small_model().write_text(folder.path()).unwrap(),
        };
        for name in names {
            write();
            let path = folder.path().join(name);
            let whole = std::fs::read(&path).unwrap();
            for length in 0..whole.len() {
                std::fs::write(&path, &whole[..length]).unwrap();
                assert!(Model::read(folder.path()).is_err(), "{name}: {length} of {} bytes", whole.len());
            }
        }
    }
}

#[test]
fn text_as_colmap_writes_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\
         # Number of cameras: 2\n1 SIMPLE_RADIAL 640 480 500 320 240 0.01\n2 RADIAL 640 480 500 320 240 0.01 -0.02\n",
        "# Image list with two lines of data per image:\n\
         #   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n\
         # Number of images: 2, mean observations per image: 0.5\n\
         1 1 0 0 0 0.5 0 0 1 a.png\n10.5 20.5 7 11 12 -1\n2 2 0 0 0 0 0 0 2 b c.png\n\n",
        "7 0.1 0.2 0.3 9 8 7 1.5 1 0\n",
    ];
    for (name, text) in TEXT.iter().zip(files) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let model = Model::read(folder.path()).unwrap();
    let Distortion::BrownConrady(k) = model.cameras[&2].intrinsics().unwrap().distortion else { panic!("no lens") };
    assert_eq!(k[..4], [0.01, -0.02, 0.0, 0.0]);
    assert_eq!((model.images[&2].name.as_str(), model.images[&2].points.len()), ("b c.png", 0));
    assert_eq!(model.images[&2].pose.rotation, DQuat::IDENTITY, "quaternions are normalised");
    assert_eq!(model.points[&7].track, [Observation { image: 1, point2d: 0 }]);

    std::fs::write(folder.path().join(TEXT[2]), "").unwrap();
    let error = Model::read(folder.path()).unwrap_err();
    assert!(error.to_string().contains("image 1 (a.png) sees the point 7"), "{error}");
}

#[test]
fn what_is_wrong_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let message = || Model::read(folder.path()).unwrap_err().to_string();
    assert!(message().contains("holds no COLMAP model"), "{}", message());
    let mut model = small_model();
    model.images.get_mut(&3).unwrap().camera = 4;
    model.write_binary(folder.path()).unwrap();
    assert!(message().contains("image 3 (cam00/000040.png) has the camera 4"), "{}", message());
    let mut model = small_model();
    model.images.get_mut(&3).unwrap().pose.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    model.write_text(folder.path()).unwrap();
    assert!(message().contains("image 3 (cam00/000040.png) has no valid rotation"), "{}", message());
    small_model().write_text(folder.path()).unwrap();
    let cameras = folder.path().join("cameras.txt");
    let text = std::fs::read_to_string(&cameras).unwrap();
    std::fs::write(&cameras, text.replace("OPENCV_FISHEYE", "THIN_PRISM_FISHEYE")).unwrap();
    assert!(message().contains("line 4") && message().contains("THIN_PRISM_FISHEYE"), "{}", message());
}

#[test]
fn a_fisheye_without_coefficients_is_no_pinhole_and_no_camera_has_any_numbers() {
    let distortion = Distortion::KannalaBrandt([0.0; 4]);
    let intrinsics = Intrinsics { width: 640, height: 480, fx: 500.0, fy: 510.0, cx: 320.5, cy: 239.0, distortion };
    let camera = ColmapCamera::from_intrinsics(&intrinsics);
    assert_eq!(camera.intrinsics().unwrap(), intrinsics);
    for (width, focal, cx) in
        [(0, 500.0, 320.0), (u64::MAX, 500.0, 320.0), (640, -500.0, 320.0), (640, f64::NAN, 1.0), (640, 9.0, f64::NAN)]
    {
        let parameters = vec![focal, 510.0, cx, 239.0, 0.0, 0.0, 0.0, 0.0];
        let error = ColmapCamera { width, parameters, ..camera.clone() }.intrinsics().unwrap_err();
        assert!(error.to_string().contains("OPENCV_FISHEYE"), "{error}");
    }
}

#[test]
fn stale_rigs_and_frames_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["rigs.bin", "frames.bin"] {
        std::fs::write(folder.path().join(name), [0; 8]).unwrap();
    }
    small_model().write_binary(folder.path()).unwrap();
    assert!(!folder.path().join("rigs.bin").exists() && !folder.path().join("frames.bin").exists());
}

#[test]
fn text_of_other_programs_may_lack_its_last_end() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        "# written by another program\n1 PINHOLE 640 480 500 500 320 240",
        "1 1 0 0 0 0.5 0 0 1 a.png\n10.5 20.5 7 11 12 -1\n2 1 0 0 0 0 0 0 1 b.png\n3.5 4.5 7",
        "7 0.1 0.2 0.3 9 8 7 1.5 1 0 2 0",
    ];
    for ends in [["", "", ""], ["\n", "", "\n"], ["\n", "\n", ""], ["\n", "\n", "\n"]] {
        for ((name, text), end) in TEXT.iter().zip(files).zip(ends) {
            std::fs::write(folder.path().join(name), format!("{text}{end}")).unwrap();
        }
        let model = Model::read(folder.path()).unwrap();
        assert_eq!((model.cameras.len(), model.images[&2].points.len(), model.points.len()), (1, 1, 1), "{ends:?}");
    }
    // What lacks more than that is cut.
    std::fs::write(folder.path().join(TEXT[2]), "7 0.1 0.2 0.3 9 8 7 1.5 1 0 2").unwrap();
    assert!(Model::read(folder.path()).is_err());
}
