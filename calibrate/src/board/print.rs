//! Targets to print at true size (SVG, PDF), and a page that blinks them for event cameras (HTML).

use std::fmt::Write as _;

use calib_targets_charuco::resolve_dictionary;

use super::{
    Target,
    aprilgrid::{BITS, BORDER, is_black},
};

/// What a target is drawn into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {
    /// Scalable vector graphics, its unit the millimetre.
    Svg,
    /// Portable document format, one page as large as the target with its margin.
    Pdf,
    /// A page that shows the target and nothing in turn, for event cameras.
    BlinkingHtml,
}

/// White around the target, in squares, or in spaces between tags: detectors need it.
pub(super) const MARGIN: f64 = 1.0;

/// A filled rectangle, millimetres: x, y, width, height.
type Rectangle = [f64; 4];

/// Size with margin, and the black rectangles. On an inverted target they are the white ones.
pub(super) struct Drawing {
    pub width: f64,
    pub height: f64,
    pub filled: Vec<Rectangle>,
    inverted: bool,
}

/// The target as a file of the kind. `blink_hz` is for [`Paper::BlinkingHtml`]: how often it comes and goes in a second.
#[must_use]
pub fn print(target: &Target, paper: Paper, blink_hz: f64) -> Vec<u8> {
    let drawing = draw(target);
    match paper {
        Paper::Svg => svg(&drawing, "mm").into_bytes(),
        Paper::Pdf => pdf(&drawing),
        Paper::BlinkingHtml => blinking(target, &drawing, blink_hz).into_bytes(),
    }
}

pub(super) fn draw(target: &Target) -> Drawing {
    if let &Target::AprilGrid { columns, rows, tag_m, spacing, first } = target {
        return draw_tags([columns, rows], first, 1e3 * tag_m, 1e3 * tag_m * spacing);
    }
    let (inner_columns, inner_rows) = target.corners();
    let (columns, rows) = (inner_columns + 1, inner_rows + 1);
    let square = 1e3 * target.square_m();
    let margin = MARGIN * square;
    let mut filled = Vec::new();
    // The number of the next marker.
    let mut white = target.numbers().start as usize;
    let begins_white = u32::from(target.begins_white());
    for row in 0..rows {
        for column in 0..columns {
            let (x, y) = (margin + f64::from(column) * square, margin + f64::from(row) * square);
            if (row + column) % 2 == begins_white {
                filled.push([x, y, square, square]);
            } else if let Target::Charuco { marker_m, dictionary, .. } = target {
                let side = 1e3 * marker_m;
                let corner = [x + 0.5 * (square - side), y + 0.5 * (square - side)];
                marker(dictionary, white, corner, side, &mut filled);
                white += 1;
            }
        }
    }
    Drawing {
        width: f64::from(columns) * square + 2.0 * margin,
        height: f64::from(rows) * square + 2.0 * margin,
        filled,
        inverted: matches!(target, Target::Charuco { inverted: true, .. }),
    }
}

/// Tags, lengths in millimetres: the one with the number `first` below left, a black square in each space between four.
fn draw_tags([columns, rows]: [u32; 2], first: u32, tag: f64, space: f64) -> Drawing {
    let (margin, pitch) = (MARGIN * space, tag + space);
    let [width, height] = [columns, rows].map(|count| f64::from(count) * pitch + space + 2.0 * margin);
    let mut filled = Vec::new();
    for row in 0..=rows {
        for column in 0..=columns {
            let (x, y) = (margin + f64::from(column) * pitch, margin + f64::from(row) * pitch);
            filled.push([x, y, space, space]);
            if row < rows && column < columns {
                let from_below = rows - 1 - row;
                april_tag(first + from_below * columns + column, [x + space, y + space], tag, &mut filled);
            }
        }
    }
    Drawing { width, height, filled, inverted: false }
}

/// The black cells of an AprilTag.
fn april_tag(id: u32, [x, y]: [f64; 2], side: f64, filled: &mut Vec<Rectangle>) {
    let cells = BITS + 2 * BORDER;
    let cell = side / cells as f64;
    for row in 0..cells {
        for column in 0..cells {
            // A cell of the border wraps around to one beyond the code.
            let of_code = is_black(id, row.wrapping_sub(BORDER), column.wrapping_sub(BORDER));
            if of_code.unwrap_or(true) {
                filled.push([x + column as f64 * cell, y + row as f64 * cell, cell, cell]);
            }
        }
    }
}

