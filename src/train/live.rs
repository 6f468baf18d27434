//! The page of a run that is being trained.

use std::{
    net::SocketAddr,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    time::{Duration, Instant},
};

use erfgs_page::serve::PageOptions;
use erfgs_run::{LeftOut, RunFolder};
use erfgs_train::trainer::{Outcome, Progress, TrainError, Trainer};
use erfgs_view::{Ask, Learned, LiveTraining, Model, Precision, ViewPage};

use crate::{terminal::Terminal, view};

/// The share of the time that pages may take from training.
const SHARE: f64 = 0.02;
/// The least time between two scenes.
const EVERY: Duration = Duration::from_secs(5);
/// How long an open page may take to fetch the last scene.
const FAREWELL: Duration = Duration::from_secs(3);

/// A page and what it shows.
pub struct Live {
    page: ViewPage,
    asks: mpsc::Receiver<Ask>,
    training: Arc<LiveTraining>,
    /// A picture that a page waits for.
    asked: Option<Ask>,
    started: Instant,
    /// What pages took from training.
    spent: Duration,
    shown: Instant,
    /// Iterations done at the last sight, and those of the scene that is shown.
    iteration: u64,
    shown_iteration: u64,
    /// Share and time at the first sight.
    first: Option<(f64, Instant)>,
}

impl Live {
    /// Serves the scene that training starts from.
    pub fn start(
        address: SocketAddr,
        trainer: &Trainer<'_>,
        folder: &RunFolder,
        terminal: &Terminal,
    ) -> anyhow::Result<Self> {
        let training = Arc::new(LiveTraining::default());
        let scene = Learned::of(&trainer.reconstruction()?).file(Precision::Packed);
        let model = Model {
            name: folder.name(),
            scene,
            dataset: Some(trainer.scene.dataset.clone()),
            errors: Vec::new(),
            window: None,
        };
        let options = PageOptions { address, names: Vec::new(), open: false };
        let (page, asks) = ViewPage::serve(vec![model], Some(Arc::clone(&training)), &options)?;
        terminal.note(format!("the training can be watched at {}", page.url()));
        let now = Instant::now();
        Ok(Self {
            page,
            asks,
            training,
            asked: None,
            started: now,
            spent: Duration::ZERO,
            shown: now,
            iteration: 0,
            shown_iteration: 0,
            first: None,
        })
    }

    /// Passes on where training stands, and sets `stop` where the page wishes it.
    pub fn progress(&mut self, now: &Progress, stop: &AtomicBool) {
        let (share, since) = *self.first.get_or_insert((now.share, Instant::now()));
        let done = now.share - share;
        let left = (done > 1e-6).then(|| since.elapsed().as_secs_f64() / done * (1.0 - now.share));
        self.training.tell(now, left);
        self.iteration = now.iteration;
        if self.training.is_to_stop() {
            stop.store(true, Ordering::Relaxed);
        }
    }

    fn scene_is_due(&self) -> bool {
        self.training.is_watched() && self.iteration > self.shown_iteration && self.shown.elapsed() >= EVERY
    }

    /// Whether a page waits for something, and may have it by the time that it took so far.
    pub fn wants_look(&mut self) -> bool {
        if self.spent.as_secs_f64() > SHARE * self.started.elapsed().as_secs_f64() {
            return false;
        }
        if self.asked.is_none() {
            // Who asked may have left.
            self.asked = self.asks.try_iter().find(|ask| !ask.is_abandoned());
        }
        self.asked.is_some() || self.scene_is_due()
    }

    /// Draws the picture that a page waits for, and shows what was learned by now.
    pub fn look(&mut self, trainer: &mut Trainer<'_>) -> Result<(), TrainError> {
        let from = Instant::now();
        if let Some(ask) = self.asked.take() {
            view::answer(ask, |view, t01| trainer.render(view, t01));
        }
        if self.scene_is_due() {
            self.show(trainer)?;
        }
        self.spent += from.elapsed();
        Ok(())
    }

    fn show(&mut self, trainer: &Trainer<'_>) -> Result<(), TrainError> {
        let words = |left: &LeftOut| format!("{}: {} ({})", left.what, left.why, left.saves);
        self.training.leaves_out(trainer.left_out().iter().map(words).collect());
        self.page.replace(0, Learned::of(&trainer.reconstruction()?).file(Precision::Packed));
        self.shown = Instant::now();
        self.shown_iteration = self.iteration;
        Ok(())
    }

    /// Whether the page wishes for a checkpoint; it is told that there is one.
    pub fn wants_checkpoint(&mut self) -> bool {
        let wants = self.training.takes_checkpoint();
        if wants {
            self.training.saved(self.iteration);
        }
        wants
    }

    /// Shows the end: pages that are open keep the last scene.
    pub fn end(mut self, trainer: &mut Trainer<'_>, outcome: &Result<Outcome, TrainError>) {
        let how = match outcome {
            Ok(Outcome::Finished) => "finished".to_owned(),
            Ok(Outcome::Stopped) => "stopped; the same command with --resume continues".to_owned(),
            Err(error) => error.to_string(),
        };
        if !self.training.is_watched() {
            return;
        }
        // Where the device failed there is no last scene.
        if let Err(error) = self.show(trainer) {
            tracing::debug!("no last scene: {error}");
        }
        self.training.ended(&how);
        let from = Instant::now();
        while from.elapsed() < FAREWELL {
            if let Ok(ask) = self.asks.recv_timeout(Duration::from_millis(50)) {
                view::answer(ask, |view, t01| trainer.render(view, t01));
            }
        }
    }
}
