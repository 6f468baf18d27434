//! The UVC camera.

use erfgs_hardware_mocks::usb::{
    Faults, Reply, TriggerLine, Urb, UsbDevice, Uvc, UvcOptions,
    clock::ClockError,
    line::PulseTrain,
    scene::{FrameScene as _, PatternFrames},
    uvc::{CLOCK_HZ, Format, FrameTruth, STREAM},
};

use super::host::Bench;

type Host = Bench<Uvc>;

fn camera(options: UvcOptions) -> Host {
    Bench::new(Uvc::new(options, Box::new(PatternFrames::new())))
}

/// Probes and commits a format, size and interval (100 ns); returns what the camera made of it.
pub fn commit<D: UsbDevice>(host: &mut Bench<D>, format: u8, size: u8, interval: u32) -> Vec<u8> {
    let mut wish = vec![1, 0, format, size];
    wish.extend(interval.to_le_bytes());
    wish.resize(26, 0);
    assert_eq!(host.submit(&Urb::control_out(0x21, 0x01, 0x0100, 1, &wish)), Reply::Taken(26));
    let answer = host.control_in(0xa1, 0x81, 0x0100, 1, 26);
    assert_eq!(answer.len(), 26);
    assert_eq!(host.submit(&Urb::control_out(0x21, 0x01, 0x0200, 1, &answer)), Reply::Taken(26));
    answer
}

pub struct Frame {
    arrived_ns: i64,
    presented: u32,
    id: bool,
    pub bytes: Vec<u8>,
}

/// Reads frames payload by payload, as `uvcvideo` does.
pub fn frames<D: UsbDevice>(host: &mut Bench<D>, for_ms: i64) -> Vec<Frame> {
    let mut all = Vec::new();
    let mut bytes = Vec::new();
    for _ in 0..for_ms {
        host.wait_us(1000);
        while let Reply::Data(payload) = host.submit(&Urb::bulk_in(STREAM, 16_384)) {
            assert_eq!(payload[0], 12);
            assert_eq!(payload[1] & 0x8c, 0x8c, "end of header, presentation time, source clock");
            bytes.extend_from_slice(&payload[12..]);
            if payload[1] & 2 != 0 {
                let presented = u32::from_le_bytes(payload[2..6].try_into().unwrap());
                let bytes = std::mem::take(&mut bytes);
                all.push(Frame { arrived_ns: host.now_ns, presented, id: payload[1] & 1 == 1, bytes });
            }
        }
    }
    all
}

#[test]
fn its_descriptors_are_consistent() {
    let mut host = camera(UvcOptions::default());
    let configuration = host.control_in(0x80, 6, 0x0200, 0, 4096);
    assert_eq!(usize::from(u16::from_le_bytes([configuration[2], configuration[3]])), configuration.len());
    let (mut at, mut kinds) = (0, Vec::new());
    while at < configuration.len() {
        let descriptor = &configuration[at..at + usize::from(configuration[at])];
        if descriptor[1] == 0x24 {
            kinds.push(descriptor[2]);
        }
        // Headers tell the length of all class descriptors of their interface.
        if descriptor[1] == 0x24 && descriptor[2] == 1 {
            let total = usize::from(u16::from_le_bytes(if descriptor[3..5] == [0, 1] {
                [descriptor[5], descriptor[6]]
            } else {
                [descriptor[4], descriptor[5]]
            }));
            let after = at + total;
            assert!(after == configuration.len() || matches!(configuration[after + 1], 4 | 5), "{total}");
        }
        at += descriptor.len();
    }
    assert_eq!(at, configuration.len());
    // Control header, camera, processing, output; stream header; MJPEG and three uncompressed formats, three sizes each.
    assert_eq!(kinds, [1, 2, 5, 3, 1, 6, 7, 7, 7, 13, 4, 5, 5, 5, 13, 4, 5, 5, 5, 13, 4, 5, 5, 5, 13]);
}

#[test]
fn frames_of_every_format_arrive_whole_and_in_turn() {
    for (number, format) in [Format::Mjpeg, Format::Yuyv, Format::Nv12, Format::Grey].into_iter().enumerate() {
        let mut host = camera(UvcOptions::default());
        let answer = commit(&mut host, number as u8 + 1, 2, 333_333);
        let largest = u32::from_le_bytes(answer[18..22].try_into().unwrap()) as usize;
        let frames = frames(&mut host, 1050);
        assert!((29..=32).contains(&frames.len()), "{} frames", frames.len());
        for (index, frame) in frames.iter().enumerate() {
            let truth = FrameTruth::of(format, &frame.bytes).unwrap();
            assert_eq!(truth.number, index as u64);
            assert!(truth.exposure_ns[1] < frame.arrived_ns);
            assert_eq!(frame.id, index % 2 == 1);
            match format {
                Format::Mjpeg => {
                    let image = image::load_from_memory(&frame.bytes).unwrap();
                    assert_eq!((image.width(), image.height()), (320, 240));
                }
                _ => assert_eq!(frame.bytes.len(), largest),
            }
        }
    }
}

