use super::*;
use crate::SweepOptions;

#[test]
fn senseless_options_are_refused_by_name() {
    let refused = |sweep: SweepOptions| check(&CloudOptions { sweep, ..CloudOptions::default() }).unwrap_err();
    let cases = [
        (SweepOptions { plane_step_px: 0.0, ..SweepOptions::default() }, "plane_step_px"),
        (SweepOptions { window: 8, ..SweepOptions::default() }, "window"),
        (SweepOptions { window: 17, ..SweepOptions::default() }, "window"),
        (SweepOptions { neighbours: 0, ..SweepOptions::default() }, "neighbours"),
        (SweepOptions { max_width: 0, ..SweepOptions::default() }, "max_width"),
        (SweepOptions { voxel_m: f64::NAN, ..SweepOptions::default() }, "voxel_m"),
        (SweepOptions { depth_tolerance: 1.5, ..SweepOptions::default() }, "depth_tolerance"),
    ];
    for (sweep, name) in cases {
        let message = refused(sweep).to_string();
        assert!(message.contains(name), "{message}");
    }
    assert!(check(&CloudOptions::default()).is_ok());
}
