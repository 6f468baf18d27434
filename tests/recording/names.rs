//! Recordings in which somebody chose the names of the streams with a purpose of his own.

use std::{fs, io::Cursor, path::Path};

use erfgs_events::{CdEvent, EventEncoding, Evt3Encoder};
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Encoding, Packet},
};
use mcap::records::Record;
use serde_json::json;

use crate::recording::files::{self, START_NS, erfgs};

/// A session of event cameras of these names, whatever they are, each of which sees one event a millisecond.
fn session(path: &Path, names: &[&str]) {
    let plain: Vec<String> = (0..names.len()).map(|index| format!("stream{index}")).collect();
    plain_session(path, &plain.iter().map(String::as_str).collect::<Vec<_>>());
    let bytes = fs::read(path).unwrap();
    let options = mcap::WriteOptions::new().compression(None).profile("erfgs");
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    for record in mcap::read::ChunkFlattener::new(&bytes).unwrap().map(Result::unwrap) {
        match record {
            Record::Schema { header, data } => {
                writer.add_schema_with_id(header.id, &header.name, &header.encoding, &data).unwrap();
            }
            Record::Channel(mut channel) => {
                for description in channel.metadata.values_mut() {
                    let mut of: serde_json::Value = serde_json::from_str(description).unwrap();
                    if let Some(at) = plain.iter().position(|plain| of["id"] == **plain) {
                        of["id"] = names[at].into();
                        *description = of.to_string();
                    }
                }
                let (id, schema) = (channel.id, channel.schema_id);
                let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                writer.add_channel_with_id(id, schema, topic, encoding, &channel.metadata).unwrap();
            }
            Record::Message { header, data } => writer.write_to_known_channel(&header, &data).unwrap(),
            Record::Metadata(metadata) => writer.write_metadata(&metadata).unwrap(),
            Record::DataEnd(_) => break,
            _ => {}
        }
    }
    writer.finish().unwrap();
    fs::write(path, writer.into_inner().into_inner()).unwrap();
}

fn plain_session(path: &Path, names: &[&str]) {
    let start = SessionStart { host_ns: START_NS, epoch_ns: 1_750_000_000_000_000_000, ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    let encoding = Encoding::Events(EventEncoding::Evt3);
    let streams: Vec<_> = names
        .iter()
        .map(|name| writer.add_stream(&files::description(name, encoding, [1280, 720], json!({}))).unwrap())
        .collect();
    let mut encoder = Evt3Encoder::default();
    let mut payload = Vec::new();
    for ms in 0..50 {
        encoder.event(CdEvent { t_us: 1000 * ms, x: 5, y: ms as u16, on: true }, &mut payload).unwrap();
    }
    encoder.finish(&mut payload);
    for stream in streams {
        let packet = Packet {
            sequence: 0,
            host_ns: START_NS + 50_000_000,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: payload.clone().into(),
        };
        writer.packet(stream, &packet).unwrap();
    }
    writer.finish().unwrap();
}

/// The files below a folder, relative to it, in order.
fn below(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            found.extend(below(&path).into_iter().map(|file| format!("{name}/{file}")));
        } else {
            found.push(path.file_name().unwrap().to_string_lossy().into_owned());
        }
    }
    found.sort();
    found
}

#[test]
fn streams_are_exported_into_the_folder_whatever_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let deep = folder.path().join("a/b/c");
    fs::create_dir_all(deep.join("out")).unwrap();
    let outside = folder.path().join("EVIL").to_string_lossy().into_owned();
    session(&deep.join("s.mcap"), &["../../EVIL", &outside, "/a/b", "/a b", ".hidden"]);
    for format in ["raw", "csv", "npz"] {
        let output = erfgs(&deep, &["export", "s.mcap", "--to", format, "--out", "out", "-q"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let written: Vec<_> = fs::read_dir(deep.join("out")).unwrap().collect();
        assert_eq!(written.len(), 5, "each stream has a file of its own");
        let files = below(folder.path());
        let stray: Vec<_> = files.iter().filter(|file| !file.starts_with("a/b/c/")).collect();
        assert!(stray.is_empty(), "{stray:?}");
        for file in ["-a-b", "-a-b_2", "-hidden", "------EVIL"] {
            assert!(files.contains(&format!("a/b/c/out/{file}.{format}")), "{file} is not among {files:?}");
        }
        fs::remove_dir_all(deep.join("out")).unwrap();
        fs::create_dir(deep.join("out")).unwrap();
    }
    // Beside the recording, where no folder is named.
    let output = erfgs(&deep, &["export", "s.mcap", "--to", "raw", "-q"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(below(folder.path()).iter().all(|file| file.starts_with("a/b/c/")));
    assert!(deep.join("s.------EVIL.raw").is_file());
}

#[test]
fn a_terminal_gets_no_commands_from_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    session(&folder.path().join("s.mcap"), &["\u{1b}[2J\u{1b}]0;title\u{7}", "plain"]);
    for arguments in [
        &["info", "s.mcap"][..],
        &["info", "s.mcap", "--check"],
        &["export", "s.mcap", "--to", "png"],
        &["export", "s.mcap", "--to", "csv", "--out", "."],
        &["sync", "s.mcap"],
    ] {
        let output = erfgs(folder.path(), arguments);
        for said in [&output.stdout, &output.stderr] {
            let commands: Vec<_> = said.iter().filter(|&&byte| byte < 0x20 && byte != b'\n' && byte != b'\t').collect();
            assert!(commands.is_empty(), "{arguments:?}: {}", String::from_utf8_lossy(said).escape_debug());
        }
    }
}
