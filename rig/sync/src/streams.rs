//! From what was gathered of all streams to the synchronisation of each.

use std::collections::BTreeMap;

use erfgs_session::{
    clock::{Clock, Epoch, Epochs, Sample},
    container::Stream,
    source::Description,
};

use super::{
    board::{Board, BoardLines, Bounds},
    collect::{Frames, Gathered},
    edges::Matched,
    epochs::{self, Fitted},
    even::{Even, even},
    exposures::Exposures,
    frames::{self, Arrived},
    lamp::Lamp,
    report::{StreamSync, Tier},
    strobe::{self, Eye, Kind, Strobe},
};

/// A plot of more points than this shows no more.
const MAX_POINTS: usize = 4000;
/// A clock that sets a larger share of its samples aside deserves a look.
const MANY_OUTLIERS: f64 = 0.03;
/// So many pulses that a camera saw and nobody can number are usual at the ends of a recording.
const MANY_UNKNOWN: u64 = 4;
/// Epochs that notes tell of one by one.
const TOLD_EPOCHS: usize = 8;

/// Fits all streams, in the order of the session.
pub(super) fn fit_all(streams: &[Stream], gathered: Vec<Gathered>) -> Vec<StreamSync> {
    let ids = || streams.iter().map(|stream| stream.description.id.clone());
    let mut found: BTreeMap<String, StreamSync> = BTreeMap::new();
    let mut board = None;
    let mut others = Vec::new();
    for (stream, gathered) in std::iter::zip(streams, gathered) {
        match gathered {
            Gathered::Board(lines) => {
                let (fit, sync) = fit_board(&stream.description.id, lines);
                // The first board that gave pulses counts.
                board = board.or(fit.filter(|board: &Board| !board.pulses.is_empty()));
                found.insert(sync.id.clone(), sync);
            }
            other => others.push((stream, other)),
        }
    }
    let mut cameras = Vec::new();
    let mut eyes = Vec::new();
    for (stream, gathered) in others {
        match gathered {
            Gathered::Events(events) if events.decoder.is_none() => {
                let mut sync = empty(&stream.description.id, Tier::FreeRunning);
                sync.faults.push("erfgs cannot decode the stream".into());
                found.insert(sync.id.clone(), sync);
            }
            Gathered::Events(events) => {
                let Description { id, encoding, .. } = &stream.description;
                let fitted = epochs::fit(events.stretches.finish(), *encoding, board.as_ref());
                eyes.push(Eye { id, fitted, sees: None });
            }
            Gathered::Frames(frames) => cameras.push((&stream.description, frames)),
            Gathered::Board(_) => {}
        }
    }
    let mut strobes = strobe::find(&cameras, &mut eyes, board.as_ref());
    let mut lamps: Vec<(Tier, Lamp)> = Vec::new();
    for eye in eyes {
        let (sync, lit) = fit_events(eye, board.as_ref());
        lamps.extend(Lamp::new(&sync.id, lit).map(|lamp| (sync.tier, lamp)));
        found.insert(sync.id.clone(), sync);
    }
    // The best clock tells best when the lamp was lit.
    let lamp = lamps.into_iter().min_by_key(|(tier, _)| *tier).map(|(_, lamp)| lamp);
    for (description, frames) in cameras {
        let strobe = strobes.remove(&description.id);
        let sync = fit_frames(description, &frames, board.as_ref(), lamp.as_ref(), strobe);
        found.insert(sync.id.clone(), sync);
    }
    ids().filter_map(|id| found.remove(&id)).collect()
}

fn empty(id: &str, tier: Tier) -> StreamSync {
    StreamSync {
        id: id.to_owned(),
        tier,
        epochs: Epochs::default(),
        matched: None,
        exposures: None,
        faults: Vec::new(),
        notes: Vec::new(),
        points: Vec::new(),
    }
}

fn fit_board(id: &str, lines: BoardLines) -> (Option<Board>, StreamSync) {
    let mut sync = empty(id, Tier::HardwareTriggered);
    match lines.finish() {
        Ok(board) => {
            if board.resets > 0 {
                sync.faults.push(format!(
                    "the board was reset {}; only its longest run is used, and frames triggered in the others have no time",
                    times(board.resets)
                ));
            }
            // The first line may be half a line.
            if board.damaged_lines > 1 {
                sync.faults.push(format!("{} lines were damaged", board.damaged_lines));
            }
            if board.restored > 0 {
                sync.faults.push(format!(
                    "the lines of {} pulses were lost; their times are interpolated from the pulses around them",
                    board.restored
                ));
            }
            sync.notes.push(match board.bounds {
                Bounds::Within { half_ns } => format!("common to all triggered streams: ±{:.0} µs", half_ns / 1000.0),
                Bounds::Disagree { by_ns } => format!(
                    "commands and answers disagree by {:.1} µs (a command arrived before it was sent): all triggered streams may \
                     share an unknown offset",
                    by_ns / 1000.0
                ),
                Bounds::OneSided => "no `clock` commands: the board's clock is late by the minimum delay of the serial line".into(),
            });
            sync.epochs = board.clock.clone().into();
            (Some(board), sync)
        }
        Err(error) => {
            sync.faults.push(error.to_string());
            (None, sync)
        }
    }
}

