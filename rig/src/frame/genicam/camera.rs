use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use bytes::Bytes;
use erfgs_session::source::{Counters, Description, Incident, Outlet, Source, SourceError};
use serde_json::{Map, Value, json};

use super::{find::choose, frames::Shape};
use crate::{
    frame::{FrameConfig, FrameError, Lock, NamedLock, retry::pause},
    genicam::{
        Chunk, GenicamConfig, GenicamError, Wish, Wishes, apply, chunk_values,
        gige::{
            Channel, Device, Found, Pulse, Stream,
            gvsp::{Counts, Receiver},
        },
    },
    host_time::host_ns,
    not_applied::NotApplied,
};

/// The longest wait for a datagram: the patience of `stop`.
const WAIT: Duration = Duration::from_millis(100);
/// A frame that has begun when the owner stops is waited for so long.
const ENDING: Duration = Duration::from_millis(300);
/// So many blocks in a row of which the leader came and no payload are no accident.
const LEADERS_ALONE: u32 = 3;

/// A GigE Vision camera as a [`Source`] of frames.
pub struct GigeCamera {
    config: FrameConfig,
    description: Description,
    state: Arc<State>,
    ready: Option<Ready>,
    thread: Option<JoinHandle<Option<Ready>>>,
}

/// A camera that is open and set.
struct Ready {
    device: Arc<Mutex<Device>>,
    stream: Stream,
    shape: Shape,
}

#[derive(Default)]
struct State {
    stopping: AtomicBool,
    counters: Mutex<Counters>,
    seen: Mutex<Seen>,
}

