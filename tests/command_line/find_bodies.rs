//! What moves is found as bodies, shown, and corrected by its user.

use super::{Folder, page::film_small};

#[test]
fn bodies_are_found_shown_and_corrected() {
    let folder = Folder::new();
    film_small(&folder);
    folder.succeed("dataset points ds --method random --random-points 400 --moving 6 --moving-points 3000");
    let found = folder.figures("dataset bodies ds --report pages/found.html");
    let count = found["count"].as_u64().expect("a number of bodies");
    assert!(count > 0, "{found}");
    let page = std::fs::read_to_string(folder.path("pages/found.html")).expect("a page");
    let sections = page.matches("<section id=\"body-").count() as u64;
    assert!(sections == count && page.contains("</html>") && page.contains("data:image/jpeg"), "{sections} of {count}");
    // By this the trial of a training decides how much better a body must be.
    let bodies = std::fs::read(folder.path("ds/bodies.json")).expect("bodies");
    let bodies: serde_json::Value = serde_json::from_slice(&bodies).expect("JSON");
    for body in bodies["bodies"].as_array().expect("bodies") {
        let agree = body["found_by"]["carving_agreement"].as_f64();
        assert!(agree.is_some_and(|agree| (0.5..=0.86).contains(&agree)), "{agree:?}");
    }
    let shown = folder.succeed("dataset bodies ds");
    assert!(shown.contains("body0") && !shown.contains("report"), "{shown}");

    let edit = |text: &str| std::fs::write(folder.path("edits.toml"), text).expect("corrections");
    edit("[[turn]]\nbody = \"body0\"\nrate_rad_s = [0.0, 0.0, 4.0]\n");
    let stdout = folder.succeed("dataset bodies ds --edit edits.toml");
    assert!(stdout.contains("as was said"), "{stdout}");
    let manifest = std::fs::read_to_string(folder.path("ds/dataset.json")).expect("a manifest");
    assert!(manifest.contains("\"edits\""), "the manifest says what was corrected");
    for (text, why) in [
        ("forget = [\"body99\"]", "there are body0"),
        ("forget = [\"body0\"", "edits.toml"),
        ("forgot = []", "forget, merge, carve, [[split]] and [[turn]]"),
        ("carve = [\"body99\"]", "there are body0"),
    ] {
        edit(text);
        let refused = folder.fail(1, "dataset bodies ds --edit edits.toml");
        assert!(refused.contains(why), "{text}: {refused}");
    }
}