/// The clocks of an event camera, and when it saw a lamp lit, if one is looked for.
fn fit_events(eye: Eye<'_>, board: Option<&Board>) -> (StreamSync, Vec<[i64; 2]>) {
    let Eye { id, fitted, sees } = eye;
    let mut sync = empty(id, Tier::FreeRunning);
    sync.matched = fitted.iter().filter_map(|epoch| epoch.matched).reduce(Matched::and);
    // The worst of the epochs: it holds for the whole stream.
    sync.tier = fitted.iter().filter_map(|fitted| fitted.epoch.clock.as_ref()).map(Tier::of).max().unwrap_or(sync.tier);
    if let Some((kind, camera)) = &sees {
        let what = match kind {
            Kind::Strobe => format!("the strobe of '{camera}'"),
            Kind::Trigger => format!("the pulses that trigger '{camera}'"),
        };
        sync.notes.push(match sync.tier {
            Tier::HardwareTriggered => format!("its clock is tied by {what} at its trigger input"),
            _ => format!("its trigger input has {what}: it dates these frames by its own clock"),
        });
        sync.tier = kind.tier();
        sync.matched = None;
    }
    tell_epochs(&fitted, board.filter(|_| sees.is_none()), &mut sync.faults);
    if let Some(Matched { seen, matched, .. }) = sync.matched
        && matched > 0
        && seen - matched.min(seen) > MANY_UNKNOWN.max(seen / 20)
    {
        sync.faults.push(format!(
            "pulses of the board were lost or doubled on the way to it: {matched} of the {seen} received pulses are used"
        ));
    }
    let samples: usize = fitted.iter().map(|fitted| fitted.evidence().len()).sum();
    let step = samples.div_ceil(MAX_POINTS).max(1);
    let mut lit = Vec::new();
    for fitted in &fitted {
        let Some(clock) = &fitted.epoch.clock else { continue };
        let point = |sample: &Sample| (clock.session_ns(sample.ticks) as f64 * 1e-9, clock.distance_ns(sample));
        sync.points.extend(fitted.evidence().iter().step_by(step).map(point));
        lit.extend(fitted.counts.iter().flat_map(|counts| counts.lit(clock)));
    }
    sync.epochs = fitted.into_iter().map(|fitted| fitted.epoch).collect::<Vec<Epoch>>().into();
    (sync, lit)
}

fn times(count: u64) -> String {
    if count == 1 { "once".to_owned() } else { format!("{count} times") }
}

/// What the user should know of the epochs of an event camera.
fn tell_epochs(fitted: &[Fitted], board: Option<&Board>, faults: &mut Vec<String>) {
    let several = fitted.len() > 1;
    if several {
        let breaks = times(fitted.len() as u64 - 1);
        faults.push(format!("the camera's clock restarts {breaks}: each part gets its own clock"));
    }
    for fitted in fitted.iter().take(TOLD_EPOCHS) {
        let part =
            if several { format!("from {:.3} s on: ", fitted.epoch.arrived_ns as f64 * 1e-9) } else { String::new() };
        let Some(clock) = &fitted.epoch.clock else {
            faults.push(format!("{part}no clock: no events and no edges"));
            continue;
        };
        if board.is_some() && Tier::of(clock) == Tier::FreeRunning {
            let what = match fitted.edges.len() {
                0 => "no edges".to_owned(),
                edges => format!("{edges} edges, none of which could be matched to a pulse"),
            };
            let remedy = if several { "" } else { "; check the wire to the trigger input" };
            faults.push(format!("{part}{what}: dated by the arrival of its data{remedy}"));
        }
        if let Some(outliers) = many_outliers(clock) {
            faults.push(format!("{part}{outliers}"));
        }
    }
    if fitted.len() > TOLD_EPOCHS {
        faults.push(format!("and {} more parts", fitted.len() - TOLD_EPOCHS));
    }
}

/// A warning, if a clock has set too much aside.
fn many_outliers(clock: &Clock) -> Option<String> {
    let share = clock.outlier_share();
    (share > MANY_OUTLIERS).then(|| {
        let all = clock.samples + clock.outliers;
        format!(
            "{} of {all} samples ({:.1} %) do not fit its clock: check the plot before you use it",
            clock.outliers,
            100.0 * share
        )
    })
}

