//! The clocks of one stream, a clock for each stretch between two breaks of its device's time.
//!
//! A device that restarts begins a new time: it may start at zero again, so that ticks repeat and no map from ticks alone
//! to session time can be right. What tells stretches apart is where they lie in the stream: an epoch begins at a break,
//! which a decoder tells while it decodes a packet ([`Sink::discontinuity`](erfgs_events::Sink::discontinuity)).

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::Clock;

/// A stretch of a stream in which its device's clock ran without a break.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Number of the packet in which it begins.
    pub first_sequence: u64,
    /// With which of the breaks that are told within that packet it begins, counted from 1; 0: before all of them.
    pub first_break: u32,
    /// When that packet arrived, nanoseconds of session time.
    pub arrived_ns: i64,
    /// From its ticks to session time; absent where nothing dates it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<Clock>,
}

/// The epochs of a stream.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Vec<Epoch>", into = "Vec<Epoch>")]
pub struct Epochs(Vec<Epoch>);

impl From<Vec<Epoch>> for Epochs {
    /// In the order of the stream, whatever the order given.
    fn from(mut epochs: Vec<Epoch>) -> Self {
        epochs.sort_by_key(place);
        Self(epochs)
    }
}

impl From<Epochs> for Vec<Epoch> {
    fn from(epochs: Epochs) -> Self {
        epochs.0
    }
}

impl From<Clock> for Epochs {
    /// A stream without a break.
    fn from(clock: Clock) -> Self {
        Self(vec![Epoch { first_sequence: 0, first_break: 0, arrived_ns: 0, clock: Some(clock) }])
    }
}

fn place(epoch: &Epoch) -> (u64, u32) {
    (epoch.first_sequence, epoch.first_break)
}

impl Epochs {
    /// The epochs, in the order of the stream.
    #[must_use]
    pub fn as_slice(&self) -> &[Epoch] {
        &self.0
    }

    /// The clocks of all epochs that have one.
    pub fn clocks(&self) -> impl Iterator<Item = &Clock> {
        self.0.iter().filter_map(|epoch| epoch.clock.as_ref())
    }

    /// Whether no part of the stream is dated.
    #[must_use]
    pub fn are_undated(&self) -> bool {
        self.clocks().next().is_none()
    }

    /// Follows the stream from epoch to epoch while it is decoded.
    #[must_use]
    pub fn follow(&self) -> EpochCursor<'_> {
        EpochCursor::start(Cow::Borrowed(&self.0))
    }

    /// As [`Epochs::follow`], with the epochs kept in what follows.
    #[must_use]
    pub fn into_cursor(self) -> EpochCursor<'static> {
        EpochCursor::start(Cow::Owned(self.0))
    }
}

/// Where a decoder is among the epochs of a stream. A sink passes on what it is told: packets and breaks.
#[derive(Clone, Debug)]
pub struct EpochCursor<'a> {
    epochs: Cow<'a, [Epoch]>,
    at: (u64, u32),
    /// The place of the epoch that holds.
    current: usize,
}

impl<'a> EpochCursor<'a> {
    fn start(epochs: Cow<'a, [Epoch]>) -> Self {
        let mut cursor = Self { epochs, at: (0, 0), current: 0 };
        cursor.seek();
        cursor
    }

    /// What is decoded next came in the packet of this number.
    pub fn packet(&mut self, sequence: u64) {
        self.at = (sequence, 0);
        self.seek();
    }

    /// The decoder told a break.
    pub fn discontinuity(&mut self) {
        self.at.1 = self.at.1.saturating_add(1);
        self.seek();
    }

    fn seek(&mut self) {
        let after = self.epochs.partition_point(|epoch| place(epoch) <= self.at);
        // What comes before the first epoch has nothing better than that.
        self.current = after.saturating_sub(1);
    }

    /// The session time of a device time in microseconds, nanoseconds; `None` in an epoch that nothing dates.
    #[must_use]
    pub fn session_ns(&self, t_us: u64) -> Option<i64> {
        let clock = self.epochs.get(self.current)?.clock.as_ref()?;
        Some(clock.session_ns(i64::try_from(t_us).unwrap_or(i64::MAX)))
    }
}
