//! What is printed on a board.

use std::{
    collections::BTreeMap,
    fmt,
    ops::Range,
    str::FromStr,
    sync::{Mutex, PoisonError},
};

use calib_targets_charuco::{CharucoBoardSpec, Dictionary, resolve_dictionary};
use glam::{DQuat, DVec3};

use super::aprilgrid::TAG_FAMILY;

/// A flat target. Its frame: origin at the first inner corner of a chessboard, or at the outer corner of a ChArUco board; x to
/// the right, y down on the printed sheet, z into it. That of an AprilGrid is Kalibr's: origin at the lower left corner of the
/// lower left tag, x to the right, y up, z out of the sheet.
#[derive(Clone, Debug, PartialEq)]
pub enum Target {
    /// `chessboard:COLUMNSxROWS:SQUARE`: inner corners, and the side of a square in metres.
    Chessboard {
        /// Inner corners in a row.
        columns: u32,
        /// Rows of inner corners.
        rows: u32,
        /// Side of a square, metres.
        square_m: f64,
    },
    /// `charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY`: squares, their side and a marker's in metres. `:first=N` behind it: its
    /// markers count from N.
    Charuco {
        /// Squares in a row.
        columns: u32,
        /// Rows of squares.
        rows: u32,
        /// Side of a square, metres.
        square_m: f64,
        /// Side of a marker, metres.
        marker_m: f64,
        /// The markers' dictionary, by OpenCV's name, such as `DICT_4X4_50`.
        dictionary: String,
        /// Whether black and white are exchanged on the print.
        inverted: bool,
        /// Whether an even number of rows begins with a white square, as OpenCV drew boards before version 4.6.
        legacy: bool,
        /// The number of its first marker in the dictionary.
        first: u32,
    },
    /// `aprilgrid:COLUMNSxROWS:TAG:SPACING`: tags of the family 36h11 with a black square at each corner, as Kalibr prints them;
    /// they count from the lower left, row by row, from 0 or, with `:first=N` behind it, from N.
    AprilGrid {
        /// Tags in a row.
        columns: u32,
        /// Rows of tags.
        rows: u32,
        /// Side of a tag, its black border included, metres.
        tag_m: f64,
        /// The space between two tags as a share of a tag's side.
        spacing: f64,
        /// The number of its first tag in the family.
        first: u32,
    },
}

impl Target {
    /// Where corner `id` is on the target, metres; ids count row by row from 0. An AprilGrid has two rows of corners for each
    /// row of tags, from below.
    #[must_use]
    pub fn point(&self, id: u32) -> Option<DVec3> {
        let (columns, rows) = self.corners();
        if id >= columns * rows {
            return None;
        }
        let (column, row) = (f64::from(id % columns), f64::from(id / columns));
        Some(match self {
            Self::Chessboard { square_m, .. } => DVec3::new(column, row, 0.0) * *square_m,
            Self::Charuco { square_m, .. } => DVec3::new(column + 1.0, row + 1.0, 0.0) * *square_m,
            Self::AprilGrid { tag_m, spacing, .. } => {
                // Two corners for each tag; a tag and the space after it for each pair.
                let along = |index: f64| (index / 2.0).floor() * (1.0 + spacing) + index % 2.0;
                DVec3::new(along(column), along(row), 0.0) * *tag_m
            }
        })
    }

    /// Corners in a row, and rows of them: inner ones, or those of tags.
    #[must_use]
    pub fn corners(&self) -> (u32, u32) {
        match self {
            Self::Chessboard { columns, rows, .. } => (*columns, *rows),
            Self::Charuco { columns, rows, .. } => (columns - 1, rows - 1),
            Self::AprilGrid { columns, rows, .. } => (2 * columns, 2 * rows),
        }
    }

    /// Side of a square, or of a tag of an AprilGrid, metres.
    #[must_use]
    pub fn square_m(&self) -> f64 {
        match self {
            Self::Chessboard { square_m, .. } | Self::Charuco { square_m, .. } => *square_m,
            Self::AprilGrid { tag_m, .. } => *tag_m,
        }
    }

    /// The target as it looks where ink is dark, whatever colour it is printed in.
    pub(super) fn as_inked(&self) -> Self {
        let mut target = self.clone();
        if let Self::Charuco { inverted, .. } = &mut target {
            *inverted = false;
        }
        target
    }

