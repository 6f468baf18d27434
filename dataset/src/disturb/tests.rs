use std::path::PathBuf;

use super::*;
use crate::{CameraEvents, Frame, Manifest, Provenance, layout};
use erfgs_events::{Event, Events};
use erfgs_scene::{Distortion, ImageRgb8, Intrinsics, Modality, PointCloud, Pose};

const SECONDS: f64 = 2.0;

/// Two RGB cameras and an event camera for training, one of each held out.
fn dataset(folder: &Path) -> Dataset {
    let mut dataset = Dataset::new(
        folder,
        Manifest {
            format: Manifest::FORMAT.into(),
            version: Manifest::VERSION,
            name: "small".into(),
            provenance: Provenance::default(),
            span_ns: [0, 2_000_000_000],
            seed: 0,
            variant: Vec::new(),
            linear_exposure: true,
            points: None,
            bodies: None,
            cameras: Vec::new(),
            sha256: std::collections::BTreeMap::new(),
        },
    );
    let camera = |name: &str, split, modality| Camera {
        name: name.into(),
        modality,
        split,
        intrinsics: Intrinsics {
            width: 16,
            height: 12,
            fx: 20.0,
            fy: 20.0,
            cx: 8.0,
            cy: 6.0,
            distortion: Distortion::None,
        },
        world_to_camera: Pose::look_at(DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y),
        pose_sigma: None,
        clock_sigma_s: None,
        frames: Vec::new(),
        events: None,
    };
    for (name, split) in [("a", Split::Train), ("b", Split::Train), ("held", Split::Test)] {
        let mut camera = camera(name, split, Modality::Rgb);
        for (index, t_ns) in [100_000_000, 1_900_000_000].into_iter().enumerate() {
            let file = layout::image(name, index);
            ImageRgb8::new(16, 12).write_png(&folder.join(&file)).unwrap();
            camera.frames.push(Frame { file, t_ns, exposure_ns: [t_ns - 5_000_000, t_ns + 5_000_000], mask: None });
        }
        dataset.manifest.cameras.push(camera);
    }
    for (name, split) in [("e", Split::Train), ("held-e", Split::Test)] {
        let mut camera = camera(name, split, Modality::Event);
        let mut events = Events::new(16, 12);
        (0..20_000).for_each(|at| {
            events.push(Event { t_us: 100 * at, x: (at % 16) as u16, y: (at % 12) as u16, on: at % 3 == 0 });
        });
        let file = layout::events(name);
        std::fs::create_dir_all(folder.join("events")).unwrap();
        npz::write_events(&folder.join(&file), &events).unwrap();
        camera.events = Some(CameraEvents {
            file,
            count: 20_000,
            threshold_on: 0.2,
            threshold_off: 0.3,
            lin_log_threshold: 20.0,
            linear_light: false,
            covers_ns: [0, 2_000_000_000],
            simulator: None,
        });
        dataset.manifest.cameras.push(camera);
    }
    let cloud = PointCloud { positions: vec![[0.0; 3]], colours: vec![[1; 3]] };
    dataset.set_points(&cloud, "test", [].into()).unwrap();
    dataset.hash_files().unwrap();
    dataset.save().unwrap();
    Dataset::load(folder).unwrap()
}

struct Folders(tempfile::TempDir);

impl Folders {
    fn new() -> (Self, Dataset) {
        let kept = tempfile::tempdir().unwrap();
        let source = dataset(&kept.path().join("source"));
        (Self(kept), source)
    }

