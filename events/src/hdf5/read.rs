//! Reading, with libhdf5.

use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, plausible::INSTANT};
use hdf5::{
    Dataset, H5Type, Location,
    datatype::ByteOrder,
    filters::Filter,
    types::{IntSize, TypeDescriptor, VarLenAscii, VarLenUnicode},
};

use super::{Hdf5Error, Hdf5Layout, blosc, checks, ecf};
use crate::{Anomalies, CdEvent, Edge, EventBatch, SensorSize, Sink};

/// Events read at once.
const PIECE: usize = 1 << 18;

/// A file that is open for reading.
#[derive(Debug)]
pub struct Hdf5File {
    path: PathBuf,
    file: hdf5::File,
    layout: Hdf5Layout,
    size: Option<SensorSize>,
}

/// Looks at a file and finds out how its events are laid out.
///
/// # Errors
/// If it cannot be read, or holds no events in a layout that is known.
pub fn open(path: &Path) -> Result<Hdf5File, Hdf5Error> {
    // The library does not say why a file cannot be opened.
    File::open(path).map_err(FileError::when("read", path))?;
    let file = hdf5::File::open(path).map_err(|error| library(path, "read", error))?;
    let refused = |what: String| Hdf5Error::Layout { path: path.to_owned(), what };
    let (layout, size) = if file.link_exists("CD") && file.link_exists("CD/events") {
        let size = text(&file, "geometry").map(|text| checks::geometry(&text)).transpose().map_err(refused)?;
        (Hdf5Layout::Metavision, size)
    } else if file.link_exists("events") && file.group("events").is_ok() {
        let events = file.group("events").map_err(|error| library(path, "read /events of", error))?;
        let names = events.member_names().unwrap_or_default();
        if !names.iter().any(|name| name == "t") {
            return Err(refused(format!("in /events are: {}", names.join(", "))));
        }
        checks::times(&file, &events).map_err(refused)?;
        let side = |name: &str| -> Result<Option<u16>, Hdf5Error> {
            let Ok(attribute) = events.attr(name) else { return Ok(None) };
            let value = attribute.read_scalar::<i64>().ok().and_then(|side| u16::try_from(side).ok());
            let wrong = || refused(format!("the attribute {name} of /events is no number of pixels"));
            value.filter(|&side| side > 0).map(Some).ok_or_else(wrong)
        };
        let size = match (side("width")?, side("height")?) {
            (Some(width), Some(height)) => Some(SensorSize { width, height }),
            (None, None) => None,
            _ => return Err(refused("of the attributes width and height of /events one is missing".into())),
        };
        (Hdf5Layout::Dsec, size)
    } else {
        let found = file.member_names().unwrap_or_default().join(", ");
        return Err(refused(format!("at its root are: {found}")));
    };
    let size = size.map(SensorSize::checked).transpose().map_err(|wrong| refused(wrong.to_string()))?;
    Ok(Hdf5File { path: path.to_owned(), file, layout, size })
}

fn library(path: &Path, doing: &str, error: hdf5::Error) -> Hdf5Error {
    Hdf5Error::Library { doing: doing.to_owned(), path: path.to_owned(), what: error.to_string() }
}

/// An attribute that is a text.
pub(super) fn text(of: &Location, name: &str) -> Option<String> {
    let attribute = of.attr(name).ok()?;
    let unicode = attribute.read_scalar::<VarLenUnicode>().map(|text| text.as_str().to_owned());
    unicode.or_else(|_| attribute.read_scalar::<VarLenAscii>().map(|text| text.as_str().to_owned())).ok()
}

/// An event as Metavision writes it.
#[derive(Clone, Copy, Debug, H5Type)]
#[repr(C)]
struct MetavisionEvent {
    x: u16,
    y: u16,
    p: i16,
    t: i64,
}

/// An edge as Metavision writes it.
#[derive(Clone, Copy, Debug, H5Type)]
#[repr(C)]
struct MetavisionEdge {
    p: i16,
    t: i64,
    id: i16,
}

