//! Strobes: an output of a frame camera that is high while its sensor is exposed, at the trigger input of an event camera.
//!
//! The event camera dates both ends of each exposure by its own clock, to a microsecond and with whatever the camera does
//! between trigger and exposure. Which edges belong to which frame is told as for the pulses of the board
//! ([`match_shots`](super::frames::match_shots)). Where several event cameras see one strobe, or the camera that gives it is
//! triggered by the board, the edges tie their clocks to one another and to the board, which arrivals do to a millisecond only.

use std::collections::{BTreeMap, HashMap};

use erfgs_events::Edge;
use erfgs_session::{
    clock::{Exposure, Sample},
    source::Description,
};

use super::{
    board::Board,
    collect::Frames,
    edges,
    epochs::Fitted,
    exposures::{Exposures, median},
    frames::{self, Shot},
};

/// A strobe is as long as the exposure that the camera was set to, but for this share, and this, nanoseconds.
const LONGER: f64 = 0.2;
const LONGER_NS: i64 = 50_000;
/// By arrivals, the clock of an event camera is late by so much at most against a camera that stamps at once, nanoseconds.
const LATE_NS: i64 = 5_000_000;
/// Stamps lie so near to the lag that they have in common if the edges are those of the frames, as a share of the time from
/// one frame to the next. Of other edges they lie anywhere within a half.
const NEAR: f64 = 0.25;
/// Fewer frames show nothing.
const FEWEST: usize = 8;

/// Whether a pulse can be the strobe of a camera with such an exposure.
#[must_use]
pub fn is_strobe(width_ns: i64, exposure_ns: i64) -> bool {
    width_ns.abs_diff(exposure_ns) <= LONGER_NS.max((LONGER * exposure_ns as f64) as i64).unsigned_abs()
}

/// An event camera whose trigger input may have a strobe.
pub(super) struct Eye<'a> {
    pub id: &'a str,
    pub fitted: Vec<Fitted>,
    /// The camera whose strobe its input has, and what else ties its clock.
    pub strobe_of: Option<String>,
}

/// What was found of a camera's strobe.
pub(super) enum Strobe {
    /// Event cameras saw it, the first of which dates the frames.
    Seen { by: Vec<String>, exposures: Exposures, inverted: bool },
    /// Why its frames are not dated by it.
    Unseen(String),
}

/// A camera with a strobe.
struct Camera<'a> {
    description: &'a Description,
    frames: &'a Frames,
    /// The event cameras that its strobe is said to go to.
    named: Vec<&'a str>,
    /// Whether the board triggers it.
    triggered: bool,
}

/// A strobe before an eye.
struct Fit {
    eye: usize,
    exposures: Exposures,
    /// For each frame its edge: which part of the eye's stream, and when by the eye's clock.
    rises: HashMap<u64, (usize, i64)>,
    inverted: bool,
}

/// The strobes of all cameras that have one, by the cameras' names. Clocks of event cameras that they tie are fitted anew.
pub(super) fn find(
    cameras: &[(&Description, Frames)],
    eyes: &mut [Eye<'_>],
    board: Option<&Board>,
) -> BTreeMap<String, Strobe> {
    if eyes.is_empty() {
        return BTreeMap::new();
    }
    let with_strobe = cameras.iter().filter_map(|(description, frames)| {
        let named = description.strobe()?;
        let triggered = board.is_some() && description.is_triggered();
        Some(Camera { description, frames, named, triggered })
    });
    let cameras: Vec<Camera<'_>> = with_strobe.collect();
    let fits: Vec<Vec<Fit>> = cameras.iter().map(|camera| fits(camera, eyes)).collect();
    let mut found = BTreeMap::new();
    for (at, camera) in cameras.iter().enumerate() {
        let own: Vec<&Fit> = fits[at].iter().filter(|fit| is_own(fit, at, &fits, &cameras)).collect();
        let strobe = match own.split_first() {
            None => Strobe::Unseen(unseen(at, &cameras, &fits, eyes)),
            Some((first, others)) => dated(camera, first, others, eyes, board),
        };
        found.insert(camera.description.id.clone(), strobe);
    }
    found
}

/// All eyes that may see the strobe of a camera, the one that saw most of it first.
fn fits(camera: &Camera<'_>, eyes: &[Eye<'_>]) -> Vec<Fit> {
    let may = |eye: &Eye<'_>| (camera.named.is_empty() || camera.named.contains(&eye.id)) && !eye.sees_the_board();
    let mut fits: Vec<Fit> = (0..eyes.len())
        .filter(|&eye| may(&eyes[eye]))
        .filter_map(|eye| {
            let upright = fit(camera, eye, &eyes[eye], false);
            upright.or_else(|| fit(camera, eye, &eyes[eye], true))
        })
        .collect();
    fits.sort_by_key(|fit| std::cmp::Reverse(fit.exposures.sequence.len()));
    fits
}

