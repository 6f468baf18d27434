//! `--quick`: a calibration that runs beside a recording or a playback, for whoever holds the board: where in each image it
//! has been, how well the views fit, what to show next.

use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use erfgs_calibrate::board::{EventBoard, EventPictures, GRID, LensModel, Quick, Target, detect};
use erfgs_events::{Decoder as _, SensorSize, StreamDecoder};
use erfgs_recorder::live::{Guidance, Guide, Monitor};
use erfgs_session::{
    container::hand_over,
    source::{Description, Packet},
};

use crate::calibrate::{blink_rate, lens_model};

/// Share of one core that may go into it.
const SHARE: f64 = 0.5;
/// Shortest and longest rest between two rounds over the cameras.
const REST: [Duration; 2] = [Duration::from_millis(10), Duration::from_millis(500)];
/// So many bytes of an event camera wait at most. If there are more, all are passed over: looking for the board needs events
/// without gaps, for half a second or so, and not all the time.
const WAITING: usize = 16 << 20;

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
    /// Event cameras of --quick: the board blinks on a screen so many times a second (`erfgs calibrate target --out
    /// board.html`). Without it they are looked at as with `calibrate board --moving`: a printed board that is waved.
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
            monitor.guide(QuickBoard::start(descriptions, target, board, self.quick_lens)?);
        }
        Ok(())
    }
}

/// A camera of the rig, as the threads of the rig and of the page see it.
struct Camera {
    description: Description,
    waiting: Mutex<Waiting>,
    guidance: Mutex<Guidance>,
}

/// What has arrived and was not looked at.
enum Waiting {
    /// The latest frame; older ones that nobody looked at are gone.
    Frame(Option<Packet>),
    /// All packets of events since the last look, unless there were too many.
    Events { packets: VecDeque<Packet>, bytes: usize, lost: bool },
}

/// What the calibration's own thread keeps of a camera.
struct Eye {
    quick: Quick,
    /// What the board is in this camera's pictures.
    target: Target,
    /// `None` for frames.
    events: Option<EventEye>,
}

/// What makes pictures of events.
struct EventEye {
    decoder: StreamDecoder,
    /// As at the start, for after a gap.
    fresh: EventPictures,
    pictures: EventPictures,
}

struct Shared {
    /// By stream; `None` for streams that show nothing.
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
    /// Looks for `target` in the cameras among `descriptions`; for event cameras `board` says what it does.
    ///
    /// # Errors
    /// If there is no camera, or the system gives no thread.
    fn start<'a>(
        descriptions: impl IntoIterator<Item = &'a Description>,
        target: &Target,
        board: EventBoard,
        model: LensModel,
    ) -> anyhow::Result<Arc<Self>> {
        let pairs =
            descriptions.into_iter().map(|d| Eye::new(d, target, board, model).map(|eye| (Camera::new(d, &eye), eye)));
        let (cameras, eyes): (Vec<_>, Vec<_>) = pairs.map(Option::unzip).unzip();
        anyhow::ensure!(
            cameras.iter().any(Option::is_some),
            "--quick looks for the board in frames and events, and no stream of this rig has any"
        );
        let shared = Arc::new(Shared { cameras, quit: AtomicBool::new(false) });
        let thread = thread::Builder::new().name("quick-board".into()).spawn({
            let shared = Arc::clone(&shared);
            move || look(&shared, eyes.into_iter().flatten().collect())
        })?;
        Ok(Arc::new(Self { shared, thread: Mutex::new(Some(thread)) }))
    }
}

impl Camera {
    fn new(description: &Description, eye: &Eye) -> Self {
        let waiting = match eye.events {
            None => Waiting::Frame(None),
            Some(_) => Waiting::Events { packets: VecDeque::new(), bytes: 0, lost: false },
        };
        let guidance = Mutex::new(guidance(&eye.quick));
        Self { description: description.clone(), waiting: Mutex::new(waiting), guidance }
    }

