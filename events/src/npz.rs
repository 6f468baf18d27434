//! Events and luma sequences in NumPy's `.npz` archives (zip files of `.npy` arrays).

use std::{
    fs::File,
    io::{BufReader, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use zip::{
    CompressionMethod, DateTime, ZipArchive, ZipWriter, read::ZipFile, result::ZipError, write::SimpleFileOptions,
};

use crate::Events;
use erfgs_base::{
    FileError,
    npy::{self, NpyArray, NpyError},
    plausible::check_sensor,
};

mod pieces;
mod times;
#[cfg(test)]
mod variants;

pub use pieces::read_pieces;

/// What can go wrong with an `.npz` file.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// The file cannot be opened, read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file is no whole zip archive.
    #[error("cannot read {}: {source}; the archive is cut short or damaged, make it again", path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// Why.
        source: ZipError,
    },
    /// An array is missing.
    #[error("{} holds no array {wanted}; it holds: {}", path.display(), found.join(", "))]
    Missing {
        /// The archive.
        path: PathBuf,
        /// The names that would do.
        wanted: &'static str,
        /// The names that there are.
        found: Vec<String>,
    },
    /// An array cannot be used.
    #[error("array `{array}` of {} {source}", path.display())]
    Array {
        /// The archive.
        path: PathBuf,
        /// The array.
        array: String,
        /// What is wrong with it.
        source: NpyError,
    },
    /// The arrays contradict each other or the sensor.
    #[error("{}: {what}", path.display())]
    Content {
        /// The archive.
        path: PathBuf,
        /// What is wrong, and what to do.
        what: String,
    },
}

/// A sequence of grey frames: `data` holds `frames` images of `height` rows of `width` values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LumaSequence {
    /// Number of frames.
    pub frames: usize,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `frames * height * width` bytes.
    pub data: Vec<u8>,
}

impl LumaSequence {
    /// The frames in order, each `height * width` values.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[u8]> {
        // A frame without pixels cannot be cut out of the data, and `read_luma` refuses it.
        self.data.chunks_exact((self.width as usize * self.height as usize).max(1))
    }
}

/// An open archive.
struct Archive<'a, R> {
    path: &'a Path,
    zip: ZipArchive<R>,
    /// Bytes that its arrays may still unpack to.
    room: u64,
    /// The same at the beginning.
    most: u64,
}

/// What an archive may unpack to: so many bytes, and so many more for each of its own. Events pack to a twentieth; what packs to
/// a thousandth was made to fill memory.
const ROOM: u64 = 256 << 20;
const ROOM_FOR_EACH: u64 = 64;

fn open(path: &Path) -> Result<BufReader<File>, NpzError> {
    Ok(BufReader::new(File::open(path).map_err(FileError::when("read", path))?))
}

impl<'a, R: Read + Seek> Archive<'a, R> {
    fn new(mut file: R, path: &'a Path) -> Result<Self, NpzError> {
        let length = file.seek(SeekFrom::End(0)).map_err(FileError::when("read", path))?;
        let room = ROOM.saturating_add(length.saturating_mul(ROOM_FOR_EACH));
        Self::with_room(file, path, room)
    }

    /// An archive that may unpack to `most` bytes.
    fn with_room(file: R, path: &'a Path, most: u64) -> Result<Self, NpzError> {
        let zip = ZipArchive::new(file).map_err(|source| NpzError::Archive { path: path.to_owned(), source })?;
        Ok(Self { path, zip, room: most, most })
    }

