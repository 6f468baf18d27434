//! Event cameras whose clock begins anew while they are recorded: the epochs of their streams, against the truth.

mod import;
pub mod support;

use erfgs_events::EventEncoding;
use erfgs_session::source::Encoding;
use erfgs_sync::{Synchronisation, Tier};

use support::{MS, Part, fitted, part};

/// What the board's clock may be off, common to all that it triggers, and 2 µs.
const TRIGGERED_NS: i64 = 150_000 + 2_000;

#[test]
fn a_triggered_evk4_that_restarts_is_dated_on_both_sides() {
    let parts = [part(0, 8, -3_000 * MS, 90.0), part(10, 16, 9_300 * MS, 92.0)];
    let (found, off) = fitted(Encoding::Events(EventEncoding::Evt3), &parts, true, true);
    assert!(off < TRIGGERED_NS, "{off}");
    assert_eq!((found.tier, found.epochs.as_slice().len()), (Tier::HardwareTriggered, 2));
    for clock in found.epochs.clocks() {
        assert!(clock.residuals.p95_ns < 2_000.0 && clock.outliers == 0, "{clock:?}");
    }
    let matched = found.matched.unwrap();
    assert_eq!((matched.matched, matched.unreadable, matched.breaks), (matched.seen, 0, 0), "{matched:?}");
    assert_eq!(found.rows().len(), 2);
    assert!(found.rows()[1].name.starts_with("eye from 10."), "{:?}", found.rows());
}

#[test]
fn a_davis_whose_ticks_repeat_is_dated_on_both_sides() {
    let parts = [part(0, 7, 0, -80.0), part(7, 12, 7_000 * MS, -80.0)];
    let (found, off) = fitted(Encoding::Events(EventEncoding::Davis), &parts, false, true);
    assert!(off < TRIGGERED_NS, "{off}");
    assert_eq!((found.tier, found.epochs.as_slice().len()), (Tier::HardwareTriggered, 2));
    // Plugged out and in again, the host knows; then also without the board.
    for zero_ns in (0..12).map(|n| 8_100 * MS + n * 2_700_000) {
        let parts = [part(0, 7, 0, -80.0), part(9, 14, zero_ns, -80.0)];
        for (with_board, limit) in [(true, TRIGGERED_NS), (false, MS)] {
            let (found, off) = fitted(Encoding::Events(EventEncoding::Davis), &parts, true, with_board);
            assert!(off < limit, "{zero_ns}: {off}");
            assert_eq!(found.epochs.as_slice().len(), 2, "{zero_ns}");
        }
    }
}

#[test]
fn a_free_running_camera_that_restarts_is_within_a_millisecond() {
    let parts = [part(0, 8, -3_000 * MS, 90.0), part(10, 16, 9_300 * MS, 92.0)];
    let (found, off) = fitted(Encoding::Events(EventEncoding::Evt3), &parts, true, false);
    assert!(off < MS, "{off}");
    assert_eq!((found.tier, found.epochs.as_slice().len()), (Tier::FreeRunning, 2));
    assert!(found.faults[0].contains("restarts once"), "{:?}", found.faults);
}

#[test]
fn lost_packets_do_not_end_an_epoch() {
    for encoding in [Encoding::Events(EventEncoding::Evt3), Encoding::Events(EventEncoding::Davis)] {
        let parts = [part(0, 8, -1_000 * MS, 90.0), part(9, 16, -1_000 * MS, 90.0)];
        let (found, off) = fitted(encoding, &parts, true, true);
        assert!(off < TRIGGERED_NS, "{off}");
        assert_eq!((found.tier, found.epochs.as_slice().len()), (Tier::HardwareTriggered, 1), "{encoding:?}");
    }
    let parts = [part(0, 8, -1_000 * MS, 90.0), part(9, 16, -1_000 * MS, 90.0)];
    assert_eq!(fitted(Encoding::Events(EventEncoding::Evt3), &parts, true, false).0.epochs.as_slice().len(), 1);
}

#[test]
fn an_epoch_without_edges_is_dated_by_arrival_and_says_so() {
    let unplugged = Part { wired: false, ..part(10, 16, 9_300 * MS, 92.0) };
    let (found, off) =
        fitted(Encoding::Events(EventEncoding::Evt3), &[part(0, 8, -3_000 * MS, 90.0), unplugged], true, true);
    assert!(off < MS, "{off}");
    assert_eq!(found.tier, Tier::FreeRunning, "the worst of its epochs");
    let tiers: Vec<Tier> = found.rows().iter().map(|row| row.tier).collect();
    assert_eq!(tiers, [Tier::HardwareTriggered, Tier::FreeRunning]);
    let is_reported = found
        .faults
        .iter()
        .any(|fault| fault.starts_with("from 10.") && fault.contains("no edges: dated by the arrival"));
    assert!(is_reported, "{:?}", found.faults);
}

#[test]
fn a_clock_that_sets_many_edges_aside_is_told() {
    let (found, _) = fitted(
        Encoding::Events(EventEncoding::Evt3),
        &[Part { displaced: 12, ..part(0, 12, -3_000 * MS, 90.0) }],
        true,
        true,
    );
    let share = found.rows()[0].outliers.unwrap();
    assert!((0.06..0.10).contains(&share), "{share}");
    assert!(found.faults.iter().any(|fault| fault.contains("do not fit its clock")), "{:?}", found.faults);
    let (found, _) = fitted(Encoding::Events(EventEncoding::Evt3), &[part(0, 12, -3_000 * MS, 90.0)], true, true);
    assert_eq!((found.rows()[0].outliers, found.faults.len()), (Some(0.0), 0), "{:?}", found.faults);
}

#[test]
fn a_file_of_another_version_is_refused_with_what_helps() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("s.sync.json");
    for version in [1, 3] {
        std::fs::write(&file, format!(r#"{{"version":{version},"session":"s.mcap","streams":[]}}"#)).unwrap();
        let message = Synchronisation::load(&file).unwrap_err().to_string();
        assert!(message.contains(&format!("version is {version}")) && message.contains("`erfgs sync`"), "{message}");
    }
}
