//! Simulated clocks: the board's line, its pulses at event cameras and frame cameras, jitter of USB and of the serial
//! line. Truth is known to the nanosecond.

use erfgs_base::random;
use erfgs_events::Edge;
use erfgs_session::{
    clock::{Residuals, Sample},
    source::Packet,
};

use super::{board::BoardLines, edges, flash, frames::Arrived, *};
use erfgs_session::trigger::{
    code,
    protocol::{Command, TICK_HZ, line},
};

const US: f64 = 1000.0;
/// Host time at the session's zero.
const START_NS: i64 = 77_000_000_000_000;
const PERIOD_S: f64 = 1.0 / 30.0;

fn uniform(n: u64, purpose: u64) -> f64 {
    random::range(random::key(11, &[n, purpose]), 1e-12, 1.0)
}

/// A crystal: seconds that its device counts after so many true seconds.
#[derive(Clone, Copy)]
struct Crystal {
    ppm: f64,
    /// Parts per million more for each minute.
    drift: f64,
}

impl Crystal {
    fn counted(self, seconds: f64) -> f64 {
        seconds * (1.0 + self.ppm * 1e-6) + 0.5 * self.drift * 1e-6 / 60.0 * seconds * seconds
    }

    /// True seconds after which the device has counted so many.
    fn truth(self, counted: f64) -> f64 {
        (0..5).fold(counted, |seconds, _| seconds - (self.counted(seconds) - counted))
    }
}

/// The board's packets over so many seconds, from 1 s on: pulses, and a `clock` command a second. A serial adapter adds a
/// delay of 80 µs and more, now and then some milliseconds.
fn board_packets(crystal: Crystal, seconds: f64, lost: impl Fn(u64) -> bool) -> Vec<Packet> {
    let tick = |truth: f64| (crystal.counted(truth) * f64::from(TICK_HZ)).round() as u64;
    let mut lines: Vec<(f64, Vec<u8>)> = Vec::new();
    for index in 0..((seconds - 1.0) / PERIOD_S) as u64 {
        let at = crystal.truth(1.0 + index as f64 * PERIOD_S);
        if !lost(index) {
            lines.push((at, line(&format!("p {index:x} {:x} {:x}", tick(at), 80_000))));
        }
    }
    for n in 0..seconds as u64 {
        let sent = n as f64 + 0.3;
        let host = START_NS + (sent * 1e9) as i64;
        let command = Command::Clock(host.cast_unsigned()).encode().len() as f64 * 20e-6;
        let received = sent + command + 60e-6 - 200e-6 * uniform(n, 1).ln();
        lines.push((received, line(&format!("+clock {host:x} {:x}", tick(received)))));
    }
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut busy_until = 0.0;
    let mut packets: Vec<Packet> = Vec::new();
    for (n, (at, bytes)) in lines.into_iter().enumerate() {
        let n = n as u64;
        let sent = f64::max(at + 20e-6, busy_until) + bytes.len() as f64 * 20e-6;
        busy_until = sent;
        let late = if uniform(n, 2) < 0.01 { 8e-3 * uniform(n, 3) } else { 0.0 };
        let arrival = sent + 80e-6 - 200e-6 * uniform(n, 4).ln() + late;
        let host_ns = START_NS + (arrival * 1e9) as i64;
        let host_ns = packets.last().map_or(host_ns, |before| before.host_ns.max(host_ns));
        packets.push(packet(n, host_ns, bytes));
    }
    packets
}

fn packet(sequence: u64, host_ns: i64, bytes: Vec<u8>) -> Packet {
    Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload: bytes.into() }
}

fn board(crystal: Crystal, seconds: f64) -> Board {
    let mut lines = BoardLines::default();
    for packet in board_packets(crystal, seconds, |index| index % 97 == 50) {
        lines.take(&packet, START_NS);
    }
    lines.finish().unwrap()
}

/// True times of the pulses, seconds.
fn pulse_times(board: Crystal, seconds: f64) -> Vec<f64> {
    (0..((seconds - 1.0) / PERIOD_S) as u64).map(|n| board.truth(1.0 + n as f64 * PERIOD_S)).collect()
}

