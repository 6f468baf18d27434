//! CSV: lines `t,x,y,on` of decimal numbers: microseconds, column, row, 1 for ON and 0 (or -1) for OFF. A first line of
//! names is skipped, as are empty lines and comments (`#`). Commas, semicolons, tabs and spaces separate.

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
        match parse(line) {
            Some(event) if event.x < self.size.width && event.y < self.size.height => {
                self.anomalies.time_backward += u64::from(event.t_us < self.last_us);
                self.last_us = event.t_us;
                self.stage.room(1, sink);
                self.stage.push(event.t_us, event.x, event.y, event.on);
            }
            Some(_) => self.anomalies.outside += 1,
            None if first && !line[0].is_ascii_digit() => {}
            None => self.anomalies.damaged += 1,
        }
    }
}

fn parse(line: &[u8]) -> Option<CdEvent> {
    let fields = line.split(|byte| matches!(byte, b',' | b';' | b'\t' | b' ')).map(<[u8]>::trim_ascii);
    let mut fields = fields.filter(|field| !field.is_empty());
    let mut next = || std::str::from_utf8(fields.next()?).ok();
    let event = CdEvent {
        t_us: next()?.parse().ok()?,
        x: next()?.parse().ok()?,
        y: next()?.parse().ok()?,
        on: match next()? {
            "1" | "true" | "True" => true,
            "0" | "-1" | "false" | "False" => false,
            _ => return None,
        },
    };
    next().is_none().then_some(event)
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
