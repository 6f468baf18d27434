//! The board of an EVK4: requests over its control endpoints, one at a time.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use super::{
    MODEL,
    treuzell::{self, FrameError, MAX_BURST, MAX_FRAME, Property},
};
use crate::{
    event::EventError,
    usb::{Fault, Interface, Transport, drain},
};

const SEND: Duration = Duration::from_secs(1);
const ANSWER: Duration = Duration::from_secs(10);
/// The sensor's number among the devices of the board.
pub(super) const SENSOR: u32 = 0;

/// Endpoints of a treuzell interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Endpoints {
    /// Number of the interface.
    pub interface: u8,
    /// Answers.
    pub control_in: u8,
    /// Requests.
    pub control_out: u8,
    /// Events.
    pub data: u8,
}

impl Endpoints {
    /// Finds the treuzell interface: vendor class, subclass 0x19, protocol 0, three bulk endpoints in the order
    /// control in, control out, data in (OpenEB, `tz_libusb_board_command.cpp`). The neuromorphic-drivers crate expects
    /// fixed addresses and checks no class, so that an interface of class 0xFF with endpoints 0x82, 0x02 and 0x81 in
    /// any order is taken too.
    pub(super) fn find(interfaces: &[Interface]) -> Option<Self> {
        let structured = interfaces.iter().find_map(|interface| match interface.endpoints.as_slice() {
            [answers, requests, data]
                if interface.class == (0xFF, 0x19, 0)
                    && interface.endpoints.iter().all(|endpoint| endpoint.bulk)
                    && answers.address & 0x80 != 0
                    && requests.address & 0x80 == 0
                    && data.address & 0x80 != 0 =>
            {
                Some(Self {
                    interface: interface.number,
                    control_in: answers.address,
                    control_out: requests.address,
                    data: data.address,
                })
            }
            _ => None,
        });
        structured.or_else(|| {
            let usual = Self { interface: 0, control_in: 0x82, control_out: 0x02, data: 0x81 };
            interfaces.iter().find_map(|interface| {
                let has = |address| interface.endpoints.iter().any(|e| e.bulk && e.address == address);
                (interface.class.0 == 0xFF && has(0x82) && has(0x02) && has(0x81))
                    .then_some(Self { interface: interface.number, ..usual })
            })
        })
    }
}

/// A board with its control endpoints.
pub(super) struct Board {
    pub transport: Arc<dyn Transport>,
    pub endpoints: Endpoints,
    /// Model and serial number, for messages.
    pub name: String,
    /// One request at a time.
    turn: Mutex<()>,
    /// Whether the board takes several registers in one frame.
    bursts: AtomicBool,
}

impl Board {
    pub(super) fn new(transport: Arc<dyn Transport>, endpoints: Endpoints) -> Self {
        let name = format!("{MODEL} at {}:{}", transport.identity().bus, transport.identity().address);
        Self { transport, endpoints, name, turn: Mutex::new(()), bursts: AtomicBool::new(true) }
    }

    /// Whether several registers go into one frame.
    pub(super) fn bursts(&self) -> bool {
        self.bursts.load(Ordering::Relaxed)
    }

    fn answer_error(&self, step: &str, error: &FrameError) -> EventError {
        EventError::Answer { camera: self.name.clone(), step: step.into(), problem: error.to_string() }
    }

    /// Sends a frame and returns the answer as it is. After a failure, throws away what the board may still send, so
    /// that the next request gets its own answer.
    fn exchange(&self, step: &str, frame: &[u8]) -> Result<Vec<u8>, EventError> {
        let mut answer = vec![0; MAX_FRAME];
        let result = self
            .transport
            .bulk_write(self.endpoints.control_out, frame, SEND)
            .and_then(|_| self.transport.bulk_read(self.endpoints.control_in, &mut answer, ANSWER));
        match result {
            Ok(count) => {
                answer.truncate(count);
                Ok(answer)
            }
            Err(source) => {
                if source.fault == Fault::Stall {
                    let _ = self.transport.clear_halt(self.endpoints.control_out);
                    let _ = self.transport.clear_halt(self.endpoints.control_in);
                }
                Err(EventError::Transport { camera: self.name.clone(), step: step.into(), source })
            }
        }
    }

