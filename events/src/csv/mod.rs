//! Text, one event a line: `t,x,y,on` of decimal numbers: microseconds, column, row, 1 for ON and 0 (or -1) for OFF. Commas,
//! semicolons, tabs and spaces separate; empty lines and comments (`#`, `%`) are skipped.
//!
//! What the beginning says holds for the whole text ([`TextLayout`]): a line of names tells the order of the columns and perhaps the
//! unit of the time (`x,y,p,t_ms`), one of two numbers the size of the sensor, as in some `events.txt`. Where no name tells the
//! unit, times are seconds if one of them has a fraction, as in `events.txt` of the University of Zurich's data sets, and
//! microseconds if all are digits alone. A line that contradicts what the beginning says is refused.

mod layout;
mod line;
mod names;
mod sample;

use self::{
    TextLayout as Layout,
    line::{Row, Time},
    names::TimeUnit,
};
pub use self::{layout::TextLayout, names::TextColumns};
use super::{Anomalies, CdEvent, Decoder, SensorSize, Sink, stage::Stage};

/// Lines longer than this are damaged.
const MAX_LINE: usize = 256;

/// The first line of files that [`CsvEncoder`] writes.
pub const CSV_HEADER: &[u8] = b"t,x,y,on\n";

/// Decodes CSV.
#[derive(Clone, Debug)]
pub struct CsvDecoder {
    size: SensorSize,
    layout: Layout,
    /// The beginning of a line whose end did not come yet; empty if it is too long.
    line: Vec<u8>,
    /// Bytes of that line so far, those of a line that is too long included.
    length: usize,
    /// Lines that are over, those before the layout's first included.
    lines: u64,
    /// Whether no event came yet and no names are known.
    first: bool,
    last_us: u64,
    /// Whether the last time had neither point nor exponent.
    last_is_whole: bool,
    /// Which of 0 and -1 were OFF.
    off: [bool; 2],
    contradiction: Option<(u64, String)>,
    anomalies: Anomalies,
    stage: Stage,
}

/// Between two times of which one has no point no more than this may pass, microseconds: 28 hours. Microseconds among seconds
/// are farther away.
const LONGEST_STEP_US: u64 = 100_000_000_000;

impl CsvDecoder {
    /// A decoder at the start of a text whose beginning was not looked at: a line of names tells the order of the columns, and
    /// the first time the unit of all. Without a size, all addresses are taken.
    #[must_use]
    pub fn new(size: Option<SensorSize>) -> Self {
        Self { first: true, ..Self::of(Layout::default(), size) }
    }

    /// A decoder at the first event of a text that is laid out so. Without a size, all addresses are taken.
    #[must_use]
    pub fn of(layout: TextLayout, size: Option<SensorSize>) -> Self {
        Self {
            size: size.unwrap_or(SensorSize { width: u16::MAX, height: u16::MAX }),
            layout,
            line: Vec::new(),
            length: 0,
            lines: layout.lines,
            first: false,
            last_us: 0,
            last_is_whole: false,
            off: [false; 2],
            contradiction: None,
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// The first line that contradicts those before it, and how; nothing behind it counts.
    #[must_use]
    pub fn contradiction(&self) -> Option<(u64, &str)> {
        self.contradiction.as_ref().map(|(line, what)| (*line, what.as_str()))
    }

    fn line(&mut self, line: &[u8], sink: &mut impl Sink) {
        self.lines += 1;
        let line = line::bare(line);
        if line.is_empty() || line.starts_with(b"#") || line.starts_with(b"%") {
            return;
        }
        let first = std::mem::take(&mut self.first);
        let Ok(line) = std::str::from_utf8(line) else {
            self.anomalies.damaged += 1;
            return;
        };
        let fields = line::fields(line);
        match Row::of(&fields, &self.layout) {
            Ok(row) => self.row(row, sink),
            Err(_) if first && line::size(&fields).is_some() => {}
            Err(_) => match TextColumns::of(&fields) {
                Ok(names) if first => self.layout.name(&names),
                _ => self.anomalies.damaged += 1,
            },
        }
    }

    fn row(&mut self, row: Row, sink: &mut impl Sink) {
        if self.contradiction.is_some() {
            self.anomalies.damaged += 1;
            return;
        }
        let unit = *self.layout.unit.get_or_insert(match row.t {
            Time::Whole(_) => TimeUnit::Microseconds,
            Time::Real(_) => TimeUnit::Seconds,
        });
        let Some(event) = row.event(unit) else {
            self.anomalies.damaged += 1;
            return;
        };
        if let Some(what) = self.contradicts(row, event, unit) {
            self.contradiction = Some((self.lines, what));
            self.anomalies.damaged += 1;
            return;
        }
        if event.x >= self.size.width || event.y >= self.size.height {
            self.anomalies.outside += 1;
            return;
        }
        self.anomalies.time_backward += u64::from(event.t_us < self.last_us);
        self.last_us = event.t_us;
        self.last_is_whole = matches!(row.t, Time::Whole(_));
        self.stage.room(1, sink);
        self.stage.push(event.t_us, event.x, event.y, event.on);
    }

    /// What in a line contradicts those before.
    fn contradicts(&mut self, row: Row, event: CdEvent, unit: TimeUnit) -> Option<String> {
        match row.p {
            0 => self.off[0] = true,
            -1 => self.off[1] = true,
            _ => {}
        }
        if self.off == [true; 2] {
            return Some("polarities are 0 in some lines and -1 in others; write OFF in one way".to_owned());
        }
        if self.layout.unit_is_named {
            return None;
        }
        let remedy =
            "write all times alike, or tell their unit by a line of names or with --columns (t_s, t_ms, t_us, t_ns)";
        match (row.t, unit) {
            (Time::Real(real), TimeUnit::Microseconds) => Some(format!(
                "the time {real} has a point or an exponent, those before are whole and were taken for microseconds; {remedy}"
            )),
            (t, TimeUnit::Seconds)
                if self.last_us > 0
                    && (self.last_is_whole || matches!(t, Time::Whole(_)))
                    && event.t_us.abs_diff(self.last_us) > LONGEST_STEP_US =>
            {
                let [before_s, s] = [self.last_us, event.t_us].map(|us| us as f64 * 1e-6);
                Some(format!("of the times {before_s} and {s} before it and in it not both are seconds; {remedy}"))
            }
            _ => None,
        }
    }
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
