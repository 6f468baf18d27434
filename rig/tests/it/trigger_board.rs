//! The trigger board's driver against its real firmware in simavr, and against a model with faults.
#![cfg(unix)]

use std::{collections::BTreeSet, path::Path, sync::Arc, time::Duration};

use crate::kept::{Kept, wait_for};
use erfgs_hardware_mocks::trigger::{Clock, Faults, Line, PortChange, PtyBoard, SimulatedBoard};
use erfgs_rig::trigger::{Led, Link, TriggerBoard, TriggerConfig, TriggerError, find};
use erfgs_session::source::{Incident, Source};
use erfgs_session::trigger::{
    code,
    protocol::{Command, Message, Pulse, Reader, Refusal, Reply},
};

fn messages(kept: &Kept) -> Vec<Message> {
    let mut reader = Reader::new();
    let mut messages = Vec::new();
    for packet in kept.packets().iter() {
        reader.push(&packet.payload, |message| messages.push(message));
    }
    messages
}

fn pulses(kept: &Kept) -> Vec<Pulse> {
    let pulse = |message| if let Message::Pulse(pulse) = message { Some(pulse) } else { None };
    messages(kept).into_iter().filter_map(pulse).collect()
}

fn config(port: &Path, rate_hz: f64, exposure_us: f64) -> TriggerConfig {
    TriggerConfig { port: port.display().to_string(), rate_hz, exposure_us, ..Default::default() }
}

const EVENTS: u8 = 1;
const FRAMES: u8 = 0b1_1110;

/// Rising and falling edges of the given pins, in cycles.
fn edges(changes: &[PortChange], port: char, mask: u8) -> Vec<(u64, bool)> {
    let mut edges = Vec::new();
    let mut before = 0;
    for change in changes.iter().filter(|change| change.port == port) {
        let now = change.value & mask;
        assert!(now == 0 || now == mask, "the outputs do not move together: {change:?}");
        if now != before {
            edges.push((change.cycle, now != 0));
        }
        before = now;
    }
    edges
}

/// Rises and widths of a line.
fn pulses_of(edges: &[(u64, bool)]) -> Vec<(u64, u64)> {
    edges
        .chunks(2)
        .map(|pair| {
            assert!(pair[0].1 && !pair[1].1, "a pulse is cut: {pair:?}");
            (pair[0].0, pair[1].0 - pair[0].0)
        })
        .collect()
}

/// Runs the firmware for `count` pulses and checks every edge of every line to the cycle.
fn check_firmware(rate_hz: f64, exposure_us: f64, leds: [Led; 3], count: usize) {
    let simulated = SimulatedBoard::power().unwrap();
    let config = TriggerConfig { leds, ..config(&simulated.port(), rate_hz, exposure_us) };
    let settings = config.settings().unwrap();
    let mut board = TriggerBoard::open(&config).unwrap();
    let kept = Arc::new(Kept::default());
    board.start(kept.clone()).unwrap();
    kept.wait("the pulses", |kept| pulses(kept).len() >= count);
    board.stop().unwrap();

    let pulses = pulses(&kept);
    let changes = simulated.changes().unwrap();
    let events = pulses_of(&edges(&changes, 'B', EVENTS));
    let frames = pulses_of(&edges(&changes, 'B', FRAMES));
    assert_eq!((pulses.len(), events.len()), (frames.len(), frames.len()));

    // The board's tick 0 is so many cycles after its power-on; the same for every pulse.
    let zero = frames[0].0 - pulses[0].tick;
    for (index, pulse) in pulses.iter().enumerate() {
        assert_eq!(pulse.index as usize, index);
        assert_eq!(frames[index].0, zero + pulse.tick, "pulse {index} rises at another tick than told");
        assert_eq!(events[index].0, frames[index].0, "pulse {index} rises at different cycles");
        assert_eq!(pulse.tick, pulses[0].tick + index as u64 * u64::from(settings.period), "pulse {index} is off");
        assert_eq!((pulse.width, frames[index].1), (settings.exposure, u64::from(settings.exposure)));
        let coded = code::width_ns(code::symbol(index as u64)) as u64 * 16 / 1000;
        let together = coded.abs_diff(u64::from(settings.exposure)) < 160;
        assert_eq!(events[index].1, if together { u64::from(settings.exposure) } else { coded }, "pulse {index}");
    }

    // An event camera sees microseconds, and knows every index from them.
    let seen: Vec<code::SensedPulse> = events
        .iter()
        .map(|&(rise, width)| {
            let us = |cycle: u64| (cycle / 16) as i64;
            code::SensedPulse { rise: us(rise), width_ns: Some((us(rise + width) - us(rise)) * 1000) }
        })
        .collect();
    let decoded = code::decode(&seen);
    assert_eq!(decoded.indices, (0..count as u64).chain(count as u64..seen.len() as u64).map(Some).collect::<Vec<_>>());

    let stopped = messages(&kept).contains(&Message::Done(Reply::Stop(pulses.len() as u32)));
    assert!(stopped, "the board's count differs");
    let counters = board.counters();
    assert_eq!((counters.lost, counters.errors, counters.refused, counters.reconnections), (0, 0, 0, 0));
    assert!(kept.incidents().is_empty());

    // Nothing was late, nothing was dropped.
    drop(board);
    let (mut link, _) = Link::open(&config.port).unwrap();
    let Reply::Status(status) = link.ask(Command::Status, |_| {}).unwrap() else { panic!("no status") };
    assert_eq!((status.running, status.late_edges, status.lost_lines), (false, 0, 0));
    // The host sends one command at a time, so that none is damaged on its way; unless the board is silent for a second,
    // which a simulated one is only on a machine without processor time for it.
    let lag = simulated.worst_lag().unwrap();
    assert!(
        status.bad_lines == 0 || lag > Duration::from_secs(1),
        "{} damaged commands, {lag:?} behind",
        status.bad_lines
    );
}

