//! How warm a device is, where its driver can tell.

use super::Subject;
use crate::check::{Check, CheckName};

const TEMPERATURE: CheckName = CheckName::Temperature;
/// What a device in a room can have, degrees Celsius.
const PLAUSIBLE: std::ops::Range<f64> = -20.0..120.0;
/// Above this sensors are noisy, and cameras switch themselves off, degrees Celsius.
const HOT: f64 = 75.0;

pub fn temperature(subject: &Subject<'_>) -> Option<Check> {
    let reading =
        ["temperature_celsius", "temperature_c"].into_iter().find_map(|name| subject.entry.readings.get(name));
    let inertial =
        subject.recordings.iter().rev().find_map(|recorded| recorded.observed.events.as_ref()?.imu_celsius());
    let Some((celsius, of)) = reading.map(|c| (*c, "")).or(inertial.map(|c| (c, " (inertial unit)"))) else {
        return Some(Check::not_tested(TEMPERATURE, "its driver reads none"));
    };
    let found = format!("{celsius:.1} °C{of}");
    Some(if !PLAUSIBLE.contains(&celsius) {
        Check::warning(TEMPERATURE, found, "that cannot be: its reading is another than the driver takes it for")
    } else if celsius > HOT {
        Check::warning(TEMPERATURE, found, "give it air; a hot sensor is noisy")
    } else {
        Check::ok(TEMPERATURE, found)
    })
}
