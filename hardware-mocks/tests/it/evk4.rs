//! The EVK4.

use std::fmt::Write as _;

use erfgs_events::CdEvent;
use erfgs_hardware_mocks::usb::{
    Evk4, Evk4Options, Faults, Reply, Speed, TriggerLine, Urb, UsbDevice,
    clock::{ClockError, SyncWire},
    evk4::{REPLIES, REQUESTS, STREAM, Stimulus},
    line::PulseTrain,
    scene::{Pattern, RecordedWords},
};

use super::host::{Bench, words};

/// The vendor's sequences (OpenEB: `imx636_evk3_issd.h`): `address=value` in hexadecimal, `~` microseconds.
pub const INIT: &str = "001C=1 ~1000000 400004=1 ~500000 400004=0 ~1000000 B000=158 ~300 B044=0 B004=0A B040=0 B0C8=0 B040=0 \
B040=0 0000=4F006442 0000=0F006442 00B8=400 00B8=400 B07C=0 B074=2 B078=A0 00C0=110 00C0=210 B120=1 E120=0 B068=4 B07C=1 \
~10 B07C=3 ~1000 00B8=401 00B8=409 0000=4F006442 0000=4F00644A B080=77 B084=0F B088=37 B08C=37 B090=DF B094=57 B098=37 \
B09C=67 B0A0=37 B0A4=2F B0AC=28 B0CC=1 B000=2F8 B004=8A B01C=30 B020=2000 B02C=FF B030=3E80 B028=FA0 A000=B0501 ~200 \
A008=2405 ~200 A004=B0501 ~200 A020=150 ~200 B040=7 B064=6 B040=F ~100 B004=8A ~200 B0C8=3 ~200 B044=1 B000=2F9 7008=1 \
7000=70001 8000=1E085 9008=644 0004=F0005042 0018=200 1014=11A1504D 9004=0 ~1000 9000=200";
pub const START: &str = "B000=2F9 9028=0 9008=645 002C=22C724 0004=F0005442";
const STOP: &str = "0004=F0005042 002C=22C324 9028=2 ~1000 9008=644 B000=2F8 ~300";

type Host = Bench<Evk4>;

fn request<D: UsbDevice>(host: &mut Bench<D>, property: u32, payload: &[u32]) -> Vec<u8> {
    let mut frame = property.to_le_bytes().to_vec();
    frame.extend((payload.len() as u32 * 4).to_le_bytes());
    frame.extend(payload.iter().flat_map(|word| word.to_le_bytes()));
    assert_eq!(host.submit(&Urb::bulk_out(REQUESTS, &frame)), Reply::Taken(frame.len()));
    match host.submit(&Urb::bulk_in(REPLIES, 1024)) {
        Reply::Data(reply) => {
            let length = u32::from_le_bytes(reply[4..8].try_into().unwrap());
            assert_eq!(reply.len(), 8 + length as usize);
            reply
        }
        other => panic!("{other:?}"),
    }
}

fn property(reply: &[u8]) -> u32 {
    u32::from_le_bytes(reply[..4].try_into().unwrap())
}

fn read(host: &mut Host, address: u32) -> u32 {
    let reply = request(host, 0x1_0102, &[0, address, 1]);
    assert_eq!(property(&reply), 0x1_0102);
    u32::from_le_bytes(reply[16..20].try_into().unwrap())
}

fn write<D: UsbDevice>(host: &mut Bench<D>, address: u32, value: u32) {
    let reply = request(host, 0x4001_0102, &[0, address, value]);
    assert_eq!(property(&reply), 0x4001_0102);
}

pub fn run<D: UsbDevice>(host: &mut Bench<D>, sequence: &str) {
    for step in sequence.split_whitespace() {
        match step.split_once('=') {
            Some((address, value)) => {
                write(host, u32::from_str_radix(address, 16).unwrap(), u32::from_str_radix(value, 16).unwrap());
            }
            None => host.wait_us(step[1..].parse().unwrap()),
        }
    }
}

fn scene(rate_hz: u64) -> Stimulus {
    Stimulus::Scene(Box::new(Pattern::new(1280, 720, rate_hz)))
}

fn device(rate_hz: u64) -> Host {
    Bench::new(Evk4::new(Evk4Options::default(), scene(rate_hz)))
}