    /// The first array of `names` that there is, with its name.
    fn find(&mut self, names: &[&'static str]) -> Result<Option<(&'static str, NpyArray)>, NpzError> {
        let Some((name, index)) = self.place(names) else { return Ok(None) };
        let mut bytes = Vec::new();
        let most = self.room + 1;
        let unpacked = self.member(index)?.take(most).read_to_end(&mut bytes);
        let unpacked = unpacked.map_err(|source| self.archive(source.into()))? as u64;
        self.unpack(unpacked)?;
        let array = NpyArray::decode(&bytes).map_err(|source| self.array(name, source))?;
        Ok(Some((name, array)))
    }

    /// The first of these names that an array has, and which member of the archive that is.
    fn place(&self, names: &[&'static str]) -> Option<(&'static str, usize)> {
        names.iter().find_map(|name| Some((*name, self.zip.index_for_name(&format!("{name}.npy"))?)))
    }

    fn member(&mut self, index: usize) -> Result<ZipFile<'_, R>, NpzError> {
        let path = self.path;
        self.zip.by_index(index).map_err(|source| NpzError::Archive { path: path.to_owned(), source })
    }

    /// Counts what is unpacked, bytes.
    fn unpack(&mut self, bytes: u64) -> Result<(), NpzError> {
        let Some(room) = self.room.checked_sub(bytes) else {
            return Err(too_much(self.path, self.most));
        };
        self.room = room;
        Ok(())
    }

    fn need(&mut self, names: &[&'static str], wanted: &'static str) -> Result<(&'static str, NpyArray), NpzError> {
        match self.find(names)? {
            Some(found) => Ok(found),
            None => Err(self.missing(wanted)),
        }
    }

    fn missing(&self, wanted: &'static str) -> NpzError {
        let names = self.zip.file_names_raw().map(|name| String::from_utf8_lossy(name).into_owned());
        NpzError::Missing { path: self.path.to_owned(), wanted, found: names.collect() }
    }

    fn column<V: TryFrom<i128>>(&mut self, (names, wanted, range): Column) -> Result<Vec<V>, NpzError> {
        let (name, array) = self.need(names, wanted)?;
        if array.shape.len() != 1 {
            return Err(self.content(format!("array `{name}` has the shape {:?}, but one axis is needed", array.shape)));
        }
        array.integers(range).map_err(|source| self.array(name, source))
    }

    fn scalar(&mut self, name: &'static str) -> Result<Option<u32>, NpzError> {
        let Some((_, array)) = self.find(&[name])? else { return Ok(None) };
        let values = array.integers("the 32-bit range").map_err(|source| self.array(name, source))?;
        match values[..] {
            [value] => Ok(Some(value)),
            _ => Err(self.content(format!("array `{name}` holds {} values instead of one", values.len()))),
        }
    }

    /// The size of the sensor that the archive tells, which must be the one that is known, if both are.
    fn sensor(&mut self, known: Option<[u32; 2]>) -> Result<Option<[u32; 2]>, NpzError> {
        let stored = match (self.scalar("width")?, self.scalar("height")?) {
            (Some(width), Some(height)) => Some([width, height]),
            _ => None,
        };
        if let Some([width, height]) = stored {
            check_sensor([width, height]).map_err(|wrong| self.content(wrong.to_string()))?;
        }
        if let (Some(size), Some(stored)) = (known, stored)
            && size != stored
        {
            let what = format!(
                "the events are of a sensor of {} x {} pixels, but one of {} x {} is named; correct the camera's size",
                stored[0], stored[1], size[0], size[1]
            );
            return Err(self.content(what));
        }
        Ok(stored)
    }

    fn archive(&self, source: ZipError) -> NpzError {
        NpzError::Archive { path: self.path.to_owned(), source }
    }

    fn array(&self, array: &str, source: NpyError) -> NpzError {
        NpzError::Array { path: self.path.to_owned(), array: array.to_owned(), source }
    }

    fn content(&self, what: String) -> NpzError {
        NpzError::Content { path: self.path.to_owned(), what }
    }
}

/// Reads events: arrays `t` or `t_us` (microseconds, any integer type), `x`, `y`, `p` (1 = ON; 0 or -1 = OFF).
///
/// `size` is the sensor's width and height in pixels; without it, what `width` and `height` of the archive say, which those
/// that [`write_events`] makes hold; without these, the least that holds all events. Where both are there, they must agree.
///
/// # Errors
/// If the file is missing, cut short or malformed, the columns differ in length, times decrease, or an event lies
/// outside the sensor.
pub fn read_events(path: &Path, size: Option<[u32; 2]>) -> Result<Events, NpzError> {
    read_events_from(open(path)?, path, size)
}

/// As [`read_events`], from anything that reads; `path` names it in errors.
///
/// # Errors
/// As [`read_events`].
pub fn read_events_from(file: impl Read + Seek, path: &Path, size: Option<[u32; 2]>) -> Result<Events, NpzError> {
    let mut archive = Archive::new(file, path)?;
    archive.check_names()?;
    let stored = archive.sensor(size)?;
    let t_us: Vec<i64> = archive.column(T)?;
    let x: Vec<u16> = archive.column(X)?;
    let y: Vec<u16> = archive.column(Y)?;
    let p: Vec<i8> = archive.column(P)?;
    events_of(path, (t_us, x, y, p), size.or(stored))
}

/// An archive that unpacks to more than it may.
fn too_much(path: &Path, most: u64) -> NpzError {
    let what = format!(
        "its arrays unpack to more than {most} bytes, which no recording of that size does; unpack it yourself if you know where \
         it comes from"
    );
    NpzError::Content { path: path.to_owned(), what }
}

/// A column: the names of its array, as they are told, and the range of its values.
type Column = (&'static [&'static str], &'static str, &'static str);
const T: Column = (&["t", "t_us"], "`t` or `t_us`", "the 64-bit range");
const X: Column = (&["x"], "`x`", "0..=65535");
const Y: Column = (&["y"], "`y`", "0..=65535");
const P: Column = (&["p"], "`p`", "0 and 1");

/// The columns t, x, y and p.
type Columns = (Vec<i64>, Vec<u16>, Vec<u16>, Vec<i8>);

/// Events of columns, on a sensor of this size or, without it, of the least that holds all.
fn events_of(path: &Path, columns: Columns, size: Option<[u32; 2]>) -> Result<Events, NpzError> {
    next_events_of(path, columns, size, [0, i64::MIN])
}

/// As [`events_of`], where so many events came before, the last of them at this time.
fn next_events_of(
    path: &Path,
    (t_us, x, y, p): Columns,
    size: Option<[u32; 2]>,
    [first, last_us]: [i64; 2],
) -> Result<Events, NpzError> {
    let wrong = |what: String| Err(NpzError::Content { path: path.to_owned(), what });
    let lengths = [t_us.len(), x.len(), y.len(), p.len()];
    if lengths.iter().any(|&length| length != t_us.len()) {
        return wrong(unequal(lengths));
    }
    let before = std::iter::once(&last_us).chain(&t_us);
    if let Some((at, (before, t_us))) = before.zip(&t_us).enumerate().find(|(_, (before, t_us))| before > t_us) {
        return wrong(format!("times decrease from {before} to {t_us} µs at event {}; sort them", first + at as i64));
    }
    let largest = |column: &[u16]| column.iter().max().map(|&address| u32::from(address) + 1);
    let needed = largest(&x).zip(largest(&y)).map(|(width, height)| [width, height]);
    let Some([width, height]) = size.or(needed) else {
        let what =
            "the sensor's size is unknown: there are neither arrays `width` and `height` nor events; name the size";
        return wrong(what.to_owned());
    };
    if let Err(implausible) = check_sensor([width, height]) {
        return wrong(format!("its events reach far out: {implausible}, or name the sensor's size"));
    }
    let outside = |(&x, &y): (&u16, &u16)| u32::from(x) >= width || u32::from(y) >= height;
    if let Some(at) = x.iter().zip(&y).position(outside) {
        return wrong(format!(
            "event {} lies at ({}, {}), outside the sensor of {width} x {height} pixels; correct the camera's size",
            first + at as i64,
            x[at],
            y[at]
        ));
    }
    if let Some(at) = p.iter().position(|p| !(-1..=1).contains(p)) {
        let at_all = first + at as i64;
        return wrong(format!("event {at_all} has the polarity {}; it must be 1 (ON) or 0 (OFF)", p[at]));
    }
    if p.contains(&0) && p.contains(&-1) {
        return wrong("polarities are 0 for some events and -1 for others; write OFF in one way".to_owned());
    }
    Ok(Events { width, height, t_us, x, y, on: p.into_iter().map(|p| p == 1).collect() })
}

fn unequal(lengths: [impl std::fmt::Debug; 4]) -> String {
    format!("the columns t, x, y, p have the lengths {lengths:?}; they must be equal")
}

/// Reads events of a structured array in an `.npy` file: fields `t`, `x`, `y` and `p`, in any order and of any number type,
/// by these or the usual other names. Times are microseconds; floating-point ones are seconds if any has a fraction, and refused where
/// they may be either.
///
/// `size` is the sensor's width and height in pixels; without it, the least that holds all events.
///
/// # Errors
/// If the file is missing, cut short or malformed, lacks a field, times decrease, or an event lies outside the sensor.
pub fn read_structured(path: &Path, size: Option<[u32; 2]>) -> Result<Events, NpzError> {
    let bytes = std::fs::read(path).map_err(FileError::when("read", path))?;
    structured(&bytes, path, size)
}

/// As [`read_structured`], from the bytes of the file; `path` names it in errors.
///
/// # Errors
/// As [`read_structured`].
pub fn structured(bytes: &[u8], path: &Path, size: Option<[u32; 2]>) -> Result<Events, NpzError> {
    let wrong = |array: &str| {
        let (path, array) = (path.to_owned(), array.to_owned());
        move |source| NpzError::Array { path, array, source }
    };
    let fields = npy::decode_records(bytes).map_err(wrong("events"))?;
    if let Some(what) = times::not_understood(fields.iter().flat_map(|(names, _)| names).map(String::as_str)) {
        return Err(NpzError::Content { path: path.to_owned(), what });
    }
    let find = |wanted: &'static str, names: &[&str]| {
        let is_it = |name: &String| names.contains(&name.to_ascii_lowercase().as_str());
        let found = fields.iter().find(|(given, _)| given.iter().any(is_it)).map(|(_, column)| column);
        found.ok_or_else(|| {
            let found = fields.iter().map(|(names, _)| names.join("/")).collect();
            NpzError::Missing { path: path.to_owned(), wanted, found }
        })
    };
    let t = find("`t`", &["t", "t_us", "ts", "time", "timestamp"])?;
    let t_us = if let Ok(times) = t.floats() {
        let is_named = find("", &["t_us"]).is_ok_and(|named| std::ptr::eq(named, t));
        let content = |what| NpzError::Content { path: path.to_owned(), what };
        times::microseconds(&times, is_named).map_err(content)?
    } else {
        t.integers("the 64-bit range").map_err(wrong("t"))?
    };
    let x = find("`x`", &["x"])?.whole("0..=65535").map_err(wrong("x"))?;
    let y = find("`y`", &["y"])?.whole("0..=65535").map_err(wrong("y"))?;
    let p = find("`p`", &["p", "on", "pol", "polarity"])?.whole("0 and 1").map_err(wrong("p"))?;
    events_of(path, (t_us, x, y, p), size)
}

