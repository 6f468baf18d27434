//! What must hold for every decoder of a stream.

use erfgs_events::{CdEvent, Columns, Decoder, EventBatch, EventEncoding, SensorSize, Sink, StreamDecoder};

use crate::{Plan, memory};

/// A sink that keeps nothing.
pub struct Nothing;

impl Sink for Nothing {
    fn event(&mut self, _event: CdEvent) {}

    fn events(&mut self, _batch: EventBatch<'_>) {}
}

/// Decodes a stream at once and in pieces, which must give the same, on a sensor of `size`, in no more than `limit` bytes of
/// memory besides what the sink keeps.
pub fn check_stream<D: Decoder>(plan: &Plan<'_>, size: SensorSize, limit: usize, new: impl Fn() -> D) {
    let [mut whole, mut pieces] = [Columns::default(), Columns::default()];
    let whole_anomalies = plan.decode(new(), false, &mut whole);
    let pieces_anomalies = plan.decode(new(), true, &mut pieces);
    assert_eq!(whole_anomalies, pieces_anomalies, "at once, and in pieces");
    assert_same(&whole, &pieces);
    assert!([whole.x.len(), whole.y.len(), whole.on.len()] == [whole.len(); 3], "columns of unequal length");
    let outside = whole.iter().find(|event| event.x >= size.width || event.y >= size.height);
    assert!(outside.is_none(), "{outside:?} is outside of {size:?}");
    let peak = memory::peak(|| plan.decode(new(), true, &mut Nothing));
    assert!(peak <= limit, "{peak} bytes of memory for {} bytes of stream; {limit} are allowed", plan.len());
}

/// Both checks for the decoder that `new` makes for a device's stream. Bit 0 of the options: the size of its sensor is
/// unknown.
pub fn check_device<D: Decoder>(
    plan: &Plan<'_>,
    encoding: EventEncoding,
    size: SensorSize,
    new: impl Fn(Option<SensorSize>) -> D,
) {
    let known = (plan.options & 1 == 0).then_some(size);
    check_stream(plan, known.unwrap_or(SensorSize::ALL), 64 << 10, || new(known));
    check_resumed(plan, encoding, known.unwrap_or(SensorSize::ALL));
}

/// Puts the decoder of a device's stream to sleep after the first piece; what wakes up must give the same events. Frames
/// and inertial samples under way are lost then, and left out here.
pub fn check_resumed(plan: &Plan<'_>, encoding: EventEncoding, size: SensorSize) {
    let bytes = plan.stream();
    let [mut whole, mut woken] = [Columns::default(), Columns::default()];
    let mut decoder = StreamDecoder::new(encoding, Some(size));
    decoder.decode(&bytes, &mut whole);
    decoder.finish(&mut whole);
    let (before, after) = bytes.split_at(plan.piece(0).min(bytes.len()));
    let mut decoder = StreamDecoder::new(encoding, Some(size));
    decoder.decode(before, &mut woken);
    let Some(state) = decoder.state() else { panic!("{encoding:?} has no state") };
    let Some(mut decoder) = StreamDecoder::from_state(encoding, state, Some(size)) else { return };
    assert_eq!(decoder.state(), Some(state), "a state is what it was made from");
    decoder.decode(after, &mut woken);
    decoder.finish(&mut woken);
    for columns in [&mut whole, &mut woken] {
        columns.frames.clear();
        columns.imu.clear();
    }
    assert_same(&whole, &woken);
}

/// Bit by bit: a sample of the inertial unit may hold what is not a number.
fn assert_same(a: &Columns, b: &Columns) {
    let imu = |columns: &Columns| -> Vec<_> {
        let bits = |values: [f32; 3]| values.map(f32::to_bits);
        let row = |sample: &erfgs_events::ImuSample| {
            let vectors = [sample.accelerometer, sample.gyroscope, sample.magnetometer].map(bits);
            (sample.t_us, sample.temperature.to_bits(), vectors)
        };
        columns.imu.iter().map(row).collect()
    };
    assert_eq!(imu(a), imu(b), "inertial samples");
    assert_eq!((&a.t_us, &a.x, &a.y, &a.on), (&b.t_us, &b.x, &b.y, &b.on), "events");
    assert_eq!((&a.edges, &a.marks, &a.monitor), (&b.edges, &b.marks, &b.monitor));
    assert_eq!((&a.discontinuities, &a.frames), (&b.discontinuities, &b.frames));
}
