//! The DAVIS346.

use erfgs_events::CdEvent;
use erfgs_hardware_mocks::usb::{
    Davis346, Davis346Options, Reply, TriggerLine, Urb,
    clock::SyncWire,
    davis346::{STREAM, imu_sample},
    line::PulseTrain,
    scene::{FrameScene as _, Pattern, PatternFrames},
};

use super::host::{Bench, words};

type Host = Bench<Davis346>;

const RATE: u64 = 200_000;

fn device(options: Davis346Options) -> Host {
    let scene = Box::new(Pattern::new(346, 260, RATE));
    Bench::new(Davis346::new(options, scene, Box::new(PatternFrames::new())))
}

fn read(host: &mut Host, module: u16, parameter: u16) -> u32 {
    u32::from_be_bytes(host.control_in(0xc0, 0xbf, module, parameter, 4).try_into().unwrap())
}

fn write(host: &mut Host, module: u16, parameter: u16, value: u32) {
    let urb = Urb::control_out(0x40, 0xbf, module, parameter, &value.to_be_bytes());
    assert_eq!(host.submit(&urb), Reply::Taken(4));
}

fn start(host: &mut Host) {
    for (module, parameter, value) in
        [(0, 3, 1), (9, 1, 80_000), (9, 0, 1), (0, 5, 1), (0, 4, 0), (0, 1, 1), (0, 0, 1), (1, 3, 1)]
    {
        write(host, module, parameter, value);
    }
}

#[derive(Debug, Default)]
struct Decoded {
    events: Vec<CdEvent>,
    edges: Vec<(u64, bool)>,
    /// Start and end of the exposure, and the levels in order of arrival: reset, then signal.
    frames: Vec<(u64, u64, Vec<u16>, Vec<u16>)>,
    imu: Vec<(u64, Vec<u8>)>,
    resets: usize,
}

fn decode(bytes: &[u8]) -> Decoded {
    let mut decoded = Decoded::default();
    let (mut base, mut t_us, mut row) = (0_u64, 0, 0);
    let mut frame = (0, 0, Vec::new(), Vec::new());
    let (mut signal, mut inertial) = (false, Vec::new());
    for word in words(bytes) {
        let data = word & 0xfff;
        match word >> 12 {
            8.. => {
                let new = base + u64::from(word & 0x7fff);
                assert!(new >= t_us, "time goes back from {t_us} to {new}");
                t_us = new;
            }
            0 => match data {
                1 => {
                    decoded.resets += 1;
                    (base, t_us) = (0, 0);
                }
                2 | 3 => decoded.edges.push((t_us, data == 3)),
                5 => inertial = Vec::new(),
                7 => decoded.imu.push((t_us, std::mem::take(&mut inertial))),
                8 | 9 => frame = (0, 0, Vec::new(), Vec::new()),
                10 => decoded.frames.push(std::mem::take(&mut frame)),
                11 | 12 => signal = data == 12,
                13 => {}
                14 => frame.0 = t_us,
                15 => frame.1 = t_us,
                _ => panic!("special word {data}"),
            },
            1 => row = data,
            code @ (2 | 3) => decoded.events.push(CdEvent { t_us, x: data, y: row, on: code == 3 }),
            4 if signal => frame.3.push(data),
            4 => frame.2.push(data),
            5 if data >> 8 == 0 => inertial.push(data as u8),
            5 => assert_eq!(data >> 8, 3),
            7 => {
                base += u64::from(data) << 15;
                t_us = base;
            }
            code => panic!("code {code}"),
        }
    }
    decoded
}

