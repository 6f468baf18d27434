use super::*;
use crate::{ColmapOptions, MatchOptions};

#[test]
fn senseless_options_are_refused_by_name() {
    let refused = |colmap: ColmapOptions| check(&CloudOptions { colmap, ..CloudOptions::default() }).unwrap_err();
    let matching = |matching| ColmapOptions { matching, ..ColmapOptions::default() };
    let cases = [
        (ColmapOptions { enlarge: 0, ..ColmapOptions::default() }, "enlarge"),
        (matching(MatchOptions { band_px: f64::NAN, ..MatchOptions::default() }), "band_px"),
        (matching(MatchOptions { ratio: 0.0, ..MatchOptions::default() }), "ratio"),
        (matching(MatchOptions { max_ray_angle_deg: 181.0, ..MatchOptions::default() }), "max_ray_angle_deg"),
    ];
    for (colmap, name) in cases {
        let message = refused(colmap).to_string();
        assert!(message.contains(name), "{message}");
    }
    assert!(check(&CloudOptions::default()).is_ok());
}

#[test]
fn enlarging_moves_the_principal_point_with_the_pixels() {
    let k = Intrinsics {
        width: 320,
        height: 180,
        fx: 240.0,
        fy: 238.0,
        cx: 160.5,
        cy: 91.0,
        distortion: erfgs_scene::Distortion::None,
    };
    let twice = enlarge(&k, 2);
    assert_eq!((twice.width, twice.height, twice.cx, twice.cy, twice.fy), (640, 360, 321.0, 182.0, 476.0));
}
