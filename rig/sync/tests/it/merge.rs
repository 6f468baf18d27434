//! Two hosts, one board: their sessions as one, against the truth.

use std::path::{Path, PathBuf};

use erfgs_events::EventEncoding;
use erfgs_session::{
    container::{Entry, Merged, Part, Session, SessionStart, SessionWriter, Settings, merge},
    source::{Description, Encoding, FrameStamp, Incident, Packet, StampClock, StampPoint},
};
use erfgs_sync::{AlignError, Pulses, SyncOptions, Synchronisation, Tier, synchronise};

use crate::breaks::support::{Dates, MS, START_NS, board, camera, description, part};

const EVT3: Encoding = Encoding::Events(EventEncoding::Evt3);
/// What the second host's clock shows at the true time 0 of the first, and how much faster it runs.
const OFFSET_NS: i64 = -31_234_567_891_234;
const PPM: f64 = 43.0;

/// A host time of the first host, as the second one's clock shows it.
fn skewed(host_ns: i64) -> i64 {
    let since = (host_ns - START_NS) as f64;
    host_ns + OFFSET_NS + (since * PPM * 1e-6).round() as i64
}

fn start(host_ns: i64, epoch_ns: i64) -> SessionStart {
    SessionStart { host_ns, epoch_ns, program: "test".into(), ..SessionStart::default() }
}

/// Frames of a triggered camera, exposed for 5 ms from each pulse on; their stamps come 1 ms after the exposure.
fn frames(seconds: i64) -> Vec<Packet> {
    let frame = |index: i64| {
        let end = START_NS + 500 * MS + index * 1_000_000_000 / 30 + 6 * MS;
        let stamp = FrameStamp {
            kernel_ns: end,
            clock: StampClock::Monotonic,
            point: StampPoint::EndOfFrame,
            sequence: index as u32,
        };
        let payload = vec![index as u8; 12].into();
        Packet {
            sequence: index as u64,
            host_ns: end + MS,
            discontinuity: false,
            damaged: false,
            stamp: Some(stamp),
            payload,
        }
    };
    (0..(seconds - 1) * 30).map(frame).collect()
}

/// One host's session: its streams with their packets.
fn write(path: &Path, start: SessionStart, streams: &[(Description, Vec<Packet>)]) {
    let mut writer = SessionWriter::create(path, start, "# a rig\n", Settings::default()).unwrap();
    let ids: Vec<_> = streams.iter().map(|(description, _)| writer.add_stream(description).unwrap()).collect();
    let mut all = Vec::new();
    for ((_, packets), id) in streams.iter().zip(ids) {
        // A device's packets arrive one after another.
        let mut last_ns = i64::MIN;
        for packet in packets {
            last_ns = last_ns.max(packet.host_ns);
            all.push((id, Packet { host_ns: last_ns, ..packet.clone() }));
        }
    }
    all.sort_by_key(|(_, packet)| packet.host_ns);
    for (id, packet) in all {
        writer.packet(id, &packet).unwrap();
    }
    writer.finish().unwrap();
}

/// The streams of a host that has no board, by its own clock.
fn second_host(packets: &[Packet]) -> Vec<Packet> {
    let moved = |packet: &Packet| {
        let mut packet = packet.clone();
        packet.host_ns = skewed(packet.host_ns);
        if let Some(stamp) = &mut packet.stamp {
            stamp.kernel_ns = skewed(stamp.kernel_ns);
        }
        packet
    };
    packets.iter().map(moved).collect()
}

fn triggered(id: &str) -> Description {
    let mut description = description(id, "grey8".parse().unwrap(), [4, 3]);
    description.settings.insert("triggered".into(), true.into());
    description.settings.insert("exposure_us".into(), 5000.into());
    description
}

struct Hosts {
    folder: tempfile::TempDir,
    paths: [PathBuf; 2],
    /// True times of the events of each host's camera, on the first one's session clock.
    truth: [Vec<i64>; 2],
}

/// The first host has the board and an event camera, the second an event camera and a triggered camera; both call it `eye`.
fn hosts(seconds: i64) -> Hosts {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["left.mcap", "right.mcap"].map(|name| folder.path().join(name));
    let (left, of_left) = camera(EVT3, &[part(0, seconds, -3_000 * MS, 90.0)], false);
    // It joins a second later and stays a second longer.
    let (right, of_right) = camera(EVT3, &[part(1, seconds + 1, -700 * MS, -60.0)], false);
    let eye = || description("eye", EVT3, [1280, 720]);
    write(
        &paths[0],
        start(START_NS, 1_000_000_000_000),
        &[(eye(), left), (description("board", Encoding::TriggerLines, [0, 0]), board(seconds + 1))],
    );
    write(
        &paths[1],
        start(skewed(START_NS + 900 * MS), 1_000_000_000_000 + 3_000 * MS),
        &[(eye(), second_host(&right)), (triggered("camera"), second_host(&frames(seconds)))],
    );
    Hosts { folder, paths, truth: [of_left, of_right] }
}

