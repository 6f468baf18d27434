//! What follows a training while it runs: a line on the terminal, and a page where one was asked for.

use std::sync::atomic::AtomicBool;

use erfgs_train::trainer::{Progress, TrainError, Trainer, Watch};

use super::live::Live;
use crate::{progress::Progress as Bar, terminal::thousands};

/// What follows a run: a line on the terminal, and a page where one was asked for.
pub(super) struct Follow {
    pub(super) bar: Bar,
    pub(super) live: Option<Live>,
    pub(super) stop: &'static AtomicBool,
    /// Iteration and seconds of training at the first sight.
    pub(super) first: Option<(u64, f64)>,
    pub(super) last: Option<Progress>,
    /// PSNR and DPSNR at the last look.
    pub(super) quality: (Option<f64>, Option<f64>),
}

impl Watch for Follow {
    fn progress(&mut self, now: &Progress) {
        let &mut (iteration, seconds) = self.first.get_or_insert((now.iteration, now.seconds));
        self.quality = (now.psnr.or(self.quality.0), now.dpsnr.or(self.quality.1));
        let quality = self.quality;
        let text = || {
            let pace = (now.iteration - iteration) as f64 / (now.seconds - seconds).max(1e-9);
            let mut text = format!(
                "{} iteration {}, {pace:.1} a second, {} Gaussians",
                now.stage.name(),
                thousands(now.iteration),
                thousands(now.gaussians.into())
            );
            for (name, value) in [("PSNR", quality.0), ("DPSNR", quality.1)] {
                text.extend(value.map(|value| format!(", {name} {value:.2} dB")));
            }
            text
        };
        let is_look = now.psnr.is_some();
        self.bar.values(now.share, text, is_look, || serde_json::to_value(now).unwrap_or_default());
        if let Some(live) = &mut self.live {
            live.progress(now, self.stop);
        }
        self.last = Some(*now);
    }

    fn wants_look(&mut self) -> bool {
        self.live.as_mut().is_some_and(Live::wants_look)
    }

    fn look(&mut self, trainer: &mut Trainer<'_>) -> Result<(), TrainError> {
        self.live.as_mut().map_or(Ok(()), |live| live.look(trainer))
    }

    fn wants_checkpoint(&mut self) -> bool {
        self.live.as_mut().is_some_and(Live::wants_checkpoint)
    }
}
