//! Reading an event file of whatever format.

use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use crate::container::ContainerError;
use erfgs_base::plausible::INSTANT;
use erfgs_events::EventEncoding;
use erfgs_events::{
    Anomalies, EventBatch, EventFile, EventFileError, EventFileHints, EventFormat, Events, SensorSize, Sink,
    hdf5::{self, Hdf5Layout},
    npz,
};

/// Events handed over at once.
const BATCH: usize = 4096;

/// How a file of one array begins.
const NPY: &[u8; 6] = b"\x93NUMPY";

/// A file whose format is known.
#[derive(Clone)]
pub(super) enum EventSource {
    /// A stream of bytes.
    Stream(EventFile),
    /// An archive of arrays, or a structured array, held in memory while it is read.
    Arrays { path: PathBuf, size: Option<SensorSize> },
    /// Opened anew for each reading.
    Hdf5 { path: PathBuf, layout: Hdf5Layout, size: Option<SensorSize> },
}

impl EventSource {
    pub fn open(path: &Path, hints: &EventFileHints) -> Result<Self, ContainerError> {
        let size = hints.size;
        let failed = |error: EventFileError| ContainerError::event_file(path, error);
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let mut head = Vec::new();
        let file = File::open(path);
        let file = file.map_err(|source| ContainerError::Open { what: "open", path: path.to_owned(), source })?;
        let read = file.take(8).read_to_end(&mut head);
        read.map_err(|source| ContainerError::Read { path: path.to_owned(), offset: 0, source })?;
        let named_arrays = extension.eq_ignore_ascii_case("npz") || head.starts_with(NPY);
        let no_text = |format| match hints.columns {
            Some(_) => Err(failed(EventFileError::NoText { path: path.to_owned(), format })),
            None => Ok(()),
        };
        // An archive may hold text instead.
        let is_archive = || head.starts_with(b"PK\x03\x04");
        let holds_no_text = || matches!(EventFile::open_with(path, hints), Err(EventFileError::Unknown { .. }));
        if named_arrays || is_archive() && holds_no_text() {
            no_text("NumPy's arrays")?;
            let events = read_arrays(path, size)?;
            let side = |side| u16::try_from(side).unwrap_or(u16::MAX);
            let size = Some(SensorSize { width: side(events.width), height: side(events.height) });
            return Ok(Self::Arrays { path: path.to_owned(), size });
        }
        if head.starts_with(b"\x89HDF")
            || extension.eq_ignore_ascii_case("h5")
            || extension.eq_ignore_ascii_case("hdf5")
        {
            no_text("HDF5")?;
            let file = hdf5::open(path).map_err(|error| ContainerError::event_file(path, error))?;
            let size = size.or(file.size());
            return Ok(Self::Hdf5 { path: path.to_owned(), layout: file.layout(), size });
        }
        EventFile::open_with(path, hints).map(Self::Stream).map_err(failed)
    }

    pub fn path(&self) -> &Path {
        match self {
            Self::Stream(file) => &file.path,
            Self::Arrays { path, .. } | Self::Hdf5 { path, .. } => path,
        }
    }

    pub fn name(&self) -> &'static str {
        match self {
            Self::Stream(file) => file.format.name(),
            Self::Arrays { path, .. } if is_npy(path) => "npy",
            Self::Arrays { .. } => "npz",
            Self::Hdf5 { layout, .. } => layout.name(),
        }
    }

    pub fn size(&self) -> Option<SensorSize> {
        match self {
            Self::Stream(file) => file.size,
            Self::Arrays { size, .. } | Self::Hdf5 { size, .. } => *size,
        }
    }

    /// Whether the file holds the words of a device as it sent them.
    pub fn is_devices_words(&self) -> bool {
        matches!(self, Self::Stream(EventFile { format: EventFormat::Raw(_), .. }))
    }

    /// Takes `found` for the sensor's size.
    pub fn set_size(&mut self, found: Option<SensorSize>) {
        match self {
            Self::Stream(file) => file.size = found,
            // The archive knows its own.
            Self::Arrays { .. } => {}
            Self::Hdf5 { size, .. } => *size = found,
        }
    }

    /// How its packets are encoded.
    pub fn encoding(&self) -> EventEncoding {
        match self {
            Self::Stream(EventFile { format: EventFormat::Raw(encoding), .. }) => *encoding,
            Self::Stream(EventFile { format: EventFormat::Dat(_) | EventFormat::Aedat2(_), .. })
            | Self::Hdf5 { layout: Hdf5Layout::Metavision, .. } => EventEncoding::Evt2,
            _ => EventEncoding::Aedat4,
        }
    }

    /// Decodes the file as long as `go_on` says so, which is told how many bytes were read.
    pub fn decode(&self, sink: &mut impl Sink, go_on: impl FnMut(u64) -> bool) -> Result<Anomalies, ContainerError> {
        match self {
            Self::Stream(file) => {
                file.decode_while(sink, go_on).map_err(|error| ContainerError::event_file(&file.path, error))
            }
            Self::Arrays { path, size } => decode_arrays(path, *size, sink, go_on),
            Self::Hdf5 { path, size, .. } => {
                let decoded = hdf5::open(path).and_then(|file| file.decode(*size, sink));
                decoded.map_err(|error| ContainerError::event_file(path, error))
            }
        }
    }
}

fn read_arrays(path: &Path, size: Option<SensorSize>) -> Result<Events, ContainerError> {
    let size = size.map(|size| [size.width.into(), size.height.into()]);
    let events = if is_npy(path) { npz::read_structured(path, size) } else { npz::read_events(path, size) };
    let events = events.map_err(|error| ContainerError::event_file(path, error))?;
    // They are in order.
    let ends = events.t_us.first().into_iter().chain(events.t_us.last());
    let checked = INSTANT.check_all(ends.map(|&t_us| t_us as f64 * 1e-6));
    checked
        .map_err(|wrong| ContainerError::event_file(path, format!("has times that are no microseconds: {wrong}")))?;
    Ok(events)
}

/// Whether the file is an array, and no archive of arrays.
fn is_npy(path: &Path) -> bool {
    let mut head = [0; NPY.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut head)).is_ok() && head == *NPY
}

fn decode_arrays(
    path: &Path,
    size: Option<SensorSize>,
    sink: &mut impl Sink,
    mut go_on: impl FnMut(u64) -> bool,
) -> Result<Anomalies, ContainerError> {
    let events = read_arrays(path, size)?;
    let mut t_us = Vec::with_capacity(BATCH);
    for from in (0..events.len()).step_by(BATCH) {
        let to = events.len().min(from + BATCH);
        t_us.clear();
        for &t in &events.t_us[from..to] {
            t_us.push(u64::try_from(t).map_err(|_| ContainerError::BeforeZero { path: path.to_owned(), t_us: t })?);
        }
        sink.events(EventBatch {
            t_us: &t_us,
            x: &events.x[from..to],
            y: &events.y[from..to],
            on: &events.on[from..to],
        });
        if !go_on(to as u64) {
            break;
        }
    }
    Ok(Anomalies::default())
}