fn fit_frames(
    description: &Description,
    frames: &Frames,
    board: Option<&Board>,
    lamp: Option<&Lamp>,
    strobe: Option<Strobe>,
) -> StreamSync {
    let mut sync = empty(&description.id, Tier::FreeRunning);
    let arrived = &frames.arrived[..];
    let exposure_ns = description.exposure_ns();
    match strobe {
        Some(Strobe::Seen { kind, by, exposures, inverted }) => {
            sync.tier = kind.tier();
            sync.faults.extend(tell_lost(
                &exposures,
                &format!("that {} saw", by[0]),
                &format!("pulse that {} saw", by[0]),
            ));
            let by = by.join(" and ");
            sync.notes.push(match kind {
                Kind::Strobe => format!("both ends of each exposure as {by} saw its strobe"),
                Kind::Trigger => {
                    format!("each exposure from the pulse on that {by} saw; the camera's delay after it is not known")
                }
            });
            if inverted && kind == Kind::Strobe {
                sync.notes.push("its strobe is low while it is exposed: taken as such".into());
            }
            sync.exposures = Some(exposures);
        }
        Some(Strobe::Unseen(why)) => sync.faults.push(why),
        None => {}
    }
    if let (Some(board), true, None) = (board, description.is_triggered(), &sync.exposures) {
        let exposures = frames::match_pulses(arrived, board, exposure_ns);
        if exposures.pulse.is_empty() {
            sync.faults.push("no frame matched a pulse: check the wire to the camera's trigger".into());
        } else {
            let given = "between its first and its last frame";
            sync.faults.extend(tell_lost(&exposures, given, "reported pulse of the board"));
            sync.tier = Tier::HardwareTriggered;
            sync.exposures = Some(exposures);
        }
    }
    if sync.exposures.is_none() && !arrived.is_empty() {
        let even = even(arrived, &frames.counts);
        match flash_of(frames, &even, lamp, exposure_ns) {
            Some(Ok((lag_ns, note))) => {
                sync.tier = Tier::Flash;
                sync.notes.push(note);
                sync.exposures = Some(frames::lagging(arrived, &even, lag_ns, exposure_ns));
            }
            failed => {
                sync.notes.push(match failed {
                    Some(Err(note)) => note,
                    _ => "the exposure times may share an offset of up to one frame; a flashing lamp measures it (--flash)".into(),
                });
                sync.exposures = Some(frames::free_running(arrived, &even, exposure_ns));
            }
        }
        let (all, fitted) = (arrived.len() as u64, even.fitted);
        if fitted < all {
            sync.notes.push(format!(
                "{} of {all} frames are not evenly spaced, or too few to decide: their stamps are used as recorded, with their \
                 jitter",
                all - fitted
            ));
        }
    }
    if let Some(exposures) = &sync.exposures {
        let stamps: BTreeMap<u64, i64> = arrived.iter().map(|frame| (frame.sequence, frame.stamp_ns)).collect();
        let step = exposures.sequence.len().div_ceil(MAX_POINTS).max(1);
        let usual_ns = exposures.usual_ns();
        sync.points = std::iter::zip(&exposures.sequence, &exposures.mid_ns)
            .enumerate()
            .step_by(step)
            .filter_map(|(at, (sequence, &mid))| {
                let off_ns = exposures.off_ns(at, usual_ns, *stamps.get(sequence)?)?;
                Some((mid as f64 * 1e-9, off_ns as f64))
            })
            .collect();
    }
    sync
}

/// What was lost between frames and pulses, which are `given` somewhere and `known` as something.
fn tell_lost(exposures: &Exposures, given: &str, known: &str) -> Vec<String> {
    let mut faults = Vec::new();
    if exposures.missed_pulses > 0 {
        faults.push(format!("{} pulses {given} gave no frame", exposures.missed_pulses));
    }
    if exposures.unmatched > 0 {
        faults.push(format!("{} frames match no {known}: they have no time", exposures.unmatched));
    }
    faults
}

/// The lag that a flash tells and how it was found, or why it tells none; `None` if no lamp was looked for.
fn flash_of(
    frames: &Frames,
    even: &Even,
    lamp: Option<&Lamp>,
    exposure_ns: Option<i64>,
) -> Option<Result<(i64, String), String>> {
    let brightness = frames.brightness.as_ref()?;
    let Some(lamp) = lamp else {
        return Some(Err(
            "no event camera saw a lamp flash three times: the exposure times may be off by up to one frame".into(),
        ));
    };
    let at = std::iter::zip(&frames.arrived, &even.at_ns).map(|(frame, &stamp_ns)| Arrived { stamp_ns, ..*frame });
    let Some(found) = lamp.lag(&at.collect::<Vec<_>>(), brightness, exposure_ns) else {
        return Some(Err(format!(
            "its brightness does not follow the {} flashes that {} saw: the exposure times may be off by up to one frame",
            lamp.lit.len(),
            lamp.seen_by
        )));
    };
    let ms = |ns: i64| ns as f64 * 1e-6;
    let note = format!(
        "lag of {2:.2} ms measured by {0} flashes that {1} saw (±{3:.2} ms, correlation {4:.3})",
        lamp.lit.len(),
        lamp.seen_by,
        ms(found.lag_ns),
        ms(found.width_ns) / 2.0,
        found.correlation
    );
    Some(Ok((found.lag_ns, note)))
}
