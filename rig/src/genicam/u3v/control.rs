//! The control channel of a camera: its registers over two bulk endpoints, a command at a time.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use super::gencp::{Answer, Command, HEADER_BYTES, WRITE_BYTES, register};
use crate::{
    genicam::{GenicamError, Registers},
    usb::{Fault, Interface, Speed, Transport, TransportError},
};

/// A command is given so often.
const TRIES: u32 = 3;
/// How long an answer may take, whatever the camera says: some say too little, some minutes.
const PATIENCE: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(5)];
/// No camera may put off an answer for longer in all.
const LONGEST_PENDING: Duration = Duration::from_secs(20);
/// What every camera takes, before it has told more: a text of the ABRM.
const LEAST_BYTES: usize = HEADER_BYTES + register::TEXT_BYTES;
/// More is of no use.
const MOST_BYTES: usize = 16 << 10;

/// A camera's registers.
pub struct Channel {
    transport: Arc<dyn Transport>,
    commands: u8,
    answers: u8,
    packet_bytes: usize,
    state: Mutex<State>,
}

struct State {
    id: u16,
    patience: Duration,
    /// Bytes of the largest command and of the largest acknowledgement.
    largest: [usize; 2],
}

impl Channel {
    /// Takes the control interface, and asks what the camera's control can do.
    ///
    /// # Errors
    /// If another program has it, it has no such endpoints, or the camera does not answer.
    pub fn open(transport: Arc<dyn Transport>, interface: &Interface) -> Result<Self, GenicamError> {
        let endpoint = |input: bool| {
            let mut bulk = interface.endpoints.iter().filter(|endpoint| endpoint.bulk);
            bulk.find(|endpoint| (endpoint.address & 0x80 != 0) == input).map(|endpoint| endpoint.address)
        };
        let (Some(commands), Some(answers)) = (endpoint(false), endpoint(true)) else {
            return Err(GenicamError::Usb3 { reason: "its control interface has no two bulk endpoints".into() });
        };
        transport.claim(interface.number, false)?;
        let packet_bytes = match transport.identity().speed {
            Speed::Super | Speed::Unknown => 1024,
            Speed::High => 512,
            Speed::Full => 64,
        };
        // What an earlier program left unanswered has other numbers.
        let id = (crate::host_time::host_ns() >> 20) as u16 | 1;
        let state = State { id, patience: PATIENCE[0], largest: [LEAST_BYTES; 2] };
        let channel = Self { transport, commands, answers, packet_bytes, state: Mutex::new(state) };
        channel.learn()?;
        Ok(channel)
    }

    /// Asks how long answers take, and how large packets can be.
    fn learn(&self) -> Result<(), GenicamError> {
        let patience = Duration::from_millis(self.word(register::RESPONSE_MS)?.into());
        let sbrm = self.double(register::SBRM)?;
        let mut largest = [0; 2];
        for (largest, at) in largest.iter_mut().zip(register::LARGEST) {
            let bytes = self.word(offset(sbrm, at)?)? as usize;
            if bytes < LEAST_BYTES {
                return Err(GenicamError::Usb3 {
                    reason: format!("its largest packet has {bytes} bytes, too few to be"),
                });
            }
            *largest = bytes.min(MOST_BYTES);
        }
        let mut state = self.state();
        state.patience = patience.clamp(PATIENCE[0], PATIENCE[1]);
        state.largest = largest;
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Plain numbers: what another thread left is whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The device.
    #[must_use]
    pub fn transport(&self) -> &Arc<dyn Transport> {
        &self.transport
    }

    /// Why it does not answer, if it does not.
    #[must_use]
    pub fn silent(&self) -> Option<String> {
        self.word(register::VERSION).err().map(|error| error.to_string())
    }

    /// A register of four bytes.
    ///
    /// # Errors
    /// As [`Registers::read`].
    pub fn word(&self, address: u64) -> Result<u32, GenicamError> {
        Ok(u32::from_le_bytes(self.array(address)?))
    }

    /// A register of eight bytes.
    ///
    /// # Errors
    /// As [`Registers::read`].
    pub fn double(&self, address: u64) -> Result<u64, GenicamError> {
        Ok(u64::from_le_bytes(self.array(address)?))
    }

    fn array<const N: usize>(&self, address: u64) -> Result<[u8; N], GenicamError> {
        let bytes = self.memory(address, N)?;
        // It has the length that was asked for, or is an error.
        bytes.try_into().map_err(|_| GenicamError::Usb3 { reason: format!("it has no {N} bytes at {address:#x}") })
    }

    /// A text of the ABRM.
    ///
    /// # Errors
    /// As [`Registers::read`].
    pub fn text(&self, address: u64) -> Result<String, GenicamError> {
        let bytes = self.memory(address, register::TEXT_BYTES)?;
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        let text = String::from_utf8_lossy(&bytes[..end]);
        Ok(text.chars().filter(|letter| !letter.is_control()).collect::<String>().trim().to_owned())
    }

    /// Reads, in as many commands as it takes.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn memory(&self, address: u64, length: usize) -> Result<Vec<u8>, GenicamError> {
        let mut bytes = Vec::new();
        while bytes.len() < length {
            let at = offset(address, bytes.len() as u64)?;
            let count = (length - bytes.len()).min(self.state().largest[1] - HEADER_BYTES);
            let count = u16::try_from(count).unwrap_or(u16::MAX);
            bytes.extend(self.ask(Command::Read(at, count), &format!("read {count} bytes at {at:#x}"))?);
        }
        Ok(bytes)
    }

