use erfgs_scene::pixel::PixelFormat;
use erfgs_scene::pixel::{RawLook, check_size};
#[cfg(target_os = "linux")]
use erfgs_session::source::{Encoding, names};
use serde::{Deserialize, Serialize};

use super::FrameError;
#[cfg(target_os = "linux")]
use crate::genicam::{GenicamConfig, pixel};

/// An RGB camera's table in `RIG.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FrameConfig {
    /// Name within the rig: letters, digits, `-` and `_`.
    pub id: String,
    /// Which camera: its serial number, the place where it is plugged in (`usb-0000:00:14.0-2`), its node
    /// (`/dev/video0`) or its name, as `erfgs devices` lists them. Empty: the only camera there is. Only serial number
    /// and place are sure to mean the same camera after it was unplugged.
    pub camera: String,
    /// How it is read.
    pub backend: Backend,
    /// What it sends.
    #[serde(deserialize_with = "super::format::deserialize")]
    pub format: PixelFormat,
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Frames a second. A triggered camera takes the trigger's rate; give at least that.
    pub rate_hz: f64,
    /// Exposure time, µs.
    pub exposure_us: Lock,
    /// Gain, in the camera's own units.
    pub gain: Lock,
    /// White balance, kelvin.
    pub white_balance_k: Lock,
    /// Focus, in the camera's own units. An autofocus that moves spoils the calibration.
    pub focus: Lock,
    /// What grey and Bayer frames look like; goes into the recording, and changes no frame.
    pub raw: Option<RawLook>,
    /// Whether its shutter waits for the trigger board. Then no frame for a long time is no fault.
    pub triggered: bool,
    /// Frames that the kernel may hold until we take them.
    pub buffers: u32,
    /// After so many milliseconds without a frame a camera that is not triggered counts as lost.
    pub timeout_ms: u32,
    /// What machine-vision cameras (`backend = "gige"` or `"u3v"`) have beyond others.
    #[cfg(target_os = "linux")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub genicam: Option<GenicamConfig>,
}

impl Default for FrameConfig {
    fn default() -> Self {
        Self {
            id: "camera".into(),
            camera: String::new(),
            backend: Backend::Auto,
            format: PixelFormat::Mjpeg,
            width: 1920,
            height: 1080,
            rate_hz: 30.0,
            exposure_us: Lock::default(),
            gain: Lock::default(),
            white_balance_k: Lock::default(),
            focus: Lock::default(),
            raw: None,
            triggered: false,
            buffers: 8,
            timeout_ms: 2000,
            #[cfg(target_os = "linux")]
            genicam: None,
        }
    }
}

impl FrameConfig {
    /// Looks for what cannot be.
    ///
    /// # Errors
    /// Says which field, and what would do.
    pub fn check(&self) -> Result<(), FrameError> {
        let fail = |problem: String| Err(FrameError::Config { id: self.id.clone(), problem });
        if self.width == 0 || self.height == 0 {
            return fail(format!("{} x {} pixels; give width and height", self.width, self.height));
        }
        if let Err(error) = check_size(self.format, self.width, self.height) {
            return fail(error.to_string());
        }
        if let Some(problem) = self.raw.and_then(|raw| raw.problem(self.format)) {
            return fail(problem);
        }
        if !(0.1..=1000.0).contains(&self.rate_hz) {
            return fail(format!("rate_hz is {}; it can be 0.1 to 1000", self.rate_hz));
        }
        if !(2..=32).contains(&self.buffers) {
            return fail(format!("buffers is {}; the kernel takes 2 to 32", self.buffers));
        }
        if !self.backend.is_genicam() && super::fourccs(self.format).is_empty() {
            return fail(format!(
                "{} comes from machine-vision cameras alone: set backend = \"gige\" or \"u3v\"",
                self.format
            ));
        }
        if let Some(problem) = self.genicam_problem() {
            return fail(problem);
        }
        if self.timeout_ms == 0 {
            return fail("timeout_ms is 0; give the time of some frames".into());
        }
        for (name, lock) in [
            ("exposure_us", self.exposure_us),
            ("gain", self.gain),
            ("white_balance_k", self.white_balance_k),
            ("focus", self.focus),
        ] {
            if let Lock::At(value) = lock
                && !(0.0..=1e9).contains(&value)
            {
                return fail(format!("{name} is {value}; it can be 0 to 1e9, \"hold\" or \"auto\""));
            }
        }
        Ok(())
    }
}