#[test]
fn it_describes_itself_as_a_davis346() {
    let mut host = device(Davis346Options::default());
    let descriptor = host.control_in(0x80, 6, 0x0100, 0, 18);
    assert_eq!(descriptor[8..14], [0x2a, 0x15, 0x1a, 0x84, 0x06, 0x00]);
    let serial = host.control_in(0x80, 6, 0x0300 | u16::from(descriptor[16]), 0x0409, 255);
    let text: Vec<u8> = serial[2..].chunks(2).map(|unit| unit[0]).collect();
    assert_eq!(text, b"00000336");
    let information: Vec<u32> = (0..8).map(|parameter| read(&mut host, 6, parameter)).collect();
    assert_eq!(information, [18, 5, 1, 90, 30, 80, 1000, 1]);
    assert_eq!((read(&mut host, 3, 0), read(&mut host, 2, 6), read(&mut host, 0, 80)), (2, 1, 1));
}

#[test]
fn parameters_are_written_one_by_one_or_together() {
    let mut host = device(Davis346Options::default());
    write(&mut host, 5, 8, 0x1234_5678);
    assert_eq!(read(&mut host, 5, 8), 0x1234_5678);
    let body = [[5, 9, 0, 0, 0, 9], [5, 10, 0, 0, 1, 0]].concat();
    assert_eq!(host.submit(&Urb::control_out(0x40, 0xc2, 2, 0, &body)), Reply::Taken(12));
    assert_eq!((read(&mut host, 5, 9), read(&mut host, 5, 10)), (9, 256));
    assert_eq!(host.submit(&Urb::control_out(0x40, 0xc2, 3, 0, &body)), Reply::Stall);
    // What the device is cannot be written.
    write(&mut host, 6, 0, 99);
    assert_eq!(read(&mut host, 6, 0), 18);
}

#[test]
fn every_event_arrives_once_with_its_time() {
    for merged_wraps in [false, true] {
        let mut host = device(Davis346Options { merged_wraps, ..Davis346Options::default() });
        assert!(host.listen(STREAM, 8192, 10_000).is_empty());
        start(&mut host);
        let decoded = decode(&host.listen(STREAM, 8192, 500_000));
        assert!(decoded.events.len() > 98_000, "{}", decoded.events.len());
        let pattern = Pattern::new(346, 260, RATE);
        for (k, event) in decoded.events.iter().enumerate() {
            assert_eq!(*event, pattern.event(k as u64));
        }
        write(&mut host, 1, 3, 0);
        host.drain(STREAM, 8192);
        assert!(decode(&host.listen(STREAM, 8192, 100_000)).events.is_empty());
    }
}

#[test]
fn an_idle_device_merges_its_roll_overs_if_it_is_of_that_kind() {
    let mut host = device(Davis346Options { merged_wraps: true, ..Davis346Options::default() });
    for (module, parameter) in [(0, 3), (9, 0), (0, 1), (0, 0)] {
        write(&mut host, module, parameter, 1);
    }
    host.listen(STREAM, 8192, 200_000);
    write(&mut host, 1, 3, 1);
    let all = words(&host.listen(STREAM, 8192, 50_000));
    assert_eq!(all[0], 0x7006, "200 ms are six times 32.768 ms");
}

#[test]
fn a_frame_carries_the_picture_and_the_times_of_its_exposure() {
    for (orientation, global) in [(0, 1), (1, 1), (2, 0), (7, 0)] {
        let mut host = device(Davis346Options { aps_orientation: orientation, ..Davis346Options::default() });
        start(&mut host);
        for (parameter, value) in [(7, global), (12, 5_000 * 30), (13, 40_000 * 30), (4, 1)] {
            write(&mut host, 2, parameter, value);
        }
        let frames = decode(&host.listen(STREAM, 131_072, 200_000)).frames;
        assert!((4..=5).contains(&frames.len()), "{}", frames.len());
        for pair in frames.windows(2) {
            assert_eq!(pair[1].0 - pair[0].0, 40_000);
        }
        let picture = PatternFrames::new().frame(1, [0, 0], 346, 260).1.luma();
        let (start, end, reset, signal) = &frames[1];
        assert_eq!(end - start, 5_000);
        assert_eq!((reset.len(), signal.len()), (346 * 260, 346 * 260));
        let (columns, rows) = if orientation & 4 == 0 { (346, 260) } else { (260, 346) };
        for (index, (reset, signal)) in reset.iter().zip(signal).enumerate() {
            // Levels come column by column; mirrored and exchanged as the orientation says.
            let (mut column, mut row) = (index / rows, index % rows);
            if orientation & 1 != 0 {
                row = rows - 1 - row;
            }
            if orientation & 2 != 0 {
                column = columns - 1 - column;
            }
            let (x, y) = if orientation & 4 == 0 { (column, row) } else { (row, column) };
            assert_eq!(reset - signal, u16::from(picture[y * 346 + x]) * 2, "{orientation}: pixel {x}, {y}");
        }
    }
}

