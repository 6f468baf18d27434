//! Frames of a session as image files.

use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

use super::{
    ImportError, SessionOptions, Timing, Viewpoint, Written,
    exposures::{self, Overlaps},
    scaled,
};
use crate::{Frame, layout};
use erfgs_base::progress::{Progress, in_parallel};
use erfgs_scene::{ImageRgb8, image::Resample};
use erfgs_session::{
    clock::Exposure,
    container::{ContainerError, Entry, Session},
    source::{LATE_NS, Packet},
};

/// Frames that are decoded and written together.
const BATCH: usize = 64;
/// The frames of a view that are wanted.
pub(super) struct Planned {
    view: usize,
    /// The exposures on the session's clock, in order; their lengths are known, or 0.
    exposures: Vec<Exposure>,
    /// The place among them of each packet.
    places: HashMap<u64, usize>,
    /// What was taken off the exposures.
    pub overlaps: Option<Overlaps>,
}

impl Planned {
    /// Each `every`-th frame of a view whose exposure has its middle within the window.
    pub fn new(view: usize, timing: &Timing, [from, to]: [i64; 2], every: usize) -> Self {
        let on_clock = |(&sequence, exposure): (&u64, &Exposure)| {
            let mid_ns = exposure.mid_ns.saturating_add(timing.offset_ns);
            // As long on both sides of the middle.
            let length_ns = exposure.length_ns.unwrap_or(0).max(0) / 2 * 2;
            (Exposure { mid_ns, length_ns: Some(length_ns) }, sequence)
        };
        let mut frames: Vec<(Exposure, u64)> = timing.frames.iter().map(on_clock).collect();
        frames.sort_unstable();
        let (mut exposures, sequences): (Vec<Exposure>, Vec<u64>) = frames.into_iter().unzip();
        // Of all frames: those that are not imported were exposed, too.
        let overlaps = exposures::part(&mut exposures);
        // Counted from the start of the recording, so that the same frames are taken in any window.
        let every = exposures.into_iter().zip(sequences).step_by(every);
        let (exposures, sequences): (Vec<Exposure>, Vec<u64>) =
            every.filter(|(exposure, _)| (from..=to).contains(&exposure.mid_ns)).unzip();
        let places = sequences.into_iter().enumerate().map(|(place, sequence)| (sequence, place)).collect();
        Self { view, exposures, places, overlaps }
    }

    /// When the shutter opened and closed for the frame at a place; equal where that is not known.
    fn exposure_ns(&self, place: usize) -> [i64; 2] {
        self.exposures[place].span_ns()
    }

    /// When the first exposure begins.
    pub fn first_ns(&self) -> Option<i64> {
        self.exposures.iter().map(|exposure| exposure.span_ns()[0]).min()
    }
}

/// A frame's packet, the plan that wants it and its place there.
struct Task {
    plan: usize,
    place: usize,
    packet: Packet,
}

