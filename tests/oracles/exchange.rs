//! Sessions and exports in the readers of others: the library of MCAP and its decoder of ROS 2 messages (Foxglove's way
//! of reading), iniVation's dv-processing, expelliarmus, faery; and files of dv-processing in ours.

mod recorded;

use std::{
    path::Path,
    process::{Command, Output},
};

use erfgs_events::{CdEvent, Columns, EventFile};
use erfgs_session::source::{Packet, StampPoint};
use serde_json::{Value, json};

use recorded::{END_NS, EPOCH_NS, RIG, Recorded, START_NS};

/// Runs the program in `folder`, which must succeed, and gives its answer.
fn erfgs(folder: &Path, arguments: &[&str]) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_erfgs"));
    answer(command.current_dir(folder).args(arguments).arg("--json").output().expect("erfgs starts"))
}

/// Asks the others.
fn others(folder: &Path, arguments: &[&str]) -> Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracles/exchange.py");
    let mut command = Command::new(super::python());
    answer(command.current_dir(folder).arg(script).args(arguments).output().unwrap())
}

fn answer(output: Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

fn in_folder(check: impl FnOnce(&Path, Recorded)) {
    let folder = tempfile::tempdir().unwrap();
    let recorded = recorded::write(&folder.path().join("s.mcap"));
    check(folder.path(), recorded);
}

fn integers(value: &Value) -> Vec<u64> {
    serde_json::from_value(value.clone()).unwrap_or_else(|error| panic!("{error}: {value}"))
}

/// Asserts that the columns of another reader are these events.
fn assert_events(who: &str, found: &Value, expected: &[CdEvent]) {
    let column = |value: fn(&CdEvent) -> u64| expected.iter().map(value).collect::<Vec<_>>();
    for (name, expected) in [
        ("t", column(|event| event.t_us)),
        ("x", column(|event| event.x.into())),
        ("y", column(|event| event.y.into())),
        ("on", column(|event| event.on.into())),
    ] {
        let found = integers(&found[name]);
        let first = found.iter().zip(&expected).position(|(found, expected)| found != expected);
        assert!(found == expected, "{who}, {name}: {} of {}, first difference {first:?}", found.len(), expected.len());
    }
}

/// The numbers of a packet as its header, and those of MCAP around it.
fn row(packet: &Packet) -> Value {
    let log = |host_ns: i64| EPOCH_NS + host_ns - START_NS;
    let (kernel_ns, kernel_sequence) = packet.stamp.map_or((0, 0), |stamp| (stamp.kernel_ns, stamp.sequence));
    let start_of_exposure = packet.stamp.is_some_and(|stamp| stamp.point == StampPoint::StartOfExposure);
    let stamped = u32::from(packet.stamp.is_some());
    let flags = u32::from(packet.discontinuity)
        + 2 * u32::from(packet.damaged)
        + (4 + 8) * stamped
        + 16 * u32::from(start_of_exposure);
    let publish_ns = packet.stamp.map_or(packet.host_ns, |stamp| stamp.kernel_ns);
    let (sequence, host_ns, length) = (packet.sequence, packet.host_ns, packet.payload.len());
    let (log_time, publish_time) = (log(host_ns), log(publish_ns));
    json!([sequence, host_ns, kernel_ns, kernel_sequence, flags, length, log_time, publish_time, sequence])
}

#[test]
fn the_library_of_mcap_and_its_decoder_of_ros_2_messages_read_every_record_of_a_session() {
    in_folder(|folder, recorded| {
        let found = others(folder, &["session", "s.mcap", "."]);
        assert_eq!(found["header"][0], "erfgs");
        assert_eq!(found["attachments"], json!([["rig.toml", "application/toml", RIG]]));
        let start = &found["metadata"]["erfgs.session"];
        assert_eq!((&start["epoch_ns"], &start["machine.kernel"]), (&EPOCH_NS.to_string().into(), &"6.1".into()));
        let totals = &found["metadata"]["erfgs.totals"];
        let mut messages = 6;
        for stream in &recorded.streams {
            let (id, topic) = (&stream.description.id, stream.topic());
            let description = serde_json::to_value(&stream.description).unwrap();
            assert_eq!(found["descriptions"][&topic], description);
            let rows: Vec<Value> = stream.packets.iter().map(row).collect();
            assert_eq!(found["packets"][&topic], Value::from(rows), "{topic}");
            let payload = std::fs::read(folder.join(topic.replace('/', "_"))).unwrap();
            assert!(payload == stream.packets.iter().map(|packet| &packet.payload[..]).collect::<Vec<_>>().concat());
            let of_stream: Value = serde_json::from_str(totals[format!("stream.{id}")].as_str().unwrap()).unwrap();
            assert_eq!(of_stream["packets"], stream.packets.len());
            messages += stream.packets.len();
        }
        let json = found["json"].as_object().unwrap();
        let states: usize = json
            .iter()
            .filter(|(topic, _)| topic.ends_with("/state"))
            .map(|(_, all)| all.as_array().unwrap().len())
            .sum();
        assert!(states > 0, "decoders' states are recorded");
        let channels = 2 + 3 * recorded.streams.len();
        assert_eq!(found["counts"], json!([messages + states, channels, 1, 2]));
        assert_eq!(json["/clock/evt3"][0]["evidence"], "trigger-edges");
        assert_eq!(
            json["/incidents"][0],
            json!({"stream": "davis", "host_ns": END_NS, "kind": "lost", "reason": "the cable is out"})
        );
        let status = json["/status"].as_array().unwrap();
        assert_eq!((&status[0]["disk_free_bytes"], status[1].get("disk_free_bytes")), (&(1_u64 << 40).into(), None));
    });
}

#[test]
fn inivations_library_reads_exported_aedat4() {
    in_folder(|folder, recorded| {
        erfgs(folder, &["export", "s.mcap", "--to", "aedat4", "--out", "."]);
        let found = others(folder, &["aedat4", "davis.aedat4", "evt3.aedat4"]);
        let (davis, evk4) = (&found["davis.aedat4"], &found["evt3.aedat4"]);
        assert_eq!(davis["streams"], json!(["events", "frames", "imu", "triggers"]));
        assert_eq!(davis["camera"], "iniVation_DAVIS346_00000042");
        assert_eq!(davis["sizes"], json!([[346, 260], [346, 260]]));
        let expected = &recorded.davis;
        assert_events("dv-processing", &davis["events"], &expected.events);
        let marks: Vec<Value> = expected.marks.iter().map(|&(t_us, mark)| json!([t_us, mark as u8])).collect();
        assert_eq!(davis["triggers"], Value::from(marks));
        let sample = |sample: &erfgs_events::ImuSample| {
            let axes = [sample.accelerometer, sample.gyroscope, sample.magnetometer].concat();
            let mut row = vec![json!(sample.t_us), json!(sample.temperature)];
            row.extend(axes.into_iter().map(|value| json!(value)));
            Value::from(row)
        };
        let samples: Vec<Value> = expected.samples.iter().map(sample).collect();
        assert_eq!(davis["samples"], Value::from(samples));
        assert_eq!(davis["frames"].as_array().unwrap().len(), expected.frames.len());
        for (found, expected) in davis["frames"].as_array().unwrap().iter().zip(&expected.frames) {
            let exposure = expected.exposure_end_us - expected.exposure_start_us;
            assert_eq!((&found["start"], &found["exposure"]), (&expected.exposure_start_us.into(), &exposure.into()));
            assert_eq!((&found["source"], &found["shape"]), (&"SENSOR".into(), &json!([260, 346])));
            let pixels: Vec<u64> = expected.pixels.iter().map(|&pixel| u64::from(pixel) << 6).collect();
            assert!(found["type"] == "uint16" && integers(&found["pixels"]) == pixels);
        }
        assert_eq!(evk4["sizes"][0], json!([1280, 720]));
        assert_events("dv-processing", &evk4["events"], &recorded.events);
        let edge = |edge: &erfgs_events::Edge| json!([edge.t_us, if edge.rising { 1 } else { 2 }]);
        assert_eq!(evk4["triggers"], Value::from(recorded.edges.iter().map(edge).collect::<Vec<_>>()));
    });
}

#[test]
fn what_inivations_library_writes_is_read_with_every_compression() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let written = others(folder, &["write", "."]);
    let files = written["files"].as_object().unwrap();
    assert_eq!(files.len(), 5, "{files:?}");
    let mut digests = Vec::new();
    for file in files.values() {
        let name = file.as_str().unwrap();
        let info = erfgs(folder, &["info", name, "--digest"]);
        assert_eq!((&info["width"], &info["height"]), (&346.into(), &260.into()), "{name}");
        digests.push(info["sha3_224_of_field"].clone());
        let mut columns = Columns::default();
        let anomalies = EventFile::open(&folder.join(name)).unwrap().decode(&mut columns).unwrap();
        assert!(anomalies.is_empty(), "{name}: {anomalies:?}");
        assert_events(name, &written["events"], &columns.iter().collect::<Vec<_>>());
        let marks: Vec<Value> = columns.marks.iter().map(|&(t_us, mark)| json!([t_us, mark as u8])).collect();
        assert_eq!(Value::from(marks), written["triggers"], "{name}");
        let frame = |frame: &erfgs_events::ApsFrame| {
            json!([frame.exposure_start_us, frame.exposure_end_us - frame.exposure_start_us, frame.pixels])
        };
        assert_eq!(Value::from(columns.frames.iter().map(frame).collect::<Vec<_>>()), written["frames"], "{name}");
        for (sample, written) in columns.imu.iter().zip(written["samples"].as_array().unwrap()) {
            let axes = [sample.accelerometer, sample.gyroscope, sample.magnetometer].concat();
            assert_eq!((&json!(sample.t_us), &json!(sample.temperature)), (&written[0], &written[1]), "{name}");
            assert!(axes.iter().zip(&written.as_array().unwrap()[2..]).all(|(axis, written)| json!(axis) == *written));
        }
        assert_eq!(columns.imu.len(), written["samples"].as_array().unwrap().len(), "{name}");
    }
    assert!(digests.iter().all(|digest| digest == &digests[0]), "{digests:?}");
}

#[test]
fn exported_raw_files_decode_alike_in_other_programs() {
    in_folder(|folder, recorded| {
        erfgs(folder, &["export", "s.mcap", "--to", "raw", "--out", "."]);
        let found = others(folder, &["raw", "evt3.raw", "evt2.raw"]);
        for (file, readers) in [("evt3.raw", &["faery"][..]), ("evt2.raw", &["faery", "expelliarmus"])] {
            assert_eq!(found[file]["size of faery"], json!([1280, 720]), "{file}");
            for &reader in readers {
                assert_events(&format!("{reader}, {file}"), &found[file][reader], &recorded.events);
            }
        }
    });
}
