//! Where a source delivers: the outlet of one stream, which feeds the recording and the subscriber.

use std::sync::{
    Arc, Mutex, PoisonError, RwLock,
    atomic::{AtomicBool, AtomicI64, Ordering::Relaxed},
};

use erfgs_session::source::{Incident, Outlet, Packet};

use erfgs_rig::host_time::host_ns;

use super::{
    log::Log,
    queue::{Item, Queue},
    status::Level,
    stream_queue::Count,
    subscriber::Subscriber,
};

/// See the module.
pub(super) struct StreamOutlet {
    stream: usize,
    id: String,
    /// Everything that arrived since the source started.
    pub arrived: Count,
    /// Host time of the last packet; 0 before the first.
    pub last_ns: AtomicI64,
    /// The driver says that the device is gone.
    pub lost: AtomicBool,
    recording: RwLock<Option<Arc<Queue>>>,
    subscriber: Option<Arc<dyn Subscriber>>,
    log: Arc<Mutex<Log>>,
}

impl StreamOutlet {
    pub fn new(stream: usize, id: &str, subscriber: Option<Arc<dyn Subscriber>>, log: Arc<Mutex<Log>>) -> Self {
        Self {
            stream,
            id: id.to_owned(),
            arrived: Count::default(),
            last_ns: AtomicI64::new(0),
            lost: AtomicBool::new(false),
            recording: RwLock::new(None),
            subscriber,
            log,
        }
    }

    /// From now on packets go into `queue`, or nowhere. When this returns no packet is on its way into the former.
    pub fn attach(&self, queue: Option<Arc<Queue>>) {
        *self.recording.write().unwrap_or_else(PoisonError::into_inner) = queue;
    }

    fn with_queue(&self, act: impl FnOnce(&Queue) -> bool) -> bool {
        let recording = self.recording.read().unwrap_or_else(PoisonError::into_inner);
        recording.as_ref().is_none_or(|queue| act(queue))
    }

    /// Puts an incident on record, without changing the state of the stream.
    pub fn note(&self, incident: Incident) {
        let host_ns = host_ns();
        self.with_queue(|queue| {
            queue.note(Item::Incident { stream: Some(self.stream), host_ns, incident });
            true
        });
    }
}

impl Outlet for StreamOutlet {
    fn send(&self, packet: Packet) -> bool {
        self.arrived.add(packet.payload.len());
        self.last_ns.store(host_ns().max(1), Relaxed);
        if let Some(subscriber) = &self.subscriber {
            subscriber.packet(self.stream, &packet);
        }
        self.with_queue(|queue| queue.packet(self.stream, packet))
    }

    fn report(&self, incident: Incident) {
        let (level, text) = match &incident {
            Incident::Lost { reason } => {
                self.lost.store(true, Relaxed);
                (Level::Error, format!("lost: {reason}"))
            }
            Incident::Back => {
                self.lost.store(false, Relaxed);
                (Level::Info, "back, and streaming again".to_owned())
            }
            Incident::Warning { message } => (Level::Warning, message.clone()),
            Incident::Ended { reason } => (Level::Info, format!("the recording ended: {reason}")),
        };
        self.log.lock().unwrap_or_else(PoisonError::into_inner).say(level, &self.id, text);
        self.note(incident);
    }
}
