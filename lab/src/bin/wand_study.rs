//! How accurate a calibration by wand is, and whether its standard deviations are right: many simulated calibrations of a
//! mixed rig with focal lengths that are 0.2 % wrong at first.
//!
//! `cargo run --release -p erfgs-lab --features studies --bin wand_study [seeds]`

#[path = "../../../calibrate/tests/it/wand/rig.rs"]
#[allow(dead_code, reason = "shared with the tests of the wand, which use more of it")]
mod rig;

use erfgs_calibrate::wand::{WandError, calibrate};

/// What is done about the focal length.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Focal {
    /// It is refined, known to 1 % beforehand (the default).
    Refined,
    /// It is refined, known to 0.2 % beforehand, as it is.
    Known,
    /// It is kept, wrong as it is.
    Kept,
    /// It is kept, and right.
    Exact,
}

fn main() -> Result<(), WandError> {
    let seeds: u64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(50);
    let stations = rig::mixed();
    println!(
        "{seeds} rigs of 8 RGB (0.2 px) and 6 event cameras (0.4 px), 3 m from the wand, focal 0.2 % wrong at first"
    );
    println!(
        "placements  focal    centre error mm (mean, max)  (mean, scale aligned too)  rotation deg  chi2/n centres (min..max)   chi2/n focals  s"
    );
    for (placements, focal) in [
        (50, Focal::Refined),
        (200, Focal::Refined),
        (200, Focal::Known),
        (800, Focal::Refined),
        (200, Focal::Kept),
        (200, Focal::Exact),
    ] {
        let since = std::time::Instant::now();
        let (mut sum, mut sum_scaled, mut worst, mut turn) = (0.0, 0.0, 0.0_f64, 0.0_f64);
        let (mut centres, mut focals) = (vec![0.0; 39], vec![0.0; 14]);
        for seed in 0..seeds {
            let mut cameras = rig::observe(&stations, &rig::wands(placements, seed), seed, |_, _| true);
            if focal != Focal::Exact {
                rig::spoil_focal(&mut cameras, 0.002, seed);
            }
            let mut options = rig::options();
            options.fix_focal = matches!(focal, Focal::Kept | Focal::Exact);
            if focal == Focal::Known {
                options.focal_sigma = 0.002;
            }
            let (found, _) = calibrate(&cameras, &options)?;
            let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
            let errors = rig::centre_errors(&found, &stations, false);
            sum += mean(&errors);
            sum_scaled += mean(&rig::centre_errors(&found, &stations, true));
            worst = errors.iter().copied().fold(worst, f64::max);
            turn = turn.max(rig::rotation_error_deg(&found, &stations));
            let (of_centres, of_focals) = rig::normalised_squares(&found, &stations);
            centres.iter_mut().zip(of_centres).for_each(|(sum, square)| *sum += square);
            focals.iter_mut().zip(of_focals).for_each(|(sum, square)| *sum += square);
        }
        let n = seeds as f64;
        let spread = |sums: &[f64]| {
            let mean = sums.iter().sum::<f64>() / sums.len() as f64 / n;
            let least = sums.iter().copied().fold(f64::INFINITY, f64::min) / n;
            let most = sums.iter().copied().fold(0.0, f64::max) / n;
            format!("{mean:.2} ({least:.2}..{most:.2})")
        };
        println!(
            "{placements:10}  {:7}  {:.2}, {:.2}  {:.2}  {turn:.4}  {}  {}  {:.2}",
            format!("{focal:?}").to_lowercase(),
            1e3 * sum / n,
            1e3 * worst,
            1e3 * sum_scaled / n,
            spread(&centres),
            if matches!(focal, Focal::Kept | Focal::Exact) { "-".into() } else { spread(&focals) },
            since.elapsed().as_secs_f64() / n
        );
    }
    Ok(())
}
