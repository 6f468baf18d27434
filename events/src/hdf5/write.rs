//! Writing DSEC's layout, with libhdf5.

use std::{
    io,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic::Place};
use hdf5::{Dataset, H5Type};

use super::Hdf5Error;
use crate::{CdEvent, SensorSize, Sink};

/// Events of a chunk. What one chunk holds is written at once.
const CHUNK: usize = 1 << 16;

/// A file that is being written: a sink of events. Its first error is told by [`Hdf5Writer::finish`]; until then nothing is at
/// its place.
#[derive(Debug)]
pub struct Hdf5Writer {
    path: PathBuf,
    place: Place,
    file: hdf5::File,
    t: Column<u32>,
    x: Column<u16>,
    y: Column<u16>,
    p: Column<u8>,
    milliseconds: Column<u64>,
    /// Time of the first event and of the last one.
    span_us: Option<(u64, u64)>,
    events: u64,
    error: Option<Hdf5Error>,
}

/// Begins a file in DSEC's layout: `/events/t` (u32), `x`, `y` (u16) and `p` (u8), deflated; `/ms_to_idx` (u64) and `/t_offset`
/// (i64), the time of the first event. Where the sensor's size is known, `/events` has it as attributes `width`, `height`.
///
/// # Errors
/// If the file cannot be written.
pub fn create(path: &Path, size: Option<SensorSize>) -> Result<Hdf5Writer, Hdf5Error> {
    let place = Place::begin(path).map_err(FileError::when("write", path))?;
    let failed = |error: hdf5::Error| library(path, error);
    let file = hdf5::File::create(place.path()).map_err(failed)?;
    let events = file.create_group("events").map_err(failed)?;
    if let Some(size) = size {
        for (name, side) in [("width", size.width), ("height", size.height)] {
            let attribute = events.new_attr::<u32>().create(name).map_err(failed)?;
            attribute.write_scalar(&u32::from(side)).map_err(failed)?;
        }
    }
    Ok(Hdf5Writer {
        path: path.to_owned(),
        place,
        t: Column::new(&events, "t").map_err(failed)?,
        x: Column::new(&events, "x").map_err(failed)?,
        y: Column::new(&events, "y").map_err(failed)?,
        p: Column::new(&events, "p").map_err(failed)?,
        milliseconds: Column::new(&file, "ms_to_idx").map_err(failed)?,
        file,
        span_us: None,
        events: 0,
        error: None,
    })
}

/// What the library says begins with what went wrong, and goes on with where it was being written and how the library got there. Where
/// the system refused, its number is told.
fn library(path: &Path, error: hdf5::Error) -> Hdf5Error {
    let message = error.to_string();
    let number = message.split_once("errno = ").and_then(|(_, rest)| rest.split(',').next()?.parse().ok());
    if let Some(number) = number {
        return FileError::when("write", path)(io::Error::from_raw_os_error(number)).into();
    }
    let why = message.split_once("error message = '").and_then(|(_, rest)| rest.split_once('\''));
    let what = why.map_or(message.as_str(), |(why, _)| why).to_owned();
    Hdf5Error::Library { doing: "write".to_owned(), path: path.to_owned(), what }
}

/// A dataset with one axis that grows.
#[derive(Debug)]
struct Column<T> {
    dataset: Dataset,
    length: usize,
    waiting: Vec<T>,
}

impl<T: H5Type> Column<T> {
    fn new(group: &hdf5::Group, name: &str) -> hdf5::Result<Self> {
        let dataset = group.new_dataset::<T>().shape(0..).chunk(CHUNK).shuffle().deflate(1).create(name)?;
        Ok(Self { dataset, length: 0, waiting: Vec::new() })
    }

    fn push(&mut self, value: T) -> hdf5::Result<()> {
        self.waiting.push(value);
        if self.waiting.len() == CHUNK { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> hdf5::Result<()> {
        let to = self.length + self.waiting.len();
        if to > self.length {
            self.dataset.resize(to)?;
            self.dataset.write_slice(&self.waiting, self.length..to)?;
            self.length = to;
            self.waiting.clear();
        }
        Ok(())
    }
}

impl Hdf5Writer {
    fn push(&mut self, event: CdEvent) -> Result<(), Hdf5Error> {
        let refused =
            |what: &str| Hdf5Error::Events { path: self.path.clone(), event: self.events, what: what.to_owned() };
        let (first, last) = self.span_us.unwrap_or((event.t_us, event.t_us));
        if event.t_us < last {
            return Err(refused(
                "goes back in time, as after a restart of the device's clock, and DSEC's times are in order",
            ));
        }
        if i64::try_from(first).is_err() {
            return Err(refused("has a time that the offset cannot hold"));
        }
        let Ok(t) = u32::try_from(event.t_us - first) else {
            return Err(refused("is more than 71 minutes after the first, and DSEC's times have 32 bits"));
        };
        self.span_us = Some((first, event.t_us));
        let mut write = || {
            // The first event at or after each whole millisecond.
            while (self.milliseconds.length + self.milliseconds.waiting.len()) as u64 * 1000 <= u64::from(t) {
                self.milliseconds.push(self.events)?;
            }
            self.t.push(t)?;
            self.x.push(event.x)?;
            self.y.push(event.y)?;
            self.p.push(event.on.into())
        };
        write().map_err(|error| library(&self.path, error))?;
        self.events += 1;
        Ok(())
    }

    /// Ends the file, puts it in its place, and says how many events it holds.
    ///
    /// # Errors
    /// If anything failed since it was begun; then there is no file.
    pub fn finish(mut self) -> Result<u64, Hdf5Error> {
        if let Some(error) = self.error {
            return Err(error);
        }
        let end = |writer: &mut Self| {
            let Self { t, x, y, p, milliseconds, .. } = writer;
            t.flush().and(x.flush()).and(y.flush()).and(p.flush()).and(milliseconds.flush())?;
            let offset = writer.span_us.map_or(0, |(first, _)| first.cast_signed());
            writer.file.new_dataset::<i64>().create("t_offset")?.write_scalar(&offset)?;
            // What the library fails to write when a dataset is closed, nobody would be told.
            writer.file.flush()
        };
        end(&mut self).map_err(|error| library(&self.path, error))?;
        let Self { path, place, file, t, x, y, p, milliseconds, events, .. } = self;
        drop((t, x, y, p, milliseconds));
        file.close().map_err(|error| library(&path, error))?;
        let io = FileError::when("write", &path);
        place.finish().map_err(io)?;
        Ok(events)
    }
}

impl Sink for Hdf5Writer {
    fn event(&mut self, event: CdEvent) {
        if self.error.is_none() {
            self.error = self.push(event).err();
        }
    }
}