#[test]
fn every_edge_is_exact_at_thirty_hertz() {
    check_firmware(30.0, 5000.0, TriggerConfig::default().leds, 20);
}

#[test]
fn every_edge_is_exact_at_full_rate_with_blinking_leds() {
    check_firmware(1000.0, 500.0, [Led::Hz(5000.0), Led::Hz(1000.0), Led::Hz(700.0)], 600);
}

#[test]
fn every_edge_is_exact_with_the_shortest_exposure() {
    check_firmware(250.0, 20.0, TriggerConfig::default().leds, 60);
}

#[test]
fn every_edge_is_exact_with_the_longest_exposure() {
    check_firmware(1000.0, 950.0, [Led::Hz(5000.0); 3], 60);
}

#[test]
fn falls_close_to_one_another_are_exact_or_joined() {
    // Symbols 0 to 16 fall at 80, 120, .. µs: 10 µs and more before and after, and less.
    for exposure_us in [70.0, 70.0625, 79.0, 80.0, 85.0, 89.9375, 90.0, 110.0] {
        check_firmware(500.0, exposure_us, TriggerConfig::default().leds, 16);
    }
}

#[test]
fn leds_blink_with_half_periods_to_the_cycle_of_their_timer() {
    let simulated = SimulatedBoard::power().unwrap();
    let (mut link, _) = Link::open(&simulated.port().display().to_string()).unwrap();
    link.ask(Command::Leds([5, 7, 0xffff]), |_| {}).unwrap();
    let mut changes = Vec::new();
    wait_for(
        || "an LED blinks".into(),
        || {
            changes = simulated.changes().unwrap();
            edges(&changes, 'C', 1).len() >= 50
        },
    );
    for (mask, half_period) in [(1, 5 * 1600), (2, 7 * 1600)] {
        let edges = edges(&changes, 'C', mask);
        let mean = (edges[edges.len() - 1].0 - edges[1].0) as f64 / (edges.len() - 2) as f64;
        assert!((mean - f64::from(half_period)).abs() < 2.0, "LED {mask}: {mean}");
        // Interrupts that are served first move an edge by microseconds, never by a unit.
        let off = edges[1..].windows(2).map(|pair| (pair[1].0 - pair[0].0).abs_diff(half_period as u64)).max();
        assert!(off < Some(160), "LED {mask}: {off:?} cycles");
    }
    assert_eq!(edges(&changes, 'C', 4).len(), 1, "the third is lit");
}

