//! Sizes of pictures and sensors.

use super::{Implausible, PIXELS, SENSOR, SIDE};

/// A width and height in pixels that are believed: whole sides from 1 to 65535, and no more than 500 million pixels together.
///
/// # Errors
/// [`Implausible`]: a side, or their product.
pub fn check_size(size: [u32; 2]) -> Result<[u32; 2], Implausible> {
    let sides = size.map(f64::from);
    SIDE.check_all(sides)?;
    PIXELS.check(sides[0] * sides[1])?;
    Ok(size)
}

/// The same of a sensor of events, which has 150 million pixels at most. A side of 0 says nothing of it.
///
/// # Errors
/// [`Implausible`]: a side, or their product.
pub fn check_sensor(size: [u32; 2]) -> Result<[u32; 2], Implausible> {
    let sides = size.map(|side| f64::from(side.max(1)));
    SIDE.check_all(sides)?;
    SENSOR.check(sides[0] * sides[1])?;
    Ok(size)
}
