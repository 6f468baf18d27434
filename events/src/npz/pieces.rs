//! Events of an archive that are read piece by piece, as they may be larger than memory.

use std::{fs::File, io::BufReader, ops::ControlFlow, path::Path};

use erfgs_base::npy::{NpyColumn, NpyReadError};
use zip::{read::ZipFile, result::ZipError};

use super::{Archive, Column, NpzError, P, T, X, Y, next_events_of, open, too_much, unequal};
use crate::Events;

/// Events that are read at once.
const PIECE: usize = 1 << 18;

/// Reads events as [`super::read_events`] does, of a sensor of this size in pixels, and hands them over piece by piece, in their order,
/// until there are no more or `take` breaks off. Each piece is checked before it is handed over; what is wrong with a later one ends the
/// reading then.
///
/// # Errors
/// As [`super::read_events`].
pub fn read_pieces(
    path: &Path,
    size: [u32; 2],
    mut take: impl FnMut(&Events) -> ControlFlow<()>,
) -> Result<(), NpzError> {
    // A member of an archive is read from its beginning to its end, so that each column has an archive of its own.
    let [mut ts, mut xs, mut ys, mut ps] = [archive(path)?, archive(path)?, archive(path)?, archive(path)?];
    ts.check_names()?;
    let sensor = ts.sensor(Some(size))?.unwrap_or(size);
    let (room, most) = (ts.room, ts.most);
    let (mut t, mut x, mut y, mut p) =
        (column(&mut ts, &T)?, column(&mut xs, &X)?, column(&mut ys, &Y)?, column(&mut ps, &P)?);
    let columns = [&t, &x, &y, &p];
    let lengths = columns.map(|column| column.length());
    if lengths.iter().any(|&length| length != lengths[0]) {
        return Err(NpzError::Content { path: path.to_owned(), what: unequal(lengths) });
    }
    let unpacked = columns.into_iter().fold(0, |sum: u64, column| sum.saturating_add(column.bytes()));
    if unpacked > room {
        return Err(too_much(path, most));
    }
    let (mut first, mut last_us) = (0, i64::MIN);
    loop {
        let columns = (
            t.next(PIECE, T.2).map_err(wrong(path, &T))?,
            x.next(PIECE, X.2).map_err(wrong(path, &X))?,
            y.next(PIECE, Y.2).map_err(wrong(path, &Y))?,
            p.next(PIECE, P.2).map_err(wrong(path, &P))?,
        );
        let events = next_events_of(path, columns, Some(sensor), [first, last_us])?;
        (first, last_us) = (first + events.len() as i64, events.t_us.last().copied().unwrap_or(last_us));
        if !events.is_empty() && take(&events).is_break() || first as u64 >= lengths[0] {
            return Ok(());
        }
    }
}

fn archive(path: &Path) -> Result<Archive<'_, BufReader<File>>, NpzError> {
    Archive::new(open(path)?, path)
}

/// A column at its first value.
fn column<'a>(
    archive: &'a mut Archive<'_, BufReader<File>>,
    column: &Column,
) -> Result<NpyColumn<ZipFile<'a, BufReader<File>>>, NpzError> {
    let (path, place) = (archive.path, archive.place(column.0));
    let Some((_, index)) = place else { return Err(archive.missing(column.1)) };
    NpyColumn::begin(archive.member(index)?).map_err(wrong(path, column))
}

fn wrong(path: &Path, column: &Column) -> impl Fn(NpyReadError) -> NpzError {
    let (path, array) = (path.to_owned(), column.0[0].to_owned());
    move |error| match error {
        NpyReadError::Read(source) => NpzError::Archive { path: path.clone(), source: ZipError::Io(source) },
        NpyReadError::Array(source) => NpzError::Array { path: path.clone(), array: array.clone(), source },
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{read_events, write_events},
        *,
    };
    use crate::Event;

    /// Events over three pieces.
    fn many() -> Events {
        let mut events = Events::new(640, 360);
        for index in 0..2 * PIECE as u32 + 7 {
            let (x, y) = ((index * 7 % 640) as u16, (index * 5 % 360) as u16);
            events.push(Event { t_us: i64::from(index / 3), x, y, on: index % 2 == 0 });
        }
        events
    }

    fn pieces(path: &Path, size: [u32; 2]) -> Result<Vec<Events>, NpzError> {
        let mut pieces = Vec::new();
        read_pieces(path, size, |events| {
            pieces.push(events.clone());
            ControlFlow::Continue(())
        })?;
        Ok(pieces)
    }

    #[test]
    fn pieces_are_the_events_in_their_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.npz");
        for events in [many(), Events::new(640, 360)] {
            write_events(&path, &events).unwrap();
            let pieces = pieces(&path, [640, 360]).unwrap();
            assert_eq!(pieces.len(), if events.is_empty() { 0 } else { 3 });
            let all: Vec<Event> = pieces.iter().flat_map(Events::iter).collect();
            assert_eq!(all, events.iter().collect::<Vec<_>>());
        }
    }

    #[test]
    fn what_one_reader_refuses_the_other_does_too_and_names_the_same_event() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.npz");
        // In the second piece: a step back at its very beginning and one within, and an event outside.
        for (at, change) in [(PIECE, 0), (PIECE + 9, 0), (PIECE + 9, 1)] {
            let mut events = many();
            if change == 0 {
                events.t_us[at] = 5;
            } else {
                events.y[at] = 360;
            }
            write_events(&path, &events).unwrap();
            let [whole, pieces] = [read_events(&path, Some([640, 360])).map(drop), pieces(&path, [640, 360]).map(drop)]
                .map(Result::unwrap_err);
            assert!(whole.to_string().contains(&format!("event {at}")), "{whole}");
            assert_eq!(whole.to_string(), pieces.to_string());
        }
        write_events(&path, &many()).unwrap();
        assert!(pieces(&path, [320, 360]).unwrap_err().to_string().contains("one of 320 x 360 is named"));
        let bytes = std::fs::read(&path).unwrap();
        for cut in [0, 1, bytes.len() / 2, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            assert!(pieces(&path, [640, 360]).is_err(), "{cut} of {}", bytes.len());
        }
        // A byte of what is packed: another checksum, if it unpacks at all.
        let mut damaged = bytes.clone();
        damaged[bytes.len() / 3] ^= 0x10;
        std::fs::write(&path, damaged).unwrap();
        assert!(pieces(&path, [640, 360]).is_err());
    }

    #[test]
    fn reading_ends_where_the_taker_breaks_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.npz");
        write_events(&path, &many()).unwrap();
        let mut calls = 0;
        read_pieces(&path, [640, 360], |_| {
            calls += 1;
            ControlFlow::Break(())
        })
        .unwrap();
        assert_eq!(calls, 1);
    }
}