/// Writes events: `t` (i64, microseconds), `x` and `y` (u16), `p` (u8, 1 = ON), `width` and `height` (u32 scalars).
/// The file appears whole or not at all; the same events give the same bytes.
///
/// # Errors
/// If the columns differ in length or the file cannot be written.
pub fn write_events(path: &Path, events: &Events) -> Result<(), NpzError> {
    let count = events.t_us.len();
    if [events.x.len(), events.y.len(), events.on.len()] != [count; 3] {
        let what = "the columns to be written differ in length".to_owned();
        return Err(NpzError::Content { path: path.to_owned(), what });
    }
    let shape = [count];
    write(
        path,
        &[
            ("t", npy::encode(&shape, events.t_us.iter().copied())),
            ("x", npy::encode(&shape, events.x.iter().copied())),
            ("y", npy::encode(&shape, events.y.iter().copied())),
            ("p", npy::encode(&shape, events.on.iter().map(|&on| u8::from(on)))),
            ("width", npy::encode(&[], [events.width].into_iter())),
            ("height", npy::encode(&[], [events.height].into_iter())),
        ],
    )
}

/// Reads `luma[T, H, W]` (u8): T grey frames of H rows and W columns.
///
/// # Errors
/// If the file is missing, cut short or malformed, or the frames are empty.
pub fn read_luma(path: &Path) -> Result<LumaSequence, NpzError> {
    read_luma_from(open(path)?, path)
}

