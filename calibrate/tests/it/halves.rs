//! Two calibrations of one rig, from different parts of a recording: by how many of their stated deviations they differ.

use erfgs_scene::rig_file::RigFile;

/// A figure in which two rigs differ: what it is, by how much, and the deviation that both state of the difference.
pub type Difference = (String, f64, f64);

/// Focal lengths and principal points (pixels), centres (metres), turns about the cameras' axes (degrees) and time offsets
/// (seconds), as far as both rigs say how well they know them.
pub fn differences(one: &RigFile, other: &RigFile) -> Vec<Difference> {
    let mut differences = Vec::new();
    for (a, b) in one.cameras.iter().zip(&other.cameras) {
        let (sigma_a, sigma_b) = (a.sigma.as_ref().unwrap(), b.sigma.as_ref().unwrap());
        let mut differ = |what: &str, off: f64, known: [Option<f64>; 2]| {
            if let [Some(a_sigma), Some(b_sigma)] = known
                && a_sigma.hypot(b_sigma) > 0.0
            {
                differences.push((format!("{} {what}", a.name), off, a_sigma.hypot(b_sigma)));
            }
        };
        let (i, j) = (&a.intrinsics, &b.intrinsics);
        // Of square pixels fy says nothing of its own.
        let square = (i.fy / i.fx - j.fy / j.fx).abs() < 1e-12;
        for (name, off) in [("fx", i.fx - j.fx), ("fy", i.fy - j.fy), ("cx", i.cx - j.cx), ("cy", i.cy - j.cy)] {
            let known = [sigma_a, sigma_b].map(|sigma| sigma.intrinsics.get(name).copied().flatten());
            if !(square && name == "fy") {
                differ(name, off, known);
            }
        }
        let (pose_a, pose_b) = (a.pose.unwrap(), b.pose.unwrap());
        let apart = pose_a.centre() - pose_b.centre();
        let turn = pose_a.rotation * pose_b.rotation.conjugate();
        // Of the two quaternions of a turn, the one by less than half a turn.
        let turned = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            differ(&format!("centre {name}"), apart[axis], [sigma_a.centre_m[axis], sigma_b.centre_m[axis]]);
            let known = [sigma_a.rotation_deg[axis], sigma_b.rotation_deg[axis]];
            differ(&format!("turn {name}"), turned[axis].to_degrees(), known);
        }
        differ("offset", a.time_offset_s - b.time_offset_s, [sigma_a.time_offset_s, sigma_b.time_offset_s]);
    }
    differences
}

/// Prints them; the root mean square in deviations, and the largest.
pub fn in_deviations(what: &str, differences: &[Difference]) -> [f64; 2] {
    let ratio = |(_, off, sigma): &Difference| off / sigma;
    for difference in differences {
        let (name, off, sigma) = difference;
        println!("  {name}: {off:+.5} ± {sigma:.5}: {:+.2}", ratio(difference));
    }
    let squares: f64 = differences.iter().map(|difference| ratio(difference).powi(2)).sum();
    let rms = (squares / differences.len() as f64).sqrt();
    let most = differences.iter().map(|difference| ratio(difference).abs()).fold(0.0, f64::max);
    println!("{what}: {} figures differ by {rms:.2} deviations (rms), {most:.2} at most", differences.len());
    [rms, most]
}
