//! `erfgs bench budget`.

use std::fs;

use crate::command_line::Folder;

#[test]
fn errors_are_put_in_trained_with_and_told_as_a_page_a_document_and_numbers() {
    let folder = Folder::new();
    let words = "bench budget --small --only place --only cameras --iterations 5+5 --seeds 2 --out budget";
    let figures = folder.figures(words);
    let causes = figures["causes"].as_array().expect("causes");
    let names: Vec<_> = causes.iter().map(|cause| cause["name"].as_str().expect("a name")).collect();
    assert_eq!(names, ["place", "event cameras"], "{figures}");
    assert_eq!(figures["base"].as_array().map(Vec::len), Some(2), "a base for each seed: {figures}");
    let place = &causes[0]["rows"][0];
    let moved = place["moved_px"].as_f64().expect("pixels");
    // A millimetre at two to four metres, with a focal length of 75 px.
    assert!((0.01..0.2).contains(&moved), "{place}");
    let read = |name: &str| fs::read_to_string(folder.path(&format!("budget/{name}"))).expect(name);
    let [table, text, page] = ["budget.csv", "budget.md", "budget.html"].map(read);
    assert_eq!(table.lines().filter(|line| line.starts_with("nothing,")).count(), 2, "{table}");
    assert!(table.contains("\nplace,mm,1,") && table.contains("\nevent cameras,,0,"), "{table}");
    assert!(
        text.contains("--only 'place' --only 'cameras' --small --iterations 5+5 --seeds 2 --out budget` made this"),
        "{text}"
    );
    assert!(page.contains("<svg class=\"plot tradeoff\""), "{page}");
    // Whoever gives the command again gets the same, and trains nothing.
    let trained = |folder: &Folder| {
        let run = fs::metadata(folder.path("budget/wrong/runs/place-1-s1/checkpoint.bin")).expect("a checkpoint");
        run.modified().expect("a time")
    };
    let before = trained(&folder);
    assert_eq!(folder.figures(words), figures);
    assert_eq!(trained(&folder), before);
    for asked in ["--only nothing", "--only place --only nothing", "--only place --only nothing=3"] {
        let message = folder.fail(2, &format!("bench budget --small {asked} --out budget"));
        assert!(message.contains("errors and their sizes are place (1, 3, 10, 30), direction"), "{message}");
    }
}
