//! A rig without a fault.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread,
};

use erfgs_hardware_mocks::{
    trigger::Faults as BoardFaults,
    usb::{Davis346Options, Evk4Options, Faults, TriggerLine, U3vFaults, U3vOptions, clock::ClockError},
};
use erfgs_selftest::{CheckName, Verdict};

use crate::rig::{Bench, Tested};

/// Two event cameras and a frame camera on the board's wires, a free camera whose strobe a third event camera sees.
fn sound() -> Bench {
    let mut bench = Bench::new();
    let crystal = |offset_ppm| Faults {
        clock: ClockError { offset_ppm, ..ClockError::default() },
        jitter_mean_us: 150.0,
        ..Faults::default()
    };
    let trigger = bench.events.clone();
    bench.evk4("left", 0x51234, Evk4Options { trigger, faults: crystal(40.0), ..Evk4Options::default() }, &[]);
    let strobe = TriggerLine::new();
    bench.evk4("eye", 0x51235, Evk4Options { trigger: strobe.clone(), ..Evk4Options::default() }, &[]);
    let trigger = bench.events.clone();
    bench.davis("davis", "", Davis346Options { trigger, faults: crystal(-45.0), ..Davis346Options::default() }, &[]);
    bench.triggered();
    let options = U3vOptions { strobe: Some(strobe), ..U3vOptions::default() };
    bench.u3v("free", "", "strobe_line = \"Line1\"", options, &[]);
    bench.sound_board(BoardFaults::default());
    bench
}

/// What a rig with all of it can test is tested, and right. Of clocks of which few arrivals tell, a busy host may say nothing.
fn all_right(tested: &Tested) {
    assert_eq!(tested.complaints(), [], "\n{}", tested.lines());
    let ok = |device: &str, checks: &[CheckName]| {
        for check in checks {
            assert_eq!(
                tested.verdict(device, *check),
                Some(Verdict::Ok),
                "{device} {}\n{}",
                check.name(),
                tested.lines()
            );
        }
    };
    use CheckName as C;
    for device in ["left", "davis", "eye", "mono", "free"] {
        ok(device, &[C::Opened, C::SerialNumber, C::Settings, C::DriverWarnings, C::Data, C::Format, C::Losses]);
        ok(device, &[C::ClockSteps, C::Temperature]);
    }
    for device in ["left", "davis"] {
        ok(device, &[C::ClockReset, C::Bandwidth, C::TriggerEdges]);
    }
    ok("mono", &[C::WaitsForTrigger, C::FramePerPulse]);
    ok("free", &[C::FrameRate, C::Bandwidth, C::StrobeEdges]);
    ok("board", &[C::Opened, C::Data, C::Format, C::Losses, C::BoardAnswers, C::Pulses]);
    ["left", "davis", "eye"].iter().for_each(|device| ok(device, &[C::ClockRate]));
    assert_eq!(tested.verdict("eye", C::TriggerEdges), Some(Verdict::NotTested));
    assert!(tested.found("eye", C::TriggerEdges).contains("strobe of 'free'"), "{}", tested.lines());
}

#[test]
fn a_sound_rig_has_no_fault_and_no_warning() {
    all_right(&sound().test(700));
}

#[test]
fn a_sound_rig_beside_a_busy_processor_has_no_fault_and_no_warning() {
    let done = Arc::new(AtomicBool::new(false));
    let cores = thread::available_parallelism().map_or(2, usize::from);
    let busy: Vec<_> = (0..2 * cores)
        .map(|_| {
            let done = Arc::clone(&done);
            thread::spawn(move || {
                while !done.load(Relaxed) {
                    std::hint::spin_loop()
                }
            })
        })
        .collect();
    let tested = sound().test(700);
    done.store(true, Relaxed);
    busy.into_iter().for_each(|thread| thread.join().unwrap());
    all_right(&tested);
}

#[test]
fn what_a_rig_without_a_board_cannot_test_is_said_to_be_not_tested() {
    let mut bench = Bench::new();
    bench.evk4("left", 0x51234, Evk4Options::default(), &[]);
    bench.triggered();
    bench.free(U3vFaults::default(), &[]);
    let tested = bench.test(500);
    assert_eq!(tested.complaints(), [], "\n{}", tested.lines());
    use CheckName as C;
    for (device, check) in [
        ("left", C::TriggerEdges),
        ("mono", C::FramePerPulse),
        ("mono", C::Data),
        ("mono", C::Format),
        ("", C::BoardAnswers),
        ("", C::Pulses),
    ] {
        assert_eq!(tested.verdict(device, check), Some(Verdict::NotTested), "{}\n{}", check.name(), tested.lines());
    }
    assert!(tested.found("left", C::TriggerEdges).contains("no trigger board"), "{}", tested.lines());
    assert_eq!(tested.verdict("mono", C::WaitsForTrigger), Some(Verdict::Ok));
}
