//! What goes wrong on demand, and the account of every byte that left a device.
//!
//! A [`Plug`] sits between a device and a front end: it unplugs, stalls, cuts and corrupts transfers at given times, and
//! writes down what the host received. Faults of the sensor itself (a crystal that is off, late delivery, a trigger
//! pulse that does not arrive) are passed to its model.

use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    io::Write,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use serde::{Deserialize, Deserializer, Serialize, de};

use super::{Reply, Speed, Urb, UsbDevice, clock::ClockError};

/// Everything that can be made to go wrong with a device. The default is a device without fault.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Faults {
    /// Error of the device's crystal.
    pub clock: ClockError,
    /// Mean of the delay with which a batch of data becomes ready for the host, microseconds; exponentially distributed,
    /// so that it is never early.
    pub jitter_mean_us: f64,
    /// Seed of the delays.
    pub jitter_seed: u64,
    /// Numbers of the pulses on the trigger line that do not reach this device.
    pub dropped_triggers: BTreeSet<u64>,
    /// What happens to its transfers, and when.
    pub schedule: Vec<Fault>,
}

/// A fault at a time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fault {
    /// When, milliseconds after the device's first transfer. A fault of a transfer hits the first one after that.
    pub at_ms: u64,
    /// What.
    #[serde(flatten)]
    pub kind: FaultKind,
}

impl<'de> Deserialize<'de> for Fault {
    /// Unknown fields are refused, which serde does not do beside a flattened field.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut fields = serde_json::Map::deserialize(deserializer)?;
        let at_ms = fields.remove("at_ms").ok_or_else(|| de::Error::missing_field("at_ms"))?;
        Ok(Self {
            at_ms: u64::deserialize(at_ms).map_err(|error| de::Error::custom(format!("at_ms: {error}")))?,
            kind: FaultKind::deserialize(serde_json::Value::Object(fields)).map_err(de::Error::custom)?,
        })
    }
}

/// What can happen to transfers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum FaultKind {
    /// The endpoint answers nothing for a while, and then goes on.
    Nak {
        /// The endpoint.
        endpoint: u8,
        /// For how long, milliseconds.
        for_ms: u64,
    },
    /// The endpoint is halted until the host clears the halt.
    Stall {
        /// The endpoint.
        endpoint: u8,
    },
    /// The next transfer from the endpoint ends after this many bytes.
    ShortRead {
        /// The endpoint.
        endpoint: u8,
        /// How many bytes come.
        bytes: usize,
        /// Whether the rest is lost; if not, it comes with the next transfer.
        lost: bool,
    },
    /// A 16-bit word of the next transfer from the endpoint arrives with some bits inverted.
    CorruptWord {
        /// The endpoint.
        endpoint: u8,
        /// Which word of the transfer; the last one if it has fewer.
        word: usize,
        /// Those that are inverted are 1.
        bits: u16,
    },
    /// The next transfer from the endpoint that carries data never arrives.
    LostTransfer {
        /// The endpoint.
        endpoint: u8,
    },
    /// The device leaves the bus.
    Unplug {
        /// After how long it is back, freshly powered, milliseconds; 0: never.
        for_ms: u64,
    },
}

impl FaultKind {
    fn endpoint(&self) -> Option<u8> {
        match *self {
            Self::Nak { endpoint, .. }
            | Self::Stall { endpoint }
            | Self::ShortRead { endpoint, .. }
            | Self::CorruptWord { endpoint, .. }
            | Self::LostTransfer { endpoint } => Some(endpoint),
            Self::Unplug { .. } => None,
        }
    }
}

/// What one endpoint delivered while the device was plugged in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Delivered {
    /// Transfers with data.
    pub transfers: u64,
    /// Their bytes.
    pub bytes: u64,
    /// CRC-32 (that of zlib) of all bytes in order.
    pub crc32: u32,
}

/// What left a device towards the host: for each time that it was plugged in, what each endpoint delivered.
#[derive(Default)]
pub struct Ledger {
    /// One entry for each time that the device was plugged in.
    pub sessions: Vec<BTreeMap<u8, Delivered>>,
    /// How many faults have happened.
    pub faults: u64,
    keep: Option<Keep>,
}

/// Where delivered bytes are copied to, by session and endpoint.
type Keep = Box<dyn FnMut(usize, u8) -> Option<Box<dyn Write + Send>> + Send>;

