//! Errors of the calibration from images, against a dataset whose poses are known.
//!
//! `cargo run --release -p erfgs-lab --features studies --bin sfm_quality -- DATASET known|unknown [COLMAP] [FRAME]`

use std::{path::PathBuf, time::Instant};

use erfgs_calibrate::{
    colmap::ColmapProgram,
    sfm::{
        KnownIntrinsics, SfmOptions,
        align::{Tolerance, align},
        read_views, sfm,
    },
};
use erfgs_dataset::Dataset;
use erfgs_scene::Pose;
use erfgs_scene::rig_file::RigFile;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [dataset, known, rest @ ..] = arguments.as_slice() else {
        return Err("DATASET known|unknown [COLMAP] [FRAME]".into());
    };
    let path = PathBuf::from(dataset);
    let known = if known == "known" { KnownIntrinsics::Dataset } else { KnownIntrinsics::Unknown };
    let options =
        SfmOptions { colmap: ColmapProgram::from(rest.first().cloned().unwrap_or_default()), ..SfmOptions::default() };
    let frame = rest.get(1).map_or(Ok(0), |frame| frame.parse())?;
    let dataset = Dataset::load(&path)?;
    let views = read_views(&path, frame, &known)?;
    let work = tempfile::tempdir()?;
    let since = Instant::now();
    let (rig, evidence) = sfm(&views, &options, work.path(), &|_, _, _| {})?;
    println!("{:.1} s", since.elapsed().as_secs_f64());
    for table in &evidence.tables {
        println!("\n{}\n{}", table.title, table.head.join(" | "));
        table.rows.iter().for_each(|row| println!("{}", row.join(" | ")));
    }
    compare(&rig, &dataset);
    Ok(())
}

fn compare(rig: &RigFile, dataset: &Dataset) {
    let poses: Vec<Option<Pose>> = rig.cameras.iter().map(|camera| camera.pose).collect();
    let truth: Vec<_> = rig.cameras.iter().map(|camera| dataset.camera(&camera.name)).collect();
    let true_poses: Vec<Option<Pose>> =
        truth.iter().map(|camera| camera.map(|camera| camera.world_to_camera)).collect();
    // A similarity over all cameras, good and bad.
    let Some(found) = align(&poses, &true_poses, Tolerance { centre: 1e9, angle: 10.0 }) else { return };
    let (mut centres, mut turns, mut focals, mut sigmas) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for ((camera, pose), (entry, true_pose)) in rig.cameras.iter().zip(&poses).zip(truth.iter().zip(&true_poses)) {
        let (Some(pose), Some(true_pose), Some(entry)) = (pose, true_pose, entry) else { continue };
        let (distance, angle) = found.similarity.difference(pose, true_pose);
        centres.push(1e3 * distance);
        turns.push(angle.to_degrees());
        focals.push(100.0 * (camera.intrinsics.fx / entry.intrinsics.fx - 1.0).abs());
        if let Some(sigma) = &camera.sigma {
            let squares: f64 = sigma.centre_m.iter().map(|s| s.unwrap_or(f64::INFINITY).powi(2)).sum();
            sigmas.push(1e3 * found.similarity.scale * squares.sqrt());
        }
    }
    println!("\n{} of {} cameras placed", centres.len(), dataset.manifest.cameras.len());
    println!("centre, mm      {}", summary(centres));
    println!("  said to be    {}", summary(sigmas));
    println!("rotation, deg   {}", summary(turns));
    println!("focal length, % {}", summary(focals));
    for camera in rig.cameras.iter().filter(|camera| !camera.warnings.is_empty()) {
        println!("{}: {}", camera.name, camera.warnings.join("; "));
    }
}

/// Mean, median and greatest.
fn summary(mut values: Vec<f64>) -> String {
    values.sort_by(f64::total_cmp);
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let at = |index: usize| values.get(index).copied().unwrap_or(f64::NAN);
    format!("mean {mean:.2}, median {:.2}, max {:.2}", at(values.len() / 2), at(values.len().saturating_sub(1)))
}
