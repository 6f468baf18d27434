//! A table of numbers: a line for each training.

use std::fmt::Write as _;

use crate::Board;

/// The header and a line for each training. What is not known is empty.
#[must_use]
pub fn csv(board: &Board) -> String {
    let mut text = String::from(
        "act,seed,method,psnr_db,static_psnr_db,dpsnr_db,between_dpsnr_db,fast_psnr_db,cpu_seconds,gap_closed\n",
    );
    let known = |value: Option<f64>| value.map_or(String::new(), |value| ((1e4 * value).round() / 1e4).to_string());
    for row in &board.rows {
        let figures = row.quality.figures().into_iter().chain([board.share(row)]);
        let cells: Vec<String> = figures.map(known).collect();
        let _ = writeln!(text, "{},{},{},{}", row.act, row.seed, row.method, cells.join(","));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_training_is_a_line_of_as_many_cells_as_the_header() {
        let text = csv(&crate::board::tests::board());
        let cells: Vec<usize> = text.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(cells, [10; 10]);
        assert!(text.contains("throw,1,erf-gs,25,30,18,17,,60,0.25\n"), "{text}");
    }
}
