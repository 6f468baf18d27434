//! What the packets hold.

use super::{
    super::{Anomalies, ApsFrame, ImuSample, Mark, SensorSize, Sink, stage::Stage},
    description::Aedat4Kind,
    flat::Table,
};

/// Events that are decoded at once.
const EVENTS: usize = 64;

/// Decodes a packet without compression and without its length; `None` if it is damaged.
pub(super) fn decode(
    kind: Aedat4Kind,
    size: SensorSize,
    bytes: &[u8],
    last_us: &mut u64,
    stage: &mut Stage,
    anomalies: &mut Anomalies,
    sink: &mut impl Sink,
) -> Option<()> {
    let root = Table::root(bytes, &kind.identifier())?;
    let mut time = |t: i64, anomalies: &mut Anomalies| {
        let t_us = u64::try_from(t).ok()?;
        anomalies.time_backward += u64::from(t_us < *last_us);
        *last_us = t_us;
        Some(t_us)
    };
    match kind {
        Aedat4Kind::Events => {
            for events in root.structures::<16>(0)?.chunks(EVENTS) {
                stage.room(EVENTS, sink);
                if let Some(columns) = stage.take() {
                    let good = decode_events(events, size, columns, last_us, anomalies);
                    stage.give_back(EVENTS - good);
                }
            }
            stage.flush(sink);
        }
        Aedat4Kind::Frames => sink.frame(frame(&root)?),
        Aedat4Kind::Imu => {
            for sample in root.tables(0)? {
                let sample = sample?;
                let Some(t_us) = time(sample.i64(0), anomalies) else {
                    anomalies.undated += 1;
                    continue;
                };
                let vector = |first: usize| std::array::from_fn(|axis| sample.f32(first + axis));
                sink.imu(ImuSample {
                    t_us,
                    temperature: sample.f32(1),
                    accelerometer: vector(2),
                    gyroscope: vector(5),
                    magnetometer: vector(8),
                });
            }
        }
        Aedat4Kind::Triggers => {
            for trigger in root.tables(0)? {
                let trigger = trigger?;
                let Some(t_us) = time(trigger.i64(0), anomalies) else {
                    anomalies.undated += 1;
                    continue;
                };
                match Mark::from_code(trigger.i8(1) as u8) {
                    Some(mark) => sink.mark(t_us, mark),
                    None => anomalies.unknown += 1,
                }
            }
        }
    }
    Some(())
}

/// Decodes at most [`EVENTS`] events into columns, one after the other without a branch; says how many are good.
fn decode_events(
    events: &[[u8; 16]],
    size: SensorSize,
    (times, xs, ys, ons): (&mut [u64; EVENTS], &mut [u16; EVENTS], &mut [u16; EVENTS], &mut [bool; EVENTS]),
    last_us: &mut u64,
    anomalies: &mut Anomalies,
) -> usize {
    let (mut good, mut undated, mut backward, mut last) = (0, 0, 0, *last_us);
    for event in events {
        let event = u128::from_le_bytes(*event);
        // Addresses are signed in the file; negative ones become large and lie outside.
        let (t_us, x, y, on) = (event as u64, (event >> 64) as u16, (event >> 80) as u16, (event >> 96) as u8 != 0);
        let dated = t_us <= i64::MAX as u64;
        backward += u64::from(dated & (t_us < last));
        last = if dated { t_us } else { last };
        undated += u64::from(!dated);
        (times[good % EVENTS], xs[good % EVENTS], ys[good % EVENTS], ons[good % EVENTS]) = (t_us, x, y, on);
        good += usize::from(dated & (x < size.width) & (y < size.height));
    }
    *last_us = last;
    anomalies.time_backward += backward;
    anomalies.undated += undated;
    anomalies.outside += events.len() as u64 - undated - good as u64;
    good
}

/// A frame. Its format is OpenCV's: depth in the low 3 bits (0 = 8 bits, 2 = 16 bits), channels less one above. `None`
/// for another depth, and if the pixels are not as many as they should be.
fn frame(root: &Table<'_>) -> Option<ApsFrame> {
    let format = root.i8(5) as u8;
    let (depth, channels) = (format & 7, (format >> 3) + 1);
    let (width, height) = (u16::try_from(root.i16(6)).ok()?, u16::try_from(root.i16(7)).ok()?);
    let samples = usize::from(width) * usize::from(height) * usize::from(channels);
    let bytes = root.bytes(10)?;
    let (bits, pixels): (u8, Vec<u16>) = match depth {
        0 => (8, bytes.iter().map(|&byte| byte.into()).collect()),
        2 => (16, bytes.as_chunks::<2>().0.iter().map(|&pixel| u16::from_le_bytes(pixel)).collect()),
        _ => return None,
    };
    if channels > 4 || pixels.len() != samples || bytes.len() != samples * usize::from(bits / 8) {
        return None;
    }
    // Older files give start and end of the exposure, newer ones its length (field 11).
    let t = root.i64(0);
    let start = if root.i64(3) > 0 { root.i64(3) } else { t };
    let end = if root.i64(4) > 0 { root.i64(4) } else { start.saturating_add(root.i64(11).max(0)) };
    let exposure_start_us = u64::try_from(start).ok()?;
    let exposure_end_us = u64::try_from(end).ok()?;
    Some(ApsFrame { exposure_start_us, exposure_end_us, width, height, channels, pixels, bits })
}
