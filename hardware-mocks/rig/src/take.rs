//! A take: devices are plugged in, set, started and recorded into a session.

use std::{
    fs::File,
    path::Path,
    sync::{Arc, Mutex, PoisonError},
    time::{SystemTime, UNIX_EPOCH},
};

use erfgs_hardware_mocks::{
    trigger::{Board, Clock as BoardClock},
    usb::{
        Davis346, Davis346Options, Evk4, Evk4Options, Faults, Plug, UsbDevice, Uvc, UvcOptions,
        evk4::Stimulus,
        scene::{EventScene, FrameScene, PatternFrames},
        uvc::Format,
    },
};
use erfgs_recorder::{DeviceConfig, DeviceSettings, Input, OpenError, RigConfig, open_on};
use erfgs_rig::{trigger::TriggerError, usb::Bus};
use erfgs_session::{
    container::{ContainerError, SessionStart, SessionWriter, Settings, StreamId},
    source::{Description, Incident, Outlet, Packet, SourceError},
};
use erfgs_stage::{Stage, StageError, StageOptions, StageView};

use crate::{
    bus::{Clock as _, EmulatedBus},
    fault,
    film::{Film, FilmError, FilmEvents, FilmFrames},
    kernel::{self, UvcHost},
    performance::{StageEvents, StageFrames},
    plan::{Act, BEFORE_S, Camera, Kind, Plan},
    screen::{Screen, ScreenEvents, ScreenFrames},
    trigger::{self, TriggerHost, Wires},
    wand::{Wand, WandEvents, WandFrames},
    world::{Stepped, World},
};

/// Why a take fails.
#[derive(Debug, thiserror::Error)]
pub enum TakeError {
    /// The session cannot be written.
    #[error(transparent)]
    Session(#[from] ContainerError),
    /// The recorder does not take the rig file.
    #[error(transparent)]
    Rig(#[from] erfgs_recorder::ConfigError),
    /// A driver does not open its device.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The board's settings are out of its range.
    #[error(transparent)]
    Trigger(#[from] TriggerError),
    /// The stage cannot be filmed.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// The film cannot be shown.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A film was to be shown, and the plan has none.
    #[error("the plan has no film")]
    NoFilm,
    /// A driver does not start or stop its device.
    #[error("cannot {doing} '{id}': {source}")]
    Source {
        /// What was being done.
        doing: &'static str,
        /// The device.
        id: String,
        /// What its driver says.
        source: SourceError,
    },
    /// The rig file has no device that the plan has.
    #[error("the rig file has no device '{id}'")]
    Missing {
        /// The device.
        id: String,
    },
}

/// The world's time when the devices are plugged in, nanoseconds.
const PLUGGED_NS: i64 = 3_000_000_000_000;
/// From there to the beginning of an act; drivers need less.
const SET_NS: i64 = 20_000_000_000;
/// So long before it the recording begins and sources are started, which takes half a second.
const STARTED_NS: i64 = 1_000_000_000;
/// When a recording begins, the world's time.
pub(crate) const RECORDED_NS: i64 = PLUGGED_NS + SET_NS - STARTED_NS;

/// Records an act into a session at `path`. `progress` hears what is being done and the share of it that is done.
///
/// # Errors
/// If the session cannot be written, or a device cannot be set.
pub fn record(plan: &Plan, act: Act, path: &Path, progress: &(dyn Fn(&str, f64) + Sync)) -> Result<(), TakeError> {
    let text = plan.rig_toml(act);
    let rig = RigConfig::parse(&text, Path::new("RIG.toml"))?;
    let world = Arc::new(World::new(PLUGGED_NS));
    let begin_ns = PLUGGED_NS + SET_NS;
    let wires = Wires::default();
    let scenes = Scenes { plan, act, stage: stage(plan), begin_ns, progress };
    let bus = EmulatedBus::new(Arc::clone(&world) as _);
    for (index, camera) in plan.cameras.iter().enumerate().filter(|(_, camera)| camera.kind.sees_events()) {
        bus.add(Arc::new(Mutex::new(scenes.event_camera(index, camera, &wires)?)));
    }
    let bus: Arc<dyn Bus> = Arc::new(bus);
    let mut event_cameras = open_on(&RigConfig { devices: on_bus(&rig), ..rig.clone() }, &bus)?;
    world.run(RECORDED_NS, &mut [], &mut |_| {});

    let session = Recording::begin(path, &text, world.now_ns())?;
    for Input { source, .. } in &mut event_cameras {
        let id = source.description().id.clone();
        let outlet = session.outlet(source.description(), &world)?;
        source.start(outlet).map_err(|source| TakeError::Source { doing: "start", id, source })?;
    }
    let mut board = None;
    for device in &rig.devices {
        let DeviceSettings::Trigger(config) = &device.settings else { continue };
        let settings = config.settings()?;
        let outlet = session.outlet(&trigger::description(&device.id, &settings), &world)?;
        let clock = BoardClock { ppm: -38.0, drift_ppm_per_minute: 0.2 };
        let model = Board::new(clock, fault::of_board(&plan.faults), PLUGGED_NS);
        let host = TriggerHost::start(model, &settings, wires.clone(), outlet, world.now_ns());
        if let Some(film) = &plan.film {
            film.begin(begin_ns + (1e9 * BEFORE_S) as i64, |ahead| host.rise_ns(ahead));
        }
        board = Some(host);
    }
    let mut devices: Vec<Box<dyn Stepped>> = Vec::new();
    // First: a pulse reaches the cameras in the step in which it comes.
    devices.extend(board.map(|host| Box::new(host) as Box<dyn Stepped>));
    for (index, camera) in plan.cameras.iter().enumerate().filter(|(_, camera)| !camera.kind.sees_events()) {
        let device = device(&rig, &camera.id)?;
        let DeviceSettings::Camera(config) = &device.settings else { continue };
        let description = kernel::description(config, plan.exposure_us(camera.kind, act));
        let outlet = session.outlet(&description, &world)?;
        let model = scenes.frame_camera(index, camera, config.rate_hz, &wires)?;
        let begins_ns = match (&plan.film, camera.kind) {
            (Some(film), Kind::Uvc { triggered: false }) => film.in_step_ns(world.now_ns()),
            _ => world.now_ns(),
        };
        devices.push(Box::new(UvcHost::start(model, description, config.rate_hz, outlet, begins_ns)));
    }
    let end_ns = begin_ns + (1e9 * plan.seconds(act)) as i64;
    world.run(end_ns, &mut devices, &mut |share| progress("recording", share));
    for Input { source, .. } in &mut event_cameras {
        let id = source.description().id.clone();
        source.stop().map_err(|source| TakeError::Source { doing: "stop", id, source })?;
    }
    drop((devices, event_cameras));
    session.finish(world.now_ns())?;
    match plan.film.as_ref().and_then(|film| film.take_failure()) {
        Some(error) => Err(FilmError::from(error).into()),
        None => Ok(()),
    }
}

/// The stage lives as long as the program: its views are handed to devices.
fn stage(plan: &Plan) -> &'static Stage {
    Box::leak(Box::new(Stage::new(StageOptions { samples_per_axis: plan.samples, ..StageOptions::default() })))
}

fn on_bus(rig: &RigConfig) -> Vec<DeviceConfig> {
    let of_bus =
        |device: &&DeviceConfig| matches!(device.settings, DeviceSettings::Evk4(_) | DeviceSettings::Davis346(_));
    rig.devices.iter().filter(of_bus).cloned().collect()
}

fn device<'a>(rig: &'a RigConfig, id: &str) -> Result<&'a DeviceConfig, TakeError> {
    rig.devices.iter().find(|device| device.id == id).ok_or_else(|| TakeError::Missing { id: id.to_owned() })
}

