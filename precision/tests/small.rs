//! Every component runs in small, and its curves are what they must be.

use erfgs_precision::{Bench, Kept, Size, Spent, components};
use erfgs_splat::gpu::{AdapterChoice, Gpu};

#[test]
fn every_setting_of_the_small_components_runs_and_each_curve_has_its_default() {
    let bench = Bench::new(Gpu::open(&AdapterChoice::default()).expect("an adapter")).expect("kernels");
    for component in components(Size::Small) {
        let outcome = component.run(&bench, 0.0, &mut Kept::default(), |_| {});
        let name = outcome.about.name;
        assert_eq!(outcome.refused().collect::<Vec<_>>(), [[""; 3]; 0], "{name}");
        for curve in &outcome.curves {
            let marked = curve.places.iter().filter(|place| place.default).count();
            assert!(marked == 1 && curve.places.len() > 1, "{name}, {}: {marked} defaults", curve.knob);
        }
        let error = |knob: &str, setting: &str, measure: usize| {
            let curve = outcome.curves.iter().find(|curve| curve.knob == knob).expect(knob);
            let place = curve.places.iter().find(|place| place.setting == setting).expect(setting);
            let spent: &Spent = place.came.as_ref().expect("an outcome");
            spent.errors[measure]
        };
        // What must be finer is finer.
        match name {
            "rasteriser" => {
                assert!(error("SH degree", "3", 0) < 0.2 * error("SH degree", "2", 0));
                assert!(error("SH degree", "3", 1) < 1e-4, "rounding in single precision");
            }
            "event simulator" => {
                let rate = |mode, fps| error(&format!("frames a second, {mode}"), fps, 0);
                assert!(rate("parity", "5000 /s") < rate("parity", "500 /s"));
                assert!(rate("enhanced", "500 /s") < rate("parity", "500 /s"));
            }
            "clock fit" => assert!(error("window", "5 s", 0) < 0.5 * error("window", "one line", 0)),
            "bundle adjustment" => {
                assert!(error("most iterations", "100", 0) < 0.1 * error("most iterations", "2", 0));
            }
            "initial points" => {
                assert!(error("instants of the hull", "12", 1) < error("instants of the hull", "3", 1));
            }
            "training" => assert!(error("iterations", "30+60", 2) < error("iterations", "5+5", 2)),
            // So short a training tells no setting from another, but it shows more than nothing.
            "motion, free in time" => assert!(error("knots of a path on either side", "2", 0) < 0.3),
            "deformation field" => assert!(error("levels of the planes", "[1, 2]", 0) < 0.3),
            other => panic!("nothing is asked of {other}"),
        }
    }
}
