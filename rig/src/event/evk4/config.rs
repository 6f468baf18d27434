//! Settings of an EVK4.

use serde::{Deserialize, Serialize};

use super::{HEIGHT, WIDTH};
use crate::event::{EventError, StreamConfig, Window};

/// Settings of an EVK4. All have defaults, which leave the sensor as its maker trimmed it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Evk4Config {
    /// Serial number, as `erfgs devices` shows it. Empty: the only EVK4 there is.
    pub serial: String,
    /// Format of the events.
    pub format: Format,
    /// Offsets of the biases from the values the unit was trimmed to.
    pub biases: BiasOffsets,
    /// Part of the image that events come from; all of it by default.
    pub region: Option<Region>,
    /// Pixels (column, row) that must stay silent: at most 64.
    pub masked_pixels: Vec<[u16; 2]>,
    /// Which row the registers of `region` and `masked_pixels` call their first. The maker's software and another
    /// driver disagree; if a mask acts mirrored on your camera, change this.
    pub mask_rows: MaskRows,
    /// Event-rate control: the sensor drops events above a rate. Off by default.
    pub rate_limit: Option<RateLimit>,
    /// Filter for flickering light. Off by default.
    pub anti_flicker: Option<AntiFlicker>,
    /// Filter for trails and isolated events. Off by default.
    pub trail_filter: Option<TrailFilter>,
    /// Whether edges at the trigger input are in the event stream.
    pub external_trigger: TriggerInput,
    /// Role in a chain of cameras that share a clock.
    pub sync: SyncRole,
    /// How data is fetched.
    pub stream: StreamConfig,
}

/// Format of the events of an EVK4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// EVT 3.0, 16-bit words: smallest where many pixels of a row change together.
    #[default]
    Evt3,
    /// EVT 2.1, 64-bit words whose halves the IMX636 sends swapped.
    Evt21,
}

/// Offsets from the unit's factory trim, in steps of the bias DAC. Positive contrast offsets make the sensor less
/// sensitive. Recommended ranges (OpenEB): fo -35..55, hpf 0..120, diff_on -85..140, diff -25..23, diff_off -35..190,
/// refr -20..235.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BiasOffsets {
    /// Low-pass cut-off of the photoreceptor's follower: -150 to 200; higher is faster.
    pub fo: i32,
    /// High-pass cut-off: 0 to 255; higher forgets slow changes.
    pub hpf: i32,
    /// Contrast threshold of rising intensity: -150 to 200; higher is less sensitive.
    pub diff_on: i32,
    /// Reference of both thresholds: -150 to 200. Leave it at 0.
    pub diff: i32,
    /// Contrast threshold of falling intensity: -150 to 200; higher is less sensitive.
    pub diff_off: i32,
    /// Refractory period: -50 to 255; higher is shorter.
    pub refr: i32,
}

/// Part of the image, as rows and columns: several windows give every crossing of their rows with their columns.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Whether the windows are kept or silenced.
    #[serde(default)]
    pub mode: RegionMode,
    /// The windows, pixels.
    pub windows: Vec<Window>,
}

/// What happens to the windows of a region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RegionMode {
    /// Events come from the windows only.
    #[default]
    Keep,
    /// Events come from everywhere else.
    Silence,
}

/// How registers count rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MaskRows {
    /// From the top, as OpenEB writes them.
    #[default]
    FromTop,
    /// From the bottom, as the neuromorphic-drivers crate writes them.
    FromBottom,
}

/// Event-rate control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateLimit {
    /// Events a second that pass, on average over `period_us`. At most 640,000 a period.
    pub events_per_second: u64,
    /// Period over which events are counted, 1 to 1023 µs.
    #[serde(default = "default_period")]
    pub period_us: u32,
}

fn default_period() -> u32 {
    200
}

/// The filter for flickering light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AntiFlicker {
    /// What happens to events whose frequency is within the band.
    pub mode: AntiFlickerMode,
    /// Lower end of the band, 50 to 520 Hz.
    pub low_hz: u32,
    /// Upper end of the band, 50 to 520 Hz.
    pub high_hz: u32,
    /// Part of a period that the light is on, above 0 to 100 %.
    pub duty_cycle_percent: f64,
}

/// What the flicker filter does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AntiFlickerMode {
    /// Events within the band are dropped.
    #[default]
    BandStop,
    /// Only events within the band pass.
    BandPass,
}

impl Default for AntiFlicker {
    fn default() -> Self {
        Self { mode: AntiFlickerMode::BandStop, low_hz: 50, high_hz: 520, duty_cycle_percent: 50.0 }
    }
}

/// The filter for trails and isolated events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrailFilter {
    /// Which events are dropped.
    pub kind: TrailKind,
    /// Time between two events of a pixel and polarity that counts, 1 to 100 ms.
    pub threshold_ms: u32,
}

/// Which events the trail filter drops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrailKind {
    /// Spatio-temporal contrast: keeps the second event of a burst only.
    StcCutTrail,
    /// Spatio-temporal contrast: keeps every event of a burst but the first.
    StcKeepTrail,
    /// Keeps the first event of a burst only.
    Trail,
}

/// Whether edges at the trigger input are recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TriggerInput {
    /// Both edges are in the event stream, channel 0.
    #[default]
    On,
    /// Edges are ignored.
    Off,
}

