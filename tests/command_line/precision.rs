//! `erfgs bench precision`.

use std::fs;

use crate::command_line::Folder;

#[test]
fn curves_are_printed_and_written_as_a_page_a_document_and_numbers() {
    let folder = Folder::new();
    let figures = folder.figures("bench precision clock --small --out curves");
    let components = figures["components"].as_array().expect("components");
    assert_eq!((components.len(), &components[0]["about"]["name"]), (1, &"clock fit".into()), "{figures}");
    let read = |name: &str| fs::read_to_string(folder.path(&format!("curves/{name}"))).expect(name);
    let [table, text, page] = ["precision.csv", "precision.md", "precision.html"].map(read);
    assert!(table.lines().any(|line| line.starts_with("clock fit,window,10 s,true,")), "{table}");
    assert!(text.contains("`erfgs bench precision 'clock' --small --out curves` made this file"), "{text}");
    assert!(text.contains("| **10 s (default)** |"), "{text}");
    assert_eq!((page.matches("<svg class=\"plot tradeoff\"").count(), page.matches("class=\"ring\"").count()), (2, 2));
    assert!(folder.fail(2, "bench precision nothing-of-that-name").contains("there are rasteriser, event simulator"));
}
