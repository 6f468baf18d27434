//! Boards in the streams of a recorded session.

use std::collections::{HashMap, HashSet};

use erfgs_events::{CdEvent, Sink};
use erfgs_scene::ImageRgb8;
use erfgs_session::{
    clock::{Dated, Exposure},
    container::{ContainerError, Entry, Session},
};
use erfgs_sync::{StreamSync, Synchronisation};
use rayon::prelude::*;

use super::{
    BoardDetections, BoardError, BoardView, EventBoard, Plate,
    input::{Mirrors, count_mirrored},
    stream::{Watcher, watch},
};

/// Frames that are looked at together.
const BATCH: usize = 16;

/// Looks for a board in all streams of a session: in the frames, and, where `events` says what to look for,
/// in the events. `sync` says when things were seen on the session's clock: without it frames are taken for as old as their
/// arrival, and events are looked at by their devices' own time. Frames of several cameras within half a frame's time of each
/// other belong together. `progress` gets the number of frames looked at and, where there are only frames, that of all.
///
/// # Errors
/// If the session cannot be read, or has no stream to look at.
pub fn look_session(
    session: &mut Session,
    plate: impl Into<Plate>,
    events: Option<EventBoard>,
    sync: Option<&Synchronisation>,
    progress: &(dyn Fn(usize, Option<usize>) + Sync),
) -> Result<Vec<BoardDetections>, BoardError> {
    let plate = &plate.into();
    let path = &session.path().to_owned();
    let of_stream = |id: &str| sync.and_then(|sync| sync.stream(id));
    let streams = session.summary().streams.clone();
    let start = session.summary().start.clone();
    let mut seen: Vec<Option<BoardDetections>> = streams
        .iter()
        .map(|stream| {
            let d = &stream.description;
            let looked_at = d.encoding.is_frames() || (d.encoding.is_events() && events.is_some());
            looked_at.then(|| BoardDetections {
                camera: d.id.clone(),
                events: d.encoding.is_events(),
                size: [d.width, d.height],
                source: path.into(),
                ..BoardDetections::default()
            })
        })
        .collect();
    if seen.iter().all(Option::is_none) {
        return Err(BoardError::NoFrames { path: path.into() });
    }
    let exposures: Vec<HashMap<u64, Exposure>> = streams
        .iter()
        .map(|stream| of_stream(&stream.description.id).map(StreamSync::frames).unwrap_or_default())
        .collect();
    let is_frames = |stream: usize| streams[stream].description.encoding.is_frames();
    let total =
        (0..streams.len()).filter(|stream| is_frames(*stream)).map(|s| streams[s].totals.packets as usize).sum();
    let mirrors: Vec<Mirrors> =
        streams.iter().map(|stream| Mirrors::of(Some(stream.totals.packets as usize))).collect();
    let mut done = 0;
    let mut batch: Vec<(usize, u64, i64, ImageRgb8)> = Vec::new();
    let look_at = |batch: &mut Vec<(usize, u64, i64, ImageRgb8)>, seen: &mut [Option<BoardDetections>]| {
        let look = |(stream, frame, _, image): &(usize, u64, i64, ImageRgb8)| {
            let corners = plate.detect(image);
            let mirrored = mirrors[*stream].look(*frame as usize, image, &corners, plate);
            (corners, mirrored)
        };
        let corners: Vec<_> = batch.par_iter().map(look).collect();
        for ((stream, frame, t_ns, _), (corners, mirrored)) in batch.drain(..).zip(corners) {
            let Some(seen) = &mut seen[stream] else { continue };
            seen.frames += 1;
            count_mirrored(&mut seen.mirrored, mirrored);
            if !corners.is_empty() {
                let time_s = Some(1e-9 * t_ns as f64);
                seen.views.push(BoardView { instant: String::new(), time_s, file: path.into(), frame, corners });
            }
        }
    };
    for entry in session.messages(None) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) if is_frames(stream) => (stream, packet),
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        let d = &streams[stream].description;
        done += 1;
        progress(done, Some(total));
        // A frame that was cut or damaged shows nothing.
        let Some(Ok(image)) = d.frame_format().map(|format| format.picture(&packet.payload)) else { continue };
        let mid_ns = exposures[stream].get(&packet.sequence).map(|exposure| exposure.mid_ns);
        let t_ns = mid_ns.unwrap_or_else(|| start.session_ns(packet.host_ns));
        batch.push((stream, packet.sequence, t_ns, image));
        if batch.len() == BATCH {
            look_at(&mut batch, &mut seen);
        }
    }
    look_at(&mut batch, &mut seen);
    if let Some(board) = events {
        for (index, stream) in streams.iter().enumerate().filter(|(_, s)| s.description.encoding.is_events()) {
            let Some(seen) = &mut seen[index] else { continue };
            let size = seen.size.map(|side| side as usize);
            let tick = || progress(done, None);
            let mut failure = None;
            (seen.frames, seen.views) = watch(path, size, plate, board, &tick, &mut |watcher| {
                failure = decode(session, index, of_stream(&seen.camera), watcher);
            });
            if let Some(error) = failure {
                return Err(error);
            }
            tracing::debug!(stream = stream.description.id, views = seen.views.len(), "looked for a board in events");
        }
    }
    let mut seen: Vec<BoardDetections> = seen.into_iter().flatten().collect();
    let frame_s = streams
        .iter()
        .filter(|stream| stream.description.encoding.is_frames() && stream.totals.packets > 1)
        .filter_map(|stream| {
            let (first, last) = stream.totals.first_host_ns.zip(stream.totals.last_host_ns)?;
            Some(1e-9 * last.saturating_sub(first) as f64 / (stream.totals.packets - 1) as f64)
        })
        .fold(f64::INFINITY, f64::min);
    name_instants(&mut seen, 0.5 * frame_s.min(1.0));
    Ok(seen)
}

