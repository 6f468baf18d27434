//! Temperature and illumination of the sensor.
//!
//! Source: OpenEB 5.1.1, `imx636_tz_device.cpp` and `imx636_registermap.h`.

use std::time::Duration;

use super::board::Board;
use crate::event::EventError;

const LIGHT_CONTROL: u32 = 0x000C;
const LIGHT: u32 = 0x0010;
const ADC_CONTROL: u32 = 0x004C;
const ADC_STATUS: u32 = 0x0050;
const ADC_SETTINGS: u32 = 0x0054;
const TEMPERATURE_CONTROL: u32 = 0x005C;
const MIRROR_CONTROL: u32 = 0x0074;

const ADC_ON: u32 = 1;
const ADC_CLOCK: u32 = 1 << 1;
const ADC_START: u32 = 1 << 2;
const ADC_DONE: u32 = 1 << 11;
const ADC_TEMPERATURE: u32 = 1 << 12;

/// Switches the thermometer and the light meter on.
pub(super) fn enable(board: &Board) -> Result<(), EventError> {
    let pause = |microseconds| board.transport.wait(Duration::from_micros(microseconds));
    board.change(ADC_CONTROL, ADC_ON, ADC_ON)?;
    board.change(ADC_CONTROL, ADC_CLOCK, ADC_CLOCK)?;
    board.change(ADC_SETTINGS, 1 << 1, 1 << 1)?;
    pause(100);
    board.change(TEMPERATURE_CONTROL, 1 << 1, 1 << 1)?;
    board.change(TEMPERATURE_CONTROL, 1, 1)?;
    pause(100);
    board.change(ADC_CONTROL, ADC_CLOCK, 0)?;
    for bit in [1, 1 << 1] {
        board.change(MIRROR_CONTROL, bit, bit)?;
        pause(20);
    }
    pause(1000);
    for bit in [1, 1 << 1, 1 << 2] {
        board.change(LIGHT_CONTROL, bit, bit)?;
        pause(1000);
    }
    Ok(())
}

/// Degrees Celsius of a reading of the converter.
fn celsius(reading: u32) -> f64 {
    0.19 * f64::from(reading & 0x3FF) - 56.0
}

/// Temperature of the sensor, degrees Celsius; `None` if the converter does not finish.
pub(super) fn temperature(board: &Board) -> Result<Option<f64>, EventError> {
    board.change(ADC_CONTROL, ADC_CLOCK, ADC_CLOCK)?;
    board.change(ADC_SETTINGS, ADC_TEMPERATURE, ADC_TEMPERATURE)?;
    board.change(ADC_CONTROL, ADC_START, ADC_START)?;
    let mut found = None;
    for _ in 0..5 {
        let status = board.read(ADC_STATUS)?;
        if status & ADC_DONE != 0 {
            found = Some(celsius(status));
            break;
        }
    }
    board.change(ADC_CONTROL, ADC_CLOCK, 0)?;
    Ok(found)
}

/// Illuminance of a count of the light meter, lux.
fn lux(reading: u32) -> Option<f64> {
    let microseconds = f64::from(reading & 0x7FF_FFFF) / 100.0;
    (microseconds > 0.0).then(|| 10_f64.powf(3.5 - (microseconds * 0.37).log10()))
}

/// Illuminance at the sensor, lux; `None` while the meter has no valid count.
pub(super) fn illuminance(board: &Board) -> Result<Option<f64>, EventError> {
    for _ in 0..10 {
        let reading = board.read(LIGHT)?;
        if reading & 1 << 29 != 0 {
            return Ok(lux(reading));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_have_the_makers_units() {
        assert!((celsius(500) - 39.0).abs() < 1e-9);
        // A count of 270.27 µs is 100 times the 2.7027 µs that the formula gives 3162 lux.
        assert!((lux(27_027).unwrap() - 31.62).abs() < 0.01);
        assert_eq!(lux(0), None);
    }
}