    /// What the ChArUco detector has to know; lengths in squares. `None` for other targets.
    pub(super) fn charuco(&self) -> Option<Charuco> {
        let Self::Charuco { columns, rows, square_m, marker_m, dictionary, first, .. } = self else { return None };
        let (dictionary, above) = (dictionary_named(dictionary)?, u32::from(self.begins_white()));
        // A board that begins with a white square is one that begins with a black one, without its first row.
        let dictionary = counted_from(dictionary, i64::from(*first) - i64::from(above * (columns / 2)))?;
        let board = CharucoBoardSpec::new(*rows + above, *columns, 1.0, (marker_m / square_m) as f32, dictionary);
        Some(Charuco { board, first: above * (columns - 1) })
    }

    /// Number of markers or tags; a chessboard has none.
    pub(super) fn markers(&self) -> u32 {
        match self {
            Self::Chessboard { .. } => 0,
            Self::Charuco { columns, rows, .. } => columns * rows / 2,
            Self::AprilGrid { columns, rows, .. } => columns * rows,
        }
    }

    /// The numbers of its markers or tags in their dictionary; empty for a chessboard.
    pub(super) fn numbers(&self) -> Range<u32> {
        match self {
            Self::Chessboard { .. } => 0..0,
            Self::Charuco { first, .. } | Self::AprilGrid { first, .. } => *first..*first + self.markers(),
        }
    }

    /// The same target with markers or tags from the number `from` on; `None` where its dictionary has not so many.
    pub(super) fn numbered_from(&self, from: u32) -> Option<Self> {
        let mut target = self.clone();
        if let Self::Charuco { first, .. } | Self::AprilGrid { first, .. } = &mut target {
            *first = from;
        }
        (target.numbers().end as usize <= target.dictionary()?.codes().len()).then_some(target)
    }

    /// The dictionary of its markers or tags; `None` for a chessboard.
    pub(super) fn dictionary(&self) -> Option<Dictionary> {
        match self {
            Self::Chessboard { .. } => None,
            Self::Charuco { dictionary, .. } => dictionary_named(dictionary),
            Self::AprilGrid { .. } => dictionary_named(TAG_FAMILY),
        }
    }

    /// Turns the target's frame to that of the sheet: x to the right, y down, z into it.
    pub(super) fn to_sheet(&self) -> DQuat {
        match self {
            Self::Chessboard { .. } | Self::Charuco { .. } => DQuat::IDENTITY,
            Self::AprilGrid { .. } => DQuat::from_rotation_x(std::f64::consts::PI),
        }
    }

    /// The point between its outermost corners, metres.
    pub(super) fn middle(&self) -> DVec3 {
        let (columns, rows) = self.corners();
        self.point(columns * rows - 1).zip(self.point(0)).map_or(DVec3::ZERO, |(last, first)| 0.5 * (first + last))
    }

    /// Whether the square above left is white.
    pub(super) fn begins_white(&self) -> bool {
        matches!(self, Self::Charuco { legacy: true, rows, .. } if rows % 2 == 0)
    }
}

/// A board as the detector knows it.
pub(super) struct Charuco {
    pub board: CharucoBoardSpec,
    /// The number there of our first corner.
    pub first: u32,
}

/// A dictionary whose markers are counted from `first`: those before come after its end, and where it is negative, as many of
/// those at its end come before. Kept as long as the program runs, once for each dictionary and number.
fn counted_from(dictionary: Dictionary, first: i64) -> Option<Dictionary> {
    static KEPT: Mutex<BTreeMap<(&str, i64), &[u64]>> = Mutex::new(BTreeMap::new());
    if first == 0 {
        return Some(dictionary);
    }
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    let codes = kept.entry((dictionary.name(), first)).or_insert_with(|| {
        let mut codes = dictionary.codes().to_vec();
        let by = first.rem_euclid(codes.len().max(1) as i64);
        codes.rotate_left(by as usize);
        codes.leak()
    });
    Dictionary::from_static_codes(dictionary.name(), dictionary.marker_size(), dictionary.max_correction_bits(), codes)
        .ok()
}

/// No square or tag is longer, metres.
const LONGEST_M: f64 = 1.0;

/// What is probably meant by a length that is too great to be of metres; `None` where it can be.
#[must_use]
pub fn not_metres(value: f64, longest_m: f64) -> Option<String> {
    (value > longest_m).then(|| {
        let read_as = [(1e-3, "millimetres"), (1e-2, "centimetres"), (0.0254, "inches")];
        let likely = read_as.iter().filter(|(unit, _)| value * unit <= longest_m);
        let likely: Vec<String> =
            likely.map(|(unit, name)| format!("if it is {name}, write {}", shortest(value * unit))).collect();
        if likely.is_empty() { "give it in metres".into() } else { likely.join("; ") }
    })
}

