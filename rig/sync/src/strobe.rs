//! Strobes and shared triggers: pulses at the trigger input of an event camera that belong to the frames of a camera, without
//! a board that tells their numbers.
//!
//! A *strobe* is an output of a frame camera that is high while its sensor is exposed: the event camera dates both ends of each
//! exposure by its own clock, to a microsecond and with whatever the camera does between trigger and exposure. A *shared trigger*
//! goes to the camera and to the event camera alike, from a generator: each exposure begins with its pulse. Which pulse belongs to
//! which frame is told as for those of the board ([`match_shots`](super::frames::match_shots)).
//!
//! Where several event cameras see the same pulses, or a camera with a strobe is triggered by the board, the pulses tie their clocks
//! to one another and to the board, which arrivals do to a millisecond only.

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
    report::Tier,
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

/// An event camera at whose trigger input there may be such pulses.
pub(super) struct Eye<'a> {
    pub id: &'a str,
    pub fitted: Vec<Fitted>,
    /// What its pulses are, and of which camera.
    pub sees: Option<(Kind, String)>,
}

/// What the pulses of a camera's frames are.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Each shows an exposure.
    Strobe,
    /// Each begins one.
    Trigger,
}

impl Kind {
    /// How well it dates.
    pub fn tier(self) -> Tier {
        match self {
            Self::Strobe => Tier::Strobe,
            Self::Trigger => Tier::HardwareTriggered,
        }
    }
}

/// What was found of a camera's pulses.
pub(super) enum Strobe {
    /// Event cameras saw them, the first of which dates the frames.
    Seen { kind: Kind, by: Vec<String>, exposures: Exposures, inverted: bool },
    /// Why its frames are not dated by its strobe.
    Unseen(String),
}

/// A camera with a strobe, or triggered otherwise than by the board of the session.
struct Camera<'a> {
    description: &'a Description,
    frames: &'a Frames,
    /// The event cameras that its strobe is said to go to; none if it has none.
    strobe: Option<Vec<&'a str>>,
    /// Whether it is triggered, and by the board.
    triggered: bool,
    by_board: bool,
}

/// Pulses of a camera before an eye.
struct Fit {
    kind: Kind,
    eye: usize,
    exposures: Exposures,
    /// For each frame its edge: which part of the eye's stream, and when by the eye's clock.
    rises: HashMap<u64, (usize, i64)>,
    inverted: bool,
}

/// The pulses of all cameras that have any, by the cameras' names. Clocks of event cameras that they tie are fitted anew.
pub(super) fn find(
    cameras: &[(&Description, Frames)],
    eyes: &mut [Eye<'_>],
    board: Option<&Board>,
) -> BTreeMap<String, Strobe> {
    if eyes.is_empty() {
        return BTreeMap::new();
    }
    let cameras = cameras.iter().filter_map(|(description, frames)| Camera::new(description, frames, board));
    let cameras: Vec<Camera<'_>> = cameras.collect();
    let fits: Vec<Vec<Fit>> = cameras.iter().map(|camera| fits(camera, eyes)).collect();
    let mut found = BTreeMap::new();
    for (at, camera) in cameras.iter().enumerate() {
        let mut own: Vec<&Fit> = fits[at].iter().filter(|fit| is_own(fit, at, &fits, &cameras)).collect();
        // An eye that another camera has tied before has the clock that the rest is tied to.
        own.sort_by_key(|fit| eyes[fit.eye].sees.is_none());
        let strobe = match own.split_first() {
            Some((first, others)) => dated(camera, first, others, eyes, board),
            None if camera.strobe.is_some() => Strobe::Unseen(unseen(at, &cameras, &fits, eyes)),
            None => continue,
        };
        found.insert(camera.description.id.clone(), strobe);
    }
    found
}

/// All eyes that may see the pulses of a camera, the one that saw most of them first.
fn fits(camera: &Camera<'_>, eyes: &[Eye<'_>]) -> Vec<Fit> {
    let strobes = camera.strobe.iter().flat_map(|named| {
        let may = |&eye: &usize| named.is_empty() || named.contains(&eyes[eye].id);
        let inverted = |eye| fit(camera, eye, &eyes[eye], Kind::Strobe, true);
        (0..eyes.len())
            .filter(may)
            .filter_map(move |eye| fit(camera, eye, &eyes[eye], Kind::Strobe, false).or_else(|| inverted(eye)))
    });
    let mut fits: Vec<Fit> = strobes.collect();
    if fits.is_empty() && camera.triggered && !camera.by_board {
        let falling = camera.description.settings.get("genicam").and_then(|genicam| genicam.get("TriggerActivation"));
        let falling = falling.is_some_and(|activation| activation == "FallingEdge");
        fits.extend((0..eyes.len()).filter_map(|eye| fit(camera, eye, &eyes[eye], Kind::Trigger, falling)));
    }
    fits.sort_by_key(|fit| std::cmp::Reverse(fit.exposures.sequence.len()));
    fits
}

