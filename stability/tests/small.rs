//! The small suite passes.

use erfgs_splat::gpu::{AdapterChoice, Gpu};
use erfgs_stability::{Bench, Size, cases};

#[test]
fn every_case_of_the_small_suite_is_as_it_must_be() {
    let bench = Bench::new(Gpu::open(&AdapterChoice::default()).expect("an adapter")).expect("kernels");
    let rows: Vec<_> = cases(Size::Small).iter().map(|case| case.run(&bench)).collect();
    let failed: Vec<String> = rows
        .iter()
        .filter(|row| row.failed())
        .map(|row| format!("{}: {}: {} ({:?})", row.part, row.name, row.verdict, row.measured))
        .collect();
    assert!(rows.len() > 60, "{} cases", rows.len());
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}
