//! Frames as folders of pictures.

use std::{fs, path::Path};

use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{Recording, SessionWriter, Settings},
    export::{FramesChoice, FramesFormat, WrittenFrames, write_frames},
    source::{Description, Encoding, Packet},
};

use crate::common::{START_NS, description, plain, start};

/// A tenth of a second of grey frames, one every ten milliseconds; of `cut` the last one lacks a byte.
fn write(path: &Path, cut: bool) {
    let mut writer = SessionWriter::create(path, start(), "[rig]\n", Settings::default()).unwrap();
    let frames = Encoding::Frames(PixelFormat::Grey8);
    let camera = writer.add_stream(&Description { width: 4, height: 2, ..description("cam0", frames) }).unwrap();
    for index in 0..10 {
        let bytes = if cut && index == 9 { 7 } else { 8 };
        let packet: Packet = plain(index, START_NS + (index as i64 + 1) * 10_000_000, vec![index as u8 * 20; bytes]);
        writer.packet(camera, &packet).unwrap();
    }
    writer.finish().unwrap();
}

fn export(recording: &mut Recording, until_ms: i64, out: &Path) -> WrittenFrames {
    recording.restrict(Some([0, until_ms * 1_000_000]));
    let choice = FramesChoice { format: FramesFormat::Png, exposures: None, bits: None };
    write_frames(recording, "cam0", choice, out, &mut Vec::new(), |_| {}).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<_> = names.collect();
    names.sort();
    names
}

#[test]
fn pictures_of_an_earlier_export_are_not_among_those_of_a_later_one() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("s.mcap"), folder.path().join("deep/pictures"));
    write(&path, false);
    let mut recording = Recording::open(&path, None).unwrap();
    assert_eq!(export(&mut recording, 100, &out).frames, 10);
    assert_eq!(names(&out).len(), 11);
    assert_eq!(names(&folder.path().join("deep")), ["pictures"], "nothing is left beside it");
    for other in ["notes.txt", "0000001.png", "000003.exr"] {
        fs::write(out.join(other), b"another's").unwrap();
    }
    assert_eq!(export(&mut recording, 20, &out).frames, 2);
    assert_eq!(names(&out), ["000000.png", "0000001.png", "000001.png", "000003.exr", "frames.csv", "notes.txt"]);
    assert_eq!(fs::read_to_string(out.join("frames.csv")).unwrap().lines().count(), 3);
}

#[test]
fn a_range_without_frames_leaves_everything_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("s.mcap"), folder.path().join("pictures"));
    write(&path, true);
    let mut recording = Recording::open(&path, None).unwrap();
    assert_eq!(export(&mut recording, 5, &out).frames, 0);
    assert_eq!(names(folder.path()), ["s.mcap"]);
    let written = export(&mut recording, 100, &out);
    assert_eq!((written.frames, written.damaged), (9, 1));
    export(&mut recording, 5, &out);
    assert_eq!(names(&out).len(), 10);
}
