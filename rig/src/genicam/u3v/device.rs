//! A camera that is open: described, its stream prepared and received.

use std::{
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use super::{
    Channel, Found, Sizes,
    control::offset,
    find,
    gencp::register,
    sizes::Needs,
    stream::{Counts, Plan, Receiver},
};
use crate::{
    genicam::{Block, Features, GenicamConfig, GenicamError, description, settings},
    usb::{Arrival, Budget, Bus, Control, Flight, Stream, memory_advice},
};

/// A manifest has no more entries.
const MOST_ENTRIES: u64 = 64;
const ENTRY_BYTES: u64 = 64;
/// A camera from which nothing comes is asked for a sign of life so often.
const LOOK_EVERY: Duration = Duration::from_secs(1);
const PATIENCE: Duration = Duration::from_secs(1);

/// A camera that we control.
pub struct Device {
    /// Its registers.
    pub channel: Arc<Channel>,
    /// What it can do.
    pub features: Features,
    endpoint: u8,
    sirm: u64,
    budget: Budget,
}

/// The receiving end of a stream.
pub struct Intake {
    /// What it looks like.
    pub sizes: Sizes,
    /// The transfers that are wanted in flight.
    pub wanted: Flight,
    /// Those of them for which there should be memory.
    pub flight: Flight,
    channel: Arc<Channel>,
    shared: Arc<Shared>,
    stream: Option<Box<dyn Stream>>,
    granted: usize,
    looked: Instant,
}

/// What the thread of the transfers gives to that of the camera.
struct Shared {
    state: Mutex<State>,
    came: Condvar,
}

struct State {
    receiver: Receiver,
    /// Why the stream broke.
    broke: Option<String>,
    /// Whether something came since it was looked at last.
    lively: bool,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // What another thread left is whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Device {
    /// Opens a camera and reads its description.
    ///
    /// # Errors
    /// If another program has it, it does not answer, or its description cannot be used.
    pub fn open(bus: &dyn Bus, found: &Found) -> Result<Self, GenicamError> {
        let opened = find::open(bus, &found.identity)?;
        let channel = opened.channel;
        let endpoint = opened.stream.endpoints.iter().find(|endpoint| endpoint.bulk && endpoint.address & 0x80 != 0);
        let Some(endpoint) = endpoint.map(|endpoint| endpoint.address) else {
            return Err(GenicamError::Usb3 { reason: "its stream interface has no bulk endpoint".into() });
        };
        channel.transport().claim(opened.stream.number, false)?;
        let sbrm = channel.double(register::SBRM)?;
        if channel.double(offset(sbrm, register::SBRM_CAPABILITY)?)? & 1 == 0 {
            return Err(GenicamError::Usb3 { reason: "it has no registers of a stream".into() });
        }
        let sirm = channel.double(offset(sbrm, register::SIRM)?)?;
        let features = Features::new(&read_description(&channel)?, Arc::clone(&channel))?;
        Ok(Self { channel, features, endpoint, sirm, budget: Budget::on(bus) })
    }

    /// What the camera needs for frames of so many bytes, and room for it.
    ///
    /// # Errors
    /// If the camera does not answer, or needs what cannot be.
    pub fn prepare(&self, config: &GenicamConfig, frame_bytes: usize) -> Result<Intake, GenicamError> {
        let at = |register| offset(self.sirm, register);
        let needs = Needs {
            info: self.channel.word(at(register::INFO)?)?,
            payload: self.channel.double(at(register::PAYLOAD)?)?,
            ends: [self.channel.word(at(register::ENDS[0])?)?, self.channel.word(at(register::ENDS[1])?)?],
        };
        let sizes = Sizes::new(needs, frame_bytes, config.transfer_bytes)?;
        let state = State { receiver: Receiver::new(Plan::from(&sizes)), broke: None, lively: false };
        let wanted = sizes.flight(config);
        Ok(Intake {
            sizes,
            wanted,
            flight: self.budget.fit(wanted),
            channel: Arc::clone(&self.channel),
            shared: Arc::new(Shared { state: Mutex::new(state), came: Condvar::new() }),
            stream: None,
            granted: 0,
            looked: Instant::now(),
        })
    }

    /// Begins to stream.
    ///
    /// # Errors
    /// If the camera does not.
    pub fn begin(&mut self, intake: &mut Intake) -> Result<(), GenicamError> {
        self.let_stream(false)?;
        for (register, size) in register::SIZES.into_iter().zip(intake.sizes.told) {
            self.channel.set_word(offset(self.sirm, register)?, size)?;
        }
        self.reset_endpoint()?;
        intake.receive_from(self.endpoint)?;
        self.let_stream(true)?;
        settings::begin(&mut self.features)
    }

    /// Ends the stream.
    ///
    /// # Errors
    /// If the camera does not take it.
    pub fn end(&mut self, intake: &mut Intake) -> Result<(), GenicamError> {
        let stopped = settings::end(&mut self.features);
        intake.stream = None;
        stopped.and(self.let_stream(false))
    }

    fn let_stream(&self, on: bool) -> Result<(), GenicamError> {
        self.channel.set_word(offset(self.sirm, register::CONTROL)?, on.into())
    }

    /// Halts the endpoint and ends the halt, so that the camera drops what it held for a program before.
    fn reset_endpoint(&self) -> Result<(), GenicamError> {
        let transport = self.channel.transport();
        // SET_FEATURE(ENDPOINT_HALT). A camera that does not know it has the halt ended all the same.
        let halt = Control { request_type: 0x02, request: 3, value: 0, index: self.endpoint.into() };
        if let Err(error) = transport.control_write(halt, &[], PATIENCE) {
            tracing::debug!("{error}");
        }
        Ok(transport.clear_halt(self.endpoint)?)
    }
}

fn read_description(channel: &Channel) -> Result<String, GenicamError> {
    let manifest = channel.double(register::MANIFEST)?;
    let count = channel.double(manifest)?;
    if !(1..=MOST_ENTRIES).contains(&count) {
        return Err(description::unusable(format!("its manifest tells of {count} descriptions")));
    }
    let read = |entry: u64| {
        let at = offset(manifest, 8 + entry * ENTRY_BYTES)?;
        let address = channel.double(offset(at, 8)?)?;
        let bytes = channel.double(offset(at, 16)?)?;
        match usize::try_from(bytes) {
            Ok(length @ 1..=description::MOST_BYTES) => description::text(&channel.memory(address, length)?),
            _ => Err(description::unusable(format!(
                "its manifest says {bytes} bytes; it can be 1 to {}",
                description::MOST_BYTES
            ))),
        }
    };
    // Others are there for a first that is damaged; what is said is of the first.
    read(0).or_else(|error| (1..count).find_map(|entry| read(entry).ok()).ok_or(error))
}

impl Intake {
    /// Puts transfers in flight.
    fn receive_from(&mut self, endpoint: u8) -> Result<(), GenicamError> {
        // One that is there takes memory that this one needs.
        self.stream = None;
        {
            let mut state = self.shared.state();
            *state = State { receiver: Receiver::new(Plan::from(&self.sizes)), broke: None, lively: true };
        }
        self.looked = Instant::now();
        let shared = Arc::clone(&self.shared);
        let stream = self.channel.transport().stream(
            endpoint,
            self.flight,
            Box::new(move |arrival| {
                let mut state = shared.state();
                match arrival {
                    Arrival::Data { host_ns, bytes } => {
                        state.receiver.take(bytes, host_ns);
                        state.lively = true;
                    }
                    Arrival::Ended(fault) => state.broke = Some(fault.to_string()),
                }
                if state.receiver.has_block() || state.broke.is_some() {
                    shared.came.notify_one();
                }
            }),
        )?;
        self.granted = stream.granted();
        self.stream = Some(stream);
        Ok(())
    }

    /// What a user should know of the transfers, if there is something.
    #[must_use]
    pub fn shortage(&self) -> Option<String> {
        (self.granted < self.wanted.transfers).then(|| {
            format!("{} transfers in flight of the {} wanted: {}", self.granted, self.wanted.transfers, memory_advice())
        })
    }

    /// Waits until a block is there, the stream broke, or time is up.
    pub fn wait(&mut self, wait: Duration) {
        let waits = |state: &mut State| !state.receiver.has_block() && state.broke.is_none();
        // What a poisoned lock holds is looked at by the next.
        let _ = self.shared.came.wait_timeout_while(self.shared.state(), wait, waits);
    }

    /// Why the camera is lost, if it is. One from which nothing comes is asked.
    pub fn lost(&mut self) -> Option<String> {
        {
            let mut state = self.shared.state();
            if let Some(broke) = &state.broke {
                return Some(format!("its stream broke: {broke}"));
            }
            if std::mem::take(&mut state.lively) {
                self.looked = Instant::now();
            }
        }
        if self.looked.elapsed() < LOOK_EVERY {
            return None;
        }
        self.looked = Instant::now();
        self.channel.silent()
    }

    /// The next block, whole or not.
    pub fn next_block(&mut self) -> Option<Block> {
        self.shared.state().receiver.next_block()
    }

    /// What happened so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.shared.state().receiver.counts()
    }

    /// Lets no block begin any more.
    pub fn end(&mut self) {
        self.shared.state().receiver.end();
    }

    /// Whether a block has begun and is not handed over.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.shared.state().receiver.is_busy()
    }

    /// Hands over what is there.
    pub fn finish(&mut self) {
        self.shared.state().receiver.finish();
    }
}