impl FrameConfig {
    /// What a machine-vision camera cannot be set to, and others not either.
    #[cfg(target_os = "linux")]
    fn genicam_problem(&self) -> Option<String> {
        if !self.backend.is_genicam() {
            let stray = self.genicam.is_some();
            return stray
                .then(|| "the table genicam is for machine-vision cameras: set backend = \"gige\" or \"u3v\"".into());
        }
        let formats = || pixel::FORMATS.iter().map(|(_, _, format)| (*format).into());
        if pixel::code_of(self.format).is_none() {
            let mut known: Vec<Encoding> = formats().collect();
            known.sort_by_key(|format| format.name());
            known.dedup();
            return Some(format!(
                "backend \"{}\" has no format {}; give one that the camera has, of {}",
                self.backend.name(),
                self.format,
                names(known.into_iter())
            ));
        }
        if matches!(self.white_balance_k, Lock::At(_)) || matches!(self.focus, Lock::At(_)) {
            return Some(
                "machine-vision cameras have neither white_balance_k nor focus as a number: leave them at \"hold\", and \
                 set BalanceRatio and the like in genicam.features"
                    .into(),
            );
        }
        self.genicam.as_ref().and_then(|more| more.problem(self.backend == Backend::U3v))
    }

    #[cfg(not(target_os = "linux"))]
    fn genicam_problem(&self) -> Option<String> {
        self.backend.is_genicam().then(|| format!("backend \"{}\" exists on Linux alone", self.backend.name()))
    }
}

/// How a camera is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// The precise way where there is one.
    #[default]
    Auto,
    /// V4L2 itself (Linux): the kernel's stamps, lost frames known, unplugged cameras come back.
    Precise,
    /// nokhwa: every system, host times only.
    Portable,
    /// GigE Vision (Linux): machine-vision cameras on Ethernet.
    Gige,
    /// USB3 Vision (Linux): machine-vision cameras on USB.
    U3v,
}

impl Backend {
    /// Its name in `RIG.toml`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Precise => "precise",
            Self::Portable => "portable",
            Self::Gige => "gige",
            Self::U3v => "u3v",
        }
    }

    /// Whether it is for machine-vision cameras.
    fn is_genicam(self) -> bool {
        matches!(self, Self::Gige | Self::U3v)
    }
}

/// What becomes of a quantity that cameras set by themselves. Training needs frames of one look, so that the default is
/// to hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "\"hold\", \"auto\" or a number is needed")]
pub enum Lock {
    /// Held as it is, or left to the camera.
    Named(NamedLock),
    /// Set to a value.
    At(f64),
}

/// A [`Lock`] without a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NamedLock {
    /// The camera's automatic is switched off, and the value stays what it is.
    Hold,
    /// The camera sets it.
    Auto,
}

