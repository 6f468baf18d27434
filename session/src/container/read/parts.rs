//! The files of a session, read as one. One file is open at a time, however many there are.

use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    path::Path,
};

use super::{file::SessionFile, walk::Walk};
use crate::container::{
    ContainerError, FileSummary, Stream, Summary,
    parts::{PartOf, part_path, parts_beside},
};

/// See the module.
pub(super) struct Parts<R> {
    /// Over the file that is open.
    pub walk: Walk<R>,
    at: usize,
    pub files: Vec<SessionFile>,
    /// Opens another of the files.
    open: Option<Open<R>>,
    /// What the session holds.
    pub summary: Summary,
}

type Open<R> = fn(&Path) -> Result<R, ContainerError>;

/// Opens what is a file, and nothing that only looks like one.
pub(super) fn open_file(path: &Path) -> Result<File, ContainerError> {
    let file = erfgs_base::regular::check(path).and_then(|()| File::open(path));
    file.map_err(|source| ContainerError::Open { what: "open", path: path.to_owned(), source })
}

impl<R: Read + Seek> Parts<R> {
    /// A session in one file.
    pub fn one(file: R, path: &Path) -> Result<Self, ContainerError> {
        let mut walk = Walk::open(file, path)?;
        let file = SessionFile::read(&mut walk, path)?;
        let mut summary = file.summary.clone();
        if let Some(part) = summary.part.clone().filter(|part| part.number > 0) {
            summary.begin_with(&part);
        }
        Ok(Self { walk, at: 0, files: vec![file], open: None, summary })
    }

    /// The file that is open.
    pub fn file(&self) -> &SessionFile {
        &self.files[self.at]
    }

    /// Goes to the first record of a file.
    pub fn begin(&mut self, number: usize) -> Result<(), ContainerError> {
        self.enter(number)?;
        self.walk.go_to(mcap::MAGIC.len() as u64);
        Ok(())
    }

    /// Goes on with the next file; `false` if there is none.
    pub fn go_on(&mut self) -> Result<bool, ContainerError> {
        let next = self.at + 1;
        if next >= self.files.len() {
            return Ok(false);
        }
        self.begin(next).map(|()| true)
    }

    /// Goes to the chunk from which on there are messages of this log time and later.
    pub fn go_to(&mut self, log_time: u64) -> Result<(), ContainerError> {
        let chunks =
            || self.files.iter().enumerate().flat_map(|(at, file)| file.chunks.iter().map(move |chunk| (at, chunk)));
        match chunks().find(|(_, chunk)| chunk.end >= log_time).or(chunks().last()) {
            Some((at, &chunk)) => {
                self.enter(at)?;
                self.walk.go_to(chunk.offset);
                Ok(())
            }
            None => self.begin(0),
        }
    }

    fn enter(&mut self, number: usize) -> Result<(), ContainerError> {
        let (true, Some(open)) = (number != self.at, self.open) else { return Ok(()) };
        let path = &self.files[number].path;
        let walk = Walk::open(open(path)?, path)?;
        self.files[self.at].layout = std::mem::replace(&mut self.walk, walk).layout;
        self.walk.layout = std::mem::take(&mut self.files[number].layout);
        self.at = number;
        Ok(())
    }
}

impl Parts<File> {
    /// Takes the further files of the session, of which the first is open. Nothing is done where it has none.
    pub fn join(&mut self) -> Result<(), ContainerError> {
        let first = self.files[0].path.clone();
        let Some(part) = self.summary.part.clone().filter(|part| part.number == 0) else { return Ok(()) };
        self.open = Some(open_file);
        self.summary.files = vec![self.files[0].in_parts()];
        let listed = |source| ContainerError::Open { what: "list the folder of", path: first.clone(), source };
        let named = parts_beside(&first).map_err(listed)?;
        let last = named.len();
        for (expected, (number, path)) in (1..).zip(named) {
            if number != expected {
                return Err(ContainerError::MissingPart { path: part_path(&first, expected), later: path });
            }
            let file = match further(&path, &PartOf { number, ..part.clone() }) {
                Ok(file) => file,
                Err(Refused::Nothing(file)) if number as usize == last => {
                    self.summary.go_on_in(file);
                    return Ok(());
                }
                Err(Refused::Nothing(_)) => {
                    return Err(ContainerError::ForeignPart { path, first, what: "it holds nothing".into() });
                }
                Err(Refused::Foreign(what)) => return Err(ContainerError::ForeignPart { path, first, what }),
                Err(Refused::Unread(error)) => return Err(error),
            };
            let foreign = |what| ContainerError::ForeignPart { path, first: first.clone(), what };
            self.files.push(self.summary.take(file).map_err(foreign)?);
        }
        if self.summary.totals.continues {
            let path = part_path(&first, last as u32 + 1);
            self.summary.go_on_in(FileSummary { path, ..FileSummary::default() });
        }
        Ok(())
    }
}

