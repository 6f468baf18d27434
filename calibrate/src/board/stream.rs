//! Boards in the events of a camera: those that blink on a screen, and printed ones that move.

use std::path::Path;

use erfgs_events::{CdEvent, EventFile, Sink};
use erfgs_scene::ImageRgb8;

use super::{
    BoardDetections, BoardError, BoardView, Plate, Target,
    blink::Windows,
    moved::moved_px,
    moving::{self, Looks},
};

/// What an event camera saw of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventBoard {
    /// It came and went on a screen.
    Blinking {
        /// How often in a second.
        hz: f64,
    },
    /// It was printed, and moved.
    Moving,
}

/// A blinking board that moved less than this (root mean square over its corners, pixels) since the last view adds nothing.
const MOVED_PX: f64 = 3.0;

impl EventBoard {
    /// `target` as it looks in the pictures that a stream gives: of what blinks they are dark, in whatever colour it is printed.
    #[must_use]
    pub fn as_seen(&self, target: &Target) -> Target {
        match self {
            Self::Blinking { .. } => target.as_inked(),
            Self::Moving => target.clone(),
        }
    }
}

/// The pictures of a stream of events in which a board is looked for.
#[derive(Clone)]
pub struct EventPictures(Kind);

#[derive(Clone)]
enum Kind {
    Blinking(Windows),
    Moving(Looks),
}

impl EventPictures {
    /// None yet, of a sensor of `size` columns and rows.
    #[must_use]
    pub fn new(size: [usize; 2], board: EventBoard) -> Self {
        Self(match board {
            EventBoard::Blinking { hz } => Kind::Blinking(Windows::new(size, hz)),
            EventBoard::Moving => Kind::Moving(Looks::new(size)),
        })
    }

    /// Takes events; hands each picture, as soon as it is complete, and its time, microseconds, to `found`.
    pub fn watch<'a>(&'a mut self, found: &'a mut dyn FnMut(i64, ImageRgb8)) -> Watcher<'a> {
        Watcher { pictures: self, found }
    }
}

/// See [`EventPictures::watch`].
pub struct Watcher<'a> {
    pictures: &'a mut EventPictures,
    found: &'a mut dyn FnMut(i64, ImageRgb8),
}

impl Watcher<'_> {
    /// There are no more events.
    fn finish(&mut self) {
        if let Kind::Blinking(windows) = &mut self.pictures.0 {
            windows.finish(self.found);
        }
    }
}

impl Sink for Watcher<'_> {
    fn event(&mut self, event: CdEvent) {
        match &mut self.pictures.0 {
            Kind::Blinking(windows) => windows.event(event, self.found),
            Kind::Moving(looks) => looks.event(event, self.found),
        }
    }
}

/// What a camera saw of a board, from a file of its events.
///
/// # Errors
/// If the file cannot be read or does not say how large the sensor is.
pub(super) fn of_events(
    camera: &str,
    path: &Path,
    plate: &Plate,
    board: EventBoard,
    tick: &(dyn Fn() + Sync),
) -> Result<BoardDetections, BoardError> {
    let file = EventFile::open(path)?;
    let Some(size) = file.size else { return Err(BoardError::NoSize { path: path.into() }) };
    let mut failure = None;
    let (frames, views) = watch(path, [size.width, size.height].map(usize::from), plate, board, tick, &mut |watcher| {
        failure = file.decode(watcher).err();
    });
    match failure {
        Some(error) => Err(error.into()),
        None => {
            let size = [u32::from(size.width), u32::from(size.height)];
            let (camera, source) = (camera.into(), path.to_owned());
            Ok(BoardDetections { camera, events: true, size, frames, views, source, ..BoardDetections::default() })
        }
    }
}

/// The number of pictures that were looked at, and those with a board that had moved. `decode` hands over the events.
pub(super) fn watch(
    path: &Path,
    size: [usize; 2],
    plate: &Plate,
    board: EventBoard,
    tick: &dyn Fn(),
    decode: &mut dyn FnMut(&mut Watcher<'_>),
) -> (usize, Vec<BoardView>) {
    let (mut frames, mut views) = (0, Vec::<BoardView>::new());
    let plate = plate.as_seen(board);
    let least_px = match board {
        EventBoard::Blinking { .. } => MOVED_PX,
        EventBoard::Moving => moving::MOVED * size[0] as f64,
    };
    let mut found = |t_us: i64, image: ImageRgb8| {
        frames += 1;
        tick();
        let corners = plate.detect(&image);
        let still = views.last().is_some_and(|last| moved_px(&last.corners, &corners) < least_px);
        if !corners.is_empty() && !still {
            let time_s = 1e-6 * t_us as f64;
            let (instant, frame) = (format!("{time_s:.2}"), t_us as u64);
            views.push(BoardView { instant, time_s: Some(time_s), file: path.into(), frame, corners });
        }
    };
    walk(size, board, &mut found, decode);
    (frames, views)
}

/// The picture of the time `t_us`, as the board was looked for in it.
pub(super) fn picture_at(
    size: [usize; 2],
    board: EventBoard,
    t_us: u64,
    decode: &mut dyn FnMut(&mut Watcher<'_>),
) -> Option<ImageRgb8> {
    let mut wanted = None;
    let mut keep = |time: i64, image: ImageRgb8| {
        if time as u64 == t_us {
            wanted = Some(image);
        }
    };
    walk(size, board, &mut keep, decode);
    wanted
}

/// Hands each picture of a stream and its time, microseconds, to `found`.
fn walk(
    size: [usize; 2],
    board: EventBoard,
    found: &mut dyn FnMut(i64, ImageRgb8),
    decode: &mut dyn FnMut(&mut Watcher<'_>),
) {
    let mut pictures = EventPictures::new(size, board);
    let mut watcher = pictures.watch(found);
    decode(&mut watcher);
    watcher.finish();
}
