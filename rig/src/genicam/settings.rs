//! What a camera is set to, in the order in which cameras take it, by whatever name its maker has for it; and what it has then.

use erfgs_scene::pixel::PixelFormat;
use serde_json::{Map, Value, json};

use super::{Features, GenicamConfig, GenicamError, pixel};
use crate::not_applied::NotApplied;

const EXPOSURE: [&str; 2] = ["ExposureTime", "ExposureTimeAbs"];
const GAIN: [&str; 3] = ["Gain", "GainAbs", "GainRaw"];
const BLACK_LEVEL: [&str; 3] = ["BlackLevel", "BlackLevelAbs", "BlackLevelRaw"];
const RATE: [&str; 2] = ["AcquisitionFrameRate", "AcquisitionFrameRateAbs"];
const RATE_ENABLE: [&str; 2] = ["AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled"];
const RESULTING_RATE: [&str; 3] = ["ResultingFrameRate", "ResultingFrameRateAbs", "AcquisitionResultingFrameRate"];
const READOUT: [&str; 3] = ["SensorReadoutTime", "ReadoutTime", "ReadoutTimeAbs"];
/// The selectors of a frame's start, the usual one first.
const FRAME_START: [&str; 3] = ["FrameStart", "FrameBurstStart", "AcquisitionStart"];
/// What a line shows while the sensor is exposed.
const STROBE_SOURCE: [&str; 3] = ["ExposureActive", "Expose", "Strobe"];
/// What is read back beside what was set, as the camera names it.
const RECORDED: [&str; 18] = [
    "PixelFormat",
    "ExposureAuto",
    "ExposureMode",
    "GainAuto",
    "BalanceWhiteAuto",
    "Gamma",
    "AcquisitionMode",
    "TriggerMode",
    "TriggerSource",
    "TriggerActivation",
    "TriggerDelay",
    "TriggerOverlap",
    "LineSource",
    "ChunkModeActive",
    "DeviceLinkThroughputLimit",
    "DeviceFirmwareVersion",
    "SensorShutterMode",
    "DeviceTemperature",
];

/// What becomes of a quantity that cameras set by themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
    /// It stays what it is.
    Hold,
    /// The camera sets it.
    Auto,
    /// It is set to a value.
    At(f64),
}

/// What a camera is to be set to.
#[derive(Clone, Debug)]
pub struct Wishes<'a> {
    /// Pixels.
    pub format: PixelFormat,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Frames a second; of a triggered camera, at most.
    pub rate_hz: f64,
    /// Exposure, µs.
    pub exposure_us: Wish,
    /// Gain, in the camera's units.
    pub gain: Wish,
    /// White balance: only held or left to the camera.
    pub white_balance: Wish,
    /// Whether each frame waits for a pulse.
    pub triggered: bool,
    /// The rest.
    pub more: &'a GenicamConfig,
}

/// Sets a camera, and gives what it has then. What it did not take goes to `missed`.
///
/// # Errors
/// If something without which the recording would be another cannot be set; the message says what would do.
pub fn apply(
    features: &mut Features,
    wishes: &Wishes<'_>,
    missed: &mut NotApplied,
) -> Result<Map<String, Value>, GenicamError> {
    stop(features);
    if wishes.more.reset {
        features.set_text("UserSetSelector", "Default")?;
        features.run("UserSetLoad")?;
        features.refresh();
    }
    set_region(features, wishes)?;
    switch_off_automatics(features, wishes, missed)?;
    switch_off_triggers(features)?;
    set_exposure(features, wishes, missed)?;
    set_rate(features, wishes, missed)?;
    if wishes.triggered {
        set_trigger(features, wishes.more)?;
    }
    set_strobe(features, &wishes.more.strobe_line)?;
    set_chunks(features, &wishes.more.chunks)?;
    if let Some(bytes) = wishes.more.throughput {
        if features.has("DeviceLinkThroughputLimitMode") {
            features.set_flag("DeviceLinkThroughputLimitMode", true)?;
        }
        set_in_range(features, "throughput", "DeviceLinkThroughputLimit", bytes as f64)?;
    }
    for (name, value) in &wishes.more.features {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        features.set_text(name, &text).map_err(|error| GenicamError::Setting {
            setting: format!("genicam.features.{name}"),
            value: text,
            reason: error.to_string(),
        })?;
    }
    features.refresh();
    read_back(features, wishes, missed)
}

/// Ends what another program may have left running; a camera that is not running may say no.
fn stop(features: &mut Features) {
    if let Err(error) = end(features) {
        tracing::debug!("{error}");
    }
}

/// Begins to acquire frames.
pub(super) fn begin(features: &mut Features) -> Result<(), GenicamError> {
    lock_format(features, true);
    features.run("AcquisitionStart")
}

