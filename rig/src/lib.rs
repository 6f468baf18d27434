//! The rig: drivers of event cameras, RGB cameras and the trigger board.
//!
//! Every driver is an [`erfgs_session::source::Source`]; who takes its packets knows nothing else of a device.
//!
//! Event cameras, listed, and the only EVK4 opened ([`event::Davis346Source`] is the same for a DAVIS346):
//!
//! ```no_run
//! use std::sync::{Arc, mpsc};
//!
//! use erfgs_rig::{
//!     event::{self, Evk4Config, Evk4Source},
//!     usb::LibusbBus,
//! };
//! use erfgs_session::source::{Incident, Outlet, Packet, Source};
//!
//! /// Where the packets go; never blocks, or the camera would lose events.
//! struct Queue(mpsc::SyncSender<Packet>);
//!
//! impl Outlet for Queue {
//!     fn send(&self, packet: Packet) -> bool {
//!         self.0.try_send(packet).is_ok()
//!     }
//!
//!     fn report(&self, incident: Incident) {
//!         eprintln!("{incident:?}");
//!     }
//! }
//!
//! for camera in event::list()? {
//!     println!("{} {} at {}: {}", camera.model, camera.serial, camera.port, camera.problem.unwrap_or("ready".into()));
//! }
//! let (queue, packets) = mpsc::sync_channel(1024);
//! let mut camera = Evk4Source::open(Arc::new(LibusbBus), "ev0", Evk4Config::default())?;
//! camera.start(Arc::new(Queue(queue)))?;
//! for packet in packets.iter().take(100) {
//!     println!("{} bytes of {} at {} ns", packet.payload.len(), camera.description().encoding, packet.host_ns);
//! }
//! camera.stop()?;
//! # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
//! ```
//!
//! RGB cameras:
//!
//! ```no_run
//! use erfgs_rig::frame::{self, FrameConfig};
//!
//! for camera in frame::list()? {
//!     println!("{} at {}: {}", camera.name, camera.node.display(), camera.formats.join(", "));
//! }
//! let camera = frame::open(&FrameConfig { id: "cam0".into(), width: 1280, height: 720, ..FrameConfig::default() })?;
//! println!("{:?}", camera.description().settings); // as read back after they were set
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The trigger board, which sets the pace of all of them: [`trigger::find`] and [`trigger::TriggerBoard`].
//!
//! # Features
//!
//! The default is all of them.
//!
//! - `evk4`, `davis346`: the drivers of event cameras, through libusb.
//! - `frames`: RGB cameras, through V4L2, GigE Vision and USB3 Vision (Linux), and nokhwa (everywhere).
//! - `trigger`: the trigger board, through a serial port.
//! - `usb`: the USB transport alone; the drivers bring it.

#[cfg(any(feature = "evk4", feature = "davis346"))]
pub mod event;
#[cfg(feature = "frames")]
pub mod frame;
#[cfg(all(feature = "frames", target_os = "linux"))]
pub mod genicam;
pub mod host_time;
#[cfg(any(feature = "evk4", feature = "davis346", feature = "frames"))]
mod not_applied;
#[cfg(feature = "trigger")]
pub mod trigger;
#[cfg(feature = "usb")]
pub mod usb;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
