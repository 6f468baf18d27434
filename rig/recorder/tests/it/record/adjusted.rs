//! Settings that are changed while a rig records: in the session, in the rig's file, on the camera.

use std::{fs, path::Path};

use erfgs_recorder::{AdjustError, Options, Recorder, RigConfig, SessionFiles, open_on};
use erfgs_session::{Session, source::Incident};
use serde_json::json;

use crate::record::support::{evk4_and_davis346, options, wait_until};

const RIG: &str = "[rig]\nname = \"lab\"\n\n# The left one.\n[[evk4]]\nid = \"left\"\n\n[[davis346]]\nid = \"davis\"\n";

#[test]
fn a_change_is_noted_with_its_time_and_kept_in_the_rigs_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("RIG.toml");
    fs::write(&file, RIG).unwrap();
    let bus = evk4_and_davis346();
    let rig = RigConfig::load(&file).unwrap();
    let options =
        Options { folder: folder.path().into(), rig_file: Some(file.clone()), ..options(SessionFiles::default()) };
    let recorder = Recorder::new(open_on(&rig, &bus).unwrap(), options).unwrap();
    let path = folder.path().join("take.mcap");
    recorder.start_recording(&path).unwrap();
    recorder.start_sources().unwrap();
    wait_until("data", || recorder.status().streams.iter().all(|stream| stream.written > 3));
    let change = |id: &str, changed: &serde_json::Value| recorder.adjust(id, changed.as_object().unwrap());
    let left = json!({ "biases": { "diff_on": 12 } });
    let davis = json!({ "events": { "refractory_us": 250 } });
    change("left", &left).unwrap();
    change("davis", &davis).unwrap();
    assert!(matches!(change("right", &left), Err(AdjustError::Unknown(_))));
    assert!(matches!(change("left", &json!({ "biases": { "diff_on": 999 } })), Err(AdjustError::Device { .. })));
    assert!(recorder.knobs("left").unwrap().iter().any(|knob| knob.path == "biases.diff_on" && knob.value == 12));
    recorder.keep_settings("left").unwrap();
    recorder.stop_recording("enough").unwrap();
    // The next take has the settings from its start.
    let next = folder.path().join("next.mcap");
    recorder.start_recording(&next).unwrap();
    recorder.stop_sources();
    recorder.stop_recording("enough").unwrap();

    let session = Session::open(&path).unwrap();
    let noted = |id: &str| {
        let incidents = &session.summary().totals.incidents;
        let of =
            incidents.iter().find(|entry| entry.stream == id && matches!(entry.incident, Incident::Adjusted { .. }));
        let entry = of.unwrap_or_else(|| panic!("{id}: {incidents:?}"));
        let Incident::Adjusted { changed } = &entry.incident else { unreachable!() };
        (session.summary().start.session_ns(entry.host_ns), serde_json::Value::Object(changed.clone()))
    };
    assert_eq!((noted("left").1, noted("davis").1), (left, davis));
    assert!(noted("left").0 > 0);
    let offset = |path: &Path| {
        let session = Session::open(path).unwrap();
        session.stream("left").unwrap().1.description.settings["biases"]["diff_on"]["offset"].clone()
    };
    assert_eq!((offset(&path), offset(&next)), (0.into(), 12.into()));
    assert_eq!(fs::read_to_string(&file).unwrap(), RIG.replace("\"left\"\n", "\"left\"\nbiases = { diff_on = 12 }\n"));
    assert!(RigConfig::load(&file).is_ok());
}
