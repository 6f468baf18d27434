//! Variants of a small dataset made here.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use erfgs_dataset::{Camera, CameraEvents, Dataset, Frame, Manifest, PointCloudFile, Provenance, Split, layout};
use erfgs_events::{Events, npz};
use erfgs_replay::{
    SimulatorConfig, VariantError, VariantOptions,
    variant::{BlurOptions, Edge, EventOnly, Label, Rounding, Window, variant},
};
use erfgs_scene::{ImageGrey8, ImageRgb8, Intrinsics, Modality, PointCloud, Pose};

const FRAMES: usize = 9;
const SIZE: [u32; 2] = [24, 16];

fn time_ns(frame: usize) -> i64 {
    frame as i64 * 33_333_333
}

/// A bright square that moves over a gradient, in its own place for each camera.
fn image(camera: usize, frame: usize) -> ImageRgb8 {
    let mut image = ImageRgb8::new(SIZE[0], SIZE[1]);
    for (at, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (at % SIZE[0] as usize, at / SIZE[0] as usize);
        let inside = (x + 48 - 2 * frame - camera) % 24 < 5 && (5..10).contains(&y);
        let level = if inside { 230 } else { 40 + 3 * x + 2 * y };
        pixel.copy_from_slice(&[level as u8, (level / 2) as u8, (255 - level) as u8]);
    }
    image
}

fn camera(root: &Path, index: usize, split: Split, events: bool) -> Camera {
    let name = format!("{index:02}");
    let frames = (0..FRAMES).map(|frame| {
        let (file, mask) = (layout::image(&name, frame), layout::mask(&name, frame));
        image(index, frame).write_png(&root.join(&file)).unwrap();
        let mut moving = ImageGrey8::new(SIZE[0], SIZE[1]);
        moving.data[frame] = 255;
        moving.write_png(&root.join(&mask)).unwrap();
        Frame { file, t_ns: time_ns(frame), exposure_ns: [time_ns(frame); 2], mask: Some(mask) }
    });
    let mut camera = Camera {
        modality: if events { Modality::Both } else { Modality::Rgb },
        split,
        intrinsics: Intrinsics {
            width: SIZE[0],
            height: SIZE[1],
            fx: 20.0,
            fy: 20.0,
            cx: 12.0,
            cy: 8.0,
            distortion: Default::default(),
        },
        world_to_camera: Pose::IDENTITY,
        pose_sigma: None,
        clock_sigma_s: None,
        frames: frames.collect(),
        events: None,
        name,
    };
    if events {
        let mut recorded = Events::new(SIZE[0], SIZE[1]);
        recorded.push(erfgs_events::Event { t_us: 7, y: 1, x: 2, on: true });
        let file = layout::events(&camera.name);
        npz::write_events(&root.join(&file), &recorded).unwrap();
        camera.events = Some(CameraEvents {
            file,
            count: 1,
            threshold_on: 0.3,
            threshold_off: 0.3,
            lin_log_threshold: 20.0,
            linear_light: true,
            covers_ns: [0, time_ns(FRAMES - 1)],
            simulator: None,
        });
    }
    camera
}

/// Six training cameras, 00 to 05, and the test camera 06; `recorded` of the training cameras have events of their own.
fn source(root: &Path, recorded: usize) -> Dataset {
    let cameras = (0..7)
        .map(|index| camera(root, index, if index == 6 { Split::Test } else { Split::Train }, index < recorded))
        .collect();
    let points = PointCloud { positions: vec![[0.0; 3]], colours: vec![[1; 3]] };
    points.write(&root.join(layout::POINTS)).unwrap();
    let manifest = Manifest {
        format: Manifest::FORMAT.into(),
        version: Manifest::VERSION,
        name: "bar".into(),
        provenance: Provenance::default(),
        span_ns: [0, time_ns(FRAMES - 1)],
        seed: 0,
        variant: Vec::new(),
        linear_exposure: false,
        points: Some(PointCloudFile {
            file: layout::POINTS.into(),
            count: 1,
            method: "known".into(),
            parameters: Default::default(),
        }),
        bodies: None,
        cameras,
        sha256: Default::default(),
    };
    let mut dataset = Dataset::new(root, manifest);
    dataset.hash_files().unwrap();
    dataset.save().unwrap();
    dataset.validate().unwrap();
    dataset
}

