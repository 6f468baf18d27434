//! Playing a small session into a collecting outlet.

use std::{
    path::Path,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use erfgs_events::EventEncoding;
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Incident, Outlet, Packet, Source, StampClock, StampPoint},
};

use super::{Controls, Player, PlayerOptions, Speed};

const START_NS: i64 = 900_000_000_000;

/// A second of two streams: a packet every 10 ms.
fn write(path: &Path) {
    let start = SessionStart { host_ns: START_NS, epoch_ns: 5, ..SessionStart::default() };
    let settings = Settings { chunk_bytes: 500, ..Settings::default() };
    let mut writer = SessionWriter::create(path, start, "", settings).unwrap();
    let description = |id: &str, encoding| Description {
        id: id.into(),
        model: "m".into(),
        serial: String::new(),
        encoding,
        width: 4,
        height: 4,
        start_order: 0,
        settings: serde_json::Map::new(),
    };
    let events = writer.add_stream(&description("ev", Encoding::Events(EventEncoding::Evt3))).unwrap();
    let frames = writer.add_stream(&description("cam", Encoding::Frames(PixelFormat::Grey8))).unwrap();
    for sequence in 0..100 {
        let host_ns = START_NS + sequence as i64 * 10_000_000;
        let stamp = FrameStamp {
            kernel_ns: host_ns - 7,
            clock: StampClock::Monotonic,
            point: StampPoint::EndOfFrame,
            sequence: 3,
        };
        let mut packet = Packet {
            sequence,
            host_ns,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: vec![sequence as u8; 16].into(),
        };
        writer.packet(events, &packet).unwrap();
        packet.stamp = Some(stamp);
        writer.packet(frames, &packet).unwrap();
        if sequence == 50 {
            writer.incident(Some(frames), host_ns, &Incident::Back).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[derive(Default)]
struct Collected {
    packets: Mutex<Vec<Packet>>,
    incidents: Mutex<Vec<Incident>>,
    /// Takes every n-th offer only, if above 1.
    reluctance: usize,
    offers: Mutex<usize>,
}

impl Outlet for Collected {
    fn send(&self, packet: Packet) -> bool {
        let mut offers = self.offers.lock().unwrap();
        *offers += 1;
        let taken = self.reluctance < 2 || offers.is_multiple_of(self.reluctance);
        if taken {
            self.packets.lock().unwrap().push(packet);
        }
        taken
    }

    fn report(&self, incident: Incident) {
        self.incidents.lock().unwrap().push(incident);
    }
}

struct Playing {
    _folder: tempfile::TempDir,
    outlets: Vec<Arc<Collected>>,
    sources: Vec<super::PlayedSource>,
    controls: Controls,
}

fn play(options: PlayerOptions, reluctance: usize) -> Playing {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path);
    let player = Player::open(&path, options).unwrap();
    let mut sources = player.sources();
    let outlets: Vec<Arc<Collected>> =
        sources.iter().map(|_| Arc::new(Collected { reluctance, ..Collected::default() })).collect();
    for (source, outlet) in std::iter::zip(&mut sources, &outlets) {
        source.start(outlet.clone()).unwrap();
    }
    Playing { _folder: folder, outlets, sources, controls: player.controls() }
}

/// Waits for what must come; a test that waits longer than anything takes fails.
fn wait_for(condition: impl Fn() -> bool) {
    let begun = Instant::now();
    while !condition() {
        assert!(begun.elapsed() < Duration::from_secs(120), "it never came");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn every_packet_arrives_in_order_with_its_times_moved_to_now() {
    let before = super::conductor::now_ns();
    let playing = play(PlayerOptions { speed: Speed::Max, ..PlayerOptions::default() }, 0);
    wait_for(|| playing.controls.finished());
    for (outlet, stamped) in std::iter::zip(&playing.outlets, [false, true]) {
        let packets = outlet.packets.lock().unwrap();
        assert_eq!(packets.len(), 100);
        let shift = packets[0].host_ns - START_NS;
        assert!(packets[0].host_ns >= before && packets[0].host_ns <= super::conductor::now_ns());
        for (n, packet) in packets.iter().enumerate() {
            assert_eq!(packet.sequence, n as u64);
            assert_eq!(packet.host_ns, START_NS + n as i64 * 10_000_000 + shift);
            assert_eq!(packet.payload[..], [n as u8; 16]);
            assert!(!packet.discontinuity);
            assert_eq!(packet.stamp.map(|stamp| stamp.kernel_ns), stamped.then_some(packet.host_ns - 7));
        }
    }
    assert_eq!(*playing.outlets[1].incidents.lock().unwrap(), [Incident::Back]);
    assert_eq!(playing.controls.position_ns(), Some(990_000_000));
    assert_eq!(playing.sources[0].counters().packets, 100);
}

#[test]
fn a_receiver_without_room_loses_nothing_at_full_speed_and_is_not_waited_for_otherwise() {
    let playing = play(PlayerOptions { speed: Speed::Max, ..PlayerOptions::default() }, 3);
    wait_for(|| playing.controls.finished());
    assert!(playing.outlets.iter().all(|outlet| outlet.packets.lock().unwrap().len() == 100));
    let playing = play(PlayerOptions { speed: Speed::Times(1000.0), ..PlayerOptions::default() }, 2);
    wait_for(|| playing.controls.finished());
    let counters = playing.sources[0].counters();
    assert_eq!((counters.packets, counters.refused), (50, 50));
}

#[test]
fn the_speed_paces_the_packets() {
    let begun = Instant::now();
    let playing = play(PlayerOptions { speed: Speed::Times(4.0), ..PlayerOptions::default() }, 0);
    wait_for(|| playing.controls.finished());
    // The last packet is due after 990 ms / 4. How much later it comes is the machine's affair.
    assert!(begun.elapsed() >= Duration::from_micros(247_500));
}

#[test]
fn a_start_at_a_later_time_begins_there_with_a_discontinuity() {
    let options = PlayerOptions { speed: Speed::Max, seek_ns: 605_000_000, ..PlayerOptions::default() };
    let playing = play(options, 0);
    wait_for(|| playing.controls.finished());
    for outlet in &playing.outlets {
        let packets = outlet.packets.lock().unwrap();
        assert_eq!(packets.len(), 39);
        assert_eq!((packets[0].payload[0], packets[0].sequence), (61, 0));
        assert!(packets[0].discontinuity && !packets[1].discontinuity);
    }
}

#[test]
fn rounds_follow_one_another_in_time_and_number_until_all_stop() {
    let mut playing = play(PlayerOptions { speed: Speed::Max, repeat: true, ..PlayerOptions::default() }, 0);
    wait_for(|| playing.outlets[1].packets.lock().unwrap().len() > 350);
    for source in &mut playing.sources {
        source.stop().unwrap();
    }
    let packets = playing.outlets[0].packets.lock().unwrap();
    let count = packets.len();
    for (n, pair) in packets.windows(2).enumerate() {
        assert_eq!(pair[1].sequence, pair[0].sequence + 1);
        assert_eq!(pair[1].host_ns, pair[0].host_ns + 10_000_000);
        assert_eq!(pair[1].discontinuity, (n + 1) % 100 == 0, "{n}");
    }
    drop(packets);
    assert_eq!(playing.outlets[0].packets.lock().unwrap().len(), count, "nothing follows a stop");
}

#[test]
fn a_jump_while_playing_goes_on_from_there() {
    let playing = play(PlayerOptions { speed: Speed::Max, ..PlayerOptions::default() }, 0);
    wait_for(|| playing.controls.finished());
    playing.controls.seek(900_000_000);
    wait_for(|| playing.outlets[1].packets.lock().unwrap().len() == 110);
    let packets = playing.outlets[1].packets.lock().unwrap();
    assert_eq!((packets[100].payload[0], packets[100].sequence, packets[100].discontinuity), (90, 100, true));
    assert!(packets[100].host_ns > packets[99].host_ns);
}

#[test]
fn a_pause_holds_and_dropped_sources_are_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path);
    let player = Player::open(&path, PlayerOptions { speed: Speed::Max, ..PlayerOptions::default() }).unwrap();
    let mut sources = player.sources();
    drop(sources.pop());
    player.controls().pause(true);
    let outlet = Arc::new(Collected::default());
    sources[0].start(outlet.clone()).unwrap();
    assert!(outlet.packets.lock().unwrap().is_empty());
    player.controls().pause(false);
    wait_for(|| player.controls().finished());
    assert_eq!(outlet.packets.lock().unwrap().len(), 100);
}

/// Where a paused playback stands, once it does, milliseconds.
fn stands_at(playing: &Playing, ms: i64) {
    wait_for(|| playing.controls.position_ns() == Some(ms * 1_000_000));
}

#[test]
fn a_paused_playback_steps_by_time_and_by_frame_and_back() {
    let playing = play(PlayerOptions { speed: Speed::Times(0.001), ..PlayerOptions::default() }, 0);
    let controls = &playing.controls;
    controls.pause(true);
    controls.seek(500_000_000);
    stands_at(&playing, 500);
    let last = |outlet: usize| playing.outlets[outlet].packets.lock().unwrap().last().map(|packet| packet.payload[0]);
    // What lies shortly before was sent at once, so that there is something to look at.
    assert_eq!((last(0), last(1)), (Some(50), Some(50)));
    assert!(playing.outlets[1].packets.lock().unwrap().iter().any(|packet| packet.payload[0] == 31));
    controls.step(1_000_000);
    stands_at(&playing, 501);
    assert_eq!(last(1), Some(50), "nothing was recorded within that millisecond");
    controls.step(9_000_000);
    wait_for(|| last(1) == Some(51));
    controls.step_packet(1);
    wait_for(|| last(1) == Some(52));
    stands_at(&playing, 520);
    controls.step(-100_000_000);
    stands_at(&playing, 420);
    assert_eq!(last(1), Some(42));
    assert!(controls.paused() && !controls.finished());
    controls.set_speed(Speed::Max);
    controls.pause(false);
    wait_for(|| controls.finished());
    assert_eq!(last(1), Some(99));
}

#[test]
fn a_step_at_the_end_of_a_round_does_not_run_through_the_next() {
    let options = PlayerOptions { speed: Speed::Times(0.001), repeat: true, ..PlayerOptions::default() };
    let playing = play(options, 0);
    playing.controls.pause(true);
    playing.controls.seek(985_000_000);
    stands_at(&playing, 985);
    let count = || playing.outlets[0].packets.lock().unwrap().len();
    let before = count();
    playing.controls.step(500_000_000);
    wait_for(|| count() > before);
    std::thread::sleep(Duration::from_millis(150));
    assert_eq!(count(), before + 1, "the last packet alone");
    // A jump does not move where rounds begin.
    playing.controls.set_speed(Speed::Max);
    playing.controls.pause(false);
    wait_for(|| count() > before + 50);
    let packets = playing.outlets[0].packets.lock().unwrap();
    assert_eq!(packets[before + 1].payload[0], 0);
}