#[test]
fn grey_and_the_luma_of_others_show_the_scene() {
    let picture = PatternFrames::new().frame(3, [0, 0], 320, 240).1.luma();
    for (number, step) in [(2, 2), (3, 1), (4, 1)] {
        let mut host = camera(UvcOptions::default());
        commit(&mut host, number, 2, 333_333);
        let frame = &frames(&mut host, 200)[3].bytes;
        let luma: Vec<u8> = frame.iter().copied().step_by(step).take(320 * 240).collect();
        assert_eq!(luma[FrameTruth::PIXELS..], picture[FrameTruth::PIXELS..]);
    }
}

#[test]
fn presentation_times_count_the_cameras_own_clock() {
    let clock = ClockError { offset_ppm: 100.0, ..ClockError::default() };
    let mut host = camera(UvcOptions { faults: Faults { clock, ..Faults::default() }, ..UvcOptions::default() });
    commit(&mut host, 4, 2, 333_333);
    let frames = frames(&mut host, 2000);
    let truth = |frame: &Frame| FrameTruth::of(Format::Grey, &frame.bytes).unwrap().exposure_ns[0];
    for pair in frames.windows(2) {
        let ticks = f64::from(pair[1].presented.wrapping_sub(pair[0].presented));
        let true_s = (truth(&pair[1]) - truth(&pair[0])) as f64 * 1e-9;
        assert!((ticks / (true_s * f64::from(CLOCK_HZ)) - 1.0001).abs() < 1e-6);
        // 33.3333 ms of a fast crystal are a little less.
        assert!((true_s - 0.033_333_3 / 1.0001).abs() < 1e-8, "{true_s}");
    }
}

#[test]
fn a_triggered_camera_exposes_a_frame_for_each_pulse() {
    let train = PulseTrain { first_ns: 0, period_ns: 50_000_000, high_ns: 1_000_000 };
    let faults = Faults { dropped_triggers: [25].into(), ..Faults::default() };
    let mut host = camera(UvcOptions { trigger: Some(TriggerLine::train(train)), faults, ..UvcOptions::default() });
    commit(&mut host, 1, 2, 333_333);
    let starts: Vec<i64> = frames(&mut host, 1000)
        .iter()
        .map(|frame| FrameTruth::of(Format::Mjpeg, &frame.bytes).unwrap().exposure_ns[0])
        .collect();
    let expected: Vec<i64> = (21..=39).filter(|pulse| *pulse != 25).map(|pulse| pulse * 50_000_000).collect();
    assert_eq!(starts, expected);
}

#[test]
fn exposure_is_set_once_the_automatism_is_off() {
    let mut host = camera(UvcOptions::default());
    let set = |host: &mut Host, unit: u16, selector: u16, data: &[u8]| {
        host.submit(&Urb::control_out(0x21, 0x01, selector << 8, unit << 8, data))
    };
    assert_eq!(host.control_in(0xa1, 0x86, 0x0400, 0x0100, 1), [7], "an automatism has the exposure");
    assert_eq!(set(&mut host, 1, 4, &50_u32.to_le_bytes()), Reply::Stall);
    assert_eq!(host.control_in(0xa1, 0x81, 0x0200, 0, 1), [2], "wrong state");
    assert_eq!(set(&mut host, 1, 2, &[1]), Reply::Taken(1));
    assert_eq!(set(&mut host, 1, 4, &50_u32.to_le_bytes()), Reply::Taken(4));
    assert_eq!(host.control_in(0xa1, 0x81, 0x0400, 0x0100, 4), 50_u32.to_le_bytes());
    assert_eq!(set(&mut host, 1, 4, &0_u32.to_le_bytes()), Reply::Stall);
    assert_eq!(set(&mut host, 2, 10, &5000_u16.to_le_bytes()), Reply::Stall);
    assert_eq!(set(&mut host, 2, 11, &[0]), Reply::Taken(1));
    assert_eq!(set(&mut host, 2, 10, &5000_u16.to_le_bytes()), Reply::Taken(2));
    assert_eq!(set(&mut host, 2, 4, &200_u16.to_le_bytes()), Reply::Taken(2));
    for (request, value) in [(0x82, 2800_u16), (0x83, 6500), (0x84, 10), (0x87, 4600)] {
        assert_eq!(host.control_in(0xa1, request, 0x0a00, 0x0200, 2), value.to_le_bytes());
    }
    commit(&mut host, 1, 2, 333_333);
    let frames = frames(&mut host, 100);
    let [start, end] = FrameTruth::of(Format::Mjpeg, &frames[0].bytes).unwrap().exposure_ns;
    assert_eq!(end - start, 5_000_000);
}

#[test]
fn clearing_the_halt_stops_the_stream_and_a_slow_host_loses_whole_frames() {
    let mut host = camera(UvcOptions::default());
    commit(&mut host, 2, 2, 333_333);
    host.wait_us(1_000_000);
    let numbers: Vec<u64> =
        frames(&mut host, 200).iter().map(|frame| FrameTruth::of(Format::Yuyv, &frame.bytes).unwrap().number).collect();
    assert_eq!(numbers[..2], [0, 1]);
    assert!(numbers[2] >= 29, "{numbers:?}");
    let counts = host.device.counts().get();
    assert_eq!(counts.seen, counts.frames + counts.lost);
    host.submit(&Urb::control_out(0x02, 1, 0, u16::from(STREAM), &[]));
    assert!(frames(&mut host, 200).is_empty());
}
