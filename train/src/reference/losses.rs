//! `f64` twins of the loss kernels.

use glam::DVec3;

use crate::{
    config::{EarlConfig, Norm, Quantise},
    losses::{Sensor, level},
};
use erfgs_splat::{raster::CORE_STRIDE, reference::raster};

/// The luma weights of v2e, OpenCV and ITU-R BT.601.
pub const LUMA: [f64; 3] = [0.299, 0.587, 0.114];

/// The luminance weights of sRGB's primaries, for linear light (IEC 61966-2-1).
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// sRGB to linear light.
#[must_use]
pub fn to_linear(x: f64) -> f64 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// Linear light to sRGB.
#[must_use]
pub fn to_display(x: f64) -> f64 {
    if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The rendered exposure: the mean of renderings, in display or in linear light, as a display colour.
#[must_use]
pub fn exposure(images: &[Vec<[f64; 3]>], linear_light: bool) -> Vec<[f64; 3]> {
    let weight = 1.0 / images.len() as f64;
    let pixels = images.first().map_or(0, Vec::len);
    (0..pixels)
        .map(|pixel| {
            std::array::from_fn(|channel| {
                let values = images.iter().map(|image| image[pixel][channel]);
                if linear_light {
                    to_display(values.map(|x| weight * to_linear(x)).sum())
                } else {
                    values.map(|x| weight * x).sum()
                }
            })
        })
        .collect()
}

/// `sum |gain * exposure + offset - frame|` over channels and those pixels that are not left out.
#[must_use]
pub fn photometric(
    images: &[Vec<[f64; 3]>],
    [gain, offset]: [[f64; 3]; 2],
    frame: &[Option<[f64; 3]>],
    linear_light: bool,
) -> f64 {
    let exposure = exposure(images, linear_light);
    let compared = exposure.iter().zip(frame).filter_map(|(shown, taken)| Some((shown, taken.as_ref()?)));
    compared.flat_map(|(a, b)| (0..3).map(move |c| (gain[c] * a[c] + offset[c] - b[c]).abs())).sum()
}

/// Lin-log intensity of a display colour.
#[must_use]
pub fn lin_log(colour: &[f64; 3], sensor: &Sensor) -> f64 {
    let sum = |weights: [f64; 3], light: fn(f64) -> f64| -> f64 {
        colour.iter().zip(weights).map(|(&value, weight)| weight * light(value)).sum()
    };
    let x = 255.0 * if sensor.linear_light { sum(LUMINANCE, to_linear) } else { sum(LUMA, |value| value) };
    let threshold = f64::from(sensor.lin_log);
    if x <= threshold { x * threshold.ln() / threshold } else { x.ln() }
}

/// The sum of the event loss over pixels.
#[must_use]
pub fn event(before: &[[f64; 3]], after: &[[f64; 3]], count: &[f64], sensor: &Sensor, config: &EarlConfig) -> f64 {
    let each = before.iter().zip(after).zip(count).map(|((before, after), &events)| {
        let change = (lin_log(after, sensor) - lin_log(before, sensor)) / f64::from(sensor.threshold);
        let error = match config.quantise {
            Quantise::TruncateSte => change.trunc() - events,
            Quantise::DeadZone => ((change - events).abs() - 1.0).max(0.0),
            Quantise::None => change - events,
        };
        let weight = if config.confidence { 1.0 / events.abs().max(1.0) } else { 1.0 };
        weight
            * match config.norm {
                Norm::L1 => error.abs(),
                Norm::L2 => error * error,
            }
    });
    each.sum()
}

/// What an error of the event loss costs where a rendering has this colour.
#[must_use]
pub fn event_cost(colour: &[f64; 3], sensor: &Sensor) -> f64 {
    const STEP: f64 = 1e-6;
    let slope =
        (lin_log(&colour.map(|c| c + STEP), sensor) - lin_log(&colour.map(|c| c - STEP), sensor)) / (2.0 * STEP);
    let middle = f64::from(level::slope(sensor));
    middle / slope.max(f64::from(level::FLATTEST) * middle)
}

/// The event loss of one pixel's rendering, where an error costs one, against the count that its level and its events make, and the level thereafter, which was
/// seen in `seen` renderings before.
#[must_use]
pub fn event_level(colour: &[f64; 3], count: f64, [level, seen]: [f64; 2], sensor: &Sensor) -> (f64, f64) {
    let away = lin_log(colour, sensor) / f64::from(sensor.threshold) - count - level;
    if seen < f64::from(level::FIRST) {
        return (0.0, level + away / (seen + 1.0));
    }
    let [rate, dead] = [level::RATE, level::DEAD].map(|units| f64::from(units) / f64::from(sensor.worth()));
    ((away.abs() - dead).max(0.0), level + away.clamp(-rate, rate))
}

/// The colours of deformed Gaussians (`core`: rows of [`CORE_STRIDE`], `sh`: as many rows) as a camera at `centre` sees
/// them, clamped at 0.
#[must_use]
pub fn colours(core: &[f64], sh: &[f64], centre: [f64; 3], degree: u32) -> Vec<[f64; 3]> {
    let rows = core.len() / CORE_STRIDE as usize;
    let stride = sh.len() / rows.max(1);
    let row = |row: usize| {
        let mean = DVec3::from_slice(&core[row * CORE_STRIDE as usize..]);
        let direction = (mean - DVec3::from(centre)).normalize();
        raster::colour(&sh[row * stride..][..stride], degree, direction).max(DVec3::ZERO).to_array()
    };
    (0..rows).map(row).collect()
}

/// The colour regulariser: the mean of `|after - before|` over Gaussians and channels.
#[must_use]
pub fn colour(before: &[[f64; 3]], after: &[[f64; 3]]) -> f64 {
    let sum: f64 = before.iter().zip(after).flat_map(|(a, b)| (0..3).map(move |c| (b[c] - a[c]).abs())).sum();
    sum / (3 * after.len().max(1)) as f64
}
