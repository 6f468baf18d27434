//! Recordings of ROS 2, as `rosbag2` writes them: `event_camera_msgs/msg/EventPacket`.

use std::{io::Cursor, path::Path};

use erfgs_events::Columns;
use erfgs_events::EventEncoding;
use erfgs_recordings::shared;
use erfgs_session::{
    container::{Entry, Session},
    source::Encoding,
};

use crate::common::{event_packet, ros_recording};

#[test]
fn packets_of_events_are_a_stream_with_its_encoding_and_size() {
    let bytes = ros_recording("evt3");
    let mut session = Session::read(Cursor::new(&bytes), Path::new("bag.mcap")).unwrap();
    let summary = session.summary().clone();
    assert!(!summary.is_session && summary.complete);
    let stream = &summary.streams[0];
    assert_eq!(stream.description.id, "event_camera-events");
    assert_eq!(stream.description.encoding, Encoding::Events(EventEncoding::Evt3));
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
    let bytes = ros_recording("trigger");
    let session = Session::read(Cursor::new(&bytes), Path::new("bag.mcap")).unwrap();
    assert_eq!(session.summary().unknown_encodings, ["trigger"]);
    assert!(session.summary().streams.is_empty());
}

/// A real recording of a DAVIS346, of one second. The sums are those of a reader of its own, written from the format's
/// description in ros-event-camera/event_camera_codecs.
#[test]
fn a_recording_of_the_ros_driver_of_libcaer_gives_its_events() {
    let Some(path) = shared("data/events_ros_event_camera_py/test_events_2/test_events_2_0.mcap") else { return };
    let mut session = Session::open(&path).unwrap();
    let summary = session.summary().clone();
    assert!(summary.complete && summary.damage.is_empty());
    assert_eq!((summary.streams.len(), summary.streams[0].totals.packets), (1, 100));
    assert_eq!((summary.streams[0].description.width, summary.streams[0].description.height), (346, 260));
    assert_eq!(summary.start.host_ns, 1_744_227_144_744_197_147);
    assert_eq!(summary.span_ns().map(|[first, last]| last - first), Some(990_468_399));
    let mut columns = Columns::default();
    let decoded = session.decode_events(0, None, &mut columns, |_| {}).unwrap().unwrap();
    assert!(decoded.anomalies.is_empty(), "{:?}", decoded.anomalies);
    let sum = |column: &[u16]| column.iter().map(|&value| u64::from(value)).sum::<u64>();
    assert_eq!((sum(&columns.x), sum(&columns.y)), (118_469_679, 78_763_572));
    assert_eq!(columns.on.iter().filter(|&&on| on).count(), 211_043);
    assert_eq!((columns.len(), columns.t_us[0]), (571_266, 6_197_288));
    assert_eq!(columns.t_us[571_265] - columns.t_us[0], 999_996);
    assert!(columns.t_us.is_sorted());
}

#[test]
fn columns_of_libcaer_become_events_in_the_order_of_their_rows() {
    // Column 5; events in row 7 (ON) and, at 4097 µs, in rows 16, 18 and 25 (OFF).
    let words: [u16; 9] = [0x0000, 0x1002, 0x2005, 0x3807, 0x0001, 0x1001, 0x4010, 0x5005, 0x5002];
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut file = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut file)).unwrap();
    let schema = writer.add_schema("event_camera_msgs/msg/EventPacket", "ros2msg", b"").unwrap();
    let channel = writer.add_channel(schema, "/events", "cdr", &Default::default()).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 9, publish_time: 9 };
    writer.write_to_known_channel(&header, &event_packet(0, "libcaer_cmp", &bytes)).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let mut session = Session::read(Cursor::new(&file), Path::new("bag.mcap")).unwrap();
    let mut columns = Columns::default();
    session.decode_events(0, None, &mut columns, |_| {}).unwrap().unwrap();
    let found: Vec<_> = columns.iter().map(|event| (event.t_us, event.x, event.y, event.on)).collect();
    assert_eq!(found, [(2, 5, 7, true), (4097, 5, 16, false), (4097, 5, 18, false), (4097, 5, 25, false)]);
}
