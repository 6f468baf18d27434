//! Faults of GigE Vision cameras, on this machine's loopback.

use std::{path::Path, sync::Arc, sync::atomic::AtomicBool, thread, time::Duration};

use erfgs_hardware_mocks::{
    gige::{GigeFaults, GigeFront, GigeOptions},
    usb::{clock::ClockError, scene::PatternFrames},
};
use erfgs_recorder::RigConfig;
use erfgs_rig::usb::{Bus, LibusbBus};
use erfgs_selftest::{
    CheckName as C, Options, Report, Verdict,
    Verdict::{Fault, Warning},
    run,
};

fn rig(front: &GigeFront) -> RigConfig {
    let text = format!(
        "[[camera]]\nid = \"net\"\ncamera = \"{address}\"\nbackend = \"gige\"\nformat = \"grey8\"\nwidth = 64\nheight = 48\n\
         rate_hz = 50.0\nexposure_us = 2000\n[camera.genicam]\nheartbeat_ms = 500\npacket_bytes = 576\naddresses = [\"{address}\"]\n",
        address = front.address()
    );
    RigConfig::parse(&text, Path::new("RIG.toml")).unwrap()
}

fn test(rig: &RigConfig) -> Report {
    let never = AtomicBool::new(false);
    let options = Options { length: Duration::from_millis(1000), keep: None, stop: &never };
    run(rig, &(Arc::new(LibusbBus) as Arc<dyn Bus>), &options, &mut |_| {}).unwrap()
}

fn complaints(report: &Report) -> Vec<(C, Verdict)> {
    let checks = report.checks.iter().filter(|check| check.verdict > Verdict::Ok);
    checks.map(|check| (check.check, check.verdict)).collect()
}

type Case = (&'static str, fn() -> GigeOptions, &'static [(C, Verdict)]);

fn with(faults: GigeFaults) -> GigeOptions {
    GigeOptions { faults, ..GigeOptions::default() }
}

#[test]
fn faults_of_a_network() {
    let cases: &[Case] = &[
        ("nothing", || with(GigeFaults::default()), &[]),
        (
            "a packet that is sent again",
            || with(GigeFaults { lost: [(5, 2)].into(), ..GigeFaults::default() }),
            &[(C::Losses, Warning)],
        ),
        (
            "a packet that stays lost",
            || with(GigeFaults { lost_for_good: [(5, 2)].into(), ..GigeFaults::default() }),
            &[(C::Losses, Fault)],
        ),
        ("doubled", || with(GigeFaults { doubled: [(5, 2)].into(), ..GigeFaults::default() }), &[]),
        ("overtaken", || with(GigeFaults { overtaken: [(5, 2)].into(), ..GigeFaults::default() }), &[]),
        (
            "without a trailer",
            || with(GigeFaults { without_trailer: [5].into(), ..GigeFaults::default() }),
            &[(C::Losses, Fault)],
        ),
        (
            "blocks that do not come",
            || with(GigeFaults { lost_blocks: [5, 6].into(), ..GigeFaults::default() }),
            &[(C::Losses, Fault)],
        ),
        ("a lost command", || with(GigeFaults { lost_commands: [20].into(), ..GigeFaults::default() }), &[]),
        (
            "ticks that are too short",
            || {
                let clock = ClockError { offset_ppm: 30_000.0, ..ClockError::default() };
                GigeOptions { clock, ..GigeOptions::default() }
            },
            &[(C::ClockRate, Fault)],
        ),
    ];
    thread::scope(|scope| {
        let of_case = |options: fn() -> GigeOptions| {
            let front = GigeFront::plug(options(), Box::new(PatternFrames::default())).unwrap();
            test(&rig(&front))
        };
        let tested: Vec<_> = cases.iter().map(|case| (case, scope.spawn(move || of_case(case.1)))).collect();
        for ((what, _, expected), report) in tested {
            let report = report.join().unwrap();
            assert_eq!(complaints(&report), *expected, "{what}\n{:#?}", report.checks);
        }
    });
}

#[test]
fn a_camera_that_another_program_controls() {
    let front = GigeFront::plug(GigeOptions::default(), Box::new(PatternFrames::default())).unwrap();
    let rig = rig(&front);
    let held = erfgs_recorder::open(&rig).unwrap();
    let report = test(&rig);
    assert_eq!(complaints(&report), [(C::Opened, Fault)], "{:#?}", report.checks);
    drop(held);
}