#[test]
fn inertial_samples_come_each_millisecond() {
    let mut host = device(Davis346Options::default());
    start(&mut host);
    for (parameter, value) in [(5, 0), (7, 1), (10, 1), (2, 1), (3, 1), (4, 1)] {
        write(&mut host, 3, parameter, value);
    }
    let samples = decode(&host.listen(STREAM, 8192, 100_000)).imu;
    assert!((97..=101).contains(&samples.len()), "{}", samples.len());
    for (number, (t_us, bytes)) in samples.iter().enumerate() {
        assert_eq!(*t_us, samples[0].0 + 1000 * number as u64);
        let expected: Vec<u8> = imu_sample(number as u64, 1).into_iter().flat_map(i16::to_be_bytes).collect();
        assert_eq!(*bytes, expected);
    }
}

#[test]
fn edges_at_the_external_input_come_as_asked_for() {
    let train = PulseTrain { first_ns: 0, period_ns: 20_000_000, high_ns: 5_000_000 };
    let mut host = device(Davis346Options { trigger: TriggerLine::train(train), ..Davis346Options::default() });
    start(&mut host);
    assert!(decode(&host.listen(STREAM, 8192, 100_000)).edges.is_empty());
    write(&mut host, 4, 1, 1);
    write(&mut host, 4, 0, 1);
    let edges = decode(&host.listen(STREAM, 8192, 200_000)).edges;
    assert!(edges.len() >= 9 && edges.iter().all(|edge| edge.1));
    write(&mut host, 4, 2, 1);
    let edges = decode(&host.listen(STREAM, 8192, 200_000)).edges;
    assert!(edges.len() >= 18);
    for pair in edges.windows(2) {
        assert_ne!(pair[0].1, pair[1].1);
        assert_eq!(pair[1].0 - pair[0].0, if pair[0].1 { 5_000 } else { 15_000 });
    }
}

#[test]
fn a_reset_of_the_time_stamps_reaches_the_slave() {
    let wire = SyncWire::new();
    let mut master = device(Davis346Options { sync: wire.clone(), ..Davis346Options::default() });
    let mut slave = device(Davis346Options { sync: wire, master: false, ..Davis346Options::default() });
    assert_eq!((read(&mut master, 6, 2), read(&mut slave, 6, 2)), (1, 0));
    start(&mut slave);
    start(&mut master);
    master.listen(STREAM, 8192, 100_000);
    slave.listen(STREAM, 8192, 100_000);
    for host in [&mut slave, &mut master] {
        let body = [[0, 2, 0, 0, 0, 1], [0, 2, 0, 0, 0, 0]].concat();
        host.submit(&Urb::control_out(0x40, 0xc2, 2, 0, &body));
    }
    let of_master = decode(&master.listen(STREAM, 8192, 50_000));
    let of_slave = decode(&slave.listen(STREAM, 8192, 50_000));
    assert_eq!((of_master.resets, of_slave.resets), (1, 1));
    let after = |decoded: &Decoded| decoded.events[decoded.events.len() - 100..].to_vec();
    assert_eq!(after(&of_master), after(&of_slave));
}
