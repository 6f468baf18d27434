//! The report as a file, and its page in the documentation.

use std::{
    collections::BTreeSet,
    path::Path,
    sync::{Arc, atomic::AtomicBool},
    time::Duration,
};

use erfgs_recorder::RigConfig;
use erfgs_rig::usb::LibusbBus;
use erfgs_selftest::{CheckName, Options, Report, SelftestError, Verdict, run};
use serde_json::Value;

const PAGE: &str = include_str!("../../../../docs/reference/selftest.md");
const RIG: &str = "[[pattern]]\nid = \"eye\"\ndelivers = \"events\"\nrate_hz = 50.0\nevents_per_packet = 500\n\
                   [[pattern]]\nid = \"camera\"\ndelivers = \"frames\"\nwidth = 64\nheight = 64\n";

fn rig(text: &str) -> RigConfig {
    RigConfig::parse(text, Path::new("RIG.toml")).unwrap()
}

fn options(stop: &AtomicBool) -> Options<'_> {
    Options { length: Duration::from_millis(1000), keep: None, stop }
}

/// The names of all fields but of those that hold what devices call by names of their own.
fn fields(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            for (name, value) in map {
                found.insert(name.clone());
                if !["description", "machine", "readings", "anomalies", "incidents", "dropped"].contains(&name.as_str())
                {
                    fields(value, found);
                }
            }
        }
        Value::Array(list) => list.iter().for_each(|value| fields(value, found)),
        _ => {}
    }
}

#[test]
fn a_report_comes_back_as_it_was_written_and_its_page_describes_all_of_it() {
    let never = AtomicBool::new(false);
    let report = run(&rig(RIG), &(Arc::new(LibusbBus) as _), &options(&never), &mut |_| {}).unwrap();
    let opened = report.checks.iter().filter(|check| check.check == CheckName::Opened);
    assert_eq!(opened.map(|check| check.verdict).collect::<Vec<_>>(), [Verdict::Ok; 2], "{:#?}", report.checks);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.json");
    report.save(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(serde_json::from_str::<Report>(&text).unwrap(), report);
    assert!(!report.machine.contains_key("host"), "the machine's name is passed on: {:?}", report.machine);

    let mut names = BTreeSet::new();
    fields(&serde_json::from_str(&text).unwrap(), &mut names);
    assert!(names.contains("packet_intervals") && names.contains("anomalies"), "{names:?}");
    let missing: Vec<&String> = names.iter().filter(|name| !PAGE.contains(&format!("`{name}`"))).collect();
    assert!(missing.is_empty(), "not in docs/reference/selftest.md: {missing:?}");
    for check in CheckName::ALL {
        assert!(PAGE.contains(&format!("\n| `{}` |", check.name())), "{}", check.name());
    }
    let message = report.save(&path.join("below-a-file.json")).unwrap_err().to_string();
    assert!(message.contains("report.json/below-a-file.json"), "{message}");
}

#[test]
fn a_test_that_is_stopped_leaves_no_report_and_one_without_devices_is_refused() {
    let stop = AtomicBool::new(true);
    let bus = Arc::new(LibusbBus) as _;
    assert!(matches!(run(&rig(RIG), &bus, &options(&stop), &mut |_| {}), Err(SelftestError::Stopped)));
    assert!(matches!(run(&rig(""), &bus, &options(&stop), &mut |_| {}), Err(SelftestError::NoDevices)));
}

#[test]
fn recordings_are_kept_where_that_is_asked_for_and_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let never = AtomicBool::new(false);
    let keep = folder.path().join("kept");
    let options = Options { length: Duration::from_millis(200), keep: Some(keep.clone()), stop: &never };
    let bus = Arc::new(LibusbBus) as _;
    run(&rig(RIG), &bus, &options, &mut |_| {}).unwrap();
    let mut names: Vec<_> = std::fs::read_dir(&keep).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["alone-camera.mcap", "alone-eye.mcap", "together.mcap"]);
    let message = run(&rig(RIG), &bus, &options, &mut |_| {}).unwrap_err().to_string();
    assert!(message.contains("alone-eye.mcap") && message.contains("never overwritten"), "{message}");
}
