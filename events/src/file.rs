//! Event files of any format.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

use super::{
    Aedat2Chip, Aedat2Decoder, Anomalies, CsvDecoder, DatDecoder, DatFormat, Decoder, RawHeader, SensorSize, Sink,
    StreamDecoder, TextColumns, TextLayout,
    es::{self, EsDecoder, EsKind},
    evt::BYTE_ORDER_MARK,
};
use crate::EventEncoding;
#[cfg(feature = "aedat4")]
use crate::aedat4::{AEDAT4_MAGIC, Aedat4Decoder, Aedat4Header, Aedat4Kind};

/// Bytes read at once.
const PIECE: usize = 1 << 20;

/// What can go wrong with an event file. Each message names the file and what to do.
#[derive(Debug, thiserror::Error)]
pub enum EventFileError {
    /// The file cannot be opened or read.
    #[error("cannot {doing} {} at byte {offset}: {source}", path.display())]
    Io {
        /// `open` or `read`.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// Why.
        source: io::Error,
    },
    /// The file's content is none of the formats.
    #[error(
        "{} is no event file that erfgs reads: {what}; formats are RAW (EVT 2, 2.1, 3), DAT, AEDAT 2 and 4, Event Stream, CSV and other text, NPZ, NPY, HDF5, MCAP and rosbag2",
        path.display()
    )]
    Unknown {
        /// The file.
        path: PathBuf,
        /// What was found.
        what: String,
    },
    /// The header is there and makes no sense.
    #[error("the header of {} is malformed at byte {offset}: {what}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What is wrong and what to do.
        what: String,
    },
    /// Columns were given of a file that is no text.
    #[error("{} is {format} and no text, so that it has no columns to name; leave --columns out", path.display())]
    NoText {
        /// The file.
        path: PathBuf,
        /// Its format.
        format: &'static str,
    },
    /// A line of text is not understood, or contradicts the others.
    #[error("line {line} of {}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Which line, from 1.
        line: u64,
        /// What is wrong and what to do.
        what: String,
    },
}

/// The format of an event file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "aedat4"), non_exhaustive)]
pub enum EventFormat {
    /// RAW with one of Prophesee's encodings.
    Raw(EventEncoding),
    /// DAT.
    Dat(DatFormat),
    /// AEDAT 2.
    Aedat2(Aedat2Chip),
    /// AEDAT 4.
    #[cfg(feature = "aedat4")]
    Aedat4,
    /// CSV and other text.
    Csv(TextLayout),
    /// Event Stream.
    Es(EsKind),
}

impl EventFormat {
    /// A short name: `evt3`, `dat2`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raw(EventEncoding::Evt2) => "evt2",
            Self::Raw(EventEncoding::Evt21) => "evt21",
            Self::Raw(EventEncoding::Evt21Legacy) => "evt21-legacy",
            Self::Raw(_) => "evt3",
            Self::Dat(format) if format.version == 1 => "dat1",
            Self::Dat(_) => "dat2",
            Self::Aedat2(_) => "aedat2",
            #[cfg(feature = "aedat4")]
            Self::Aedat4 => "aedat4",
            Self::Csv(_) => "csv",
            Self::Es(EsKind::Dvs) => "es",
            Self::Es(EsKind::Atis) => "es-atis",
        }
    }
}

/// What a user says of an event file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EventFileHints {
    /// Size of the sensor.
    pub size: Option<SensorSize>,
    /// What each column of a text is.
    pub columns: Option<TextColumns>,
}

/// An event file whose header was read.
#[derive(Clone, Debug)]
pub struct EventFile {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: EventFormat,
    /// Size of the sensor; `None` if the file does not say.
    pub size: Option<SensorSize>,
    /// What the header says, in the order of the file.
    pub header: Vec<(String, String)>,
    /// Where the events begin, bytes.
    pub body: u64,
    /// Length of the file, bytes.
    pub length: u64,
    /// The name of the file within the archive, if `path` is one.
    pub member: Option<String>,
}

impl EventFile {
    /// Looks at the beginning of the file and finds out what it is.
    ///
    /// # Errors
    /// If the file cannot be read or is none of the formats.
    pub fn open(path: &Path) -> Result<Self, EventFileError> {
        Self::open_with(path, &EventFileHints::default())
    }