impl Hdf5File {
    /// How its events are laid out.
    #[must_use]
    pub fn layout(&self) -> Hdf5Layout {
        self.layout
    }

    /// Size of the sensor, where the file says it.
    #[must_use]
    pub fn size(&self) -> Option<SensorSize> {
        self.size
    }

    /// Decodes all events and edges. Events outside of `size` (or of what the file says, or of 65535 x 65535) are counted and
    /// skipped; so are those before time zero ([`Anomalies::undated`]).
    ///
    /// # Errors
    /// If the file cannot be read, its columns differ in length, or a filter is not supported.
    pub fn decode(&self, size: Option<SensorSize>, sink: &mut impl Sink) -> Result<Anomalies, Hdf5Error> {
        let size = size.or(self.size).unwrap_or(SensorSize { width: u16::MAX, height: u16::MAX });
        let mut gather =
            Gather { size, anomalies: Anomalies::default(), last_us: 0, events: Vec::new(), at: 0, wrong: None };
        match self.layout {
            Hdf5Layout::Dsec => self.dsec(&mut gather, sink)?,
            Hdf5Layout::Metavision => self.metavision(&mut gather, sink)?,
        }
        match gather.wrong {
            Some((event, what)) => Err(self.refused(format!("its event {event} {what}"))),
            None => Ok(gather.anomalies),
        }
    }

    fn dataset(&self, name: &str) -> Result<Dataset, Hdf5Error> {
        self.file.dataset(name).map_err(|error| library(&self.path, &format!("read {name} of"), error))
    }

    fn refused(&self, what: String) -> Hdf5Error {
        Hdf5Error::Layout { path: self.path.clone(), what }
    }