/// Ends what was begun.
pub(super) fn end(features: &mut Features) -> Result<(), GenicamError> {
    let stopped = features.run("AcquisitionStop");
    lock_format(features, false);
    stopped
}

/// Tells the camera that its format is settled, or is not any more.
fn lock_format(features: &mut Features, locked: bool) {
    if features.has("TLParamsLocked")
        && let Err(error) = features.set_number("TLParamsLocked", f64::from(u8::from(locked)))
    {
        tracing::debug!("{error}");
    }
}

fn refuse(setting: &str, value: impl ToString, reason: impl Into<String>) -> GenicamError {
    GenicamError::Setting { setting: setting.to_owned(), value: value.to_string(), reason: reason.into() }
}

/// Sets a number that has to lie in the camera's range.
fn set_in_range(features: &mut Features, setting: &str, name: &str, value: f64) -> Result<(), GenicamError> {
    if let Some(([least, most], step)) = features.range(name) {
        let step = step.filter(|step| *step > 0.0);
        let off = step.is_some_and(|step| ((value - least) / step - ((value - least) / step).round()).abs() > 1e-6);
        if !(least..=most).contains(&value) || off {
            let steps = step.map_or_else(String::new, |step| format!(" in steps of {step}"));
            return Err(refuse(setting, value, format!("the camera takes {least} to {most}{steps} ({name})")));
        }
    }
    features.set_number(name, value).map_err(|error| refuse(setting, value, error.to_string()))
}

fn set_region(features: &mut Features, wishes: &Wishes<'_>) -> Result<(), GenicamError> {
    let offered = features.choices("PixelFormat");
    let name = pixel::names_of(wishes.format).find(|name| offered.iter().any(|offered| offered == name));
    let Some(name) = name else {
        let has: Vec<String> = offered.iter().map(|name| pixel::both_names(name)).collect();
        let reason =
            format!("the camera has {}", if has.is_empty() { "no PixelFormat".into() } else { has.join(", ") });
        return Err(refuse("format", wishes.format, reason));
    };
    features.set_text("PixelFormat", name)?;
    for name in ["BinningHorizontal", "BinningVertical", "DecimationHorizontal", "DecimationVertical"] {
        if features.is_settable(name) && features.number(name).is_ok_and(|now| now != 1.0) {
            features.set_number(name, 1.0)?;
        }
    }
    // At 0 first, since where the region may begin depends on how large it is, and the other way round.
    for name in ["OffsetX", "OffsetY"] {
        if features.is_settable(name) {
            features.set_number(name, 0.0)?;
        }
    }
    let [width, height] = wishes.size;
    let [x, y] = wishes.more.offset;
    for (setting, name, value) in [("width", "Width", width), ("height", "Height", height)] {
        set_in_range(features, setting, name, value.into())?;
    }
    for (setting, name, value) in [("genicam.offset", "OffsetX", x), ("genicam.offset", "OffsetY", y)] {
        if value > 0 {
            set_in_range(features, setting, name, value.into())?;
        }
    }
    Ok(())
}

/// Automatics that nobody asked for.
fn switch_off_automatics(
    features: &mut Features,
    wishes: &Wishes<'_>,
    missed: &mut NotApplied,
) -> Result<(), GenicamError> {
    let automatics = [
        ("exposure_us", "ExposureAuto", wishes.exposure_us),
        ("gain", "GainAuto", wishes.gain),
        ("white_balance_k", "BalanceWhiteAuto", wishes.white_balance),
        ("black_level", "BlackLevelAuto", Wish::Hold),
        ("rate_hz", "AcquisitionFrameRateAuto", Wish::Hold),
    ];
    for (setting, name, wish) in automatics {
        let auto = wish == Wish::Auto;
        if features.is_settable(name) {
            features.set_text(name, if auto { "Continuous" } else { "Off" })?;
        } else if auto {
            missed.because(&format!("{setting} = \"auto\""), "the camera has no automatic of it");
        }
    }
    // A curve of the camera's own would have to be known and taken back.
    for name in ["GammaEnable", "GammaEnabled"] {
        if features.is_settable(name) {
            return features.set_flag(name, false);
        }
    }
    if features.is_settable("Gamma") { features.set_number("Gamma", 1.0) } else { Ok(()) }
}

/// All triggers off: frame rate and exposure are locked with one that is on.
fn switch_off_triggers(features: &mut Features) -> Result<(), GenicamError> {
    for selector in features.choices("TriggerSelector") {
        features.set_text("TriggerSelector", &selector)?;
        if features.is_settable("TriggerMode") {
            features.set_text("TriggerMode", "Off")?;
        }
    }
    if features.is_settable("AcquisitionMode") {
        features.set_text("AcquisitionMode", "Continuous")?;
    }
    Ok(())
}

