//! `RIG.toml`: which devices make up a rig, their settings, and how they are recorded.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use toml::Table;

use super::{pattern::PatternConfig, recorder::is_id};
use erfgs_rig::{
    event::{BiasOffsets, Davis346Config, Driver, Evk4Config, davis346::Davis346, evk4::Evk4},
    frame::FrameConfig,
    trigger::TriggerConfig,
};

/// What is wrong with a `RIG.toml`.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// It cannot be read.
    #[error("cannot read the rig's configuration '{}': {source}. `erfgs record --example` prints one to start from", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It cannot be written.
    #[error(transparent)]
    Write(FileError),
    /// It is not TOML, or has fields that nothing knows.
    #[error("'{}': {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where and what.
        message: String,
    },
    /// A device's table.
    #[error("'{}', [[{kind}]] number {number}{}: {message}", path.display(), named(id))]
    Device {
        /// The file.
        path: PathBuf,
        /// The kind of device.
        kind: &'static str,
        /// Counts the tables of this kind, from 1.
        number: usize,
        /// Its id, if it has one.
        id: String,
        /// What is wrong.
        message: String,
    },
}

fn named(id: &str) -> String {
    if id.is_empty() { String::new() } else { format!(" ('{id}')") }
}

/// A petabyte: more is no reserve of a disk.
const MOST_RESERVE_MIB: u64 = 1 << 30;
/// A day: what sends nothing for longer is watched by nobody.
const MOST_STALL_SECONDS: u32 = 86_400;

/// A rig: `RIG.toml` as read.
#[derive(Clone, Debug, PartialEq)]
pub struct RigConfig {
    /// What it is called, in the session and in the names of files.
    pub name: String,
    /// How to record.
    pub record: RecordConfig,
    /// The devices, kind by kind in the order of the file.
    pub devices: Vec<DeviceConfig>,
    /// The text it was read from.
    pub text: String,
}

/// The table `[record]`: how to record. All fields have defaults.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecordConfig {
    /// How often the session file is brought into a readable state, milliseconds, 10 to 1000: what a killed process or
    /// a power cut can cost.
    pub flush_ms: u64,
    /// Space of the disk that recordings leave free, MiB, 0 to 1073741824: a recording ends in good order before the disk is full.
    pub reserve_mib: u64,
    /// Data of one stream that may wait in memory for the disk, MiB, 1 to 65536; devices may have their own.
    pub queue_mib: usize,
    /// Memory for the past that `erfgs record --before` holds, of all streams together, MiB, 1 to 1048576.
    pub before_mib: u64,
    /// After this many seconds without data, 86400 at most, a stream counts as stalled; 0: never. Devices may have their own.
    pub stall_seconds: u32,
    /// A piece of the session file closes at this size, MiB, 1 to 64.
    pub chunk_mib: u64,
    /// Whether every piece carries a checksum, so that readers notice damage.
    pub checksums: bool,
}

impl Default for RecordConfig {
    fn default() -> Self {
        Self {
            flush_ms: 500,
            reserve_mib: 512,
            queue_mib: 256,
            before_mib: 2048,
            stall_seconds: 5,
            chunk_mib: 4,
            checksums: true,
        }
    }
}

/// One device: what all have in common, and the settings of its driver.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceConfig {
    /// Name of the stream.
    pub id: String,
    /// Overrides [`RecordConfig::queue_mib`].
    pub queue_mib: Option<usize>,
    /// Overrides [`RecordConfig::stall_seconds`].
    pub stall_seconds: Option<u32>,
    /// Settings of the driver.
    pub settings: DeviceSettings,
}

impl DeviceSettings {
    /// What tells the device from others of its kind, where the settings say it: the name of the field, and its value.
    fn which(&self) -> Option<(&'static str, &str)> {
        let (field, value) = match self {
            Self::Evk4(config) => ("serial", &config.serial),
            Self::Davis346(config) => ("serial", &config.serial),
            Self::Camera(config) => ("camera", &config.camera),
            Self::Trigger(config) => ("port", &config.port),
            Self::Pattern(_) => return None,
        };
        (!value.is_empty()).then_some((field, value.as_str()))
    }
}