/// What a stream says: events, edges, counts of the rate controller. Times are continued over roll-overs.
#[derive(Debug, Default, PartialEq)]
pub struct Decoded {
    pub events: Vec<CdEvent>,
    edges: Vec<(u64, bool)>,
    monitors: Vec<(u64, u16, u32)>,
}

pub fn evt3(bytes: &[u8]) -> Decoded {
    let mut decoded = Decoded::default();
    let (mut high, mut loops, mut low, mut y, mut x, mut on) = (None::<u64>, 0_u64, 0, 0, 0, false);
    let mut monitor: Option<(u16, u32, u32)> = None;
    for word in words(bytes) {
        let data = word & 0xfff;
        let t_us = high.map(|high| (loops << 24) + (high << 12) + low);
        match word >> 12 {
            0 => y = data & 0x7ff,
            2 => decoded.events.push(CdEvent { t_us: t_us.unwrap(), x: data & 0x7ff, y, on: data >> 11 == 1 }),
            3 => (x, on) = (data & 0x7ff, data >> 11 == 1),
            code @ (4 | 5) => {
                let width = if code == 4 { 12 } else { 8 };
                for bit in (0..width).filter(|bit| data >> bit & 1 == 1) {
                    decoded.events.push(CdEvent { t_us: t_us.unwrap(), x: x + bit, y, on });
                }
                x += width;
            }
            6 => low = u64::from(data),
            8 => {
                loops += u64::from(high.is_some_and(|high| high > u64::from(data)));
                (high, low) = (Some(u64::from(data)), 0);
            }
            10 => decoded.edges.push((t_us.unwrap(), data & 1 == 1)),
            14 => monitor = Some((data, 0, 0)),
            code @ (15 | 7) => {
                let (subtype, value, shift) = monitor.as_mut().unwrap();
                *value |= u32::from(data) << *shift;
                *shift += 12;
                if code == 7 {
                    decoded.monitors.push((t_us.unwrap(), *subtype, *value));
                    monitor = None;
                }
            }
            code => panic!("code {code}"),
        }
    }
    decoded
}

/// Checks that events are those of the pattern without a gap, and returns the number of the first.
fn assert_contiguous(events: &[CdEvent], rate_hz: u64) -> u64 {
    let pattern = Pattern::new(1280, 720, rate_hz);
    let first = pattern.first_at(events[0].t_us);
    let first = (first..).find(|&k| pattern.event(k) == events[0]).unwrap();
    for (offset, event) in events.iter().enumerate() {
        assert_eq!(*event, pattern.event(first + offset as u64), "event {offset}");
    }
    first
}

#[test]
fn it_describes_itself_as_an_evk4() {
    let mut host = device(0);
    let descriptor = host.control_in(0x80, 6, 0x0100, 0, 18);
    assert_eq!(descriptor[8..14], [0xb4, 0x04, 0xf5, 0x00, 0x09, 0x03]);
    let configuration = host.control_in(0x80, 6, 0x0200, 0, 255);
    assert_eq!(usize::from(configuration[2]), configuration.len());
    assert_eq!(configuration[9..18], [9, 4, 0, 0, 3, 0xff, 0x19, 0, 0]);
    // Replies, requests, stream, in this order: hosts rely on it.
    let endpoints: Vec<u8> = configuration[18..].chunks(13).map(|endpoint| endpoint[2]).collect();
    assert_eq!(endpoints, [0x82, 0x02, 0x81]);
    let name = host.control_in(0x80, 6, 0x0302, 0x0409, 255);
    assert_eq!(name, [10, 3, b'E', 0, b'V', 0, b'K', 0, b'4', 0]);
    assert_eq!(host.control_in(0xc0, 0x72, 0, 0, 2), [0x31, 0]);
    assert_eq!(host.submit(&Urb::control_in(0xc0, 0x99, 0, 0, 2)), Reply::Stall);
}