/// What the thread of the stream has seen, for readings.
#[derive(Default)]
struct Seen {
    counts: Counts,
    dropped: u32,
    chunks: Vec<(u32, Bytes)>,
    device: Option<Arc<Mutex<Device>>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Plain values: what another thread left is whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl GigeCamera {
    /// Opens the camera that the configuration means, and sets it.
    ///
    /// # Errors
    /// If there is no such camera, another program has it, or it cannot do what is asked.
    pub fn open(config: &FrameConfig) -> Result<Self, FrameError> {
        config.check()?;
        let found = choose(config)?;
        let (ready, settings) = prepare(config, &found)?;
        let description = Description {
            id: config.id.clone(),
            model: found.identity.label(),
            serial: found.identity.serial.clone(),
            encoding: config.format.into(),
            width: config.width,
            height: config.height,
            start_order: 0,
            settings,
        };
        let state = Arc::<State>::default();
        lock(&state.seen).device = Some(Arc::clone(&ready.device));
        Ok(Self { config: config.clone(), description, state, ready: Some(ready), thread: None })
    }
}

fn wish(lock: Lock) -> Wish {
    match lock {
        Lock::Named(NamedLock::Hold) => Wish::Hold,
        Lock::Named(NamedLock::Auto) => Wish::Auto,
        Lock::At(value) => Wish::At(value),
    }
}

/// Takes control of a camera, sets it, and prepares its stream.
fn prepare(config: &FrameConfig, found: &Found) -> Result<(Ready, Map<String, Value>), FrameError> {
    let fail = |source: GenicamError| FrameError::Genicam {
        id: config.id.clone(),
        camera: format!("{} at {}", found.identity.label(), found.identity.address),
        source: source.into(),
    };
    let more = config.genicam.clone().unwrap_or_default();
    let mut device = Device::open(found, &more).map_err(fail)?;
    let wishes = Wishes {
        format: config.format,
        size: [config.width, config.height],
        rate_hz: config.rate_hz,
        exposure_us: wish(config.exposure_us),
        gain: wish(config.gain),
        white_balance: wish(config.white_balance_k),
        triggered: config.triggered,
        more: &more,
    };
    let mut missed = NotApplied::default();
    let mut settings = apply(&mut device.features, &wishes, &mut missed).map_err(fail)?;
    let shape = Shape { format: config.format, size: [config.width, config.height], tick_hz: device.tick_hz };
    let stream = device.prepare(&more, shape.bytes()).map_err(fail)?;
    tell(&mut settings, &mut missed, config, &more, found, &device, &stream);
    missed.tell(&mut settings);
    Ok((Ready { device: Arc::new(Mutex::new(device)), stream, shape }, settings))
}

/// What is to be known of camera and stream, and what of them is not as wanted.
fn tell(
    settings: &mut Map<String, Value>,
    missed: &mut NotApplied,
    config: &FrameConfig,
    more: &GenicamConfig,
    found: &Found,
    device: &Device,
    stream: &Stream,
) {
    let told = json!({
        "backend": "gige",
        "address": found.identity.address.to_string(),
        "mac": found.identity.mac_text(),
        "user_name": found.identity.name,
        "tick_hz": device.tick_hz,
        "packet_bytes": stream.packet_bytes,
        "resend": stream.plan.resend,
        "receive_buffer_bytes": stream.socket.room_bytes(),
        "asked_rate_hz": config.rate_hz,
        "triggered": config.triggered,
    });
    if let Value::Object(told) = told {
        settings.extend(told);
    }
    settings.extend(config.raw.map(|raw| ("raw".to_owned(), json!(raw))));
    if let Some(asked) = more.packet_bytes {
        missed.compare("genicam.packet_bytes", asked, stream.packet_bytes);
    }
    if more.resend && !stream.plan.resend {
        missed.because("genicam.resend = true", "the camera keeps no packets");
    }
    let (room, wanted) = (stream.socket.room_bytes(), stream.wanted_room);
    if room < wanted {
        missed.because(
            &format!("genicam.receive_buffer_mib = {}", wanted.div_ceil(1 << 20)),
            format!(
                "the system gives {:.1}; packets are lost when this program has to wait. `sudo sysctl -w \
                 net.core.rmem_max={wanted}` raises its limit",
                room as f64 / f64::from(1 << 20)
            ),
        );
    }
}

impl Source for GigeCamera {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        if self.thread.is_some() {
            return Ok(());
        }
        let mut ready = match self.ready.take() {
            // It may have been lost, or restarted, since it was opened.
            Some(ready) if lock(&ready.device).lost().is_none() => ready,
            _ => prepare(&self.config, &choose(&self.config)?)?.0,
        };
        begin(&mut ready).map_err(|source| FrameError::Genicam {
            id: self.config.id.clone(),
            camera: self.description.model.clone(),
            source: source.into(),
        })?;
        self.state.stopping.store(false, Ordering::Relaxed);
        *lock(&self.state.counters) = Counters::default();
        *lock(&self.state.seen) = Seen { device: Some(Arc::clone(&ready.device)), ..Seen::default() };
        let watch = Watch {
            config: self.config.clone(),
            identity: self.identity(),
            outlet,
            state: Arc::clone(&self.state),
            sequence: 0,
            discontinuity: false,
        };
        let thread = thread::Builder::new().name(self.config.id.clone()).spawn(move || watch.run(ready))?;
        self.thread = Some(thread);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let Some(thread) = self.thread.take() else { return Ok(()) };
        self.state.stopping.store(true, Ordering::Relaxed);
        self.ready = thread.join().map_err(|_| format!("the thread of camera {} has panicked", self.config.id))?;
        let Some(ready) = &self.ready else { return Ok(()) };
        let ended = lock(&ready.device).end();
        ended.map_err(|error| format!("camera {} does not end its stream: {error}", self.config.id).into())
    }

    fn counters(&self) -> Counters {
        *lock(&self.state.counters)
    }

    fn readings(&mut self) -> Vec<(String, f64)> {
        let seen = lock(&self.state.seen);
        let Counts { missing, asked, late, doubled, strange, .. } = seen.counts;
        let mut readings: Vec<(String, f64)> = [
            ("missing_packets", missing),
            ("asked_packets", asked),
            ("late_packets", late),
            ("doubled_packets", doubled),
            ("strange_packets", strange),
            ("kernel_drops", seen.dropped.into()),
        ]
        .map(|(name, count)| (name.to_owned(), count as f64))
        .into();
        let (device, chunks) = (seen.device.clone(), seen.chunks.clone());
        drop(seen);
        let Some(device) = device else { return readings };
        let mut device = lock(&device);
        if device.lost().is_none() && device.features.has("DeviceTemperature") {
            let celsius = device.features.number("DeviceTemperature").ok();
            readings.extend(celsius.map(|celsius| ("temperature_c".to_owned(), celsius)));
        }
        if !chunks.is_empty() {
            let chunks: Vec<Chunk<'_>> = chunks.iter().map(|(id, data)| Chunk { id: *id, data }).collect();
            device.features.attach(&chunks);
            let names = self.config.genicam.as_ref().map_or(&[][..], |more| &more.chunks);
            readings.extend(
                chunk_values(&device.features, names).into_iter().map(|(name, value)| (format!("chunk {name}"), value)),
            );
        }
        readings
    }
}