    /// Writes a register of four bytes.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn set_word(&self, address: u64, value: u32) -> Result<(), GenicamError> {
        self.write(address, &value.to_le_bytes())
    }

    /// Writes, in as many commands as it takes.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn write(&self, address: u64, data: &[u8]) -> Result<(), GenicamError> {
        // In one packet that is not full: one that ends with a full packet would have no end.
        let most = (self.state().largest[0] - WRITE_BYTES).min(self.packet_bytes - WRITE_BYTES - 4);
        for (index, piece) in data.chunks(most).enumerate() {
            let at = offset(address, (index * most) as u64)?;
            self.ask(Command::Write(at, piece), &format!("write {} bytes at {at:#x}", piece.len()))?;
        }
        Ok(())
    }

    fn ask(&self, command: Command<'_>, doing: &str) -> Result<Vec<u8>, GenicamError> {
        let mut state = self.state();
        state.id = state.id.checked_add(1).unwrap_or(1);
        let packet = command.packet(state.id);
        for _ in 0..TRIES {
            match self.transport.bulk_write(self.commands, &packet, state.patience) {
                Ok(_) => {}
                Err(error) => {
                    self.revive(error)?;
                    continue;
                }
            }
            if let Some(data) = self.hear(command, &state, doing)? {
                return Ok(data);
            }
        }
        Err(GenicamError::NoAnswer { doing: doing.to_owned() })
    }

    /// Waits for the answer. `None` if it does not come.
    fn hear(&self, command: Command<'_>, state: &State, doing: &str) -> Result<Option<Vec<u8>>, GenicamError> {
        let mut buffer = vec![0; state.largest[1].next_multiple_of(self.packet_bytes)];
        let began = Instant::now();
        let mut until = began + state.patience;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            // Less than a millisecond would be none, and none means for ever.
            let left = left.max(Duration::from_millis(1));
            let count = match self.transport.bulk_read(self.answers, &mut buffer, left) {
                Ok(count) => count,
                Err(error) => {
                    self.revive(error)?;
                    return Ok(None);
                }
            };
            match command.answer(state.id, &buffer[..count.min(buffer.len())]) {
                Answer::Done(data) => return Ok(Some(data)),
                Answer::Refused(status) => return Err(GenicamError::Refused { doing: doing.to_owned(), status }),
                Answer::Pending(wait) => until = (Instant::now() + wait + state.patience).min(began + LONGEST_PENDING),
                Answer::Other => {}
                Answer::Malformed(reason) => {
                    let reason = format!("it was to {doing}, and its answer cannot be used: {reason}");
                    return Err(GenicamError::Usb3 { reason });
                }
            }
        }
    }

    /// After a failure: ends a halt, and lets a command be given again unless that is hopeless.
    fn revive(&self, error: TransportError) -> Result<(), GenicamError> {
        match error.fault {
            Fault::Timeout => Ok(()),
            Fault::Stall => {
                self.transport.clear_halt(self.commands)?;
                Ok(self.transport.clear_halt(self.answers)?)
            }
            _ => Err(error.into()),
        }
    }
}

/// An address behind another. Both are the camera's.
pub(super) fn offset(base: u64, by: u64) -> Result<u64, GenicamError> {
    base.checked_add(by).ok_or_else(|| GenicamError::Usb3 {
        reason: format!("its registers begin at {base:#x}, where nothing follows"),
    })
}

impl Registers for Arc<Channel> {
    fn read(&self, address: u64, length: usize) -> Result<Vec<u8>, GenicamError> {
        self.memory(address, length)
    }

    fn write(&self, address: u64, data: &[u8]) -> Result<(), GenicamError> {
        Channel::write(self, address, data)
    }
}
