//! Frames in which the board was found, read once more for the report.

use std::collections::BTreeMap;

use erfgs_events::EventFile;
use erfgs_scene::{ImageRgb8, video::Video};
use erfgs_session::container::{ContainerError, Entry, Session};
use erfgs_sync::{StreamSync, Synchronisation};

use super::{
    BoardDetections, BoardError, BoardView, Plate,
    layout::{VIDEOS, has_extension},
    session::decode,
    stream::{EventBoard, picture_at},
};
use crate::evidence::{Evidence, Picture};

/// The frames of cameras (indices in `seen`) that show placements (numbers in `evidence`), reduced, with the corners that were
/// found. Those of events are pictures of what `events` says, by the same `sync` with which they were found. Frames are read
/// one at a time.
///
/// # Errors
/// If a file can no longer be read.
pub fn pictures(
    seen: &[BoardDetections],
    plate: impl Into<Plate>,
    events: Option<EventBoard>,
    evidence: &Evidence,
    wanted: &[(usize, usize)],
    sync: Option<&Synchronisation>,
) -> Result<Vec<Picture>, BoardError> {
    let plate = &plate.into();
    let mut pictures = Vec::new();
    // Sessions are walked once for all their streams.
    let mut packets: BTreeMap<(&str, u64), (usize, usize, &BoardView)> = BTreeMap::new();
    for &(camera, placement) in wanted {
        let (Some(seen), Some(moment)) = (seen.get(camera), evidence.moments.get(placement)) else { continue };
        let Some(view) = seen.views.iter().find(|view| view.instant == moment.name) else { continue };
        if !seen.events && has_extension(&view.file, &["mcap"]) {
            packets.insert((&seen.camera, view.frame), (camera, placement, view));
            continue;
        }
        let clock = sync.and_then(|sync| sync.stream(&seen.camera));
        let image = if seen.events { of_events(seen, view, events, clock)? } else { of_file(view)? };
        pictures.push(picture(camera, placement, &image, view, plate));
    }
    let Some((_, _, first)) = packets.values().next() else { return Ok(pictures) };
    let mut session = Session::open(&first.file)?;
    let streams = session.summary().streams.clone();
    for entry in session.messages(None) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        let d = &streams[stream].description;
        let Some((camera, placement, view)) = packets.remove(&(d.id.as_str(), packet.sequence)) else { continue };
        if let Some(Ok(image)) = d.frame_format().map(|format| format.picture(&packet.payload)) {
            pictures.push(picture(camera, placement, &image, view, plate));
        }
        if packets.is_empty() {
            break;
        }
    }
    pictures.sort_by_key(|picture| picture.camera);
    Ok(pictures)
}

fn picture(camera: usize, placement: usize, image: &ImageRgb8, view: &BoardView, plate: &Plate) -> Picture {
    let found = plate.points(view).map(|(corner, point)| (point, corner.pixel));
    Picture { found: found.collect(), ..Picture::new(camera, Some(placement), image) }
}

fn of_file(view: &BoardView) -> Result<ImageRgb8, BoardError> {
    if !has_extension(&view.file, &VIDEOS) {
        return Ok(ImageRgb8::read(&view.file)?);
    }
    let mut video = Video::open(&view.file)?;
    for _ in 0..view.frame {
        video.next_frame()?;
    }
    video.next_frame()?.ok_or_else(|| gone(view))
}

fn of_events(
    seen: &BoardDetections,
    view: &BoardView,
    events: Option<EventBoard>,
    clock: Option<&StreamSync>,
) -> Result<ImageRgb8, BoardError> {
    let board = events.ok_or_else(|| BoardError::NoBlink { path: view.file.clone() })?;
    let size = seen.size.map(|side| side as usize);
    let mut failure: Option<BoardError> = None;
    let image = if has_extension(&view.file, &["mcap"]) {
        let mut session = Session::open(&view.file)?;
        let (stream, _) = session.stream(&seen.camera)?;
        picture_at(size, board, view.frame, &mut |watcher| {
            failure = decode(&mut session, stream, clock, watcher);
        })
    } else {
        let file = EventFile::open(&view.file)?;
        picture_at(size, board, view.frame, &mut |watcher| failure = file.decode(watcher).err().map(BoardError::from))
    };
    failure.map_or_else(|| image.ok_or_else(|| gone(view)), Err)
}

fn gone(view: &BoardView) -> BoardError {
    BoardError::NoFrame { path: view.file.clone(), frame: view.frame }
}
