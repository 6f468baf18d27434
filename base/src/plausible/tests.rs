use proptest::prelude::*;

use super::*;

const ALL: [Quantity; 19] = [
    SIDE,
    PIXELS,
    SENSOR,
    POSITION,
    POINT,
    QUATERNION,
    INSTANT,
    SPAN,
    EXPOSURE,
    OVERHANG,
    OVERLAP,
    OFFSET,
    RATE,
    TICK,
    THRESHOLD,
    LIN_LOG,
    REFRACTORY,
    SIGMA_PLACE,
    SIGMA_TIME,
];

/// What no quantity is, whatever its bounds.
fn never() -> impl Strategy<Value = f64> {
    prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e308, f64::MAX, f64::MIN])
}

fn lens(size: [u32; 2], focal: f64, centre: [f64; 2]) -> Lens<'static> {
    Lens { size, focal: [focal; 2], centre, distortion: &[] }
}

proptest! {
    #[test]
    fn a_value_is_believed_between_the_bounds_and_nowhere_else(
        quantity in prop::sample::select(ALL.to_vec()),
        share in 0.0..=1.0_f64,
        beyond in 1e-6..1e6_f64,
    ) {
        let inside = quantity.least + share * (quantity.most - quantity.least);
        prop_assert_eq!(quantity.check(inside), Ok(inside));
        let width = quantity.most - quantity.least;
        for value in [quantity.most + beyond * width, quantity.least - beyond * width] {
            let error = quantity.check(value).unwrap_err();
            prop_assert_eq!((error.quantity, error.value), (quantity, value));
            let text = error.to_string();
            prop_assert!(text.starts_with(quantity.name) && text.ends_with(quantity.remedy) && text.len() < 250, "{}", text);
        }
    }

    #[test]
    fn what_is_no_number_or_beyond_all_is_never_believed(quantity in prop::sample::select(ALL.to_vec()), value in never()) {
        prop_assert!(quantity.check(value).is_err());
    }

    #[test]
    fn lenses_of_microscopes_drones_and_large_cameras_are_believed(
        sides in prop::array::uniform2(16_u32..16_000),
        // From a fisheye of 180 degrees to a microscope.
        focal in (-1.2..3.0_f64).prop_map(|power| 10.0_f64.powf(power)),
        // A part of a picture of 60,000 pixels.
        offset in prop::array::uniform2(-6e4..6e4_f64),
        strength in -1.0..1.0_f64,
    ) {
        let longest = f64::from(sides[0].max(sides[1]));
        let middle = sides.map(|side| 0.5 * f64::from(side));
        let focal = focal * longest;
        // Coefficients that bend the corner by as much as the picture is large.
        let reach = middle[0].hypot(middle[1]) / focal;
        let terms = [2, 4, 6].map(|power| (strength / reach.powi(power), power));
        let centre = [middle[0] + offset[0], middle[1] + offset[1]];
        prop_assert_eq!(check_lens(&lens(sides, focal, centre)), Ok(()));
        prop_assert_eq!(check_lens(&Lens { distortion: &terms, ..lens(sides, focal, middle) }), Ok(()));
    }

    #[test]
    fn one_implausible_number_of_a_lens_is_named(
        sides in prop::array::uniform2(16_u32..16_000),
        value in prop_oneof![never(), (12.0..300.0_f64).prop_map(|power| 10.0_f64.powf(power))],
        axis in 0..2_usize,
        power in prop::sample::select(vec![2, 4, 6, 8]),
    ) {
        let longest = f64::from(sides[0].max(sides[1]));
        let middle = sides.map(|side| 0.5 * f64::from(side));
        let good = lens(sides, longest, middle);
        let mut focal = good;
        focal.focal[axis] = value;
        prop_assert_eq!(check_lens(&focal).unwrap_err().quantity.name, "the focal length");
        for short in [0.0, -1.0, -longest, 1e-3 * longest, f64::MIN_POSITIVE] {
            focal.focal[axis] = short;
            prop_assert_eq!(check_lens(&focal).unwrap_err().quantity.name, "the focal length");
        }
        let mut centre = good;
        centre.centre[axis] = value;
        prop_assert_eq!(check_lens(&centre).unwrap_err().quantity.name, "the principal point");
        let terms = [(0.1, 2), (value, power)];
        let error = check_lens(&Lens { distortion: &terms, ..good }).unwrap_err();
        prop_assert_eq!(error.quantity.name, "a distortion coefficient");
    }

    #[test]
    fn times_of_any_distance_are_compared_without_overflow(from in any::<i64>(), to in any::<i64>()) {
        let seconds = (to as f64 - from as f64) * 1e-9;
        prop_assume!((seconds.abs() - SPAN.most).abs() > 1.0 && seconds.abs() > 1.0);
        prop_assert_eq!(SPAN.check_between_ns([from, to]).is_ok(), SPAN.holds(seconds));
    }
}

#[test]
fn pictures_of_a_hundred_million_pixels_are_believed_and_of_billions_are_not() {
    for size in [[1, 1], [11_648, 8_736], [14_204, 10_652], [65_535, 4_000]] {
        assert_eq!(check_size(size), Ok(size));
    }
    for size in [[0, 0], [1280, 720], [2048, 2048], [11_648, 8_736]] {
        assert_eq!(check_sensor(size), Ok(size));
    }
    for size in [[20_000, 20_000], [65_535, 65_535], [65_536, 1], [u32::MAX, 0]] {
        assert!(check_sensor(size).is_err(), "{size:?}");
    }
    for size in [[0, 480], [640, 0], [65_536, 1], [65_535, 65_535], [u32::MAX, u32::MAX], [30_000, 30_000]] {
        assert!(check_size(size).is_err(), "{size:?}");
    }
}

#[test]
fn the_documentation_lists_every_quantity_with_its_bounds() {
    let page = include_str!("../../../docs/reference/event-formats.md");
    for quantity in ALL.into_iter().filter(|quantity| ![QUATERNION, LIN_LOG].contains(quantity)) {
        let bound = |value: f64| format!("{}{}", Brief(value), Unit(quantity.unit));
        let row = format!("| {} | {} | {} |", quantity.name, bound(quantity.least), bound(quantity.most));
        assert!(page.contains(&row), "{row}");
    }
}

#[test]
fn the_message_names_quantity_value_bounds_and_remedy() {
    let error = check_lens(&lens([640, 480], 1e308, [320.0, 240.0])).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the focal length is 1e308 px, and 6.4 to 6.4e7 px is plausible; a focal length is in pixels: calibrate or import it again"
    );
}
