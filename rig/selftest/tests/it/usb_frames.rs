//! Faults of USB3 Vision cameras, and of their cables and wires.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::SeqCst},
    },
    thread,
    time::Duration,
};

use erfgs_hardware_mocks::usb::{Evk4Options, FaultKind, Speed, U3vFaults, U3vOptions, clock::ClockError, u3v::STREAM};
use erfgs_rig::host_time::host_ns;
use erfgs_selftest::{
    CheckName as C,
    Verdict::{Fault, Ok, Warning},
};

use crate::{
    event_cameras::{Case, each},
    rig::Bench,
};

#[test]
fn each_fault_of_usb_cameras_and_their_cables_is_found_by_its_name() {
    let cases: &[Case] = &[
        (
            "a packet is lost",
            |bench| bench.free(U3vFaults { lost_packets: [(5, 0)].into(), ..U3vFaults::default() }, &[]),
            &[(C::Losses, Fault)],
        ),
        (
            "a block ends early",
            |bench| bench.free(U3vFaults { truncated: [(5, 1500)].into(), ..U3vFaults::default() }, &[]),
            &[(C::Losses, Fault)],
        ),
        (
            "a block without a leader",
            |bench| bench.free(U3vFaults { without_leader: [5].into(), ..U3vFaults::default() }, &[]),
            &[(C::Losses, Fault)],
        ),
        (
            "a block without a trailer",
            |bench| bench.free(U3vFaults { without_trailer: [5].into(), ..U3vFaults::default() }, &[]),
            &[(C::Losses, Fault)],
        ),
        (
            "blocks that do not come",
            |bench| bench.free(U3vFaults { lost_blocks: [5, 6].into(), ..U3vFaults::default() }, &[]),
            &[(C::Losses, Fault)],
        ),
        (
            "stuck",
            |bench| bench.free(U3vFaults { stuck_from: Some(8), ..U3vFaults::default() }, &[]),
            &[(C::Data, Fault)],
        ),
        (
            "late answers",
            |bench| {
                let late_answers = (0..400).step_by(9).collect();
                bench.free(U3vFaults { late_answers, ..U3vFaults::default() }, &[]);
            },
            &[],
        ),
        (
            "no answers",
            |bench| bench.free(U3vFaults { lost_answers: (30..60).collect(), ..U3vFaults::default() }, &[]),
            &[(C::Opened, Fault)],
        ),
        (
            "another one is plugged in",
            |bench| {
                bench.free(U3vFaults::default(), &[]);
                bench.rename("U3V00001", "U3V00002");
            },
            &[(C::Opened, Fault)],
        ),
        (
            "slow link",
            |bench| bench.u3v("free", "", "", U3vOptions { speed: Speed::High, ..U3vOptions::default() }, &[]),
            &[(C::DriverWarnings, Warning)],
        ),
        (
            "ticks that are too short",
            |bench| {
                let clock = ClockError { offset_ppm: 30_000.0, ..ClockError::default() };
                bench.u3v("free", "", "", U3vOptions { clock, ..U3vOptions::default() }, &[]);
            },
            &[(C::ClockRate, Fault)],
        ),
        (
            "halted",
            |bench| bench.free(U3vFaults::default(), &[(700, FaultKind::Stall { endpoint: STREAM })]),
            // Its driver opens it anew.
            &[(C::Data, Fault), (C::Losses, Fault)],
        ),
    ];
    each("free", 1600, cases);
}

#[test]
fn a_camera_that_is_pulled() {
    let mut bench = Bench::new();
    bench.free(U3vFaults::default(), &[(900, FaultKind::Unplug { for_ms: 0 })]);
    let tested = bench.test(1600);
    assert_eq!(tested.verdict("free", C::Data), Some(Fault), "{}", tested.lines());
    // A frame that is under way at that moment is lost.
    let others = tested.complaints().into_iter().filter(|(_, check, _)| ![C::Data, C::Losses].contains(check));
    assert_eq!(others.collect::<Vec<_>>(), [], "{}", tested.lines());
}

#[test]
fn a_camera_that_another_program_has() {
    let mut bench = Bench::new();
    bench.free(U3vFaults::default(), &[]);
    let held = bench.hold();
    let tested = bench.test(300);
    tested.complain("free", &[(C::Opened, Fault)]);
    assert!(tested.found("free", C::Opened).contains("another program uses it"), "{}", tested.lines());
    drop(held);
}

/// Pulses that no board gives: an input that floats.
#[test]
fn a_triggered_camera_that_does_not_wait() {
    let mut bench = Bench::new();
    bench.triggered();
    let line = bench.frames.clone();
    let done = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&done);
    let noise = thread::spawn(move || {
        while !ended.load(SeqCst) {
            let at_ns = host_ns();
            line.push(at_ns, true);
            line.push(at_ns + 1_000_000, false);
            thread::sleep(Duration::from_millis(10));
        }
    });
    let tested = bench.test(500);
    done.store(true, SeqCst);
    noise.join().unwrap();
    assert_eq!(tested.verdict("mono", C::WaitsForTrigger), Some(Fault), "{}", tested.lines());
    assert_eq!(tested.verdict("mono", C::Losses), Some(Ok), "{}", tested.lines());
}

#[test]
fn a_strobe_that_reaches_no_event_camera() {
    let mut bench = Bench::new();
    bench.evk4("eye", 1, Evk4Options::default(), &[]);
    bench.u3v("free", "", "strobe_line = \"Line1\"", U3vOptions::default(), &[]);
    let tested = bench.test(500);
    tested.complain("free", &[(C::StrobeEdges, Warning)]);
}