struct Fixture {
    folder: tempfile::TempDir,
    source: Dataset,
}

impl Fixture {
    fn new(recorded: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = source(&folder.path().join("source"), recorded);
        Self { folder, source }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn make(&self, options: &VariantOptions) -> Dataset {
        let made = variant(&self.source, options, &self.path("out"), &mut |_| {}).unwrap();
        let loaded = Dataset::load(&self.path("out")).unwrap();
        assert_eq!(made, loaded);
        loaded.verify().unwrap();
        assert_eq!(files_on_disk(&loaded.root), loaded.files(), "nothing but what the manifest names");
        loaded
    }

    fn refused(&self, options: &VariantOptions) -> VariantError {
        let error = variant(&self.source, options, &self.path("out"), &mut |_| {}).unwrap_err();
        assert!(!self.path("out").exists(), "no folder is left: {error}");
        error
    }
}

fn files_on_disk(root: &Path) -> BTreeSet<PathBuf> {
    let mut files = BTreeSet::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.file_name().unwrap() != Dataset::MANIFEST {
                files.insert(path.strip_prefix(root).unwrap().to_owned());
            }
        }
    }
    files
}

fn dv() -> VariantOptions {
    VariantOptions {
        subsample: 4,
        blur: BlurOptions { frames: 3, ..BlurOptions::default() },
        event_only: EventOnly::Names(vec!["02".into(), "04".into()]),
        seed: 5,
        ..VariantOptions::default()
    }
}

#[test]
fn a_dv_variant_has_blurred_frames_event_cameras_and_untouched_test_cameras() {
    let fixture = Fixture::new(0);
    let made = fixture.make(&dv());
    assert_eq!(made.manifest.name, "bar-dv");
    for (camera, before) in made.manifest.cameras.iter().zip(&fixture.source.manifest.cameras) {
        match camera.name.as_str() {
            "06" => assert_eq!(camera, before),
            "02" | "04" => {
                assert_eq!((camera.modality, camera.frames.len()), (Modality::Event, 0));
                let events = made.read_events(camera).unwrap().unwrap();
                assert!(events.len() > 100, "{} events", events.len());
                // Of the full rate: in every frame interval, and up to the last frame.
                for frame in 1..FRAMES {
                    let edge = |frame| time_ns(frame) / 1000 + 1;
                    assert!(!events.between(edge(frame - 1), edge(frame)).is_empty(), "interval {frame}");
                }
                let file = camera.events.as_ref().unwrap();
                assert_eq!(file.covers_ns, [0, time_ns(FRAMES - 1)]);
                assert_eq!((file.threshold_on, file.lin_log_threshold), (0.2, 20.0));
                assert_eq!(file.simulator.as_ref().unwrap()["config"]["seed"], 5);
            }
            _ => {
                // Frames 0 and 4; 8 has no two frames after it.
                assert_eq!(camera.modality, Modality::Rgb);
                assert_eq!(camera.frames.iter().map(|f| f.t_ns).collect::<Vec<_>>(), [time_ns(0), time_ns(4)]);
                assert_eq!(camera.frames[1].exposure_ns, [time_ns(4), time_ns(6)]);
                assert!(camera.events.is_none());
            }
        }
    }
    let camera = made.camera("03").unwrap();
    let blurred = made.read_image(camera, &camera.frames[1]).unwrap();
    let sharp = [4, 5, 6].map(|frame| image(3, frame));
    for (at, &level) in blurred.data.iter().enumerate() {
        let sum: u32 = sharp.iter().map(|image| u32::from(image.data[at])).sum();
        assert_eq!(u32::from(level), sum / 3);
    }
    let mask = made.read_mask(camera, &camera.frames[1]).unwrap().unwrap();
    assert_eq!(mask.data[..9], [0, 0, 0, 0, 255, 255, 255, 0, 0], "what moves in any of the three");
    let steps: Vec<&str> = made.manifest.variant.iter().map(|step| step.step.as_str()).collect();
    assert_eq!(steps, ["simulate", "subsample", "blur", "event_only", "points"]);
    assert!(made.manifest.points.is_none(), "the points were made from frames that are gone");
}

