//! Biases that a session was recorded with, as a bias file of Metavision.

use std::fs;

use erfgs_events::EventEncoding;
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::Encoding,
};
use serde_json::json;

use crate::recording::files::{description, erfgs};

#[test]
fn the_biases_of_a_recording_are_written_as_a_file_that_a_rig_reads() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut writer =
        SessionWriter::create(&folder.join("s.mcap"), SessionStart::default(), "", Settings::default()).unwrap();
    let evt3 = Encoding::Events(EventEncoding::Evt3);
    let biases = json!({ "diff_on": { "trim": 102, "offset": 31, "value": 133 }, "hpf": { "trim": 0, "offset": 12, "value": 12 } });
    for (id, settings) in [("left", json!({ "biases": biases })), ("other", json!({}))] {
        writer.add_stream(&description(id, evt3, [1280, 720], settings)).unwrap();
    }
    writer.finish().unwrap();
    let run = |words: &[&str]| {
        let output = erfgs(folder, words);
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(run(&["export", "s.mcap", "--to", "bias"]), (true, String::new()));
    let text = fs::read_to_string(folder.join("s.left.bias")).unwrap();
    assert!(
        text.contains("31   % bias_diff_on\n") && text.contains("12   % bias_hpf\n") && text.lines().count() == 6,
        "{text}"
    );
    assert!(!folder.join("s.other.bias").exists());
    let (_, message) = run(&["export", "s.mcap", "--to", "bias", "--stream", "other", "--out", "o.bias"]);
    assert!(message.contains("no biases of an IMX636 (EVK4) were recorded of other"), "{message}");
    // What a rig with it lacks is the camera.
    fs::write(folder.join("RIG.toml"), "[[evk4]]\nid = \"left\"\nbias_file = \"s.left.bias\"\n").unwrap();
    let (_, message) = run(&["record", "RIG.toml", "--out", "x.mcap", "--seconds", "1"]);
    assert!(message.contains("left") && !message.contains("bias"), "{message}");
    fs::write(folder.join("s.left.bias"), "102 % bias_diff_on\n77 % bias_diff\n").unwrap();
    let (_, message) = run(&["record", "RIG.toml", "--out", "x.mcap", "--seconds", "1"]);
    assert!(message.contains("s.left.bias") && message.contains("values of a DAC"), "{message}");
}