/// The strobe of a camera before an eye, if its edges can be that.
fn fit(camera: &Camera<'_>, at: usize, eye: &Eye<'_>, inverted: bool) -> Option<Fit> {
    let set_ns = camera.description.exposure_ns();
    let seen = seen(eye, inverted);
    let usual_ns = median(seen.iter().filter_map(|pulse| pulse.width_ns).collect())?;
    if set_ns.is_some_and(|set_ns| !is_strobe(usual_ns, set_ns)) || (set_ns.is_none() && inverted) {
        return None;
    }
    let shots: Vec<Shot> = seen
        .iter()
        .enumerate()
        .map(|(number, pulse)| Shot {
            pulse: number as u64,
            exposure: Exposure::beginning(pulse.rise_ns, pulse.width_ns.unwrap_or(usual_ns)),
        })
        .collect();
    let period_ns = median(seen.windows(2).map(|pair| pair[1].rise_ns.saturating_sub(pair[0].rise_ns)).collect())?;
    let early_ns = LATE_NS.min(period_ns / 4);
    let mut exposures = frames::match_shots(&camera.frames.arrived, &shots, period_ns, early_ns);
    let matched = exposures.sequence.len();
    if matched < FEWEST.max(camera.frames.arrived.len() / 2) || exposures.residuals.p95_ns > NEAR * period_ns as f64 {
        return None;
    }
    // They are no pulses of the board.
    let numbers = std::mem::take(&mut exposures.pulse);
    let rises = std::iter::zip(&exposures.sequence, numbers).filter_map(|(&sequence, number)| {
        let pulse = seen.get(usize::try_from(number).ok()?)?;
        Some((sequence, (pulse.part, pulse.tick)))
    });
    Some(Fit { eye: at, rises: rises.collect(), exposures, inverted })
}

/// A pulse at the input of an eye.
struct Pulse {
    part: usize,
    tick: i64,
    rise_ns: i64,
    width_ns: Option<i64>,
}

fn seen(eye: &Eye<'_>, inverted: bool) -> Vec<Pulse> {
    let mut seen = Vec::new();
    for (part, fitted) in eye.fitted.iter().enumerate() {
        let (Some(clock), Some(first)) = (&fitted.epoch.clock, fitted.edges.first()) else { continue };
        let turned = |edge: &Edge| Edge { rising: edge.rising != inverted, ..*edge };
        let edges: Vec<Edge> = fitted.edges.iter().map(turned).collect();
        seen.extend(edges::pulses(&edges, first.channel).into_iter().map(|pulse| Pulse {
            part,
            tick: pulse.rise,
            rise_ns: clock.session_ns(pulse.rise),
            width_ns: pulse.width_ns,
        }));
    }
    // Of a pulse that was high at the end nobody knows how long.
    seen.pop_if(|last| last.width_ns.is_none());
    seen
}

impl Eye<'_> {
    fn sees_the_board(&self) -> bool {
        self.fitted.iter().any(|fitted| fitted.matched.is_some_and(|matched| matched.matched > 0))
    }
}