    fn dsec(&self, gather: &mut Gather, sink: &mut impl Sink) -> Result<(), Hdf5Error> {
        let offset = if self.file.link_exists("t_offset") {
            let dataset = self.dataset("t_offset")?;
            let failed = |error| library(&self.path, "read t_offset of", error);
            let kind = dataset.dtype().and_then(|kind| kind.to_descriptor()).map_err(failed)?;
            let is_whole = matches!(kind, TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_));
            if !is_whole || dataset.size() != 1 {
                return Err(self.refused(format!(
                    "t_offset holds {} of {kind}, and one integer in microseconds is needed",
                    dataset.size()
                )));
            }
            dataset.read_raw::<i64>().map_err(failed)?.first().copied().unwrap_or(0)
        } else {
            0
        };
        let mut columns = Vec::new();
        for name in ["events/t", "events/x", "events/y", "events/p"] {
            columns.push(Column::new(self, name)?);
        }
        let lengths: Vec<usize> = columns.iter().map(|column| column.length).collect();
        if lengths.iter().any(|&length| length != lengths[0]) {
            let what = format!("the columns t, x, y, p have the lengths {lengths:?}");
            return Err(Hdf5Error::Layout { path: self.path.clone(), what });
        }
        for from in (0..lengths[0]).step_by(PIECE) {
            let to = lengths[0].min(from + PIECE);
            let mut fields = Vec::new();
            for column in &mut columns {
                fields.push(column.read(self, from, to)?);
            }
            let [t, x, y, p] = &fields[..] else { break };
            for ((&t, &x), (&y, &p)) in t.iter().zip(x).zip(y.iter().zip(p)) {
                gather.event(t.saturating_add(offset), x, y, p);
            }
            if !gather.flush(sink) {
                break;
            }
        }
        Ok(())
    }

    fn metavision(&self, gather: &mut Gather, sink: &mut impl Sink) -> Result<(), Hdf5Error> {
        let dataset = self.dataset("CD/events")?;
        let refused = |what| self.refused(what);
        if dataset.ndim() != 1 {
            return Err(self.refused(format!("CD/events has the shape {:?}, but one axis is needed", dataset.shape())));
        }
        checks::fields("CD/events", &dataset, &["x", "y", "p", "t"]).map_err(refused)?;
        checks::stored("CD/events", &dataset).map_err(refused)?;
        let filters = dataset.filters();
        if filters.len() == 1 && filters[0].id() == ecf::FILTER {
            let mut chunks = Chunks::new(self, "CD/events", &dataset)?;
            let length = dataset.size();
            for (index, from) in (0..length).step_by(chunks.length).enumerate() {
                let events = match chunks.packed(self, index)? {
                    (bytes, true) => ecf::unpack(&bytes),
                    (_, false) => Err("it is stored without the filter ECF, which is not read".to_owned()),
                };
                let events = events.map_err(|what| chunks.error(self, index, what))?;
                let wanted = chunks.length.min(length - from);
                if events.len() < wanted {
                    return Err(chunks.error(self, index, format!("it holds {} events of {wanted}", events.len())));
                }
                for CdEvent { t_us, x, y, on } in events.into_iter().take(wanted) {
                    gather.event(i64::try_from(t_us).unwrap_or(i64::MAX), x.into(), y.into(), on.into());
                }
                if !gather.flush(sink) {
                    return Ok(());
                }
            }
        } else {
            for from in (0..dataset.size()).step_by(PIECE) {
                let to = dataset.size().min(from + PIECE);
                let events = dataset
                    .read_slice_1d::<MetavisionEvent, _>(from..to)
                    .map_err(|error| library(&self.path, "read CD/events of", error))?;
                for MetavisionEvent { x, y, p, t } in events {
                    gather.event(t, x.into(), y.into(), p.into());
                }
                if !gather.flush(sink) {
                    return Ok(());
                }
            }
        }
        if self.file.link_exists("EXT_TRIGGER") && self.file.link_exists("EXT_TRIGGER/events") {
            let dataset = self.dataset("EXT_TRIGGER/events")?;
            checks::fields("EXT_TRIGGER/events", &dataset, &["p", "t", "id"]).map_err(refused)?;
            checks::stored("EXT_TRIGGER/events", &dataset).map_err(refused)?;
            let edges = dataset.read_raw::<MetavisionEdge>();
            for edge in edges.map_err(|error| library(&self.path, "read EXT_TRIGGER/events of", error))? {
                match (u64::try_from(edge.t), u8::try_from(edge.id)) {
                    (Ok(t_us), Ok(channel)) => sink.edge(Edge { t_us, channel, rising: edge.p > 0 }),
                    (Err(_), _) => gather.anomalies.undated += 1,
                    (_, Err(_)) => gather.anomalies.unknown += 1,
                }
            }
        }
        Ok(())
    }
}

/// Events on their way to the sink.
struct Gather {
    size: SensorSize,
    anomalies: Anomalies,
    last_us: u64,
    events: Vec<CdEvent>,
    /// How many there were.
    at: u64,
    /// The first event that cannot be, and why; none after it is taken.
    wrong: Option<(u64, String)>,
}

impl Gather {
    /// Polarities are 1 and 0, or 1 and -1.
    fn event(&mut self, t_us: i64, x: i64, y: i64, p: i64) {
        self.at += 1;
        let time = INSTANT.check(t_us as f64 * 1e-6).map_err(String::from);
        let wrong = match (time, p) {
            (Err(what), _) => format!("has a time that no clock has, taken for microseconds: {what}"),
            (Ok(_), -1..=1) => String::new(),
            (Ok(_), p) => format!("has the polarity {p}: 1 is ON, and 0 or -1 is OFF"),
        };
        if !wrong.is_empty() {
            self.wrong.get_or_insert((self.at - 1, wrong));
            return;
        }
        let on = p > 0;
        let Ok(t_us) = u64::try_from(t_us) else {
            self.anomalies.undated += 1;
            return;
        };
        match (u16::try_from(x), u16::try_from(y)) {
            (Ok(x), Ok(y)) if x < self.size.width && y < self.size.height => {
                self.anomalies.time_backward += u64::from(t_us < self.last_us);
                self.last_us = t_us;
                self.events.push(CdEvent { t_us, x, y, on });
            }
            _ => self.anomalies.outside += 1,
        }
    }