#[test]
fn requests_tell_serial_versions_and_names() {
    let mut host = device(0);
    assert_eq!(request(&mut host, 0x72, &[])[8..], 0x0005_1234_u64.to_le_bytes());
    assert_eq!(request(&mut host, 0x79, &[])[8..], 0x3_0900_u32.to_le_bytes());
    assert_eq!(request(&mut host, 0x1_0000, &[])[8..], [1, 0, 0, 0]);
    let names = request(&mut host, 0x1_0003, &[0]);
    assert_eq!(names[8..12], [0; 4]);
    assert_eq!(&names[12..], b"psee,ccam5_imx636\0psee,ccam5_gen42\0");
    assert_eq!(read(&mut host, 0x0014), 0xa040_1806);
    assert_eq!(read(&mut host, 0xf128) & 3, 0);
}

#[test]
fn a_request_that_cannot_be_served_is_answered_as_failed() {
    let mut host = device(0);
    // Not known; no such sensor; not an address of a register; a length that is not that of the frame.
    assert_eq!(property(&request(&mut host, 0x1234, &[])), 0x8000_0000);
    let reply = request(&mut host, 0x1_0102, &[1, 0, 1]);
    assert_eq!((property(&reply), reply[16]), (0x8001_0102, 19));
    let reply = request(&mut host, 0x1_0102, &[0, 3, 1]);
    assert_eq!((property(&reply), reply[16]), (0x8001_0102, 22));
    let frame = [0x72, 0, 0, 0, 9, 0, 0, 0];
    host.submit(&Urb::bulk_out(REQUESTS, &frame));
    let Reply::Data(reply) = host.submit(&Urb::bulk_in(REPLIES, 1024)) else { panic!() };
    assert_eq!(property(&reply), 0x8000_0072);
    // The device survives all of it.
    assert_eq!(read(&mut host, 0x0014), 0xa040_1806);
}

#[test]
fn several_registers_are_written_and_read_with_one_request() {
    let mut host = device(0);
    let values: Vec<u32> = (0..40).map(|index| 0x0101 * index).collect();
    let reply = request(&mut host, 0x4001_0102, &[&[0, 0x2000], &values[..]].concat());
    assert_eq!(property(&reply), 0x4001_0102);
    let reply = request(&mut host, 0x1_0102, &[0, 0x2000, 40]);
    let read: Vec<u32> = reply[16..].chunks(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
    assert_eq!(read, values);

    let mut old = Bench::new(Evk4::new(Evk4Options { burst_writes: false, ..Evk4Options::default() }, scene(0)));
    let reply = request(&mut old, 0x4001_0102, &[0, 0x2000, 1, 2]);
    assert_eq!(property(&reply), 0xc001_0102);
    assert_eq!(self::read(&mut old, 0x2000), 0);
}

#[test]
fn biases_are_those_of_the_factory_until_written_and_after_a_reset() {
    let trim = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13];
    let mut host = Bench::new(Evk4::new(Evk4Options { trim, ..Evk4Options::default() }, scene(0)));
    assert_eq!(read(&mut host, 0x1000), 0x11a1_007d);
    write(&mut host, 0x1000, 0x11a1_0033);
    assert_eq!(read(&mut host, 0x1000) & 0xff, 0x33);
    write(&mut host, 0x0040_0004, 1);
    assert_eq!(read(&mut host, 0x1000) & 0xff, 0x7d);
}

#[test]
fn temperature_and_illumination_are_there_when_their_converters_run() {
    let mut host = device(0);
    assert_eq!(read(&mut host, 0x0050), 0);
    write(&mut host, 0x004c, 0x7647);
    let status = read(&mut host, 0x0050);
    assert_eq!(status >> 11 & 1, 1);
    let celsius = 0.19 * f64::from(status & 0x3ff) - 56.0;
    assert!((celsius - 42.0).abs() < 0.2, "{celsius}");
    write(&mut host, 0x000c, 7);
    assert_eq!(read(&mut host, 0x0010) >> 29, 1);
}

#[test]
fn the_dead_time_is_there_when_its_counter_runs() {
    let mut host = device(0);
    assert_eq!(read(&mut host, 0x0020), 0);
    write(&mut host, 0x0020, 1 << 31 | 1 << 30);
    let count = read(&mut host, 0x0020);
    assert_eq!((count >> 28 & 1, (count & 0xfff_ffff) / 200), (1, 20));
    write(&mut host, 0x0020, 0);
    assert_eq!(read(&mut host, 0x0020), 0);
}

