//! Sessions of several hosts brought to one clock by the pulses of the one trigger board that all of them saw.
//!
//! Hosts need no common clock: the code on the pulses numbers them, so that a pulse that two hosts saw is one moment in both. Of
//! the host that the board talks to, the times of the pulses are the board's. Of another one they are those of the event camera
//! that saw most of them, by the arrival of its data: late by the least delay of its line, a fraction of a millisecond. Once
//! merged, its event cameras are tied to the board by the edges themselves, to microseconds.

use std::{
    collections::BTreeMap,
    io::{Read, Seek},
    path::PathBuf,
};

use erfgs_session::{
    clock::{Clock, Errors, Evidence, Sample},
    container::{ContainerError, Session, SessionStart, Stream},
    trigger::code,
};

use super::{
    board::BoardLines,
    collect::{Events, Gathered, SyncOptions, gather_all},
    edges, epochs,
};

/// Fewer pulses than two groups of the code could be seen by chance.
const LEAST: usize = 16;
/// Pulses of one train keep one time on both hosts, but for delays of data: half of a period of 1 kHz at most.
const LIMIT_NS: f64 = 500_000.0;
/// Of the pulses that both know so many may be off.
const MANY_OUTLIERS: f64 = 0.1;
/// Rates of crystals drift with the temperature, over minutes.
const WINDOW_NS: i64 = 60_000_000_000;
/// The calendars of two hosts of a laboratory agree to this; takes lie farther apart.
const CALENDARS_NS: i64 = 30_000_000_000;

/// The pulses that a session knows.
#[derive(Clone, Debug, PartialEq)]
pub struct Pulses {
    /// The session.
    pub path: PathBuf,
    /// When and with what it was recorded.
    pub start: SessionStart,
    /// The stream that tells them.
    pub stream: String,
    /// Whether that is the trigger board itself, and not a camera that saw them.
    pub of_board: bool,
    /// When each rose, by its index; nanoseconds on the session clock.
    pub rises_ns: BTreeMap<u64, i64>,
}

/// Why sessions cannot be brought to one clock.
#[derive(Debug, thiserror::Error)]
pub enum AlignError {
    /// A session cannot be read.
    #[error(transparent)]
    Session(#[from] ContainerError),
    /// A session saw no pulses.
    #[error(
        "{} holds no pulses of a trigger board: neither the board's lines nor an event camera that saw {LEAST} of them at its \
         trigger input; connect a trigger input of this host to the board (docs/guide/recording.md)",
        path.display()
    )]
    NoPulses {
        /// The session.
        path: PathBuf,
    },
    /// Two sessions have a board.
    #[error(
        "both {} and {} hold the lines of a trigger board; only sessions that share one board can be merged, and one host talks to \
         it",
        first.display(), second.display()
    )]
    TwoBoards {
        /// One.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// They saw different pulses.
    #[error(
        "{} knows pulses {own:?} and {} pulses {other:?}, of which {common} are the same: they were not recorded at the same \
         time, or by different boards",
        path.display(), reference.display()
    )]
    NothingInCommon {
        /// A session.
        path: PathBuf,
        /// The one that it should be brought to.
        reference: PathBuf,
        /// First and last of the one.
        own: [u64; 2],
        /// First and last of the other.
        other: [u64; 2],
        /// How many are the same.
        common: usize,
    },
    /// They saw pulses of different trains.
    #[error(
        "the times of pulses in {} differ from those of the same number in {}: by {p95_us:.0} µs where at most {:.0} µs are allowed, \
         with {outliers} of {common} outliers removed; they are of different boards, or one board was restarted",
        path.display(), reference.display(), LIMIT_NS * 1e-3
    )]
    OtherTrain {
        /// A session.
        path: PathBuf,
        /// The one that it should be brought to.
        reference: PathBuf,
        /// How far apart, microseconds.
        p95_us: f64,
        /// Pulses that fit not at all.
        outliers: u64,
        /// Pulses that both know.
        common: usize,
    },
    /// They were recorded at different times.
    #[error(
        "{} and {} hold pulses of the same numbers, but the dates of their hosts are {seconds:.0} s apart: they seem to be different \
         takes. If a host's date is wrong, --any-date merges them anyway",
        path.display(), reference.display()
    )]
    OtherTake {
        /// A session.
        path: PathBuf,
        /// The one that it should be brought to.
        reference: PathBuf,
        /// How far apart.
        seconds: f64,
    },
}

/// How a session's clock stands to that of another.
#[derive(Clone, Debug, PartialEq)]
pub struct Aligned {
    /// From session time, as ticks of a nanosecond, to that of the other.
    pub clock: Clock,
    /// Pulses that both know.
    pub common: usize,
    /// What the session's calendar is ahead of the other's, nanoseconds.
    pub calendar_ns: i64,
}

impl Aligned {
    /// From host times of `own` to those of `reference`.
    #[must_use]
    pub fn to_host_ns(&self, own: &Pulses, reference: &Pulses) -> Box<dyn Fn(i64) -> i64> {
        let (clock, from, to) = (self.clock.clone(), own.start.host_ns, reference.start.host_ns);
        let same = own.path == reference.path;
        // What is the reference's own stays to the nanosecond.
        Box::new(
            move |host_ns| {
                if same { host_ns } else { clock.session_ns(host_ns.saturating_sub(from)).saturating_add(to) }
            },
        )
    }
}

