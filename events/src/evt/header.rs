//! The text at the beginning of RAW files: lines `% key value`, the last of them `% end`.

use std::borrow::Cow;

use super::super::SensorSize;
use crate::EventEncoding;

/// The keys and values of a RAW file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RawHeader {
    /// In the order of the file.
    pub fields: Vec<(String, String)>,
}

/// How the events of a RAW file are encoded, as far as its header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawFormat {
    /// One of the EVT encodings.
    pub encoding: EventEncoding,
    /// Size of the sensor.
    pub size: Option<SensorSize>,
}

/// Prophesee's numbers of systems whose headers said neither encoding nor size: number, EVT 3 (and not 2), megapixel (and
/// not VGA).
const SYSTEMS: [(u32, bool, bool); 21] = [
    (0x15, false, false),
    (0x17, false, false),
    (0x19, false, false),
    (0x1A, false, true),
    (0x1C, false, false),
    (0x1D, false, false),
    (0x1E, true, true),
    (0x1F, false, true),
    (0x21, false, false),
    (0x22, false, false),
    (0x23, false, false),
    (0x27, false, true),
    (0x28, true, false),
    (0x29, false, false),
    (0x2E, true, true),
    (0x30, true, true),
    (0x31, true, true),
    (0x32, true, true),
    (0x97, false, false),
    (0x99, false, false),
    (0xA1, false, false),
];

/// From this system on, words of EVT 2.1 come in little-endian order where nothing else is said.
const FIRST_LITTLE_SYSTEM: u32 = 0x37;

/// The mark that editors put before UTF-8.
pub(crate) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// A line as UTF-8 or else Latin-1; `None` if it is neither, but the first events: these hold control characters.
fn text(line: &[u8]) -> Option<Cow<'_, str>> {
    if let Ok(text) = std::str::from_utf8(line) {
        return Some(text.into());
    }
    let is_text = |&byte: &u8| !byte.is_ascii_control() || byte == b'\t' || byte == b'\r';
    line.iter().all(is_text).then(|| line.iter().copied().map(char::from).collect::<String>().into())
}

impl RawHeader {
    /// Headers end before this, bytes.
    pub const MAX_BYTES: usize = 1 << 16;

    /// The header of a new file. `sensor` is the sensor's name (`IMX636`), `generation` its number (`4.2`), `date` the
    /// time of recording as `YYYY-MM-DD hh:mm:ss`. Holds what Prophesee's software looks for, current and older.
    ///
    /// `None` if the encoding is none of Prophesee's.
    #[must_use]
    pub fn new(encoding: EventEncoding, size: SensorSize, serial: &str, date: &str) -> Option<Self> {
        let SensorSize { width, height } = size;
        let geometry = format!("height={height};width={width}");
        let (format, version, order) = match encoding {
            EventEncoding::Evt2 => (format!("EVT2;{geometry}"), "2.0", None),
            EventEncoding::Evt21 => (format!("EVT21;endianness=little;{geometry}"), "2.1", Some("little")),
            EventEncoding::Evt21Legacy => (format!("EVT21;endianness=legacy;{geometry}"), "2.1", Some("legacy")),
            EventEncoding::Evt3 => (format!("EVT3;{geometry}"), "3.0", None),
            _ => return None,
        };
        let mut header = Self::default();
        header.set("camera_integrator_name", "Prophesee");
        header.set("date", date);
        if let Some(order) = order {
            header.set("endianness", order);
        }
        header.set("evt", version);
        header.set("format", &format);
        header.set("geometry", &format!("{width}x{height}"));
        header.set("integrator_name", "Prophesee");
        header.set("plugin_integrator_name", "Prophesee");
        header.set("plugin_name", "hal_plugin_prophesee");
        header.set("serial_number", serial);
        Some(header)
    }

    /// Adds what is known of an IMX636 behind an EVK4's board.
    #[must_use]
    pub fn with_imx636(mut self, firmware: &str) -> Self {
        self.set("firmware_version", firmware);
        self.set("sensor_generation", "4.2");
        self.set("sensor_name", "IMX636");
        self.set("subsystem_ID", "0");
        self.set("system_ID", "49");
        self
    }

