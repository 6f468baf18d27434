//! `--quick`: a calibration that runs beside a recording or a playback, for whoever holds the board: where in each image it
//! has been, how well the views fit, what to show next.

use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use erfgs_calibrate::board::{GRID, LensModel, Quick, Target, detect};
use erfgs_rig::live::{Guidance, Guide, Monitor};
use erfgs_session::{
    pixel,
    source::{Description, Packet},
};

use crate::calibrate::lens_model;

/// Share of one core that may go into it.
const SHARE: f64 = 0.5;
/// Shortest and longest rest between two rounds over the cameras.
const REST: [Duration; 2] = [Duration::from_millis(10), Duration::from_millis(500)];

/// Options of the commands that have a live page.
#[derive(Clone, Debug, clap::Args)]
pub struct QuickOptions {
    /// Calibrate while the cameras run: the live page shows where in each image the board has been, how well its views fit and
    /// what to show next. TARGET is what is printed on the board, as for `erfgs calibrate board`.
    #[arg(long, value_name = "TARGET", requires = "live")]
    quick: Option<Target>,
    /// Lens model of --quick: pinhole, brown, brown8 or fisheye.
    #[arg(long, value_name = "MODEL", default_value = "brown", value_parser = lens_model, requires = "quick")]
    quick_lens: LensModel,
}

impl QuickOptions {
    /// Starts to guide `monitor`'s page, if that is asked for.
    pub fn start<'a>(
        &self,
        descriptions: impl IntoIterator<Item = &'a Description>,
        monitor: &Monitor,
    ) -> anyhow::Result<()> {
        if let Some(target) = &self.quick {
            monitor.guide(QuickBoard::start(descriptions, target, self.quick_lens)?);
        }
        Ok(())
    }
}

/// A frame camera of the rig, as the threads of the rig and of the page see it.
struct Camera {
    description: Description,
    /// The latest frame; older ones that nobody looked at are gone.
    frame: Mutex<Option<Packet>>,
    guidance: Mutex<Guidance>,
}

struct Shared {
    /// By stream; `None` for streams without frames.
    cameras: Vec<Option<Camera>>,
    quit: AtomicBool,
}

/// See the module.
struct QuickBoard {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl QuickBoard {
    /// Looks for `target` in the streams of frames among `descriptions`.
    ///
    /// # Errors
    /// If no stream has frames, or the system gives no thread.
    fn start<'a>(
        descriptions: impl IntoIterator<Item = &'a Description>,
        target: &Target,
        model: LensModel,
    ) -> anyhow::Result<Arc<Self>> {
        let camera = |description: &Description| {
            description.encoding.is_frames().then(|| {
                let quick = Quick::new(&description.id, [description.width, description.height], target.clone(), model);
                let guidance = Mutex::new(guidance(&quick));
                (Camera { description: description.clone(), frame: Mutex::default(), guidance }, quick)
            })
        };
        let (cameras, quicks): (Vec<_>, Vec<_>) = descriptions.into_iter().map(|d| camera(d).unzip()).unzip();
        anyhow::ensure!(
            cameras.iter().any(Option::is_some),
            "--quick looks for the board in frames, and no camera of this rig gives any; event cameras are calibrated \
             afterwards, by `erfgs calibrate board --blink` or `--moving`"
        );
        let shared = Arc::new(Shared { cameras, quit: AtomicBool::new(false) });
        let thread = thread::Builder::new().name("quick-board".into()).spawn({
            let (shared, target) = (Arc::clone(&shared), target.clone());
            move || look(&shared, &target, quicks.into_iter().flatten().collect())
        })?;
        Ok(Arc::new(Self { shared, thread: Mutex::new(Some(thread)) }))
    }
}

/// Goes round the cameras and rests between to keep to the share.
fn look(shared: &Shared, target: &Target, mut quicks: Vec<Quick>) {
    while !shared.quit.load(Ordering::Relaxed) {
        let begun = Instant::now();
        for (camera, quick) in shared.cameras.iter().flatten().zip(&mut quicks) {
            let Some(packet) = lock(&camera.frame).take() else { continue };
            let d = &camera.description;
            let Ok(image) = pixel::picture(d, &packet.payload) else { continue };
            if [image.width, image.height] != [d.width, d.height] {
                continue;
            }
            quick.see(detect(&image, target));
            quick.refit();
            *lock(&camera.guidance) = guidance(quick);
        }
        let rest = begun.elapsed().mul_f64(1.0 / SHARE - 1.0);
        thread::park_timeout(rest.clamp(REST[0], REST[1]));
    }
}

impl Guide for QuickBoard {
    fn packet(&self, stream: usize, packet: &Packet) {
        if let Some(Some(camera)) = self.shared.cameras.get(stream)
            && !packet.damaged
        {
            *lock(&camera.frame) = Some(packet.clone());
        }
    }

    fn guidance(&self) -> Vec<Guidance> {
        self.shared.cameras.iter().flatten().map(|camera| lock(&camera.guidance).clone()).collect()
    }
}

fn guidance(quick: &Quick) -> Guidance {
    let [width, height] = quick.size().map(f64::from);
    let [frames, with_board, views] = quick.counts();
    let mut figures = vec![("board".to_owned(), format!("in {with_board} of {frames} frames · {views} views"))];
    if let Some(fit) = quick.fit() {
        figures.push(("error".into(), format!("{:.2} px", fit.rms_px)));
        figures.push(("focal length".into(), format!("{:.1} ± {:.1} px", fit.focal_px, fit.focal_sigma_px)));
    }
    let advice = quick.advice();
    Guidance {
        id: quick.camera().to_owned(),
        points: quick.last().iter().map(|c| [(c.pixel.x / width) as f32, (c.pixel.y / height) as f32]).collect(),
        columns: GRID[0],
        coverage: quick.coverage(),
        figures,
        done: advice.is_none(),
        advice: advice.unwrap_or_else(|| "enough views".into()),
    }
}

impl Drop for QuickBoard {
    fn drop(&mut self) {
        self.shared.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = lock(&self.thread).take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}