/// The pulses of a camera before an eye, if what it sees can be these.
fn fit(camera: &Camera<'_>, at: usize, eye: &Eye<'_>, kind: Kind, inverted: bool) -> Option<Fit> {
    if eye.sees_the_board() {
        return None;
    }
    let set_ns = camera.description.exposure_ns();
    let mut seen = seen(eye, inverted);
    if kind == Kind::Strobe || set_ns.is_none() {
        // Of a pulse that is high at the end nobody knows how long.
        seen.pop_if(|last| last.width_ns.is_none());
    }
    let widths: Vec<i64> = seen.iter().filter_map(|pulse| pulse.width_ns).collect();
    let usual_ns = median(widths.clone())?;
    let may = match (kind, set_ns) {
        (Kind::Strobe, Some(set_ns)) => is_strobe(usual_ns, set_ns),
        // Nothing tells which way round it is.
        (Kind::Strobe, None) => !inverted,
        (Kind::Trigger, Some(_)) => true,
        // Pulses of different lengths are not the exposures of the camera: a board's at another host have numbers written on them.
        (Kind::Trigger, None) => widths.iter().all(|&width_ns| is_strobe(width_ns, usual_ns)),
    };
    if !may {
        return None;
    }
    let length_ns = |pulse: &Pulse| match kind {
        Kind::Trigger => set_ns.unwrap_or(usual_ns),
        Kind::Strobe => pulse.width_ns.unwrap_or(usual_ns),
    };
    let shot = |(number, pulse): (usize, &Pulse)| Shot {
        pulse: number as u64,
        exposure: Exposure::beginning(pulse.rise_ns, length_ns(pulse)),
    };
    let shots: Vec<Shot> = seen.iter().enumerate().map(shot).collect();
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
    Some(Fit { kind, eye: at, rises: rises.collect(), exposures, inverted })
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
    seen
}

impl<'a> Camera<'a> {
    fn new(description: &'a Description, frames: &'a Frames, board: Option<&Board>) -> Option<Self> {
        let (strobe, triggered) = (description.strobe(), description.is_triggered());
        let by_board = triggered && board.is_some();
        let may = strobe.is_some() || (triggered && !by_board);
        may.then_some(Self { description, frames, strobe, triggered, by_board })
    }

    fn is_named(&self) -> bool {
        self.strobe.as_ref().is_some_and(|named| !named.is_empty())
    }
}

impl Eye<'_> {
    fn sees_the_board(&self) -> bool {
        self.fitted.iter().any(|fitted| fitted.matched.is_some_and(|matched| matched.matched > 0))
    }
}

/// Whether an eye sees the pulses of this camera rather than those of another. A trigger is shared; a strobe is of one camera.
/// Cameras that the board triggers expose together, and what is nearest will do; of others that fit alike nothing tells, unless the
/// rig does.
fn is_own(fit: &Fit, at: usize, fits: &[Vec<Fit>], cameras: &[Camera<'_>]) -> bool {
    let camera = &cameras[at];
    let others = (0..cameras.len()).filter(|&other| other != at && cameras[other].is_named() >= camera.is_named());
    let mut rivals = others.flat_map(|other| fits[other].iter().map(move |of| (other, of)));
    rivals.all(|(other, of)| {
        let nearer = (fit.exposures.residuals.p95_ns, at) < (of.exposures.residuals.p95_ns, other);
        match (of.eye == fit.eye, fit.kind, of.kind) {
            (false, ..) | (true, _, Kind::Trigger) => true,
            (true, Kind::Trigger, Kind::Strobe) => false,
            (true, Kind::Strobe, Kind::Strobe) => nearer && camera.by_board && cameras[other].by_board,
        }
    })
}

/// Why a strobe dates nothing.
fn unseen(at: usize, cameras: &[Camera<'_>], fits: &[Vec<Fit>], eyes: &[Eye<'_>]) -> String {
    let id = |at: usize| cameras[at].description.id.as_str();
    let mut named = cameras[at].strobe.iter().flatten();
    if let Some(stray) = named.find(|name| eyes.iter().all(|eye| eye.id != **name)) {
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
    let by_board = board.filter(|_| camera.by_board).map(|board| begins_by(board, camera));
    let by_board = by_board.filter(|begins| begins.len() >= FEWEST);
    if let Some(begins) = by_board.as_ref().filter(|_| eyes[first.eye].sees.is_none()) {
        tie(first, begins, &mut eyes[first.eye]);
    }
    let begins = by_board.unwrap_or_else(|| {
        let clock = |part: usize| eyes[first.eye].fitted[part].epoch.clock.as_ref();
        let begin = |(&sequence, &(part, tick)): (&u64, &(usize, i64))| Some((sequence, clock(part)?.session_ns(tick)));
        first.rises.iter().filter_map(begin).collect()
    });
    for fit in others.iter().filter(|fit| eyes[fit.eye].sees.is_none()).collect::<Vec<_>>() {
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
    for fit in own() {
        eyes[fit.eye].sees.get_or_insert_with(|| (fit.kind, description.id.clone()));
    }
    let by = own().map(|fit| eyes[fit.eye].id.to_owned()).collect();
    Strobe::Seen { kind: first.kind, by, exposures, inverted: first.inverted }
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
