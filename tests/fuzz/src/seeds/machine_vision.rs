//! What USB3 Vision cameras send, made from the protocol: answers, streams, and a camera's whole memory.

use std::io::{Cursor, Write as _};

use zip::{ZipWriter, write::SimpleFileOptions};

use super::Seeds;

pub fn put(seeds: &mut Seeds) {
    answers(seeds);
    streams(seeds);
    for zipped in [false, true] {
        seeds.put("u3vcamera", &camera(XML, zipped));
    }
    // Of a short description more is left when some bytes are changed.
    for names in PARTS {
        seeds.put("u3vcamera", &camera(&part(names), false));
    }
}

fn halves(halves: &[u16]) -> Vec<u8> {
    halves.iter().flat_map(|half| half.to_le_bytes()).collect()
}

fn words(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// A read of 8 bytes and a write of 8, done, refused, put off and answered by another number.
fn answers(seeds: &mut Seeds) {
    for (command, reply, data) in
        [(0, 0x0801, &[1, 2, 3, 4, 5, 6, 7, 8][..]), (1, 0x0803, &[0, 0, 8, 0]), (1, 0x0803, &[])]
    {
        for (status, kind, id, data) in
            [(0, reply, 5, data), (0x8006, reply, 5, &[]), (0, 0x0805, 5, &[0, 0, 30, 0]), (0, reply, 4, data)]
        {
            let head = [command, 5, 0, 8, 0];
            let header = halves(&[status, kind, data.len() as u16, id]);
            seeds.put("gencp", &[&head, &b"U3VC"[..], &header, data].concat());
        }
    }
}

fn leader(id: u64, kind: u16) -> Vec<u8> {
    let image = words(&[0x0108_0001, 60, 50, 0, 0, 0]);
    [&b"U3VL\0\0\x34\0"[..], &id.to_le_bytes(), &halves(&[0, kind]), &(1000 * id).to_le_bytes(), &image].concat()
}

fn trailer(id: u64, status: u16, valid: u64) -> Vec<u8> {
    [&b"U3VT\0\0\x20\0"[..], &id.to_le_bytes(), &halves(&[status, 0]), &valid.to_le_bytes(), &words(&[50])].concat()
}

/// A payload of 3024 bytes; with chunks, the image and the number of the frame behind it.
fn payload(id: u64, chunks: bool) -> Vec<u8> {
    let mut bytes: Vec<u8> = (0..3024).map(|at| (at * 7 + id as usize) as u8).collect();
    if chunks {
        bytes.truncate(3000);
        bytes.extend(words(&[0x1000, 3000]));
        bytes.extend(id.to_le_bytes());
        bytes.extend(words(&[0x1003, 8]));
    }
    bytes
}

/// Three blocks with transfers of 1024 and of 2048 bytes, with chunks and without; the same with parts that do not come; and 20 that nobody
/// takes.
fn streams(seeds: &mut Seeds) {
    let block = |id: u64, chunks: bool, transfer: usize| {
        let payload = payload(id, chunks);
        let mut transfers = vec![leader(id, if chunks { 0x4001 } else { 1 })];
        transfers.extend(payload.chunks(transfer).map(<[u8]>::to_vec));
        transfers.push(trailer(id, 0, payload.len() as u64));
        transfers
    };
    let stream = |transfers: &[Vec<u8>], taken: u16| {
        let mut bytes = [&3024_u16.to_le_bytes()[..], &[128]].concat();
        for transfer in transfers {
            bytes.extend((transfer.len() as u16 | taken).to_le_bytes());
            bytes.extend(transfer);
        }
        bytes
    };
    for (chunks, transfer) in [(false, 1024), (true, 2048)] {
        let blocks = [7, 8, 9].map(|id| block(id, chunks, transfer));
        seeds.put("u3vstream", &stream(&blocks.concat(), 1 << 14));
        for lost in 0..blocks[1].len() {
            let mut blocks = blocks.clone();
            blocks[1].remove(lost);
            seeds.put("u3vstream", &stream(&blocks.concat(), 1 << 14));
        }
        seeds.put("u3vstream", &stream(&[&blocks[0][..], &blocks[2]].concat(), 1 << 14));
    }
    let refused = [leader(1, 1), payload(1, false)[..500].to_vec(), trailer(1, 0xa101, 500)];
    seeds.put("u3vstream", &stream(&refused, 1 << 14 | 1 << 15));
    let small: Vec<Vec<u8>> = (0..20).flat_map(|id| [leader(id, 1), vec![1; 100], trailer(id, 0, 100)]).collect();
    seeds.put("u3vstream", &stream(&small, 0));
}

/// Where everything lies in a camera's memory.
const SBRM: u64 = 0x200;
const SIRM: u64 = 0x260;
const MANIFEST: u64 = 0x2a0;
const FEATURES: u64 = 0x300;
const DESCRIPTION: u64 = 0x400;

fn camera(xml: &str, zipped: bool) -> Vec<u8> {
    let description = if zipped { archive(xml) } else { xml.as_bytes().to_vec() };
    // With zeros behind a text, there is room for what changes put into it.
    let room = if zipped { 0 } else { 512 };
    let mut memory = vec![0; DESCRIPTION as usize];
    let mut put = |at: u64, bytes: &[u8]| memory[at as usize..at as usize + bytes.len()].copy_from_slice(bytes);
    for (at, text) in [(0x004, "Maker"), (0x044, "Model"), (0x144, "0042"), (0x184, "left")] {
        put(at, text.as_bytes());
    }
    for (at, word) in [
        (0x000, 0x0001_0001_u32),
        (0x1cc, 100),
        (SBRM + 0x14, 1024),
        (SBRM + 0x18, 1024),
        (SBRM + 0x1c, 1),
        (SIRM, 10 << 24),
        (SIRM + 0x10, 52),
        (SIRM + 0x14, 32),
        (MANIFEST + 8, 0x0100_0000),
        (MANIFEST + 12, 1 << 24 | 1 << 16 | u32::from(zipped) << 10),
    ] {
        put(at, &word.to_le_bytes());
    }
    for (at, double) in [
        (0x1c4, 0x309_u64),
        (0x1d0, MANIFEST),
        (0x1d8, SBRM),
        (SBRM + 0x04, 1),
        (SBRM + 0x20, SIRM),
        (SIRM + 0x08, 3072),
        (MANIFEST, 1),
        (MANIFEST + 16, DESCRIPTION),
        (MANIFEST + 24, description.len() as u64 + room),
    ] {
        put(at, &double.to_le_bytes());
    }
    for (index, word) in [64_u32, 0x0108_0001, 2000, 1, 0x41a0_0000].into_iter().enumerate() {
        put(FEATURES + 4 * index as u64, &word.to_le_bytes());
    }
    [memory, description].concat()
}

fn archive(text: &str) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("camera.xml", SimpleFileOptions::default()).unwrap();
    zip.write_all(text.as_bytes()).unwrap();
    zip.finish().unwrap().into_inner()
}

