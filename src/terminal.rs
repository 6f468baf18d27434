//! What reaches the user: results on stdout, everything else on stderr.

use std::io::Write;

use anyhow::Context;
use erfgs_base::names::printable;
use serde::Serialize;

use crate::progress::{Progress, Shown};

/// Options that every command takes.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Terminal {
    /// Print figures as JSON on stdout.
    #[arg(long, global = true, display_order = 900)]
    json: bool,
    /// No progress bars and no notes.
    #[arg(long, short, global = true, display_order = 901)]
    quiet: bool,
    /// How progress is shown.
    #[arg(
        long,
        global = true,
        value_enum,
        value_name = "HOW",
        default_value = "bar",
        hide_default_value = true,
        display_order = 901
    )]
    progress: Shown,
    /// Log what the libraries do on stderr; the environment variable RUST_LOG filters it.
    #[arg(long, short, global = true, display_order = 902)]
    verbose: bool,
}

impl Terminal {
    /// Starts the log.
    pub fn start_log(&self) {
        // The board detectors warn of every picture without a board.
        let level = if self.verbose {
            "erfgs=debug,info,wgpu=warn,naga=warn,calib_targets_charuco=error"
        } else {
            "warn,wgpu=error,naga=error,calib_targets_charuco=error"
        };
        let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| level.into());
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).without_time().init();
    }

    /// Prints a result: `value` under `--json`, `text` otherwise.
    pub fn result(&self, value: &impl Serialize, text: impl FnOnce() -> String) -> anyhow::Result<()> {
        let mut text = if self.json {
            serde_json::to_string_pretty(value).context("cannot write JSON")?
        } else {
            printable(&text())
        };
        if !text.ends_with('\n') {
            text.push('\n');
        }
        self.raw(text.as_bytes())
    }

    /// Prints bytes as they are on stdout.
    pub fn raw(&self, bytes: &[u8]) -> anyhow::Result<()> {
        match std::io::stdout().lock().write_all(bytes) {
            // `erfgs info run | head` closes the pipe early; that is no failure.
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
            other => other.context("cannot write to stdout"),
        }
    }

    /// Whether progress and remarks are not wanted.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Prints a remark on stderr.
    pub fn note(&self, text: impl AsRef<str>) {
        if !self.quiet {
            eprintln!("{}", printable(text.as_ref()));
        }
    }

    /// A progress display for a piece of work.
    pub fn progress(&self, label: &str) -> Progress {
        Progress::new(label, self.quiet, self.progress)
    }
}

/// A table for humans: columns padded to their widest cell, two spaces apart. A column of numbers under its heading
/// stands to the right.
pub fn table(rows: &[Vec<String>]) -> String {
    let rows: Vec<Vec<String>> = rows.iter().map(|row| shortened(row)).collect();
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let cells = |column: usize| rows.iter().filter_map(move |row| row.get(column));
    let widths: Vec<usize> =
        (0..columns).map(|column| cells(column).map(|cell| cell.chars().count()).max().unwrap_or(0)).collect();
    let is_figure = |cell: &String| cell == "-" || cell.replace(',', "").parse::<f64>().is_ok();
    let figures: Vec<bool> =
        (0..columns).map(|column| rows.len() > 1 && cells(column).skip(1).all(is_figure)).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for ((cell, &width), &right) in row.iter().zip(&widths).zip(&figures) {
            line.push_str(&if right { format!("{cell:>width$}  ") } else { format!("{cell:<width$}  ") });
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// The cells of a row, so short that a terminal can show them: what files say may have any length. The last cell may be longer,
/// since nothing stands beside it.
fn shortened(row: &[String]) -> Vec<String> {
    let cut = |(column, cell): (usize, &String)| {
        let most = if column + 1 == row.len() { 400 } else { 100 };
        match cell.char_indices().nth(most) {
            Some((end, _)) => format!("{}…", &cell[..end]),
            None => cell.clone(),
        }
    };
    row.iter().enumerate().map(cut).collect()
}

/// A count with thousands separated: `1,234,567`.
pub fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number of bytes for humans: `12.3 MiB`.
pub fn bytes(count: u64) -> String {
    let mut value = count as f64;
    for unit in ["B", "KiB", "MiB", "GiB"] {
        if value < 1024.0 {
            return if unit == "B" { format!("{count} B") } else { format!("{value:.1} {unit}") };
        }
        value /= 1024.0;
    }
    format!("{value:.1} TiB")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_by_thousands() {
        let grouped: Vec<String> = [0, 999, 1000, 1_234_567].into_iter().map(thousands).collect();
        assert_eq!(grouped, ["0", "999", "1,000", "1,234,567"]);
    }

    #[test]
    fn columns_of_numbers_stand_to_the_right() {
        let rows = [["run", "PSNR"], ["a", "1.5"], ["longer", "22.25"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(table(&rows), "run      PSNR\na         1.5\nlonger  22.25\n");
    }

    #[test]
    fn what_a_file_says_at_length_is_cut_for_a_terminal() {
        let rows = [[" ".repeat(9000), "x".repeat(9000)], ["key".into(), "value".into()]].map(|row| row.to_vec());
        let text = table(&rows);
        assert!(text.lines().all(|line| line.chars().count() <= 504), "{text}");
        assert!(text.contains("xx…") && text.ends_with("value\n"), "{text}");
    }

    #[test]
    fn byte_counts_carry_their_unit() {
        assert_eq!([12, 2048, 5 << 20].map(bytes), ["12 B", "2.0 KiB", "5.0 MiB"]);
    }
}