/// The pulses as a camera sees them, in its whole microseconds.
fn camera_edges(times: &[f64], camera: Crystal, lost: impl Fn(u64) -> bool) -> Vec<Edge> {
    let t_us = |truth: f64| (camera.counted(truth) * 1e6).floor() as u64;
    (0..times.len() as u64)
        .filter(|&index| !lost(index))
        .flat_map(|index| {
            let width = code::width_ns(code::symbol(index)) as f64 * 1e-9;
            let at = times[index as usize];
            [
                Edge { t_us: t_us(at), channel: 0, rising: true },
                Edge { t_us: t_us(at + width), channel: 0, rising: false },
            ]
        })
        .collect()
}

/// Of boards and of cameras. The last two boards have a ceramic resonator, as an Arduino Uno has.
const CRYSTALS: [(Crystal, Crystal); 5] = [
    (Crystal { ppm: 100.0, drift: 1.0 }, Crystal { ppm: -100.0, drift: -1.0 }),
    (Crystal { ppm: -100.0, drift: 1.0 }, Crystal { ppm: 100.0, drift: 1.0 }),
    (Crystal { ppm: 20.0, drift: 0.0 }, Crystal { ppm: -7.0, drift: 0.0 }),
    (Crystal { ppm: 4900.0, drift: 10.0 }, Crystal { ppm: -20.0, drift: 0.1 }),
    (Crystal { ppm: -3100.0, drift: 0.0 }, Crystal { ppm: 40.0, drift: -0.1 }),
];

#[test]
fn with_trigger_edges_an_event_camera_is_within_2_us_of_the_boards_clock() {
    for (of_board, of_camera) in CRYSTALS {
        let seconds = 120.0;
        let board = board(of_board, seconds);
        let edges = camera_edges(&pulse_times(of_board, seconds), of_camera, |index| index % 61 == 7);
        let (clock, matched, _) = edges::fit(&edges, &board).unwrap();
        assert!(matched.matched * 100 > matched.given * 90, "{matched:?}");
        // An event at any time: what the camera's clock says, and what the board's clock says of the same moment.
        let errors = (0..10_000).map(|n| {
            let truth = 1.5 + (seconds - 3.0) * n as f64 / 10_000.0;
            let t_us = (of_camera.counted(truth) * 1e6) as i64;
            let tick = (of_board.counted(truth) * f64::from(TICK_HZ)) as i64;
            (clock.session_ns(t_us) - board.clock.session_ns(tick)).abs() as f64
        });
        let errors = Residuals::of(errors.collect());
        assert!(errors.p95_ns < 2.0 * US, "{errors:?}");
    }
}

#[test]
fn the_boards_clock_lies_within_what_it_says_of_the_hosts() {
    for (of_board, _) in CRYSTALS {
        let board = board(of_board, 120.0);
        let Bounds::Within { half_ns: bound } = board.bounds else { panic!("{:?}", board.bounds) };
        assert!(bound < 150.0 * US, "{bound}");
        for n in 0..1000 {
            let truth = 1.0 + 118.0 * f64::from(n) / 1000.0;
            let tick = (of_board.counted(truth) * f64::from(TICK_HZ)) as i64;
            let error = (board.clock.session_ns(tick) as f64 - truth * 1e9).abs();
            assert!(error < bound + 20.0 * US, "{error} of {bound}");
        }
    }
}

#[test]
fn bounds_that_disagree_state_no_uncertainty() {
    let of_board = Crystal { ppm: 20.0, drift: 0.0 };
    let bounds = |early_ns: i64| {
        let mut lines = BoardLines::default();
        for packet in board_packets(of_board, 10.0, |_| false) {
            // As if the host had stamped all lines too early.
            lines.take(&Packet { host_ns: packet.host_ns - early_ns, ..packet }, START_NS);
        }
        lines.finish().unwrap().bounds
    };
    let Bounds::Within { half_ns } = bounds(0) else { panic!("{:?}", bounds(0)) };
    let Bounds::Disagree { by_ns } = bounds(2 * half_ns as i64 + 30_000) else { panic!("they should disagree") };
    assert!((by_ns - 30_000.0).abs() < 1_000.0, "{by_ns}");
}