#[test]
fn settings_of_a_running_board_change_between_pulses() {
    let simulated = SimulatedBoard::power().unwrap();
    let (mut link, _) = Link::open(&simulated.port().display().to_string()).unwrap();
    let mut pulses = Vec::new();
    fn keep(pulses: &mut Vec<Pulse>, message: Message) {
        if let Message::Pulse(pulse) = message {
            pulses.push(pulse);
        }
    }
    for command in [Command::Exposure(1600), Command::Period(48_000), Command::Start] {
        link.ask(command, |message| keep(&mut pulses, message)).unwrap();
    }
    let again = link.ask(Command::Start, |message| keep(&mut pulses, message));
    assert!(matches!(again, Err(TriggerError::Refused { error: Refusal::Running, .. })));
    let ten_more = |link: &mut Link, pulses: &mut Vec<Pulse>| {
        let before = pulses.len();
        wait_for(
            || "ten more pulses".into(),
            || {
                link.pump().unwrap().into_iter().for_each(|message| keep(pulses, message));
                pulses.len() >= before + 10
            },
        );
    };
    ten_more(&mut link, &mut pulses);
    link.ask(Command::Period(32_000), |message| keep(&mut pulses, message)).unwrap();
    link.ask(Command::Exposure(3200), |message| keep(&mut pulses, message)).unwrap();
    ten_more(&mut link, &mut pulses);
    let Reply::Stop(count) = link.ask(Command::Stop, |message| keep(&mut pulses, message)).unwrap() else {
        panic!("no count")
    };
    assert_eq!(pulses.len(), count as usize);
    let intervals: BTreeSet<_> = pulses.windows(2).map(|pair| pair[1].tick - pair[0].tick).collect();
    assert_eq!(intervals, BTreeSet::from([32_000, 48_000]));
    assert_eq!(pulses.iter().map(|pulse| pulse.width).collect::<BTreeSet<_>>(), BTreeSet::from([1600, 3200]));
    let frames = pulses_of(&edges(&simulated.changes().unwrap(), 'B', FRAMES));
    let widths: Vec<_> = pulses.iter().map(|pulse| u64::from(pulse.width)).collect();
    assert_eq!(frames.iter().map(|frame| frame.1).collect::<Vec<_>>(), widths);
}

#[test]
fn the_firmware_refuses_what_it_cannot_do_and_says_why() {
    let simulated = SimulatedBoard::power().unwrap();
    let (mut link, identity) = Link::open(&simulated.port().display().to_string()).unwrap();
    assert_eq!((identity.tick_hz, identity.outputs), (16_000_000, 4));
    let mut refusal = |command| match link.ask(command, |_| {}) {
        Err(TriggerError::Refused { error, .. }) => error,
        other => panic!("{command:?}: {other:?}"),
    };
    assert_eq!(refusal(Command::Period(15_999)), Refusal::Range);
    assert_eq!(refusal(Command::Period(0x1000_0001)), Refusal::Range);
    assert_eq!(refusal(Command::Period(80_000)), Refusal::Range);
    assert_eq!(refusal(Command::Exposure(319)), Refusal::Range);
    assert_eq!(refusal(Command::Exposure(533_333 - 799)), Refusal::Range);
    assert_eq!(refusal(Command::Outputs(16)), Refusal::Range);
    assert_eq!(link.ask(Command::Exposure(533_333 - 800), |_| {}).unwrap(), Reply::Exposure(533_333 - 800));
    let token = u64::MAX;
    assert!(matches!(link.ask(Command::Clock(token), |_| {}).unwrap(), Reply::Clock { token: t, .. } if t == token));
    assert_eq!(link.damaged(), 0);
}

#[test]
fn a_reset_board_is_started_again_and_the_recording_says_so() {
    let simulated = SimulatedBoard::power().unwrap();
    let mut board = TriggerBoard::open(&config(&simulated.port(), 200.0, 1000.0)).unwrap();
    let kept = Arc::new(Kept::default());
    board.start(kept.clone()).unwrap();
    kept.wait("the first pulses", |kept| pulses(kept).len() >= 20);
    simulated.reset().unwrap();
    kept.wait("the return", |kept| kept.incidents().contains(&Incident::Back));
    let before = pulses(&kept).len();
    kept.wait("pulses after it", |kept| pulses(kept).len() >= before + 20);
    board.stop().unwrap();

    assert!(
        matches!(&kept.incidents()[..], [Incident::Lost { reason }, Incident::Back] if reason.contains("restarted"))
    );
    assert_eq!((board.counters().reconnections, board.counters().lost), (1, 0));
    let pulses = pulses(&kept);
    let starts: Vec<_> = pulses.iter().filter(|pulse| pulse.index == 0).collect();
    assert_eq!(starts.len(), 2, "the second train has its own indices");
    let packets = kept.packets();
    assert!(packets.iter().enumerate().all(|(at, packet)| packet.sequence == at as u64));
    assert_eq!(packets.iter().filter(|packet| packet.discontinuity).count(), 1);
}

