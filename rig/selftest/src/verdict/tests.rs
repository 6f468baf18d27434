//! Verdicts on what was observed, made by hand.

use std::path::Path;

use erfgs_recorder::RigConfig;
use erfgs_session::source::{Encoding, Incident, StampClock};
use erfgs_sync::Synchronisation;
use serde_json::{Value, json};

use super::*;
use crate::{
    observe::ObservedEvents,
    rate::{Rate, RateFit},
};
use Verdict::{Fault, NotTested, Ok as Good, Warning};

/// A stream of a hundred packets a second over a second, with settings.
fn stream(id: &str, encoding: &str, settings: Value) -> Observed {
    let mut description = Description::trigger_board(id, settings.as_object().cloned().unwrap_or_default());
    description.encoding = encoding.parse::<Encoding>().unwrap();
    (description.width, description.height, description.serial) = (64, 48, "7".into());
    let mut observed = Observed::nothing(description);
    come(&mut observed, 100.0, 1000);
    observed
}

/// So many packets of so many bytes come in a second.
fn come(observed: &mut Observed, rate_hz: f64, bytes: u64) {
    let at_ns = |index: u64| (index as f64 * 1e9 / rate_hz) as i64;
    observed.arrivals_ns = (0..rate_hz as u64).map(at_ns).collect();
    let packets = observed.arrivals_ns.len() as u64;
    (observed.totals.packets, observed.totals.bytes) = (packets, packets * bytes);
    observed.totals.first_host_ns = observed.arrivals_ns.first().copied();
    observed.totals.last_host_ns = observed.arrivals_ns.last().copied();
    if observed.is_frames() {
        observed.frames_ns = observed.arrivals_ns.clone();
    }
    observed.clock = Some(RateFit::Even(Rate { ppm: 20.0, uncertainty_ppm: 100.0 }));
    if let Some(events) = &mut observed.events {
        *events =
            ObservedEvents { events: 5000, on: 2500, range_us: Some([20, 1_000_000]), ..ObservedEvents::default() };
    }
}

fn recording(streams: Vec<Observed>) -> Box<Recording> {
    let sync = Synchronisation { version: 0, session: String::new(), streams: Vec::new() };
    Box::new(Recording { seconds: 1.0, streams, sync })
}

/// The findings of a rig: of each device its recordings alone and with the others.
fn findings(rig: &str, streams: Vec<(Option<Observed>, Observed)>) -> Findings {
    let rig = RigConfig::parse(rig, Path::new("RIG.toml")).unwrap();
    let (alone, together): (Vec<_>, Vec<_>) = streams.into_iter().unzip();
    let devices = rig.devices.iter().zip(alone).zip(&together).map(|((device, alone), together)| DeviceFindings {
        device: device.clone(),
        opened: Ok(together.description.clone()),
        alone: alone
            .map_or(Alone::Skipped("it is the only device".into()), |alone| Alone::Recorded(recording(vec![alone]))),
        warnings: Vec::new(),
        readings: BTreeMap::new(),
    });
    Findings { devices: devices.collect(), together: Together::Recorded(recording(together)) }
}

fn check(findings: &Findings, device: &str, name: CheckName) -> Check {
    let checks = judge(findings);
    let found = checks.iter().find(|check| check.device == device && check.check == name);
    found.cloned().unwrap_or_else(|| panic!("no {} of {device}: {checks:#?}", name.name()))
}

/// The verdict on an EVK4 that was recorded with nothing else.
fn on_eye(name: CheckName, change: impl FnOnce(&mut Observed)) -> Check {
    let mut eye = stream("eye", "evt3", json!({ "external_trigger": true }));
    change(&mut eye);
    check(&findings("[[evk4]]\nid = \"eye\"", vec![(None, eye)]), "eye", name)
}

/// The verdict on a frame camera of 100 Hz that was recorded with nothing else.
fn on_camera(name: CheckName, change: impl FnOnce(&mut Observed)) -> Check {
    let mut camera = stream("cam", "grey8", json!({ "asked_rate_hz": 100.0, "rate_hz": 100.0 }));
    camera.stamped_by = Some(StampClock::Camera);
    change(&mut camera);
    check(&findings("[[camera]]\nid = \"cam\"", vec![(None, camera)]), "cam", name)
}

