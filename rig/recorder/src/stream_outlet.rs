//! Where a source delivers: the outlet of one stream, which feeds the gate to the recording and the subscriber.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicBool, AtomicI64, Ordering::Relaxed},
};

use erfgs_session::source::{Incident, Outlet, Packet};

use erfgs_rig::host_time::host_ns;

use super::{gate::Gate, log::Log, status::Level, stream_queue::Count, subscriber::Subscriber};

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
    gate: Arc<Gate>,
    subscriber: Option<Arc<dyn Subscriber>>,
    log: Arc<Mutex<Log>>,
}

impl StreamOutlet {
    pub fn new(
        stream: usize,
        id: &str,
        gate: Arc<Gate>,
        subscriber: Option<Arc<dyn Subscriber>>,
        log: Arc<Mutex<Log>>,
    ) -> Self {
        Self {
            stream,
            id: id.to_owned(),
            arrived: Count::default(),
            last_ns: AtomicI64::new(0),
            lost: AtomicBool::new(false),
            gate,
            subscriber,
            log,
        }
    }

    /// Puts an incident on record, without changing the state of the stream.
    pub fn note(&self, incident: Incident) {
        self.gate.incident(self.stream, host_ns(), incident);
    }
}

impl Outlet for StreamOutlet {
    fn send(&self, packet: Packet) -> bool {
        self.arrived.add(packet.payload.len());
        self.last_ns.store(host_ns().max(1), Relaxed);
        if let Some(subscriber) = &self.subscriber {
            subscriber.packet(self.stream, &packet);
        }
        self.gate.packet(self.stream, packet)
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
            Incident::Adjusted { changed } => {
                (Level::Info, format!("changed: {}", serde_json::Value::Object(changed.clone())))
            }
            Incident::Ended { reason } => (Level::Info, format!("the recording ended: {reason}")),
        };
        self.log.lock().unwrap_or_else(PoisonError::into_inner).say(level, &self.id, text);
        self.note(incident);
    }
}
