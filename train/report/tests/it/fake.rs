//! Run folders that look like real ones: a ball thrown through a room, seen by a ring of cameras.

use std::{collections::BTreeMap, path::Path, sync::Mutex};

use erfgs_dataset::{Camera, CameraEvents, Frame, Manifest, PointCloudFile, Provenance, Split, VariantStep};
use erfgs_run::{ColourCorrected, CurveRow, LeftOut, MaskKind, Metrics, Part, PerView, RunFolder, RunInfo};
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};
use erfgs_train::metrics::{self, Dpsnr, Picture, motion_masks};
use glam::DVec3;
use image::{GrayImage, RgbImage};

pub const WIDTH: u32 = 192;
pub const HEIGHT: u32 = 108;
const FRAMES: u32 = 25;
const RGB_EVERY: u32 = 4;
const FRAME_NS: i64 = 33_333_333;

/// What tells one run from another.
pub struct Kind {
    pub method: &'static str,
    /// How far the ball is from where it should be between RGB frames, pixels.
    pub lag: f64,
    pub events: bool,
}

fn cameras() -> Vec<Camera> {
    let intrinsics = Intrinsics {
        width: WIDTH,
        height: HEIGHT,
        fx: 150.0,
        fy: 150.0,
        cx: f64::from(WIDTH) / 2.0,
        cy: f64::from(HEIGHT) / 2.0,
        distortion: Distortion::None,
    };
    (0..14u32)
        .map(|index| {
            let angle = f64::from(index) * 0.41;
            let eye = DVec3::new(3.0 * angle.cos(), -1.4 - 0.3 * f64::from(index % 3), 2.6 * angle.sin());
            let (split, modality) = match index {
                0 | 7 => (Split::Test, Modality::Rgb),
                3 | 6 | 10 => (Split::Train, Modality::Event),
                12 => (Split::Train, Modality::Both),
                _ => (Split::Train, Modality::Rgb),
            };
            let every = if split == Split::Test { 1 } else { RGB_EVERY };
            let frames = (0..FRAMES).step_by(every as usize).filter(|_| modality.has_frames()).map(|at| {
                let t_ns = i64::from(at) * FRAME_NS;
                let end = if split == Split::Test { t_ns } else { t_ns + 2 * FRAME_NS };
                let file = format!("images/cam{index:02}/{at:05}.png").into();
                Frame { file, t_ns, exposure_ns: [t_ns, end], mask: None }
            });
            Camera {
                name: format!("cam{index:02}"),
                modality,
                split,
                intrinsics,
                world_to_camera: Pose::look_at(eye, DVec3::new(0.0, -0.8, 0.0), DVec3::Y),
                pose_sigma: None,
                clock_sigma_s: None,
                frames: frames.collect(),
                events: modality.has_events().then(|| CameraEvents {
                    file: format!("events/cam{index:02}.npz").into(),
                    count: 812_345 + u64::from(index) * 1977,
                    threshold_on: 0.2,
                    threshold_off: 0.2,
                    lin_log_threshold: 20.0,
                    linear_light: false,
                    covers_ns: [0, i64::from(FRAMES - 1) * FRAME_NS],
                    simulator: None,
                }),
            }
        })
        .collect()
}

pub fn manifest() -> Manifest {
    let step = |step: &str, parameters: &[(&str, serde_json::Value)]| VariantStep {
        step: step.into(),
        parameters: parameters.iter().map(|(name, value)| ((*name).into(), value.clone())).collect(),
    };
    Manifest {
        format: Manifest::FORMAT.into(),
        version: Manifest::VERSION,
        name: "thrown-ball-dv".into(),
        provenance: Provenance {
            importer: "stage".into(),
            name: "thrown-ball".into(),
            options: BTreeMap::new(),
            zero_ns: None,
            erfgs: "0.1.0".into(),
        },
        span_ns: [0, i64::from(FRAMES - 1) * FRAME_NS],
        seed: 1,
        variant: vec![
            step("simulate", &[("mode", "enhanced".into()), ("threshold", 0.2.into())]),
            VariantStep::subsample(RGB_EVERY),
            step("blur", &[("frames", 3.into())]),
            step("event_only", &[("count", 3.into())]),
        ],
        linear_exposure: false,
        points: Some(PointCloudFile {
            file: "points.ply".into(),
            count: 14_012,
            method: "colmap".into(),
            parameters: BTreeMap::new(),
        }),
        bodies: None,
        cameras: cameras(),
        sha256: BTreeMap::new(),
    }
}

/// The room with the ball `lag` pixels behind its place at frame `at`, painted once for all runs.
fn picture(camera: u32, at: f64, lag: f64, noise: u64) -> RgbImage {
    static PAINTED: Mutex<BTreeMap<(u32, u64, u64, u64), RgbImage>> = Mutex::new(BTreeMap::new());
    let mut painted = PAINTED.lock().unwrap();
    painted.entry((camera, at.to_bits(), lag.to_bits(), noise)).or_insert_with(|| paint(camera, at, lag, noise)).clone()
}

