//! AEDAT 4, AEDAT 2 and DAVIS words.

use std::io::Write;

use erfgs_events::{
    Aedat2Chip, Aedat2Decoder, Aedat4Compression, Aedat4Decoder, Aedat4Encoder, Anomalies, ApsFrame, CdEvent, Columns,
    DavisDecoder, DavisEncoder, DavisLayout, Decoder, Edge, ImuSample, Mark, SensorSize, Sink,
};

use super::{decode, words};

const SIZE: SensorSize = SensorSize { width: 6, height: 4 };

fn event(t_us: u64, x: u16, y: u16, on: bool) -> CdEvent {
    CdEvent { t_us, x, y, on }
}

fn frame(exposure_start_us: u64, exposure_end_us: u64, bits: u8) -> ApsFrame {
    let pixels = (0..24).map(|pixel| pixel * if bits > 8 { 44 } else { 10 }).collect();
    ApsFrame { exposure_start_us, exposure_end_us, width: 6, height: 4, channels: 1, pixels, bits }
}

fn sample(t_us: u64) -> ImuSample {
    ImuSample {
        t_us,
        temperature: 36.0,
        accelerometer: [0.5, -1.0, 7.75],
        gyroscope: [31.25, -62.5, 500.0],
        magnetometer: [0.0; 3],
    }
}

fn aedat4(compression: Aedat4Compression, events: u64) -> (Vec<u8>, Columns) {
    let start = 1_600_000_000_000_000;
    let mut sinks = (Aedat4Encoder::new(SIZE, "DAVIS346_<1>&", compression), Columns::default());
    for number in 0..events {
        let event = event(start + number / 3, (number % 6) as u16, (number % 4) as u16, number % 5 < 2);
        sinks.0.event(event);
        sinks.1.event(event);
    }
    for sink in [&mut sinks.0 as &mut dyn FnMutSink, &mut sinks.1] {
        sink.rest(start);
    }
    (sinks.0.finish(), sinks.1)
}

/// Feeds everything but events.
trait FnMutSink {
    fn rest(&mut self, start: u64);
}

impl<S: Sink> FnMutSink for S {
    fn rest(&mut self, start: u64) {
        self.frame(frame(start, start + 7, 8));
        self.frame(frame(start + 20, start + 27, 16));
        for number in 0..3 {
            self.imu(ImuSample { magnetometer: [1.0, 2.0, -3.0], ..sample(start + number) });
        }
        for (number, mark) in (0..).zip(Mark::ALL) {
            self.mark(start + number, mark);
        }
    }
}

#[test]
fn aedat4_comes_back_with_every_compression() {
    for compression in [Aedat4Compression::None, Aedat4Compression::Lz4, Aedat4Compression::Zstd] {
        let (bytes, expected) = aedat4(compression, 9000);
        let (columns, anomalies) = decode(Aedat4Decoder::new(), &bytes, &[]);
        assert!(anomalies.is_empty(), "{compression:?}: {anomalies:?}");
        assert_eq!(columns, expected, "{compression:?}");
    }
}

#[test]
fn aedat4_may_be_cut_into_pieces_anywhere() {
    let (bytes, expected) = aedat4(Aedat4Compression::Lz4, 100);
    for cut in 0..=bytes.len() {
        assert_eq!(decode(Aedat4Decoder::new(), &bytes, &[cut]).0, expected, "cut at byte {cut}");
    }
    let every_byte: Vec<usize> = (0..bytes.len()).collect();
    assert_eq!(decode(Aedat4Decoder::new(), &bytes, &every_byte).0, expected);
}

#[test]
fn an_aedat4_file_that_ends_anywhere_gives_its_whole_packets() {
    let (bytes, expected) = aedat4(Aedat4Compression::Zstd, 100);
    let mut last = 0;
    for length in 0..bytes.len() {
        let (columns, anomalies) = decode(Aedat4Decoder::new(), &bytes[..length], &[]);
        assert!(columns.len() >= last && expected.t_us.starts_with(&columns.t_us));
        assert_eq!(anomalies.damaged, 0, "{length}");
        last = columns.len();
    }
    assert_eq!(last, expected.len());
}

#[test]
fn damage_in_an_aedat4_packet_is_counted_and_does_not_spread() {
    let (bytes, expected) = aedat4(Aedat4Compression::Lz4, 9000);
    let header = aedat4_header_length(&bytes);
    // The first packet holds 4096 events; its LZ4 frame's magic number is broken.
    let mut damaged = bytes.clone();
    damaged[header + 8] ^= 0xFF;
    let (columns, anomalies) = decode(Aedat4Decoder::new(), &damaged, &[]);
    assert_eq!(anomalies, Anomalies { damaged: 1, ..Anomalies::default() });
    assert_eq!(columns.t_us, expected.t_us[4096..]);
    assert_eq!(columns.frames, expected.frames);
}

fn aedat4_header_length(bytes: &[u8]) -> usize {
    let mut decoder = Aedat4Decoder::new();
    decoder.decode(bytes, &mut Columns::default());
    decoder.header().unwrap().length
}