#[test]
fn nothing_streams_before_the_start_sequence_nor_after_the_stop_sequence() {
    let mut host = device(1_000_000);
    assert!(host.listen(STREAM, 16384, 20_000).is_empty());
    run(&mut host, START);
    assert!(host.listen(STREAM, 16384, 20_000).is_empty(), "a sensor that was not initialised does not stream");
    run(&mut host, STOP);
    run(&mut host, INIT);
    assert!(host.listen(STREAM, 16384, 20_000).is_empty());
    run(&mut host, START);
    assert!(!host.listen(STREAM, 16384, 20_000).is_empty());
    run(&mut host, STOP);
    host.drain(STREAM, 16384);
    assert!(host.listen(STREAM, 16384, 20_000).is_empty());
}

#[test]
fn every_event_of_the_pattern_arrives_once_whatever_the_size_of_the_transfers() {
    for (rate, length) in [(1_000, 512), (250_000, 512), (3_000_000, 16_384), (40_000_000, 131_072)] {
        let mut host = device(rate);
        run(&mut host, INIT);
        run(&mut host, START);
        let bytes = host.listen(STREAM, length, 200_000);
        let decoded = evt3(&bytes);
        // 4 ms are on their way at most.
        let expected = rate * 195 / 1000..=rate / 5 + rate / 1_000_000 + 1;
        assert!(expected.contains(&(decoded.events.len() as u64)), "{} of {expected:?}", decoded.events.len());
        assert_eq!(assert_contiguous(&decoded.events, rate), 0);
        assert_eq!(host.device.counts().get().lost, 0);
    }
}

#[test]
fn the_time_goes_on_over_the_roll_over_of_24_bits() {
    let mut host = device(1_000);
    run(&mut host, INIT);
    run(&mut host, START);
    let decoded = evt3(&host.listen(STREAM, 16_384, 40_000_000));
    assert!(decoded.events.len() >= 39_990);
    assert_contiguous(&decoded.events, 1_000);
}

#[test]
fn a_host_that_does_not_read_loses_what_does_not_fit_and_the_rest_is_sound() {
    let options = Evk4Options { queue_bytes: 100_000, ..Evk4Options::default() };
    let mut host = Bench::new(Evk4::new(options, scene(1_000_000)));
    run(&mut host, INIT);
    run(&mut host, START);
    host.wait_us(500_000);
    let mut bytes = host.drain(STREAM, 4096);
    bytes.extend(host.listen(STREAM, 4096, 50_000));
    let counts = host.device.counts().get();
    assert!(counts.lost > 100_000, "{counts:?}");
    assert_eq!(counts.seen, counts.lost + counts.sent);
    let events = evt3(&bytes).events;
    let pattern = Pattern::new(1280, 720, 1_000_000);
    for event in &events {
        assert_eq!(*event, pattern.event(event.t_us));
    }
    assert!(counts.sent - events.len() as u64 <= 5_000, "what was sent and not lost has arrived, but for a batch");
}

#[test]
fn edges_arrive_when_the_input_is_enabled_and_dropped_pulses_do_not() {
    let train = PulseTrain { first_ns: 0, period_ns: 10_000_000, high_ns: 3_000_000 };
    let faults = Faults { dropped_triggers: [455].into(), ..Faults::default() };
    let options = Evk4Options { trigger: TriggerLine::train(train), faults, ..Evk4Options::default() };
    let mut host = Bench::new(Evk4::new(options, scene(100_000)));
    run(&mut host, INIT);
    run(&mut host, START);
    assert!(evt3(&host.listen(STREAM, 16_384, 100_000)).edges.is_empty());
    write(&mut host, 0x7004, 0xc5ff);
    let started = host.now_ns;
    let edges = evt3(&[&[0, 0x80][..], &host.listen(STREAM, 16_384, 1_000_000)].concat()).edges;
    assert!((196..=200).contains(&edges.len()), "{}", edges.len());
    for pair in edges.windows(2).filter(|pair| pair[0].1 && pair[1].0 - pair[0].0 < 5_000) {
        assert_eq!(pair[1].0 - pair[0].0, 3_000);
        assert!(!pair[1].1);
    }
    let gaps = edges.windows(2).filter(|pair| pair[1].0 - pair[0].0 > 10_000).count();
    assert_eq!(gaps, usize::from((started / 10_000_000..started / 10_000_000 + 100).contains(&455)));
}