impl std::fmt::Debug for Ledger {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Ledger").field("sessions", &self.sessions).field("faults", &self.faults).finish()
    }
}

impl Ledger {
    fn write_down(&mut self, endpoint: u8, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        let session = self.sessions.len() - 1;
        if let Some(mut out) = self.keep.as_mut().and_then(|keep| keep(session, endpoint)) {
            // A copy that cannot be written shows as a difference to the count.
            let _ = out.write_all(bytes);
        }
        let entry = self.sessions[session].entry(endpoint).or_default();
        let mut crc = crc32fast::Hasher::new_with_initial(entry.crc32);
        crc.update(bytes);
        *entry = Delivered {
            transfers: entry.transfers + 1,
            bytes: entry.bytes + bytes.len() as u64,
            crc32: crc.finalize(),
        };
    }
}

/// A handle to the ledger of a device that a front end owns.
#[derive(Clone, Debug, Default)]
pub struct SharedLedger(Arc<Mutex<Ledger>>);

impl SharedLedger {
    /// The ledger.
    pub fn lock(&self) -> MutexGuard<'_, Ledger> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Copies every byte that is delivered from now on to what `keep` gives for its session (from 0) and endpoint.
    pub fn keep(&self, keep: impl FnMut(usize, u8) -> Option<Box<dyn Write + Send>> + Send + 'static) {
        self.lock().keep = Some(Box::new(keep));
    }
}

/// A device on a cable: see the [module](self).
#[derive(Debug)]
pub struct Plug<D> {
    device: D,
    schedule: VecDeque<Fault>,
    ledger: SharedLedger,
    first_ns: Option<i64>,
    plugged: bool,
    back_ns: Option<i64>,
    nak: BTreeMap<u8, i64>,
    halted: BTreeSet<u8>,
    armed: Vec<FaultKind>,
    rest: BTreeMap<u8, VecDeque<u8>>,
}

impl<D: UsbDevice> Plug<D> {
    /// Plugs a device in.
    #[must_use]
    pub fn new(device: D, faults: &Faults) -> Self {
        let mut schedule = faults.schedule.clone();
        schedule.sort_by_key(|fault| fault.at_ms);
        let ledger = SharedLedger::default();
        ledger.lock().sessions.push(BTreeMap::new());
        Self {
            device,
            schedule: schedule.into(),
            ledger,
            first_ns: None,
            plugged: true,
            back_ns: None,
            nak: BTreeMap::new(),
            halted: BTreeSet::new(),
            armed: Vec::new(),
            rest: BTreeMap::new(),
        }
    }

