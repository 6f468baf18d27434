//! Opened, the right one, and set as asked.

use erfgs_recorder::DeviceSettings;
use serde_json::Value;

use super::Subject;
use crate::check::{Check, CheckName};

const OPENED: CheckName = CheckName::Opened;
const SERIAL: CheckName = CheckName::SerialNumber;
const SETTINGS: CheckName = CheckName::Settings;
const WARNINGS: CheckName = CheckName::DriverWarnings;
/// Warnings that are repeated in full.
const MAX_WARNINGS: usize = 4;

/// A device that cannot be opened. Its driver says what is wrong in a sentence, and what to do in the next.
pub fn refused(reason: &str) -> Check {
    let (wrong, remedy) = reason.split_once(". ").unwrap_or((reason, "`erfgs devices` lists what is plugged in"));
    Check::fault(OPENED, format!("cannot be opened: {wrong}"), remedy)
}

pub fn opened(subject: &Subject<'_>) -> Check {
    let description = subject.description;
    let firmware = ["firmware", "firmware_version"].into_iter().find_map(|name| description.settings.get(name));
    let firmware = firmware.map(|value| format!(", firmware {}", plain(value))).unwrap_or_default();
    Check::ok(OPENED, format!("{}{firmware}", description.model))
}

fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

pub fn serial_number(subject: &Subject<'_>) -> Check {
    let has = subject.description.serial.as_str();
    let asked = match &subject.entry.device.settings {
        DeviceSettings::Evk4(config) => config.serial.as_str(),
        DeviceSettings::Davis346(config) => config.serial.as_str(),
        DeviceSettings::Camera(config) => config.camera.as_str(),
        DeviceSettings::Trigger(_) => return Check::not_tested(SERIAL, "trigger boards have no serial number"),
        DeviceSettings::Pattern(_) => return Check::not_tested(SERIAL, "a built-in pattern has no serial number"),
    };
    match (asked, has) {
        (_, "") => Check::not_tested(SERIAL, "the device tells no serial number"),
        ("", has) => Check::ok(SERIAL, format!("{has}; the rig asks for none")),
        (asked, has) if asked == has => Check::ok(SERIAL, has),
        (asked, has) if matches!(subject.entry.device.settings, DeviceSettings::Camera(_)) => {
            Check::ok(SERIAL, format!("{has}, chosen as \"{asked}\""))
        }
        (asked, has) => Check::fault(
            SERIAL,
            format!("{has}, and the rig asks for {asked}"),
            "plug in the device that the rig asks for, or write its serial number into the rig's file",
        ),
    }
}

/// Drivers list what a device did not take under `not_applied`.
pub fn settings(subject: &Subject<'_>) -> Check {
    let missed: Vec<String> = match subject.description.settings.get("not_applied") {
        None | Some(Value::Null) => Vec::new(),
        Some(Value::Array(list)) => list.iter().map(plain).collect(),
        Some(other) => vec![plain(other)],
    };
    if missed.is_empty() {
        return Check::ok(SETTINGS, "all settings read back as asked for");
    }
    let found = format!("not accepted: {}", missed.join("; "));
    Check::warning(SETTINGS, found, "give a value that the device takes, or leave the setting out")
}

pub fn driver_warnings(subject: &Subject<'_>) -> Check {
    let warnings = &subject.entry.warnings;
    if subject.recordings.is_empty() {
        return Check::not_tested(WARNINGS, "it was not recorded");
    }
    if warnings.is_empty() {
        return Check::ok(WARNINGS, "none");
    }
    let more = warnings.len().saturating_sub(MAX_WARNINGS);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    Check::warning(WARNINGS, warnings[..warnings.len().min(MAX_WARNINGS)].join("; ") + &more, "")
}
