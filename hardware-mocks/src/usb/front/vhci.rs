//! Plugs devices into this machine's kernel through `vhci_hcd`, its virtual host controller. Needs root and the module.

use std::{
    fs, io,
    os::{fd::AsRawFd as _, unix::net::UnixStream},
    path::Path,
};

use thiserror::Error;

use crate::usb::Speed;

const CONTROLLER: &str = "/sys/devices/platform/vhci_hcd.0";
/// State of a port that nothing is plugged into.
const FREE: &str = "004";

/// Why a device cannot be plugged in.
#[derive(Debug, Error)]
pub enum VhciError {
    /// The controller's file cannot be used.
    #[error("cannot use {path}: {source}; run as root after `modprobe vhci-hcd`")]
    Access {
        /// The file.
        path: String,
        /// Why.
        source: io::Error,
    },
    /// All ports of the speed are taken.
    #[error("all ports of {hub} speed of the virtual controller are taken; unplug a device")]
    NoPort {
        /// `hs` or `ss`.
        hub: &'static str,
    },
}

fn access(path: &str) -> impl FnOnce(io::Error) -> VhciError {
    let path = path.to_owned();
    |source| VhciError::Access { path, source }
}

/// Plugs in what is served at the other end of `stream`, and returns the number of its port.
///
/// # Errors
/// If the controller is not there, refuses, or is full.
pub fn attach(stream: &UnixStream, speed: Speed) -> Result<u32, VhciError> {
    let path = format!("{CONTROLLER}/status");
    let status = fs::read_to_string(&path).map_err(access(&path))?;
    // The kernel's codes of speeds (enum usb_device_speed).
    let (hub, code) = match speed {
        Speed::High => ("hs", 3),
        Speed::Super => ("ss", 5),
    };
    let port = status
        .lines()
        .filter_map(|line| {
            let mut fields = line.split_whitespace();
            let (of, port, state) = (fields.next()?, fields.next()?, fields.next()?);
            (of == hub && state == FREE).then(|| port.parse::<u32>().ok())?
        })
        .next()
        .ok_or(VhciError::NoPort { hub })?;
    let path = format!("{CONTROLLER}/attach");
    // Port, socket, a number of our choice for the device, speed.
    let line = format!("{port} {} {} {code}", stream.as_raw_fd(), 0x1_0000 + port + 1);
    fs::write(&path, line).map_err(access(&path))?;
    Ok(port)
}

/// Pulls a device out of the kernel's side.
///
/// # Errors
/// If the controller refuses: the port is free already.
pub fn detach(port: u32) -> Result<(), VhciError> {
    let path = format!("{CONTROLLER}/detach");
    fs::write(&path, port.to_string()).map_err(access(&path))
}

/// Whether the virtual controller is there.
#[must_use]
pub fn is_available() -> bool {
    Path::new(CONTROLLER).exists()
}