#[test]
fn an_aedat4_packet_that_claims_more_than_64_mib_ends_the_stream_and_reserves_nothing() {
    let (bytes, _) = aedat4(Aedat4Compression::None, 9000);
    let at = aedat4_header_length(&bytes) + 4;
    let mut claimed = bytes.clone();
    claimed[at..at + 4].copy_from_slice(&((1u32 << 26) + 1).to_le_bytes());
    for cuts in [&[][..], &[at + 4]] {
        let (columns, anomalies) = decode(Aedat4Decoder::new(), &claimed, cuts);
        assert_eq!(anomalies, Anomalies { damaged: 1, ..Anomalies::default() });
        assert!(columns.is_empty());
    }
    // A length that is allowed, and of which nothing comes, is waited for.
    claimed[at..at + 4].copy_from_slice(&(1u32 << 26).to_le_bytes());
    assert_eq!(decode(Aedat4Decoder::new(), &claimed, &[]).1.damaged, 0);
}

#[test]
fn an_aedat4_packet_that_unpacks_to_more_than_64_mib_is_damaged_and_those_behind_it_are_read() {
    let (bytes, expected) = aedat4(Aedat4Compression::Lz4, 9000);
    let header = aedat4_header_length(&bytes);
    let first = 8 + u32::from_le_bytes(bytes[header + 4..header + 8].try_into().unwrap()) as usize;
    let mut blown = vec![0; (1 << 26) + 100];
    blown[..4].copy_from_slice(&((1u32 << 26) + 96).to_le_bytes());
    let mut packer = lz4_flex::frame::FrameEncoder::new(Vec::new());
    packer.write_all(&blown).unwrap();
    let body = packer.finish().unwrap();
    assert!(body.len() < 1 << 20, "{} bytes stand for all of it", body.len());
    let id = &bytes[header..header + 4];
    let packet = [id, &(body.len() as u32).to_le_bytes(), &body, &bytes[header + first..]].concat();
    let damaged = [&bytes[..header], &packet].concat();
    let (columns, anomalies) = decode(Aedat4Decoder::new(), &damaged, &[]);
    assert_eq!(anomalies.damaged, 1);
    assert_eq!(columns.t_us, expected.t_us[4096..]);
}

#[test]
fn davis_words_mean_what_libcaer_says() {
    let bytes: Vec<u8> = words::DAVIS.iter().flat_map(|word| word.to_le_bytes()).collect();
    let layout = DavisLayout { size: SIZE, ..DavisLayout::default() };
    let (columns, anomalies) = decode(DavisDecoder::new(layout), &bytes, &[]);
    let expected = [event(5, 4, 3, false), event(5, 5, 3, true), event(65_537, 0, 3, true)];
    assert_eq!(columns.iter().collect::<Vec<_>>(), expected);
    let edge = |t_us, rising| Edge { t_us, channel: 0, rising };
    assert_eq!(columns.edges, [edge(65_537, true), edge(65_537, false), edge(7, true)]);
    assert_eq!(columns.discontinuities, [(3, 0)]);
    assert_eq!(anomalies, Anomalies { outside: 1, no_row: 1, discontinuities: 1, ..Anomalies::default() });
}

#[test]
fn davis_streams_come_back() {
    let layout = DavisLayout { size: SIZE, ..DavisLayout::default() };
    let mut encoder = DavisEncoder::new(layout);
    let (mut bytes, mut events) = (Vec::new(), Vec::new());
    for number in 0..500_u64 {
        let event = event(number * number * 40, (number % 6) as u16, (number / 7 % 4) as u16, number % 3 == 0);
        encoder.event(event, &mut bytes).unwrap();
        events.push(event);
    }
    let t = 20_000_000;
    encoder.frame(&frame(t, t + 40_000, 10), &mut bytes).unwrap();
    // A unit that is switched on in steps gives samples of which some parts are off.
    let partial = ImuSample { temperature: f32::NAN, gyroscope: [f32::NAN; 3], ..sample(t + 40_001) };
    encoder.imu(sample(t + 40_001), &mut bytes).unwrap();
    encoder.imu(partial, &mut bytes).unwrap();
    encoder.mark(t + 40_002, Mark::ExternalRising, &mut bytes).unwrap();
    encoder.mark(t + 40_003, Mark::GeneratorFalling, &mut bytes).unwrap();
    let (columns, anomalies) = decode(DavisDecoder::new(layout), &bytes, &[]);
    assert!(anomalies.is_empty(), "{anomalies:?}");
    assert_eq!(columns.iter().collect::<Vec<_>>(), events);
    assert_eq!(columns.frames, [frame(t, t + 40_000, 10)]);
    assert_eq!(columns.imu, [sample(t + 40_001), partial]);
    assert_ne!(columns.imu[0], partial);
    let marks: Vec<Mark> = columns.marks.iter().map(|mark| mark.1).collect();
    let of_frame = [Mark::FrameBegin, Mark::ExposureBegin, Mark::ExposureEnd, Mark::FrameEnd];
    assert_eq!(marks, [&of_frame[..], &[Mark::ExternalRising, Mark::GeneratorFalling]].concat());
    assert_eq!(columns.edges, [Edge { t_us: t + 40_002, channel: 0, rising: true }]);
}