    /// As [`EventFile::open`], with what the user says of the file, whatever it says itself.
    ///
    /// # Errors
    /// If the file cannot be read or is none of the formats, or is no text and has columns nevertheless.
    pub fn open_with(path: &Path, hints: &EventFileHints) -> Result<Self, EventFileError> {
        let mut file = Self::recognised(path, hints.columns)?;
        if hints.columns.is_some() && !matches!(file.format, EventFormat::Csv(_)) {
            return Err(EventFileError::NoText { path: path.to_owned(), format: file.format.name() });
        }
        file.size = hints.size.or(file.size);
        Ok(file)
    }

    fn recognised(path: &Path, columns: Option<TextColumns>) -> Result<Self, EventFileError> {
        let io = |doing| move |source| EventFileError::Io { doing, path: path.to_owned(), offset: 0, source };
        erfgs_base::regular::check(path).map_err(io("open"))?;
        let mut file = File::open(path).map_err(io("open"))?;
        let length = file.metadata().map_err(io("open"))?.len();
        let mut head = Vec::new();
        (&mut file).take(RawHeader::MAX_BYTES as u64).read_to_end(&mut head).map_err(io("read"))?;
        let unknown = |what: &str| EventFileError::Unknown { path: path.to_owned(), what: what.to_owned() };
        if head.is_empty() {
            return Err(unknown("it is empty"));
        }
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let extension = extension.to_ascii_lowercase();
        #[cfg_attr(not(feature = "npz"), expect(unused_mut, reason = "only archives have members"))]
        let mut member = None;
        let (format, size, header, body) = match &head[..] {
            // Whatever its name says, text has columns.
            _ if columns.is_some() && !head.contains(&0) => text(path, &head, columns)?,
            _ if extension == "dat" => dat(path, &head)?,
            _ if is_raw(&head, &extension) => raw(path, &head)?,
            _ if head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&head).starts_with(b"#!AER-DAT2.0") => {
                aedat2(path, &mut file, head)?
            }
            #[cfg(not(feature = "aedat4"))]
            _ if head.starts_with(b"#!AER-DAT4.") => {
                return Err(unknown("it is AEDAT 4, without which erfgs-events was built (feature `aedat4`)"));
            }
            #[cfg(feature = "aedat4")]
            _ if head.starts_with(AEDAT4_MAGIC) => aedat4(path, &mut file, head)?,
            _ if head.starts_with(es::MAGIC) => {
                let (kind, size, body) = es::parse_header(&head).map_err(|(at, what)| malformed(path, at, what))?;
                (EventFormat::Es(kind), Some(size), Vec::new(), body)
            }
            #[cfg(feature = "npz")]
            _ if head.starts_with(b"PK\x03\x04") => {
                let (name, start) = crate::archive::text_in(path).map_err(|what| unknown(&what))?;
                member = Some(name);
                text(path, &start, columns)?
            }
            _ if extension == "csv" || extension == "txt" && TextLayout::is_likely(&head) => {
                text(path, &head, columns)?
            }
            _ => return Err(unknown(foreign(&head).unwrap_or("its first bytes are those of no format"))),
        };
        let size = size.map(SensorSize::checked).transpose().map_err(|wrong| malformed(path, 0, wrong))?;
        Ok(Self { path: path.to_owned(), format, size, header, body: body as u64, length, member })
    }

    /// A decoder of the file's body.
    #[must_use]
    pub fn decoder(&self) -> StreamDecoder {
        match self.format {
            EventFormat::Raw(encoding) => StreamDecoder::new(encoding, self.size),
            EventFormat::Dat(format) => StreamDecoder::Dat(DatDecoder::new(DatFormat { size: self.size, ..format })),
            EventFormat::Aedat2(chip) => StreamDecoder::Aedat2(Aedat2Decoder::new(chip)),
            #[cfg(feature = "aedat4")]
            EventFormat::Aedat4 => StreamDecoder::Aedat4(Aedat4Decoder::new()),
            EventFormat::Csv(layout) => StreamDecoder::Csv(CsvDecoder::of(layout, self.size)),
            EventFormat::Es(kind) => {
                let size = self.size.unwrap_or(SensorSize { width: u16::MAX, height: u16::MAX });
                StreamDecoder::Es(EsDecoder::new(kind, size))
            }
        }
    }

    /// Decodes the file piece by piece; see [`EventFile::decode_while`].
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn decode(&self, sink: &mut impl Sink) -> Result<Anomalies, EventFileError> {
        self.decode_while(sink, |_| true)
    }

    /// Decodes the file piece by piece, as long as `go_on`, which is told the bytes read so far, says so. A file
    /// that was cut short gives what is there, and [`Anomalies::truncated_bytes`].
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn decode_while(
        &self,
        sink: &mut impl Sink,
        mut go_on: impl FnMut(u64) -> bool,
    ) -> Result<Anomalies, EventFileError> {
        #[cfg(feature = "npz")]
        if let Some(member) = &self.member {
            return crate::archive::decode(self, member, sink, go_on);
        }
        let mut offset = self.body;
        let io = |doing, offset| move |source| EventFileError::Io { doing, path: self.path.clone(), offset, source };
        let mut file = File::open(&self.path).map_err(io("open", 0))?;
        file.seek(SeekFrom::Start(self.body)).map_err(io("read", offset))?;
        let mut decoder = self.decoder();
        let mut piece = vec![0; PIECE];
        loop {
            let count = match file.read(&mut piece) {
                Ok(0) => break,
                Ok(count) => count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(io("read", offset)(error)),
            };
            decoder.decode(&piece[..count], sink);
            self.check(&decoder)?;
            offset += count as u64;
            if !go_on(offset - self.body) {
                break;
            }
        }
        decoder.finish(sink);
        self.check(&decoder)?;
        Ok(decoder.anomalies())
    }

    /// Refuses a text that contradicts itself.
    pub(super) fn check(&self, decoder: &StreamDecoder) -> Result<(), EventFileError> {
        let StreamDecoder::Csv(decoder) = decoder else { return Ok(()) };
        decoder.contradiction().map_or(Ok(()), |wrong| Err(line(&self.path, wrong)))
    }
}

