use std::{io, net::Ipv4Addr};

use super::Status;
use crate::usb::TransportError;

/// What can go wrong with a machine-vision camera.
#[derive(Debug, thiserror::Error)]
pub enum GenicamError {
    /// The system gives no socket, or no interfaces.
    #[error("cannot {doing}: {source}")]
    Network {
        /// What was being done.
        doing: String,
        /// What the system says.
        source: io::Error,
    },
    /// No answer, as often as it was asked.
    #[error(
        "it does not answer at {address} when it is to {doing}: check its cable and its power, and that no firewall drops \
         UDP from and to port 3956"
    )]
    Silent {
        /// Where it was.
        address: Ipv4Addr,
        /// What was asked.
        doing: String,
    },
    /// The bus says no.
    #[error(transparent)]
    Bus(#[from] TransportError),
    /// No answer, as often as it was told.
    #[error(
        "it does not answer when it is to {doing}: unplug it and plug it in again, to a port of the computer itself"
    )]
    NoAnswer {
        /// What was asked.
        doing: String,
    },
    /// It is on USB, and not as USB3 Vision has it.
    #[error("it does not follow USB3 Vision: {reason}. A newer firmware of its maker may")]
    Usb3 {
        /// In what.
        reason: String,
    },
    /// It says no.
    #[error("it refuses to {doing}: {status}")]
    Refused {
        /// What was asked.
        doing: String,
        /// What it says.
        status: Status,
    },
    /// Another program has it.
    #[error(
        "another program{} controls it: close that program (one that has crashed keeps the camera for {seconds:.0} s)",
        at(by)
    )]
    Held {
        /// Where that program runs, if the camera tells.
        by: Option<Ipv4Addr>,
        /// How long a camera waits for the heartbeat of its controller.
        seconds: f64,
    },
    /// Control was there, and is no more.
    #[error("control of it was lost: it was restarted, or another program took it")]
    ControlLost,
    /// Its address is in no subnet of this machine.
    #[error("{0}")]
    WrongSubnet(String),
    /// Its description cannot be used.
    #[error("its description cannot be used: {reason}")]
    Description {
        /// Why.
        reason: String,
    },
    /// A feature that is not there, or not as it is needed.
    #[error("its feature {name}: {reason}")]
    Feature {
        /// Which.
        name: String,
        /// What is wrong.
        reason: String,
    },
    /// A setting of the rig that it cannot take.
    #[error("{setting} = {value}: {reason}")]
    Setting {
        /// Which.
        setting: String,
        /// What was asked for.
        value: String,
        /// Why not, and what would do.
        reason: String,
    },
    /// Packets of the size asked for do not come through.
    #[error(
        "packets of {asked} bytes do not come through and those of {passing} do: set the MTU of the network interface and \
         of every switch between to {asked} or more (jumbo frames), or leave packet_bytes out"
    )]
    PacketSize {
        /// What was asked for.
        asked: u32,
        /// What passes.
        passing: u32,
    },
}

fn at(by: &Option<Ipv4Addr>) -> String {
    by.map_or_else(String::new, |address| format!(" at {address}"))
}
