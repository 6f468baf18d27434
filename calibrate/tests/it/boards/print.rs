//! What is printed, as a renderer draws it.

use erfgs_calibrate::board::{Paper, Target, detect, print};
use erfgs_scene::ImageRgb8;
use glam::DVec2;

/// What follows `key` in a drawing, up to the next of these.
fn after<'a>(svg: &'a str, key: &str, ends: &[char]) -> &'a str {
    svg.split(key).nth(1).unwrap().split(ends).next().unwrap()
}

fn grey(colour: &str) -> u8 {
    match colour {
        "black" | "#000" | "#000000" => 20,
        "white" | "#fff" | "#ffffff" => 230,
        other => panic!("{other}"),
    }
}

fn height_mm(svg: &str) -> f64 {
    after(svg, " height=\"", &['m', '"']).parse().unwrap()
}

/// The drawing as a picture of `scale` pixels per millimetre.
fn picture(svg: &str, scale: f64) -> ImageRgb8 {
    let width: f64 = after(svg, " width=\"", &['m', '"']).parse().unwrap();
    let (width, height) = ((width * scale) as u32, (height_mm(svg) * scale) as u32);
    let paper = grey(after(svg, "<rect width=\"100%\" height=\"100%\" fill=\"", &['"']));
    let ink = grey(after(svg, "<path id=\"target\" fill=\"", &['"']));
    let mut image = ImageRgb8 { width, height, data: vec![paper; (3 * width * height) as usize] };
    for rectangle in after(svg, " d=\"M", &['"']).split('M') {
        let numbers: Vec<f64> =
            rectangle.split(['M', ' ', 'h', 'v', 'z']).filter_map(|number| number.parse().ok()).collect();
        let [x, y, w, h, back] = numbers[..] else { panic!("{rectangle}") };
        assert_eq!(back, -w, "{rectangle}");
        for row in (y * scale).round() as u32..((y + h) * scale).round() as u32 {
            for column in (x * scale).round() as u32..((x + w) * scale).round() as u32 {
                let at = 3 * (row * width + column) as usize;
                image.data[at..at + 3].fill(ink);
            }
        }
    }
    image
}

#[test]
fn what_is_printed_is_found_again_corner_by_corner() {
    // A target, and one that is drawn alike with other markers.
    for (text, other) in [
        ("chessboard:9x6:0.025", None),
        ("charuco:5x7:0.03:0.0225:DICT_4X4_50", Some("charuco:5x7:0.03:0.0225:DICT_4X4_50:first=17")),
        ("charuco:4x5:0.03:0.024:DICT_5X5_100:inverted", Some("charuco:4x5:0.03:0.024:DICT_5X5_100:inverted:first=10")),
        ("aprilgrid:4x3:0.05:0.3", Some("aprilgrid:4x3:0.05:0.3:first=12")),
        ("charuco:5x7:0.03:0.0225:DICT_4X4_50:first=33", Some("charuco:5x7:0.03:0.0225:DICT_4X4_50")),
        (
            "charuco:5x6:0.03:0.0225:DICT_4X4_100:legacy:first=1",
            Some("charuco:5x6:0.03:0.0225:DICT_4X4_100:legacy:first=16"),
        ),
        ("aprilgrid:4x3:0.05:0.3:first=575", Some("aprilgrid:4x3:0.05:0.3")),
    ] {
        let target: Target = text.parse().unwrap();
        let printed = String::from_utf8(print(&target, Paper::Svg, 0.0)).unwrap();
        let scale = 2.4;
        let seen = picture(&printed, scale);
        let corners = detect(&seen, &target);
        let (columns, rows) = target.corners();
        assert_eq!(corners.len(), (columns * rows) as usize, "{text}");
        if let Some(other) = other {
            assert_eq!(detect(&seen, &other.parse().unwrap()), [], "{text} is not {other}");
        }
        for corner in corners {
            let point = target.point(corner.id).unwrap().truncate() * 1e3;
            let square = 1e3 * target.square_m();
            let place = scale
                * match target {
                    // A chessboard counts from its first inner corner, a ChArUco board from its edge.
                    Target::Chessboard { .. } => point + 2.0 * square,
                    Target::Charuco { .. } => point + square,
                    // From below, beyond the margin and the squares at the outer tags' corners.
                    Target::AprilGrid { spacing, .. } => {
                        let from = 2.0 * spacing * square;
                        DVec2::new(from + point.x, height_mm(&printed) - from - point.y)
                    }
                };
            assert!((corner.pixel - place).length() < 0.6, "{text} {}: {} {place}", corner.id, corner.pixel);
        }
    }
}