#[test]
fn data_has_to_come_to_the_end_and_without_a_pause() {
    assert_eq!(on_eye(CheckName::Data, |_| {}).verdict, Good);
    assert_eq!(on_eye(CheckName::Data, |eye| eye.totals.packets = 0).verdict, Fault);
    let ended = on_eye(CheckName::Data, |eye| eye.arrivals_ns.truncate(30));
    assert!(ended.verdict == Fault && ended.found.contains("last 0.7 of 1.0 s"), "{ended:?}");
    let paused = on_eye(CheckName::Data, |eye| drop(eye.arrivals_ns.drain(20..90)));
    assert!(paused.verdict == Warning && paused.found.contains("for 0.7 s in between"), "{paused:?}");
    let lost = Incident::Lost { reason: "unplugged".into() };
    assert_eq!(on_eye(CheckName::Data, |eye| eye.incidents.push(lost)).verdict, Fault);
    // Five frames a second leave pauses of 0.2 s.
    let slow = |camera: &mut Observed| {
        come(camera, 5.0, 10);
        camera.description.settings.insert("rate_hz".into(), json!(5.0));
    };
    assert_eq!(on_camera(CheckName::Data, slow).verdict, Good);
}

#[test]
fn damaged_words_and_another_order_of_words_are_two_things() {
    let format =
        |change: fn(&mut ObservedEvents)| on_eye(CheckName::Format, |eye| change(eye.events.as_mut().unwrap()));
    assert_eq!(format(|_| {}).verdict, Good);
    assert_eq!(format(|events| events.anomalies.undated = 40).verdict, Good);
    assert_eq!(format(|events| events.anomalies.no_row = 3000).verdict, Fault);
    let behind_a_break = on_eye(CheckName::Format, |eye| {
        eye.totals.discontinuities = 1;
        eye.events.as_mut().unwrap().anomalies.no_row = 3000;
    });
    assert_eq!(behind_a_break.verdict, Good);
    let one = format(|events| events.anomalies.unknown = 1);
    assert!(one.verdict == Fault && one.found.contains("damaged or missing"), "{one:?}");
    let order = format(|events| events.anomalies.outside = 4000);
    assert!(order.verdict == Fault && order.found.contains("order of words"), "{order:?}");
    assert_eq!(format(|events| events.on = 5000).verdict, Warning);
    assert_eq!(format(|events| (events.events, events.on) = (0, 0)).verdict, NotTested);
    assert_eq!(on_camera(CheckName::Format, |camera| camera.frame_problem = Some("short".into())).verdict, Fault);
}

#[test]
fn losses_have_their_stage_and_its_remedy() {
    assert_eq!(on_camera(CheckName::Losses, |_| {}).verdict, Good);
    let bus = on_camera(CheckName::Losses, |camera| camera.missing_frames = 3);
    assert!(bus.verdict == Fault && bus.found.starts_with("3 frames") && bus.remedy.contains("cable"), "{bus:?}");
    let disk = on_camera(CheckName::Losses, |camera| {
        camera.dropped.insert("queue".into(), 5);
        camera.totals.missing = 5;
    });
    assert!(disk.verdict == Fault && disk.found == "5 dropped, as the disk was too slow", "{disk:?}");
    assert!(disk.remedy.contains("faster disk"), "{disk:?}");
}

#[test]
fn packets_of_a_network_that_came_twice_were_late_and_not_lost() {
    let losses = |asked: f64, doubled: f64, late: f64| {
        let readings = [("asked_packets", asked), ("doubled_packets", doubled), ("late_packets", late)];
        let mut findings = findings("[[camera]]\nid = \"cam\"", vec![(None, stream("cam", "grey8", json!({})))]);
        findings.devices[0].readings = readings.map(|(name, value)| (name.to_owned(), value)).into();
        check(&findings, "cam", CheckName::Losses).verdict
    };
    assert_eq!([losses(0.0, 0.0, 0.0), losses(8.0, 5.0, 3.0), losses(0.0, 4.0, 0.0)], [Good; 3]);
    assert_eq!([losses(8.0, 0.0, 0.0), losses(8.0, 5.0, 2.0)], [Warning; 2]);
}