    fn out(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

fn made(folders: &Folders, source: &Dataset, name: &str, wrong: Disturbance) -> Dataset {
    let made = disturb(source, &wrong, &folders.out(name), &mut |_| {}).unwrap();
    made.verify().unwrap();
    assert_eq!(Dataset::load(&folders.out(name)).unwrap(), made);
    made
}

#[test]
fn nothing_wrong_changes_nothing_but_the_steps() {
    let (folders, source) = Folders::new();
    let same = made(&folders, &source, "same", Disturbance::default());
    assert_eq!(same.manifest.cameras, source.manifest.cameras);
    assert_eq!(same.manifest.points, source.manifest.points);
    assert_eq!(same.manifest.sha256, source.manifest.sha256);
    assert_eq!(same.manifest.variant.last().unwrap().step, "disturb");
}

#[test]
fn training_cameras_are_moved_by_their_own_errors_and_held_out_ones_stay() {
    let (folders, source) = Folders::new();
    let of = |scale: f64| Disturbance {
        place_m: 0.01 * scale,
        direction_deg: 0.5 * scale,
        focal: 0.01 * scale,
        frame_clock_s: 0.5 * scale,
        seed: 7,
        ..Disturbance::default()
    };
    let [once, twice] = [1.0, 2.0].map(|scale| made(&folders, &source, &format!("by-{scale}"), of(scale)));
    assert!(once.manifest.points.is_none(), "points that better cameras made");
    let off = |of: &Dataset, name: &str| {
        let [from, to] = [&source, of].map(|dataset| dataset.camera(name).unwrap().clone());
        let turned = (to.world_to_camera.rotation * from.world_to_camera.rotation.inverse()).to_scaled_axis();
        let moved = to.world_to_camera.centre() - from.world_to_camera.centre();
        let late = to.frames.first().map_or(0, |frame| frame.t_ns - from.frames[0].t_ns);
        (moved, turned, to.intrinsics.fx / from.intrinsics.fx - 1.0, late)
    };
    for name in ["held", "held-e"] {
        assert_eq!(once.camera(name), source.camera(name));
    }
    let (a, b, twice_a) = (off(&once, "a"), off(&once, "b"), off(&twice, "a"));
    assert!((a.0 - b.0).length() > 1e-4 && (a.1 - b.1).length() > 1e-4 && a.3 != b.3, "each its own: {a:?} {b:?}");
    assert!((twice_a.0 - 2.0 * a.0).length() < 1e-9 && (twice_a.1 - 2.0 * a.1).length() < 1e-9);
    assert!((twice_a.2 - 2.0 * a.2).abs() < 1e-9 && (twice_a.3 - 2 * a.3).abs() <= 1);
    assert!((0.0..0.05).contains(&a.0.length()) && a.1.length().to_degrees() < 2.5 && a.2.abs() < 0.05);
    // A frame that leaves the span takes it along, and its exposure.
    let frame = &twice.camera("a").unwrap().frames[0];
    assert!(twice.manifest.span_ns[0] <= frame.t_ns && frame.exposure_ns[1] - frame.exposure_ns[0] == 10_000_000);
}

#[test]
fn events_come_late_get_noise_and_lose_packets() {
    let (folders, source) = Folders::new();
    let of = |name: &str, wrong| {
        let made = made(&folders, &source, name, wrong);
        let camera = made.camera("e").unwrap().clone();
        assert_eq!(made.camera("held-e"), source.camera("held-e"));
        (made.read_events(&camera).unwrap().unwrap(), camera.events.unwrap())
    };
    let before = source.read_events(source.camera("e").unwrap()).unwrap().unwrap();
    let (late, file) = of("late", Disturbance { event_clock_s: 0.003, ..Disturbance::default() });
    assert!(late.t_us.iter().zip(&before.t_us).all(|(late, t)| late - t == 3000));
    assert_eq!(file.covers_ns, [3_000_000, 2_003_000_000]);
    let (noisy, _) = of("noisy", Disturbance { noise_hz: 50.0, ..Disturbance::default() });
    let (more, expected) = ((noisy.len() - before.len()) as f64, 50.0 * SECONDS * 16.0 * 12.0);
    assert!((more - expected).abs() < 5.0 * expected.sqrt(), "{more} events of noise, expected {expected}");
    assert!(noisy.t_us.is_sorted() && noisy.t_us.iter().all(|t| (0..2_000_000).contains(t)));
    let (left, file) = of("lost", Disturbance { lost: 0.5, ..Disturbance::default() });
    assert!((4..16).contains(&(left.len() / Disturbance::PACKET)), "{}", left.len());
    assert_eq!(file.count, left.len() as u64);
    let (_, wrong) = of("stated", Disturbance { threshold: 0.5, ..Disturbance::default() });
    assert!((wrong.threshold_on - 0.3).abs() < 1e-12 && (wrong.threshold_off - 0.45).abs() < 1e-12);
    let (_, wrong) = of("balance", Disturbance { balance: 0.44, ..Disturbance::default() });
    assert!((wrong.threshold_on - 0.24).abs() < 1e-12 && (wrong.threshold_off - 0.25).abs() < 1e-12);
}

#[test]
fn cameras_can_be_left_out_and_what_cannot_be_is_refused() {
    let (folders, source) = Folders::new();
    let keep = |names: &[&str]| Some(names.iter().map(|&name| name.to_owned()).collect());
    let fewer = made(&folders, &source, "fewer", Disturbance { cameras: keep(&["a", "e"]), ..Disturbance::default() });
    let names: Vec<_> = fewer.manifest.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["a", "held", "e", "held-e"]);
    for wrong in [
        Disturbance { cameras: keep(&["held"]), ..Disturbance::default() },
        Disturbance { cameras: keep(&[]), ..Disturbance::default() },
        Disturbance { place_m: f64::NAN, ..Disturbance::default() },
        Disturbance { lost: 1.5, ..Disturbance::default() },
        Disturbance { focal: 1.0, ..Disturbance::default() },
    ] {
        let refused = disturb(&source, &wrong, &folders.out("no"), &mut |_| {});
        assert!(matches!(refused, Err(DatasetError::Disturbance { .. })), "{wrong:?}");
        assert!(!folders.out("no").exists());
    }
}
