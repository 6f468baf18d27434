use erfgs_dataset::Dataset;
use erfgs_splat::gaussians::CORE;
use erfgs_stage::{FilmOptions, RigOptions, StageOptions, film};
use erfgs_train::{checkpoint::Checkpoint, config::Config, scene::Scene};

use crate::command_line::Folder;

/// Six RGB cameras and a held-out one, 13 sharp frames at 30 a second.
fn sharp_film(folder: &Folder) {
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 40, height: 30, rgb: 6, event: 0, test: 1, ..RigOptions::default() },
        duration_ns: 400_000_000,
        exposure_ns: 0,
        rgb_fps: 30.0,
        test_fps: 30.0,
        truth_points: 0,
        ..FilmOptions::default()
    };
    film(&folder.path("ds"), &options, &|_| {}).expect("a film");
}

#[test]
fn a_variant_has_fewer_blurred_frames_and_event_only_cameras_and_can_be_trained_on() {
    let folder = Folder::new();
    sharp_film(&folder);
    let full = folder.figures("info ds");
    assert_eq!((full["train_rgb"].as_u64(), full["frames"].as_u64()), (Some(6), Some(7 * 13)), "{full}");

    let made = folder.figures("dataset variant ds --subsample 4 --blur 3 --event-only 2 --out ds-dv");
    assert_eq!(
        (made["train_rgb"].as_u64(), made["train_event"].as_u64(), made["test"].as_u64()),
        (Some(4), Some(2), Some(1))
    );
    // Frames 0, 4 and 8 of four cameras; 12 would need two frames past the end. All 13 of the held-out camera.
    assert_eq!(made["frames"].as_u64(), Some(4 * 3 + 13), "{made}");
    assert!(made["events"].as_u64() > Some(100), "{made}");
    folder.succeed("dataset check ds-dv");

    // The trainer counts events in the steps of the simulator: a bin for each frame of the source.
    let dataset = Dataset::load(&folder.path("ds-dv")).expect("a dataset");
    let scene = Scene::load(dataset, &Config::default(), true).expect("a scene");
    assert_eq!((scene.bins.per_interval, &scene.bins.edges_us[..3]), (4, &[0, 33_333, 66_667][..]));
    assert_eq!(scene.bins.anchors, [0, 4, 8]);
    assert!(scene.bins.edges.windows(2).all(|pair| pair[0] < pair[1]), "no bin is empty: {:?}", scene.bins.edges);

    let named = folder.figures("dataset variant ds --event-only rgb01,rgb04 --out ds-named");
    assert_eq!((named["train_event"].as_u64(), named["frames"].as_u64()), (Some(2), Some(4 * 13 + 13)), "{named}");
    assert!(folder.fail(1, "dataset variant ds --event-only nobody --out ds-wrong").contains("nobody"));
    assert!(folder.fail(1, "dataset variant ds --subsample 4 --out ds-dv").contains("ds-dv"));

    folder.succeed("dataset points ds-dv --method random --random-points 200");
    let written = folder.figures("export ds-dv --to colmap --out for-colmap");
    assert_eq!(written["images"].as_u64(), Some(4 * 3 + 13), "{written}");
    assert!(written["points"].as_u64() >= Some(200), "{written}");
    // Cameras of other programs need frames: those with events alone are said to be missing.
    assert!(written["notes"].to_string().contains("no frames: 2"), "{written}");
    folder.succeed("export ds-dv/dataset.json --to nerfstudio --out for-nerfstudio");
    let back = folder.figures("dataset import nerfstudio for-nerfstudio --fps 30 --out back");
    assert_eq!((back["train_rgb"].as_u64(), back["test"].as_u64()), (Some(4), Some(1)), "{back}");
    assert!(folder.fail(1, "export ds-dv --to colmap --out for-colmap").contains("for-colmap"));
    assert!(folder.fail(2, "export ds-dv --to png --out pictures").contains("--to colmap or nerfstudio"));
    assert!(folder.fail(2, "export ds-dv --to colmap").contains("--out"));
    let trained = folder.figures("train ds-dv --iterations 5+10 --no-evaluation --out run");
    assert_eq!(trained["iterations"].as_u64(), Some(15), "{trained}");
    let paper =
        "train ds-dv --preset paper --iterations 3+9 --set eds.from=4 --set eds.every=4 --set eds.min_events=0.5";
    let trained = folder.figures(&format!("{paper} --set eds.until=1 --no-evaluation --out paper"));
    assert!(trained["gaussians"].as_u64() > Some(200), "event-guided densification added some: {trained}");
}

