//! Errors of the calibration from images against known poses.
use std::path::PathBuf;

use erfgs_calibrate::{
    colmap::ColmapProgram,
    sfm::{
        KnownIntrinsics, SfmOptions,
        align::{self, Tolerance},
        read_views, trial,
    },
};
use erfgs_session::{Dataset, Pose};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let path = PathBuf::from(&args[1]);
    let known = if args[2] == "known" { KnownIntrinsics::Dataset } else { KnownIntrinsics::Unknown };
    let colmap = ColmapProgram::from(args[3].clone());
    let work = PathBuf::from(&args[4]);
    let dataset = Dataset::load(&path).unwrap();
    let views = read_views(&path, 0, &known).unwrap();
    let truth: Vec<Option<Pose>> = views.iter().map(|v| dataset.camera(&v.name).map(|c| c.world_to_camera)).collect();
    let options = SfmOptions { colmap, ..SfmOptions::default() };
    trial(&views, &options, &work, &mut |name, poses, k| {
        println!("{name}");
        let Some(a) = align::align(poses, &truth, Tolerance { centre: 0.3, angle: 0.1 }) else {
            println!("  none");
            return;
        };
        let mut c = Vec::new();
        let mut r = Vec::new();
        for (p, t) in poses.iter().zip(&truth) {
            if let (Some(p), Some(t)) = (p, t) {
                let (d, q) = a.similarity.difference(p, t);
                c.push(1000.0 * d);
                r.push(q.to_degrees());
            }
        }
        let wrong: Vec<&str> = a.alike.iter().zip(&views).filter(|(a, _)| !**a).map(|(_, v)| v.name.as_str()).collect();
        let st = |v: &mut Vec<f64>| {
            v.sort_by(f64::total_cmp);
            format!("{:.2}/{:.2}/{:.2}", v.iter().sum::<f64>() / v.len() as f64, v[v.len() / 2], v[v.len() - 1])
        };
        let mut f: Vec<f64> = k
            .iter()
            .zip(&views)
            .filter_map(|(k, v)| {
                Some(
                    100.0
                        * (k.as_ref()?.fx / dataset.manifest.cameras.iter().find(|c| c.name == v.name)?.intrinsics.fx
                            - 1.0)
                            .abs(),
                )
            })
            .collect();
        println!(
            "  registered {} centre mm {} rot deg {} focal % {} wrong {wrong:?}",
            c.len(),
            st(&mut c),
            st(&mut r),
            st(&mut f)
        );
    })
    .unwrap();
}
