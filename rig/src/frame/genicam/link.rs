//! What differs between a camera on Ethernet and one on USB.

use std::time::Duration;

use serde_json::{Map, Value};

use crate::{
    frame::{FrameConfig, FrameError},
    genicam::{Block, Features, GenicamConfig, GenicamError, Order},
    not_applied::NotApplied,
};

/// A transport: finds cameras.
pub trait Link: Send + Sync + 'static {
    /// Its name in `RIG.toml`.
    const BACKEND: &'static str;
    /// Which way the numbers of chunks lie.
    const ORDER: Order;
    /// A camera on it.
    type Device: Device;

    /// Finds the camera that a configuration means, and takes control of it.
    ///
    /// # Errors
    /// If there is no such camera, another program has it, or it does not answer.
    fn open(&self, config: &FrameConfig) -> Result<Self::Device, FrameError>;
}

/// A camera that we control. Dropping it gives it free.
pub trait Device: Send + 'static {
    /// The receiving end of its stream.
    type Intake: Intake;

    /// What it is.
    fn identity(&self) -> Identity;
    /// What it can do.
    fn features(&mut self) -> &mut Features;
    /// Ticks of its clock a second.
    fn tick_hz(&self) -> u64;
    /// Why it is no longer ours, if it is not.
    fn lost(&self) -> Option<String>;
    /// Prepares a stream of frames of so many bytes.
    ///
    /// # Errors
    /// If the camera does not take what is asked, or its frames cannot be.
    fn prepare(&self, config: &GenicamConfig, frame_bytes: usize) -> Result<Self::Intake, GenicamError>;
    /// What of the transport is to be known, and what of it is not as wanted.
    fn tell(
        &self,
        intake: &Self::Intake,
        config: &GenicamConfig,
        settings: &mut Map<String, Value>,
        missed: &mut NotApplied,
    );
    /// Begins to stream.
    ///
    /// # Errors
    /// If the camera does not.
    fn begin(&mut self, intake: &mut Self::Intake) -> Result<(), GenicamError>;
    /// Ends the stream.
    ///
    /// # Errors
    /// If the camera does not take it.
    fn end(&mut self, intake: &mut Self::Intake) -> Result<(), GenicamError>;
}

/// What a camera is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Maker and model.
    pub label: String,
    /// Serial number, if it has one.
    pub serial: String,
    /// Where it is now.
    pub place: String,
    /// What stays with a camera without a serial number.
    pub lasting: String,
}

impl Identity {
    /// Maker, model and place.
    pub fn full(&self) -> String {
        format!("{} at {}", self.label, self.place)
    }

    /// By what the camera is found again, wherever it is then.
    pub fn again(&self) -> &str {
        if self.serial.is_empty() { &self.lasting } else { &self.serial }
    }
}

/// The receiving end of a stream that runs.
pub trait Intake: Send + 'static {
    /// Takes what comes, for so long at most.
    ///
    /// # Errors
    /// If the system does not give it.
    fn receive(&mut self, wait: Duration) -> Result<(), String>;
    /// Why the camera is lost, if it is.
    fn lost(&mut self) -> Option<String>;
    /// The next block, whole or not.
    fn next_block(&mut self) -> Option<Block>;
    /// The next thing that a user should know.
    fn warning(&mut self) -> Option<String>;
    /// Lets no block begin any more: one that has begun may come to its end.
    fn end(&mut self);
    /// Whether a block has begun and is not handed over.
    fn is_busy(&self) -> bool;
    /// Hands over what is there.
    fn finish(&mut self);
    /// Blocks that are lost since the stream began.
    fn lost_blocks(&self) -> u64;
    /// What is counted, by name.
    fn counts(&self, into: &mut Vec<(&'static str, u64)>);
    /// What may help with a camera that answers and sends nothing.
    fn silence(&self) -> &'static str;
}