impl Default for Lock {
    fn default() -> Self {
        Self::Named(NamedLock::Hold)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_read_and_unknown_fields_are_refused() {
        let table = r#"{"id": "left", "format": "grey12", "exposure_us": 5000, "gain": "auto"}"#;
        let config: FrameConfig = serde_json::from_str(table).unwrap();
        assert_eq!((config.exposure_us, config.gain), (Lock::At(5000.0), Lock::Named(NamedLock::Auto)));
        assert_eq!(config.white_balance_k, Lock::Named(NamedLock::Hold));
        assert_eq!(config.format, PixelFormat::Grey12);
        assert_eq!(config.raw, None);
        assert!(config.check().is_ok());
        assert!(serde_json::from_str::<FrameConfig>(r#"{"exposure": 5000}"#).is_err());
        let word = serde_json::from_str::<FrameConfig>(r#"{"exposure_us": "fast"}"#).unwrap_err().to_string();
        assert!(word.contains("\"hold\", \"auto\" or a number is needed"), "{word}");
        let unknown = serde_json::from_str::<FrameConfig>(r#"{"format": "evt3"}"#).unwrap_err().to_string();
        assert!(unknown.contains("no format \"evt3\"; there are mjpeg") && unknown.contains("rggb10p"), "{unknown}");

        let table = r#"{"format": "gbrg12p", "raw": {"black_level": 240, "white_balance": [1.9, 1, 1.6]}}"#;
        let config: FrameConfig = serde_json::from_str(table).unwrap();
        assert!(config.check().is_ok());
        assert_eq!(config.raw.unwrap().black_level, 240.0);
        assert!(serde_json::from_str::<FrameConfig>(r#"{"raw": {"gamma": 2}}"#).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_machine_vision_cameras_have_is_read_and_checked() {
        let read = |more: &str| {
            let table = format!(r#"{{"id": "left", "backend": "gige", "format": "grey8"{more}}}"#);
            let config: Result<FrameConfig, String> = serde_json::from_str(&table).map_err(|error| error.to_string());
            config.and_then(|config| config.check().map(|()| config).map_err(|error| error.to_string()))
        };
        let config = read(r#", "genicam": {"offset": [8, 4], "features": {"Gamma": 0.5}}"#).unwrap();
        assert_eq!(config.genicam.unwrap().offset, [8, 4]);
        for (more, says) in [
            (r#", "genicam": {"ofset": [8, 4]}"#, "unknown field `ofset`"),
            (r#", "genicam": {"packet_bytes": 20}"#, "576 to 16000"),
            (r#", "genicam": {"heartbeat_ms": 5}"#, "500 to 60000"),
            (r#", "genicam": {"features": {"Gamma": [1]}}"#, "features.Gamma must be"),
            (r#", "genicam": {"throughput": 0}"#, "throughput is 0"),
            (r#", "focus": 3"#, "BalanceRatio"),
        ] {
            let error = read(more).unwrap_err();
            assert!(error.contains(says), "{more}: {error}");
        }
        let on_usb = |more: &str| {
            let table = format!(r#"{{"backend": "u3v", "format": "grey8", "genicam": {more}}}"#);
            serde_json::from_str::<FrameConfig>(&table).unwrap().check().map_err(|error| error.to_string())
        };
        assert_eq!(on_usb(r#"{"transfers": 16, "transfer_bytes": 65536}"#), Ok(()));
        for (more, says) in [
            (r#"{"packet_bytes": 1500}"#, "genicam.packet_bytes is for backend = \"gige\", and this is \"u3v\""),
            (r#"{"transfers": 1}"#, "2 to 256"),
            (r#"{"transfer_bytes": 1000}"#, "in steps of 1024"),
        ] {
            let error = on_usb(more).unwrap_err();
            assert!(error.contains(says), "{more}: {error}");
        }
        assert!(read(r#", "genicam": {"transfers": 16}"#).unwrap_err().contains("is for backend = \"u3v\""));
        let stray: FrameConfig = serde_json::from_str(r#"{"genicam": {}}"#).unwrap();
        assert!(stray.check().unwrap_err().to_string().contains("set backend = \"gige\""));
    }

    #[test]
    fn what_no_camera_can_do_is_refused_by_name() {
        let refused = |change: fn(&mut FrameConfig)| {
            let mut config = FrameConfig::default();
            change(&mut config);
            config.check().unwrap_err().to_string()
        };
        assert!(refused(|c| c.width = 0).contains("0 x 1080"));
        assert!(refused(|c| (c.format, c.width) = (PixelFormat::Grey10Packed, 1922)).contains("a multiple of 4"));
        assert!(
            refused(|c| c.raw = Some(RawLook::default())).contains("raw is for grey and Bayer formats, not for mjpeg")
        );
        assert!(refused(|c| c.rate_hz = f64::INFINITY).contains("rate_hz"));
        assert!(refused(|c| c.buffers = 1).contains("2 to 32"));
        assert!(refused(|c| c.timeout_ms = 0).contains("timeout_ms"));
        assert!(refused(|c| c.format = PixelFormat::Grey12Lsb).contains("grey12lsb comes from machine-vision cameras"));
        assert!(
            cfg!(not(target_os = "linux")) || refused(|c| c.backend = Backend::Gige).contains("has no format mjpeg")
        );
        assert!(refused(|c| c.exposure_us = Lock::At(-1.0)).contains("exposure_us is -1"));
    }
}