fn set_exposure(features: &mut Features, wishes: &Wishes<'_>, missed: &mut NotApplied) -> Result<(), GenicamError> {
    if features.is_settable("ExposureMode") {
        features.set_text("ExposureMode", "Timed")?;
    }
    for (selector, all) in [("GainSelector", ["All", "AnalogAll"]), ("BlackLevelSelector", ["All", "AnalogAll"])] {
        let choices = features.choices(selector);
        if let Some(all) = all.into_iter().find(|all| choices.iter().any(|choice| choice == all)) {
            features.set_text(selector, all)?;
        }
    }
    let black_level = wishes.more.black_level.map_or(Wish::Hold, Wish::At);
    let quantities = [
        ("exposure_us", &EXPOSURE[..], wishes.exposure_us),
        ("gain", &GAIN, wishes.gain),
        ("genicam.black_level", &BLACK_LEVEL, black_level),
    ];
    for (setting, names, wish) in quantities {
        let Wish::At(value) = wish else { continue };
        let Some(name) = features.first(names) else {
            return Err(refuse(setting, value, "the camera has no such feature; leave it out"));
        };
        set_in_range(features, setting, name, value)?;
        features.refresh();
        // A camera takes the nearest value that it has; farther off, something is in the way.
        if let Ok(now) = features.number(name)
            && (now - value).abs() > (0.01 * value.abs()).max(1.0)
        {
            missed.compare(setting, value, now);
        }
    }
    Ok(())
}

fn set_rate(features: &mut Features, wishes: &Wishes<'_>, missed: &mut NotApplied) -> Result<(), GenicamError> {
    // With a trigger, a limit of the rate swallows pulses.
    let enable = RATE_ENABLE.into_iter().find(|name| features.is_settable(name));
    if let Some(name) = enable {
        features.set_flag(name, !wishes.triggered)?;
    }
    if wishes.triggered {
        return Ok(());
    }
    let Some(name) = features.first(&RATE) else {
        missed.because(&format!("rate_hz = {}", wishes.rate_hz), "the camera has no rate that can be set");
        return Ok(());
    };
    set_in_range(features, "rate_hz", name, wishes.rate_hz)
}

fn set_trigger(features: &mut Features, config: &GenicamConfig) -> Result<(), GenicamError> {
    let selectors = features.choices("TriggerSelector");
    match FRAME_START.into_iter().find(|start| selectors.iter().any(|selector| selector == start)) {
        Some(start) => features.set_text("TriggerSelector", start)?,
        None if selectors.is_empty() => {}
        None => {
            let reason = format!("the camera has no trigger of a frame; it has {}", selectors.join(", "));
            return Err(refuse("triggered", true, reason));
        }
    }
    let sources = features.choices("TriggerSource");
    if !sources.contains(&config.trigger_line) {
        let reason = format!("name the input that the trigger comes in at; the camera has {}", sources.join(", "));
        return Err(refuse("genicam.trigger_line", format!("{:?}", config.trigger_line), reason));
    }
    features.set_text("TriggerSource", &config.trigger_line)?;
    if features.is_settable("TriggerActivation") {
        features.set_text("TriggerActivation", &config.trigger_activation)?;
    }
    // Without it the next exposure waits for the end of the readout, at half the rate.
    if features.is_settable("TriggerOverlap") && features.choices("TriggerOverlap").iter().any(|c| c == "ReadOut") {
        features.set_text("TriggerOverlap", "ReadOut")?;
    }
    if features.is_settable("TriggerDelay") {
        let least = features.range("TriggerDelay").map_or(0.0, |([least, _], _)| least.max(0.0));
        features.set_number("TriggerDelay", least)?;
    }
    features.set_text("TriggerMode", "On")
}

/// An output that is active while the sensor is exposed.
fn set_strobe(features: &mut Features, line: &str) -> Result<(), GenicamError> {
    if line.is_empty() {
        return Ok(());
    }
    let setting = "genicam.strobe_line";
    features.set_text("LineSelector", line).map_err(|error| refuse(setting, line, error.to_string()))?;
    if features.is_settable("LineMode") {
        features.set_text("LineMode", "Output").map_err(|error| refuse(setting, line, error.to_string()))?;
    }
    let sources = features.choices("LineSource");
    let Some(source) = STROBE_SOURCE.into_iter().find(|source| sources.iter().any(|has| has == source)) else {
        let reason = format!("the line cannot show the exposure; it can show {}", sources.join(", "));
        return Err(refuse(setting, line, reason));
    };
    features.set_text("LineSource", source)?;
    if features.is_settable("LineInverter") {
        features.set_flag("LineInverter", false)?;
    }
    Ok(())
}

