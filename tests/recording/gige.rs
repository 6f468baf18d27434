//! A GigE Vision camera through the program: listed, recorded, told of, synchronised and exported.

use std::fs;

use erfgs_hardware_mocks::{
    gige::{GigeFaults, GigeFront, GigeOptions},
    usb::scene::PatternFrames,
};

use crate::recording::files::{erfgs, json};

#[test]
fn an_ethernet_camera_is_listed_recorded_synchronised_and_exported() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    // A packet is lost, and asked for; of one block nothing comes.
    let faults = GigeFaults { lost: [(3, 2)].into(), lost_blocks: [12].into(), ..GigeFaults::default() };
    let options = GigeOptions { serial: "GEV00042".into(), name: "left".into(), faults, ..GigeOptions::default() };
    let front = GigeFront::plug(options, Box::new(PatternFrames::default())).expect("a loopback address");
    let address = front.address().to_string();

    let listed = json(folder, &["devices", "--at", &address, "--json"]);
    let camera = listed["cameras"].as_array().expect("cameras").iter().find(|camera| camera["serial"] == "GEV00042");
    let camera = camera.unwrap_or_else(|| panic!("{listed}"));
    assert_eq!((&camera["bus"], &camera["problem"]), (&address.as_str().into(), &serde_json::Value::Null));
    assert_eq!(camera["name"], "erfgs Emulated GigE \"left\"");
    let text = String::from_utf8(erfgs(folder, &["devices", "--at", &address]).stdout).expect("text");
    assert!(text.lines().any(|line| line.contains("GEV00042") && line.contains("GigE Vision")), "{text}");

    let rig = |serial: &str| {
        format!(
            "[[camera]]\nid = \"mono\"\ncamera = \"{serial}\"\nbackend = \"gige\"\nformat = \"grey12\"\nwidth = 160\nheight = 120\n\
             rate_hz = 50.0\nexposure_us = 4000\ngain = 6\n[camera.genicam]\naddresses = [\"{address}\"]\noffset = [16, 8]\n\
             chunks = [\"ExposureTime\"]\npacket_bytes = 1500\n"
        )
    };
    fs::write(folder.join("rig.toml"), rig("GEV00042")).expect("written");
    let summary =
        json(folder, &["record", "rig.toml", "--out", "take.mcap", "--seconds", "2", "--no-preflight", "--json"]);
    let stream = &summary["streams"][0];
    let written = stream["written"].as_u64().expect("a count");
    assert!(written > 30, "{summary}");

    let info = json(folder, &["info", "take.mcap", "--json"]);
    let settings = &info["streams"][0]["settings"];
    assert_eq!(
        (&settings["backend"], &settings["exposure_us"], &settings["gain"]),
        (&"gige".into(), &4000.0.into(), &6.0.into())
    );
    assert_eq!((&settings["region_x"], &settings["address"]), (&16.0.into(), &address.as_str().into()));

    let sync = json(folder, &["sync", "take.mcap", "--json"]);
    assert_eq!(sync["streams"][0]["tier"], "free-running", "{sync}");
    json(folder, &["export", "take.mcap", "--to", "png", "--out", "pictures", "--json"]);
    let pictures = fs::read_dir(folder.join("pictures/mono")).expect("pictures").flatten();
    let pictures = pictures.filter(|entry| entry.path().extension().is_some_and(|ending| ending == "png")).count();
    assert_eq!(pictures as u64, written);

    fs::write(folder.join("other.toml"), rig("GEV00043")).expect("written");
    let output = erfgs(folder, &["record", "other.toml", "--out", "other.mcap", "--no-preflight"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && stderr.contains("no GigE Vision camera is \"GEV00043\""), "{stderr}");
}