/// As [`read_luma`], from anything that reads; `path` names it in errors.
///
/// # Errors
/// As [`read_luma`].
pub fn read_luma_from(file: impl Read + Seek, path: &Path) -> Result<LumaSequence, NpzError> {
    let mut archive = Archive::new(file, path)?;
    let (name, array) = archive.need(&["luma"], "`luma`")?;
    let shape = array.shape.clone();
    let [frames, height, width] = shape[..] else {
        return Err(
            archive.content(format!("array `luma` has the shape {shape:?}, but [frames, height, width] is needed"))
        );
    };
    // Event coordinates are 16 bits wide.
    let [Ok(height @ 1..), Ok(width @ 1..)] = [u16::try_from(height), u16::try_from(width)] else {
        return Err(archive.content(format!("frames of {width} x {height} pixels cannot be used")));
    };
    let data = array.into_bytes().map_err(|source| archive.array(name, source))?;
    Ok(LumaSequence { frames, width: width.into(), height: height.into(), data })
}

/// Writes arrays, encoded as `.npy`, into a new archive.
fn write(path: &Path, arrays: &[(&str, Vec<u8>)]) -> Result<(), NpzError> {
    let io = FileError::when("write", path);
    let mut zip = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in arrays {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .compression_level(Some(LEVEL))
            .last_modified_time(DateTime::default())
            .large_file(bytes.len() as u64 >= u64::from(u32::MAX));
        zip.start_file(format!("{name}.npy"), options).map_err(|error| io(error.into()))?;
        zip.write_all(bytes).map_err(&io)?;
    }
    let bytes = zip.finish().map_err(|error| io(error.into()))?.into_inner();
    Ok(erfgs_base::atomic::write(path, &bytes).map_err(io)?)
}

/// Level of the compression: on simulated events level 6 saves a few per cent more and takes several times as long.
const LEVEL: i64 = 1;

#[cfg(test)]
mod tests;