fn paint(camera: u32, at: f64, lag: f64, noise: u64) -> RgbImage {
    let progress = at / f64::from(FRAMES - 1);
    let ball =
        (20.0 + 150.0 * progress - lag, 80.0 - 230.0 * progress * (1.0 - progress) + f64::from(camera % 3) * 4.0);
    RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let (fx, fy) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        let floor = fy > 78.0;
        let checker = ((fx / 14.0 + f64::from(camera)).floor() + (fy / 9.0).floor()) as i64 % 2 == 0;
        let mut colour = match (floor, checker) {
            (true, true) => [150.0, 128.0, 96.0],
            (true, false) => [116.0, 98.0, 74.0],
            (false, _) => [176.0 - 0.4 * fy + 12.0 * (fx / 23.0).sin(), 184.0 - 0.3 * fy, 190.0],
        };
        let distance = ((fx - ball.0).powi(2) + (fy - ball.1).powi(2)).sqrt();
        let cover = (7.5 - distance).clamp(0.0, 1.0);
        let shade = 1.0 - 0.05 * (fx - ball.0 + fy - ball.1);
        for (value, of_ball) in colour.iter_mut().zip([214.0, 104.0, 42.0]) {
            *value = *value * (1.0 - cover) + of_ball * shade * cover;
        }
        let mut state = noise.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from(y * WIDTH + x);
        state = (state ^ state >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let jitter = if noise == 0 { 0.0 } else { ((state >> 40) as f64 / f64::from(1 << 24) - 0.5) * 14.0 };
        image::Rgb(colour.map(|value| (value + jitter).clamp(0.0, 255.0) as u8))
    })
}

/// Writes a run with everything in it.
pub fn write(root: &Path, kind: &Kind) -> RunFolder {
    let run = RunFolder::new(root);
    let left_out = [
        ("deformation of static Gaussians", "no event and no motion where they project", "71 % of field time, 208 s"),
        ("SH bands above 1", "PSNR of training views rose by less than 0.02 dB", "64 % of SH memory"),
    ];
    let item =
        |(what, why, saves): (&str, &str, &str)| LeftOut { what: what.into(), why: why.into(), saves: saves.into() };
    run.write_info(&RunInfo {
        method: kind.method.into(),
        preset: "paper".into(),
        dataset: "thrown-ball-dv".into(),
        dataset_name: "thrown-ball-dv".into(),
        dataset_sha256: Some("5f".repeat(32)),
        adapter: "llvmpipe (LLVM 19.1.7, 256 bits)".into(),
        driver: "Mesa 25.0.7".into(),
        seed: 1,
        left_out: left_out.into_iter().map(item).collect(),
        ..RunInfo::default()
    })
    .unwrap();
    run.write_config(&format!(
        "method = \"{}\"\nseed = 1\nnear_m = 0.009999999776482582\n[earl]\nenabled = {}\nweight = 0.1\n[density]\nevery = 200\n",
        kind.method, kind.events
    ))
    .unwrap();
    run.write_dataset(&manifest()).unwrap();
    curve(&run, kind);
    evaluation(&run, kind);
    if kind.method == "erf-gs" {
        events(&run);
    }
    run
}

fn curve(run: &RunFolder, kind: &Kind) {
    let mut writer = run.create_curve().unwrap();
    for iteration in (50..=6000u64).step_by(50) {
        let progress = iteration as f64 / 6000.0;
        let fine = iteration > 1500;
        let wobble = 1.0 + 0.12 * (iteration as f64 * 1.7).sin();
        let events = kind.events && fine;
        let evaluated = iteration.is_multiple_of(500);
        writer
            .append(&CurveRow {
                iteration,
                stage: if fine { "fine" } else { "coarse" }.into(),
                wall_seconds: iteration as f64 * if kind.events { 0.16 } else { 0.14 },
                loss_rgb: Some((0.02 + 0.12 * (-5.0 * progress).exp()) * wobble),
                loss_event: events.then_some(0.3 * (-2.0 * progress).exp() * wobble),
                loss_trajectory: events.then_some(4e-4 * wobble),
                loss_colour: events.then_some(2e-3 * wobble),
                loss_plane: fine.then_some(3e-4 / wobble),
                gaussians: 14_000 + (progress * 30_000.0) as u64,
                dynamic: if fine { 4_000 + (progress * 9_000.0) as u64 } else { 0 },
                psnr: evaluated.then_some(27.4 - 7.0 * (-4.0 * progress).exp() - kind.lag * 0.05),
                dpsnr: evaluated.then_some(24.0 - 6.0 * (-3.0 * progress).exp() - kind.lag * 0.5),
                psnr_static: evaluated.then_some(27.9 - 7.0 * (-4.0 * progress).exp()),
                cpu_seconds: Some(iteration as f64 * if kind.events { 0.3 } else { 0.2 }),
            })
            .unwrap();
    }
}