#[test]
fn without_edges_an_event_camera_is_within_200_us() {
    for (_, of_camera) in CRYSTALS {
        // A transfer a millisecond, and what the bus and the host add.
        let arrivals: Vec<Sample> = (0..120_000)
            .map(|n| {
                let truth = f64::from(n) * 1e-3;
                let late = if uniform(n as u64, 20) < 0.003 { 15e-3 * uniform(n as u64, 21) } else { 0.0 };
                let delay = 60e-6 - 250e-6 * uniform(n as u64, 22).ln() + late;
                Sample { ticks: (of_camera.counted(truth) * 1e6) as i64, session_ns: ((truth + delay) * 1e9) as i64 }
            })
            .collect();
        let clock = fit_arrivals(&arrivals).unwrap();
        let errors = (0..10_000).map(|n| {
            let truth = f64::from(n) * 12e-3;
            (clock.session_ns((of_camera.counted(truth) * 1e6) as i64) as f64 - truth * 1e9).abs()
        });
        let errors = Residuals::of(errors.collect());
        assert!(errors.p95_ns < 200.0 * US, "{errors:?}");
    }
}

/// Frames of a triggered camera: stamped when their transfer begins, 300 µs and more after the exposure.
fn triggered_frames(times: &[f64], exposure_s: f64, lost: impl Fn(usize) -> bool) -> Vec<Arrived> {
    let stamped = times.iter().enumerate().filter(|(index, _)| !lost(*index)).map(|(index, at)| {
        let delay = 300e-6 - 700e-6 * uniform(index as u64, 30).ln();
        ((at + exposure_s + delay) * 1e9) as i64
    });
    stamped.enumerate().map(|(n, stamp_ns)| Arrived { sequence: n as u64, stamp_ns }).collect()
}

#[test]
fn the_middles_of_triggered_exposures_are_within_50_us() {
    let of_board = Crystal { ppm: 100.0, drift: 1.0 };
    let seconds = 120.0;
    let board = board(of_board, seconds);
    let times = pulse_times(of_board, seconds);
    let bias = board.bounds;
    for exposure_s in [5e-3, 0.5e-3, 25e-3] {
        let lost = |index: usize| index < 4 || index % 53 == 20;
        let frames = triggered_frames(&times, exposure_s, lost);
        let exposures = match_pulses(&frames, &board, Some((exposure_s * 1e9) as i64));
        assert!(exposures.pulse.len() * 100 >= frames.len() * 98, "{} of {}", exposures.pulse.len(), frames.len());
        let kept: Vec<usize> = (0..times.len()).filter(|&index| !lost(index)).collect();
        let mut errors = Vec::new();
        for (at, &sequence) in exposures.sequence.iter().enumerate() {
            let index = kept[sequence as usize];
            assert_eq!(exposures.pulse[at], index as u64, "the right pulse");
            errors.push((exposures.mid_ns[at] as f64 - (times[index] + exposure_s / 2.0) * 1e9).abs());
        }
        let errors = Residuals::of(errors);
        assert!(errors.p95_ns < 50.0 * US, "{errors:?}, the board is known to {bias:?}");
        assert!(exposures.residuals.p95_ns < 5000.0 * US);
        assert!(exposures.missed_pulses > 40, "{}", exposures.missed_pulses);
    }
}

#[test]
fn frames_of_before_the_first_pulse_are_matched_with_none() {
    let of_board = Crystal { ppm: 0.0, drift: 0.0 };
    let board = board(of_board, 20.0);
    let mut frames: Vec<Arrived> =
        (0..5).map(|n| Arrived { sequence: n, stamp_ns: 100_000_000 + n as i64 * 33_333_333 }).collect();
    frames.extend(triggered_frames(&pulse_times(of_board, 20.0), 5e-3, |_| false));
    let exposures = match_pulses(&frames, &board, None);
    assert_eq!(exposures.pulse.first(), Some(&0));
    assert!(exposures.unmatched >= 5);
}

#[test]
fn a_board_that_was_reset_counts_from_its_longest_run() {
    let of_board = Crystal { ppm: 0.0, drift: 0.0 };
    let mut lines = BoardLines::default();
    let boot = line("b erfgs-trigger 1 1 f42400 4 2");
    lines.take(&packet(0, START_NS, boot.clone()), START_NS);
    lines.take(&packet(1, START_NS + 1, line("p 0 100 80")), START_NS);
    lines.take(&packet(2, START_NS + 2, boot), START_NS);
    for packet in board_packets(of_board, 10.0, |_| false) {
        lines.take(&packet, START_NS);
    }
    lines.take(&packet(9, START_NS + 11_000_000_000, b"p 0 10*0000\ngarbage\n".to_vec()), START_NS);
    let board = lines.finish().unwrap();
    assert_eq!((board.resets, board.damaged_lines), (1, 2));
    assert!(board.pulses.len() > 250);
}