/// Writes all frames that are planned. Those that are damaged are left out and counted.
pub(super) fn write(
    session: &mut Session,
    streams: &[usize],
    views: &[Viewpoint],
    plans: &[Planned],
    options: &SessionOptions,
    root: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Vec<Written>, ImportError> {
    let start_ns = session.summary().start.host_ns;
    let of_stream: BTreeMap<usize, usize> =
        plans.iter().enumerate().map(|(plan, planned)| (streams[planned.view], plan)).collect();
    let descriptions: Vec<_> =
        plans.iter().map(|planned| session.summary().streams[streams[planned.view]].description.clone()).collect();
    let total: usize = plans.iter().map(|planned| planned.exposures.len()).sum();
    let ends = |exposures: &[Exposure]| Some((exposures.first()?.mid_ns, exposures.last()?.mid_ns));
    let (first, last) = plans
        .iter()
        .filter_map(|planned| ends(&planned.exposures))
        .fold((i64::MAX, i64::MIN), |(first, last), (from, to)| (first.min(from), last.max(to)));
    if total == 0 {
        return Ok(Vec::new());
    }
    let last_arrival = last.saturating_add(start_ns).saturating_add(LATE_NS);

    let mut good: Vec<Vec<bool>> = plans.iter().map(|planned| vec![false; planned.exposures.len()]).collect();
    let mut batch: Vec<Task> = Vec::new();
    let mut done = 0;
    let mut flush = |batch: &mut Vec<Task>| -> Result<(), ImportError> {
        let work = |task: &Task, _: &dyn Fn()| -> Result<bool, ImportError> {
            let (planned, d) = (&plans[task.plan], &descriptions[task.plan]);
            let Some(Ok(image)) = d.frame_format().map(|format| format.picture(&task.packet.payload)) else {
                return Ok(false);
            };
            if [image.width, image.height] != [d.width, d.height] {
                return Ok(false);
            }
            let scale = options.scale_of(&views[planned.view]);
            save(&views[planned.view], image, scale, options.resample, task.place, root)?;
            Ok(true)
        };
        let whole = in_parallel(options.jobs, batch, ("frames", 0), work, &mut |_| {})?;
        for (task, whole) in batch.drain(..).zip(whole) {
            good[task.plan][task.place] = whole;
            done += 1;
        }
        progress(Progress { what: "frames", done, total: total as u64 });
        Ok(())
    };
    let from = first.saturating_add(start_ns).saturating_sub(LATE_NS);
    for entry in session.messages(Some(from)) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        if packet.host_ns > last_arrival {
            break;
        }
        let Some(&plan) = of_stream.get(&stream) else { continue };
        let Some(&place) = plans[plan].places.get(&packet.sequence) else { continue };
        if packet.damaged {
            continue;
        }
        batch.push(Task { plan, place, packet });
        if batch.len() == BATCH {
            flush(&mut batch)?;
        }
    }
    flush(&mut batch)?;
    let written = plans.iter().zip(good).map(|(planned, good)| {
        let lost = good.iter().filter(|good| !**good).count();
        let places = good.iter().enumerate().filter(|(_, good)| **good).map(|(place, _)| place);
        let frames = places.map(|place| frame(&views[planned.view].camera, place, planned.exposure_ns(place)));
        Written { view: planned.view, frames: frames.collect(), lost }
    });
    Ok(written.collect())
}

/// Writes the pictures that an event camera took besides.
pub(super) fn write_pictures(
    view: usize,
    viewpoint: &Viewpoint,
    pictures: Vec<([i64; 2], ImageRgb8)>,
    merged: u32,
    root: &Path,
) -> Result<Written, ImportError> {
    let mut frames = Vec::new();
    let size = [viewpoint.intrinsics.width, viewpoint.intrinsics.height];
    let mut lost = 0;
    for (place, (exposure_ns, image)) in pictures.into_iter().enumerate() {
        if [image.width, image.height] != size {
            lost += 1;
            continue;
        }
        save(viewpoint, image, 1.0 / f64::from(merged), Resample::Area, place, root)?;
        frames.push(frame(&viewpoint.camera, place, exposure_ns));
    }
    frames.sort_by_key(|frame| frame.t_ns);
    Ok(Written { view, frames, lost })
}

fn frame(camera: &str, place: usize, exposure_ns: [i64; 2]) -> Frame {
    let t_ns = i64::midpoint(exposure_ns[0], exposure_ns[1]);
    Frame { file: layout::image(camera, place), t_ns, exposure_ns, mask: None }
}

fn save(
    view: &Viewpoint,
    image: ImageRgb8,
    scale: f64,
    resample: Resample,
    place: usize,
    root: &Path,
) -> Result<(), ImportError> {
    let target = scaled(&view.intrinsics, scale);
    let image = if [image.width, image.height] == [target.width, target.height] {
        image
    } else {
        image.resized(target.width, target.height, resample)
    };
    let failed = |source| ImportError::Image { camera: view.stream.clone(), source };
    image.write_png(&root.join(layout::image(&view.camera, place))).map_err(failed)
}

/// Frames that a camera should have taken.
pub(super) struct Gap {
    /// About how many.
    pub frames: u64,
    /// Between which of its frames, or the beginning or the end of those of others, session nanoseconds.
    pub between: [i64; 2],
}

