//! What an event camera recorded on both sides of a break, as a dataset.

use erfgs_dataset::import::session::{SessionNote, SessionOptions, Timing, Viewpoint, import};
use erfgs_events::EventEncoding;
use erfgs_events::npz;
use erfgs_scene::{Distortion, Intrinsics, Pose};
use erfgs_session::{container::Session, source::Encoding};
use erfgs_sync::{SyncOptions, synchronise};

use super::support::{MS, board, camera, part, write};

#[test]
fn a_dataset_has_the_events_of_the_longer_side_or_of_the_one_that_is_asked_for_at_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    // A DAVIS whose ticks repeat.
    let (packets, truth) =
        camera(Encoding::Events(EventEncoding::Davis), &[part(0, 6, 0, -80.0), part(8, 12, 8_000 * MS, -80.0)], true);
    write(&path, Encoding::Events(EventEncoding::Davis), &packets, Some(&board(12)));
    let mut session = Session::open(&path).unwrap();
    let sync = synchronise(&mut session, SyncOptions::default(), |_| {}).unwrap();
    let intrinsics = Intrinsics {
        width: 346,
        height: 260,
        fx: 300.0,
        fy: 300.0,
        cx: 173.0,
        cy: 130.0,
        distortion: Distortion::None,
    };
    let view = Viewpoint {
        stream: "eye".into(),
        camera: "eye".into(),
        intrinsics,
        pose: Pose::IDENTITY,
        pose_sigma: None,
        clock_sigma_s: None,
        timing: Timing { epochs: sync.stream("eye").unwrap().epochs.clone(), ..Timing::default() },
        thresholds: [0.2, 0.2],
    };
    for (name, window_ns, expected) in [
        // Of the two seconds in between nothing is known, which is not the same as that nothing happened.
        ("whole", None, &truth[..truth.partition_point(|&at| at < 7_000 * MS)]),
        ("late", Some([9_000 * MS, 11_000 * MS]), &truth[truth.partition_point(|&at| at < 9_000 * MS)..]),
    ] {
        let out = folder.path().join(name);
        let options = SessionOptions { window_ns, ..SessionOptions::default() };
        let mut notes = Vec::new();
        let view = std::slice::from_ref(&view);
        let found = import(&mut session, view, &options, &out, &mut |note| notes.push(note), &mut |_| {}).unwrap();
        let [from, to] = found.manifest.cameras[0].events.as_ref().unwrap().covers_ns;
        let partly = notes.iter().any(|note| matches!(note, SessionNote::EventsOfPart { .. }));
        assert!(partly == window_ns.is_none() && from < 1000, "{name}: {notes:?}");
        let span_ns = if partly { 6_000 * MS } else { found.manifest.span_ns[1] };
        assert!((to - span_ns).abs() < 2 * MS, "{name}: {to}");
        let file = std::fs::read_dir(out.join("events")).unwrap().next().unwrap().unwrap().path();
        let events = npz::read_events(&file, None).unwrap();
        let expected: Vec<i64> =
            expected.iter().take_while(|&&at| window_ns.is_none_or(|[_, to]| at <= to)).copied().collect();
        // At the ends of the window, what lies within the clock's error of it may fall out.
        assert!(events.len().abs_diff(expected.len()) <= 2, "{name}: {} of {}", events.len(), expected.len());
        // Times count from the first event.
        let off = events.t_us.iter().zip(&expected).map(|(&t_us, at)| (t_us * 1000 - (at - expected[0])).abs());
        assert!(off.max().unwrap() < MS, "{name}");
    }
}
