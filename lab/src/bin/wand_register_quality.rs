//! Errors of four event cameras that a simulated wand places among the frame cameras of the Panoptic Studio's dome.
//!
//! `ERFGS_SHARED=FOLDER cargo run --release -p erfgs-lab --features studies --bin wand_register_quality -- [RIG] [SEEDS]`
//!
//! RIG is a rig file of the same cameras from images (`erfgs calibrate sfm`); `-` for none. The wand is waved for two minutes on
//! the dome's floor.

#[path = "../../../calibrate/tests/it/wand/dome.rs"]
#[allow(dead_code, reason = "shared with the tests of the wand, which use more of it")]
mod dome;

use std::path::Path;

use dome::Eye;
use erfgs_base::random;
use erfgs_calibrate::wand::{KnownRig, Stick, WandOptions, calibrate};
use erfgs_scene::Modality;
use erfgs_scene::rig_file::{RigCamera, RigFile};

const SECONDS: f64 = 120.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let images =
        arguments.first().filter(|path| *path != "-").map(|path| RigFile::read(Path::new(path))).transpose()?;
    let seeds: u64 = arguments.get(1).map_or(Ok(5), |text| text.parse())?;
    let source = erfgs_recordings::folder().map(|folder| folder.join(dome::PANOPTIC)).filter(|source| source.is_dir());
    let eyes = dome::panoptic(&source.ok_or("the Panoptic scene is not in $ERFGS_SHARED")?);
    let stick = Stick::new([0.13, 0.26]).ok_or("no wand")?;
    let rgb = |eye: &&Eye| eye.modality == Modality::Rgb;
    let truth =
        eyes.iter().filter(rgb).map(|eye| RigCamera::new(&eye.name, Modality::Rgb, eye.intrinsics, Some(eye.pose)));
    let truth = RigFile::new("truth", true, truth.collect());
    let mut frames = vec![("wand alone", None), ("among true poses", Some(truth))];
    if let Some(mut rig) = images {
        rig.cameras.retain(|camera| eyes.iter().any(|eye| eye.name == camera.name && eye.modality == Modality::Rgb));
        println!("the rig from images: {}", line(&rig, &eyes));
        frames.push(("among poses from images", Some(rig)));
    }
    for seed in 0..seeds {
        let mut cameras = dome::observe(&eyes, &stick, SECONDS, seed);
        for (index, camera) in cameras.iter_mut().enumerate() {
            // Focal lengths are known to 0.2 %.
            let factor = 1.0 + 0.002 * random::normal(random::key(seed, &[4, index as u64]));
            camera.intrinsics.fx *= factor;
            camera.intrinsics.fy *= factor;
        }
        for (name, rig) in &frames {
            let options = WandOptions { known: rig.clone().map(KnownRig::new), ..WandOptions::new(stick) };
            let since = std::time::Instant::now();
            let (found, _) = calibrate(&cameras, &options)?;
            let measures = found.quality.as_ref().map(|quality| &quality.measures);
            let measure = |name: &str| measures.and_then(|m| m.get(name)).copied().unwrap_or(f64::NAN);
            println!(
                "seed {seed}, {name}, {:.0} placements, held-out {:.2} mm, {:.1} s: {}",
                measure("placements"),
                measure("held_out_whole_wand_rms_mm"),
                since.elapsed().as_secs_f64(),
                line(&found, &eyes)
            );
            found.warnings.iter().for_each(|warning| println!("  {warning}"));
            for camera in found.cameras.iter().filter(|camera| !camera.warnings.is_empty()) {
                println!("  {}: {}", camera.name, camera.warnings.join("; "));
            }
        }
    }
    Ok(())
}

/// Errors of the event cameras one by one, and of the others in the mean.
fn line(found: &RigFile, eyes: &[Eye]) -> String {
    let errors = dome::errors(found, eyes);
    let rgb: Vec<_> = errors.iter().filter(|error| error.1 == Modality::Rgb).collect();
    let mean = |of: fn(&(String, Modality, f64, f64)) -> f64| {
        rgb.iter().map(|error| of(error)).sum::<f64>() / rgb.len().max(1) as f64
    };
    let most = rgb.iter().map(|error| error.2).fold(0.0, f64::max);
    let events = errors.iter().filter(|error| error.1 == Modality::Event);
    let events = events.map(|(name, _, mm, deg)| {
        let sigma = found.camera(name).and_then(|camera| camera.sigma.clone()).unwrap_or_default();
        let squares: f64 = sigma.centre_m.iter().map(|s| s.unwrap_or(f64::NAN).powi(2)).sum();
        format!("{name} {mm:.2} (said {:.2}) mm {deg:.3} deg", 1e3 * squares.sqrt())
    });
    format!(
        "{} RGB {:.2} (most {most:.2}) mm {:.3} deg; {}",
        rgb.len(),
        mean(|error| error.2),
        mean(|error| error.3),
        events.collect::<Vec<_>>().join(", ")
    )
}
