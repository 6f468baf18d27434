//! What the user says of an event file.

use erfgs_events::{EventFileHints, SensorSize, TextColumns};

/// Options of every command that reads event files.
#[derive(Debug, clap::Args)]
pub struct EventFileOptions {
    /// Size of the sensor, if an event file does not say it; without it, what holds all addresses.
    #[arg(long, value_name = "WxH", value_parser = crate::parse::sensor_size)]
    size: Option<SensorSize>,
    #[command(flatten)]
    text: TextOptions,
}

/// Options of every command that reads events as text.
#[derive(Debug, clap::Args)]
pub struct TextOptions {
    /// What each column of a text of events (CSV) is, whatever the text says: t, x, y and p in its order, the unit of time behind t
    /// (t_s, t_ms, t_us, t_ns), - for a column that is none of them.
    #[arg(long, value_name = "x,y,p,t_us", allow_hyphen_values = true)]
    columns: Option<TextColumns>,
}

impl EventFileOptions {
    pub fn hints(&self) -> EventFileHints {
        EventFileHints { size: self.size, ..self.text.hints() }
    }
}

impl EventFileOptions {
    /// The first of the options that is there.
    pub fn given(&self) -> Option<&'static str> {
        self.size.map(|_| "--size").or(self.text.columns.map(|_| "--columns"))
    }
}

impl TextOptions {
    pub fn hints(&self) -> EventFileHints {
        EventFileHints { columns: self.columns, size: None }
    }
}