/// Settings of a driver, by kind of device.
#[derive(Clone, Debug, PartialEq)]
pub enum DeviceSettings {
    /// `[[evk4]]`: a Prophesee EVK4.
    Evk4(Box<Evk4Config>),
    /// `[[davis346]]`: an iniVation DAVIS346.
    Davis346(Box<Davis346Config>),
    /// `[[camera]]`: an RGB camera.
    Camera(Box<FrameConfig>),
    /// `[[trigger]]`: a trigger board.
    Trigger(Box<TriggerConfig>),
    /// `[[pattern]]`: a built-in source.
    Pattern(PatternConfig),
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct File {
    rig: Rig,
    record: RecordConfig,
    evk4: Vec<Table>,
    davis346: Vec<Table>,
    camera: Vec<Table>,
    trigger: Vec<Table>,
    pattern: Vec<Table>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Rig {
    name: String,
}

impl Default for Rig {
    fn default() -> Self {
        Self { name: "rig".into() }
    }
}

impl RigConfig {
    /// The annotated example: every device and every field, with its default.
    pub const EXAMPLE: &'static str = include_str!("../../../docs/reference/rig.toml");

    /// Reads and checks a file.
    ///
    /// # Errors
    /// If it cannot be read or something in it is wrong; the message names the place.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text = fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Checks the text of a file; `path` names it in errors.
    ///
    /// # Errors
    /// If something in it is wrong.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let syntax = |message: String| ConfigError::Syntax { path: path.to_owned(), message };
        let file: File = toml::from_str(text).map_err(|error| syntax(error.to_string()))?;
        let record = &file.record;
        let ranges = [
            ("reserve_mib", record.reserve_mib, 0..=MOST_RESERVE_MIB),
            ("stall_seconds", record.stall_seconds.into(), 0..=MOST_STALL_SECONDS.into()),
            ("flush_ms", record.flush_ms, 10..=1000),
            ("queue_mib", record.queue_mib as u64, 1..=65_536),
            ("before_mib", record.before_mib, 1..=1_048_576),
            ("chunk_mib", record.chunk_mib, 1..=64),
        ];
        if let Some((name, value, range)) = ranges.into_iter().find(|(_, value, range)| !range.contains(value)) {
            let (least, most) = range.into_inner();
            return Err(syntax(format!("[record] {name} is {value}; it can be {least} to {most}")));
        }
        if !is_id(&file.rig.name) {
            return Err(syntax(format!("[rig] name '{}': use 1 to 64 letters, digits, '-' and '_'", file.rig.name)));
        }
        let mut devices = Vec::new();
        let mut add = |kind, tables: Vec<Table>, settings: &dyn Fn(&str, Table) -> Result<DeviceSettings, String>| {
            for (index, table) in tables.into_iter().enumerate() {
                let id = table.get("id").and_then(toml::Value::as_str).unwrap_or_default().to_owned();
                let device = device(table, settings).and_then(|device| {
                    if devices.iter().any(|other: &DeviceConfig| other.id == device.id) {
                        return Err("another device has this id".into());
                    }
                    // Two kinds of cameras may have one serial number; of one kind it would be opened twice.
                    let same = devices.iter().find(|other: &&DeviceConfig| {
                        std::mem::discriminant(&other.settings) == std::mem::discriminant(&device.settings)
                            && device.settings.which().is_some_and(|which| other.settings.which() == Some(which))
                    });
                    match (same, device.settings.which()) {
                        (Some(other), Some((field, value))) => {
                            Err(format!("'{}' has the same {field} = \"{value}\"; each device needs its own", other.id))
                        }
                        _ => Ok(device),
                    }
                });
                devices.push(device.map_err(|message| ConfigError::Device {
                    path: path.to_owned(),
                    kind,
                    number: index + 1,
                    id,
                    message,
                })?);
            }
            Ok(())
        };
        add("evk4", file.evk4, &|_, mut table| {
            bias_file(&mut table, path)?;
            let config: Evk4Config = driver(table)?;
            Evk4::validate(&config).map_err(|error| error.to_string())?;
            Ok(DeviceSettings::Evk4(config.into()))
        })?;
        add("davis346", file.davis346, &|_, table| {
            let config: Davis346Config = driver(table)?;
            Davis346::validate(&config).map_err(|error| error.to_string())?;
            Ok(DeviceSettings::Davis346(config.into()))
        })?;
        add("camera", file.camera, &|id, table| {
            let config = FrameConfig { id: id.into(), ..driver(table)? };
            config.check().map_err(|error| error.to_string())?;
            Ok(DeviceSettings::Camera(config.into()))
        })?;
        add("trigger", file.trigger, &|id, table| {
            let config = TriggerConfig { id: id.into(), ..driver(table)? };
            config.settings().map_err(|error| error.to_string())?;
            Ok(DeviceSettings::Trigger(config.into()))
        })?;
        add("pattern", file.pattern, &|_, table| {
            let config: PatternConfig = driver(table)?;
            config.validate()?;
            Ok(DeviceSettings::Pattern(config))
        })?;
        Ok(Self { name: file.rig.name, record: file.record, devices, text: text.to_owned() })
    }
}

/// Puts the offsets of the bias file that a table names into its place, beneath those that the table has itself. The file lies beside
/// the rig's.
fn bias_file(table: &mut Table, rig: &Path) -> Result<(), String> {
    let Some(name) = table.remove("bias_file") else { return Ok(()) };
    let name = name.as_str().ok_or("bias_file must be the name of a file, in quotes")?;
    let file = rig.parent().unwrap_or(Path::new("")).join(name);
    let text =
        fs::read_to_string(&file).map_err(|error| format!("cannot read bias_file {}: {error}", file.display()))?;
    let offsets =
        BiasOffsets::of_metavision(&text).map_err(|wrong| format!("bias_file {}: {wrong}", file.display()))?;
    let mut biases = Table::try_from(offsets).map_err(|error| error.to_string())?;
    match table.remove("biases") {
        Some(toml::Value::Table(own)) => biases.extend(own),
        Some(_) => return Err("biases must be a table: { diff_on = 20 }".into()),
        None => {}
    }
    table.insert("biases".into(), biases.into());
    Ok(())
}

fn driver<T: DeserializeOwned>(table: Table) -> Result<T, String> {
    table.try_into().map_err(|error: toml::de::Error| error.message().to_owned())
}

/// Takes what all devices have out of a table, and leaves the rest to the driver.
fn device(
    mut table: Table,
    settings: &dyn Fn(&str, Table) -> Result<DeviceSettings, String>,
) -> Result<DeviceConfig, String> {
    #[derive(Deserialize)]
    struct Common {
        id: Option<String>,
        queue_mib: Option<usize>,
        stall_seconds: Option<u32>,
    }
    let taken: Table =
        ["id", "queue_mib", "stall_seconds"].iter().filter_map(|&name| table.remove_entry(name)).collect();
    let Common { id, queue_mib, stall_seconds } = driver(taken)?;
    let id = id.ok_or("it needs an id: `id = \"left\"` names its stream in the recording")?;
    if !is_id(&id) {
        return Err("its id must be 1 to 64 letters, digits, '-' and '_'".into());
    }
    if stall_seconds.is_some_and(|seconds| seconds > MOST_STALL_SECONDS) {
        return Err(format!("stall_seconds can be 0 to {MOST_STALL_SECONDS}"));
    }
    if queue_mib.is_some_and(|mib| !(1..=65_536).contains(&mib)) {
        return Err("queue_mib can be 1 to 65536".into());
    }
    let settings = settings(&id, table)?;
    Ok(DeviceConfig { id, queue_mib, stall_seconds, settings })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<RigConfig, String> {
        RigConfig::parse(text, Path::new("RIG.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn the_example_is_valid() {
        let rig = parse(RigConfig::EXAMPLE).unwrap();
        assert!(!rig.devices.is_empty());
        assert_eq!(rig.record, RecordConfig::default(), "the example shows the defaults");
    }

    #[test]
    fn a_bias_file_lies_beneath_the_biases_of_the_rig() {
        let folder = tempfile::tempdir().unwrap();
        let rig = folder.path().join("RIG.toml");
        let parse = |more: &str| {
            let text = format!("[[evk4]]\nid = \"left\"\n{more}\n");
            RigConfig::parse(&text, &rig).map_err(|error| error.to_string())
        };
        fs::write(folder.path().join("quiet.bias"), "20 % bias_diff_on\n-7 % bias_fo\n").unwrap();
        fs::write(folder.path().join("gen3.bias"), "300 % bias_diff\n").unwrap();
        let biases = |more: &str| match &parse(more).unwrap().devices[0].settings {
            DeviceSettings::Evk4(config) => config.biases,
            other => panic!("{other:?}"),
        };
        let of_file = BiasOffsets { diff_on: 20, fo: -7, ..BiasOffsets::default() };
        assert_eq!(biases("bias_file = \"quiet.bias\""), of_file);
        let changed = BiasOffsets { fo: 0, refr: 3, ..of_file };
        assert_eq!(biases("bias_file = \"quiet.bias\"\nbiases = { fo = 0, refr = 3 }"), changed);
        for (more, says) in [
            ("bias_file = \"none.bias\"", "cannot read bias_file"),
            ("bias_file = \"gen3.bias\"", "values of a DAC"),
            ("bias_file = 3", "in quotes"),
            ("bias_file = \"quiet.bias\"\nbiases = 3", "must be a table"),
            ("bias_file = \"quiet.bias\"\nbiases = { pr = 3 }", "pr"),
        ] {
            let message = parse(more).unwrap_err();
            assert!(message.contains(says) && message.contains("left"), "{says}: {message}");
        }
    }

    #[test]
    fn every_field_of_the_recorder_is_in_the_example() {
        let fields = serde_json::to_value(RecordConfig::default()).unwrap();
        for name in fields.as_object().unwrap().keys() {
            assert!(RigConfig::EXAMPLE.contains(&format!("{name} = ")), "{name}");
        }
    }

    #[test]
    fn devices_override_what_the_recorder_says() {
        let rig = parse("[[pattern]]\nid = \"a\"\nqueue_mib = 3\n[[pattern]]\nid = \"b\"\nrate_hz = 5\n").unwrap();
        assert_eq!((rig.devices[0].queue_mib, rig.devices[1].queue_mib), (Some(3), None));
        let DeviceSettings::Pattern(pattern) = &rig.devices[1].settings else { panic!("{rig:?}") };
        assert_eq!(pattern.rate_hz, 5.0);
    }

    #[test]
    fn mistakes_are_refused_and_named() {
        for (text, says) in [
            ("[rig]\nnam = \"x\"", "unknown field `nam`"),
            ("[[evk5]]\nid = \"x\"", "evk5"),
            ("[record]\nflush_ms = 5000", "10 to 1000"),
            ("[record]\nqueue_mib = 0", "1 to 65536"),
            ("[record]\nreserve_mib = 18446744073709", "0 to 1073741824"),
            ("[record]\nstall_seconds = 1000000000", "0 to 86400"),
            ("[[pattern]]\nid = \"a\"\nstall_seconds = 1000000000", "0 to 86400"),
            ("[[camera]]\nid = \"a\"\nrate_hz = nan", "0.1 to 1000"),
            ("[[camera]]\nid = \"a\"\nexposure_us = 1e300", "0 to 1e9"),
            ("[[camera]]\nid = \"a\"\nwidth = 65535\nheight = 65535", "500 million pixels"),
            ("[rig]\nname = \"a/b\"", "letters"),
            ("[[pattern]]\nwidth = 640", "needs an id"),
            ("[[pattern]]\nid = \"../x\"", "must be 1 to 64"),
            ("[[pattern]]\nid = \"a\"\n[[pattern]]\nid = \"a\"", "number 2 ('a'): another device"),
            ("[[pattern]]\nid = \"a\"\nwidht = 640", "unknown field `widht`"),
            ("[[pattern]]\nid = \"a\"\nwidth = 1", "64 to 2048"),
            ("[[pattern]]\nid = 7", "string"),
            ("[[evk4]]\nid = \"a\"\nbiases = { diff_onn = 3 }", "diff_onn"),
            ("[[evk4]]\nid = \"a\"\nbiases = { diff_on = 3000 }", "diff_on"),
            ("[[davis346]]\nid = \"a\"\nexposure = 3", "unknown field `exposure`"),
            ("[[camera]]\nid = \"a\"\nrate_hz = 0.0", "0.1 to 1000"),
            ("[[trigger]]\nid = \"a\"\nrate_hz = 5000.0", "1000 pulses"),
            ("[[trigger]]\nid = \"a\"\nrate = 50", "unknown field `rate`"),
            (
                "[[evk4]]\nid = \"a\"\nserial = \"7\"\n[[evk4]]\nid = \"b\"\nserial = \"7\"",
                "'a' has the same serial = \"7\"",
            ),
            ("[[trigger]]\nid = \"a\"\nport = \"/dev/x\"\n[[trigger]]\nid = \"b\"\nport = \"/dev/x\"", "same port"),
            ("[[camera]]\nid = \"a\"\ncamera = \"c\"\n[[camera]]\nid = \"b\"\ncamera = \"c\"", "same camera"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(says) && error.contains("RIG.toml"), "{text}: {error}");
        }
    }
}
