//! The page: the tables, and for each take what is true beside what each method makes of it.

use erfgs_page::{
    html::{self, Escaped},
    picture::data_uri,
};

use super::{COLUMNS, EXPLAINED, Made, cell};
use crate::{Board, Method, Row};

/// The page, one HTML file. Pictures that cannot be read are left out.
#[must_use]
pub fn page(board: &Board, made: &Made) -> String {
    let head = format!(
        "<p>{} Made by <code>{}</code>, trained on {}.</p>\n<p>{EXPLAINED}</p>\n",
        Escaped(&made.what),
        Escaped(&made.command),
        Escaped(&made.adapter)
    );
    let mut body = String::new();
    if board.acts().len() > 1 {
        body.push_str(&html::section("", "all", "All takes", &table(board, None)));
    }
    for act in board.acts() {
        let mut part = table(board, Some(act));
        for seed in board.seeds(act) {
            part.push_str(&pictures(board, act, seed));
        }
        body.push_str(&html::section("", &act.replace('+', "-"), act, &part));
    }
    html::page("Acts", &head, &body)
}

fn about(method: &str) -> &str {
    Method::named(method).map_or(method, |method| method.about)
}

fn table(board: &Board, act: Option<&str>) -> String {
    let head = COLUMNS.map(|column| format!("<th>{}</th>", Escaped(column))).join("");
    let row = |method: &&str| {
        let means = board.mean(act, method).into_iter().enumerate();
        let cells: String = means.map(|(column, value)| format!("<td>{}</td>", cell(column, value))).collect();
        format!("<tr><th>{}</th>{cells}</tr>\n", Escaped(about(method)))
    };
    let rows: String = board.methods().iter().map(row).collect();
    html::table("", &format!("<tr><th>method</th>{head}</tr>"), &rows)
}

/// What is true, and what each method makes of it.
fn pictures(board: &Board, act: &str, seed: u64) -> String {
    let figure = |file: &std::path::Path, caption: &str| {
        let bytes = std::fs::read(file).ok()?;
        let caption = Escaped(caption);
        let source = data_uri("image/png", &bytes);
        Some(format!(
            "<figure><figcaption>{caption}</figcaption><img class=\"detail\" src=\"{source}\" alt=\"{caption}\"></figure>\n"
        ))
    };
    let truth = board.truths.iter().find(|(of, with, _)| of == act && *with == seed);
    let mut figures: Vec<String> = truth.and_then(|(.., file)| figure(file, "what is true")).into_iter().collect();
    let rows = board.rows.iter().filter(|row| row.act == act && row.seed == seed);
    figures.extend(rows.filter_map(|row| figure(row.picture.as_deref()?, &caption(board, row))));
    if figures.is_empty() {
        return String::new();
    }
    format!(
        "<h3>Seed {seed}, between frames</h3>\n<div class=\"pictures\" style=\"--columns: {}\">\n{}</div>\n",
        figures.len(),
        figures.concat()
    )
}

fn caption(board: &Board, row: &Row) -> String {
    let dpsnr = row.quality.dpsnr.map_or(String::new(), |value| format!(": DPSNR {value:.2} dB"));
    let share = board.share(row).map_or(String::new(), |share| format!(", {} of the gap", cell(6, Some(share))));
    format!("{}{dpsnr}{share}", about(row.method))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_has_a_table_for_each_act_and_the_pictures_there_are() {
        let folder = tempfile::tempdir().unwrap();
        let mut board = crate::board::tests::board();
        let file = folder.path().join("a.png");
        erfgs_scene::ImageRgb8::new(4, 3).write_png(&file).unwrap();
        board.truths.push(("throw".into(), 1, file.clone()));
        board.rows[1].picture = Some(file);
        board.rows[2].picture = Some(folder.path().join("missing.png"));
        let made = Made { command: "<x>".into(), version: "1".into(), adapter: "a".into(), what: "It.".into() };
        let text = page(&board, &made);
        assert!(text.contains("id=\"throw\"") && text.contains("id=\"fan\"") && text.contains("&lt;x&gt;"));
        assert_eq!(text.matches("<img").count(), 2);
        assert!(text.contains("what is true") && text.contains("25 % of the gap"));
    }
}
