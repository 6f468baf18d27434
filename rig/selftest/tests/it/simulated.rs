//! A take of a rig on a simulated clock: frame cameras whose frames the kernel stamps, at the board's wires with event cameras. What
//! goes wrong is known, and how busy this machine is changes nothing.

use std::{collections::BTreeMap, path::Path};

use erfgs_emulated_rig::{Act, Fault, Plan, record};
use erfgs_recorder::RigConfig;
use erfgs_selftest::{
    Alone, Check, CheckName as C, DeviceFindings, Findings, Together, Verdict,
    Verdict::{Fault as Bad, Warning},
    judge, observe,
};
use erfgs_session::Session;

use crate::rig::{check_of, complaints};

/// Two triggered cameras and a free one, an EVK4 and a DAVIS346, for two seconds.
fn plan(faults: Vec<Fault>) -> Plan {
    let mut plan = Plan::small().unwrap();
    plan.cameras.retain(|camera| ["rgb0", "rgb1", "free0", "event0", "davis"].contains(&camera.id.as_str()));
    Plan { wand_s: 2.0, rate_hz: 30.0, exposure_us: 8000.0, faults, ..plan }
}

/// The checks of a take.
fn checks(faults: Vec<Fault>) -> Vec<Check> {
    let plan = plan(faults);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("take.mcap");
    record(&plan, Act::Wand, &path, &|_, _| {}).unwrap();
    let rig = RigConfig::parse(&plan.rig_toml(Act::Wand), Path::new("RIG.toml")).unwrap();
    let mut session = Session::open(&path).unwrap();
    let recording = observe(&mut session, None).unwrap();
    let entry = |device: &erfgs_recorder::DeviceConfig| DeviceFindings {
        device: device.clone(),
        opened: Ok(recording.stream(&device.id).unwrap().description.clone()),
        alone: Alone::Skipped("it is a take of all".into()),
        warnings: Vec::new(),
        readings: BTreeMap::new(),
    };
    let devices = rig.devices.iter().map(entry).collect();
    judge(&Findings { devices, together: Together::Recorded(Box::new(recording)) })
}

#[test]
fn a_sound_take_has_no_fault_and_its_pulses_are_known_everywhere() {
    let checks = checks(Vec::new());
    assert_eq!(complaints(&checks), [], "{checks:#?}");
    for (device, name) in [
        ("event0", C::TriggerEdges),
        ("davis", C::TriggerEdges),
        ("rgb0", C::FramePerPulse),
        ("rgb1", C::FramePerPulse),
        ("free0", C::FrameRate),
        ("board", C::Pulses),
        ("board", C::BoardAnswers),
        ("event0", C::ClockRate),
    ] {
        assert_eq!(
            check_of(&checks, device, name).map(|check| check.verdict),
            Some(Verdict::Ok),
            "{device} {}\n{checks:#?}",
            name.name()
        );
    }
}

#[test]
fn pulses_and_clocks_that_go_wrong_are_found_by_the_camera() {
    let checks = checks(vec![
        Fault::LostPulses { camera: "rgb0".into(), pulses: 20..23 },
        Fault::LostPulses { camera: "davis".into(), pulses: 31..32 },
        Fault::LostLines { pulses: 40..42 },
        // A jump that no decoder and no arrival tells, but the edges do.
        Fault::ClockJump { camera: "event0".into(), at_s: 1.5, by_us: 1500.0 },
    ]);
    let expected = [
        ("event0", C::ClockSteps, Bad),
        ("davis", C::TriggerEdges, Bad),
        ("rgb0", C::FramePerPulse, Bad),
        ("board", C::Pulses, Warning),
    ];
    let expected = expected.map(|(device, check, verdict)| (device.to_owned(), check, verdict));
    assert_eq!(complaints(&checks), expected, "{checks:#?}");
    let found = |device, name| check_of(&checks, device, name).map_or("", |check| check.found.as_str());
    assert!(found("rgb0", C::FramePerPulse).starts_with("3 of"), "{checks:#?}");
    assert!(found("davis", C::TriggerEdges).starts_with("1 of"), "{checks:#?}");
    assert!(found("board", C::Pulses).contains("lines of 2 of"), "{checks:#?}");
}
