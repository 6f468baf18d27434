//! The scoreboard as numbers, as a document and as a page.

mod csv;
mod markdown;
mod page;

pub use csv::csv;
pub use markdown::markdown;
pub use page::page;

/// How the scoreboard was made.
#[derive(Clone, Debug)]
pub struct Made {
    /// The command.
    pub command: String,
    /// The program's version.
    pub version: String,
    /// The adapter that trained.
    pub adapter: String,
    /// What was trained, in words.
    pub what: String,
}

/// What the columns of tables are called: the figures of [`crate::Quality::figures`], and the share closed.
pub const COLUMNS: [&str; 7] =
    ["PSNR, dB", "still, dB", "DPSNR, dB", "between, dB", "fast, dB", "processor, min", "gap closed"];

/// The columns in words.
const EXPLAINED: &str = "PSNR is of whole held-out frames, \"still\" of where nothing moves, DPSNR of what moves, \"between\" of that between \
                         the exposures of the training frames, \"fast\" of the tenth of it that changes most. \"Gap closed\" is (x - 4dgs) / \
                         (ceiling - 4dgs) of DPSNR, for each take alone; the ceiling is 4DGS on what the same cameras would have recorded if \
                         they were sharp and eight times as fast.";

/// A figure of a column; a dash where it is not known.
#[must_use]
pub fn cell(column: usize, value: Option<f64>) -> String {
    match (column, value) {
        (_, None) => "-".into(),
        (5, Some(seconds)) => format!("{:.1}", seconds / 60.0),
        (6, Some(share)) => format!("{:.0} %", 100.0 * share),
        (_, Some(value)) => format!("{value:.2}"),
    }
}