    /// Reads the header at the beginning of `bytes` and tells where the events begin. Where a header has no `% end`, as
    /// older files have none, it ends with its last line. What is no UTF-8 is read as Latin-1, and a byte order mark is skipped.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> (Self, usize) {
        let mut header = Self::default();
        let mut at = if bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        while let [b'%', b' ', line @ ..] = &bytes[at..bytes.len().min(Self::MAX_BYTES)] {
            let Some(length) = line.iter().position(|&byte| byte == b'\n') else { break };
            let Some(text) = text(&line[..length]) else { break };
            at += length + 3;
            let mut words = text.split_whitespace();
            match words.next() {
                Some("end") => break,
                Some(key) => header.fields.push((key.to_owned(), words.collect::<Vec<_>>().join(" "))),
                None => {}
            }
        }
        (header, at)
    }

    /// The value of `key`, if it is there and not empty.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&str> {
        let field = self.fields.iter().rev().find(|(name, _)| name == key);
        field.map(|(_, value)| value.as_str()).filter(|value| !value.is_empty())
    }

    /// Sets `key`.
    pub fn set(&mut self, key: &str, value: &str) {
        let value = value.replace(['\r', '\n'], " ");
        match self.fields.iter_mut().find(|(name, _)| name == key) {
            Some((_, old)) => *old = value,
            None => self.fields.push((key.to_owned(), value)),
        }
    }

    /// The bytes of the header, `% end` included, keys in alphabetical order.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut fields: Vec<_> = self.fields.iter().filter(|(_, value)| !value.is_empty()).collect();
        fields.sort();
        let lines = fields.into_iter().map(|(key, value)| format!("% {key} {value}\n"));
        lines.chain(["% end\n".to_owned()]).collect::<String>().into_bytes()
    }

    /// What the lines `format` and `evt` say, if they do not agree.
    pub(crate) fn contradiction(&self) -> Option<(&str, &str)> {
        let format = self.get("format")?;
        let evt = self.get("evt")?;
        let digits = |text: &str| text.chars().filter(char::is_ascii_digit).collect::<String>();
        let [of_format, of_evt] = [format.split(';').next().unwrap_or_default(), evt].map(digits);
        let agree = of_format.trim_end_matches('0') == of_evt.trim_end_matches('0');
        (!agree && format.starts_with("EVT")).then_some((format, evt))
    }

    /// EventEncoding and size: from `format`, else from `evt` and `geometry`, else from the number of the system.
    ///
    /// `None` if nothing says what the encoding is, or if it is one that is not read (EVT 4, AER, frames).
    #[must_use]
    pub fn format(&self) -> Option<RawFormat> {
        let mut parts = self.get("format").unwrap_or_default().split(';');
        let name = parts.next().unwrap_or_default();
        let options: Vec<(&str, &str)> = parts.filter_map(|part| part.split_once('=')).collect();
        let option = |key| options.iter().find(|(name, _)| *name == key).map(|(_, value)| *value);
        let id = self.get("system_ID").and_then(|id| id.parse::<u32>().ok());
        let system = SYSTEMS.into_iter().find(|(number, ..)| Some(*number) == id);
        let encoding = match (name, self.get("evt")) {
            ("EVT2", _) | ("", Some("2.0")) => EventEncoding::Evt2,
            ("EVT3", _) | ("", Some("3.0")) => EventEncoding::Evt3,
            ("EVT21", _) | ("", Some("2.1")) => {
                let order = option("endianness").or(self.get("endianness"));
                let old = id.is_some_and(|id| id != 0 && id < FIRST_LITTLE_SYSTEM);
                if order == Some("legacy") || (order.is_none() && old) {
                    EventEncoding::Evt21Legacy
                } else {
                    EventEncoding::Evt21
                }
            }
            ("", None) => {
                if system?.1 {
                    EventEncoding::Evt3
                } else {
                    EventEncoding::Evt2
                }
            }
            _ => return None,
        };
        let number = |text: &str| text.trim().parse().ok().filter(|&number: &u16| number > 0);
        let pair = |width: Option<&str>, height: Option<&str>| {
            Some(SensorSize { width: number(width?)?, height: number(height?)? })
        };
        let geometry = self.get("geometry").and_then(|text| text.split_once('x'));
        let size = pair(option("width"), option("height"))
            .or_else(|| pair(geometry.map(|pair| pair.0), geometry.map(|pair| pair.1)))
            .or_else(|| pair(self.get("Width"), self.get("Height")))
            .or_else(|| {
                let (width, height) = if system?.2 { (1280, 720) } else { (640, 480) };
                Some(SensorSize { width, height })
            });
        Some(RawFormat { encoding, size })
    }
}