impl Pulses {
    /// Those of a session, which is read through. `progress` is called with the bytes of payload so far.
    ///
    /// # Errors
    /// If it cannot be read, or knows none.
    pub fn of<R: Read + Seek>(session: &mut Session<R>, mut progress: impl FnMut(u64)) -> Result<Self, AlignError> {
        let gathered = gather_all(session, SyncOptions::default(), &mut progress)?;
        let (mut board, mut best): (Option<Self>, Option<Self>) = (None, None);
        for (stream, gathered) in std::iter::zip(&session.summary().streams, gathered) {
            let (of_board, rises_ns) = match gathered {
                Gathered::Board(lines) => (true, of_board(lines)),
                Gathered::Events(events) => (false, of_camera(stream, *events)),
                Gathered::Frames(_) => continue,
            };
            let found = Self {
                path: session.path().to_owned(),
                start: session.summary().start.clone(),
                stream: stream.description.id.clone(),
                of_board,
                rises_ns,
            };
            let place = if of_board { &mut board } else { &mut best };
            if found.rises_ns.len() >= place.as_ref().map_or(LEAST, |other| other.rises_ns.len() + 1) {
                *place = Some(found);
            }
        }
        board.or(best).ok_or_else(|| AlignError::NoPulses { path: session.path().to_owned() })
    }

    /// Which of several sessions the others are brought to: the one with the board, or the first where none has it.
    ///
    /// # Errors
    /// [`AlignError::TwoBoards`].
    pub fn reference(all: &[Self]) -> Result<usize, AlignError> {
        let mut boards = all.iter().enumerate().filter(|(_, pulses)| pulses.of_board);
        match (boards.next(), boards.next()) {
            (Some((_, first)), Some((_, second))) => {
                Err(AlignError::TwoBoards { first: first.path.clone(), second: second.path.clone() })
            }
            (first, _) => Ok(first.map_or(0, |(at, _)| at)),
        }
    }

    /// How this session's clock stands to that of `reference`. `any_date`: whatever their calendars say.
    ///
    /// # Errors
    /// If they did not see the same pulses.
    pub fn align(&self, reference: &Self, any_date: bool) -> Result<Aligned, AlignError> {
        let (path, other) = (self.path.clone(), reference.path.clone());
        let samples: Vec<Sample> = self
            .rises_ns
            .iter()
            .filter_map(|(index, &ticks)| Some(Sample { ticks, session_ns: *reference.rises_ns.get(index)? }))
            .collect();
        let common = samples.len();
        let fit = Clock::fit(&samples, 1.0, Evidence::TriggerEdges, Errors::Symmetric, WINDOW_NS);
        let (Ok(clock), true) = (fit, common >= LEAST) else {
            let ends = |pulses: &Self| {
                let (first, last) = (pulses.rises_ns.keys().next(), pulses.rises_ns.keys().next_back());
                [first, last].map(|index| index.copied().unwrap_or_default())
            };
            let (own, theirs) = (ends(self), ends(reference));
            return Err(AlignError::NothingInCommon { path, reference: other, own, other: theirs, common });
        };
        if clock.residuals.p95_ns > LIMIT_NS || clock.outlier_share() > MANY_OUTLIERS {
            let (p95_us, outliers) = (clock.residuals.p95_ns * 1e-3, clock.outliers);
            return Err(AlignError::OtherTrain { path, reference: other, p95_us, outliers, common });
        }
        // When this session began, by its own calendar and by that of the other host.
        let by_other = reference.start.epoch_ns.saturating_add(clock.session_ns(0));
        let calendar_ns = self.start.epoch_ns.saturating_sub(by_other);
        if calendar_ns.saturating_abs() > CALENDARS_NS && !any_date {
            return Err(AlignError::OtherTake { path, reference: other, seconds: calendar_ns as f64 * 1e-9 });
        }
        Ok(Aligned { clock, common, calendar_ns })
    }
}

fn of_board(lines: BoardLines) -> BTreeMap<u64, i64> {
    let Ok(board) = lines.finish() else { return BTreeMap::new() };
    board.pulses.iter().map(|(&index, pulse)| (index, board.rise_ns(pulse))).collect()
}

/// The longest run of pulses that follow one another: where the board is started again, it counts anew.
fn of_camera(stream: &Stream, events: Events) -> BTreeMap<u64, i64> {
    if events.decoder.is_none() {
        return BTreeMap::new();
    }
    let (mut longest, mut run): (BTreeMap<u64, i64>, BTreeMap<u64, i64>) = (BTreeMap::new(), BTreeMap::new());
    for fitted in epochs::fit(events.stretches.finish(), stream.description.encoding, None) {
        let Some(clock) = &fitted.epoch.clock else { continue };
        let seen = edges::pulses(&fitted.edges, fitted.edges.first().map_or(0, |edge| edge.channel));
        let decoded = code::decode(&seen);
        for (pulse, index) in std::iter::zip(&seen, &decoded.indices) {
            let Some(index) = *index else { continue };
            if run.keys().next_back().is_some_and(|&last| index <= last) {
                keep_longer(&mut longest, std::mem::take(&mut run));
            }
            run.insert(index, clock.session_ns(pulse.rise));
        }
    }
    keep_longer(&mut longest, run);
    longest
}

fn keep_longer(longest: &mut BTreeMap<u64, i64>, run: BTreeMap<u64, i64>) {
    if run.len() > longest.len() {
        *longest = run;
    }
}
