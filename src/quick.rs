//! `--quick`: a calibration that runs beside a recording or a playback, for whoever holds the board. The live page shows where
//! in each image the board has been, how well the views fit, what to show next.

use std::sync::Arc;

use erfgs_calibrate::board::{EventBoard, GRID, LensModel, QuickRig, QuickState, Target};
use erfgs_recorder::live::{Guidance, Guide, Monitor};
use erfgs_session::source::{Description, Packet};

use crate::calibrate::{blink_rate, lens_model};

/// Options of the commands that have a live page.
#[derive(Clone, Debug, clap::Args)]
pub struct QuickOptions {
    /// Calibrate while the cameras run: the live page shows where in each image the board has been, how well its views fit
    /// and what to show next. TARGET describes the board, as for `erfgs calibrate board`.
    #[arg(long, value_name = "TARGET", requires = "live")]
    quick: Option<Target>,
    /// Lens model of --quick: pinhole, brown, brown8 or fisheye.
    #[arg(long, value_name = "MODEL", default_value = "brown", value_parser = lens_model, requires = "quick")]
    quick_lens: LensModel,
    /// Event cameras of --quick: blink rate of a board on a screen, hertz (`erfgs calibrate target --out board.html`).
    /// Default: a printed board that is waved, as with `calibrate board --moving`.
    #[arg(long, value_name = "HZ", requires = "quick", value_parser = blink_rate)]
    quick_blink: Option<f64>,
}

impl QuickOptions {
    /// Starts to guide `monitor`'s page, if that is asked for.
    pub fn start<'a>(
        &self,
        descriptions: impl IntoIterator<Item = &'a Description>,
        monitor: &Monitor,
    ) -> anyhow::Result<()> {
        if let Some(target) = &self.quick {
            let board = self.quick_blink.map_or(EventBoard::Moving, |hz| EventBoard::Blinking { hz });
            let Some(rig) = QuickRig::start(descriptions, target, board, self.quick_lens)? else {
                anyhow::bail!("--quick looks for the board in frames and events, and no stream of this rig has any");
            };
            monitor.guide(Arc::new(QuickBoard(rig)));
        }
        Ok(())
    }
}

/// A calibration as a guide of the page.
struct QuickBoard(QuickRig);

impl Guide for QuickBoard {
    fn packet(&self, stream: usize, packet: &Packet) {
        self.0.packet(stream, packet);
    }

    fn guidance(&self) -> Vec<Guidance> {
        self.0.states().into_iter().map(guidance).collect()
    }
}

fn guidance(state: QuickState) -> Guidance {
    let [width, height] = state.size.map(f64::from);
    let [frames, with_board, views] = state.counts;
    let mut figures = vec![("board".to_owned(), format!("in {with_board} of {frames} pictures · {views} views"))];
    if let Some(fit) = state.fit {
        figures.push(("error".into(), format!("{:.2} px", fit.rms_px)));
        figures.push(("focal length".into(), format!("{:.1} ± {:.1} px", fit.focal_px, fit.focal_sigma_px)));
    }
    Guidance {
        id: state.camera,
        points: state.last.iter().map(|c| [(c.pixel.x / width) as f32, (c.pixel.y / height) as f32]).collect(),
        columns: GRID[0],
        coverage: state.coverage,
        figures,
        done: state.advice.is_none(),
        advice: state.advice.unwrap_or_else(|| "enough views".into()),
    }
}