/// As `erfgs merge` does it.
fn merged(paths: &[&Path], out: &Path, any_date: bool) -> Result<Merged, AlignError> {
    let mut sessions: Vec<Session> = paths.iter().map(|path| Session::open(path)).collect::<Result<_, _>>()?;
    let pulses = sessions.iter_mut().map(|session| Pulses::of(session, |_| {})).collect::<Result<Vec<_>, _>>()?;
    let first = Pulses::reference(&pulses)?;
    let to_host = pulses
        .iter()
        .map(|own| Ok(own.align(&pulses[first], any_date)?.to_host_ns(own, &pulses[first])))
        .collect::<Result<Vec<_>, AlignError>>()?;
    let mut parts: Vec<Part<'_, _>> =
        sessions.iter_mut().zip(&to_host).map(|(session, host_ns)| Part { session, host_ns: &**host_ns }).collect();
    parts[..=first].rotate_right(1);
    Ok(merge(&mut parts, out, |_| {})?)
}

/// The farthest that an event of a stream is off.
fn off(session: &mut Session, sync: &Synchronisation, id: &str, truth: &[i64]) -> i64 {
    let found = sync.stream(id).unwrap();
    assert_eq!(found.tier, Tier::HardwareTriggered, "{id}: {:?}", found.notes);
    let mut dates = Dates(found.epochs.follow(), Vec::new());
    let (stream, _) = session.stream(id).unwrap();
    session.decode_events(stream, None, &mut dates, |_| {}).unwrap();
    assert!(!dates.1.is_empty() && dates.1.len() <= truth.len(), "{id}: {} events", dates.1.len());
    std::iter::zip(&dates.1, truth).map(|(date, truth)| (date - truth).abs()).max().unwrap()
}

#[test]
fn two_hosts_with_clocks_of_their_own_become_one_session() {
    let Hosts { folder, paths, truth } = hosts(8);
    let out = folder.path().join("take.mcap");
    // The one with the board gives the clock, wherever it is named.
    let merged = merged(&[&paths[1], &paths[0]], &out, false).unwrap();
    let names: Vec<&str> = merged.streams.iter().map(|stream| stream.merged_id.as_str()).collect();
    assert_eq!(names, ["eye", "board", "right-eye", "camera"]);
    assert!(merged.cut_off.is_empty() && merged.damaged.is_empty(), "{merged:?}");

    let mut session = Session::open(&out).unwrap();
    assert!(session.summary().complete);
    assert_eq!(session.summary().start.host_ns, START_NS, "the board's host began first");
    // Every packet, byte for byte and in the order of arrival.
    let payloads = |path: &Path, id: &str| -> Vec<Packet> {
        let mut session = Session::open(path).unwrap();
        let (wanted, _) = session.stream(id).unwrap();
        let of_stream = |entry| match entry {
            Ok(Entry::Packet { stream, packet }) if stream == wanted => Some(packet),
            _ => None,
        };
        session.messages(None).filter_map(of_stream).collect()
    };
    for (path, id, merged_id) in
        [(&paths[0], "eye", "eye"), (&paths[1], "eye", "right-eye"), (&paths[1], "camera", "camera")]
    {
        let (there, here) = (payloads(path, id), payloads(&out, merged_id));
        assert_eq!(there.len(), here.len(), "{id}");
        assert!(std::iter::zip(&there, &here).all(|(a, b)| a.payload == b.payload && a.sequence == b.sequence), "{id}");
    }
    let times: Vec<i64> = session
        .messages(None)
        .filter_map(|entry| match entry {
            Ok(Entry::Packet { packet, .. }) => Some(packet.host_ns),
            _ => None,
        })
        .collect();
    assert!(times.is_sorted());

    // Both cameras are tied to the board: what its clock is off is common to both.
    let sync = synchronise(&mut session, SyncOptions::default(), |_| {}).unwrap();
    for (id, truth) in [("eye", &truth[0]), ("right-eye", &truth[1])] {
        let off = off(&mut session, &sync, id, truth);
        assert!(off < 152_000, "{id}: {off} ns");
    }
    // And so is the triggered camera, whose middles lie 2.5 ms after the pulses.
    let camera = sync.stream("camera").unwrap();
    assert_eq!(camera.tier, Tier::HardwareTriggered);
    let exposures = camera.exposures.as_ref().unwrap();
    assert_eq!((exposures.pulse.len(), exposures.unmatched), (7 * 30, 0));
    let middles = std::iter::zip(&exposures.sequence, &exposures.mid_ns);
    let off = middles.map(|(&n, mid)| (mid - (502_500_000 + n as i64 * 1_000_000_000 / 30)).abs()).max();
    assert!(off < Some(152_000), "{off:?}");
}