impl GigeCamera {
    /// By what the camera is found again, wherever it is then.
    fn identity(&self) -> String {
        let serial = Some(self.description.serial.clone()).filter(|serial| !serial.is_empty());
        let mac = self.description.settings.get("mac").and_then(Value::as_str).map(str::to_owned);
        serial.or(mac).unwrap_or_else(|| self.config.camera.clone())
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        if let Err(error) = self.stop() {
            tracing::warn!("while closing camera {}: {error}", self.config.id);
        }
    }
}

fn begin(ready: &mut Ready) -> Result<(), GenicamError> {
    lock(&ready.device).begin(&mut ready.stream)
}

/// The thread that takes frames and brings a lost camera back.
struct Watch {
    config: FrameConfig,
    identity: String,
    outlet: Arc<dyn Outlet>,
    state: Arc<State>,
    sequence: u64,
    discontinuity: bool,
}

/// What a stream is watched by.
struct Health {
    channel: Arc<Channel>,
    pulse: Pulse,
    last: Instant,
    /// What blocks were lost before this stream, and so counted.
    lost: u64,
    leaders_alone: u32,
    dropped: u32,
    /// What has been told of, once a stream.
    told: VecDeque<String>,
}

impl Watch {
    fn stopping(&self) -> bool {
        self.state.stopping.load(Ordering::Relaxed)
    }

    /// Ends with the camera if the owner stops.
    fn run(mut self, mut ready: Ready) -> Option<Ready> {
        loop {
            let Err(reason) = self.stream(&mut ready) else { return Some(ready) };
            // The camera is given up before it is looked for: it lets nobody else control it.
            lock(&self.state.seen).device = None;
            drop(ready);
            self.outlet.report(Incident::Lost { reason });
            ready = self.bring_back()?;
            self.discontinuity = true;
            lock(&self.state.counters).reconnections += 1;
            lock(&self.state.seen).device = Some(Arc::clone(&ready.device));
            self.outlet.report(Incident::Back);
        }
    }

    /// Takes frames until the owner stops (`Ok`), or the camera is lost.
    fn stream(&mut self, ready: &mut Ready) -> Result<(), String> {
        let mut receiver = Receiver::new(ready.stream.plan);
        let (channel, pulse) = {
            let device = lock(&ready.device);
            (Arc::clone(&device.channel), device.pulse())
        };
        let mut health = Health {
            channel,
            pulse,
            last: Instant::now(),
            lost: 0,
            leaders_alone: 0,
            dropped: ready.stream.socket.dropped(),
            told: VecDeque::new(),
        };
        let mut ends = None;
        loop {
            // What has begun when the owner stops is a whole frame a moment later.
            if ends.is_none() && self.stopping() {
                receiver.end();
                ends = Some(Instant::now() + ENDING);
            }
            if ends.is_some_and(|ends| !receiver.is_busy() || Instant::now() >= ends) {
                break;
            }
            if let Some(reason) = health.pulse.lost() {
                return Err(format!("camera {}: {reason}; it is opened anew", self.config.id));
            }
            let wait = receiver.wake_ns().map_or(WAIT, |wake_ns| {
                Duration::from_nanos(u64::try_from(wake_ns - host_ns()).unwrap_or(0)).min(WAIT)
            });
            let received = ready.stream.socket.receive(wait, |bytes, now_ns| {
                receiver.take(bytes, now_ns);
            });
            received
                .map_err(|error| format!("camera {}: its stream fails: {error}; it is opened anew", self.config.id))?;
            receiver.advance(host_ns());
            self.settle(&mut receiver, ready, &mut health);
            let silent = health.last.elapsed() > Duration::from_millis(u64::from(self.config.timeout_ms));
            if silent && !self.config.triggered && ends.is_none() {
                return Err(self.silence());
            }
        }
        receiver.finish();
        self.settle(&mut receiver, ready, &mut health);
        Ok(())
    }