#[test]
fn a_ts_variant_links_the_kept_frames() {
    let fixture = Fixture::new(0);
    let options = VariantOptions { subsample: 4, keep_points: true, ..VariantOptions::default() };
    let made = fixture.make(&options);
    assert_eq!(made.manifest.name, "bar-ts");
    let (camera, before) = (made.camera("00").unwrap(), fixture.source.camera("00").unwrap());
    assert_eq!(camera.frames, [0, 4, 8].map(|frame| before.frames[frame].clone()));
    assert_eq!(made.camera("06").unwrap().frames.len(), FRAMES);
    assert!(made.manifest.cameras.iter().all(|camera| camera.events.is_none()));
    assert_eq!(made.manifest.points, fixture.source.manifest.points);
    for (file, hash) in &made.manifest.sha256 {
        assert_eq!(fixture.source.manifest.sha256.get(file), Some(hash), "{}", file.display());
    }
}

#[test]
fn event_cameras_are_drawn_with_the_seed() {
    let fixture = Fixture::new(0);
    let chosen = |seed: u64| -> Vec<String> {
        let options = VariantOptions { event_only: EventOnly::Count(2), seed, ..VariantOptions::default() };
        let out = fixture.path("drawn");
        let made = variant(&fixture.source, &options, &out, &mut |_| {}).unwrap();
        std::fs::remove_dir_all(out).unwrap();
        assert_eq!(made.manifest.seed, seed);
        made.cameras(Split::Train).filter(|c| c.modality == Modality::Event).map(|c| c.name.clone()).collect()
    };
    let draws: Vec<_> = (0..8).map(chosen).collect();
    assert!(draws.iter().all(|cameras| cameras.len() == 2));
    assert!(draws.iter().collect::<BTreeSet<_>>().len() > 2, "{draws:?}");
    assert_eq!(draws[3], chosen(3));
}

#[test]
fn the_same_variant_has_the_same_bytes() {
    let fixture = Fixture::new(0);
    let options = VariantOptions { simulator: SimulatorConfig::preset("noisy").unwrap(), ..dv() };
    let first = fixture.make(&options);
    let again = variant(&fixture.source, &options, &fixture.path("again"), &mut |_| {}).unwrap();
    assert_eq!(first.manifest, again.manifest, "with the hashes of all files");
}

#[test]
fn rgb_cameras_get_events_on_request() {
    let fixture = Fixture::new(0);
    let options = VariantOptions { keep_rgb_events: true, ..dv() };
    let made = fixture.make(&options);
    assert!(made.cameras(Split::Train).all(|camera| camera.modality.has_events()));
    assert_eq!(made.camera("00").unwrap().modality, Modality::Both);
    assert_eq!(made.camera("06").unwrap().modality, Modality::Rgb);
    // The events do not depend on which cameras lose their frames.
    let alone = variant(&fixture.source, &dv(), &fixture.path("alone"), &mut |_| {}).unwrap();
    let file = layout::events("02");
    assert_eq!(made.manifest.sha256[&file], alone.manifest.sha256[&file]);
}

#[test]
fn recorded_events_are_carried_not_simulated() {
    let fixture = Fixture::new(3);
    let made = fixture.make(&dv());
    for name in ["00", "01", "02"] {
        assert_eq!(made.camera(name).unwrap().events, fixture.source.camera(name).unwrap().events, "{name}");
    }
    assert_eq!(made.camera("02").unwrap().modality, Modality::Event);
    assert_eq!(made.camera("01").unwrap().modality, Modality::Both);
    assert_eq!(made.read_events(made.camera("02").unwrap()).unwrap().unwrap().len(), 1);
    let simulate = &made.manifest.variant[0];
    assert_eq!((simulate.step.as_str(), &simulate.parameters["cameras"]), ("simulate", &serde_json::json!(["04"])));
}

#[test]
fn a_variant_of_a_variant_adds_its_steps() {
    let fixture = Fixture::new(0);
    let blinded = VariantOptions { event_only: EventOnly::Names(vec!["01".into()]), seed: 1, ..Default::default() };
    let first = fixture.make(&blinded);
    let blurred =
        VariantOptions { blur: BlurOptions { frames: 2, ..Default::default() }, seed: 2, ..Default::default() };
    let second = variant(&first, &blurred, &fixture.path("second"), &mut |_| {}).unwrap();
    let steps: Vec<&str> = second.manifest.variant.iter().map(|step| step.step.as_str()).collect();
    assert_eq!(steps, ["simulate", "event_only", "points", "blur"]);
    assert_eq!(second.camera("01"), first.camera("01"));
    assert_eq!(second.camera("00").unwrap().frames.len(), FRAMES - 1);
    assert_eq!(second.manifest.name, "bar-dv-mb");
    Dataset::load(&second.root).unwrap().verify().unwrap();
}