#[test]
fn gaussians_that_are_free_in_time_are_born_from_silhouettes_and_go_on_after_a_stop() {
    let folder = Folder::new();
    sharp_film(&folder);
    folder.succeed("dataset variant ds --subsample 2 --blur 2 --event-only 2 --out ds-free");
    folder.succeed("dataset points ds-free --method random --random-points 200 --moving 0");
    let train = "train ds-free --motion free-time --no-evaluation --set eds.from=10 --set eds.every=10 \
                 --set eds.min_events=0.5 --set density.from=5 --set density.every=10";
    let stderr = folder.fail(1, &format!("{train} --iterations 2+2 --out none"));
    assert!(stderr.contains("has no moving points") && stderr.contains("dataset points"), "{stderr}");

    folder.succeed("dataset points ds-free --method random --random-points 200");
    // A point of a blurred frame was there in the middle of the exposure, and not when the shutter opened.
    let scene = Scene::load(Dataset::load(&folder.path("ds-free")).expect("a dataset"), &Config::default(), false);
    let scene = scene.expect("a scene");
    let mut instants: Vec<f64> = scene.frames.iter().map(|frame| frame.instant(Some(0.5))).collect();
    instants.sort_by(f64::total_cmp);
    let mut born: Vec<f64> = scene.moving_points().iter().map(|(_, t01)| *t01).collect();
    born.dedup();
    assert!(
        born.len() >= 3 && born.iter().all(|t| instants.iter().any(|instant| (instant - t).abs() < 1e-9)),
        "{born:?}"
    );
    assert!(scene.frames.iter().all(|frame| frame.exposure[1] > frame.exposure[0]), "frames are blurred");

    let first = folder.figures(&format!("{train} --iterations 10+20 --out run"));
    assert!(first["dynamic"].as_u64() > Some(20), "{first}");
    // The default is what the points allow.
    for (run, more, expected) in
        [("auto", "", "motion = \"free-time\""), ("unmoved", "--init random", "motion = \"hexplane\"")]
    {
        folder.succeed(&format!("train ds-free --no-evaluation --iterations 2+2 {more} --out {run}"));
        let config = std::fs::read_to_string(folder.path(run).join("config.toml")).expect("a configuration");
        assert!(config.contains(expected), "{config}");
        assert_eq!(config.contains("instant = 0.5"), run == "auto", "the middle of the exposure");
    }
    let more = folder.figures(&format!("{train} --iterations 10+40 --out run --resume --change"));
    assert_eq!(more["iterations"].as_u64(), Some(50), "{more}");
    assert!(more["cpu_seconds"].as_f64() > first["cpu_seconds"].as_f64(), "{more}");
    let stderr = folder.fail(1, "train ds-free --motion hexplane --iterations 10+50 --out run --resume --change");
    assert!(stderr.contains("another motion model"), "{stderr}");

    let measured = folder.figures("eval run --pictures 0");
    let parts = ["at_frames", "between_frames", "outside_frames"].map(|part| measured[part]["frames"].as_u64());
    assert_eq!(parts.iter().flatten().sum::<u64>(), 13, "{measured}");
    assert!(measured["colour_corrected"]["psnr"].as_f64() > Some(1.0), "{measured}");
    let fast = measured["psnr_fast"].as_f64().expect("something is fast");
    assert!(fast > 1.0 && Some(fast) < measured["psnr"].as_f64(), "{measured}");
    let files = folder.figures("export run --instants 3");
    assert_eq!(files.as_array().map(Vec::len), Some(4), "{files}");
}

#[test]
fn what_stands_still_learns_from_frames_alone() {
    let folder = Folder::new();
    sharp_film(&folder);
    folder.succeed("dataset variant ds --subsample 2 --blur 2 --event-only 2 --out ds-free");
    folder.succeed("dataset points ds-free --method random --random-points 1000");
    // One iteration from the same start, in which events weigh little or much.
    let after = |weight: &str, more: &str| {
        let run = format!("run-{weight}{}", more.len());
        folder.succeed(&format!(
            "train ds-free --no-evaluation --deterministic --iterations 20+1 --set eds.enabled=false --set earl.share=1 \
             --set earl.pairing=any --set earl.weight={weight} {more} --out {run}"
        ));
        let checkpoint = Checkpoint::load(&folder.path(&run).join("checkpoint.bin")).expect("a checkpoint");
        let mut core = checkpoint.population.gaussians.core;
        let still = core.split_off(CORE * checkpoint.population.gaussians.dynamic);
        (core, still)
    };
    let (little, much, all) = (after("0.01", ""), after("5", ""), after("5", "--set earl.still_learn=true"));
    assert!(little.0 != much.0, "events teach what moves");
    assert!(!little.1.is_empty() && little.1 == much.1, "they do not teach what stands still");
    assert!(much.1 != all.1, "where they do, it changes");
    // Frames are rendered as ever, held-out cameras not at all.
    let veiled = after("5", "--set near_share=0");
    assert!(
        veiled.0 != much.0,
        "what no frame sees before an event camera's lens is not what its events are held against"
    );
}