    /// Hands over what there is; `false` once an event cannot be.
    fn flush(&mut self, sink: &mut impl Sink) -> bool {
        if self.wrong.is_some() {
            return false;
        }
        let column = |field: fn(&CdEvent) -> u16| self.events.iter().map(field).collect::<Vec<_>>();
        let (x, y) = (column(|event| event.x), column(|event| event.y));
        let t_us: Vec<u64> = self.events.iter().map(|event| event.t_us).collect();
        let on: Vec<bool> = self.events.iter().map(|event| event.on).collect();
        sink.events(EventBatch { t_us: &t_us, x: &x, y: &y, on: &on });
        self.events.clear();
        true
    }
}

/// The chunks of a dataset with one axis, as they lie in the file.
struct Chunks {
    name: String,
    dataset: Dataset,
    /// Elements of a chunk.
    length: usize,
    file: File,
}

impl Chunks {
    fn new(of: &Hdf5File, name: &str, dataset: &Dataset) -> Result<Self, Hdf5Error> {
        let file = File::open(&of.path).map_err(FileError::when("read", &of.path))?;
        match dataset.chunk().as_deref() {
            Some(&[length]) if length > 0 && of.file.userblock() == 0 => {
                Ok(Self { name: name.to_owned(), dataset: dataset.clone(), length, file })
            }
            _ => {
                let what = format!("{name} is not in chunks along one axis, or a block of the user's is before them");
                Err(Hdf5Error::Layout { path: of.path.clone(), what })
            }
        }
    }

    fn error(&self, of: &Hdf5File, chunk: usize, what: String) -> Hdf5Error {
        Hdf5Error::Chunk { path: of.path.clone(), dataset: self.name.clone(), chunk, what }
    }

    /// The bytes of a chunk before its one filter is undone, and whether it was applied: a filter that would have made the
    /// chunk longer may have been left out.
    fn packed(&mut self, of: &Hdf5File, index: usize) -> Result<(Vec<u8>, bool), Hdf5Error> {
        let info = self.dataset.chunk_info(index);
        let begins = (index * self.length) as u64;
        let Some(info) = info.filter(|info| info.offset == [begins]) else {
            return Err(self.error(of, index, "it is missing".to_owned()));
        };
        let mut bytes = Vec::new();
        let read = self.file.seek(SeekFrom::Start(info.addr));
        let read = read.and_then(|_| (&mut self.file).take(info.size).read_to_end(&mut bytes));
        read.map_err(FileError::when("read", &of.path))?;
        if bytes.len() as u64 == info.size {
            Ok((bytes, info.filter_mask & 1 == 0))
        } else {
            Err(self.error(of, index, "the file is cut short".to_owned()))
        }
    }
}

/// A column of integers.
struct Column {
    name: &'static str,
    dataset: Dataset,
    length: usize,
    /// Where its filter is one that the library lacks.
    unpacked: Option<Unpacked>,
}

/// A column that is unpacked here.
struct Unpacked {
    chunks: Chunks,
    /// The type of an element.
    kind: TypeDescriptor,
    /// The last chunk unpacked, and which it is.
    last: Option<(usize, Vec<i64>)>,
}

