//! A run that is being trained: what its page is told, and what the page wishes.

use std::{
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use erfgs_train::trainer::Progress;
use serde::Serialize;

/// A page that has not asked for so long is closed.
const CLOSED: Duration = Duration::from_secs(6);

/// What joins the trainer and its page.
#[derive(Debug, Default)]
pub struct LiveTraining {
    state: Mutex<TrainingState>,
    /// When a page asked last.
    asked: Mutex<Option<Instant>>,
    checkpoint: AtomicBool,
    stop: AtomicBool,
}

/// Where a training stands.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TrainingState {
    /// Where it stands now.
    pub now: Option<Progress>,
    /// Seconds that it takes yet, as far as can be told.
    pub left_seconds: Option<f64>,
    /// Rows of its curve: those that were logged, evaluated or not.
    pub rows: Vec<Progress>,
    /// What the scene did not need.
    pub left_out: Vec<String>,
    /// When the last checkpoint was saved that the page wished for, iteration.
    pub saved: Option<u64>,
    /// How it ended.
    pub ended: Option<String>,
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl LiveTraining {
    /// Tells where the training stands. What was measured there becomes a row of the curve.
    pub fn tell(&self, now: &Progress, left_seconds: Option<f64>) {
        let mut state = held(&self.state);
        if now.loss_rgb.is_some() || now.loss_event.is_some() || now.psnr.is_some() {
            state.rows.push(*now);
        }
        state.now = Some(*now);
        state.left_seconds = left_seconds;
    }

    /// Tells what the scene does not need.
    pub fn leaves_out(&self, what: Vec<String>) {
        held(&self.state).left_out = what;
    }

    /// Tells that a checkpoint was saved after so many iterations.
    pub fn saved(&self, iteration: u64) {
        held(&self.state).saved = Some(iteration);
    }

    /// Tells how it ended.
    pub fn ended(&self, how: &str) {
        held(&self.state).ended = Some(how.to_owned());
    }

    /// Whether a page is open.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        held(&self.asked).is_some_and(|asked| asked.elapsed() < CLOSED)
    }

    /// Whether a page wished for a checkpoint since this was asked last.
    #[must_use]
    pub fn takes_checkpoint(&self) -> bool {
        self.checkpoint.swap(false, Ordering::Relaxed)
    }

    /// Whether a page wished the training to stop.
    #[must_use]
    pub fn is_to_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The state, with the rows that follow the first `rows`.
    pub(crate) fn since(&self, rows: usize) -> TrainingState {
        *held(&self.asked) = Some(Instant::now());
        let state = held(&self.state);
        let new = state.rows.get(rows..).unwrap_or_default().to_vec();
        TrainingState { rows: new, left_out: state.left_out.clone(), ended: state.ended.clone(), ..*state }
    }

    pub(crate) fn wish_checkpoint(&self) {
        self.checkpoint.store(true, Ordering::Relaxed);
    }

    pub(crate) fn wish_stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}