#[test]
fn a_clock_is_judged_by_what_is_certain() {
    let rate = |ppm: f64, uncertainty_ppm: f64| {
        let clock = Some(RateFit::Even(Rate { ppm, uncertainty_ppm }));
        on_eye(CheckName::ClockRate, |eye| eye.clock = clock).verdict
    };
    assert_eq!([rate(90.0, 50.0), rate(-900.0, 600.0), rate(4000.0, 5000.0)], [Good; 3]);
    assert_eq!([rate(600.0, 100.0), rate(-1200.0, 300.0)], [Warning; 2]);
    assert_eq!([rate(1200.0, 100.0), rate(-30_000.0, 5000.0)], [Fault; 2]);
    assert_eq!(rate(300.0, 30_000.0), NotTested);
    assert_eq!(on_eye(CheckName::ClockRate, |eye| eye.clock = Some(RateFit::TooFew)).verdict, NotTested);
    let kernel = on_camera(CheckName::ClockRate, |camera| camera.stamped_by = Some(StampClock::Monotonic));
    assert!(kernel.verdict == NotTested && kernel.found.contains("host's clock"), "{kernel:?}");
    let late = on_eye(CheckName::ClockReset, |eye| {
        eye.events.as_mut().unwrap().range_us = Some([900_000_000, 901_000_000]);
    });
    assert!(late.verdict == Warning && late.found.contains("900.000 s"), "{late:?}");
    let broken = on_eye(CheckName::ClockSteps, |eye| eye.events.as_mut().unwrap().unexplained_breaks = 1);
    assert_eq!(broken.verdict, Fault);
    let back = on_camera(CheckName::ClockSteps, |camera| camera.frames_ns[50] = 0);
    assert!(back.verdict == Fault && back.found.contains("go back"), "{back:?}");
}

#[test]
fn frames_come_as_often_as_asked_for() {
    let at = |rate_hz: f64| on_camera(CheckName::FrameRate, |camera| come(camera, rate_hz, 10)).verdict;
    assert_eq!([at(100.0), at(99.0), at(95.0), at(50.0)], [Good, Good, Warning, Fault]);
    let hole = on_camera(CheckName::FrameRate, |camera| {
        camera.frames_ns.iter_mut().skip(60).for_each(|at_ns| *at_ns += 15_000_000);
    });
    assert!(hole.verdict == Warning && hole.found.contains("1 holes"), "{hole:?}");
    // What the camera counted is a loss, and no other rate.
    let lost = on_camera(CheckName::FrameRate, |camera| {
        drop(camera.frames_ns.drain(40..50));
        camera.missing_frames = 10;
    });
    assert_eq!(lost.verdict, Good);
}

#[test]
fn a_bus_that_carries_less_than_its_devices_send_is_named_with_them() {
    let usb =
        |bus: u32| json!({ "usb": { "device": format!("04b4:00f5 at {bus}:5 (port {bus}-1)") }, "rate_hz": 100.0 });
    let rig = "[[camera]]\nid = \"a\"\ncamera = \"1\"\n[[camera]]\nid = \"b\"\ncamera = \"2\"\n[[camera]]\nid = \"c\"\ncamera = \"3\"";
    let pair = |id: &str, bus: u32, together_hz: f64| {
        let (alone, mut together) = (stream(id, "grey8", usb(bus)), stream(id, "grey8", usb(bus)));
        come(&mut together, together_hz, 1000);
        (Some(alone), together)
    };
    let findings = findings(rig, vec![pair("a", 2, 80.0), pair("b", 2, 99.0), pair("c", 3, 100.0)]);
    let a = check(&findings, "a", CheckName::Bandwidth);
    assert!(a.verdict == Warning && a.found.contains("it shares USB bus 2 with b"), "{a:?}");
    // A hundred packets of 1000 bytes from the first to the last.
    assert!(a.found.contains("101.0 kB/s alone"), "{a:?}");
    for id in ["b", "c"] {
        assert_eq!(check(&findings, id, CheckName::Bandwidth).verdict, Good, "{id}");
    }
}

#[test]
fn fewer_events_may_be_chance_but_not_half_of_many() {
    let rig = "[[evk4]]\nid = \"a\"\nserial = \"1\"\n[[evk4]]\nid = \"b\"\nserial = \"2\"";
    let bandwidth = |bytes: [u64; 2]| {
        let [alone, together] = bytes.map(|bytes| {
            let mut eye = stream("a", "evt3", json!({}));
            come(&mut eye, 100.0, bytes);
            eye
        });
        let other = || stream("b", "evt3", json!({}));
        let findings = findings(rig, vec![(Some(alone), together), (Some(other()), other())]);
        check(&findings, "a", CheckName::Bandwidth).verdict
    };
    assert_eq!([bandwidth([400_000, 250_000]), bandwidth([20_000, 1000])], [Good; 2]);
    assert_eq!(bandwidth([400_000, 150_000]), Warning);
}

