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

/// Millimetres. A pixel of these cameras is some 50 mm wide where the room is. Measured are 116, 81 and 396.
const POINTS: [f64; 3] = [175.0, 125.0, 600.0];

/// Shares of white: half way between what 5+5 iterations leave (0.248, 0.247 and 0.410) and what the defaults do (0.189, 0.188 and 0.348).
const TRAINED: [f64; 3] = [0.218, 0.218, 0.379];

#[test]
fn points_and_trainings_are_held_against_the_stage() {
    let folder = Folder::new();
    for (name, most) in [("points", POINTS), ("training", TRAINED), ("motion", TRAINED), ("field", TRAINED)] {
        let figures = folder.figures(&format!("bench precision {name} --small"));
        let curves = figures["components"][0]["curves"].as_array().expect("curves");
        let places = curves[0]["places"].as_array().expect("places");
        let place = places.iter().find(|place| place["default"] == true).expect("a default");
        let errors = place["came"]["Ok"]["errors"].as_array().expect("errors");
        let errors: Vec<f64> = errors.iter().map(|error| error.as_f64().expect("a figure")).collect();
        // None is exact, or nothing was compared.
        let within = |(error, most): (&f64, &f64)| *error > 0.0 && error < most;
        assert!(errors.len() == most.len() && errors.iter().zip(&most).all(within), "{name}: {errors:?}, {figures}");
    }
}
