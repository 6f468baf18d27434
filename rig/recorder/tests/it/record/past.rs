//! Recordings that begin before they were asked for.

use std::{
    path::Path,
    sync::{Arc, OnceLock, Weak},
    thread,
    time::Duration,
};

use erfgs_recorder::{Alarm, AlarmKind, Before, Options, RecordError, Recorder, SessionFiles};
use erfgs_rig::host_time::host_ns;
use erfgs_session::{Session, container::Entry};

use crate::record::support::{Puppet, options, packet, wait_until};

fn held_options(folder: &Path, span_ms: u64, after_ms: Option<u64>) -> Options {
    Options {
        folder: folder.into(),
        before: Some(Before { span: Duration::from_millis(span_ms), bytes: 64 << 20 }),
        after: after_ms.map(Duration::from_millis),
        ..options(SessionFiles::default())
    }
}

/// Sequence numbers and host times of a whole session.
fn packets(path: &Path) -> Vec<(u64, i64)> {
    let mut session = Session::open(path).unwrap();
    assert!(session.summary().complete);
    assert_eq!(session.check(|_| {}).unwrap(), Vec::<String>::new());
    let start_ns = session.summary().start.host_ns;
    let packet = |entry| match entry {
        Ok(Entry::Packet { packet, .. }) => Some((packet.sequence, packet.host_ns)),
        Ok(_) => None,
        Err(error) => panic!("{error}"),
    };
    let packets: Vec<(u64, i64)> = session.messages(None).filter_map(packet).collect();
    assert!(packets.iter().all(|&(_, host_ns)| host_ns >= start_ns), "nothing lies before the session's zero");
    packets
}

#[test]
fn what_came_before_the_order_is_kept_whole_with_what_comes_after() {
    let folder = tempfile::tempdir().unwrap();
    let (puppet, handle) = Puppet::new("one", 0);
    let recorder = Recorder::new(vec![puppet.input(1 << 20)], held_options(folder.path(), 60_000, Some(200))).unwrap();
    recorder.start_sources().unwrap();
    // Far more than may wait for the disk.
    for sequence in 0..400 {
        assert!(handle.send(packet(sequence, 10_000)));
    }
    wait_until("what is held", || recorder.status().held.is_some_and(|held| held.bytes > 4_000_000));
    let asked_ns = host_ns();
    let path = recorder.keep_past(recorder.after()).unwrap();
    assert!(
        path.starts_with(folder.path()) && path.file_name().unwrap().to_string_lossy().starts_with("test-"),
        "{path:?}"
    );
    for sequence in 400..420 {
        assert!(handle.send(packet(sequence, 10_000)));
    }
    assert!(recorder.status().recording.is_some() || recorder.is_recording());
    wait_until("its end", || !recorder.is_recording());
    let summary = recorder.last().unwrap();
    assert!(
        summary.failure.is_none() && summary.drops() == 0 && summary.reason.contains("after the trigger"),
        "{summary:?}"
    );
    let found = packets(&path);
    assert!(found.iter().map(|&(sequence, _)| sequence).eq(0..420));
    assert!(found[399].1 <= asked_ns && found[400].1 >= asked_ns);
    // The next one begins with what came since, in a file of its own.
    assert!(handle.send(packet(420, 10)));
    let next = recorder.keep_past(None).unwrap();
    assert_ne!(next, path);
    assert!(matches!(recorder.keep_past(None), Err(RecordError::Busy(_))));
    recorder.stop_recording("enough").unwrap();
    assert!(packets(&next).iter().map(|&(sequence, _)| sequence).eq(420..421));
}

#[test]
fn a_rise_of_the_event_rate_keeps_what_led_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let (puppet, handle) = Puppet::new("one", 0);
    let input = puppet.input(1 << 20);
    let recorder: Arc<OnceLock<Weak<Recorder>>> = Arc::default();
    let on_alarm = Box::new({
        let recorder = Arc::clone(&recorder);
        move |_: &str, _: &str| {
            if let Some(recorder) = recorder.get().and_then(Weak::upgrade) {
                recorder.keep_past(recorder.after()).unwrap();
            }
        }
    });
    let alarm = Alarm::new([input.source.description()], vec![AlarmKind::Rate(4.0)], None, on_alarm).unwrap();
    let options = Options { subscriber: Some(Arc::new(alarm)), ..held_options(folder.path(), 600, Some(150)) };
    let running = Arc::new(Recorder::new(vec![input], options).unwrap());
    recorder.set(Arc::downgrade(&running)).unwrap();
    running.start_sources().unwrap();
    // Three seconds of a steady rate, by their times of arrival, then much more.
    let begin_ns = host_ns() - 3_200_000_000;
    let mut sequence = 0;
    let mut send = |ms: i64, bytes: usize| {
        let host_ns = begin_ns + 1_000_000 * ms;
        handle.send(erfgs_session::source::Packet { host_ns, ..packet(sequence, bytes) });
        sequence += 1;
    };
    for ms in 0..3000 {
        send(ms, 100);
    }
    thread::sleep(Duration::from_millis(100));
    assert!(!running.is_recording(), "nothing has happened");
    for ms in 3000..3100 {
        send(ms, 4000);
    }
    wait_until("the recording", || running.last().is_some());
    let found = packets(&running.last().unwrap().path);
    // The last 0.6 s before the alarm, and the rise itself.
    assert!((2300..=2600).contains(&found[0].0), "{:?}", found[0]);
    assert!(found.last().unwrap().0 >= 3010, "{:?}", found.last());
    assert!(found.windows(2).all(|pair| pair[1].0 == pair[0].0 + 1));
}