/// Why a file is not read as a part.
enum Refused {
    /// It was cut off before it said anything.
    Nothing(FileSummary),
    /// It is something else.
    Foreign(String),
    Unread(ContainerError),
}

/// A file that should be `part` of a session.
fn further(path: &Path, part: &PartOf) -> Result<SessionFile, Refused> {
    let mut walk = Walk::open(open_file(path).map_err(Refused::Unread)?, path).map_err(|error| unread(path, error))?;
    let mut file = SessionFile::read(&mut walk, path).map_err(|error| unread(path, error))?;
    let what = match &file.summary.part {
        None if file.summary.span_ns().is_none() && !file.summary.complete => {
            return Err(Refused::Nothing(FileSummary { whole_bytes: 0, ..file.in_parts() }));
        }
        None => "it is a recording of its own".to_owned(),
        Some(found) if found.session != part.session => "it is of another session".to_owned(),
        Some(found) if found.number != part.number => format!("it is the one with number {}", found.number),
        Some(_) => {
            file.layout = walk.layout;
            return Ok(file);
        }
    };
    Err(Refused::Foreign(what))
}

fn unread(path: &Path, error: ContainerError) -> Refused {
    match error {
        error if holds_nothing(path, &error) => {
            let bytes = path.metadata().map_or(0, |file| file.len());
            Refused::Nothing(FileSummary { path: path.to_owned(), bytes, ..FileSummary::default() })
        }
        ContainerError::Empty { .. } | ContainerError::NotMcap { .. } | ContainerError::NotASession { .. } => {
            Refused::Foreign(format!("it cannot be one: {error}"))
        }
        error => Refused::Unread(error),
    }
}

/// Whether erfgs cannot read the file because its recording was cut off at its beginning: it has no bytes, some of the first ones, or
/// zeros, as a file system may leave them that lost power.
fn holds_nothing(path: &Path, error: &ContainerError) -> bool {
    const MAGIC: &[u8] = mcap::MAGIC;
    let (mut start, mut end) = (Vec::new(), Vec::new());
    let Ok(mut file) = open_file(path) else { return false };
    let Ok(length) = (&file).take(MAGIC.len() as u64).read_to_end(&mut start) else { return false };
    match error {
        ContainerError::Empty { .. } => true,
        ContainerError::NotMcap { .. } => {
            let cut = length < MAGIC.len() && MAGIC.starts_with(&start);
            cut || start.iter().all(|&byte| byte == 0)
        }
        ContainerError::NotASession { .. } => {
            let at = file.seek(SeekFrom::End(-(length as i64)));
            // The first bytes of a file are also its last.
            at.is_ok_and(|at| at == 0) || (file.read_to_end(&mut end).is_ok() && end != MAGIC)
        }
        _ => false,
    }
}

impl SessionFile {
    /// What is said of it among the files of a session.
    fn in_parts(&self) -> FileSummary {
        let Summary { file_bytes, whole_bytes, complete, .. } = self.summary;
        FileSummary { path: self.path.clone(), bytes: file_bytes, whole_bytes, complete }
    }
}

impl Summary {
    /// Takes what the next file holds; `Err` says what does not fit.
    fn take(&mut self, mut file: SessionFile) -> Result<SessionFile, String> {
        self.go_on_in(file.in_parts());
        let next = &file.summary;
        self.chunks += next.chunks;
        self.damage.extend(next.damage.iter().cloned());
        let unknown = next.unknown_encodings.iter().filter(|encoding| !self.unknown_encodings.contains(encoding));
        self.unknown_encodings.extend(unknown.cloned().collect::<Vec<_>>());
        file.streams.clear();
        for stream in &next.streams {
            let number = self.take_stream(stream)?;
            file.streams.push(number);
        }
        self.totals.go_on(&next.totals);
        for stream in &self.streams {
            self.totals.streams.insert(stream.description.id.clone(), stream.totals);
        }
        Ok(file)
    }

    /// The number of a stream of the next file.
    fn take_stream(&mut self, next: &Stream) -> Result<usize, String> {
        let of = &next.description;
        let Some((number, _)) = self.stream(&of.id) else {
            self.streams.push(next.clone());
            return Ok(self.streams.len() - 1);
        };
        let stream = &mut self.streams[number];
        let known = &stream.description;
        if (known.encoding, known.width, known.height) != (of.encoding, of.width, of.height) {
            return Err(format!("its stream '{}' is another", of.id));
        }
        stream.totals.go_on(&next.totals);
        Ok(number)
    }

    /// The session goes on in another file.
    fn go_on_in(&mut self, file: FileSummary) {
        self.complete &= file.complete;
        self.file_bytes = self.file_bytes.saturating_add(file.bytes);
        self.whole_bytes = self.whole_bytes.saturating_add(file.whole_bytes);
        self.files.push(file);
    }
}