/// Whether an eye sees this camera rather than another. Cameras that the board triggers expose together, and what is nearest
/// will do; of others that fit alike nothing tells, unless the rig does.
fn is_own(fit: &Fit, at: usize, fits: &[Vec<Fit>], cameras: &[Camera<'_>]) -> bool {
    let camera = &cameras[at];
    let rivals =
        (0..cameras.len()).filter(|&other| other != at && camera.named.is_empty() >= cameras[other].named.is_empty());
    let mut rivals =
        rivals.flat_map(|other| fits[other].iter().filter(|of| of.eye == fit.eye).map(move |of| (other, of)));
    rivals.all(|(other, of)| {
        let nearer = (fit.exposures.residuals.p95_ns, at) < (of.exposures.residuals.p95_ns, other);
        nearer && camera.triggered && cameras[other].triggered
    })
}

/// Why a strobe dates nothing.
fn unseen(at: usize, cameras: &[Camera<'_>], fits: &[Vec<Fit>], eyes: &[Eye<'_>]) -> String {
    let id = |at: usize| cameras[at].description.id.as_str();
    if let Some(stray) = cameras[at].named.iter().find(|name| eyes.iter().all(|eye| eye.id != **name)) {
        return format!("its strobe is said to go to '{stray}', which is no event camera of the session");
    }
    let shared =
        |fit: &&Fit| fits.iter().enumerate().find(|(of, fits)| *of != at && fits.iter().any(|f| f.eye == fit.eye));
    if let Some((fit, (other, _))) = fits[at].iter().find_map(|fit| Some((fit, shared(&fit)?))) {
        return format!(
            "the edges at the trigger input of '{}' may be its strobe or that of '{}': say with strobe_to which event cameras each \
             strobe goes to",
            eyes[fit.eye].id,
            id(other)
        );
    }
    "no event camera has edges like its exposures: check the wire of its strobe".into()
}

/// The frames of a camera by what its eyes saw, the first of which dates them.
fn dated(camera: &Camera<'_>, first: &Fit, others: &[&Fit], eyes: &mut [Eye<'_>], board: Option<&Board>) -> Strobe {
    let description = camera.description;
    let by_board = board.filter(|_| camera.triggered).map(|board| begins_by(board, camera));
    let by_board = by_board.filter(|begins| begins.len() >= FEWEST);
    if let Some(begins) = &by_board {
        tie(first, begins, &mut eyes[first.eye]);
    }
    let begins = by_board.unwrap_or_else(|| {
        let clock = |part: usize| eyes[first.eye].fitted[part].epoch.clock.as_ref();
        let begin = |(&sequence, &(part, tick)): (&u64, &(usize, i64))| Some((sequence, clock(part)?.session_ns(tick)));
        first.rises.iter().filter_map(begin).collect()
    });
    for fit in others {
        tie(fit, &begins, &mut eyes[fit.eye]);
    }
    let mut exposures = first.exposures.clone();
    for (at, sequence) in exposures.sequence.iter().enumerate() {
        let (part, tick) = first.rises[sequence];
        if let (Some(clock), Some(&length_ns)) =
            (&eyes[first.eye].fitted[part].epoch.clock, exposures.exposure_ns.get(at))
        {
            exposures.mid_ns[at] = Exposure::beginning(clock.session_ns(tick), length_ns).mid_ns;
        }
    }
    let own = || std::iter::once(first).chain(others.iter().copied());
    own().for_each(|fit| eyes[fit.eye].strobe_of = Some(description.id.clone()));
    let by = own().map(|fit| eyes[fit.eye].id.to_owned()).collect();
    Strobe::Seen { by, exposures, inverted: first.inverted }
}

/// When each frame's exposure began by the pulse of the board that triggered it.
fn begins_by(board: &Board, camera: &Camera<'_>) -> HashMap<u64, i64> {
    let matched = frames::match_pulses(&camera.frames.arrived, board, camera.description.exposure_ns());
    let rise = |(&sequence, pulse): (&u64, &u64)| Some((sequence, board.rise_ns(board.pulses.get(pulse)?)));
    std::iter::zip(&matched.sequence, &matched.pulse).filter_map(rise).collect()
}

/// Fits the clocks of an eye to when exposures began.
fn tie(fit: &Fit, begins: &HashMap<u64, i64>, eye: &mut Eye<'_>) {
    for (part, fitted) in eye.fitted.iter_mut().enumerate() {
        let rises = fit.rises.iter().filter(|(_, at)| at.0 == part);
        let mut samples: Vec<Sample> = rises
            .filter_map(|(sequence, at)| Some(Sample { ticks: at.1, session_ns: *begins.get(sequence)? }))
            .collect();
        samples.sort_unstable_by_key(|sample| sample.ticks);
        if samples.len() >= FEWEST {
            fitted.tie(samples);
        }
    }
}