/// What the cameras see.
struct Scenes<'a> {
    plan: &'a Plan,
    act: Act,
    stage: &'static Stage,
    begin_ns: i64,
    progress: &'a (dyn Fn(&str, f64) + Sync),
}

impl Scenes<'_> {
    fn screen(&self, camera: &Camera) -> Screen {
        Screen::new(camera.lens, camera.bench, self.begin_ns + 400_000_000, self.plan.boards)
    }

    /// When the performance begins, and how long it is.
    fn performance(&self) -> [i64; 2] {
        [self.begin_ns + (1e9 * BEFORE_S) as i64, (1e9 * self.plan.performance_s) as i64]
    }

    fn film(&self) -> Result<Arc<Film>, TakeError> {
        self.plan.film.clone().ok_or(TakeError::NoFilm)
    }

    fn events(&self, index: usize, camera: &Camera) -> Result<Box<dyn EventScene>, TakeError> {
        let seed = self.plan.seed + index as u64;
        Ok(match self.act {
            Act::Screen => Box::new(ScreenEvents::new(self.screen(camera), seed)),
            Act::Wand => Box::new(WandEvents::new(Wand::new(camera.lens, camera.place, self.begin_ns), seed)),
            Act::Film => Box::new(FilmEvents::new(self.film()?, &camera.id)?),
            Act::Performance => {
                let view = StageView::new(self.stage, &camera.lens, &camera.place)?;
                let what = format!("events of {}", camera.id);
                let progress = |share| (self.progress)(&what, share);
                let thresholds = camera.kind.thresholds();
                Box::new(StageEvents::record(
                    &view,
                    self.performance(),
                    thresholds,
                    self.plan.seed,
                    index as u64,
                    &progress,
                )?)
            }
        })
    }

    fn event_camera(&self, index: usize, camera: &Camera, wires: &Wires) -> Result<Box<dyn UsbDevice>, TakeError> {
        let mut faults =
            Faults { clock: camera.clock, jitter_mean_us: 150.0, jitter_seed: index as u64, ..Faults::default() };
        fault::of_camera(&self.plan.faults, &camera.id, 1e-9 * (SET_NS - STARTED_NS) as f64, &mut faults);
        let cable = faults.clone();
        let (trigger, events) = (wires.events.clone(), self.events(index, camera)?);
        let device: Box<dyn UsbDevice> = if camera.kind == Kind::Evk4 {
            // Serial numbers are of the plan, and are numbers.
            let serial = u32::from_str_radix(&camera.serial, 16).unwrap_or_default();
            let options = Evk4Options { serial, trigger, faults, queue_bytes: 64 << 20, ..Evk4Options::default() };
            Box::new(Evk4::new(options, Stimulus::Scene(events)))
        } else {
            let serial = camera.serial.clone();
            let options = Davis346Options { serial, trigger, faults, ..Davis346Options::default() };
            Box::new(Davis346::new(options, events, Box::new(PatternFrames::new())))
        };
        Ok(Box::new(Plug::new(device, &cable)))
    }

    fn frame_camera(&self, index: usize, camera: &Camera, rate_hz: f64, wires: &Wires) -> Result<Plug<Uvc>, TakeError> {
        let seed = self.plan.seed + index as u64;
        let frames: Box<dyn FrameScene> = match self.act {
            Act::Screen => Box::new(ScreenFrames::new(self.screen(camera))),
            Act::Wand => Box::new(WandFrames::new(Wand::new(camera.lens, camera.place, self.begin_ns), seed)),
            Act::Film => Box::new(FilmFrames::new(self.film()?, &camera.id)?),
            Act::Performance => {
                let view = StageView::new(self.stage, &camera.lens, &camera.place)?;
                let [begin_ns, length_ns] = self.performance();
                Box::new(StageFrames::new(view, begin_ns, length_ns))
            }
        };
        let mut faults = Faults { clock: camera.clock, jitter_mean_us: 100.0, jitter_seed: seed, ..Faults::default() };
        fault::of_camera(&self.plan.faults, &camera.id, 0.0, &mut faults);
        let cable = faults.clone();
        let is_triggered = camera.kind == Kind::Uvc { triggered: true };
        let options = UvcOptions {
            name: format!("Emulated camera {}", camera.id),
            serial: camera.serial.clone(),
            formats: vec![Format::Mjpeg],
            sizes: vec![(camera.lens.width, camera.lens.height)],
            rates_hz: vec![rate_hz],
            trigger: is_triggered.then(|| wires.frames.clone()),
            faults,
            // What is held out of a film is known at its instants, so that nothing may come between.
            readout_ns: if self.act == Act::Film && !is_triggered { 0 } else { UvcOptions::default().readout_ns },
            ..UvcOptions::default()
        };
        Ok(Plug::new(Uvc::new(options, frames), &cable))
    }
}