#[test]
fn a_crystal_that_is_off_shifts_the_stamps() {
    let train = PulseTrain { first_ns: 0, period_ns: 1_000_000_000, high_ns: 1_000_000 };
    let clock = ClockError { offset_ppm: 100.0, ..ClockError::default() };
    let faults = Faults { clock, ..Faults::default() };
    let options = Evk4Options { trigger: TriggerLine::train(train), faults, ..Evk4Options::default() };
    let mut host = Bench::new(Evk4::new(options, scene(0)));
    run(&mut host, INIT);
    write(&mut host, 0x7004, 0xc5ff);
    run(&mut host, START);
    let rises: Vec<u64> =
        evt3(&host.listen(STREAM, 16_384, 5_000_000)).edges.iter().filter(|edge| edge.1).map(|edge| edge.0).collect();
    assert!(rises.len() >= 4);
    for pair in rises.windows(2) {
        assert!((1_000_100..=1_000_101).contains(&(pair[1] - pair[0])), "{rises:?}");
    }
}

#[test]
fn a_slave_shares_the_time_of_its_master() {
    let wire = SyncWire::new();
    let train = PulseTrain { first_ns: 0, period_ns: 50_000_000, high_ns: 1_000_000 };
    let line = TriggerLine::train(train);
    let unit = |ppm| {
        let clock = ClockError { offset_ppm: ppm, ..ClockError::default() };
        let faults = Faults { clock, ..Faults::default() };
        let options = Evk4Options { trigger: line.clone(), sync: wire.clone(), faults, ..Evk4Options::default() };
        Bench::new(Evk4::new(options, scene(10_000)))
    };
    let (mut slave, mut master) = (unit(-80.0), unit(90.0));
    for host in [&mut slave, &mut master] {
        run(host, INIT);
        write(host, 0x7004, 0xc5ff);
    }
    master.now_ns = slave.now_ns;
    run(&mut slave, &START.replace("9008=645", "9008=64A 0044=CCFFFCCF 9008=64B"));
    slave.wait_us(300_000);
    let idle = evt3(&slave.drain(STREAM, 16_384));
    assert!(!idle.edges.is_empty() && idle.edges.iter().all(|edge| edge.0 == 0), "without a master the time is zero");
    master.now_ns = slave.now_ns;
    run(&mut master, &START.replace("9008=645", "9008=64E 0044=CCFCFCCF ~1000 9008=64F"));
    slave.now_ns = master.now_ns;
    let tail = [&[0, 0x80][..], &slave.listen(STREAM, 16_384, 2_000_000)].concat();
    let of_slave = evt3(&tail).edges;
    let of_master = evt3(&master.listen(STREAM, 16_384, 2_000_000)).edges;
    assert!(of_master.len() > 70);
    let late: Vec<_> = of_slave.into_iter().filter(|edge| edge.0 > 0).collect();
    assert_eq!(late, of_master);
}

#[test]
fn masks_and_hot_pixel_slots_take_events_away() {
    let mut host = device(1_000_000);
    run(&mut host, INIT);
    // Columns 32 to 63 off; pixel (5, 0) off: rows of the slots count from the bottom.
    write(&mut host, 0x2004, 0xffff_ffff);
    write(&mut host, 0x9100, 1 << 31 | 719 << 16 | 5);
    write(&mut host, 0x0004, 0xf000_5062);
    run(&mut host, START);
    let events = evt3(&host.listen(STREAM, 16_384, 20_000)).events;
    assert!(events.iter().any(|event| event.x == 5 && event.y == 1));
    assert!(!events.iter().any(|event| (event.x, event.y) == (5, 0) || (32..64).contains(&event.x)));
}