#[test]
fn the_gravest_of_both_recordings_counts_and_says_which_it_was() {
    let rig = "[[evk4]]\nid = \"a\"\nserial = \"1\"\n[[evk4]]\nid = \"b\"\nserial = \"2\"";
    let eye = |id: &str| stream(id, "evt3", json!({}));
    let mut alone = eye("a");
    alone.totals.discontinuities = 2;
    let findings = findings(rig, vec![(Some(alone), eye("a")), (Some(eye("b")), eye("b"))]);
    let a = check(&findings, "a", CheckName::Losses);
    assert!(a.verdict == Fault && a.found == "recorded alone: 2 breaks in the stream", "{a:?}");
    assert_eq!(check(&findings, "b", CheckName::Losses).verdict, Good);
}

#[test]
fn a_device_is_the_one_that_is_asked_for_and_takes_its_settings() {
    let eye = |settings: Value| {
        let findings =
            findings("[[evk4]]\nid = \"eye\"\nserial = \"8\"", vec![(None, stream("eye", "evt3", settings))]);
        [CheckName::SerialNumber, CheckName::Settings].map(|name| check(&findings, "eye", name))
    };
    let [serial, settings] = eye(json!({ "not_applied": ["rate_limit: asked 5, has 6"] }));
    assert!(serial.verdict == Fault && serial.found == "7, and the rig asks for 8", "{serial:?}");
    assert!(settings.verdict == Warning && settings.found.contains("asked 5, has 6"), "{settings:?}");
    assert_eq!(eye(json!({ "not_applied": [] }))[1].verdict, Good);
}

#[test]
fn temperatures_are_plausible_hot_or_not_read() {
    let temperature = |readings: &[(&str, f64)]| {
        let mut findings = findings("[[evk4]]\nid = \"eye\"", vec![(None, stream("eye", "evt3", json!({})))]);
        findings.devices[0].readings = readings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        check(&findings, "eye", CheckName::Temperature).verdict
    };
    let celsius = |value: f64| temperature(&[("temperature_celsius", value)]);
    assert_eq!([celsius(42.0), celsius(80.0), celsius(-56.0), celsius(f64::NAN)], [Good, Warning, Warning, Warning]);
    assert_eq!((temperature(&[("temperature_c", 30.0)]), temperature(&[])), (Good, NotTested));
}

#[test]
fn a_device_that_keeps_all_from_starting_is_named_at_each_of_them() {
    let mut findings = findings(
        "[[evk4]]\nid = \"a\"\nserial = \"1\"\n[[evk4]]\nid = \"b\"\nserial = \"2\"",
        vec![(None, stream("a", "evt3", json!({}))), (None, stream("b", "evt3", json!({})))],
    );
    findings.together = Together::NotStarted { device: "b".into(), reason: "no memory".into() };
    let b = check(&findings, "b", CheckName::Data);
    assert!(b.verdict == Fault && b.found.contains("no memory"), "{b:?}");
    let a = check(&findings, "a", CheckName::Data);
    assert!(a.verdict == NotTested && a.found.contains("'b' did not start"), "{a:?}");
    findings.devices[0].opened = Err("no such camera. Check the cable".into());
    let a = check(&findings, "a", CheckName::Opened);
    assert_eq!((a.verdict, a.remedy.as_str()), (Fault, "Check the cable"));
    assert_eq!(a.found, "cannot be opened: no such camera");
    assert_eq!(judge(&findings).iter().filter(|check| check.device == "a").count(), 1);
}

#[test]
fn of_streams_of_which_nothing_came_there_is_something_to_say() {
    for encoding in ["evt3", "davis", "grey8", "mjpeg", "trigger-lines"] {
        let mut empty = stream("x", encoding, json!({ "rate_hz": 40.0, "period_ticks": 400_000, "triggered": true }));
        empty = Observed::nothing(empty.description);
        let table = if encoding == "trigger-lines" { "trigger" } else { "camera" };
        let checks = judge(&findings(&format!("[[{table}]]\nid = \"x\""), vec![(None, empty)]));
        assert!(checks.iter().all(|check| !check.found.is_empty()), "{checks:#?}");
    }
}
