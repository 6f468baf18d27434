//! The calibration of all cameras of a rig while it records or is played: packets go in from the threads of the rig, a thread
//! of its own looks for the board in them, and what it knows of each camera can be asked for at any time.

use std::{
    collections::VecDeque,
    io,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use erfgs_events::{Decoder as _, StreamDecoder};
use erfgs_session::{
    container::{hand_over, sensor_size},
    source::{Description, Packet},
};

use super::{EventBoard, EventPictures, LensModel, Quick, QuickState, Target, detect};

/// Share of one core that may go into it.
const SHARE: f64 = 0.5;
/// Shortest and longest rest between two rounds over the cameras.
const REST: [Duration; 2] = [Duration::from_millis(10), Duration::from_millis(500)];
/// So many bytes of an event camera wait at most. If there are more, all are passed over: looking for the board needs events
/// without gaps, for half a second or so, and not all the time.
const WAITING: usize = 16 << 20;

/// A camera of the rig, as the threads of the rig and of the page see it.
struct Camera {
    description: Description,
    waiting: Mutex<Waiting>,
    state: Mutex<QuickState>,
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

/// See the module. Dropped, it ends its thread.
pub struct QuickRig {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl QuickRig {
    /// Looks for `target` in the cameras among `descriptions`, the streams of the rig in their order; for event cameras `board`
    /// says what it does. `None` if no stream shows anything.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start<'a>(
        descriptions: impl IntoIterator<Item = &'a Description>,
        target: &Target,
        board: EventBoard,
        model: LensModel,
    ) -> io::Result<Option<Self>> {
        let pairs =
            descriptions.into_iter().map(|d| Eye::new(d, target, board, model).map(|eye| (Camera::new(d, &eye), eye)));
        let (cameras, eyes): (Vec<_>, Vec<_>) = pairs.map(Option::unzip).unzip();
        if cameras.iter().all(Option::is_none) {
            return Ok(None);
        }
        let shared = Arc::new(Shared { cameras, quit: AtomicBool::new(false) });
        let thread = thread::Builder::new().name("quick-board".into()).spawn({
            let shared = Arc::clone(&shared);
            move || look(&shared, eyes.into_iter().flatten().collect())
        })?;
        Ok(Some(Self { shared, thread: Some(thread) }))
    }

    /// Takes note of a packet of the `stream`-th stream; returns at once.
    pub fn packet(&self, stream: usize, packet: &Packet) {
        if let Some(Some(camera)) = self.shared.cameras.get(stream) {
            camera.keep(packet);
        }
    }

    /// What is known of each stream that shows something.
    #[must_use]
    pub fn states(&self) -> Vec<QuickState> {
        self.shared.cameras.iter().flatten().map(|camera| lock(&camera.state).clone()).collect()
    }
}

impl Camera {
    fn new(description: &Description, eye: &Eye) -> Self {
        let waiting = match eye.events {
            None => Waiting::Frame(None),
            Some(_) => Waiting::Events { packets: VecDeque::new(), bytes: 0, lost: false },
        };
        let state = Mutex::new(eye.quick.state());
        Self { description: description.clone(), waiting: Mutex::new(waiting), state }
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
        let (encoding, size) = (d.encoding.events()?, sensor_size(d)?);
        let decoder = StreamDecoder::new(encoding, Some(size));
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
                *lock(&camera.state) = eye.quick.state();
            }
        }
        let rest = begun.elapsed().mul_f64(1.0 / SHARE - 1.0);
        thread::park_timeout(rest.clamp(REST[0], REST[1]));
    }
}

impl Drop for QuickRig {
    fn drop(&mut self) {
        self.shared.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}
