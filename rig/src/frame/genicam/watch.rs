//! The thread that takes frames, and brings a lost camera back.

use std::{
    collections::VecDeque,
    sync::{Arc, atomic::Ordering},
    time::{Duration, Instant},
};

use bytes::Bytes;
use erfgs_session::source::{Incident, Outlet, Packet};

use super::{
    camera::{Ready, State, lock, prepare},
    link::{Identity, Intake, Link},
};
use crate::{
    frame::{FrameConfig, FrameError, retry::pause},
    genicam::GenicamConfig,
};

/// The longest wait for what comes: the patience of `stop`.
const WAIT: Duration = Duration::from_millis(100);
/// A frame that has begun when the owner stops is waited for so long.
const ENDING: Duration = Duration::from_millis(300);

/// See the module.
pub(super) struct Watch<L: Link> {
    pub link: Arc<L>,
    pub config: FrameConfig,
    pub identity: Identity,
    pub outlet: Arc<dyn Outlet>,
    pub state: Arc<State<L::Device>>,
    pub sequence: u64,
    pub discontinuity: bool,
}

/// What a stream is watched by.
struct Health {
    last: Instant,
    /// Lost blocks that are counted.
    lost: u64,
    /// What has been told of, once a stream.
    warnings: VecDeque<String>,
}

impl<L: Link> Watch<L> {
    fn stopping(&self) -> bool {
        self.state.stopping.load(Ordering::Relaxed)
    }

    /// Ends with the camera if the owner stops.
    pub fn run(mut self, mut ready: Ready<L::Device>) -> Option<Ready<L::Device>> {
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
    fn stream(&mut self, ready: &mut Ready<L::Device>) -> Result<(), String> {
        let mut health = Health { last: Instant::now(), lost: 0, warnings: VecDeque::new() };
        let mut ends = None;
        let id = self.config.id.clone();
        loop {
            // What has begun when the owner stops is a whole frame a moment later.
            if ends.is_none() && self.stopping() {
                ready.intake.end();
                ends = Some(Instant::now() + ENDING);
            }
            if ends.is_some_and(|ends| !ready.intake.is_busy() || Instant::now() >= ends) {
                break;
            }
            if let Some(reason) = ready.intake.lost() {
                self.finish(ready, &mut health);
                return Err(format!("camera {id}: {reason}; it is opened anew"));
            }
            let received = ready.intake.receive(WAIT);
            received.map_err(|error| format!("camera {id}: its stream fails: {error}; it is opened anew"))?;
            self.settle(ready, &mut health);
            let silent = health.last.elapsed() > Duration::from_millis(u64::from(self.config.timeout_ms));
            if silent && !self.config.triggered && ends.is_none() {
                let (ms, advice) = (self.config.timeout_ms, ready.intake.silence());
                self.finish(ready, &mut health);
                return Err(format!(
                    "camera {id} answers and has given no frame for {ms} ms; it is opened anew. If that does not help, {advice}"
                ));
            }
        }
        self.finish(ready, &mut health);
        Ok(())
    }

    /// Delivers what has begun, too.
    fn finish(&mut self, ready: &mut Ready<L::Device>, health: &mut Health) {
        ready.intake.finish();
        self.settle(ready, health);
    }

    /// Delivers what is there, and tells what a user should know.
    fn settle(&mut self, ready: &mut Ready<L::Device>, health: &mut Health) {
        while let Some(block) = ready.intake.next_block() {
            health.last = Instant::now();
            let frame = ready.shape.frame(block, self.sequence);
            if let Some(strange) = frame.strange {
                self.warn(
                    health,
                    format!("it sends {strange}, which is not what it was set to; they are kept as damaged"),
                );
            }
            self.deliver(frame.packet, frame.chunks);
        }
        while let Some(message) = ready.intake.warning() {
            self.warn(health, message);
        }
        let lost = ready.intake.lost_blocks();
        lock(&self.state.counters).lost += lost - health.lost;
        health.lost = lost;
        let mut seen = lock(&self.state.seen);
        seen.counts.clear();
        ready.intake.counts(&mut seen.counts);
    }

    fn warn(&self, health: &mut Health, message: String) {
        if health.warnings.contains(&message) {
            return;
        }
        // Enough to tell each kind once.
        if health.warnings.len() == 16 {
            health.warnings.pop_front();
        }
        health.warnings.push_back(message.clone());
        self.outlet.report(Incident::Warning { message: format!("camera {}: {message}", self.config.id) });
    }

    fn deliver(&mut self, mut packet: Packet, chunks: Vec<(u32, Bytes)>) {
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
    fn bring_back(&self) -> Option<Ready<L::Device>> {
        let mut config = self.config.clone();
        // It may have another address by then; one that broadcasts do not reach has to be asked for there.
        if let Ok(address) = config.camera.parse() {
            config.genicam.get_or_insert_with(GenicamConfig::default).addresses.push(address);
        }
        self.identity.again().clone_into(&mut config.camera);
        while !self.stopping() {
            let back = prepare(&*self.link, &config).and_then(|(mut ready, _)| {
                ready.begin().map_err(|source| FrameError::Genicam {
                    id: config.id.clone(),
                    camera: self.identity.label.clone(),
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
