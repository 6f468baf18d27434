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
    assert!(table.lines().any(|line| line.starts_with("clock fit,window,5 s,true,")), "{table}");
    assert!(text.contains("`erfgs bench precision 'clock' --small --out curves` made this file"), "{text}");
    assert!(text.contains("| **5 s (default)** |"), "{text}");
    assert_eq!((page.matches("<svg class=\"plot tradeoff\"").count(), page.matches("class=\"ring\"").count()), (2, 2));
    assert!(folder.fail(2, "bench precision nothing-of-that-name").contains("there are rasteriser, event simulator"));
}

#[test]
fn points_and_trainings_are_held_against_the_stage() {
    let folder = Folder::new();
    for (name, measures) in [("points", 3), ("training", 3), ("motion", 3), ("field", 3)] {
        let figures = folder.figures(&format!("bench precision {name} --small"));
        let curves = figures["components"][0]["curves"].as_array().expect("curves");
        let places = curves[0]["places"].as_array().expect("places");
        let place = places.iter().find(|place| place["default"] == true).expect("a default");
        let errors: Vec<f64> = place["came"]["Ok"]["errors"]
            .as_array()
            .expect("errors")
            .iter()
            .filter_map(|error| error.as_f64())
            .collect();
        assert!(errors.len() == measures && errors.iter().all(|error| *error > 0.0 && *error < 1000.0), "{figures}");
    }
}
