use std::net::Ipv4Addr;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// The table `genicam` of a camera in `RIG.toml`: what machine-vision cameras have beyond others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GenicamConfig {
    /// First column and row of the region that is read; its size are the camera's `width` and `height`.
    pub offset: [u32; 2],
    /// Black level, in the camera's own units; left out, it stays what it is.
    pub black_level: Option<f64>,
    /// The input that the trigger comes in at (`Line0`), where the camera is triggered.
    pub trigger_line: String,
    /// Which edge of it begins an exposure.
    pub trigger_activation: String,
    /// The output that is active while the sensor is exposed, if one is wanted.
    pub strobe_line: String,
    /// The event cameras whose trigger inputs it goes to; none: what synchronisation finds.
    pub strobe_to: Vec<String>,
    /// What the camera is to measure of each frame: `Timestamp`, `ExposureTime`, `FrameID`.
    pub chunks: Vec<String>,
    /// Most bytes a second that it may send, where cameras share a link.
    pub throughput: Option<u64>,
    /// Whether the maker's settings are loaded first, so that nothing depends on what was set before.
    pub reset: bool,
    /// Features by their own names, set last.
    pub features: Map<String, Value>,
    /// Addresses that are asked for cameras beside the broadcasts, which do not pass routers.
    pub addresses: Vec<Ipv4Addr>,
    /// Bytes of a packet; left out, the largest that passes.
    pub packet_bytes: Option<u32>,
    /// Pause between two packets, nanoseconds.
    pub packet_delay_ns: u64,
    /// Whether lost packets are asked for again.
    pub resend: bool,
    /// Memory of the kernel for packets that were not taken yet, MiB; left out, two frames and 8 at least.
    pub receive_buffer_mib: Option<u32>,
    /// After so many milliseconds without a word from us the camera takes itself for free.
    pub heartbeat_ms: u32,
    /// USB transfers in flight; left out, those of two frames.
    pub transfers: Option<usize>,
    /// Most bytes of a USB transfer; left out, 256 KiB.
    pub transfer_bytes: Option<u32>,
}

impl Default for GenicamConfig {
    fn default() -> Self {
        Self {
            offset: [0, 0],
            black_level: None,
            trigger_line: String::new(),
            trigger_activation: "RisingEdge".into(),
            strobe_line: String::new(),
            strobe_to: Vec::new(),
            chunks: Vec::new(),
            throughput: None,
            reset: false,
            features: Map::new(),
            addresses: Vec::new(),
            packet_bytes: None,
            packet_delay_ns: 0,
            resend: true,
            receive_buffer_mib: None,
            heartbeat_ms: 3000,
            transfers: None,
            transfer_bytes: None,
        }
    }
}

impl GenicamConfig {
    /// Looks for what cannot be, on Ethernet or on USB: which field, and what would do.
    #[must_use]
    pub fn problem(&self, on_usb: bool) -> Option<String> {
        if let Some(stray) = self.stray(on_usb) {
            let [has, other] = if on_usb { ["u3v", "gige"] } else { ["gige", "u3v"] };
            return Some(format!("genicam.{stray} is for backend = \"{other}\", and this is \"{has}\"; leave it out"));
        }
        if let Some(bytes) = self.packet_bytes.filter(|bytes| !(576..=16_000).contains(bytes)) {
            return Some(format!("genicam.packet_bytes is {bytes}; it can be 576 to 16000, or be left out"));
        }
        if self.strobe_line.is_empty() && !self.strobe_to.is_empty() {
            return Some("genicam.strobe_to is there without strobe_line, the output that it is about".into());
        }
        if self.packet_delay_ns > 1_000_000_000 {
            return Some("genicam.packet_delay_ns can be 0 to 1000000000".into());
        }
        if !(500..=60_000).contains(&self.heartbeat_ms) {
            return Some(format!("genicam.heartbeat_ms is {}; it can be 500 to 60000", self.heartbeat_ms));
        }
        if self.receive_buffer_mib.is_some_and(|mib| !(1..=2047).contains(&mib)) {
            return Some("genicam.receive_buffer_mib can be 1 to 2047".into());
        }
        if let Some(transfers) = self.transfers.filter(|transfers| !(2..=256).contains(transfers)) {
            return Some(format!("genicam.transfers is {transfers}; it can be 2 to 256"));
        }
        if let Some(bytes) =
            self.transfer_bytes.filter(|bytes| !(1 << 10..=4 << 20).contains(bytes) || !bytes.is_multiple_of(1024))
        {
            return Some(format!("genicam.transfer_bytes is {bytes}; it can be 1024 to 4194304, in steps of 1024"));
        }
        if self.throughput == Some(0) {
            return Some("genicam.throughput is 0; give bytes a second, or leave it out".into());
        }
        let odd = |(_, value): &(&String, &Value)| value.is_array() || value.is_object() || value.is_null();
        self.features
            .iter()
            .find(odd)
            .map(|(name, _)| format!("genicam.features.{name} must be a number, a text or a truth value"))
    }

    /// A field of the other transport that is set.
    fn stray(&self, on_usb: bool) -> Option<&'static str> {
        let default = Self::default();
        let ethernet = [
            ("addresses", self.addresses != default.addresses),
            ("packet_bytes", self.packet_bytes != default.packet_bytes),
            ("packet_delay_ns", self.packet_delay_ns != default.packet_delay_ns),
            ("resend", self.resend != default.resend),
            ("receive_buffer_mib", self.receive_buffer_mib != default.receive_buffer_mib),
            ("heartbeat_ms", self.heartbeat_ms != default.heartbeat_ms),
        ];
        let usb = [
            ("transfers", self.transfers != default.transfers),
            ("transfer_bytes", self.transfer_bytes != default.transfer_bytes),
        ];
        let fields = if on_usb { &ethernet[..] } else { &usb };
        fields.iter().find(|(_, is_set)| *is_set).map(|(name, _)| *name)
    }
}