    /// Takes note of a packet; returns at once.
    fn keep(&self, packet: &Packet) {
        match &mut *lock(&self.waiting) {
            Waiting::Frame(frame) if !packet.damaged => *frame = Some(packet.clone()),
            Waiting::Frame(_) => {}
            Waiting::Events { packets, bytes, lost } => {
                if *bytes + packet.payload.len() > WAITING {
                    packets.clear();
                    (*bytes, *lost) = (0, true);
                }
                *bytes += packet.payload.len();
                packets.push_back(packet.clone());
            }
        }
    }

    /// What has arrived since the last look, and whether something is missing before it.
    fn take(&self) -> (VecDeque<Packet>, bool) {
        match &mut *lock(&self.waiting) {
            Waiting::Frame(frame) => (frame.take().into_iter().collect(), false),
            Waiting::Events { packets, bytes, lost } => {
                *bytes = 0;
                (std::mem::take(packets), std::mem::take(lost))
            }
        }
    }
}

impl Eye {
    /// `None` for a stream that shows nothing.
    fn new(d: &Description, target: &Target, board: EventBoard, model: LensModel) -> Option<Self> {
        let quick = |target: &Target, events| Quick::new(&d.id, events, [d.width, d.height], target.clone(), model);
        if d.encoding.is_frames() {
            return Some(Self { quick: quick(target, false), target: target.clone(), events: None });
        }
        let side = |pixels: u32| u16::try_from(pixels).ok().filter(|pixels| *pixels > 0);
        let size = SensorSize { width: side(d.width)?, height: side(d.height)? };
        if !d.encoding.is_events() {
            return None;
        }
        let decoder = StreamDecoder::new(d.encoding.events()?, Some(size));
        let pictures = EventPictures::new([size.width, size.height].map(usize::from), board);
        let target = board.as_seen(target);
        let events = Some(EventEye { decoder, fresh: pictures.clone(), pictures });
        Some(Self { quick: quick(&target, true), target, events })
    }

    /// Looks at what has arrived. Returns whether there was something to see.
    fn look(&mut self, description: &Description, packets: VecDeque<Packet>, lost: bool) -> bool {
        let mut looked = false;
        let Self { quick, target, events } = self;
        let mut see = |image| {
            quick.see(detect(&image, target));
            looked = true;
        };
        match events {
            None => {
                let [width, height] = [description.width, description.height];
                for packet in packets {
                    let Some(Ok(image)) = description.frame_format().map(|format| format.picture(&packet.payload))
                    else {
                        continue;
                    };
                    if [image.width, image.height] == [width, height] {
                        see(image);
                    }
                }
            }
            Some(EventEye { decoder, fresh, pictures }) => {
                if lost {
                    decoder.restart();
                    pictures.clone_from(fresh);
                }
                for packet in packets {
                    if packet.discontinuity {
                        pictures.clone_from(fresh);
                    }
                    hand_over(decoder, &packet, true);
                    decoder.decode(&packet.payload, &mut pictures.watch(&mut |_, image| see(image)));
                }
            }
        }
        if looked {
            quick.refit();
        }
        looked
    }
}

/// Goes round the cameras and rests between to keep to the share.
fn look(shared: &Shared, mut eyes: Vec<Eye>) {
    while !shared.quit.load(Ordering::Relaxed) {
        let begun = Instant::now();
        for (camera, eye) in shared.cameras.iter().flatten().zip(&mut eyes) {
            let (packets, lost) = camera.take();
            if eye.look(&camera.description, packets, lost) {
                *lock(&camera.guidance) = guidance(&eye.quick);
            }
        }
        let rest = begun.elapsed().mul_f64(1.0 / SHARE - 1.0);
        thread::park_timeout(rest.clamp(REST[0], REST[1]));
    }
}

impl Guide for QuickBoard {
    fn packet(&self, stream: usize, packet: &Packet) {
        if let Some(Some(camera)) = self.shared.cameras.get(stream) {
            camera.keep(packet);
        }
    }

    fn guidance(&self) -> Vec<Guidance> {
        self.shared.cameras.iter().flatten().map(|camera| lock(&camera.guidance).clone()).collect()
    }
}

fn guidance(quick: &Quick) -> Guidance {
    let [width, height] = quick.size().map(f64::from);
    let [frames, with_board, views] = quick.counts();
    let mut figures = vec![("board".to_owned(), format!("in {with_board} of {frames} pictures · {views} views"))];
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
