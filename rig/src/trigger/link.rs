use std::{
    io::{self, ErrorKind, Read, Write},
    path::Path,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use bytes::Bytes;
use erfgs_session::source::{Outlet, Packet};
use serialport::SerialPort;

use super::TriggerError;
use crate::host_time::host_ns;
use erfgs_session::trigger::protocol::{BAUD, Command, Identity, Message, NAME, Reader, Reply, VERSION};

/// How long a read waits for bytes.
const READ_WAIT: Duration = Duration::from_millis(20);
/// How long a board that is known to be there may take to answer. It takes milliseconds; the rest is for hosts that have
/// much else to do.
pub(super) const ANSWER_WAIT: Duration = Duration::from_secs(5);
/// After this long without an answer a command may have been lost on the way. A command that is sent while the board is
/// still busy with the one before is lost or damaged itself.
pub(super) const ASK_AGAIN: Duration = Duration::from_secs(1);
/// How long a port may be locked.
const LOCKED_WAIT: Duration = Duration::from_secs(1);
/// How often the board is asked for a token before it is given up.
const SETTLE_ATTEMPTS: usize = 5;
/// When a board that does not answer is asked again. An Arduino restarts when its port is opened, and its boot loader
/// listens for up to two seconds before our firmware starts.
const ATTEMPTS: [Duration; 4] =
    [Duration::ZERO, Duration::from_millis(2200), Duration::from_millis(3200), Duration::from_millis(4200)];

/// A trigger board at the other end of a serial line.
pub struct Link {
    name: String,
    port: Box<dyn SerialPort>,
    reader: Reader,
    /// Where whole lines go as packets, once the source has started.
    outlet: Option<Arc<dyn Outlet>>,
    sequence: u64,
    bytes: u64,
    refused: u64,
    /// The next packet follows after something was lost.
    discontinuity: bool,
    /// Whether the last read took all that had come.
    drained: bool,
}

impl Link {
    /// Opens a port and waits until the board there says who it is: at once if it runs already, after up to five
    /// seconds if opening the port restarts it.
    ///
    /// # Errors
    /// If the port cannot be opened, or no trigger board of this version answers.
    pub fn open(port: &str) -> Result<(Self, Identity), TriggerError> {
        let began = Instant::now();
        loop {
            let looked = began.elapsed();
            match serialport::new(port, BAUD).timeout(READ_WAIT).open() {
                Ok(opened) => return Self::new(port, opened),
                // A port that was closed a moment ago is still locked if another thread is about to start a program, which
                // has all open files until it runs.
                Err(source)
                    if source.kind() == serialport::ErrorKind::NoDevice
                        && Path::new(port).exists()
                        && looked < LOCKED_WAIT =>
                {
                    thread::sleep(READ_WAIT);
                }
                Err(source) => return Err(TriggerError::Open { port: port.to_owned(), source }),
            }
        }
    }

    /// As [`Link::open`], with a port that is open.
    ///
    /// # Errors
    /// If no trigger board of this version answers.
    pub fn new(name: &str, mut port: Box<dyn SerialPort>) -> Result<(Self, Identity), TriggerError> {
        // USB serial converters may hold data back without DTR; pseudo-terminals have no such line (ENOTTY).
        if let Err(error) = port.write_data_terminal_ready(true) {
            tracing::debug!("{name} has no DTR line: {error}");
        }
        port.set_timeout(READ_WAIT).map_err(|source| TriggerError::Open { port: name.to_owned(), source })?;
        let mut link = Self {
            name: name.to_owned(),
            port,
            reader: Reader::new(),
            outlet: None,
            sequence: 0,
            bytes: 0,
            refused: 0,
            discontinuity: false,
            drained: false,
        };
        let identity = link.greet()?;
        Ok((link, identity))
    }

    /// Asks who is there until someone answers. The message of a board that has just booted is no answer: our question may
    /// be under way still, and whatever followed it would meet a busy board.
    fn greet(&mut self) -> Result<Identity, TriggerError> {
        let began = Instant::now();
        let patience = *ATTEMPTS.last().expect("there are attempts") + ASK_AGAIN;
        let mut attempts = ATTEMPTS.into_iter().peekable();
        loop {
            let looked = began.elapsed();
            for message in self.pump()? {
                let Message::Done(Reply::Identify(identity)) = message else { continue };
                if identity.name != NAME {
                    continue;
                }
                if identity.version != VERSION {
                    return Err(TriggerError::Version { port: self.name.clone(), version: identity.version });
                }
                self.settle()?;
                return Ok(identity);
            }
            if self.drained && looked >= patience {
                return Err(TriggerError::Silent { port: self.name.clone(), command: Command::Identify.name().into() });
            }
            if self.drained && attempts.next_if(|&at| looked >= at).is_some() {
                // Ends half a line that the board may have.
                self.write(b"\n")?;
                self.send(Command::Identify)?;
            }
        }
    }

    /// Makes sure that no command is under way any more: there may be one more `identify`. The board answers in order, so
    /// that the answer to a token of our own is the last of all.
    fn settle(&mut self) -> Result<(), TriggerError> {
        for _ in 0..SETTLE_ATTEMPTS {
            let token = host_ns().unsigned_abs();
            self.write(b"\n")?;
            match self.ask(Command::Clock(token), |_| {}) {
                Ok(Reply::Clock { token: answered, .. }) if answered == token => return Ok(()),
                // A line that came while the board was busy with another is lost or damaged: once more.
                Ok(_) | Err(TriggerError::Silent { .. } | TriggerError::Refused { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Err(TriggerError::Silent { port: self.name.clone(), command: "clock".into() })
    }

    /// The port's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// From now on every line goes into this outlet too. `first` is the sequence number of the next packet.
    pub(super) fn forward(&mut self, outlet: Arc<dyn Outlet>, first: u64, discontinuity: bool) {
        self.outlet = Some(outlet);
        self.sequence = first;
        self.discontinuity = discontinuity;
    }

    /// The sequence number of the next packet.
    pub(super) fn next_sequence(&self) -> u64 {
        self.sequence
    }

    /// Bytes and refused packets since this was last asked.
    pub(super) fn take_totals(&mut self) -> (u64, u64) {
        (std::mem::take(&mut self.bytes), std::mem::take(&mut self.refused))
    }

    /// Whether the last [`Link::pump`] took all that had come. A host that was busy elsewhere for long must not take the
    /// board for silent before it has read what waits.
    pub(super) fn drained(&self) -> bool {
        self.drained
    }

    /// Lines that came damaged.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.reader.damaged()
    }

    fn failed(&self, source: io::Error) -> TriggerError {
        TriggerError::Port { port: self.name.clone(), source }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), TriggerError> {
        self.port.write_all(bytes).map_err(|source| self.failed(source))
    }

    /// Sends a command and does not wait for its answer.
    ///
    /// # Errors
    /// If the port fails.
    pub fn send(&mut self, command: Command) -> Result<(), TriggerError> {
        self.write(&command.encode())
    }

    /// Reads what has come, waiting 20 ms for it; gives the messages in it.
    ///
    /// # Errors
    /// If the port fails.
    pub fn pump(&mut self) -> Result<Vec<Message>, TriggerError> {
        // Less than a terminal holds, so that a full buffer says that more may wait.
        let mut buffer = [0; 1024];
        self.drained = true;
        let count = match self.port.read(&mut buffer) {
            Ok(0) => return Err(self.failed(ErrorKind::UnexpectedEof.into())),
            Ok(count) => count,
            Err(error)
                if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock) =>
            {
                return Ok(Vec::new());
            }
            Err(error) => return Err(self.failed(error)),
        };
        let now = host_ns();
        self.drained = count < buffer.len();
        let received = &buffer[..count];
        let mut messages = Vec::new();
        let mut reader = std::mem::take(&mut self.reader);
        // Garbage goes on its way as well.
        reader.parts(received, |line, message| {
            self.deliver(line, now);
            messages.extend(message);
        });
        self.reader = reader;
        Ok(messages)
    }

    /// Sends the line as a packet.
    fn deliver(&mut self, line: &[u8], host_ns: i64) {
        let payload = Bytes::copy_from_slice(line);
        let Some(outlet) = &self.outlet else { return };
        let packet = Packet {
            sequence: self.sequence,
            host_ns,
            discontinuity: std::mem::take(&mut self.discontinuity),
            damaged: false,
            stamp: None,
            payload,
        };
        self.sequence += 1;
        self.bytes += packet.payload.len() as u64;
        self.refused += u64::from(!outlet.send(packet));
    }

    /// Sends a command and waits for the answer; what else comes meanwhile goes to `noted`.
    ///
    /// # Errors
    /// If the port fails, the board does not answer within five seconds, or refuses.
    pub fn ask(&mut self, command: Command, mut noted: impl FnMut(Message)) -> Result<Reply, TriggerError> {
        self.ask_within(command, ANSWER_WAIT, &mut noted)
    }

    /// As [`Link::ask`], with another patience.
    pub(super) fn ask_within(
        &mut self,
        command: Command,
        wait: Duration,
        noted: &mut dyn FnMut(Message),
    ) -> Result<Reply, TriggerError> {
        self.send(command)?;
        let began = Instant::now();
        let mut answer = None;
        loop {
            let last_look = began.elapsed() >= wait;
            for message in self.pump()? {
                match message {
                    Message::Done(reply) if answer.is_none() && reply.command() == command.name() => {
                        answer = Some(Ok(reply));
                    }
                    Message::Refused { command: refused, error } if refused == command.name() || refused == "?" => {
                        let (port, command) = (self.name.clone(), command.to_string());
                        answer = Some(Err(TriggerError::Refused { port, command, error }));
                    }
                    other => noted(other),
                }
            }
            if let Some(answer) = answer {
                return answer;
            }
            if last_look && self.drained {
                return Err(TriggerError::Silent { port: self.name.clone(), command: command.to_string() });
            }
        }
    }
}