type Head = (EventFormat, Option<SensorSize>, Vec<(String, String)>, usize);

fn malformed(path: &Path, offset: usize, what: impl Into<String>) -> EventFileError {
    EventFileError::Header { path: path.to_owned(), offset: offset as u64, what: what.into() }
}

/// Whether a file begins as RAW does. Text may have comments of that kind, which name no encoding.
fn is_raw(head: &[u8], extension: &str) -> bool {
    let start = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(head);
    let is_text = matches!(extension, "csv" | "txt") && RawHeader::parse(head).0.format().is_none();
    start.starts_with(b"% ") && !is_text
}

/// What a file is that others read and erfgs does not, and what makes one of it that is read.
fn foreign(head: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 6] = [
        (b"#!AER-DAT3", "it is AEDAT 3, which is not read; convert it to AEDAT 4 with DV or to AEDAT 2 with jAER"),
        (b"#!AER-DAT1", "it is AEDAT 1, which is not read; convert it to AEDAT 2 with jAER"),
        (
            b"#!AER-DAT",
            "it is AEDAT of a version that is not read; convert it to AEDAT 4 with DV or to AEDAT 2 with jAER",
        ),
        (b"#ROSBAG V", "it is a bag of ROS 1, which is not read; convert it: rosbags-convert --src FILE --dst FOLDER"),
        (b"\x28\xb5\x2f\xfd", "it is compressed by Zstandard, as rosbag2 does it; unpack it first: zstd -d FILE"),
        (b"\x1f\x8b", "it is compressed by gzip; unpack it first: gunzip FILE"),
    ];
    KNOWN.into_iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, what)| what)
}

/// Text says at its beginning how it is laid out.
fn text(path: &Path, head: &[u8], columns: Option<TextColumns>) -> Result<Head, EventFileError> {
    let layout = TextLayout::of(head, head.len() < RawHeader::MAX_BYTES, columns).map_err(|wrong| line(path, wrong))?;
    Ok((EventFormat::Csv(layout), layout.size(), Vec::new(), layout.body()))
}