#[test]
fn lines_that_get_lost_are_counted_and_garbage_is_survived() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("board");
    let faults = Faults {
        dropped_lines: BTreeSet::from([5, 6, 20]),
        damaged_lines: BTreeSet::from([11]),
        garbage: b"\x00\xffp 1 2\nq\n\xfe".to_vec(),
        ..Faults::default()
    };
    let _plugged = PtyBoard::plug(&path, Clock::PERFECT, faults).unwrap();
    let mut board = TriggerBoard::open(&config(&path, 200.0, 1000.0)).unwrap();
    let kept = Arc::new(Kept::default());
    board.start(kept.clone()).unwrap();
    kept.wait("the pulses", |kept| pulses(kept).last().is_some_and(|pulse| pulse.index >= 30));
    board.stop().unwrap();
    // The damaged line's pulse is unknown as well.
    assert_eq!(board.counters().lost, 4);
    assert!(board.counters().errors >= 1);
    assert!(kept.incidents().is_empty());
    let packets = kept.packets();
    assert_eq!(board.counters().packets, packets.len() as u64);
    assert_eq!(board.counters().bytes, packets.iter().map(|packet| packet.payload.len() as u64).sum::<u64>());
}

#[test]
fn pulses_that_never_reach_the_cameras_show_in_the_edges() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("board");
    let faults =
        Faults { dropped_pulses: BTreeSet::from([13]), doubled_pulses: BTreeSet::from([29]), ..Faults::default() };
    let plugged = PtyBoard::plug(&path, Clock { ppm: 90.0, drift_ppm_per_minute: 1.0 }, faults).unwrap();
    let mut board = TriggerBoard::open(&config(&path, 200.0, 1000.0)).unwrap();
    let kept = Arc::new(Kept::default());
    board.start(kept.clone()).unwrap();
    kept.wait("the pulses", |kept| pulses(kept).len() >= 48);
    board.stop().unwrap();
    assert_eq!(board.counters().lost, 0, "every line came");

    let edges: Vec<_> =
        plugged.with(|board| board.take_edges()).into_iter().filter(|e| e.line == Line::Events).collect();
    let seen: Vec<_> = edges
        .chunks(2)
        .map(|pair| code::SensedPulse { rise: pair[0].at_ns, width_ns: Some(pair[1].at_ns - pair[0].at_ns) })
        .collect();
    let decoded = code::decode(&seen);
    assert_eq!(decoded.breaks + decoded.indices.iter().filter(|index| index.is_none()).count(), 2);
    let known: BTreeSet<_> = decoded.indices.iter().copied().flatten().collect();
    assert!(!known.contains(&13) && known.contains(&12) && known.contains(&14));
}

#[test]
fn an_unplugged_board_comes_back_at_its_port() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("board");
    let plugged = PtyBoard::plug(&path, Clock::PERFECT, Faults::default()).unwrap();
    let mut board = TriggerBoard::open(&config(&path, 200.0, 1000.0)).unwrap();
    let kept = Arc::new(Kept::default());
    board.start(kept.clone()).unwrap();
    kept.wait("the first pulses", |kept| pulses(kept).len() >= 5);
    drop(plugged);
    kept.wait("the loss", |kept| !kept.incidents().is_empty());
    let plugged = PtyBoard::plug(&path, Clock::PERFECT, Faults::default()).unwrap();
    kept.wait("the return", |kept| kept.incidents().contains(&Incident::Back));
    let before = pulses(&kept).len();
    kept.wait("pulses after it", |kept| pulses(kept).len() >= before + 5);
    board.stop().unwrap();
    assert_eq!(board.counters().reconnections, 1);
    assert!(!plugged.with(|board| board.take_edges()).is_empty());
    // It starts again from where it stopped.
    let again = Arc::new(Kept::default());
    board.start(again.clone()).unwrap();
    again.wait("pulses", |kept| pulses(kept).len() >= 5);
    assert_eq!(pulses(&again)[0].index, 0);
    board.stop().unwrap();
}

#[test]
fn boards_are_found_among_ports() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("board");
    let _plugged = PtyBoard::plug(&path, Clock::PERFECT, Faults::default()).unwrap();
    let absent = folder.path().join("absent").display().to_string();
    let ports = [absent, path.display().to_string()];
    let found = find(&ports);
    assert!(matches!(&found[0], (_, Err(TriggerError::Open { .. }))));
    assert!(matches!(&found[1], (port, Ok(board)) if *port == ports[1] && board.identity.outputs == 4));
}

#[test]
fn a_port_where_nobody_answers_is_given_up() {
    let (master, slave) = serialport::TTYPort::pair().unwrap();
    let name = serialport::SerialPort::name(&slave).unwrap();
    assert!(matches!(Link::open(&name), Err(TriggerError::Silent { .. })));
    drop((master, slave));
}
