//! Text in zip archives, as the University of Zurich packs the events of its data sets.

use std::{
    fs::File,
    io::{BufReader, Read},
    path::Path,
};

use zip::ZipArchive;

use super::{Anomalies, Decoder, EventFile, EventFileError, RawHeader, Sink};

/// Bytes unpacked at once.
const PIECE: usize = 1 << 20;
/// An archive may unpack to so many bytes, and to so many for each of its own: text of events packs to a quarter.
const ROOM: u64 = 256 << 20;
const ROOM_FOR_EACH: u64 = 64;

/// The name of the member that holds events as text, and how it begins.
///
/// # Errors
/// What the archive is instead.
pub(super) fn text_in(path: &Path) -> Result<(String, Vec<u8>), String> {
    let mut zip = open(path).map_err(|error| format!("it is an archive that cannot be read ({error})"))?;
    let is_events = |name: &str| matches!(name.rsplit('/').next(), Some("events.txt" | "events.csv"));
    // The shortest path first: `events.txt` itself before that of a folder.
    let names = zip.file_names_raw().filter_map(|name| Some(std::str::from_utf8(name).ok()?.to_owned()));
    let found = names.filter(|name| is_events(name)).min_by_key(|name| (name.len(), name.clone()));
    let Some(name) = found else {
        return Err("it is an archive without `events.txt`; unpack it, and give what holds events".into());
    };
    let mut start = Vec::new();
    let member = zip.by_name(&name).map_err(|error| format!("its `{name}` cannot be unpacked ({error})"))?;
    member
        .take(RawHeader::MAX_BYTES as u64)
        .read_to_end(&mut start)
        .map_err(|error| format!("its `{name}` cannot be unpacked ({error})"))?;
    Ok((name, start))
}

fn open(path: &Path) -> zip::result::ZipResult<ZipArchive<BufReader<File>>> {
    ZipArchive::new(BufReader::new(File::open(path)?))
}

/// Decodes a member, as long as `go_on` says so, which is told the bytes that were unpacked.
///
/// # Errors
/// If it cannot be unpacked, or unpacks to much more than the archive holds.
pub(super) fn decode(
    file: &EventFile,
    name: &str,
    sink: &mut impl Sink,
    mut go_on: impl FnMut(u64) -> bool,
) -> Result<Anomalies, EventFileError> {
    let path = &file.path;
    let failed = |offset, source| EventFileError::Io { doing: "unpack", path: path.clone(), offset, source };
    let mut zip = open(path).map_err(|error| failed(0, error.into()))?;
    let mut member = zip.by_name(name).map_err(|error| failed(0, error.into()))?;
    let mut decoder = file.decoder();
    let skipped = std::io::copy(&mut (&mut member).take(file.body), &mut std::io::sink());
    skipped.map_err(|source| failed(0, source))?;
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let most = ROOM.saturating_add(length.saturating_mul(ROOM_FOR_EACH));
    let (mut piece, mut offset) = (vec![0; PIECE], 0);
    loop {
        let count = member.read(&mut piece).map_err(|source| failed(offset, source))?;
        if count == 0 {
            break;
        }
        offset += count as u64;
        if offset > most {
            let what = format!("it unpacks to more than {most} bytes, which no recording of that size does");
            return Err(failed(offset, std::io::Error::other(what)));
        }
        decoder.decode(&piece[..count], sink);
        file.check(&decoder)?;
        if !go_on(offset) {
            break;
        }
    }
    decoder.finish(sink);
    file.check(&decoder)?;
    Ok(decoder.anomalies())
}
