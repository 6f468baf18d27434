//! Faults of the trigger board, and of the wires from it.

use std::thread;

use erfgs_hardware_mocks::{
    trigger::{Clock, Faults},
    usb::{Davis346Options, Evk4Options, Faults as DeviceFaults, TriggerLine},
};
use erfgs_selftest::{CheckName as C, Verdict, Verdict::Fault, Verdict::Warning};

use crate::rig::{Bench, Complaint};

/// An event camera and a frame camera at a board.
fn bench(faults: Faults, wire: fn(bool) -> Option<bool>, device: DeviceFaults) -> Bench {
    let mut bench = Bench::new();
    let trigger = bench.events.clone();
    bench.evk4("eye", 0x51234, Evk4Options { trigger, faults: device, ..Evk4Options::default() }, &[]);
    bench.triggered();
    bench.board(Clock::PERFECT, faults, wire);
    bench
}

type Case = (&'static str, fn() -> Bench, &'static [(&'static str, C, Verdict)]);

fn each(cases: &[Case]) {
    thread::scope(|scope| {
        let tested: Vec<_> = cases.iter().map(|case| (case, scope.spawn(|| (case.1)().test(900)))).collect();
        for ((what, _, expected), tested) in tested {
            let tested = tested.join().unwrap();
            let expected: Vec<Complaint> =
                expected.iter().map(|(device, check, verdict)| ((*device).to_owned(), *check, *verdict)).collect();
            assert_eq!(tested.complaints(), expected, "{what}\n{}", tested.lines());
        }
    });
}

#[test]
fn each_fault_of_the_board_and_its_wires_is_found_by_its_name() {
    each(&[
        (
            "pulses that reach no output",
            || bench(Faults { dropped_pulses: [10, 11].into(), ..Faults::default() }, Some, DeviceFaults::default()),
            &[("eye", C::TriggerEdges, Fault), ("mono", C::FramePerPulse, Fault)],
        ),
        (
            "pulses that come twice",
            || bench(Faults { doubled_pulses: [10, 15].into(), ..Faults::default() }, Some, DeviceFaults::default()),
            &[("eye", C::TriggerEdges, Fault), ("mono", C::FramePerPulse, Fault)],
        ),
        (
            "pulses that one camera misses",
            || {
                let dropped_triggers = [9, 14].into();
                bench(Faults::default(), Some, DeviceFaults { dropped_triggers, ..DeviceFaults::default() })
            },
            &[("eye", C::TriggerEdges, Fault)],
        ),
        (
            "lines that do not arrive",
            || bench(Faults { dropped_lines: [8, 9].into(), ..Faults::default() }, Some, DeviceFaults::default()),
            &[("board", C::Losses, Fault), ("board", C::Pulses, Warning)],
        ),
        (
            "a line that is damaged",
            || bench(Faults { damaged_lines: [9].into(), ..Faults::default() }, Some, DeviceFaults::default()),
            &[("board", C::Format, Warning), ("board", C::Losses, Fault), ("board", C::Pulses, Warning)],
        ),
        (
            "garbage at the start",
            || bench(Faults { garbage: b"\xff\x00p 7".to_vec(), ..Faults::default() }, Some, DeviceFaults::default()),
            &[],
        ),
        (
            "an inverting wire",
            || bench(Faults::default(), |rising| Some(!rising), DeviceFaults::default()),
            &[("eye", C::TriggerEdges, Fault)],
        ),
        (
            "a level at the limit",
            || bench(Faults::default(), |rising| rising.then_some(true), DeviceFaults::default()),
            &[("eye", C::TriggerEdges, Fault)],
        ),
        (
            "no wire",
            || {
                let mut bench = bench(Faults::default(), |_| None, DeviceFaults::default());
                bench.frames = TriggerLine::new();
                bench
            },
            &[("eye", C::TriggerEdges, Fault)],
        ),
    ]);
}

#[test]
fn a_board_that_restarts() {
    let tested = bench(Faults { restart_at: Some(12), ..Faults::default() }, Some, DeviceFaults::default()).test(900);
    assert_eq!(tested.verdict("board", C::BoardAnswers), Some(Fault), "{}", tested.lines());
    assert!(tested.found("board", C::BoardAnswers).contains("restarted"), "{}", tested.lines());
}

#[test]
fn a_board_with_a_resonator() {
    for (ppm, verdict) in [(8000.0, Warning), (30_000.0, Fault)] {
        let mut bench = Bench::new();
        bench.board(Clock { ppm, drift_ppm_per_minute: 0.0 }, Faults::default(), Some);
        let tested = bench.test(1000);
        assert_eq!(tested.verdict("board", C::ClockRate), Some(verdict), "{}", tested.lines());
    }
}

#[test]
fn an_inverted_polarity_is_named() {
    let tested = bench(Faults::default(), |rising| Some(!rising), DeviceFaults::default()).test(700);
    assert!(tested.found("eye", C::TriggerEdges).contains("polarity is inverted"), "{}", tested.lines());
}

#[test]
fn a_frame_camera_without_a_wire_is_found_and_an_input_that_is_off_is_not_tested() {
    let mut bench = Bench::new();
    let trigger = bench.events.clone();
    let options = Davis346Options { trigger, ..Davis346Options::default() };
    bench.davis("davis", "external_input = { rising = false, falling = false }", options, &[]);
    bench.triggered();
    bench.frames = TriggerLine::new();
    bench.sound_board(Faults::default());
    let tested = bench.test(600);
    let expected = [("mono".to_owned(), C::FramePerPulse, Fault)];
    assert_eq!(tested.complaints(), expected, "{}", tested.lines());
    assert_eq!(tested.verdict("davis", C::TriggerEdges), Some(Verdict::NotTested), "{}", tested.lines());
    assert_eq!(tested.found("davis", C::TriggerEdges), "its trigger input is switched off");
}
