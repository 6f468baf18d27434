//! Faults of event cameras and of their cables.

use std::thread;

use erfgs_hardware_mocks::usb::{
    Davis346Options, Evk4Options, FaultKind, Faults, Speed,
    clock::ClockError,
    evk4::STREAM,
};
use erfgs_selftest::{
    CheckName as C,
    Verdict::{Fault, Warning},
};

use crate::rig::{Bench, Tested};

pub type Case = (&'static str, fn(&mut Bench), &'static [(C, erfgs_selftest::Verdict)]);

/// Each case on a bench of its own, all at one time.
pub fn each(device: &str, milliseconds: u64, cases: &[Case]) {
    let of_case = |case: &Case| -> Tested {
        let mut bench = Bench::new();
        (case.1)(&mut bench);
        bench.test(milliseconds)
    };
    thread::scope(|scope| {
        let tested: Vec<_> = cases.iter().map(|case| (case, scope.spawn(|| of_case(case)))).collect();
        for ((what, _, expected), tested) in tested {
            let tested = tested.join().unwrap();
            eprintln!("{what}");
            tested.complain(device, expected);
        }
    });
}

fn evk4(bench: &mut Bench, faults: Faults, cable: &[(u64, FaultKind)]) {
    bench.evk4("eye", 0x51234, Evk4Options { faults, ..Evk4Options::default() }, cable);
}

fn clock(error: ClockError) -> Faults {
    Faults { clock: error, ..Faults::default() }
}

#[test]
fn clocks_of_event_cameras() {
    let cases: &[Case] = &[
        (
            "ticks that are too short",
            |bench| evk4(bench, clock(ClockError { offset_ppm: 30_000.0, ..ClockError::default() }), &[]),
            &[(C::ClockRate, Fault)],
        ),
        (
            "a jump ahead",
            |bench| evk4(bench, clock(ClockError { jump_at_s: 1.0, jump_us: 80_000.0, ..ClockError::default() }), &[]),
            &[(C::ClockSteps, Fault)],
        ),
        (
            "a jump back",
            |bench| evk4(bench, clock(ClockError { jump_at_s: 1.0, jump_us: -80_000.0, ..ClockError::default() }), &[]),
            &[(C::ClockSteps, Fault)],
        ),
    ];
    each("eye", 1500, cases);
}

#[test]
fn cables_of_event_cameras() {
    let cases: &[Case] = &[
        (
            "silent for a while",
            |bench| evk4(bench, Faults::default(), &[(900, FaultKind::Nak { endpoint: STREAM, for_ms: 900 })]),
            &[(C::Data, Warning)],
        ),
        (
            "halted",
            |bench| evk4(bench, Faults::default(), &[(900, FaultKind::Stall { endpoint: STREAM })]),
            &[(C::DriverWarnings, Warning), (C::Losses, Fault)],
        ),
        (
            "cut in the middle of a word",
            |bench| {
                let cut = FaultKind::ShortRead { endpoint: STREAM, bytes: 101, lost: true };
                evk4(bench, Faults::default(), &[(900, cut)]);
            },
            // All words behind it are read from their middle.
            &[(C::Format, Fault), (C::ClockSteps, Fault)],
        ),
        (
            "a word of no type",
            |bench| {
                let bits = 0x8000;
                evk4(bench, Faults::default(), &[(900, FaultKind::CorruptWord { endpoint: STREAM, word: 3, bits })]);
            },
            &[(C::Format, Fault)],
        ),
        (
            "a transfer lost",
            |bench| evk4(bench, Faults::default(), &[(900, FaultKind::LostTransfer { endpoint: STREAM })]),
            &[(C::Losses, Fault)],
        ),
        (
            "pulled",
            |bench| evk4(bench, Faults::default(), &[(900, FaultKind::Unplug { for_ms: 0 })]),
            &[(C::Data, Fault)],
        ),
        (
            "pulled and plugged in",
            |bench| evk4(bench, Faults::default(), &[(900, FaultKind::Unplug { for_ms: 50 })]),
            &[(C::Data, Fault), (C::Losses, Fault)],
        ),
    ];
    each("eye", 2000, cases);
}

#[test]
fn what_is_wrong_with_an_event_camera_itself() {
    let cases: &[Case] = &[
        (
            "hot",
            |bench| bench.evk4("eye", 1, Evk4Options { temperature_c: 90.0, ..Evk4Options::default() }, &[]),
            &[(C::Temperature, Warning)],
        ),
        (
            "old firmware",
            |bench| bench.evk4("eye", 1, Evk4Options { release: 0x3_0500, ..Evk4Options::default() }, &[]),
            &[(C::Opened, Fault)],
        ),
        (
            "slow link",
            |bench| bench.evk4("eye", 1, Evk4Options { speed: Speed::High, ..Evk4Options::default() }, &[]),
            &[(C::DriverWarnings, Warning)],
        ),
        (
            "one register at a time",
            |bench| bench.evk4("eye", 1, Evk4Options { burst_writes: false, ..Evk4Options::default() }, &[]),
            &[],
        ),
        (
            "another one is plugged in",
            |bench| {
                bench.evk4("eye", 1, Evk4Options::default(), &[]);
                bench.rename("00000001", "00000002");
            },
            &[(C::Opened, Fault)],
        ),
        (
            "a DAVIS with old firmware",
            |bench| bench.davis("eye", "", Davis346Options { firmware: 5, ..Davis346Options::default() }, &[]),
            &[(C::Opened, Fault)],
        ),
        (
            "a DAVIS that drops events",
            |bench| bench.davis("eye", "", Davis346Options { queue_bytes: 500, ..Davis346Options::default() }, &[]),
            &[(C::Losses, Fault)],
        ),
    ];
    each("eye", 600, cases);
}