fn line(path: &Path, (line, what): (u64, impl Into<String>)) -> EventFileError {
    EventFileError::Line { path: path.to_owned(), line, what: what.into() }
}

fn raw(path: &Path, head: &[u8]) -> Result<Head, EventFileError> {
    let (header, body) = RawHeader::parse(head);
    // Some programs name DAT files otherwise: their header has a version of its own and no encoding.
    if header.get("Version").is_some() && header.get("evt").is_none() && header.get("format").is_none() {
        return dat(path, head);
    }
    if let Some((format, evt)) = header.contradiction() {
        let what = format!("its line `format` says {format}, its line `evt` {evt}; remove the one that is wrong");
        return Err(malformed(path, 0, what));
    }
    let format = header.format().ok_or_else(|| {
        let what = "it names no encoding that is read; put a line `% format EVT3;height=720;width=1280` (or EVT2, EVT21 \
                    and the sensor's size) first";
        malformed(path, 0, what)
    })?;
    Ok((EventFormat::Raw(format.encoding), format.size, header.fields, body))
}

fn dat(path: &Path, head: &[u8]) -> Result<Head, EventFileError> {
    let (format, header, body) = DatFormat::parse(head).map_err(|(offset, what)| malformed(path, offset, what))?;
    Ok((EventFormat::Dat(format), format.size, header.fields, body))
}

/// jAER writes all of its preferences into the header: the longest that is read.
const AEDAT2_HEADER_MOST: usize = 16 << 20;

fn aedat2(path: &Path, file: &mut File, mut head: Vec<u8>) -> Result<Head, EventFileError> {
    let (chip, header, body) = loop {
        let parsed = Aedat2Chip::parse(&head);
        // A line that is not over may go on in what was not read yet.
        let is_over = head.get(parsed.2).is_some_and(|&byte| byte != b'#');
        if is_over {
            break parsed;
        }
        let offset = head.len();
        if offset > AEDAT2_HEADER_MOST {
            return Err(malformed(path, 0, format!("its header does not end within {AEDAT2_HEADER_MOST} bytes")));
        }
        let more = file.take(offset as u64).read_to_end(&mut head).map_err(|source| EventFileError::Io {
            doing: "read",
            path: path.to_owned(),
            offset: offset as u64,
            source,
        })?;
        if more == 0 {
            break parsed;
        }
    };
    let chip = chip.ok_or_else(|| {
        let what = "it names no chip that is known; add a line `# AEChip: eu.seebetter.ini.chips.davis.Davis346B` (or \
                    DAVIS240C, DVS128) after the first";
        malformed(path, 0, what)
    })?;
    Ok((EventFormat::Aedat2(chip), Some(chip.size()), header, body))
}

/// The decoder of AEDAT 4 reads the header itself; here it is read to find what is wrong with it.
#[cfg(feature = "aedat4")]
fn aedat4(path: &Path, file: &mut File, mut head: Vec<u8>) -> Result<Head, EventFileError> {
    let needs = Aedat4Header::needs(&head).unwrap_or(0);
    let missing = needs.saturating_sub(head.len()) as u64;
    let offset = head.len() as u64;
    file.take(missing).read_to_end(&mut head).map_err(|source| EventFileError::Io {
        doing: "read",
        path: path.to_owned(),
        offset,
        source,
    })?;
    let header = Aedat4Header::parse(&head).map_err(|what| malformed(path, AEDAT4_MAGIC.len(), what))?;
    let mut fields = vec![("compression".to_owned(), format!("{:?}", header.compression).to_ascii_lowercase())];
    for stream in &header.streams {
        let kind = stream.kind.map_or("unknown".to_owned(), |kind| format!("{kind:?}").to_ascii_lowercase());
        fields.push((format!("stream {}", stream.id), format!("{kind} {}", stream.source)));
    }
    let size = |kind| header.stream(kind).and_then(|stream| stream.size);
    Ok((EventFormat::Aedat4, size(Aedat4Kind::Events).or(size(Aedat4Kind::Frames)), fields, 0))
}