#[test]
fn a_host_that_is_lost_costs_its_own_streams_only() {
    let Hosts { folder, paths, truth } = hosts(8);
    let whole = std::fs::read(&paths[1]).unwrap();
    std::fs::write(&paths[1], &whole[..whole.len() / 2]).unwrap();
    let out = folder.path().join("take.mcap");
    let merged = merged(&[&paths[0], &paths[1]], &out, false).unwrap();
    assert_eq!(merged.cut_off, [paths[1].clone()]);
    let mut session = Session::open(&out).unwrap();
    let lost: Vec<&str> = session
        .summary()
        .totals
        .incidents
        .iter()
        .filter(|entry| matches!(entry.incident, Incident::Lost { .. }))
        .map(|entry| entry.stream.as_str())
        .collect();
    assert_eq!(lost, ["right-eye", "camera"]);
    let sync = synchronise(&mut session, SyncOptions::default(), |_| {}).unwrap();
    let (_, left) = session.summary().stream("eye").unwrap();
    assert_eq!(left.totals.packets, 8_000, "all of the other host's packets");
    for (id, truth) in [("eye", &truth[0]), ("right-eye", &truth[1])] {
        let off = off(&mut session, &sync, id, truth);
        assert!(off < 152_000, "{id}: {off} ns");
    }
}

#[test]
fn sessions_that_do_not_belong_together_are_refused() {
    let Hosts { folder, paths: [left, right], .. } = hosts(4);
    let out = folder.path().join("take.mcap");
    let refused = |paths: &[&Path]| merged(paths, &out, false).unwrap_err();
    let eye = || description("eye", EVT3, [1280, 720]);

    // Frames alone do not tell the number of a pulse.
    let frames_only = folder.path().join("frames.mcap");
    write(&frames_only, start(START_NS, 1_000_000_000_000), &[(triggered("camera"), frames(4))]);
    assert!(matches!(refused(&[&left, &frames_only]), AlignError::NoPulses { path } if path == frames_only));
    let message = refused(&[&left, &frames_only]).to_string();
    assert!(message.contains("frames.mcap") && message.contains("trigger input"), "{message}");

    assert!(matches!(refused(&[&left, &left]), AlignError::TwoBoards { .. }));

    // The same pulse numbers, minutes later: another take.
    let later = folder.path().join("later.mcap");
    let (packets, _) = camera(EVT3, &[part(1, 5, -700 * MS, -60.0)], false);
    write(&later, start(skewed(START_NS), 1_000_000_000_000 + 200_000 * MS), &[(eye(), second_host(&packets))]);
    let error = refused(&[&left, &later]);
    assert!(matches!(&error, AlignError::OtherTake { .. }) && error.to_string().contains("200 s"), "{error}");
    assert!(!out.exists(), "nothing is written of what is refused");
    merged(&[&left, &later], &out, true).unwrap();
    std::fs::remove_file(&out).unwrap();

    // Pulses of the same numbers that come 2 % faster, and others of the same time.
    let seen = Pulses::of(&mut Session::open(&right).unwrap(), |_| {}).unwrap();
    let reference = Pulses::of(&mut Session::open(&left).unwrap(), |_| {}).unwrap();
    assert!(seen.align(&reference, false).is_ok());
    let with = |change: fn((u64, i64)) -> (u64, i64)| {
        let rises_ns = seen.rises_ns.iter().map(|(&index, &ns)| change((index, ns))).collect();
        Pulses { rises_ns, ..seen.clone() }.align(&reference, true).unwrap_err()
    };
    let error = with(|(index, ns)| (index, ns / 50 * 49));
    assert!(matches!(error, AlignError::OtherTrain { .. }), "{error}");
    let error = with(|(index, ns)| (index + 10_000, ns));
    assert!(matches!(error, AlignError::NothingInCommon { common: 0, .. }), "{error}");
}