/// Hands the events of a stream to `watcher`: with session time if the stream has clocks, with its device's own otherwise.
pub(super) fn decode(
    session: &mut Session,
    stream: usize,
    sync: Option<&StreamSync>,
    watcher: &mut Watcher<'_>,
) -> Option<BoardError> {
    let decoded = match sync.map(|sync| &sync.epochs).filter(|epochs| !epochs.are_undated()) {
        Some(epochs) => session.decode_events(stream, None, &mut Dated::new(epochs, Handed(watcher)), |_| {}),
        None => session.decode_events(stream, None, watcher, |_| {}),
    };
    decoded.err().map(BoardError::from)
}

struct Handed<'a, 'b>(&'a mut Watcher<'b>);

impl Sink for Handed<'_, '_> {
    fn event(&mut self, event: CdEvent) {
        self.0.event(event);
    }
}

/// Gives views that lie within `tolerance_s` of each other the same instant, one of each camera at most.
fn name_instants(seen: &mut [BoardDetections], tolerance_s: f64) {
    let mut views: Vec<(f64, usize, usize)> = Vec::new();
    for (camera, seen) in seen.iter().enumerate() {
        views.extend(seen.views.iter().enumerate().filter_map(|(view, v)| Some((v.time_s?, camera, view))));
    }
    views.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut since, mut taken, mut number) = (f64::NEG_INFINITY, HashSet::new(), 0);
    for (time, camera, view) in views {
        if time - since > tolerance_s || taken.contains(&camera) {
            (since, number) = (time, number + 1);
            taken.clear();
        }
        taken.insert(camera);
        seen[camera].views[view].instant = number.to_string();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_within_half_a_period_are_one_instant() {
        let of = |times: &[f64]| BoardDetections {
            camera: String::new(),
            events: false,
            size: [4, 4],
            frames: times.len(),
            views: times
                .iter()
                .map(|t| BoardView {
                    instant: String::new(),
                    time_s: Some(*t),
                    file: "a".into(),
                    frame: 0,
                    corners: Vec::new(),
                })
                .collect(),
            ..BoardDetections::default()
        };
        let mut seen = vec![of(&[0.0, 0.1, 0.2]), of(&[0.01, 0.12, 0.26])];
        name_instants(&mut seen, 0.05);
        let names =
            |seen: &BoardDetections| seen.views.iter().map(|view| view.instant.clone()).collect::<Vec<_>>().join(" ");
        assert_eq!([names(&seen[0]), names(&seen[1])], ["1 2 3", "1 2 4"]);
    }
}