/// The black cells of a marker: a border of one cell, and the bits that are 0.
fn marker(dictionary: &str, id: usize, [x, y]: [f64; 2], side: f64, filled: &mut Vec<Rectangle>) {
    let Some(dictionary) = resolve_dictionary(dictionary) else { return };
    let Some(code) = dictionary.codes().get(id) else { return };
    let bits = dictionary.marker_size();
    let cell = side / (bits + 2) as f64;
    for row in 0..bits + 2 {
        for column in 0..bits + 2 {
            let border = row == 0 || column == 0 || row > bits || column > bits;
            let black = border || (code >> ((row - 1) * bits + column - 1)) & 1 == 1;
            if black {
                filled.push([x + column as f64 * cell, y + row as f64 * cell, cell, cell]);
            }
        }
    }
}

/// One path for all rectangles, so that no renderer leaves a seam between neighbours.
fn path(drawing: &Drawing) -> String {
    let mut path = String::new();
    for [x, y, width, height] in &drawing.filled {
        let _ = write!(path, "M{x:.4} {y:.4}h{width:.4}v{height:.4}h-{width:.4}z");
    }
    path
}

fn svg(drawing: &Drawing, unit: &str) -> String {
    let Drawing { width, height, inverted, .. } = drawing;
    let (paper, ink) = if *inverted { ("#000", "#fff") } else { ("#fff", "#000") };
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.4}{unit}\" height=\"{height:.4}{unit}\" \
         viewBox=\"0 0 {width:.4} {height:.4}\" shape-rendering=\"crispEdges\"><rect width=\"100%\" height=\"100%\" \
         fill=\"{paper}\"/><path id=\"target\" fill=\"{ink}\" d=\"{}\"/></svg>\n",
        path(drawing)
    )
}

/// A PDF of one page; its unit is the point, 1/72 inch.
fn pdf(drawing: &Drawing) -> Vec<u8> {
    const POINT: f64 = 72.0 / 25.4;
    let mut content = String::new();
    let (paper, ink) = if drawing.inverted { (0, 1) } else { (1, 0) };
    let _ = writeln!(content, "{paper} g 0 0 {:.4} {:.4} re f", drawing.width * POINT, drawing.height * POINT);
    let _ = writeln!(content, "{ink} g");
    for [x, y, width, height] in &drawing.filled {
        // y grows upwards in a PDF.
        let below = drawing.height - y - height;
        let [x, y, width, height] = [*x, below, *width, *height].map(|value| value * POINT);
        let _ = writeln!(content, "{x:.4} {y:.4} {width:.4} {height:.4} re");
    }
    content.push_str("f\n");
    let objects = [
        "<< /Type /Catalog /Pages 2 0 R >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.4} {:.4}] /Contents 4 0 R /Resources << >> >>",
            drawing.width * POINT,
            drawing.height * POINT
        ),
        format!("<< /Length {} >>\nstream\n{content}endstream", content.len()),
    ];
    let mut file = String::from("%PDF-1.4\n");
    let mut places = Vec::new();
    for (number, object) in (1..).zip(&objects) {
        places.push(file.len());
        let _ = write!(file, "{number} 0 obj\n{object}\nendobj\n");
    }
    let table = file.len();
    let _ = write!(file, "xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1);
    for place in places {
        // An entry is 20 bytes long, the blank before its end included.
        let _ = writeln!(file, "{place:010} 00000 n ");
    }
    let _ = write!(file, "trailer\n<< /Size {} /Root 1 0 R >>\nstartxref\n{table}\n%%EOF\n", objects.len() + 1);
    file.into_bytes()
}

fn blinking(target: &Target, drawing: &Drawing, blink_hz: f64) -> String {
    include_str!("blinking.html")
        .replace("{target}", &target.to_string())
        .replace("{hz}", &format!("{blink_hz}"))
        .replace("{width}", &format!("{:.4}", drawing.width))
        .replace("{height}", &format!("{:.4}", drawing.height))
        .replace("{paper}", if drawing.inverted { "#000" } else { "#fff" })
        .replace("{ink}", if drawing.inverted { "#fff" } else { "#000" })
        .replace("{path}", &path(drawing))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_of_true_size() {
        let target: Target = "chessboard:9x6:0.025".parse().unwrap();
        let svg = String::from_utf8(print(&target, Paper::Svg, 0.0)).unwrap();
        assert!(svg.contains("width=\"300.0000mm\" height=\"225.0000mm\""), "{}", &svg[..200]);
        let pdf = String::from_utf8(print(&target, Paper::Pdf, 0.0)).unwrap();
        // 300 mm are 850.3937 points.
        assert!(pdf.contains("/MediaBox [0 0 850.3937 637.7953]"), "{pdf}");
        let place: usize = pdf.rsplit("startxref\n").next().unwrap().lines().next().unwrap().parse().unwrap();
        assert!(pdf[place..].starts_with("xref"));
        let page = String::from_utf8(print(&target, Paper::BlinkingHtml, 20.0)).unwrap();
        assert!(page.contains("300.0000") && page.contains("chessboard:9x6:0.025") && !page.contains("{path}"));
    }
}