    /// The account of what is delivered.
    #[must_use]
    pub fn ledger(&self) -> SharedLedger {
        self.ledger.clone()
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &D {
        &self.device
    }

    /// Pulls the cable. What is scheduled to come back does not.
    pub fn unplug(&mut self) {
        if self.plugged {
            self.plugged = false;
            self.nak.clear();
            self.halted.clear();
            self.armed.clear();
            self.rest.clear();
            self.ledger.lock().faults += 1;
        }
        self.back_ns = None;
    }

    /// Plugs the cable in again: the device powers up.
    pub fn plug(&mut self) {
        if !self.plugged {
            self.plugged = true;
            self.back_ns = None;
            self.device.reset();
            self.ledger.lock().sessions.push(BTreeMap::new());
        }
    }

    fn keep_time(&mut self, now_ns: i64) {
        let first = *self.first_ns.get_or_insert(now_ns);
        if self.back_ns.is_some_and(|back| back <= now_ns) {
            self.plug();
        }
        while let Some(fault) = self.schedule.pop_front_if(|fault| first + fault.at_ms as i64 * 1_000_000 <= now_ns) {
            if !self.plugged {
                continue;
            }
            match fault.kind {
                FaultKind::Unplug { for_ms } => {
                    self.unplug();
                    self.back_ns = (for_ms > 0).then(|| now_ns + for_ms as i64 * 1_000_000);
                    continue;
                }
                FaultKind::Nak { endpoint, for_ms } => {
                    self.nak.insert(endpoint, now_ns + for_ms as i64 * 1_000_000);
                }
                FaultKind::Stall { endpoint } => {
                    self.halted.insert(endpoint);
                }
                kind => {
                    self.armed.push(kind);
                    continue;
                }
            }
            self.ledger.lock().faults += 1;
        }
    }

    /// The reply to a transfer from the host's side of an endpoint that has data, with the next armed fault applied.
    fn tamper(&mut self, endpoint: u8, mut data: Vec<u8>) -> Reply {
        let armed = self.armed.iter().position(|kind| kind.endpoint() == Some(endpoint));
        if let Some(kind) = armed.filter(|_| !data.is_empty()).map(|index| self.armed.remove(index)) {
            self.ledger.lock().faults += 1;
            match kind {
                FaultKind::ShortRead { bytes, lost, .. } => {
                    let rest = data.split_off(bytes.min(data.len()));
                    if !lost && !rest.is_empty() {
                        self.rest.entry(endpoint).or_default().extend(rest);
                    }
                }
                FaultKind::CorruptWord { word, bits, .. } if data.len() >= 2 => {
                    let at = word.min(data.len() / 2 - 1) * 2;
                    let [low, high] = bits.to_le_bytes();
                    data[at] ^= low;
                    data[at + 1] ^= high;
                }
                FaultKind::LostTransfer { .. } => return Reply::Pending,
                _ => {}
            }
        }
        self.ledger.lock().write_down(endpoint, &data);
        Reply::Data(data)
    }
}

impl<D: UsbDevice> UsbDevice for Plug<D> {
    fn speed(&self) -> Speed {
        self.device.speed()
    }

    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        self.keep_time(now_ns);
        if !self.plugged {
            return Reply::Gone;
        }
        if let Some(setup) = urb.setup {
            // CLEAR_FEATURE(ENDPOINT_HALT), and the halt that GET_STATUS tells of.
            let endpoint = setup.index.to_le_bytes()[0];
            if (setup.request_type, setup.request, setup.value) == (0x02, 1, 0) {
                self.halted.remove(&endpoint);
            }
            if (setup.request_type, setup.request) == (0x82, 0) && self.halted.contains(&endpoint) {
                return Reply::Data(vec![1, 0]);
            }
        }
        if self.nak.get(&urb.endpoint).is_some_and(|&until| now_ns < until) {
            return Reply::Pending;
        }
        if self.halted.contains(&urb.endpoint) && urb.endpoint != 0 {
            return Reply::Stall;
        }
        if let Some(rest) = self.rest.get_mut(&urb.endpoint) {
            let taken: Vec<u8> = rest.drain(..urb.length.min(rest.len())).collect();
            if rest.is_empty() {
                self.rest.remove(&urb.endpoint);
            }
            return self.tamper(urb.endpoint, taken);
        }
        match self.device.submit(urb, now_ns) {
            Reply::Data(data) if urb.endpoint & 0x80 != 0 => self.tamper(urb.endpoint, data),
            reply => reply,
        }
    }

    fn reset(&mut self) {
        self.nak.clear();
        self.halted.clear();
        self.rest.clear();
        self.device.reset();
    }

    fn plugged(&mut self, now_ns: i64) -> bool {
        self.keep_time(now_ns);
        self.plugged
    }

    fn wake_ns(&mut self, now_ns: i64) -> i64 {
        let next =
            self.schedule.front().zip(self.first_ns).map(|(fault, first)| first + fault.at_ms as i64 * 1_000_000);
        let nak = self.nak.values().copied().filter(|&until| until > now_ns).min();
        let wake = self.device.wake_ns(now_ns);
        [next, nak, self.back_ns].into_iter().flatten().fold(wake, i64::min).max(now_ns)
    }
}

/// Delays of delivery: exponentially distributed, the same for the same seed.
#[derive(Clone, Debug)]
pub(crate) struct Jitter {
    mean_us: f64,
    key: u64,
    drawn: u64,
}

impl Jitter {
    pub(crate) fn new(faults: &Faults) -> Self {
        use erfgs_base::random;
        Self {
            mean_us: faults.jitter_mean_us,
            key: random::key(faults.jitter_seed, &[random::purpose("usb jitter")]),
            drawn: 0,
        }
    }

    pub(crate) fn next_ns(&mut self) -> i64 {
        if self.mean_us <= 0.0 {
            return 0;
        }
        self.drawn += 1;
        (erfgs_base::random::exponential(erfgs_base::random::extend(self.key, self.drawn)) * self.mean_us * 1000.0)
            as i64
    }
}
