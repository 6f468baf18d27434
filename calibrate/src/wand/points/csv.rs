//! Rows of a time and three pixels.

use std::path::Path;

use glam::DVec2;

use super::{super::Sighting, WandError, malformed, read_text};

/// Reads rows `t_ns, x1, y1, x2, y2, x3, y3`. A LED whose fields are empty was not seen; so was one whose two fields are -1,
/// if `minus_one` says so. `shift` is added to every coordinate. A first row that does not start with a number is a head.
pub fn read(path: &Path, separator: char, minus_one: bool, shift: f64) -> Result<Vec<Sighting>, WandError> {
    let text = read_text(path)?;
    let mut sightings = Vec::new();
    for (index, row) in text.lines().enumerate() {
        let row = row.trim();
        if row.is_empty() || row.starts_with('#') || (index == 0 && row.starts_with(char::is_alphabetic)) {
            continue;
        }
        let error = |what: String| malformed(path, Some(index + 1), what);
        let fields: Vec<&str> = row.split(separator).map(str::trim).collect();
        if fields.len() != 7 {
            let what = format!("{} fields where t_ns, x1, y1, x2, y2, x3, y3 were expected", fields.len());
            return Err(error(what));
        }
        let t_ns = fields[0].parse().map_err(|_| error(format!("'{}' is no time in whole nanoseconds", fields[0])))?;
        let mut leds = [None; 3];
        for (led, pair) in leds.iter_mut().zip(fields[1..].chunks_exact(2)) {
            if pair.iter().all(|field| field.is_empty()) {
                continue;
            }
            let number = |field: &str| match field.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(error(format!("'{field}' is no pixel coordinate"))),
            };
            let pixel = DVec2::new(number(pair[0])?, number(pair[1])?);
            if !(minus_one && pixel == DVec2::NEG_ONE) {
                *led = Some(pixel + shift);
            }
        }
        sightings.push(Sighting { t_ns, leds });
    }
    Ok(sightings)
}