/// A session that is being written.
struct Recording(Arc<Mutex<Writing>>);

/// The writer until the session is finished, and the first error of it.
struct Writing {
    writer: Option<SessionWriter<File>>,
    failed: Option<ContainerError>,
}

impl Writing {
    /// Writes something; `false` where that is not possible.
    fn write(&mut self, write: impl FnOnce(&mut SessionWriter<File>) -> Result<(), ContainerError>) -> bool {
        let Some(writer) = &mut self.writer else { return false };
        let written = write(writer);
        let is_written = written.is_ok();
        self.failed = self.failed.take().or(written.err());
        is_written
    }
}

impl Recording {
    fn begin(path: &Path, rig: &str, now_ns: i64) -> Result<Self, TakeError> {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let start = SessionStart {
            host_ns: now_ns,
            epoch_ns: i64::try_from(since_1970.as_nanos()).unwrap_or(0),
            program: concat!("erfgs-emulated-rig ", env!("CARGO_PKG_VERSION")).into(),
            ..SessionStart::default()
        };
        let writer = SessionWriter::create(path, start, rig, Settings::default())?;
        Ok(Self(Arc::new(Mutex::new(Writing { writer: Some(writer), failed: None }))))
    }

    fn outlet(&self, description: &Description, world: &Arc<World>) -> Result<Arc<dyn Outlet>, TakeError> {
        let mut writing = lock(&self.0);
        let Some(writer) = &mut writing.writer else { return Err(TakeError::Missing { id: description.id.clone() }) };
        let stream = writer.add_stream(description)?;
        Ok(Arc::new(StreamOutlet { writing: Arc::clone(&self.0), stream, world: Arc::clone(world) }))
    }

    fn finish(self, now_ns: i64) -> Result<(), TakeError> {
        let mut writing = lock(&self.0);
        writing.write(|writer| writer.incident(None, now_ns, &Incident::Ended { reason: "the take was over".into() }));
        if let Some(error) = writing.failed.take() {
            return Err(error.into());
        }
        writing.writer.take().map(SessionWriter::finish).transpose()?;
        Ok(())
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A stream of it.
struct StreamOutlet {
    writing: Arc<Mutex<Writing>>,
    stream: StreamId,
    world: Arc<World>,
}

impl Outlet for StreamOutlet {
    fn send(&self, packet: Packet) -> bool {
        lock(&self.writing).write(|writer| writer.packet(self.stream, &packet))
    }

    fn report(&self, incident: Incident) {
        lock(&self.writing).write(|writer| writer.incident(Some(self.stream), self.world.now_ns(), &incident));
    }
}
