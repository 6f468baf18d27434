//! A mixed rig: errors, and whether they are as large as foretold.

use erfgs_calibrate::wand::calibrate;

use crate::wand::rig;

/// `lab/src/bin/wand_study.rs` does the same with 50 seeds and more cases.
const SEEDS: u64 = 6;

#[test]
fn a_mixed_rig_with_wrong_focal_lengths_comes_out_within_a_millimetre_and_its_sigmas_are_right() {
    let stations = rig::mixed();
    let (mut centre_mm, mut squares, mut count, mut focal_squares, mut focal_count) = (0.0, 0.0, 0, 0.0, 0);
    for seed in 0..SEEDS {
        let mut cameras = rig::observe(&stations, &rig::wands(200, seed), seed, |_, _| true);
        rig::spoil_focal(&mut cameras, 0.002, seed);
        let (found, evidence) = calibrate(&cameras, &rig::options()).unwrap();
        let errors = rig::centre_errors(&found, &stations, false);
        centre_mm += 1e3 * errors.iter().sum::<f64>() / errors.len() as f64 / SEEDS as f64;
        let (centres, focals) = rig::normalised_squares(&found, &stations);
        squares += centres.iter().sum::<f64>();
        count += centres.len();
        focal_squares += focals.iter().sum::<f64>();
        focal_count += focals.len();
        let quality = found.quality.as_ref().unwrap();
        assert!((quality.variance_factor - 1.0).abs() < 0.06, "{}", quality.variance_factor);
        assert!(quality.condition.is_some_and(|condition| condition < 1e6), "{:?}", quality.condition);
        let held_out = quality.measures["held_out_whole_wand_rms_mm"];
        assert!((0.05..0.5).contains(&held_out), "{held_out} mm");
        assert!(evidence.held_out.len() > 100);
        assert!(found.warnings.is_empty() && found.cameras.iter().all(|camera| camera.warnings.is_empty()));
    }
    assert!(centre_mm <= 0.7, "{centre_mm} mm");
    // The cameras of a rig share the error of the first one's pose: six rigs are worth far fewer than 234 free errors.
    let (centres, focals) = (squares / count as f64, focal_squares / focal_count as f64);
    assert!((0.5..1.7).contains(&centres), "centres {centres}");
    assert!((0.6..1.5).contains(&focals), "focal lengths {focals}");
}
