//! The document.

use std::fmt::Write as _;

use super::{COLUMNS, EXPLAINED, Made, cell};
use crate::{Board, Method};

/// The document, in Markdown: the means over all takes, and over the seeds of each act.
#[must_use]
pub fn markdown(board: &Board, made: &Made) -> String {
    let mut text = format!(
        "# Acts\n\n`{}` made this file (version {}, trained on {}). `acts.html` beside it shows pictures, `acts.csv` has every \
         training.\n\n{} {EXPLAINED}\n",
        made.command,
        made.version,
        made.adapter.replace('|', "/"),
        made.what
    );
    let methods = board.methods();
    if board.acts().len() > 1 {
        let _ = write!(text, "\n## All takes\n\n{}", table(board, None, &methods));
    }
    for act in board.acts() {
        let seeds: Vec<String> = board.seeds(act).iter().map(u64::to_string).collect();
        let plural = if seeds.len() == 1 { "" } else { "s" };
        let _ =
            write!(text, "\n## {act}\n\nSeed{plural} {}.\n\n{}", seeds.join(", "), table(board, Some(act), &methods));
    }
    text
}

fn table(board: &Board, act: Option<&str>, methods: &[&str]) -> String {
    let mut text = format!("| method | {} |\n|---|{}\n", COLUMNS.join(" | "), "---|".repeat(COLUMNS.len()));
    for method in methods {
        let means = board.mean(act, method);
        let cells: Vec<String> = means.into_iter().enumerate().map(|(column, value)| cell(column, value)).collect();
        let about = Method::named(method).map_or(*method, |method| method.about);
        let _ = writeln!(text, "| {about} | {} |", cells.join(" | "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_over_seeds_stand_beside_their_methods() {
        let made =
            Made { command: "erfgs bench acts".into(), version: "1".into(), adapter: "a|b".into(), what: "It.".into() };
        let text = markdown(&crate::board::tests::board(), &made);
        assert!(text.contains("trained on a/b"));
        assert!(text.contains("## throw\n\nSeeds 1, 2.\n"), "{text}");
        assert!(
            text.contains("| ERF-GS, frames and events | 25.00 | 30.00 | 19.00 | 18.00 | - | 1.0 | 38 % |"),
            "{text}"
        );
    }
}
