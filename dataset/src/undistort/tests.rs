use glam::DVec3;

use super::*;
use crate::{Manifest, PointCloudFile, Provenance, Split};
use erfgs_scene::{ImageGrey8, ImageRgb8, Modality, PointCloud, Pose};

fn lens(distortion: Distortion) -> Intrinsics {
    Intrinsics { width: 64, height: 48, fx: 60.0, fy: 58.0, cx: 33.0, cy: 23.5, distortion }
}

const BARREL: Distortion = Distortion::BrownConrady([-0.2, 0.02, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
const PINCUSHION: Distortion = Distortion::BrownConrady([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
const FISHEYE: Distortion = Distortion::KannalaBrandt([-0.02, 0.003, 0.0, 0.0]);

/// What a camera sees of a smooth world: brightness is a function of the direction.
fn brightness(ray: DVec3) -> f64 {
    127.5 + 60.0 * (3.0 * ray.x / ray.z).sin() + 60.0 * (4.0 * ray.y / ray.z).cos()
}

fn picture(intrinsics: &Intrinsics) -> ImageRgb8 {
    let mut image = ImageRgb8::new(intrinsics.width, intrinsics.height);
    for (index, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (index as u32 % intrinsics.width, index as u32 / intrinsics.width);
        let ray = intrinsics.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
        pixel.fill(brightness(ray).round() as u8);
    }
    image
}

#[test]
fn an_undistorted_picture_is_what_the_pinhole_sees() {
    for distortion in [BARREL, PINCUSHION, FISHEYE] {
        let from = lens(distortion);
        let (to, factor) = pinhole(&from).unwrap();
        assert_eq!((to.distortion, to.cx, to.cy), (Distortion::None, from.cx, from.cy));
        assert!((to.fx / from.fx - factor).abs() < 1e-12 && (to.fy / from.fy - factor).abs() < 1e-12);
        let (found, expected) = (Undistortion::new(&from, &to).picture(&picture(&from)), picture(&to));
        let worst = found.data.iter().zip(&expected.data).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst <= Some(2), "{distortion:?}: {worst:?}");
    }
}

#[test]
fn events_go_where_their_rays_fall() {
    let from = lens(BARREL);
    let (to, _) = pinhole(&from).unwrap();
    let mut events = Events::new(64, 48);
    for (t_us, (x, y)) in [(33, 23), (0, 0), (50, 40)].into_iter().enumerate() {
        events.push(Event { t_us: t_us as i64, x, y, on: x > 40 });
    }
    let moved = undistort_events(&from, &to, &events);
    // The corner was pressed inwards by the lens, so that it leaves the image; the others move outwards or stay.
    assert_eq!((moved.width, moved.height, moved.t_us.as_slice()), (64, 48, &[0, 2][..]));
    assert_eq!((moved.get(0).x, moved.get(0).y, moved.get(0).on), (33, 23, false));
    let expected = to.project_pinhole(from.unproject(DVec2::new(50.5, 40.5)).unwrap());
    let found = DVec2::new(f64::from(moved.get(1).x) + 0.5, f64::from(moved.get(1).y) + 0.5);
    assert!((found - expected).abs().max_element() <= 0.5 && moved.get(1).x > 50, "{found} against {expected}");
}

#[test]
fn a_dataset_loses_its_distortion_and_keeps_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("ds");
    let camera = |name: &str, distortion| {
        let intrinsics = lens(distortion);
        let frame = Frame { file: format!("raw/{name}.png").into(), t_ns: 5, exposure_ns: [4, 6], mask: None };
        let (mut events, mut mask) = (Events::new(64, 48), ImageGrey8::new(64, 48));
        picture(&intrinsics).write_png(&root.join(&frame.file)).unwrap();
        events.push(Event { t_us: 1, x: 0, y: 0, on: true });
        events.push(Event { t_us: 2, x: 33, y: 23, on: true });
        npz::write_events(&root.join(format!("raw/{name}.npz")), &events).unwrap();
        mask.data.fill(255);
        mask.write_png(&root.join(format!("raw/{name}-mask.png"))).unwrap();
        let events = CameraEvents {
            file: format!("raw/{name}.npz").into(),
            count: 2,
            threshold_on: 0.2,
            threshold_off: 0.2,
            lin_log_threshold: 20.0,
            linear_light: false,
            covers_ns: [0, 10],
            simulator: None,
        };
        Camera {
            name: name.to_owned(),
            modality: Modality::Both,
            split: Split::Train,
            intrinsics,
            world_to_camera: Pose::IDENTITY,
            pose_sigma: None,
            clock_sigma_s: None,
            frames: vec![Frame { mask: Some(format!("raw/{name}-mask.png").into()), ..frame }],
            events: Some(events),
        }
    };
    let cameras = vec![camera("bent", BARREL), camera("straight", Distortion::None)];
    PointCloud::default().write(&root.join("points.ply")).unwrap();
    let points =
        PointCloudFile { file: "points.ply".into(), count: 0, method: "none".to_owned(), parameters: BTreeMap::new() };
    let manifest = Manifest {
        format: Manifest::FORMAT.to_owned(),
        version: Manifest::VERSION,
        name: "lens".to_owned(),
        provenance: Provenance::default(),
        span_ns: [0, 10],
        seed: 3,
        variant: Vec::new(),
        linear_exposure: false,
        points: Some(points),
        bodies: None,
        cameras,
        sha256: BTreeMap::new(),
    };
    let dataset = Dataset::new(&root, manifest);
    let out = folder.path().join("flat");
    let mut heard = Vec::new();
    let flat = undistort(&dataset, &out, &mut |progress| heard.push((progress.done, progress.total))).unwrap();
    assert_eq!(heard, [(1, 4), (2, 4), (3, 4), (4, 4)]);
    assert_eq!(Dataset::load(&out).unwrap(), flat);
    flat.verify().unwrap();
    assert_eq!(flat.manifest.variant[0].step, "undistort");
    assert_eq!(flat.manifest.variant[0].parameters["cameras"], json!({ "bent": { "focal_factor": 1.0 } }));
    let [bent, straight] = [&flat.manifest.cameras[0], &flat.manifest.cameras[1]];
    assert_eq!((bent.intrinsics.distortion, straight), (Distortion::None, &dataset.manifest.cameras[1]));
    assert_eq!(bent.events.as_ref().unwrap().count, 1, "the event in the corner has left the image");
    assert_eq!(flat.read_events(bent).unwrap().unwrap().t_us, [2]);
    let expected = picture(&bent.intrinsics);
    let found = flat.read_image(bent, &bent.frames[0]).unwrap();
    assert!(found.data.iter().zip(&expected.data).all(|(a, b)| a.abs_diff(*b) <= 2));
    assert!(flat.read_mask(bent, &bent.frames[0]).unwrap().unwrap().data.iter().all(|&value| value == 255));
    assert!(matches!(undistort(&dataset, &out, &mut |_| {}), Err(DatasetError::OutputExists { .. })));
}