#[test]
fn blurred_frames_may_be_centred_shortened_rounded_and_labelled_by_the_middle() {
    let fixture = Fixture::new(0);
    let blur = BlurOptions {
        frames: 3,
        window: Window::Centred,
        edge: Edge::Shorten,
        rounding: Rounding::Nearest,
        linear_light: true,
        label: Label::Mid,
    };
    let made = fixture.make(&VariantOptions { subsample: 4, blur, ..VariantOptions::default() });
    assert!(made.manifest.linear_exposure);
    let frames = &made.camera("00").unwrap().frames;
    let exposures: Vec<_> = frames.iter().map(|frame| frame.exposure_ns).collect();
    let between = |first, last| [time_ns(first), time_ns(last)];
    assert_eq!(exposures, [between(0, 1), between(3, 5), between(7, 8)]);
    let middle = |[start, end]: [i64; 2]| start + (end - start) / 2;
    assert!(frames.iter().all(|frame| frame.t_ns == middle(frame.exposure_ns)));
    // Where nothing moves, the mean of linear light is the level itself.
    let (still, sharp) = (made.read_image(made.camera("00").unwrap(), &frames[1]).unwrap(), image(0, 4));
    assert_eq!(still.pixel(3, 0), sharp.pixel(3, 0));
}

#[test]
fn the_source_stays_as_it_was_and_progress_reaches_its_end() {
    let fixture = Fixture::new(1);
    let mut last = None;
    variant(&fixture.source, &dv(), &fixture.path("out"), &mut |progress| {
        assert_eq!(progress.done, last.map_or(0, |last: erfgs_base::Progress| last.done) + 1);
        last = Some(progress);
    })
    .unwrap();
    let last = last.unwrap();
    assert_eq!(last.done, last.total);
    fixture.source.verify().unwrap();
    assert_eq!(files_on_disk(&fixture.source.root), fixture.source.files());
}

#[test]
fn impossible_variants_are_refused_and_leave_nothing_behind() {
    let fixture = Fixture::new(0);
    let refused = |options: &VariantOptions| fixture.refused(options).to_string();
    let named = |name: &str| VariantOptions { event_only: EventOnly::Names(vec![name.into()]), ..Default::default() };
    assert!(refused(&named("17")).contains("no such camera"));
    assert!(refused(&named("06")).contains("test camera"));
    let all = VariantOptions { event_only: EventOnly::Count(6), ..Default::default() };
    assert!(refused(&all).contains("6 of 6"));
    assert!(refused(&VariantOptions { subsample: 0, ..Default::default() }).contains("subsampling"));
    let blur = |frames| VariantOptions { blur: BlurOptions { frames, ..Default::default() }, ..Default::default() };
    assert!(refused(&blur(0)).contains("averaged"));
    assert!(refused(&blur(10)).contains("would keep none"));
    let simulator = SimulatorConfig { threshold_on: 0.0, ..SimulatorConfig::default() };
    assert!(refused(&VariantOptions { simulator, ..Default::default() }).contains("threshold_on"));
    std::fs::remove_file(fixture.source.root.join(layout::image("02", 3))).unwrap();
    assert!(refused(&dv()).contains("02"));
    assert_eq!(std::fs::read_dir(fixture.folder.path()).unwrap().count(), 1, "the unfinished folder is gone");
}

#[test]
fn a_folder_that_holds_something_is_not_touched() {
    let fixture = Fixture::new(0);
    std::fs::create_dir(fixture.path("out")).unwrap();
    std::fs::write(fixture.path("out/notes.txt"), "mine").unwrap();
    let error = variant(&fixture.source, &dv(), &fixture.path("out"), &mut |_| {}).unwrap_err();
    assert!(matches!(error, VariantError::NotEmpty { .. }), "{error}");
    assert_eq!(std::fs::read(fixture.path("out/notes.txt")).unwrap(), b"mine");
}