    fn silence(&self) -> String {
        let (id, ms) = (&self.config.id, self.config.timeout_ms);
        format!(
            "camera {id} answers and has given no frame for {ms} ms; it is opened anew. If that does not help, a firewall of \
             this machine may drop its stream (UDP from the camera), or its packets are too large for a switch \
             (genicam.packet_bytes = 1500)"
        )
    }

    /// Delivers what is there, asks for what is missing, and tells what a user should know.
    fn settle(&mut self, receiver: &mut Receiver, ready: &Ready, health: &mut Health) {
        while let Some(request) = receiver.next_request() {
            health.channel.ask_again(&request);
        }
        while let Some(block) = receiver.next_block() {
            health.last = Instant::now();
            let packets = ready.stream.plan.block_bytes.div_ceil(ready.stream.plan.datagram_bytes.max(1)) as u32;
            let alone = block.leader.is_some() && block.missing >= packets.max(2);
            health.leaders_alone = if alone { health.leaders_alone + 1 } else { 0 };
            if health.leaders_alone == LEADERS_ALONE {
                let bytes = ready.stream.packet_bytes;
                self.warn(
                    health,
                    format!(
                        "frames begin and their pixels do not come: packets of {bytes} bytes are dropped on the way. Set \
                         genicam.packet_bytes = 1500, or let every switch and interface pass jumbo frames"
                    ),
                );
            }
            let frame = ready.shape.frame(block, self.sequence);
            if let Some(strange) = frame.strange {
                self.warn(
                    health,
                    format!("it sends {strange}, which is not what it was set to; they are kept as damaged"),
                );
            }
            self.deliver(frame.packet, frame.chunks);
        }
        let (counts, dropped) = (receiver.counts(), ready.stream.socket.dropped());
        if dropped != health.dropped {
            let room = ready.stream.socket.room_bytes() >> 10;
            health.dropped = dropped;
            self.warn(
                health,
                format!(
                    "the kernel had no room for packets of its stream ({room} KiB): raise it by `sudo sysctl -w \
                     net.core.rmem_max=67108864` and genicam.receive_buffer_mib = 64, and see what else keeps this machine busy"
                ),
            );
        }
        lock(&self.state.counters).lost += counts.lost - health.lost;
        health.lost = counts.lost;
        let mut seen = lock(&self.state.seen);
        (seen.counts, seen.dropped) = (counts, dropped);
    }

    fn warn(&self, health: &mut Health, message: String) {
        if health.told.contains(&message) {
            return;
        }
        // Enough to tell each kind once.
        if health.told.len() == 16 {
            health.told.pop_front();
        }
        health.told.push_back(message.clone());
        self.outlet.report(Incident::Warning { message: format!("camera {}: {message}", self.config.id) });
    }

    fn deliver(&mut self, mut packet: erfgs_session::source::Packet, chunks: Vec<(u32, Bytes)>) {
        packet.discontinuity |= std::mem::take(&mut self.discontinuity);
        if !chunks.is_empty() {
            // Copies, so that a reading does not keep a whole frame.
            let chunks = chunks.into_iter().map(|(id, data)| (id, Bytes::copy_from_slice(&data))).collect();
            lock(&self.state.seen).chunks = chunks;
        }
        self.sequence += 1;
        let (bytes, damaged) = (packet.payload.len() as u64, packet.damaged);
        let taken = self.outlet.send(packet);
        lock(&self.state.counters).deliver(bytes, damaged, taken);
    }

    /// Looks for the same camera until it is there again, or the owner stops.
    fn bring_back(&self) -> Option<Ready> {
        let mut config = self.config.clone();
        // It may have another address by then; one that broadcasts do not reach has to be asked for there.
        let address: Option<std::net::Ipv4Addr> = config.camera.parse().ok();
        config.genicam.get_or_insert_with(GenicamConfig::default).addresses.extend(address);
        config.camera.clone_from(&self.identity);
        while !self.stopping() {
            let back = choose(&config).and_then(|found| {
                let (mut ready, _) = prepare(&config, &found)?;
                begin(&mut ready).map_err(|source| FrameError::Genicam {
                    id: config.id.clone(),
                    camera: found.identity.label(),
                    source: source.into(),
                })?;
                Ok(ready)
            });
            match back {
                Ok(back) => return Some(back),
                Err(error) => tracing::debug!("not back yet: {error}"),
            }
            pause(|| self.stopping());
        }
        None
    }
}