/// A number without what the last digits of a product add to it.
fn shortest(value: f64) -> f64 {
    format!("{value:.6}").parse().unwrap_or(value)
}

/// The number of the first marker, from `first=NUMBER`.
fn number_of_first(word: &str) -> Option<u32> {
    word.strip_prefix("first=")?.parse().ok().filter(|first| *first < 100_000)
}

/// A dictionary by its name, in whatever case: those of AprilTags have a small h in it.
fn dictionary_named(name: &str) -> Option<Dictionary> {
    let name = name.to_ascii_uppercase();
    resolve_dictionary(&name).or_else(|| resolve_dictionary(&name.replace('H', "h")))
}

impl FromStr for Target {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |what: &str| {
            format!(
                "'{text}' is not a target: {what}; write chessboard:9x6:0.025 (inner corners, metres), \
                 charuco:5x4:0.054:0.0405:DICT_4X4_50 (squares, metres) or aprilgrid:6x6:0.088:0.3 (tags, metres, share of a tag)"
            )
        };
        let mut parts = text.split(':');
        let kind = parts.next().unwrap_or_default();
        let size = parts.next().ok_or_else(|| wrong("its size is missing"))?;
        let (columns, rows) = size.split_once('x').ok_or_else(|| wrong("its size is not COLUMNSxROWS"))?;
        let count = |text: &str| text.parse::<u32>().ok().filter(|count| (2..=200).contains(count));
        let (columns, rows) = count(columns)
            .zip(count(rows))
            .ok_or_else(|| wrong("columns and rows must be whole numbers from 2 to 200"))?;
        let mut length = |what: &str| {
            let value = parts.next().and_then(|text| text.parse::<f64>().ok());
            let value = value
                .filter(|v| *v > 0.0 && v.is_finite())
                .ok_or_else(|| wrong(&format!("its {what} is no length in metres")))?;
            match not_metres(value, LONGEST_M) {
                Some(meant) => Err(wrong(&format!("a {what} of {value} m cannot be; {meant}"))),
                None => Ok(value),
            }
        };
        let square_m = length(if kind == "aprilgrid" { "tag" } else { "square" })?;
        let target = match kind {
            "chessboard" => Self::Chessboard { columns, rows, square_m },
            "charuco" => {
                let marker_m = length("marker")?;
                if marker_m >= square_m {
                    return Err(wrong("its marker is not smaller than its square"));
                }
                let dictionary = parts.next().unwrap_or("DICT_4X4_50");
                let known = dictionary_named(dictionary);
                let dictionary = known.ok_or_else(|| wrong(&format!("there is no dictionary {dictionary}")))?;
                let dictionary = dictionary.name().to_owned();
                let (mut inverted, mut legacy, mut first) = (false, false, 0);
                for word in parts.by_ref() {
                    match word {
                        "inverted" => inverted = true,
                        "legacy" => legacy = true,
                        _ => {
                            let what = "after the dictionary only 'inverted', 'legacy' and 'first=NUMBER' may stand";
                            first = number_of_first(word).ok_or_else(|| wrong(what))?;
                        }
                    }
                }
                if columns < 3 || rows < 3 {
                    return Err(wrong("a ChArUco board has at least 3x3 squares"));
                }
                Self::Charuco { columns, rows, square_m, marker_m, dictionary, inverted, legacy, first }
            }
            "aprilgrid" => {
                let spacing = parts.next().and_then(|text| text.parse::<f64>().ok());
                let spacing = spacing
                    .filter(|share| (0.05..=1.0).contains(share))
                    .ok_or_else(|| wrong("its spacing is no share of a tag's side from 0.05 to 1"))?;
                let first = parts.next().map_or(Some(0), number_of_first);
                let first = first.ok_or_else(|| wrong("after the spacing only 'first=NUMBER' may stand"))?;
                Self::AprilGrid { columns, rows, tag_m: square_m, spacing, first }
            }
            _ => return Err(wrong("its kind is none of chessboard, charuco and aprilgrid")),
        };
        if parts.next().is_some() {
            return Err(wrong("it has too many parts"));
        }
        if let Some(dictionary) = target.dictionary()
            && target.numbers().end as usize > dictionary.codes().len()
        {
            let (name, count, numbers) = (dictionary.name(), dictionary.codes().len(), target.numbers());
            return Err(wrong(&format!(
                "its markers have the numbers {} to {}, and {name} has {count} only, from 0",
                numbers.start,
                numbers.end - 1
            )));
        }
        Ok(target)
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Chessboard { columns, rows, square_m } => write!(f, "chessboard:{columns}x{rows}:{square_m}"),
            Self::Charuco { columns, rows, square_m, marker_m, dictionary, inverted, legacy, first } => {
                let inverted = if *inverted { ":inverted" } else { "" };
                let legacy = if *legacy { ":legacy" } else { "" };
                write!(f, "charuco:{columns}x{rows}:{square_m}:{marker_m}:{dictionary}{inverted}{legacy}")?;
                first_word(f, *first)
            }
            Self::AprilGrid { columns, rows, tag_m, spacing, first } => {
                write!(f, "aprilgrid:{columns}x{rows}:{tag_m}:{spacing}")?;
                first_word(f, *first)
            }
        }
    }
}

