//! Recordings of ROS 2, as `rosbag2` writes them: `event_camera_msgs/msg/EventPacket`.

use std::{io::Cursor, path::Path};

use erfgs_session::{
    container::{Entry, Session},
    source::Encoding,
};

/// A message as the CDR of ROS 2 lays it out.
fn event_packet(sequence: u64, encoding: &str, events: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    let align = |bytes: &mut Vec<u8>, size: usize| {
        while !(bytes.len() - 4).is_multiple_of(size) {
            bytes.push(0);
        }
    };
    let text = |bytes: &mut Vec<u8>, text: &str| {
        while !(bytes.len() - 4).is_multiple_of(4) {
            bytes.push(0);
        }
        bytes.extend_from_slice(&(text.len() as u32 + 1).to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        bytes.push(0);
    };
    bytes.extend_from_slice(&17_i32.to_le_bytes());
    bytes.extend_from_slice(&5_u32.to_le_bytes());
    text(&mut bytes, "optical_frame");
    align(&mut bytes, 4);
    bytes.extend_from_slice(&480_u32.to_le_bytes());
    bytes.extend_from_slice(&640_u32.to_le_bytes());
    align(&mut bytes, 8);
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&123_u64.to_le_bytes());
    text(&mut bytes, encoding);
    bytes.push(0);
    align(&mut bytes, 4);
    bytes.extend_from_slice(&(events.len() as u32).to_le_bytes());
    bytes.extend_from_slice(events);
    bytes
}

fn recording(encoding: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("event_camera_msgs/msg/EventPacket", "ros2msg", b"").unwrap();
    let channel = writer.add_channel(schema, "/event_camera/events", "cdr", &Default::default()).unwrap();
    for sequence in 40..45 {
        let time = 1_744_000_000_000_000_000 + sequence * 1_000_000;
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: time, publish_time: time };
        let message = event_packet(sequence, encoding, &vec![sequence as u8; sequence as usize]);
        writer.write_to_known_channel(&header, &message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

#[test]
fn packets_of_events_are_a_stream_with_its_encoding_and_size() {
    let bytes = recording("evt3");
    let mut session = Session::read(Cursor::new(&bytes), Path::new("bag.mcap")).unwrap();
    let summary = session.summary().clone();
    assert!(!summary.is_session && summary.complete);
    let stream = &summary.streams[0];
    assert_eq!(stream.description.id, "event_camera-events");
    assert_eq!(stream.description.encoding, Encoding::Evt3);
    assert_eq!((stream.description.width, stream.description.height), (640, 480));
    assert_eq!((stream.totals.packets, stream.totals.missing), (5, 0), "numbers need not start at 0");
    assert_eq!(summary.start.session_ns(stream.totals.last_host_ns.unwrap()), 4_000_000);
    let packets: Vec<_> = session.messages(None).map(Result::unwrap).collect();
    assert_eq!(packets.len(), 5);
    for (entry, sequence) in packets.iter().zip(40_u64..) {
        let Entry::Packet { packet, .. } = entry else { panic!("{entry:?}") };
        assert_eq!(packet.sequence, sequence);
        assert_eq!(packet.payload, vec![sequence as u8; sequence as usize]);
    }
}

#[test]
fn an_encoding_that_is_not_known_is_named() {
    let bytes = recording("libcaer_cmp");
    let session = Session::read(Cursor::new(&bytes), Path::new("bag.mcap")).unwrap();
    assert_eq!(session.summary().unknown_encodings, ["libcaer_cmp"]);
    assert!(session.summary().streams.is_empty());
}
