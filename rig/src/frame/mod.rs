//! RGB cameras: nokhwa as the portable path, V4L2 on Linux as the precise one; GigE Vision and USB3 Vision for machine-vision cameras.

mod check;
mod config;
mod error;
mod format;
#[cfg(target_os = "linux")]
mod genicam;
mod portable;
#[cfg(target_os = "linux")]
mod retry;
#[cfg(target_os = "linux")]
mod v4l2;

use std::{path::PathBuf, sync::Arc};

use erfgs_session::source::Source;
use serde::Serialize;

use crate::usb::{Bus, LibusbBus};
pub use config::{Backend, FrameConfig, Lock, NamedLock};
pub use error::FrameError;
pub use format::{encoding_of, fourccs};
#[cfg(target_os = "linux")]
pub use genicam::{GenicamCamera, GigeLink, U3vLink, list_gige, list_u3v, list_u3v_on};
use portable::PortableCamera;
#[cfg(target_os = "linux")]
pub use v4l2::{PreciseCamera, list_in};

/// A camera that is plugged in.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FoundCamera {
    /// Its name.
    pub name: String,
    /// Serial number, empty where it has none.
    pub serial: String,
    /// Where it is plugged in: `usb-0000:00:14.0-2`. Empty where the system does not say.
    pub bus: String,
    /// Its node, or the system's index.
    pub node: PathBuf,
    /// The kernel driver, or the system's interface.
    pub driver: String,
    /// The formats that it offers, as four-character codes; empty where they are known only when it is opened.
    pub formats: Vec<String>,
    /// Speed of its link, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link: Option<String>,
    /// Why it cannot be used, if it cannot.
    pub problem: Option<String>,
}

/// The cameras that are plugged in. Nodes that give no frames (metadata, outputs) are left out.
///
/// # Errors
/// If the system does not list them.
pub fn list() -> Result<Vec<FoundCamera>, FrameError> {
    #[cfg(target_os = "linux")]
    return v4l2::list();
    #[cfg(not(target_os = "linux"))]
    return portable::list();
}

/// Opens the camera that a configuration means, and sets it.
///
/// # Errors
/// If there is no such camera, or it cannot do what is asked; the message says what it can.
pub fn open(config: &FrameConfig) -> Result<Box<dyn Source>, FrameError> {
    open_on(config, &(Arc::new(LibusbBus) as _))
}

/// As [`open`], with the USB devices of `bus`. Cameras that the kernel's own driver serves are the machine's all the same.
///
/// # Errors
/// As [`open`].
#[cfg_attr(not(target_os = "linux"), expect(unused_variables, reason = "no camera there is opened by way of a bus"))]
pub fn open_on(config: &FrameConfig, bus: &Arc<dyn Bus>) -> Result<Box<dyn Source>, FrameError> {
    match config.backend {
        #[cfg(target_os = "linux")]
        Backend::Auto | Backend::Precise => Ok(Box::new(PreciseCamera::open(config)?)),
        #[cfg(not(target_os = "linux"))]
        Backend::Precise => Err(FrameError::Config {
            id: config.id.clone(),
            problem: "backend \"precise\" exists on Linux alone; leave it out".into(),
        }),
        #[cfg(not(target_os = "linux"))]
        Backend::Auto => Ok(Box::new(PortableCamera::open(config)?)),
        Backend::Portable => Ok(Box::new(PortableCamera::open(config)?)),
        #[cfg(target_os = "linux")]
        Backend::Gige => Ok(Box::new(GenicamCamera::open(GigeLink, config)?)),
        #[cfg(target_os = "linux")]
        Backend::U3v => Ok(Box::new(GenicamCamera::open(U3vLink(Arc::clone(bus)), config)?)),
        #[cfg(not(target_os = "linux"))]
        Backend::Gige | Backend::U3v => {
            let problem = format!("backend \"{}\" exists on Linux alone", config.backend.name());
            Err(FrameError::Config { id: config.id.clone(), problem })
        }
    }
}
