//! Writes what the fuzzer starts from: `fuzz_seeds FOLDER` makes a folder for each fuzz target, with small streams and files
//! in it, made of the words of the tests and by the encoders. `session/fuzz/src/plan.rs` says what comes before a stream.

use std::{fs, io, path::Path};

use erfgs_scene::pixel::PixelFormat;
use erfgs_events::EventEncoding;
use erfgs_events::{Event, Events, Aedat4Compression, Aedat4Encoder, ApsFrame, CSV_HEADER, CdEvent, CsvEncoder, DatEncoder, DatFormat, DavisEncoder, DavisLayout, Edge, Evt2Encoder, Evt3Encoder, Evt21Encoder, ImuSample, Mark, RawHeader, SensorSize, Sink, WordOrder, npz};
use erfgs_session::{container::Settings, source::{Encoding, Packet}};
use erfgs_base::npy;
use erfgs_scene::pixel;

#[allow(dead_code, reason = "the tests of sessions use the rest")]
#[path = "../../../session/tests/it/common.rs"]
mod sessions;
#[path = "../../../events/tests/it/words.rs"]
mod words;

const SIZE: SensorSize = SensorSize { width: 6, height: 4 };
/// What is before a stream: no cuts; pieces of 7 bytes; two cuts, with a restart and with a hint.
const PLANS: [&[u8]; 3] = [&[0, 0], &[0, 1, 7], &[0, 0x22, 3, 64, 40, 0, 3, 1, 0, 0, 24, 0, 2 | 20 << 2, 9, 0, 0]];

/// Collects seeds by target.
struct Seeds<'a> {
    folder: &'a Path,
    count: usize,
}

impl Seeds<'_> {
    fn put(&mut self, target: &str, bytes: &[u8]) -> io::Result<()> {
        let folder = self.folder.join(target);
        fs::create_dir_all(&folder)?;
        self.count += 1;
        fs::write(folder.join(format!("seed-{:03}", self.count)), bytes)
    }

    /// A stream with these options, taken apart in several ways.
    fn stream(&mut self, target: &str, options: u8, stream: &[u8]) -> io::Result<()> {
        for plan in PLANS {
            self.put(target, &[&[options], &plan[1..], stream].concat())?;
        }
        Ok(())
    }
}

fn events() -> Vec<CdEvent> {
    let event =
        |n: u64| CdEvent { t_us: 4_000 + n * n * 7, x: (n % 6) as u16, y: (n / 6 % 4) as u16, on: n.is_multiple_of(3) };
    (0..40).map(event).collect()
}

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

fn prophesee(seeds: &mut Seeds<'_>) -> io::Result<Vec<u8>> {
    let evt2: Vec<u8> = words::EVT2.iter().flat_map(|word| word.to_le_bytes()).collect();
    let evt3: Vec<u8> = words::EVT3.iter().flat_map(|word| word.to_le_bytes()).collect();
    let evt21 = |legacy: bool| -> Vec<u8> {
        let halves = words::EVT21.iter().flat_map(|&(head, data)| if legacy { [head, data] } else { [data, head] });
        halves.flat_map(u32::to_le_bytes).collect()
    };
    seeds.stream("evt2", 0, &evt2)?;
    seeds.stream("evt3", 0, &evt3)?;
    seeds.stream("evt21", 0, &evt21(false))?;
    seeds.stream("evt21", 2, &evt21(true))?;
    let [mut evt2, mut evt21, mut evt3, mut dat] = [const { Vec::new() }; 4];
    let mut encoders =
        (Evt2Encoder::default(), Evt21Encoder::new(WordOrder::Little), Evt3Encoder::default(), DatEncoder::default());
    let failed = io::Error::other;
    for event in events() {
        encoders.0.event(event, &mut evt2).map_err(failed)?;
        encoders.1.event(event, &mut evt21).map_err(failed)?;
        encoders.2.event(event, &mut evt3).map_err(failed)?;
        encoders.3.event(event, &mut dat).map_err(failed)?;
    }
    let edge = Edge { t_us: 20_000, channel: 1, rising: true };
    encoders.0.edge(edge, &mut evt2).map_err(failed)?;
    encoders.1.edge(edge, &mut evt21).map_err(failed)?;
    encoders.2.edge(edge, &mut evt3).map_err(failed)?;
    encoders.1.finish(&mut evt21);
    encoders.2.finish(&mut evt3);
    seeds.stream("evt2", 1, &evt2)?;
    seeds.stream("evt21", 1, &evt21)?;
    seeds.stream("evt3", 1, &evt3)?;
    for options in 0..8 {
        seeds.stream("dat", options, &dat)?;
    }
    for encoding in [Encoding::Events(EventEncoding::Evt2), Encoding::Events(EventEncoding::Evt21), Encoding::Events(EventEncoding::Evt21Legacy), Encoding::Events(EventEncoding::Evt3)] {
        let header = RawHeader::new(encoding, SIZE, "00050567", "2026-01-02 03:04:05").unwrap_or_default();
        seeds.put("headers", &header.with_imx636("3.9.0").encode())?;
    }
    seeds.put("headers", b"% evt 2.1\n% system_ID 49\n% geometry 1280x720\n% end\n")?;
    seeds.put("headers", &DatFormat::header(SIZE, "2026-01-02 03:04:05"))?;
    Ok(evt3)
}

