use std::path::Path;

use serialport::SerialPortType;

use super::{Link, TriggerError};
use erfgs_session::trigger::protocol::Identity;

/// USB vendors whose serial converters sit on Arduino boards: Arduino (two), WCH (CH340), FTDI, Silicon Labs (CP210x).
const VENDORS: [u16; 5] = [0x2341, 0x2a03, 0x1a86, 0x0403, 0x10c4];

/// A trigger board among the serial ports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundBoard {
    /// Its port.
    pub port: String,
    /// What it says of itself.
    pub identity: Identity,
}

/// Serial ports at which a trigger board may be: those on USB converters as Arduino boards have them. Opens none.
#[must_use]
pub fn ports() -> Vec<String> {
    // A container may have no such folder, and then no ports; `serialport` panics there.
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").exists() {
        return Vec::new();
    }
    let ports = serialport::available_ports().unwrap_or_else(|error| {
        tracing::warn!("cannot list serial ports: {error}");
        Vec::new()
    });
    let on_board = |kind: &SerialPortType| matches!(kind, SerialPortType::UsbPort(usb) if VENDORS.contains(&usb.vid));
    ports.into_iter().filter(|port| on_board(&port.port_type)).map(|port| port.port_name).collect()
}

/// Asks at every one of `ports` for a trigger board, and gives what is at each. Opening a port restarts an Arduino.
#[must_use]
pub fn find(ports: &[String]) -> Vec<(String, Result<FoundBoard, TriggerError>)> {
    // A port with something else takes seconds to give up on: ask all at once.
    std::thread::scope(|scope| {
        let asked: Vec<_> = ports
            .iter()
            .map(|port| (port, scope.spawn(move || Link::open(port).map(|(_, identity)| identity))))
            .collect();
        asked
            .into_iter()
            .map(|(port, thread)| {
                let identity = thread
                    .join()
                    .unwrap_or_else(|_| Err(TriggerError::Silent { port: port.clone(), command: "identify".into() }));
                (port.clone(), identity.map(|identity| FoundBoard { port: port.clone(), identity }))
            })
            .collect()
    })
}

/// The only board among `ports`.
pub(super) fn only(ports: &[String]) -> Result<String, TriggerError> {
    let mut boards = Vec::new();
    let mut tried = Vec::new();
    for (port, found) in find(ports) {
        match found {
            Ok(board) => boards.push(board.port),
            Err(error) => tried.push(format!("{port} ({error})")),
        }
    }
    match boards.as_slice() {
        [port] => Ok(port.clone()),
        [] if tried.is_empty() => Err(TriggerError::NotFound { tried: "none".into() }),
        [] => Err(TriggerError::NotFound { tried: tried.join(", ") }),
        _ => Err(TriggerError::Ambiguous { ports: boards.join(", ") }),
    }
}
