//! Errors of event cameras that a dark ramp registers in a rig of frame cameras, against a dataset whose poses are known.
//!
//! `cargo run --release -p erfgs-lab --features studies --bin register_quality -- DATASET [COLMAP] [FRAME] [SENSOR:RAMPS,..]`
//!
//! Four cameras of the dataset become event cameras: the simulator is shown their frame, in linear light, as it rises from black.

use std::{path::PathBuf, time::Instant};

use erfgs_calibrate::{
    colmap::ColmapProgram,
    geometry::angle,
    intensity::dark_ramp,
    sfm::{CameraView, KnownIntrinsics, RegisterOptions, read_views, register},
};
use erfgs_dataset::Dataset;
use erfgs_events::Events;
use erfgs_replay::{
    Luma, Mode, Simulator, SimulatorConfig,
    simulator::{camera_key, linear_of_srgb},
};
use erfgs_scene::Modality;
use erfgs_scene::rig_file::{RigCamera, RigFile};

/// Steps of the ramp, each this much brighter in natural logarithms.
const STEPS: usize = 120;
const STEP: f64 = 0.05;
/// How long the ramp takes, nanoseconds.
const RAMP_NS: i64 = 400_000_000;
/// How long the dark after a ramp lasts, in steps as long as those of the ramp.
const DARK_STEPS: i64 = 120;
/// Sensors, and how often the light rises.
const CASES: &str = "frames:1,noiseless:1,clean:1,noisy:1,noisy:6";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = PathBuf::from(arguments.first().ok_or("DATASET [COLMAP] [FRAME]")?);
    let frame = arguments.get(2).map_or(Ok(0), |frame| frame.parse())?;
    let dataset = Dataset::load(&path)?;
    let mut model = read_views(&path, frame, &KnownIntrinsics::Dataset)?;
    let every = model.len() / 4;
    let mut new = Vec::new();
    for index in [4, 3, 2, 1].map(|nth| nth * every - every / 2) {
        new.insert(0, model.remove(index));
    }
    let options = RegisterOptions {
        colmap: ColmapProgram::from(arguments.get(1).cloned().unwrap_or_default()),
        ..RegisterOptions::default()
    };
    let own = |view: &CameraView| {
        let pose = dataset.camera(&view.name).map(|camera| camera.world_to_camera);
        view.intrinsics.map(|intrinsics| RigCamera::new(&view.name, Modality::Rgb, intrinsics, pose))
    };
    let rig = RigFile::new("sfm", true, model.iter().filter_map(own).collect());
    for case in arguments.get(3).map_or(CASES, String::as_str).split(',') {
        let (preset, ramps) = case.split_once(':').unwrap_or((case, "1"));
        let ramps = ramps.parse()?;
        let seen = new.iter().map(|view| match preset {
            "frames" => Ok(view.clone()),
            _ => event_view(view, preset, ramps, options.radius_px),
        });
        let seen: Vec<CameraView> = seen.collect::<Result<_, _>>()?;
        if let Some(folder) = std::env::var_os("SAVE") {
            for view in &seen {
                view.image.write_png(&PathBuf::from(&folder).join(format!("{}-{preset}-{ramps}.png", view.name)))?;
            }
        }
        let work = tempfile::tempdir()?;
        let since = Instant::now();
        match register(&rig, &model, &seen, &options, work.path(), &|_, _, _| {}) {
            Ok((rig, evidence)) => {
                println!("\n{preset}, {ramps} ramps: {:.1} s", since.elapsed().as_secs_f64());
                for row in evidence.tables.iter().flat_map(|table| &table.rows) {
                    compare(&rig, &dataset, row);
                }
                rig.warnings.iter().for_each(|warning| println!("  {warning}"));
            }
            Err(error) => println!("\n{preset}, {ramps} ramps: {error}"),
        }
    }
    Ok(())
}

/// What an event camera makes of light that rises from black onto the view, `ramps` times.
fn event_view(
    view: &CameraView,
    preset: &str,
    ramps: i64,
    radius_px: u32,
) -> Result<CameraView, Box<dyn std::error::Error>> {
    let config =
        SimulatorConfig { mode: Mode::Enhanced, seed: 1, ..SimulatorConfig::preset(preset).ok_or("no such preset")? };
    let (width, height) = (view.image.width, view.image.height);
    let mut simulator = Simulator::new(width, height, &config, camera_key(&view.name))?;
    let mut events = Events::new(width, height);
    let linear: Vec<f64> =
        view.image.data.iter().map(|&level| 255.0 * linear_of_srgb(f64::from(level) / 255.0).max(2e-3)).collect();
    let step_ns = RAMP_NS / STEPS as i64;
    let mut t_ns = 0;
    for _ in 0..ramps {
        for step in 0..=STEPS {
            // The simulator's logarithm has a linear foot up to 20 of 255; the ramp ends 4 times above white, where it matters
            // less.
            let gain = if step == 0 { 0.0 } else { 4.0 * ((step as f64 - STEPS as f64) * STEP).exp() };
            let levels: Vec<f32> = linear.iter().map(|value| (gain * value) as f32).collect();
            simulator.step(Luma::F32(&levels), t_ns, &mut events)?;
            t_ns += step_ns;
        }
        if ramps > 1 {
            let dark = vec![0.0; linear.len()];
            for _ in 0..DARK_STEPS {
                simulator.step(Luma::F32(&dark), t_ns, &mut events)?;
                t_ns += step_ns;
            }
        }
    }
    let image = dark_ramp(&events, config.threshold_on).picture(radius_px);
    Ok(CameraView { image, modality: Modality::Event, ..view.clone() })
}

fn compare(rig: &RigFile, dataset: &Dataset, row: &[String]) {
    let Some(camera) = rig.camera(&row[0]) else { return };
    let (Some(pose), Some(entry)) = (camera.pose, dataset.camera(&row[0])) else { return };
    let truth = entry.world_to_camera;
    let sigma = camera.sigma.as_ref().map_or(f64::NAN, |sigma| {
        sigma.centre_m.iter().map(|s| s.unwrap_or(f64::INFINITY).powi(2)).sum::<f64>().sqrt()
    });
    println!(
        "  {}: centre {:.2} mm (said to be {:.2}), rotation {:.3} deg; {} {}",
        camera.name,
        1e3 * pose.centre().distance(truth.centre()),
        1e3 * sigma,
        angle(pose.rotation, truth.rotation).to_degrees(),
        row[1..].join(" | "),
        camera.warnings.join("; ")
    );
}
