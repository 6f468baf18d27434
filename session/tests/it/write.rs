use std::{
    io::{self, Write},
    path::Path,
};

use erfgs_events::EventEncoding;
use erfgs_session::{
    clock::ClockFit,
    container::{ContainerError, SessionWriter, Settings, Status, packet},
    source::{Description, Encoding, Incident},
};

use crate::common::{self, START_NS};

#[test]
fn another_reader_finds_every_message_with_its_schema_and_description() {
    let (mut writer, events, frames) = common::writer(Settings { chunk_bytes: 4000, ..Settings::default() });
    for sequence in 0..20 {
        writer.packet(events, &common::packet(sequence, 500)).unwrap();
        writer.packet(frames, &common::packet(sequence, 70)).unwrap();
    }
    let fit = common::fit(7);
    writer.clock(events, START_NS + 5, &fit).unwrap();
    writer.incident(Some(frames), START_NS + 6, &Incident::Lost { reason: "unplugged".into() }).unwrap();
    writer.status(&Status { host_ns: START_NS + 7, ..Status::default() }).unwrap();
    let finished = writer.finish().unwrap();
    let (events, frames) = (finished.totals.streams["ev0"], finished.totals.streams["cam0"]);
    assert_eq!((events.packets, events.bytes), (20, 10_000));
    assert_eq!((frames.discontinuities, frames.damaged), (1, 1));
    assert_eq!(finished.bytes, finished.sink.len() as u64);

    let summary = mcap::Summary::read(&finished.sink).unwrap().unwrap();
    assert!(summary.chunk_indexes.len() > 2);
    assert_eq!(summary.attachment_indexes[0].name, "rig.toml");
    assert_eq!(summary.stats.unwrap().message_count, 43);
    let mut next = 0;
    for message in mcap::MessageStream::new(&finished.sink).unwrap() {
        let message = message.unwrap();
        match message.channel.topic.as_str() {
            "/event/ev0/raw" => {
                assert_eq!(message.channel.schema.as_ref().unwrap().name, packet::SCHEMA_NAME);
                let description: Description =
                    serde_json::from_str(&message.channel.metadata["erfgs.description"]).unwrap();
                assert_eq!(description, common::description("ev0", Encoding::Events(EventEncoding::Evt3)));
                let found = packet::parse(&message.data.into_owned().into()).unwrap();
                assert_eq!(found, common::packet(next, 500));
                assert_eq!(message.log_time, 1_750_000_000_000_000_000 + next * 10_000_000);
                next += 1;
            }
            "/frame/cam0/mjpeg" if message.sequence == 1 => {
                assert_eq!(message.publish_time, message.log_time - 1_000_000, "the kernel's stamp");
            }
            "/clock/ev0" => assert_eq!(serde_json::from_slice::<ClockFit>(&message.data).unwrap(), fit),
            "/incidents" => {
                let json: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
                assert_eq!((&json["stream"], &json["kind"]), (&"cam0".into(), &"lost".into()));
            }
            _ => {}
        }
    }
    assert_eq!(next, 20);
}

#[test]
fn a_chunk_closes_when_it_is_old_even_if_nothing_follows() {
    let (mut writer, events, _) = common::writer(Settings::default());
    writer.packet(events, &common::packet(0, 100)).unwrap();
    let before = writer.written_bytes();
    writer.flush_if_due(START_NS + 499_999_999).unwrap();
    assert_eq!(writer.written_bytes(), before);
    writer.flush_if_due(START_NS + 500_000_000).unwrap();
    assert!(writer.written_bytes() > before + 100);
    let after = writer.written_bytes();
    writer.flush_if_due(START_NS + 5_000_000_000).unwrap();
    assert_eq!(writer.written_bytes(), after, "there is nothing to write");
}

#[test]
fn names_that_clash_or_break_topics_are_refused() {
    let (mut writer, _, _) = common::writer(Settings::default());
    let mut add = |id| writer.add_stream(&common::description(id, Encoding::Events(EventEncoding::Evt3))).unwrap_err();
    assert!(matches!(add("ev0"), ContainerError::DuplicateStream { .. }));
    assert!(matches!(add("a/b"), ContainerError::StreamName { .. }));
    assert!(matches!(add(""), ContainerError::StreamName { .. }));
}

#[test]
fn a_file_that_exists_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    std::fs::write(&path, b"precious").unwrap();
    let error = SessionWriter::create(&path, common::start(), "", Settings::default()).err().unwrap();
    assert!(matches!(error, ContainerError::Exists { .. }), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

/// Takes `room` bytes, then nothing more.
struct FullDisk {
    room: usize,
}

impl Write for FullDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.room == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let taken = bytes.len().min(self.room);
        self.room -= taken;
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_that_says_how_far_it_came() {
    let path = Path::new("full.mcap");
    for room in (0..20_000).step_by(371) {
        let settings = Settings { chunk_bytes: 4000, ..Settings::default() };
        let written =
            SessionWriter::new(FullDisk { room }, path, common::start(), "", settings).and_then(|mut writer| {
                let stream = writer.add_stream(&common::description("ev0", Encoding::Events(EventEncoding::Evt3)))?;
                for sequence in 0..100 {
                    writer.packet(stream, &common::packet(sequence, 500))?;
                }
                writer.finish().map(drop)
            });
        match written.unwrap_err() {
            ContainerError::Write { offset, source, .. } => {
                assert!(offset <= room as u64 + (1 << 16), "{offset} of {room}");
                assert_eq!(source.kind(), io::ErrorKind::StorageFull);
            }
            other => panic!("{other}"),
        }
    }
}
