//! Files: what they are, what is wrong with them.

use std::path::{Path, PathBuf};

use erfgs_events::EventEncoding;
use erfgs_events::{
    Anomalies, CSV_HEADER, CdEvent, Columns, CsvEncoder, DatEncoder, DatFormat, EventFile, EventFileError, Evt3Encoder,
    RawHeader, SensorSize,
};

const SIZE: SensorSize = SensorSize { width: 1280, height: 720 };

fn events() -> Vec<CdEvent> {
    (0..200_u64).map(|n| CdEvent { t_us: 1000 + n * 9, x: (n * 6) as u16, y: (n * 3) as u16, on: n % 3 == 0 }).collect()
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn raw(encoding: EventEncoding) -> Vec<u8> {
    let header = RawHeader::new(encoding, SIZE, "00050567", "2026-01-02 03:04:05").unwrap();
    header.with_imx636("3.9.0").encode()
}

fn read(path: &Path) -> (EventFile, Columns, Anomalies) {
    let file = EventFile::open(path).unwrap();
    let mut columns = Columns::default();
    let anomalies = file.decode(&mut columns).unwrap();
    (file, columns, anomalies)
}

#[test]
fn raw_files_say_how_they_are_encoded() {
    for encoding in [EventEncoding::Evt2, EventEncoding::Evt21, EventEncoding::Evt21Legacy, EventEncoding::Evt3] {
        let bytes = raw(encoding);
        let (header, length) = RawHeader::parse(&bytes);
        assert_eq!(length, bytes.len());
        let format = header.format().unwrap();
        assert_eq!((format.encoding, format.size), (encoding, Some(SIZE)));
        assert_eq!(header.encode(), bytes);
    }
    let text = String::from_utf8(raw(EventEncoding::Evt3)).unwrap();
    let expected = "% camera_integrator_name Prophesee\n% date 2026-01-02 03:04:05\n% evt 3.0\n% firmware_version 3.9.0\n\
                    % format EVT3;height=720;width=1280\n% geometry 1280x720\n% integrator_name Prophesee\n\
                    % plugin_integrator_name Prophesee\n% plugin_name hal_plugin_prophesee\n% sensor_generation 4.2\n\
                    % sensor_name IMX636\n% serial_number 00050567\n% subsystem_ID 0\n% system_ID 49\n% end\n";
    assert_eq!(text, expected);
}

#[test]
fn old_headers_are_understood() {
    let format = |text: &str| RawHeader::parse(text.as_bytes()).0.format().map(|format| (format.encoding, format.size));
    let vga = Some(SensorSize { width: 640, height: 480 });
    assert_eq!(format("% evt 2.0\n% system_ID 21\n"), Some((EventEncoding::Evt2, vga)));
    assert_eq!(format("% evt 3.0\n% geometry 1280x720\n"), Some((EventEncoding::Evt3, Some(SIZE))));
    assert_eq!(format("% system_ID 48\n"), Some((EventEncoding::Evt3, Some(SIZE))));
    assert_eq!(
        format("% format EVT21;width=1280;height=720\n% system_ID 49\n"),
        Some((EventEncoding::Evt21Legacy, Some(SIZE)))
    );
    assert_eq!(format("% format EVT21;width=1280;height=720\n"), Some((EventEncoding::Evt21, Some(SIZE))));
    assert_eq!(format("% evt 2.1\n% endianness legacy\n"), Some((EventEncoding::Evt21Legacy, None)));
    assert_eq!(format("% format EVT4;width=1280;height=720\n"), None);
    assert_eq!(format("% Date 2020-09-25\n"), None);
}

#[test]
fn a_raw_file_cut_anywhere_gives_what_is_there() {
    let folder = Folder::new();
    let mut bytes = raw(EventEncoding::Evt3);
    let header = bytes.len();
    let mut encoder = Evt3Encoder::default();
    events().into_iter().for_each(|event| encoder.event(event, &mut bytes).unwrap());
    encoder.finish(&mut bytes);
    let path = folder.write("a.raw", &bytes);
    let (file, columns, anomalies) = read(&path);
    assert_eq!((file.size, file.format.name()), (Some(SIZE), "evt3"));
    assert_eq!(columns.iter().collect::<Vec<_>>(), events());
    assert!(anomalies.is_empty());
    for length in header..bytes.len() {
        let (_, columns, anomalies) = read(&folder.write("a.raw", &bytes[..length]));
        assert_eq!(columns.iter().collect::<Vec<_>>(), events()[..columns.len()]);
        assert_eq!(anomalies.truncated_bytes, (length - header) as u64 % 2);
    }
}

#[test]
fn dat_and_csv_come_back() {
    let folder = Folder::new();
    let mut dat = DatFormat::header(SIZE, "2026-01-02 03:04:05");
    let mut csv = CSV_HEADER.to_vec();
    let mut encoder = DatEncoder::default();
    for event in events() {
        encoder.event(event, &mut dat).unwrap();
        CsvEncoder.event(event, &mut csv);
    }
    for (name, bytes, format, size) in [("a.dat", dat, "dat2", Some(SIZE)), ("a.csv", csv, "csv", None)] {
        let (file, columns, anomalies) = read(&folder.write(name, &bytes));
        assert_eq!((file.format.name(), file.size), (format, size));
        assert_eq!(columns.iter().collect::<Vec<_>>(), events());
        assert!(anomalies.is_empty(), "{name}: {anomalies:?}");
    }
}

#[test]
fn text_of_others_is_read_in_seconds_in_their_order_and_with_their_size() {
    let folder = Folder::new();
    let expected = vec![(3811, 96, 133, false), (1_499_999_123, 239, 0, true)];
    for (name, text, size) in [
        ("events.txt", "0.003811000 96 133 0\n1499.999123 239 0 1\n", None),
        ("b.txt", "240 180\n0.003811000 96 133 0\n1499.999123 239 0 1\n", Some(SensorSize { width: 240, height: 180 })),
        ("c.csv", "x,y,p,t\n96,133,0,3811\n239,0,1,1499999123\n", None),
        ("d.csv", "3.811e-03 9.6e+01 1.33e+02 0.0\n1.499999123e+03 2.39e+02 0.0 1.0\n", None),
    ] {
        let (file, columns, anomalies) = read(&folder.write(name, text.as_bytes()));
        let found: Vec<_> = columns.iter().map(|event| (event.t_us, event.x, event.y, event.on)).collect();
        assert_eq!((found, file.size), (expected.clone(), size), "{name}");
        assert!(anomalies.is_empty(), "{name}: {anomalies:?}");
    }
    let prose = EventFile::open(&folder.write("e.txt", b"A letter to a friend.\n")).unwrap_err();
    assert!(matches!(prose, EventFileError::Unknown { .. }), "{prose}");
}

#[test]
fn dat_of_version_1_and_triggers_are_read() {
    let folder = Folder::new();
    let item = |t: u32, packed: u32| [t.to_le_bytes(), packed.to_le_bytes()].concat();
    let first =
        [b"% Data file containing Event2D events.\n\x00\x08".to_vec(), item(7, 1 << 17 | 239 << 9 | 303)].concat();
    let (file, columns, _) = read(&folder.write("a.dat", &first));
    assert_eq!(file.format.name(), "dat1");
    assert_eq!(columns.iter().collect::<Vec<_>>(), [CdEvent { t_us: 7, x: 303, y: 239, on: true }]);
    let mut triggers = b"% Version 2\n% end\n\x0E\x08".to_vec();
    triggers.extend([item(u32::MAX, 3 << 8 | 1), item(1, 3 << 8)].concat());
    let (_, columns, anomalies) = read(&folder.write("b.dat", &triggers));
    let edges: Vec<_> = columns.edges.iter().map(|edge| (edge.t_us, edge.channel, edge.rising)).collect();
    assert_eq!(edges, [(u64::from(u32::MAX), 3, true), ((1 << 32) + 1, 3, false)]);
    assert!(anomalies.is_empty());
}

#[test]
fn a_header_of_aedat_2_may_be_longer_than_events_and_ends_where_it_says() {
    let folder = Folder::new();
    let mut header = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346B\r\n".to_vec();
    // jAER's preferences; among them a line that looks like pairs of words.
    for line in 0..3000 {
        header.extend(format!("# preference {line} {}\r\n", "x".repeat(60)).bytes());
    }
    header.extend(b"#End Of ASCII Header\r\n");
    assert!(header.len() > 200_000);
    // The first address begins with the byte of a `#`, and a line's end follows.
    let address = u32::from_be_bytes([b'#', 0x40, 0x08, 0x00]);
    let pairs = [address.to_be_bytes(), 10_u32.to_be_bytes()].concat();
    let (file, columns, anomalies) = read(&folder.write("a.aedat", &[header.clone(), pairs].concat()));
    assert_eq!((file.body as usize, columns.len()), (header.len(), 1));
    assert_eq!((columns.t_us[0], columns.on[0]), (10, true));
    assert_eq!(
        (columns.x[0], columns.y[0]),
        (345 - (address >> 12 & 0x3ff) as u16, 259 - (address >> 22 & 0x1ff) as u16)
    );
    assert!(anomalies.is_empty());
    let endless = [b"#!AER-DAT2.0\r\n".to_vec(), b"# no end\r\n".repeat(2 << 20)].concat();
    let message = EventFile::open(&folder.write("b.aedat", &endless)).unwrap_err().to_string();
    assert!(message.contains("does not end within"), "{message}");
}

#[test]
fn what_is_no_event_file_is_named_with_a_remedy() {
    let folder = Folder::new();
    let message = |name: &str, bytes: &[u8]| EventFile::open(&folder.write(name, bytes)).unwrap_err().to_string();
    let text = message("a.raw", b"");
    assert!(text.contains("a.raw") && text.contains("it is empty"), "{text}");
    assert!(message("b.bin", b"\x00\x01\x02").contains("formats are RAW"));
    assert!(message("c.raw", b"% Date today\n% end\n").contains("put a line `% format"));
    assert!(message("d.dat", b"% Version 3\n% end\n\x0C\x08").contains("version 3 is unknown"));
    let text = message("e.dat", b"% Version 2\n% end\n\x0C\x07");
    assert!(text.contains("at byte 19") && text.contains("items of 7 bytes"), "{text}");
    assert!(message("f.dat", b"% Version 2\n% end\n\x0C").contains("ends before the type"));
    assert!(message("g.aedat", b"#!AER-DAT2.0\r\n# nothing\r\n").contains("no chip that is known"));
    assert!(message("h.aedat4", b"#!AER-DAT4.0\r\n\x40\x00\x00\x00").contains("ends inside its header"));
    let missing = EventFile::open(&folder.0.path().join("none.raw")).unwrap_err();
    assert!(matches!(missing, EventFileError::Io { doing: "open", .. }), "{missing}");
}

/// A header of RAW with these lines in any encoding, before as many words.
fn with_lines(lines: &[&[u8]], mark: bool) -> Vec<u8> {
    let mut bytes = if mark { b"\xef\xbb\xbf".to_vec() } else { Vec::new() };
    for line in lines {
        bytes.extend([b"% ", *line, b"\n"].concat());
    }
    bytes
}

#[test]
fn headers_in_other_encodings_and_with_marks_are_read_to_their_end() {
    let folder = Folder::new();
    let foreign: [&[u8]; 4] =
        [b"operator Andr\xe9", b"pc_name Caf\xe9-PC\r", "lab Zürich µ".as_bytes(), b"note \x80 \xff"];
    let mut words = Vec::new();
    let mut encoder = Evt3Encoder::default();
    events().into_iter().for_each(|event| encoder.event(event, &mut words).unwrap());
    encoder.finish(&mut words);
    let mut items = b"\x0C\x08".to_vec();
    let mut encoder = DatEncoder::default();
    events().into_iter().for_each(|event| encoder.event(event, &mut items).unwrap());
    for (name, own, body) in [
        ("a.raw", &[&b"format EVT3;height=720;width=1280"[..]][..], &words),
        ("a.dat", &[&b"Version 2"[..], b"Width 1280", b"Height 720"], &items),
    ] {
        for line in foreign {
            for mark in [false, true] {
                for ends in [false, true] {
                    for before in [false, true] {
                        let mut lines = own.to_vec();
                        lines.insert(if before { 0 } else { lines.len() }, line);
                        if ends {
                            lines.push(b"end");
                        }
                        let bytes = [with_lines(&lines, mark), body.clone()].concat();
                        let (file, columns, anomalies) = read(&folder.write(name, &bytes));
                        assert_eq!(
                            columns.iter().collect::<Vec<_>>(),
                            events(),
                            "{name} {line:?} {mark} {ends} {before}"
                        );
                        assert!(file.size == Some(SIZE) && anomalies.is_empty());
                    }
                }
            }
        }
    }
    let aedat2 =
        [&b"\xef\xbb\xbf#!AER-DAT2.0\r\n# Andr\xe9\r\n# AEChip: DVS128\r\n"[..], &[0, 0, 0, 3, 0, 0, 0, 9]].concat();
    let (_, columns, _) = read(&folder.write("a.aedat", &aedat2));
    assert_eq!(columns.t_us, [9]);
}

#[test]
fn a_header_of_dat_and_its_items_may_not_contradict_each_other() {
    let folder = Folder::new();
    let pixels: Vec<(u16, u16, bool)> = (0..60_u16).map(|n| (n * 5, n * 4, n % 3 == 0)).collect();
    let body = |version: u8| {
        let mut bytes = b"\x00\x08".to_vec();
        for (t, &(x, y, on)) in (0_u32..).zip(&pixels) {
            let [x, y, on] = [x.into(), y.into(), u32::from(on)];
            let packed = if version == 1 { on << 17 | y << 9 | x } else { on << 28 | y << 14 | x };
            bytes.extend([t.to_le_bytes(), packed.to_le_bytes()].concat());
        }
        bytes
    };
    let file = |declared: &str, version| {
        [format!("{declared}% Width 304\n% Height 240\n% end\n").into_bytes(), body(version)].concat()
    };
    for version in [1, 2] {
        for declared in [String::new(), format!("% Version {version}\n")] {
            let (read, columns, anomalies) = read(&folder.write("a.dat", &file(&declared, version)));
            let found: Vec<_> = columns.iter().map(|event| (event.x, event.y, event.on)).collect();
            assert_eq!((found, read.format.name()), (pixels.clone(), if version == 1 { "dat1" } else { "dat2" }));
            assert!(anomalies.is_empty());
        }
        let wrong = format!("% Version {}\n", 3 - version);
        let message = EventFile::open(&folder.write("b.dat", &file(&wrong, version))).unwrap_err().to_string();
        assert!(message.contains(&format!("correct the line to `% Version {version}`")), "{message}");
    }
    let message = EventFile::open(&folder.write("c.dat", b"% Width many\n% end\n\x0C\x08")).unwrap_err().to_string();
    assert!(message.contains("Width `many`"), "{message}");
    let opened = EventFile::open(&folder.write("d.raw", b"% evt 2.0\n% format EVT3;height=7;width=9\n% end\n"));
    assert!(opened.unwrap_err().to_string().contains("its line `evt` 2.0"));
    EventFile::open(&folder.write("e.raw", b"% evt 2.1\n% format EVT21;height=7;width=9\n% end\n")).unwrap();
}

#[test]
fn files_of_others_are_named_with_what_converts_them() {
    let folder = Folder::new();
    for (start, words) in [
        (&b"#!AER-DAT3.1\r\n#Format: RAW\r\n"[..], "AEDAT 3"),
        (b"#!AER-DAT1.0\r\n", "AEDAT 1"),
        (b"#ROSBAG V2.0\n", "rosbags-convert"),
        (b"\x28\xb5\x2f\xfd....", "zstd -d"),
        (b"\x1f\x8b\x08\x00", "gunzip"),
    ] {
        let message = EventFile::open(&folder.write("a.bin", start)).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
}
