//! Settings of devices, changed while they run.

use erfgs_session::source::{Incident, Knob, Outlet as _, SourceError, merge_settings};
use serde_json::{Map, Value};

use super::{
    config::ConfigError,
    recorder::{Recorder, lock},
    rig_file,
    status::Level,
};

/// Why settings are not changed.
#[derive(Debug, thiserror::Error)]
pub enum AdjustError {
    /// There is no such stream.
    #[error("the rig has no device '{0}'")]
    Unknown(String),
    /// The device refuses.
    #[error("the settings of '{id}' were not changed: {source}")]
    Device {
        /// The stream.
        id: String,
        /// Why.
        source: SourceError,
    },
    /// The rig was not read from a file.
    #[error("the rig has no file to write the settings into")]
    NoFile,
    /// Nothing was changed.
    #[error("nothing was changed of '{0}' since it was opened")]
    Unchanged(String),
    /// The rig's file.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

impl Recorder {
    /// What of a device can be changed while it runs, and how it stands.
    ///
    /// # Errors
    /// If there is no such device.
    pub fn knobs(&self, id: &str) -> Result<Vec<Knob>, AdjustError> {
        Ok(lock(&self.slot(id)?.source).knobs())
    }

    /// Changes settings of a device while it runs; the recording that runs notes what and when, and those that follow have
    /// the settings as read back.
    ///
    /// # Errors
    /// If there is no such device, or it does not take them.
    pub fn adjust(&self, id: &str, changed: &Map<String, Value>) -> Result<Vec<Knob>, AdjustError> {
        let slot = self.slot(id)?;
        let mut source = lock(&slot.source);
        source.adjust(changed).map_err(|source| AdjustError::Device { id: id.to_owned(), source })?;
        let knobs = source.knobs();
        let missed = source.description().settings.get("not_applied").cloned();
        drop(source);
        merge_settings(&mut lock(&slot.adjusted), changed);
        slot.outlet.report(Incident::Adjusted { changed: changed.clone() });
        if let Some(missed) = missed {
            self.say(Level::Warning, id, format!("not all was taken: {missed}"));
        }
        Ok(knobs)
    }

    /// Writes what was changed of a device since it was opened into the rig's file.
    ///
    /// # Errors
    /// If there is no such device or file, or it cannot be changed so; it is left alone then.
    pub fn keep_settings(&self, id: &str) -> Result<(), AdjustError> {
        let slot = self.slot(id)?;
        let Some(path) = self.rig_file() else { return Err(AdjustError::NoFile) };
        let changed = lock(&slot.adjusted).clone();
        if changed.is_empty() {
            return Err(AdjustError::Unchanged(id.to_owned()));
        }
        rig_file::keep_settings(path, id, &changed)?;
        self.say(Level::Info, id, format!("its settings are in '{}'", path.display()));
        Ok(())
    }
}