#[test]
fn a_davis_clock_that_is_reset_before_it_told_a_time_breaks_nothing() {
    for (before, breaks) in [(&[0x7002_u16, 0x7001][..], 0), (&[0x7002, 0x8005], 1)] {
        let words = before.iter().chain(&[0x0001, 0x8007, 0x1003, 0x3004]);
        let bytes: Vec<u8> = words.flat_map(|word| word.to_le_bytes()).collect();
        let mut columns = Columns::default();
        let mut decoder = DavisDecoder::new(DavisLayout::default());
        decoder.decode(&bytes, &mut columns);
        assert_eq!(columns.iter().collect::<Vec<_>>(), [event(7, 4, 3, true)]);
        assert_eq!(decoder.anomalies().discontinuities, breaks);
        assert_eq!(columns.discontinuities.len() as u64, breaks);
    }
}

#[test]
fn davis_frames_turn_as_the_registers_say() {
    // Read out from the right to the left and from the bottom to the top, or with rows for columns.
    let usual = DavisLayout { size: SIZE, ..DavisLayout::default() };
    let mut bytes = Vec::new();
    DavisEncoder::new(usual).frame(&frame(1, 2, 10), &mut bytes).unwrap();
    let read = |layout| decode(DavisDecoder::new(layout), &bytes, &[]).0.frames.remove(0).pixels;
    let flipped = read(DavisLayout { frames_flip_x: true, frames_flip_y: true, ..usual });
    let mut expected = frame(1, 2, 10).pixels;
    expected.reverse();
    assert_eq!(flipped, expected);
    let transposed = read(DavisLayout::from_registers(SensorSize { width: 4, height: 6 }, 0, 4, 0, 1));
    let original = frame(1, 2, 10).pixels;
    let expected: Vec<u16> = (0..24).map(|at| original[at % 4 * 6 + at / 4]).collect();
    assert_eq!(transposed, expected);
}

#[test]
fn a_davis_frame_without_all_its_pixels_is_dropped_and_counted() {
    let layout = DavisLayout { size: SIZE, ..DavisLayout::default() };
    let mut bytes = Vec::new();
    DavisEncoder::new(layout).frame(&frame(1, 2, 10), &mut bytes).unwrap();
    let at = bytes.len() - 20;
    bytes.drain(at..at + 2);
    let (columns, anomalies) = decode(DavisDecoder::new(layout), &bytes, &[]);
    assert!(columns.frames.is_empty());
    assert_eq!(anomalies, Anomalies { incomplete: 1, ..Anomalies::default() });
}

#[test]
fn davis_time_lost_with_data_is_counted_with_the_hosts_clock() {
    let layout = DavisLayout { size: SIZE, ..DavisLayout::default() };
    let bytes = |words: &[u16]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let mut decoder = DavisDecoder::new(layout);
    let mut columns = Columns::default();
    decoder.hint_host_us(1_000_000);
    decoder.decode(&bytes(&[0x8010, 0x1000, 0x3000]), &mut columns);
    decoder.restart();
    decoder.hint_host_us(2_000_000 + 400);
    let truth = 0x10 + 1_000_000_u64;
    decoder.decode(&bytes(&[0x8000 | (truth & 0x7FFF) as u16, 0x1000, 0x3000]), &mut columns);
    assert_eq!(columns.t_us, [0x10, truth]);
    assert_eq!(columns.discontinuities, [(1, truth)]);
    assert_eq!(decoder.anomalies().loops_restored, truth >> 15);
}

#[test]
fn aedat2_addresses_are_turned_to_the_top_left() {
    let davis = Aedat2Chip::Davis(SensorSize { width: 346, height: 260 });
    let bytes: Vec<u8> =
        words::AEDAT2.iter().flat_map(|&(address, t)| [address, t]).flat_map(u32::to_be_bytes).collect();
    let (columns, anomalies) = decode(Aedat2Decoder::new(davis), &bytes, &[]);
    let expected = [event(10, 342, 0, true), event(0x7FFF_FFFF, 0, 259, false)];
    assert_eq!(columns.iter().collect::<Vec<_>>(), expected);
    assert_eq!(columns.edges, [Edge { t_us: (1 << 31) + 5, channel: 0, rising: true }]);
    assert_eq!(anomalies, Anomalies { outside: 1, ..Anomalies::default() });
    let bytes = [(127_u32 << 8 | 127 << 1).to_be_bytes(), 3_u32.to_be_bytes()].concat();
    let (columns, _) = decode(Aedat2Decoder::new(Aedat2Chip::Dvs128), &bytes, &[]);
    assert_eq!(columns.iter().collect::<Vec<_>>(), [event(3, 0, 0, true)]);
}