fn inivation(seeds: &mut Seeds<'_>) -> io::Result<Vec<u8>> {
    let pairs: Vec<u8> = words::AEDAT2.iter().flat_map(|&(a, t)| [a, t]).flat_map(u32::to_be_bytes).collect();
    seeds.stream("aedat2", 0, &pairs)?;
    seeds.stream("aedat2", 1, &pairs)?;
    seeds.put("headers", b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346B\r\n# end\r\n")?;

    let failed = io::Error::other;
    let golden: Vec<u8> = words::DAVIS.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut encoder = DavisEncoder::new(DavisLayout { size: SIZE, ..DavisLayout::default() });
    let mut davis = Vec::new();
    for event in events() {
        encoder.event(event, &mut davis).map_err(failed)?;
    }
    encoder.frame(&frame(10), &mut davis).map_err(failed)?;
    encoder.imu(sample(), &mut davis).map_err(failed)?;
    encoder.mark(150_001, Mark::ExternalRising, &mut davis).map_err(failed)?;
    encoder.mark(150_002, Mark::TimestampReset, &mut davis).map_err(failed)?;
    for options in [0, 1, 0b11_1100, 3] {
        seeds.stream("davis", options, &golden)?;
        seeds.stream("davis", options, &davis)?;
    }

    for compression in [Aedat4Compression::None, Aedat4Compression::Lz4, Aedat4Compression::Zstd] {
        let mut encoder = Aedat4Encoder::new(SIZE, "DAVIS346_<1>&", compression);
        seeds.put("headers", &encoder.take())?;
        let mut encoder = Aedat4Encoder::new(SIZE, "DAVIS346_1", compression);
        events().into_iter().for_each(|event| encoder.event(event));
        encoder.frame(frame(8));
        encoder.frame(frame(16));
        encoder.imu(sample());
        Mark::ALL.into_iter().for_each(|mark| encoder.mark(150_001, mark));
        seeds.stream("aedat4", 0, &encoder.finish())?;
    }
    Ok(davis)
}

fn text_and_arrays(seeds: &mut Seeds<'_>) -> io::Result<()> {
    let mut csv = CSV_HEADER.to_vec();
    events().into_iter().for_each(|event| CsvEncoder.event(event, &mut csv));
    seeds.stream("csv", 0, &csv)?;
    seeds.stream("csv", 1, b"# t x y p\r\n12;3\t4,-1\n5 6 7 True\n\n18446744073709551615,65534,65534,0\n1,2,3,2\n")?;

    let events = events();
    let shape = [events.len()];
    let arrays = [
        npy::encode(&shape, events.iter().map(|event| event.t_us as i64)),
        npy::encode(&shape, events.iter().map(|event| event.x)),
        npy::encode(&shape, events.iter().map(|event| event.y)),
        npy::encode(&shape, events.iter().map(|event| u8::from(event.on))),
        npy::encode(&[], [6_u32].into_iter()),
        npy::encode(&[], [4_u32].into_iter()),
        npy::encode(&[2, 2, 3], (0..12).map(|value: u8| value)),
        npy::encode(&[2, 2], [0.5_f64, -1.0, f64::NAN, 3.0].into_iter()),
    ];
    for array in &arrays {
        seeds.put("npy", array)?;
    }
    seeds.put("npy", b"\x93NUMPY\x01\x00\x3b\x00{'descr': '>i2', 'fortran_order': True, 'shape': (1, 3), }\n\x00\x01\x00\x02\x00\x03")?;
    let with_lengths = arrays[..7].iter().flat_map(|array| [&(array.len() as u16).to_le_bytes()[..], array].concat());
    seeds.put("npz", &[&[1 | 40 << 1], &with_lengths.collect::<Vec<u8>>()[..]].concat())?;
    let file = seeds.folder.join("events.npz");
    let mut columns = Events::new(6, 4);
    for CdEvent { t_us, x, y, on } in events {
        columns.push(Event { t_us: t_us as i64, x, y, on });
    }
    npz::write_events(&file, &columns).map_err(io::Error::other)?;
    seeds.put("npz", &[&[9 << 1], &fs::read(&file)?[..]].concat())?;
    fs::remove_file(file)
}

/// Sessions: small ones, and what kills and damage leave of them.
fn sessions(seeds: &mut Seeds<'_>, evt3: &[u8], davis: &[u8]) -> io::Result<()> {
    let failed = io::Error::other;
    let small = sessions::small_session();
    let (mut writer, camera, _) = sessions::writer(Settings { chunk_bytes: 300, ..Settings::default() });
    let mut description = sessions::description("dv0", Encoding::Events(EventEncoding::Davis));
    (description.width, description.height) = (6, 4);
    let other = writer.add_stream(&description).map_err(failed)?;
    for sequence in 0..4 {
        let packet = sessions::packet(sequence, 0);
        for (stream, words) in [(camera, evt3), (other, davis)] {
            let payload = words.to_vec().into();
            writer.packet(stream, &Packet { payload, ..packet.clone() }).map_err(failed)?;
        }
    }
    let words = writer.finish().map_err(failed)?.sink;
    for session in [&small, &words] {
        let mut damaged = session.clone();
        damaged[session.len() / 2] ^= 1;
        let zeros = [&session[..session.len() / 3], &[0; 100]].concat();
        for bytes in [&session[..], &session[..session.len() - 400], &session[..session.len() / 2], &damaged, &zeros] {
            seeds.put("container", &[&[13], bytes].concat())?;
            seeds.put("repair", bytes)?;
        }
    }
    for encoding in ["evt3", "libcaer_cmp", "unknown"] {
        seeds.put("container", &[&[13], &sessions::ros_recording(encoding)[..]].concat())?;
    }
    Ok(())
}

/// A frame of 8 x 4 pixels in each encoding; as JPEG with tables and, as cameras send it, without.
fn frames(seeds: &mut Seeds<'_>) -> io::Result<()> {
    let levels: Vec<u8> = (0..8 * 4 * 3).map(|n| (n * 37) as u8).collect();
    for (index, encoding) in Encoding::all().enumerate() {
        let head = [index as u8, 8, 4, 20 | (index as u8 & 1) << 6, 0, 0];
        let Some(bytes) = pixel::frame_bytes(encoding, 8, 4) else { continue };
        seeds.put("frames", &[&head[..], &levels[..bytes]].concat())?;
    }
    let mjpeg = Encoding::all().position(|encoding| encoding == Encoding::Frames(PixelFormat::Mjpeg)).unwrap_or_default();
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new(&mut jpeg)
        .encode(&levels, 8, 4, image::ExtendedColorType::Rgb8)
        .map_err(io::Error::other)?;
    let is_table = |at: &usize| jpeg[*at..].starts_with(&[0xff, 0xc4]);
    let tables = (0..jpeg.len()).find(is_table).unwrap_or_default();
    let scan = (tables..jpeg.len()).find(|&at| jpeg[at..].starts_with(&[0xff, 0xda])).unwrap_or_default();
    let bare = [&jpeg[..tables], &jpeg[scan..]].concat();
    for jpeg in [&jpeg, &bare] {
        seeds.put("frames", &[&[mjpeg as u8, 8, 4, 128, 0, 0], &jpeg[..]].concat())?;
    }
    Ok(())
}

fn main() -> io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1) else {
        return Err(io::Error::other("usage: fuzz_seeds FOLDER"));
    };
    let mut seeds = Seeds { folder: Path::new(&folder), count: 0 };
    let evt3 = prophesee(&mut seeds)?;
    let davis = inivation(&mut seeds)?;
    text_and_arrays(&mut seeds)?;
    frames(&mut seeds)?;
    sessions(&mut seeds, &evt3, &davis)
}