/// Role in a chain of cameras that share a clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SyncRole {
    /// Own clock.
    #[default]
    Standalone,
    /// Own clock, driven out of the sync connector (1 MHz).
    Master,
    /// The clock of the sync connector; started before the master.
    Slave,
}

impl Evk4Config {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`EventError::Setting`] names the first value out of range.
    pub fn validate(&self) -> Result<(), EventError> {
        let check = EventError::check::<i64>;
        for (name, value, allowed) in self.biases.entries() {
            check(&format!("biases.{name}"), value.into(), i64::from(*allowed.start())..=i64::from(*allowed.end()))?;
        }
        if let Some(region) = &self.region {
            if region.windows.is_empty() {
                return Err(EventError::setting("region.windows", "[]", "one window or more"));
            }
            for window in &region.windows {
                check("region.windows.width", window.width.into(), 1..=WIDTH.into())?;
                check("region.windows.height", window.height.into(), 1..=HEIGHT.into())?;
                check("region.windows.x", window.x.into(), 0..=(WIDTH - window.width).into())?;
                check("region.windows.y", window.y.into(), 0..=(HEIGHT - window.height).into())?;
            }
        }
        check("masked_pixels (how many)", i64::try_from(self.masked_pixels.len()).unwrap_or(i64::MAX), 0..=64)?;
        for &[x, y] in &self.masked_pixels {
            check("masked_pixels (column)", x.into(), 0..=i64::from(WIDTH) - 1)?;
            check("masked_pixels (row)", y.into(), 0..=i64::from(HEIGHT) - 1)?;
        }
        if let Some(limit) = &self.rate_limit {
            check("rate_limit.period_us", limit.period_us.into(), 1..=1023)?;
            let most = 640_000 * 1_000_000 / i64::from(limit.period_us);
            check(
                "rate_limit.events_per_second",
                i64::try_from(limit.events_per_second).unwrap_or(i64::MAX),
                0..=most,
            )?;
        }
        if let Some(filter) = &self.anti_flicker {
            check("anti_flicker.high_hz", filter.high_hz.into(), 50..=520)?;
            check("anti_flicker.low_hz", filter.low_hz.into(), 50..=filter.high_hz.into())?;
            if !(filter.duty_cycle_percent > 0.0 && filter.duty_cycle_percent <= 100.0) {
                let allowed = "above 0 up to 100";
                return Err(EventError::setting("anti_flicker.duty_cycle_percent", filter.duty_cycle_percent, allowed));
            }
        }
        if let Some(filter) = &self.trail_filter {
            check("trail_filter.threshold_ms", filter.threshold_ms.into(), 1..=100)?;
        }
        self.stream.validate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_table_is_the_default() {
        assert_eq!(toml::from_str::<Evk4Config>("").unwrap(), Evk4Config::default());
        Evk4Config::default().validate().unwrap();
    }

    #[test]
    fn a_full_table_reads_and_writes_back() {
        let text = r#"
            serial = "00051234"
            format = "evt21"
            masked_pixels = [[3, 4], [1279, 719]]
            external_trigger = "off"
            sync = "slave"
            biases = { diff_on = 20, diff_off = -10 }
            region = { mode = "silence", windows = [{ x = 0, y = 0, width = 64, height = 720 }] }
            rate_limit = { events_per_second = 20000000 }
            anti_flicker = { low_hz = 90, high_hz = 110 }
            trail_filter = { kind = "stc-keep-trail", threshold_ms = 10 }
            stream = { transfers = 8 }
        "#;
        let config: Evk4Config = toml::from_str(text).unwrap();
        config.validate().unwrap();
        assert_eq!(config.rate_limit.unwrap().period_us, 200);
        let again: Evk4Config = toml::from_str(&toml::to_string(&config).unwrap()).unwrap();
        assert_eq!(again, config);
    }

    #[test]
    fn unknown_fields_and_values_out_of_range_are_refused() {
        assert!(toml::from_str::<Evk4Config>("bias_diff_on = 3").is_err());
        assert!(toml::from_str::<Evk4Config>("biases = { on = 3 }").is_err());
        for (text, named) in [
            ("biases = { diff_on = 201 }", "biases.diff_on"),
            ("biases = { hpf = -1 }", "biases.hpf"),
            ("masked_pixels = [[1280, 0]]", "masked_pixels"),
            ("region = { windows = [{ x = 1, y = 0, width = 1280, height = 1 }] }", "region.windows.x"),
            ("region = { windows = [] }", "region.windows"),
            ("rate_limit = { events_per_second = 9000000000 }", "rate_limit.events_per_second"),
            ("anti_flicker = { low_hz = 200, high_hz = 100 }", "anti_flicker.low_hz"),
            ("anti_flicker = { duty_cycle_percent = 0.0 }", "duty_cycle"),
            ("trail_filter = { kind = \"trail\", threshold_ms = 0 }", "threshold_ms"),
            ("stream = { transfers = 1 }", "stream.transfers"),
            ("stream = { transfer_bytes = 1000 }", "stream.transfer_bytes"),
        ] {
            let error = toml::from_str::<Evk4Config>(text).unwrap().validate().unwrap_err().to_string();
            assert!(error.contains(named) && error.contains("allowed"), "{text}: {error}");
        }
    }
}
