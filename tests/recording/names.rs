//! Recordings in which somebody chose the names of the streams with a purpose of his own.

use std::{fs, io::Cursor, path::Path};

use erfgs_base::random;
use erfgs_events::{CdEvent, EventEncoding, Evt3Encoder};
use erfgs_scene::{
    Distortion, Intrinsics, Modality, Pose,
    rig_file::{RigCamera, RigFile},
};
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
        for stream in [&output.stdout, &output.stderr] {
            let commands: Vec<_> =
                stream.iter().filter(|&&byte| byte < 0x20 && byte != b'\n' && byte != b'\t').collect();
            assert!(commands.is_empty(), "{arguments:?}: {}", String::from_utf8_lossy(stream).escape_debug());
        }
    }
}

/// What names are made of that are meant to be something else: a path, a command, another name.
const PIECES: [&str; 28] = [
    "..",
    "/",
    "\\",
    ".",
    "a",
    "A",
    "cam",
    "0",
    " ",
    "  ",
    "\0",
    "\n",
    "\r",
    "\t",
    "\u{1b}[2J",
    "\u{202e}",
    "\u{7f}",
    "~",
    "$HOME",
    "%2e%2e%2f",
    "'",
    "\"",
    ":",
    "#",
    "CON",
    "ä",
    "\u{1f980}",
    "-",
];

/// Names drawn from the pieces, and some that lie in wait in `folder`: paths there, the longest ones, none at all.
fn drawn(seed: u64, folder: &Path) -> Vec<String> {
    let absolute = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let mut names =
        vec![String::new(), "..".into(), "x".repeat(3000), "ä/".repeat(400), absolute("EVIL"), absolute("../EVIL")];
    names.extend((0..26).map(|number| {
        let key = random::key(seed, &[random::purpose("names"), number]);
        let length = 1 + random::below(key, 7);
        (0..length).map(|at| PIECES[random::below(random::extend(key, at), PIECES.len() as u64) as usize]).collect()
    }));
    names
}

/// Runs the program in `work`, a folder below `all`, and says what it wrote. It may refuse; it may not panic, write outside of
/// `work`, or send a terminal what is no text.
fn written(all: &Path, work: &Path, arguments: &[&str]) -> (Vec<String>, String) {
    let before = below(all);
    let output = erfgs(work, arguments);
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned();
    assert!(matches!(output.status.code(), Some(0..=2)), "{arguments:?}: {:?}: {text}", output.status);
    let controls = text.chars().filter(|&c| c.is_control() && c != '\n' && c != '\t' || c == '\u{202e}').count();
    assert_eq!(controls, 0, "{arguments:?}: {}", text.escape_debug());
    let place = format!("{}/", work.strip_prefix(all).unwrap().display());
    let new: Vec<String> = below(all).into_iter().filter(|file| !before.contains(file)).collect();
    let stray: Vec<_> = new.iter().filter(|file| !file.starts_with(&place)).collect();
    assert!(stray.is_empty(), "{arguments:?} wrote {stray:?}");
    if !output.status.success() {
        assert!(text.contains("error:"), "{arguments:?}: {text}");
    }
    (new, text)
}

#[test]
fn whatever_the_streams_are_called_nothing_is_written_elsewhere() {
    for seed in 0..3 {
        let folder = tempfile::tempdir().unwrap();
        let work = folder.path().join("a/b/work");
        fs::create_dir_all(&work).unwrap();
        let names = drawn(seed, &work.join(".."));
        session(&work.join("s.mcap"), &names.iter().map(String::as_str).collect::<Vec<_>>());
        for (arguments, files) in [
            (&["export", "s.mcap", "--to", "raw", "--out", "raw"][..], Some(names.len())),
            (&["export", "s.mcap", "--to", "npz", "--out", "npz"], Some(names.len())),
            (&["export", "s.mcap", "--to", "csv"], Some(names.len())),
            (&["export", "s.mcap", "--to", "session", "--out", "t.mcap"], Some(1)),
            (&["recover", "s.mcap", "--out", "r.mcap"], None),
            (&["info", "s.mcap", "--check"], Some(0)),
            (&["sync", "s.mcap"], None),
        ] {
            let (new, text) = written(folder.path(), &work, arguments);
            assert!(
                files.is_none_or(|files| files == new.len()),
                "{arguments:?}: {} files: {new:#?}; {text}",
                new.len()
            );
        }
    }
}

#[test]
fn whatever_the_cameras_are_called_nothing_is_written_elsewhere() {
    let intrinsics =
        Intrinsics { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, distortion: Distortion::None };
    for seed in 0..2 {
        let folder = tempfile::tempdir().unwrap();
        let work = folder.path().join("a/b/work");
        fs::create_dir_all(&work).unwrap();
        let names = drawn(seed, &work.join(".."));
        let cameras = |names: &[String]| -> Vec<RigCamera> {
            let pose = Some(Pose::IDENTITY);
            names.iter().map(|name| RigCamera::new(name, Modality::Rgb, intrinsics, pose)).collect()
        };
        let mut rigs = vec![cameras(&names)];
        rigs.extend(names.iter().map(|name| cameras(std::slice::from_ref(name))));
        let mut converted = 0;
        for (number, cameras) in rigs.into_iter().enumerate() {
            let rig = serde_json::to_string(&RigFile::new("board", true, cameras)).unwrap();
            fs::write(work.join("rig.json"), rig).unwrap();
            // All formats for all names at once, and one after the other for each name alone.
            let formats = ["colmap", "kalibr", "opencv", "ros", "nerfstudio", "llff", "caliscope", "pose2sim", "rig"];
            for (index, format) in formats.into_iter().enumerate() {
                if number > 0 && number % formats.len() != index {
                    continue;
                }
                let out = format!("out-{number}-{format}");
                let arguments = ["calibrate", "convert", "rig.json", "--to", format, "--out", &out];
                converted += usize::from(!written(folder.path(), &work, &arguments).0.is_empty());
            }
        }
        assert!(converted > 0, "every rig was refused");
    }
}
