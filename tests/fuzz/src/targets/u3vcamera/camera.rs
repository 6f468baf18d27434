//! A camera that is nothing but its memory, behind the traits that drivers see.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use erfgs_rig::usb::{
    Bus, Control, Described, Endpoint, Fault, Flight, Identity, Interface, Receiver, Speed, Stream, Transport,
    TransportError,
};

const READ: u16 = 0x0800;
const WRITE: u16 = 0x0802;
const NO_ADDRESS: u16 = 0x8003;
/// Zeros behind the memory, so that what lies at its end is there where bytes were taken out before it.
const BEHIND: usize = 4 << 10;

/// A bus with the camera.
pub struct Camera(Arc<Open>);

struct Open {
    identity: Identity,
    interfaces: Vec<Interface>,
    state: Mutex<State>,
}

struct State {
    memory: Vec<u8>,
    answer: Option<Vec<u8>>,
}

impl Camera {
    pub fn with(memory: &[u8]) -> Self {
        let interface = |number, protocol, endpoints: &[u8]| Interface {
            number,
            class: (0xef, 5, protocol),
            endpoints: endpoints.iter().map(|&address| Endpoint { address, bulk: true }).collect(),
        };
        Self(Arc::new(Open {
            identity: Identity {
                vendor: 0x1d6b,
                product: 0x0105,
                version: 0x0100,
                bus: 1,
                address: 1,
                port: "1-1".into(),
                speed: Speed::Super,
            },
            interfaces: vec![interface(0, 0, &[0x01, 0x81]), interface(1, 2, &[0x82])],
            state: Mutex::new(State { memory: [memory, &[0; BEHIND]].concat(), answer: None }),
        }))
    }
}

impl Bus for Camera {
    fn list(&self) -> Result<Vec<Identity>, TransportError> {
        Ok(vec![self.0.identity.clone()])
    }

    fn describe(&self, _: &Identity) -> Result<Described, TransportError> {
        Ok(Described { interfaces: self.0.interfaces.clone(), ..Described::default() })
    }

    fn open(&self, _: &Identity) -> Result<Arc<dyn Transport>, TransportError> {
        Ok(Arc::clone(&self.0) as _)
    }
}

impl State {
    /// What is answered to a command: of a read, the memory; a write changes it.
    fn obey(&mut self, command: &[u8]) -> Option<Vec<u8>> {
        let half = |at: usize| Some(u16::from_le_bytes(*command.get(at..)?.first_chunk()?));
        let (kind, id) = (half(6)?, half(10)?);
        let address = usize::try_from(u64::from_le_bytes(*command.get(12..)?.first_chunk()?)).ok()?;
        let content = match kind {
            READ => {
                let end = address.checked_add(usize::from(half(22)?));
                end.and_then(|end| self.memory.get(address..end)).map(<[u8]>::to_vec)
            }
            WRITE => {
                let data = command.get(20..)?;
                let end = address.checked_add(data.len());
                let place = end.and_then(|end| self.memory.get_mut(address..end));
                place.map(|place| place.copy_from_slice(data)).map(|()| Vec::new())
            }
            _ => None,
        };
        let status = if content.is_some() { 0 } else { NO_ADDRESS };
        let content = content.unwrap_or_default();
        let mut answer = b"U3VC".to_vec();
        for half in [status, kind | 1, content.len() as u16, id] {
            answer.extend(half.to_le_bytes());
        }
        answer.extend(content);
        Some(answer)
    }
}

impl Open {
    fn silent<T>(&self) -> Result<T, TransportError> {
        Err(TransportError::new(&self.identity, "read", Fault::Timeout))
    }
}

impl Transport for Open {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn serial(&self) -> Option<&str> {
        None
    }

    fn interfaces(&self) -> &[Interface] {
        &self.interfaces
    }

    fn claim(&self, _: u8, _: bool) -> Result<(), TransportError> {
        Ok(())
    }

    fn control_read(&self, _: Control, _: &mut [u8], _: Duration) -> Result<usize, TransportError> {
        self.silent()
    }

    fn control_write(&self, _: Control, from: &[u8], _: Duration) -> Result<usize, TransportError> {
        Ok(from.len())
    }

    fn bulk_read(&self, _: u8, into: &mut [u8], _: Duration) -> Result<usize, TransportError> {
        let answer = self.state.lock().unwrap_or_else(PoisonError::into_inner).answer.take();
        let Some(answer) = answer else { return self.silent() };
        let Some(place) = into.get_mut(..answer.len()) else {
            return Err(TransportError::new(&self.identity, "read", Fault::Overflow));
        };
        place.copy_from_slice(&answer);
        Ok(answer.len())
    }

    fn bulk_write(&self, _: u8, from: &[u8], _: Duration) -> Result<usize, TransportError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.answer = state.obey(from);
        Ok(from.len())
    }

    fn clear_halt(&self, _: u8) -> Result<(), TransportError> {
        Ok(())
    }

    fn stream(&self, _: u8, _: Flight, _: Receiver) -> Result<Box<dyn Stream>, TransportError> {
        self.silent()
    }
}