impl Column {
    fn new(of: &Hdf5File, name: &'static str) -> Result<Self, Hdf5Error> {
        let dataset = of.dataset(name)?;
        let layout = |what: String| Hdf5Error::Layout { path: of.path.clone(), what };
        let failed = |error| library(&of.path, &format!("read {name} of"), error);
        if dataset.ndim() != 1 {
            return Err(layout(format!("{name} has the shape {:?}, but one axis is needed", dataset.shape())));
        }
        let kind = dataset.dtype().and_then(|kind| Ok((kind.to_descriptor()?, kind.byte_order()))).map_err(failed)?;
        if !matches!(kind.0, TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_) | TypeDescriptor::Boolean) {
            return Err(layout(format!("{name} holds {} and no integers", kind.0)));
        }
        checks::stored(name, &dataset).map_err(layout)?;
        let filters = dataset.filters();
        let unpacked = match &filters[..] {
            [Filter::User(id, _)] if *id == blosc::FILTER => {
                if kind.1 == ByteOrder::BigEndian {
                    return Err(layout(format!("{name} is big-endian behind Blosc; `h5repack -f NONE` converts")));
                }
                Some(Unpacked { chunks: Chunks::new(of, name, &dataset)?, kind: kind.0, last: None })
            }
            filters => {
                if let Some(filter) = filters.iter().find(|filter| !filter.is_available()) {
                    let what = format!(
                        "{name} is compressed by the filter {}, which is not read; `h5repack -f GZIP=1` converts where its \
                         plugin is installed",
                        filter.id()
                    );
                    return Err(layout(what));
                }
                None
            }
        };
        Ok(Self { name, length: dataset.size(), dataset, unpacked })
    }

    /// The elements `from..to`. Numbers above those of `i64` become its largest.
    fn read(&mut self, of: &Hdf5File, from: usize, to: usize) -> Result<Vec<i64>, Hdf5Error> {
        let Some(Unpacked { chunks, kind, last }) = &mut self.unpacked else {
            let values = self.dataset.read_slice_1d::<i64, _>(from..to);
            let doing = format!("read {} of", self.name);
            return Ok(values.map_err(|error| library(&of.path, &doing, error))?.to_vec());
        };
        let mut values = Vec::with_capacity(to - from);
        while from + values.len() < to {
            let at = from + values.len();
            let index = at / chunks.length;
            if last.as_ref().is_none_or(|(found, _)| *found != index) {
                let (packed, filtered) = chunks.packed(of, index)?;
                let unpacked = if filtered { blosc::unpack(&packed) } else { Ok(packed) };
                let bytes = unpacked.map_err(|what| chunks.error(of, index, what))?;
                *last = Some((index, integers(&bytes, kind)));
            }
            let chunk = last.as_ref().map_or(&[][..], |(_, values)| values);
            let begin = at % chunks.length;
            let end = chunks.length.min(begin + to - at);
            let Some(part) = chunk.get(begin..end) else {
                return Err(chunks.error(of, index, format!("it holds {} values of {}", chunk.len(), chunks.length)));
            };
            values.extend_from_slice(part);
        }
        Ok(values)
    }
}

/// Little-endian integers of this type.
fn integers(bytes: &[u8], kind: &TypeDescriptor) -> Vec<i64> {
    fn all<const N: usize>(bytes: &[u8], value: impl Fn([u8; N]) -> i64) -> Vec<i64> {
        bytes.as_chunks::<N>().0.iter().map(|&bytes| value(bytes)).collect()
    }
    match kind {
        TypeDescriptor::Integer(IntSize::U1) => all(bytes, |b| i8::from_le_bytes(b).into()),
        TypeDescriptor::Integer(IntSize::U2) => all(bytes, |b| i16::from_le_bytes(b).into()),
        TypeDescriptor::Integer(IntSize::U4) => all(bytes, |b| i32::from_le_bytes(b).into()),
        TypeDescriptor::Integer(IntSize::U8) => all(bytes, i64::from_le_bytes),
        TypeDescriptor::Unsigned(IntSize::U2) => all(bytes, |b| u16::from_le_bytes(b).into()),
        TypeDescriptor::Unsigned(IntSize::U4) => all(bytes, |b| u32::from_le_bytes(b).into()),
        TypeDescriptor::Unsigned(IntSize::U8) => {
            all(bytes, |b| i64::try_from(u64::from_le_bytes(b)).unwrap_or(i64::MAX))
        }
        _ => all(bytes, |b| u8::from_le_bytes(b).into()),
    }
}