fn evaluation(run: &RunFolder, kind: &Kind) {
    let mut views = Vec::new();
    let mut dpsnr = Dpsnr::default();
    for camera in [0, 7u32] {
        let name = format!("cam{camera:02}");
        let truths: Vec<RgbImage> = (0..FRAMES).map(|at| picture(camera, f64::from(at), 0.0, 0)).collect();
        let raw: Vec<&[u8]> = truths.iter().map(|truth| truth.as_raw().as_slice()).collect();
        let masks = motion_masks(WIDTH, HEIGHT, &raw, &Default::default()).unwrap();
        for (index, (truth, mask)) in (0..FRAMES).zip(truths.iter().zip(&masks)) {
            let away = f64::from(index % RGB_EVERY) / f64::from(RGB_EVERY);
            let lag = kind.lag * 4.0 * away * (1.0 - away);
            let render = picture(camera, f64::from(index), lag, 1 + u64::from(index + camera));
            let (a, b) = (metrics::to_unit(render.as_raw()), metrics::to_unit(truth.as_raw()));
            let (a, b) = (Picture::new(WIDTH, HEIGHT, &a).unwrap(), Picture::new(WIDTH, HEIGHT, &b).unwrap());
            let error = metrics::masked_error(a, b, mask).unwrap();
            dpsnr.add(error);
            views.push(PerView {
                camera: name.clone(),
                index,
                t_ns: i64::from(index) * FRAME_NS,
                psnr: metrics::psnr(a, b).unwrap(),
                dpsnr: error.psnr(),
                ssim: metrics::ssim(a, b).unwrap(),
                lpips: None,
                moving_pixels: error.pixels,
            });
            save(&render, &run.render_file(&name, index).unwrap());
            save(truth, &run.truth_file(&name, index).unwrap());
            let white = mask.iter().map(|&moves| if moves { 255 } else { 0 }).collect();
            let mask = GrayImage::from_raw(WIDTH, HEIGHT, white).unwrap();
            mask.save(created(&run.mask_file(&name, index).unwrap())).unwrap();
        }
    }
    let mean = |value: fn(&PerView) -> f64| views.iter().map(value).sum::<f64>() / views.len() as f64;
    run.write_metrics(&Metrics {
        psnr: mean(|view| view.psnr),
        dpsnr: dpsnr.mean(),
        dpsnr_pooled: dpsnr.pooled(),
        dpsnr_mask: MaskKind::Motion,
        psnr_static: Some(27.9),
        psnr_fast: Some(18.0 - kind.lag),
        at_frames: Part { frames: 6, psnr: Some(27.2), dpsnr: Some(24.0), psnr_fast: None },
        between_frames: Part { frames: 8, psnr: Some(27.0), dpsnr: Some(23.1 - kind.lag), psnr_fast: None },
        outside_frames: Part::default(),
        colour_corrected: Some(ColourCorrected { psnr: 28.0, dpsnr: Some(24.3), psnr_static: Some(28.8) }),
        ssim: mean(|view| view.ssim),
        lpips: None,
        lpips_kind: None,
        train_psnr: Some(29.871),
        iterations: 6000,
        train_seconds: if kind.events { 960.4 } else { 840.0 },
        train_cpu_seconds: Some(if kind.events { 1800.0 } else { 1200.0 }),
        gaussians: 44_000,
        bytes: 18_345_678,
        render_fps: 31.4,
    })
    .unwrap();
    run.write_per_view(&views).unwrap();
}

fn events(run: &RunFolder) {
    for camera in [3, 6u32] {
        for index in 0..3 {
            let at = f64::from(index * RGB_EVERY + 2);
            for (shift, path) in [
                (0.0, run.measured_events_file(&format!("cam{camera:02}"), index).unwrap()),
                (1.5, run.rendered_events_file(&format!("cam{camera:02}"), index).unwrap()),
            ] {
                let (before, after) = (picture(camera, at, shift, 0), picture(camera, at + 1.0, shift, 0));
                let frame = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
                    let change = i32::from(after.get_pixel(x, y).0[1]) - i32::from(before.get_pixel(x, y).0[1]);
                    image::Rgb(match change {
                        9.. => [200, 60, 40],
                        ..=-9 => [40, 90, 190],
                        _ => [255, 255, 255],
                    })
                });
                save(&frame, &path);
            }
        }
    }
}

fn save(picture: &RgbImage, path: &Path) {
    picture.save(created(path)).unwrap();
}

fn created(path: &Path) -> &Path {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    path
}