#[test]
fn lines_are_read_however_they_are_cut_into_packets() {
    let of_board = Crystal { ppm: 50.0, drift: 0.0 };
    let packets = board_packets(of_board, 3.0, |_| false);
    let whole: Vec<u8> = packets.iter().flat_map(|packet| packet.payload.to_vec()).collect();
    let mut pieces = BoardLines::default();
    for (n, byte) in whole.iter().enumerate() {
        pieces.take(&packet(n as u64, START_NS + n as i64, vec![*byte]), START_NS);
    }
    let mut lines = BoardLines::default();
    for packet in &packets {
        lines.take(packet, START_NS);
    }
    let (pieces, lines) = (pieces.finish().unwrap(), lines.finish().unwrap());
    assert_eq!(pieces.pulses, lines.pulses);
    assert_eq!(pieces.damaged_lines, 0);
}

#[test]
fn a_blinking_lamp_tells_the_lag_of_a_free_running_camera() {
    // The lamp: 40 ms lit, 73 ms dark, against frames of 30 Hz.
    let lit: Vec<[i64; 2]> = (0..200).map(|n| [n * 113_000_000, n * 113_000_000 + 40_000_000]).collect();
    for (lag_ns, exposure_ns) in [(21_000_000, 5_000_000), (3_000_000, 20_000_000), (45_000_000, 10_000_000)] {
        let mut brightness = Vec::new();
        let frames: Vec<Arrived> = (0..500_i64)
            .map(|n| {
                let mid = 50_000_000 + n * 33_366_700;
                let shown = (0..1000).filter(|part| {
                    let at = mid - exposure_ns / 2 + exposure_ns * part / 1000;
                    lit.iter().any(|interval| interval[0] <= at && at < interval[1])
                });
                brightness.push(20.0 + 0.1 * shown.count() as f64 + uniform(n as u64, 40));
                let jitter = (400_000.0 * uniform(n as u64, 41)) as i64;
                Arrived { sequence: n as u64, stamp_ns: mid + lag_ns + jitter }
            })
            .collect();
        let found = find_lag(&frames, &brightness, &lit, exposure_ns).unwrap();
        assert!((found.lag_ns - lag_ns - 200_000).abs() < 500_000, "{found:?} of {lag_ns}");
        assert!(found.correlation > 0.95);
        let dark = vec![7.0; frames.len()];
        assert_eq!(find_lag(&frames, &dark, &lit, exposure_ns), None, "a camera that does not see the lamp");
    }
}

#[test]
fn a_lamp_is_found_in_the_counts_of_events() {
    let mut on = vec![30_u32; 1000];
    let mut off = vec![28_u32; 1000];
    for n in 0..9 {
        (on[50 + n * 100], on[51 + n * 100]) = (9000, 4000);
        (off[90 + n * 100], off[91 + n * 100]) = (7000, 2500);
    }
    let lit = flash::lit_intervals(&on, &off, 5_000, 1_000_000);
    assert_eq!(lit.len(), 9);
    assert_eq!(lit[2], [5_000 + 250_500_000, 5_000 + 290_500_000]);
}

#[test]
fn edges_without_their_partners_are_pulses_without_a_width() {
    let edge = |t_us, rising| Edge { t_us, channel: 0, rising };
    let seen = pulses(&[edge(5, false), edge(10, true), edge(20, true), edge(100, false), edge(130, false)], 0);
    assert_eq!(seen.len(), 2);
    assert_eq!((seen[0].rise, seen[0].width_ns), (10, None));
    assert_eq!((seen[1].rise, seen[1].width_ns), (20, Some(80_000)));
}

#[test]
fn pulses_whose_lines_were_lost_are_put_in_while_the_board_went_on() {
    let crystal = Crystal { ppm: 20.0, drift: 0.0 };
    let board = |lost: fn(u64) -> bool| {
        let mut lines = BoardLines::default();
        board_packets(crystal, 5.0, lost).iter().for_each(|packet| lines.take(packet, START_NS));
        lines.finish().unwrap()
    };
    let whole = board(|_| false);
    let restored = board(|index| (40..45).contains(&index) || index < 3);
    assert_eq!(restored.restored, 5);
    assert_eq!(restored.pulses.len(), whole.pulses.len() - 3, "before the first nothing is known");
    for index in 40..45 {
        let apart = restored.pulses[&index].tick.abs_diff(whole.pulses[&index].tick);
        assert!(apart <= 1, "pulse {index}: {apart} ticks");
    }
}
