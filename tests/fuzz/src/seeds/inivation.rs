//! DAVIS, AEDAT 2 and 4 and the headers of their files.

use erfgs_events::{Aedat4Compression, Aedat4Encoder, ApsFrame, DavisEncoder, DavisLayout, ImuSample, Mark, Sink};

use super::{SIZE, Seeds, events, words};

fn frame(bits: u8) -> ApsFrame {
    let pixels = (0..24).map(|pixel| pixel * if bits > 8 { 40 } else { 10 }).collect();
    let (exposure_start_us, exposure_end_us) = (100_000, 140_000);
    ApsFrame { exposure_start_us, exposure_end_us, width: 6, height: 4, channels: 1, pixels, bits }
}

fn sample() -> ImuSample {
    let accelerometer = [0.5, -1.0, 7.75];
    let gyroscope = [31.25, -62.5, 500.0];
    ImuSample { t_us: 150_000, temperature: 36.0, accelerometer, gyroscope, magnetometer: [0.0; 3] }
}

/// Puts them; gives a stream of a DAVIS.
pub fn put(seeds: &mut Seeds) -> Vec<u8> {
    let pairs: Vec<u8> = words::AEDAT2.iter().flat_map(|&(a, t)| [a, t]).flat_map(u32::to_be_bytes).collect();
    seeds.stream("aedat2", 0, &pairs);
    seeds.stream("aedat2", 1, &pairs);
    seeds.put("headers", b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346B\r\n# end\r\n");

    let golden: Vec<u8> = words::DAVIS.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut encoder = DavisEncoder::new(DavisLayout { size: SIZE, ..DavisLayout::default() });
    let mut davis = Vec::new();
    for event in events() {
        encoder.event(event, &mut davis).unwrap();
    }
    encoder.frame(&frame(10), &mut davis).unwrap();
    encoder.imu(sample(), &mut davis).unwrap();
    encoder.mark(150_001, Mark::ExternalRising, &mut davis).unwrap();
    encoder.mark(150_002, Mark::TimestampReset, &mut davis).unwrap();
    for options in [0, 1, 0b11_1100, 3] {
        seeds.stream("davis", options, &golden);
        seeds.stream("davis", options, &davis);
    }

    for compression in [Aedat4Compression::None, Aedat4Compression::Lz4, Aedat4Compression::Zstd] {
        let mut encoder = Aedat4Encoder::new(SIZE, "DAVIS346_<1>&", compression);
        seeds.put("headers", &encoder.take());
        let mut encoder = Aedat4Encoder::new(SIZE, "DAVIS346_1", compression);
        events().into_iter().for_each(|event| encoder.event(event));
        encoder.frame(frame(8));
        encoder.frame(frame(16));
        encoder.imu(sample());
        Mark::ALL.into_iter().for_each(|mark| encoder.mark(150_001, mark));
        seeds.stream("aedat4", 0, &encoder.finish());
    }
    davis
}