/// The description with these nodes alone.
fn part(names: &[&str]) -> String {
    let is_kept = |line: &str| {
        let mut kept = names.iter().chain(&["Device"]);
        !line.contains(" Name=") || kept.any(|name| line.contains(&format!(" Name=\"{name}\"")))
    };
    XML.split_inclusive('\n').filter(|line| is_kept(line)).collect()
}

/// Nodes of [`XML`] that do without the others.
const PARTS: [&[&str]; 5] = [
    &["Width", "WidthReg", "WidthMax", "Bits"],
    &["PixelFormat", "PixelReg", "Bits"],
    &["ExposureTime", "ExposureRaw", "ExposureReg", "WidthReg", "Gain", "GainConverter", "GainRaw"],
    &["GammaEnable", "Bits", "TriggerMode", "AcquisitionStart"],
    &["DeviceModelName", "DeviceTemperature", "ChunkFrameID", "ChunkReg", "ChunkPort"],
];

/// A node of each kind that cameras have.
const XML: &str = r#"<RegisterDescription ModelName="M" VendorName="V" SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0">
<Category Name="Root"><pFeature>Width</pFeature><pFeature>Gain</pFeature></Category>
<StringReg Name="DeviceModelName"><Address>0x44</Address><Length>64</Length><AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>
<Integer Name="Width"><pIsLocked>Bits</pIsLocked><pValue>WidthReg</pValue><Min>16</Min><pMax>WidthMax</pMax><Inc>4</Inc></Integer>
<IntReg Name="WidthReg"><Address>0x300</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></IntReg>
<IntSwissKnife Name="WidthMax"><pVariable Name="W">WidthReg</pVariable><Formula>(W &gt; 8) ? W * 10 : 640</Formula></IntSwissKnife>
<Enumeration Name="PixelFormat"><EnumEntry Name="Mono8"><Value>17301505</Value></EnumEntry><EnumEntry Name="Mono12"><pIsAvailable>Bits</pIsAvailable><Value>17825797</Value></EnumEntry><pValue>PixelReg</pValue></Enumeration>
<IntReg Name="PixelReg"><Address>0x304</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></IntReg>
<Float Name="ExposureTime"><pValue>ExposureRaw</pValue><Unit>us</Unit></Float>
<Integer Name="ExposureRaw"><pValue>ExposureReg</pValue><Min>10</Min><Max>100000</Max></Integer>
<IntReg Name="ExposureReg"><Address>0x308</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><pInvalidator>WidthReg</pInvalidator><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></IntReg>
<Float Name="Gain"><pValue>GainConverter</pValue></Float>
<Converter Name="GainConverter"><FormulaTo>FROM * 10</FormulaTo><FormulaFrom>TO / 10</FormulaFrom><pValue>GainRaw</pValue><Slope>Increasing</Slope></Converter>
<IntConverter Name="GainRaw"><FormulaTo>FROM + 1</FormulaTo><FormulaFrom>TO - 1</FormulaFrom><pValue>ExposureRaw</pValue></IntConverter>
<Boolean Name="GammaEnable"><pValue>Bits</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>
<MaskedIntReg Name="Bits"><Address>0x30c</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><LSB>3</LSB><MSB>1</MSB><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></MaskedIntReg>
<StructReg Comment="s"><Address>0x30c</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Endianess>LittleEndian</Endianess><StructEntry Name="TriggerMode"><Bit>4</Bit></StructEntry></StructReg>
<FloatReg Name="DeviceTemperature"><Address>0x310</Address><Length>4</Length><AccessMode>RO</AccessMode><pPort>Device</pPort><Endianess>LittleEndian</Endianess></FloatReg>
<Command Name="AcquisitionStart"><pValue>Bits</pValue><CommandValue>1</CommandValue></Command>
<Integer Name="ChunkFrameID"><pValue>ChunkReg</pValue></Integer>
<IntReg Name="ChunkReg"><Address>0</Address><Length>8</Length><AccessMode>RO</AccessMode><pPort>ChunkPort</pPort><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></IntReg>
<Port Name="ChunkPort"><ChunkID>1003</ChunkID></Port>
<Port Name="Device"/>
</RegisterDescription>
"#;
