//! RGB cameras: nokhwa as the portable path, V4L2 on Linux as the precise one; GigE Vision for machine-vision cameras.

mod check;
mod config;
mod error;
mod format;
#[cfg(target_os = "linux")]
mod gige;
mod portable;
#[cfg(target_os = "linux")]
mod retry;
#[cfg(target_os = "linux")]
mod v4l2;

use std::path::PathBuf;

use erfgs_session::source::Source;
use serde::Serialize;

pub use config::{Backend, FrameConfig, Lock, NamedLock};
pub use error::FrameError;
pub use format::{encoding_of, fourccs};
#[cfg(target_os = "linux")]
pub use gige::{GigeCamera, list as list_gige};
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
        Backend::Gige => Ok(Box::new(GigeCamera::open(config)?)),
        #[cfg(not(target_os = "linux"))]
        Backend::Gige => {
            Err(FrameError::Config { id: config.id.clone(), problem: "backend \"gige\" exists on Linux alone".into() })
        }
    }
}
