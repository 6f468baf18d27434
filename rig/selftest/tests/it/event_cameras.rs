//! Faults of event cameras and of their cables.

use std::thread;

use erfgs_hardware_mocks::usb::{
    Davis346Options, Evk4Options, FaultKind, Faults, Speed, clock::ClockError, evk4::STREAM,
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
        let of_case = &of_case;
        let tested: Vec<_> = cases.iter().map(|case| (case, scope.spawn(move || of_case(case)))).collect();
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

/// A cable on which something happens while the camera records.
fn cable(bench: &mut Bench, kind: FaultKind) {
    evk4(bench, Faults::default(), &[(900, kind)]);
}

const CLOCKS: &[Case] = &[
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

const CABLES: &[Case] = &[
    (
        "silent for a while",
        |bench| cable(bench, FaultKind::Nak { endpoint: STREAM, for_ms: 800 }),
        &[(C::Data, Warning)],
    ),
    (
        "halted",
        |bench| cable(bench, FaultKind::Stall { endpoint: STREAM }),
        &[(C::DriverWarnings, Warning), (C::Losses, Fault)],
    ),
    (
        "cut in the middle of a word",
        |bench| cable(bench, FaultKind::ShortRead { endpoint: STREAM, bytes: 101, lost: true }),
        // All words behind it are read from their middle.
        &[(C::Format, Fault), (C::ClockSteps, Fault)],
    ),
    (
        "cut behind a word",
        |bench| cable(bench, FaultKind::ShortRead { endpoint: STREAM, bytes: 100, lost: true }),
        &[(C::Losses, Warning)],
    ),
    ("in two pieces", |bench| cable(bench, FaultKind::ShortRead { endpoint: STREAM, bytes: 101, lost: false }), &[]),
    (
        "a word of no type",
        // An address becomes 1001 or 1011, a time 1101.
        |bench| cable(bench, FaultKind::CorruptWord { endpoint: STREAM, word: 3, bits: 0xB000 }),
        &[(C::Format, Fault)],
    ),
    ("a transfer is lost", |bench| cable(bench, FaultKind::LostTransfer { endpoint: STREAM }), &[(C::Losses, Warning)]),
    ("pulled", |bench| cable(bench, FaultKind::Unplug { for_ms: 0 }), &[(C::Data, Fault)]),
    (
        "pulled and plugged in",
        |bench| cable(bench, FaultKind::Unplug { for_ms: 50 }),
        &[(C::Data, Fault), (C::Losses, Fault)],
    ),
];

const THEMSELVES: &[Case] = &[
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
        // For half of what it sees from one packet to the next, so that it loses some of it however fast it is read.
        "an EVK4 with little memory",
        |bench| bench.evk4("eye", 1, Evk4Options { queue_bytes: 250, ..Evk4Options::default() }, &[]),
        &[(C::Losses, Warning)],
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
    (
        "a DAVIS of which a transfer is lost",
        |bench| {
            let lost = FaultKind::LostTransfer { endpoint: 0x82 };
            bench.davis("eye", "", Davis346Options::default(), &[(900, lost)]);
        },
        &[(C::Losses, Warning)],
    ),
];

#[test]
fn each_fault_of_event_cameras_and_their_cables_is_found_by_its_name() {
    each("eye", 1800, &[CLOCKS, CABLES, THEMSELVES].concat());
}
