//! Text, one event a line: `t,x,y,on` of decimal numbers: microseconds, column, row, 1 for ON and 0 (or -1) for OFF. Commas,
//! semicolons, tabs and spaces separate; empty lines and comments (`#`) are skipped.
//!
//! A time with a point or an exponent is in seconds, as in `events.txt` of the University of Zurich's data sets; other numbers
//! may be written so, too, if they are whole (`3.4e1`), as NumPy writes them. A first line of names says in which order the
//! columns are (`x,y,p,t`); one of two numbers is the size of the sensor, as in some `events.txt`.

use super::{Anomalies, CdEvent, Decoder, SensorSize, Sink, stage::Stage};

/// Lines longer than this are damaged.
const MAX_LINE: usize = 256;

/// The first line of files that [`CsvEncoder`] writes.
pub const CSV_HEADER: &[u8] = b"t,x,y,on\n";

/// Decodes CSV.
#[derive(Clone, Debug)]
pub struct CsvDecoder {
    size: SensorSize,
    /// The beginning of a line whose end did not come yet; empty if it is too long.
    line: Vec<u8>,
    /// Bytes of that line so far, those of a line that is too long included.
    length: usize,
    first: bool,
    /// Which column is the time, the column, the row and the polarity.
    order: [usize; 4],
    last_us: u64,
    anomalies: Anomalies,
    stage: Stage,
}

impl CsvDecoder {
    /// A decoder at the start of a file. Without a size, all addresses are taken.
    #[must_use]
    pub fn new(size: Option<SensorSize>) -> Self {
        Self {
            size: size.unwrap_or(SensorSize { width: u16::MAX, height: u16::MAX }),
            line: Vec::new(),
            length: 0,
            first: true,
            order: [0, 1, 2, 3],
            last_us: 0,
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    fn line(&mut self, line: &[u8], sink: &mut impl Sink) {
        let first = std::mem::take(&mut self.first);
        let line = line.trim_ascii();
        if line.is_empty() || line.starts_with(b"#") {
            self.first = first;
            return;
        }
        match parse(line, self.order) {
            Some(event) if event.x < self.size.width && event.y < self.size.height => {
                self.anomalies.time_backward += u64::from(event.t_us < self.last_us);
                self.last_us = event.t_us;
                self.stage.room(1, sink);
                self.stage.push(event.t_us, event.x, event.y, event.on);
            }
            Some(_) => self.anomalies.outside += 1,
            None if first && !matches!(line[0], b'0'..=b'9' | b'-' | b'+' | b'.') => {
                self.order = order(line).unwrap_or(self.order)
            }
            None if first && text_size(line).is_some() => {}
            None => self.anomalies.damaged += 1,
        }
    }
}

/// The fields of a line; `None` if there are others than four, or they are not text.
fn fields(line: &[u8]) -> Option<[&str; 4]> {
    let mut found = [""; 4];
    let mut fields = std::str::from_utf8(line).ok()?.split([',', ';', '\t', ' ']).filter(|field| !field.is_empty());
    for field in &mut found {
        *field = fields.next()?.trim();
    }
    fields.next().is_none().then_some(found)
}

/// The order of the columns that a line of names tells.
fn order(line: &[u8]) -> Option<[usize; 4]> {
    let names = fields(line)?.map(|name| name.trim_matches('"').to_ascii_lowercase());
    let find = |wanted: &[&str]| names.iter().position(|name| wanted.contains(&name.as_str()));
    Some([
        find(&["t", "t_us", "ts", "time", "timestamp", "timestamps"])?,
        find(&["x", "column", "col"])?,
        find(&["y", "row"])?,
        find(&["p", "on", "pol", "polarity"])?,
    ])
}

/// The size of the sensor that a first line of two numbers tells.
pub(super) fn text_size(line: &[u8]) -> Option<SensorSize> {
    let mut fields = std::str::from_utf8(line).ok()?.split([',', ';', '\t', ' ']).filter(|field| !field.is_empty());
    let mut next = || fields.next()?.trim().parse().ok().filter(|&side: &u16| side > 0);
    let size = SensorSize { width: next()?, height: next()? };
    fields.next().is_none().then_some(size)
}

/// Whether a line can be that of an event, or one of two numbers.
pub(super) fn is_text(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    parse(line, [0, 1, 2, 3]).is_some() || text_size(line).is_some() || order(line).is_some()
}

fn parse(line: &[u8], order: [usize; 4]) -> Option<CdEvent> {
    let fields = fields(line)?;
    let [t, x, y, on] = order.map(|at| fields[at]);
    Some(CdEvent {
        t_us: microseconds(t)?,
        x: whole(x)?,
        y: whole(y)?,
        on: match on {
            "1" | "true" | "True" => true,
            "0" | "-1" | "false" | "False" => false,
            other => match other.parse::<f64>().ok()? {
                1.0 => true,
                0.0 | -1.0 => false,
                _ => return None,
            },
        },
    })
}

/// A time: a whole number of microseconds, or seconds.
fn microseconds(text: &str) -> Option<u64> {
    if let Ok(t_us) = text.parse() {
        return Some(t_us);
    }
    let us = (text.parse::<f64>().ok()? * 1e6).round();
    // Beyond 2^53 a number of 64 bits has no microseconds.
    (0.0..=9.007e15).contains(&us).then_some(us as u64)
}

fn whole(text: &str) -> Option<u16> {
    text.parse().ok().or_else(|| {
        let value = text.parse::<f64>().ok()?;
        (value.fract() == 0.0 && (0.0..=65_535.0).contains(&value)).then_some(value as u16)
    })
}

impl Decoder for CsvDecoder {
    fn decode(&mut self, mut bytes: &[u8], sink: &mut impl Sink) {
        while let Some(end) = bytes.iter().position(|&byte| byte == b'\n') {
            let (line, rest) = bytes.split_at(end);
            bytes = &rest[1..];
            let length = std::mem::take(&mut self.length) + line.len();
            if length > MAX_LINE {
                self.line.clear();
                self.anomalies.damaged += 1;
            } else if self.line.is_empty() {
                self.line(line, sink);
            } else {
                let mut whole = std::mem::take(&mut self.line);
                whole.extend(line);
                self.line(&whole, sink);
                whole.clear();
                self.line = whole;
            }
        }
        self.length += bytes.len();
        if self.length > MAX_LINE {
            self.line.clear();
        } else {
            self.line.extend(bytes);
        }
        self.stage.flush(sink);
    }

    /// A last line without its end counts, as editors leave it.
    fn finish(&mut self, sink: &mut impl Sink) {
        let line = std::mem::take(&mut self.line);
        if std::mem::take(&mut self.length) > MAX_LINE {
            self.anomalies.damaged += 1;
        } else {
            self.line(&line, sink);
        }
        self.stage.flush(sink);
    }

    fn restart(&mut self) {
        self.anomalies.truncated_bytes += std::mem::take(&mut self.length) as u64;
        self.line.clear();
    }

    /// The format comes from files alone and needs no host clock.
    fn hint_host_us(&mut self, _host_us: u64) {}

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}

/// Encodes lines, to follow [`CSV_HEADER`].
#[derive(Clone, Copy, Debug, Default)]
pub struct CsvEncoder;

impl CsvEncoder {
    /// Appends an event.
    pub fn event(&self, event: CdEvent, out: &mut Vec<u8>) {
        let CdEvent { t_us, x, y, on } = event;
        out.extend(format!("{t_us},{x},{y},{}\n", u8::from(on)).into_bytes());
    }
}