#[test]
fn a_window_is_made_of_its_corners_and_counts_while_it_is_switched_on() {
    for on in [true, false] {
        let mut host = device(1_000_000);
        run(&mut host, INIT);
        assert_eq!(read(&mut host, 0x003c), 719 << 16 | 1279);
        // Rows of the window count from the bottom, as those of the masks do.
        write(&mut host, 0x0038, 719 << 16 | 10);
        write(&mut host, 0x003c, 719 << 16 | 40);
        assert_eq!(read(&mut host, 0x0034), 0);
        write(&mut host, 0x0034, 1);
        assert_eq!(read(&mut host, 0x0034), 0b11, "begun, and done");
        // The last word of rows keeps bit 15 alone, row 719.
        assert_eq!([0x2000, 0x2004, 0x4058].map(|address| read(&mut host, address)), [0x3ff, !0x1ff, !0x8000]);
        write(&mut host, 0x0004, 0xf000_5062);
        write(&mut host, 0x0034, 0);
        assert_eq!(read(&mut host, 0x0034), 0);
        run(&mut host, START);
        let control = read(&mut host, 0x0004);
        write(&mut host, 0x0004, control & !2 | u32::from(on) << 1);
        let events = evt3(&host.listen(STREAM, 16_384, 20_000)).events;
        let within = events.iter().filter(|event| event.y == 0 && (10..=40).contains(&event.x)).count();
        assert!(within > 0);
        assert_eq!(within == events.len(), on);
    }
}

#[test]
fn the_rate_controller_keeps_its_target_and_reports_both_counts() {
    let mut host = device(2_000_000);
    run(&mut host, INIT);
    run(&mut host, "6000=155400 6004=1 6008=C8 600C=64 6028=3 6050=1 6000=155401");
    run(&mut host, START);
    let decoded = evt3(&host.listen(STREAM, 65_536, 200_000));
    // 100 events each 200 us: half a million a second.
    let expected = 97_000..=100_100;
    assert!(expected.contains(&decoded.events.len()), "{}", decoded.events.len());
    let sum =
        |subtype| decoded.monitors.iter().filter(|monitor| monitor.1 == subtype).map(|monitor| monitor.2).sum::<u32>();
    assert!(decoded.monitors.len() >= 36);
    assert!((350_000..=400_010).contains(&sum(0x14)), "{}", sum(0x14));
    assert!((87_000..=100_000).contains(&sum(0x16)), "{}", sum(0x16));
}

#[test]
fn evt21_carries_the_same_events() {
    let mut host = device(5_000_000);
    run(&mut host, INIT);
    run(&mut host, "7000=70003 8000=1E005");
    run(&mut host, START);
    let bytes = host.listen(STREAM, 65_536, 50_000);
    let mut events = Vec::new();
    let mut high = 0;
    for pair in bytes.chunks(8) {
        let upper = u32::from_le_bytes(pair[..4].try_into().unwrap());
        let mask = u32::from_le_bytes(pair[4..].try_into().unwrap());
        match upper >> 28 {
            8 => high = u64::from(upper & 0xfff_ffff) << 6,
            polarity @ (0 | 1) => events.extend((0..32).filter(|bit| mask >> bit & 1 == 1).map(|bit| CdEvent {
                t_us: high + u64::from(upper >> 22 & 63),
                x: (upper >> 11 & 0x7ff) as u16 + bit,
                y: (upper & 0x7ff) as u16,
                on: polarity == 1,
            })),
            code => panic!("code {code}"),
        }
    }
    assert!(events.len() > 220_000);
    assert_eq!(assert_contiguous(&events, 5_000_000), 0);
}

#[test]
fn a_recorded_file_is_sent_byte_for_byte() {
    let mut recording = Vec::new();
    for step in 0_u16..100 {
        for word in [0x8000 | step, 0x6000 | step, step, 0x2000 | step] {
            recording.extend(word.to_le_bytes());
        }
    }
    let words = Stimulus::Words(RecordedWords::new(recording.clone()));
    let mut host = Bench::new(Evk4::new(Evk4Options::default(), words));
    run(&mut host, INIT);
    run(&mut host, START);
    let first = host.listen(STREAM, 500, 200_000);
    assert!(first.len() < recording.len() && first == recording[..first.len()]);
    let rest = host.listen(STREAM, 500, 400_000);
    assert_eq!([first, rest].concat(), recording);
}

#[test]
fn a_bus_reset_powers_the_sensor_down() {
    let mut host = device(1_000_000);
    run(&mut host, INIT);
    run(&mut host, START);
    host.listen(STREAM, 16_384, 10_000);
    host.device.reset();
    assert!(host.listen(STREAM, 16_384, 10_000).is_empty());
    let mut state = String::new();
    write!(state, "{:x}", host.device.register(0xb000)).unwrap();
    assert_eq!(state, "0");
    assert_eq!(host.device.speed(), Speed::Super);
}