fn set_chunks(features: &mut Features, chunks: &[String]) -> Result<(), GenicamError> {
    if !features.has("ChunkModeActive") {
        return match chunks {
            [] => Ok(()),
            chunks => Err(refuse("genicam.chunks", chunks.join(", "), "the camera measures nothing of its frames")),
        };
    }
    features.set_flag("ChunkModeActive", !chunks.is_empty())?;
    if chunks.is_empty() {
        return Ok(());
    }
    let offered = features.choices("ChunkSelector");
    if let Some(chunk) = chunks.iter().find(|chunk| !offered.contains(chunk)) {
        return Err(refuse("genicam.chunks", chunk, format!("the camera has {}", offered.join(", "))));
    }
    for name in &offered {
        features.set_text("ChunkSelector", name)?;
        // The image is a chunk that some cameras do not let be switched off.
        if features.is_settable("ChunkEnable") && name != "Image" {
            features.set_flag("ChunkEnable", chunks.contains(name))?;
        }
    }
    Ok(())
}

/// What the camera has now, and whether that can be what was asked for.
fn read_back(
    features: &Features,
    wishes: &Wishes<'_>,
    missed: &mut NotApplied,
) -> Result<Map<String, Value>, GenicamError> {
    let mut settings = Map::new();
    let mut tell = |setting: &str, names: &[&str]| {
        let value = features.first(names).and_then(|name| features.number(name).ok());
        settings.extend(value.map(|value| (setting.to_owned(), json!(value))));
        value
    };
    let exposure_us = tell("exposure_us", &EXPOSURE);
    tell("gain", &GAIN);
    tell("black_level", &BLACK_LEVEL);
    // With a trigger it is a limit that is off.
    let rate_hz = if wishes.triggered { None } else { tell("rate_hz", &RATE) };
    let most_hz = tell("most_rate_hz", &RESULTING_RATE);
    let readout_us = tell("readout_us", &READOUT);
    tell("region_x", &["OffsetX"]);
    tell("region_y", &["OffsetY"]);
    if wishes.triggered {
        settings.insert("rate_hz".into(), json!(wishes.rate_hz));
    }
    for (setting, name) in [("exposure_us_locked", "ExposureAuto"), ("gain_locked", "GainAuto")] {
        let locked = !features.has(name) || features.text(name).is_ok_and(|now| now == "Off");
        settings.insert(setting.into(), json!(locked));
    }
    let names = RECORDED.iter().filter(|name| features.has(name));
    let values: Map<String, Value> =
        names.filter_map(|name| Some(((*name).to_owned(), features.value(name)?))).collect();
    settings.insert("genicam".into(), json!(values));
    if !wishes.more.strobe_line.is_empty() {
        settings.insert("strobe_line".into(), json!(wishes.more.strobe_line));
        settings.insert("strobe_to".into(), json!(wishes.more.strobe_to));
    }
    let period_us = 1e6 / wishes.rate_hz;
    if let Some(exposure_us) = exposure_us.filter(|exposure_us| *exposure_us > period_us) {
        let reason =
            format!("at {} frames a second there is time for {period_us:.0} µs; lower rate_hz", wishes.rate_hz);
        return Err(refuse("exposure_us", exposure_us, reason));
    }
    // What overlaps is in the camera's own figure, if it has one.
    let overlaps = features.text("TriggerOverlap").is_ok_and(|overlap| overlap != "Off") || !wishes.triggered;
    if let (Some(exposure_us), Some(readout_us), false, None) = (exposure_us, readout_us, overlaps, most_hz)
        && exposure_us + readout_us > period_us
    {
        let reason = format!(
            "exposure and readout take {:.0} µs together, and a pulse comes every {period_us:.0} µs: every second would be \
             ignored; shorten the exposure, lower the rate, or read fewer rows",
            exposure_us + readout_us
        );
        return Err(refuse("rate_hz", wishes.rate_hz, reason));
    }
    if let Some(most_hz) = most_hz.filter(|most_hz| *most_hz < 0.99 * wishes.rate_hz) {
        let reason = format!(
            "with this exposure, region, format and bandwidth the camera gives {most_hz:.2} frames a second at most: \
             shorten the exposure, read fewer rows, or raise its throughput and the packets' size"
        );
        return Err(refuse("rate_hz", wishes.rate_hz, reason));
    }
    if let Some(rate_hz) = rate_hz.filter(|rate| (rate - wishes.rate_hz).abs() > 0.01 * wishes.rate_hz) {
        missed.compare("rate_hz", wishes.rate_hz, rate_hz);
    }
    Ok(settings)
}

/// What the camera measured of the frame whose chunks are attached: names as in `genicam.chunks`, and values.
#[must_use]
pub fn chunk_values(features: &Features, chunks: &[String]) -> Vec<(String, f64)> {
    let named = chunks.iter().filter_map(|chunk| {
        let name = format!("Chunk{chunk}");
        Some((chunk.clone(), features.number(&name).ok()?))
    });
    named.collect()
}