    /// Sends a request and hands the payload of its answer to `read`. An answer to another request is a late one: it
    /// and whatever follows it is thrown away, and the request sent once more.
    pub(super) fn request<T>(
        &self,
        step: &str,
        property: Property,
        words: &[u32],
        read: impl Fn(&[u8]) -> Result<T, FrameError>,
    ) -> Result<T, EventError> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let frame = treuzell::request(property, words);
        let answer = self.exchange(step, &frame)?;
        match treuzell::payload(property, &answer).and_then(&read) {
            Err(FrameError::Property(_) | FrameError::Address { .. }) => {
                let (silence, limit) = (Duration::from_millis(100), Duration::from_secs(1));
                drain(self.transport.as_ref(), self.endpoints.control_in, silence, limit)
                    .map_err(|source| EventError::Transport { camera: self.name.clone(), step: step.into(), source })?;
                let answer = self.exchange(step, &frame)?;
                treuzell::payload(property, &answer).and_then(&read).map_err(|error| self.answer_error(step, &error))
            }
            result => result.map_err(|error| self.answer_error(step, &error)),
        }
    }

    /// Reads a register of the sensor.
    pub(super) fn read(&self, address: u32) -> Result<u32, EventError> {
        let step = format!("read register {address:#06x}");
        self.request(&step, Property::ReadRegisters, &[SENSOR, address, 1], |payload| {
            let values = treuzell::about(payload, SENSOR, address)?;
            treuzell::word(values, 0).ok_or(FrameError::TooShort(payload.len()))
        })
    }

    /// Writes registers of the sensor that follow each other, in one frame.
    fn write_frame(&self, address: u32, values: &[u32]) -> Result<(), EventError> {
        let step = match values {
            [value] => format!("write {value:#x} to register {address:#06x}"),
            _ => format!("write {} registers from {address:#06x}", values.len()),
        };
        let mut words = vec![SENSOR, address];
        words.extend(values);
        self.request(&step, Property::WriteRegisters, &words, |payload| {
            treuzell::about(payload, SENSOR, address).map(|_| ())
        })
    }

    /// Writes a register of the sensor.
    pub(super) fn write(&self, address: u32, value: u32) -> Result<(), EventError> {
        self.write_frame(address, &[value])
    }

    /// Changes the bits of `mask` in a register.
    pub(super) fn change(&self, address: u32, mask: u32, value: u32) -> Result<(), EventError> {
        let before = self.read(address)?;
        self.write(address, before & !mask | value & mask)
    }

    /// Writes a table of registers, as many to a frame as fit. Whether boards take that was never seen on hardware
    /// (the vendor's call takes a list of values, but its software passes one), so that the last register of the first
    /// burst is read back; a board that refuses or does not remember gets one register a frame from then on.
    pub(super) fn write_table(&self, address: u32, values: &[u32]) -> Result<(), EventError> {
        for (chunk, at) in values.chunks(MAX_BURST).zip((address..).step_by(MAX_BURST * 4)) {
            if chunk.len() > 1 && self.bursts() && !self.burst_arrived(at, chunk)? {
                tracing::warn!(camera = self.name, "the board takes one register a frame; tables take longer");
                self.bursts.store(false, Ordering::Relaxed);
            }
            if chunk.len() == 1 || !self.bursts() {
                for (&value, at) in chunk.iter().zip((at..).step_by(4)) {
                    self.write(at, value)?;
                }
            }
        }
        Ok(())
    }

    fn burst_arrived(&self, address: u32, values: &[u32]) -> Result<bool, EventError> {
        match self.write_frame(address, values) {
            Ok(()) => {}
            Err(EventError::Answer { .. }) => return Ok(false),
            Err(error) if matches!(error.fault(), Some(Fault::Stall | Fault::Timeout)) => return Ok(false),
            Err(error) => return Err(error),
        }
        let last = u32::try_from(values.len() - 1).unwrap_or(0);
        Ok(values.last() == Some(&self.read(address + 4 * last)?))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use crate::usb::{Control, Endpoint, Flight, Identity, Receiver, Speed, Stream, TransportError};

    /// A device that answers as it was told to, whatever it is asked.
    struct Scripted {
        identity: Identity,
        answers: Mutex<VecDeque<Result<Vec<u8>, Fault>>>,
        /// What was done: a request frame, or the endpoint whose halt was ended.
        done: Mutex<Vec<Vec<u8>>>,
    }

    impl Scripted {
        fn error<T>(&self, fault: Fault) -> Result<T, TransportError> {
            Err(TransportError::new(&self.identity, "scripted", fault))
        }
    }

    impl Transport for Scripted {
        fn identity(&self) -> &Identity {
            &self.identity
        }
        fn serial(&self) -> Option<&str> {
            None
        }
        fn interfaces(&self) -> &[Interface] {
            &[]
        }
        fn claim(&self, _: u8, _: bool) -> Result<(), TransportError> {
            Ok(())
        }
        fn control_read(&self, _: Control, _: &mut [u8], _: Duration) -> Result<usize, TransportError> {
            self.error(Fault::Stall)
        }
        fn control_write(&self, _: Control, _: &[u8], _: Duration) -> Result<usize, TransportError> {
            self.error(Fault::Stall)
        }
        fn bulk_read(&self, _: u8, into: &mut [u8], _: Duration) -> Result<usize, TransportError> {
            match self.answers.lock().unwrap().pop_front() {
                Some(Ok(bytes)) => {
                    into[..bytes.len()].copy_from_slice(&bytes);
                    Ok(bytes.len())
                }
                Some(Err(fault)) => self.error(fault),
                None => self.error(Fault::Timeout),
            }
        }
        fn bulk_write(&self, _: u8, from: &[u8], _: Duration) -> Result<usize, TransportError> {
            self.done.lock().unwrap().push(from.to_vec());
            Ok(from.len())
        }
        fn clear_halt(&self, endpoint: u8) -> Result<(), TransportError> {
            self.done.lock().unwrap().push(vec![endpoint]);
            Ok(())
        }
        fn stream(&self, _: u8, _: Flight, _: Receiver) -> Result<Box<dyn Stream>, TransportError> {
            self.error(Fault::Stall)
        }
    }

    fn board(answers: Vec<Result<Vec<u8>, Fault>>) -> (Board, Arc<Scripted>) {
        let identity = Identity {
            vendor: 0x04B4,
            product: 0x00F5,
            version: 0x0309,
            bus: 2,
            address: 3,
            port: "2-1".into(),
            speed: Speed::Super,
        };
        let answers = Mutex::new(answers.into());
        let device = Arc::new(Scripted { identity, answers, done: Mutex::default() });
        let endpoints = Endpoints { interface: 0, control_in: 0x82, control_out: 0x02, data: 0x81 };
        (Board::new(device.clone(), endpoints), device)
    }

    fn answer(property: Property, words: &[u32]) -> Result<Vec<u8>, Fault> {
        Ok(treuzell::request(property, words))
    }

    #[test]
    fn a_late_answer_is_thrown_away_and_the_request_repeated() {
        let late = answer(Property::ReadRegisters, &[0, 0x18, 7]);
        let ours = || answer(Property::ReadRegisters, &[0, 0x14, 9]);
        // The late one, then ours (thrown away with it), silence, then the answer to the repetition.
        let (board, device) = board(vec![late, ours(), Err(Fault::Timeout), ours()]);
        assert_eq!(board.read(0x14).unwrap(), 9);
        let request = treuzell::request(Property::ReadRegisters, &[0, 0x14, 1]);
        assert_eq!(*device.done.lock().unwrap(), [request.clone(), request]);
    }

    #[test]
    fn a_halted_control_endpoint_is_cleared_and_the_request_fails_with_its_register() {
        let (board, device) = board(vec![Err(Fault::Stall)]);
        let error = board.write(0x1010, 5).unwrap_err();
        assert_eq!(error.fault(), Some(&Fault::Stall));
        assert!(error.to_string().contains("write 0x5 to register 0x1010"), "{error}");
        assert_eq!(device.done.lock().unwrap()[1..], [vec![0x02], vec![0x82]]);
    }

    #[test]
    fn a_board_that_does_not_remember_a_burst_gets_single_writes() {
        let written = |address| answer(Property::WriteRegisters, &[0, address]);
        let forgotten = answer(Property::ReadRegisters, &[0, 0x6404, 0]);
        let (board, device) = board(vec![written(0x6400), forgotten, written(0x6400), written(0x6404)]);
        board.write_table(0x6400, &[1, 2]).unwrap();
        assert!(!board.bursts());
        let done = device.done.lock().unwrap();
        assert_eq!(done[0], treuzell::request(Property::WriteRegisters, &[0, 0x6400, 1, 2]));
        assert_eq!(done[2], treuzell::request(Property::WriteRegisters, &[0, 0x6400, 1]));
        assert_eq!(done[3], treuzell::request(Property::WriteRegisters, &[0, 0x6404, 2]));
    }

    #[test]
    fn long_tables_are_written_in_frames_that_fit() {
        let mut answers = Vec::new();
        for (address, last, value) in [(0x6400, 251, 251), (0x6400 + 4 * 252, 3, 255)] {
            answers.push(answer(Property::WriteRegisters, &[0, address]));
            answers.push(answer(Property::ReadRegisters, &[0, address + 4 * last, value]));
        }
        let (board, device) = board(answers);
        board.write_table(0x6400, &(0..256).collect::<Vec<_>>()).unwrap();
        let lengths: Vec<_> = device.done.lock().unwrap().iter().map(Vec::len).collect();
        assert_eq!(lengths, [1024, 20, 32, 20]);
    }

    #[test]
    fn the_control_interface_is_found_by_its_structure() {
        let endpoints = |addresses: [u8; 3]| addresses.map(|address| Endpoint { address, bulk: true }).to_vec();
        let interface = |class, addresses| Interface { number: 3, class, endpoints: endpoints(addresses) };
        let found = Endpoints::find(&[interface((0xFF, 0x19, 0), [0x83, 0x04, 0x85])]).unwrap();
        assert_eq!(found, Endpoints { interface: 3, control_in: 0x83, control_out: 0x04, data: 0x85 });
        assert!(Endpoints::find(&[interface((0xFF, 0, 0), [0x81, 0x02, 0x82])]).is_some());
        assert!(Endpoints::find(&[interface((0xFF, 0, 0), [0x81, 0x02, 0x83])]).is_none());
        assert!(Endpoints::find(&[interface((0x0E, 0x19, 0), [0x83, 0x04, 0x85])]).is_none());
    }
}
