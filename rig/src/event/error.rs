//! Errors of event cameras.

use std::{fmt::Display, ops::RangeInclusive};

use thiserror::Error;

use crate::usb::{Fault, TransportError};

/// What went wrong with an event camera: which, at what step, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum EventError {
    /// A transfer failed.
    #[error("{camera}: {step}: {source}")]
    Transport {
        /// Model and serial number.
        camera: String,
        /// Step or register.
        step: String,
        /// The failed transfer.
        source: TransportError,
    },
    /// No such camera is plugged in.
    #[error(
        "no {model}{} found{}. Check the cable (USB 3, straight into the computer) and that `lsusb` shows it; \
         `erfgs devices` lists what was recognised",
        wanted(serial),
        list_of(others)
    )]
    NotFound {
        /// The model looked for.
        model: &'static str,
        /// The serial number asked for; empty: any.
        serial: String,
        /// What was found instead, and why it was not taken.
        others: Vec<String>,
    },
    /// Several cameras fit.
    #[error("{} cameras of the model {model} are plugged in. Choose one: `serial = \"...\"` with one of {}",
        serials.len(), serials.join(", "))]
    Ambiguous {
        /// The model looked for.
        model: &'static str,
        /// Serial numbers of those that fit.
        serials: Vec<String>,
    },
    /// The device at these identifiers is another model.
    #[error("{device} is not a {model}: {found}. Use the driver of that model")]
    WrongDevice {
        /// Identifiers, bus and address.
        device: String,
        /// The model expected.
        model: &'static str,
        /// What it is instead.
        found: String,
    },
    /// The firmware or logic of the camera is not one this driver knows.
    #[error("{camera}: {part} version {found} is not supported ({needed} needed). Update it with the maker's tool")]
    Firmware {
        /// Model and serial number.
        camera: String,
        /// Which part.
        part: &'static str,
        /// Version found.
        found: String,
        /// Version needed.
        needed: &'static str,
    },
    /// The camera answered, but not as its protocol says.
    #[error("{camera}: {step}: {problem}. Unplug the camera and plug it in again; update its firmware if that repeats")]
    Answer {
        /// Model and serial number.
        camera: String,
        /// Step or register.
        step: String,
        /// What is wrong with the answer.
        problem: String,
    },
    /// A setting is out of its range.
    #[error("{setting} = {value} is out of range: allowed is {allowed}")]
    Setting {
        /// Its name in the configuration.
        setting: String,
        /// Its value.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// A source was started twice.
    #[error("{camera}: already streaming; stop it first")]
    Running {
        /// Model and serial number.
        camera: String,
    },
    /// The system starts no more threads.
    #[error("{camera}: the system refuses to start more threads. Close other programs or raise the limit (ulimit -u)")]
    Threads {
        /// Model and serial number.
        camera: String,
    },
}

fn wanted(serial: &str) -> String {
    if serial.is_empty() { String::new() } else { format!(" with serial number {serial}") }
}

fn list_of(others: &[String]) -> String {
    if others.is_empty() { String::new() } else { format!(" (found: {})", others.join("; ")) }
}

impl EventError {
    pub(crate) fn setting(setting: impl Into<String>, value: impl Display, allowed: impl Into<String>) -> Self {
        Self::Setting { setting: setting.into(), value: value.to_string(), allowed: allowed.into() }
    }

    /// Checks that `value` is within `range`.
    pub(crate) fn check<T: PartialOrd + Display>(
        setting: &str,
        value: T,
        range: RangeInclusive<T>,
    ) -> Result<(), Self> {
        if range.contains(&value) {
            return Ok(());
        }
        Err(Self::setting(setting, value, format!("{} to {}", range.start(), range.end())))
    }

    /// The fault of the transport behind this error, where there is one.
    #[must_use]
    pub fn fault(&self) -> Option<&Fault> {
        match self {
            Self::Transport { source, .. } => Some(&source.fault),
            _ => None,
        }
    }
}
