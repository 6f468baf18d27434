//! `erfgs bench stability`.

use std::fs;

use crate::command_line::Folder;

#[test]
fn the_suite_prints_what_cases_came_to_and_writes_it_down() {
    let folder = Folder::new();
    let figures = folder.figures("bench stability --small --only needles --out stability.md");
    let rows = figures["rows"].as_array().expect("rows");
    assert_eq!((rows.len(), &figures["failed"]), (1, &0.into()), "{figures}");
    assert_eq!(rows[0]["verdict"], "Within");
    let document = fs::read_to_string(folder.path("stability.md")).expect("a document");
    assert!(document.contains("`erfgs bench stability --small --only 'needles' --out stability.md` made this file"));
    assert!(
        document.contains("1 cases: 1 finite and within their bounds, 0 refused as they must be, 0 failed."),
        "{document}"
    );
    assert!(folder.fail(2, "bench stability --only nothing-of-that-name").contains("no case has this name"));
}