fn first_word(f: &mut fmt::Formatter<'_>, first: u32) -> fmt::Result {
    if first > 0 { write!(f, ":first={first}") } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_written_as_they_are_read() {
        for text in [
            "chessboard:9x6:0.025",
            "charuco:4x5:0.054:0.0405:DICT_4X4_1000:inverted",
            "aprilgrid:6x6:0.088:0.3",
            "charuco:5x6:0.03:0.02:DICT_4X4_50:legacy",
            "charuco:5x6:0.03:0.02:DICT_4X4_50:inverted:legacy",
            "charuco:5x6:0.03:0.02:DICT_4X4_50:inverted:legacy:first=35",
            "aprilgrid:6x6:0.088:0.3:first=551",
            "charuco:5x4:0.05:0.04:DICT_APRILTAG_36h11",
        ] {
            assert_eq!(text.parse::<Target>().unwrap().to_string(), text);
        }
        let board: Target = "charuco:4x5:0.054:0.0405:DICT_4X4_1000".parse().unwrap();
        assert_eq!((board.corners(), board.point(3)), ((3, 4), Some(DVec3::new(0.054, 0.108, 0.0))));
        assert_eq!(board.point(12), None);
        assert!(board.charuco().is_some());
    }

    #[test]
    fn corners_of_an_aprilgrid_count_as_kalibr_counts_them() {
        let grid: Target = "aprilgrid:2x3:0.1:0.5".parse().unwrap();
        assert_eq!(grid.corners(), (4, 6));
        let point = |id| grid.point(id).unwrap();
        for (id, x, y) in
            [(0, 0.0, 0.0), (1, 0.1, 0.0), (2, 0.15, 0.0), (7, 0.25, 0.1), (8, 0.0, 0.15), (23, 0.25, 0.4)]
        {
            assert!((point(id) - DVec3::new(x, y, 0.0)).length() < 1e-12, "{id}: {}", point(id));
        }
    }

    #[test]
    fn wrong_targets_are_told_what_is_wrong() {
        for (text, what) in [
            ("chessboard", "size is missing"),
            ("chessboard:9x1:0.02", "from 2 to 200"),
            ("chessboard:9x6:-1", "square"),
            ("chessboard:9x6:0.02:1", "too many"),
            ("chessboard:9x6:60", "if it is millimetres, write 0.06"),
            ("charuco:5x4:54:40:DICT_4X4_50", "write 0.054"),
            ("charuco:5x4:0.02:0.03", "smaller"),
            ("charuco:5x4:0.02:0.01:DICT_9", "dictionary"),
            ("aprilgrid:6x6:0.088", "spacing"),
            ("aprilgrid:6x6:0:0.3", "tag is no length"),
            ("aprilgrid:6x6:0.088:1.5", "spacing"),
            ("aprilgrid:30x20:0.088:0.3", "587"),
            ("aprilgrid:6x6:0.088:0.3:first=552", "552 to 587"),
            ("aprilgrid:6x6:0.088:0.3:36", "first=NUMBER"),
            ("charuco:5x4:0.02:0.01:DICT_4X4_50:first=41", "41 to 50"),
            ("charuco:5x4:0.02:0.01:DICT_4X4_50:first=-1", "first=NUMBER"),
            ("charuco:11x10:0.02:0.01:DICT_4X4_50", "0 to 54"),
            ("circles:5x4:0.02", "kind"),
        ] {
            let message = text.parse::<Target>().unwrap_err();
            assert!(message.contains(what), "{text}: {message}");
        }
    }
}
