//! `erfgs calibrate target`: boards to print, or to blink on a screen.

use std::path::PathBuf;

use erfgs_base::{FileError, atomic};
use erfgs_calibrate::board::{Paper, Target, print};

use crate::{errors::Usage, terminal::Terminal};

/// Draw a board at true size: to print (svg, pdf), or to blink on a screen before event cameras (html).
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Print at 100 %, without fitting to the page, glue it to something flat, and measure a row of squares: what the ruler says is \
what `erfgs calibrate board --target` needs.

Examples:
  erfgs calibrate target chessboard:9x6:0.025 --out board.pdf
  erfgs calibrate target charuco:7x5:0.04:0.03:DICT_4X4_50 --out board.svg
  erfgs calibrate target aprilgrid:6x6:0.03:0.3 --out board.pdf
  erfgs calibrate target aprilgrid:6x6:0.03:0.3:first=36 --out back.pdf    # for the other side of the same board
  erfgs calibrate target chessboard:9x6:0.02 --out board.html --blink 20")]
pub struct Arguments {
    /// The target, as `erfgs calibrate board` takes it.
    target: Target,
    /// The file to write; its extension is the format: svg, pdf or html.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// How often the page blinks in a second; half the screen's frame rate at most.
    #[arg(long, value_name = "HZ", default_value_t = 15.0)]
    blink: f64,
}

/// Writes the file.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let paper = match arguments.out.extension().and_then(|extension| extension.to_str()) {
        Some("svg") => Paper::Svg,
        Some("pdf") => Paper::Pdf,
        Some("html" | "htm") => Paper::BlinkingHtml,
        _ => return Err(Usage("--out must end in .svg, .pdf or .html".into()).into()),
    };
    if !(arguments.blink > 0.0 && arguments.blink <= 1000.0) {
        return Err(Usage("--blink must be a rate between 0 and 1000 Hz".into()).into());
    }
    let out = &arguments.out;
    atomic::write(out, &print(&arguments.target, paper, arguments.blink)).map_err(FileError::when("write", out))?;
    terminal.result(&serde_json::json!({ "out": out, "target": arguments.target.to_string() }), || {
        format!("{}\n", out.display())
    })
}
