//! What a model of event camera must be able to do.

use std::sync::Arc;

use erfgs_session::source::{Encoding, Knob};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Map, Value};

use super::{EventError, StreamConfig};
use crate::usb::{Identity, Transport};

/// A model of event camera. One value is one camera while it is plugged in; dropping it gives the device free.
pub trait Driver: Send + Sized + 'static {
    /// Its settings.
    type Config: Clone + Send + Sync + Serialize + DeserializeOwned + 'static;
    /// Maker and model.
    const MODEL: &'static str;
    /// Names of the settings that can be changed while the camera sends.
    const ADJUSTABLE: &'static [&'static str];

    /// Whether a device on the bus may be one.
    fn is_candidate(identity: &Identity) -> bool;
    /// Makes sure that it is one and reads its serial number. Changes nothing on it.
    ///
    /// # Errors
    /// If it is another model, is used by another program or does not answer.
    fn connect(transport: Arc<dyn Transport>) -> Result<Self, EventError>;
    /// Its serial number.
    fn serial(&self) -> &str;
    /// The serial number that the settings ask for; empty: any.
    fn wanted_serial(config: &Self::Config) -> &str;
    /// Checks settings that need no camera.
    ///
    /// # Errors
    /// The first one out of range.
    fn validate(config: &Self::Config) -> Result<(), EventError>;
    /// How data is fetched.
    fn stream_config(config: &Self::Config) -> StreamConfig;
    /// The device.
    fn transport(&self) -> &Arc<dyn Transport>;
    /// Model, serial number, bus and address, for messages.
    fn name(&self) -> &str;
    /// Where data comes from.
    fn endpoint(&self) -> u8;
    /// Brings the camera into the state that the settings describe, silent.
    ///
    /// # Errors
    /// If it does not take them.
    fn configure(&mut self, config: &Self::Config) -> Result<(), EventError>;
    /// Changes what [`Driver::ADJUSTABLE`] names to what the settings describe, while the camera sends; the rest of them is
    /// as it was.
    ///
    /// # Errors
    /// If it does not take them.
    fn adjust(&mut self, config: &Self::Config) -> Result<(), EventError>;
    /// What can be changed so, for people, and how it stands in these settings.
    fn knobs(config: &Self::Config) -> Vec<Knob>;
    /// Settings as read back by the last [`Driver::configure`] or [`Driver::adjust`].
    fn settings(&self) -> &Map<String, Value>;
    /// How its data is encoded.
    fn encoding(&self) -> Encoding;
    /// Columns and rows, pixels.
    fn size(&self) -> (u32, u32);
    /// Order of its start among the sources of a rig.
    fn start_order(&self) -> i32;
    /// Lets it send. The transfers are in flight already.
    ///
    /// # Errors
    /// If it does not answer.
    fn run(&mut self) -> Result<(), EventError>;
    /// Stops it sending.
    ///
    /// # Errors
    /// If it does not answer.
    fn halt(&mut self) -> Result<(), EventError>;
    /// Powers the sensor down, before the camera is given free.
    ///
    /// # Errors
    /// If it does not answer.
    fn shut_down(&mut self) -> Result<(), EventError>;
    /// What it measures of itself.
    ///
    /// # Errors
    /// If it does not answer.
    fn readings(&mut self) -> Result<Vec<(String, f64)>, EventError>;
    /// Data that the device itself dropped since it was configured, as its last readings told.
    fn lost(&self) -> u64 {
        0
    }
}