/// The gaps in the frames of a camera: before its first and after its last frame, where others have frames, and between them.
/// Times are still those of the session.
pub(super) fn gaps(frames: &[Frame], all: &[Written]) -> Vec<Gap> {
    let mut apart: Vec<i64> = frames.windows(2).map(|pair| pair[1].t_ns - pair[0].t_ns).collect();
    let middle = apart.len() / 2;
    if apart.is_empty() {
        return Vec::new();
    }
    let usual_ns = (*apart.select_nth_unstable(middle).1).max(1);
    let times = || all.iter().flat_map(|one| one.frames.iter().map(|frame| frame.t_ns));
    let (Some(first), Some(last)) = (times().min(), times().max()) else { return Vec::new() };
    let inner = frames.windows(2).map(|pair| ([pair[0].t_ns, pair[1].t_ns], 1));
    let outer = [([first, frames[0].t_ns], 0), ([frames[frames.len() - 1].t_ns, last], 0)];
    let gap = |(between, known): ([i64; 2], i64)| {
        let length = between[1] - between[0];
        // At the ends a whole interval must lack, give or take what times are rounded by; between frames half of one more tells.
        let missing =
            if known == 1 { (length + usual_ns / 2) / usual_ns - 1 } else { (length + usual_ns / 50) / usual_ns };
        (missing > 0).then_some(Gap { frames: missing.unsigned_abs(), between })
    };
    outer[..1].iter().copied().chain(inner).chain(outer[1..].iter().copied()).filter_map(gap).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(times_ms: &[i64]) -> Written {
        let frame = |t_ms: &i64| Frame {
            file: "a".into(),
            t_ns: t_ms * 1_000_000,
            exposure_ns: [t_ms * 1_000_000; 2],
            mask: None,
        };
        Written { view: 0, frames: times_ms.iter().map(frame).collect(), lost: 0 }
    }

    #[test]
    fn exposures_are_parted_before_frames_are_chosen() {
        let exposures = (0..6).map(|n| (n, Exposure { mid_ns: 33_000_000 * n as i64, length_ns: Some(50_000_000) }));
        let timing = Timing { frames: exposures.collect(), ..Timing::default() };
        let planned = Planned::new(0, &timing, [i64::MIN, i64::MAX], 2);
        let overlaps = planned.overlaps.unwrap();
        assert_eq!((overlaps.frames, overlaps.longest_ns, overlaps.apart_ns), (6, 50_000_000, 33_000_000));
        let length = |place| planned.exposure_ns(place)[1] - planned.exposure_ns(place)[0];
        assert_eq!([0, 1, 2].map(length), [33_000_000; 3], "every second frame, exposed no longer than they were");
    }

    #[test]
    fn frames_that_lack_before_after_and_between_are_counted_and_those_that_are_not_due_are_not() {
        let all = [
            taken(&[0, 50, 100, 150, 200, 250]),
            taken(&[100, 150]),
            // Not at the same instants, and faster.
            taken(&[7, 24, 40, 57, 74, 90, 107, 124, 140, 157, 174, 190, 207, 224, 240]),
            taken(&[130]),
        ];
        let found: Vec<Vec<(u64, [i64; 2])>> = all
            .iter()
            .map(|one| {
                gaps(&one.frames, &all).iter().map(|gap| (gap.frames, gap.between.map(|t| t / 1_000_000))).collect()
            })
            .collect();
        assert_eq!(found[0], []);
        assert_eq!(found[1], [(2, [0, 100]), (2, [150, 250])]);
        assert_eq!((found[2].len(), found[3].len()), (0, 0));
        let mut gone = taken(&[0, 50, 100, 150, 200, 450, 500]);
        assert_eq!(gaps(&gone.frames, &all).iter().map(|gap| gap.frames).collect::<Vec<_>>(), [4]);
        gone.frames.truncate(3);
        assert_eq!(gaps(&gone.frames, &all).iter().map(|gap| gap.between[1]).collect::<Vec<_>>(), [250_000_000]);
    }
}
