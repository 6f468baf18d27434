//! The files of a session that is recorded in several: when it goes on in the next one, and what if that cannot be made.

use std::{
    fs::File,
    io::{self, Write},
    path::{Path, PathBuf},
};

use erfgs_session::{
    container::{SessionWriter, Split, part_path},
    source::{Incident, Packet},
};

use super::{
    session_file::{not_begun, not_made, sort},
    sink::SinkError,
    status::Level,
};

/// After this long a file that could not be made is tried again, nanoseconds.
const AGAIN_NS: i64 = 10_000_000_000;

/// See the module.
pub(super) struct Files<W> {
    first: PathBuf,
    split: Split,
    /// Makes a file that must not exist.
    create: fn(&Path) -> io::Result<W>,
    /// Nothing is tried before this host time.
    not_before_ns: i64,
    /// What the user was not told yet.
    pub news: Vec<(Level, String)>,
}

impl Files<File> {
    /// Of the session that begins in `first`.
    pub fn new(first: &Path, split: Split) -> Self {
        let create = |path: &Path| File::create_new(path);
        Self { first: first.to_owned(), split, create, not_before_ns: i64::MIN, news: Vec::new() }
    }
}

impl<W: Write> Files<W> {
    /// Goes on in the next file if `packet` belongs there. If that cannot be made, the present one takes more.
    pub fn change_if_full(&mut self, writer: &mut SessionWriter<W>, packet: &Packet) -> Result<(), SinkError> {
        if packet.host_ns < self.not_before_ns || !writer.is_full(self.split, packet) {
            return Ok(());
        }
        let present = part_path(&self.first, writer.part_number());
        let path = part_path(&self.first, writer.part_number() + 1);
        let made = (self.create)(&path).map_err(|error| not_made(&path, error));
        let begun =
            made.and_then(|file| writer.next_part(file, &path).map_err(|error| not_begun(&path, sort(&path, error))));
        match begun {
            Ok(next) => {
                let mut ended = writer.change_to(next).map_err(|error| sort(&present, error))?;
                ended.sink.flush().map_err(|error| SinkError::io(&present, error))?;
                self.news.push((Level::Info, format!("the recording goes on in '{}'", path.display())));
            }
            Err(why) => {
                self.not_before_ns = packet.host_ns.saturating_add(AGAIN_NS);
                let message = format!("'{}' takes more than it should: {why}", present.display());
                let warning = Incident::Warning { message: message.clone() };
                writer.incident(None, packet.host_ns, &warning).map_err(|error| sort(&present, error))?;
                self.news.push((Level::Warning, message));
            }
        }
        Ok(())
    }
}
