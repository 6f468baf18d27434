//! Repairing a file where it lies.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use super::{
    Recovered, open_error, read_back,
    survey::{Survey, survey},
    worth_saving,
};
use crate::container::ContainerError;

/// Repairs `path` itself: cuts off what is not whole and appends the index, which needs next to no room. What it cuts off and
/// overwrites is kept beside it, as `NAME.before`, until the result was read back. Does nothing if it is whole.
///
/// # Errors
/// If the file cannot be read or written or is no MCAP file, or if something in its middle is lost: that is left to
/// [`recover`](super::recover). Then it is as it was before.
pub fn recover_in_place(path: &Path) -> Result<Recovered, ContainerError> {
    let file = File::options().read(true).write(true).open(path);
    let file = file.map_err(|source| open_error("open", path, source))?;
    let survey = survey(&file, path)?;
    if !survey.recovered.damaged.is_empty() {
        return Err(ContainerError::DamagedWithin { path: path.to_owned(), places: survey.recovered.damaged.len() });
    }
    if survey.is_whole() {
        return Ok(Recovered { was_whole: true, ..survey.recovered });
    }
    worth_saving(&survey, path)?;
    let Survey { recovered, patches, tail, end, .. } = survey;
    let before = Before::keep(&file, path, end, &patches)?;
    let write = || {
        for (place, byte) in &patches {
            put(&file, *place, &[*byte])?;
        }
        file.set_len(end)?;
        put(&file, end, &tail.into_bytes(end))?;
        file.sync_all()
    };
    let written = write().map_err(|source| ContainerError::Write { path: path.to_owned(), offset: end, source });
    match written.and_then(|()| read_back(path, &recovered)) {
        Ok(()) => before.forget(),
        Err(error) => {
            before.put_back(&file)?;
            return Err(error);
        }
    }
    Ok(recovered)
}

fn put(mut file: &File, at: u64, bytes: &[u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(at))?;
    file.write_all(bytes)
}

/// What a repair in place overwrites, in a file beside it: the end of the session from a byte on.
struct Before {
    path: PathBuf,
    from: u64,
    bytes: Vec<(u64, u8)>,
}

impl Before {
    fn keep(mut file: &File, path: &Path, from: u64, patches: &[(u64, u8)]) -> Result<Self, ContainerError> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".before");
        let kept = path.with_file_name(name);
        if kept.exists() {
            return Err(ContainerError::RepairCutOff { path: path.to_owned(), kept });
        }
        let unread = |offset| move |source| ContainerError::Read { path: path.to_owned(), offset, source };
        let mut bytes = Vec::new();
        for &(at, _) in patches {
            let mut byte = [0];
            file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut byte)).map_err(unread(at))?;
            bytes.push((at, byte[0]));
        }
        file.seek(SeekFrom::Start(from)).map_err(unread(from))?;
        let copied = erfgs_base::atomic::write_with(&kept, |sink| io::copy(&mut file, sink).map(drop));
        copied.map_err(|source| ContainerError::NotWritten { path: kept.clone(), source })?;
        Ok(Self { path: kept, from, bytes })
    }

    fn forget(&self) {
        let _ = std::fs::remove_file(&self.path);
    }

    /// The session is as it was before.
    fn put_back(&self, mut file: &File) -> Result<(), ContainerError> {
        let mut put_all = || {
            for (at, byte) in &self.bytes {
                put(file, *at, &[*byte])?;
            }
            file.set_len(self.from)?;
            file.seek(SeekFrom::Start(self.from))?;
            io::copy(&mut File::open(&self.path)?, &mut file)?;
            file.sync_all()
        };
        put_all().map_err(|source| ContainerError::Write { path: self.path.clone(), offset: 0, source })?;
        self.forget();
        Ok(())
    }
}
