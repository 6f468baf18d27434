//! What the beginning of a text says of all of it: order of the columns, unit of the time, size of the sensor.

use super::{
    line::{self, Row, Time},
    names::{Names, TimeUnit, known},
};
use crate::{SensorSize, evt::BYTE_ORDER_MARK};

/// How a text is laid out. One layout holds for all of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextLayout {
    /// Which column is the time, the column of the pixel, its row and the polarity.
    pub(super) order: [usize; 4],
    /// Number of columns.
    pub(super) columns: usize,
    /// The unit of the time; `None` where the first time decides.
    pub(super) unit: Option<TimeUnit>,
    /// Whether the text names the unit, so that how numbers are written says nothing.
    pub(super) unit_is_named: bool,
    /// Size of the sensor, where the text says it.
    pub(super) size: Option<SensorSize>,
    /// Bytes before the first event.
    pub(super) body: usize,
    /// Lines before it.
    pub(super) lines: u64,
}

impl Default for TextLayout {
    /// `t,x,y,p` from the first byte on.
    fn default() -> Self {
        Self { order: [0, 1, 2, 3], columns: 4, unit: None, unit_is_named: false, size: None, body: 0, lines: 0 }
    }
}

/// A line and what is wrong in it.
type Wrong = (u64, String);

/// The lines before the first event.
#[derive(Default)]
struct Preamble {
    names: Option<Names>,
    size: Option<SensorSize>,
    /// A line `%geometry:W,H`, as OpenEB's decoders write before `x,y,p,t`.
    geometry: bool,
}

impl TextLayout {
    /// The size of the sensor, where the text says it.
    pub(crate) fn size(&self) -> Option<SensorSize> {
        self.size
    }

    /// Bytes before the first event.
    pub(crate) fn body(&self) -> usize {
        self.body
    }

    /// The layout of a text that begins with `head`; `whole` if that is all of it.
    ///
    /// # Errors
    /// The line, and what in it is not understood or contradicts the others.
    pub(crate) fn of(head: &[u8], whole: bool) -> Result<Self, Wrong> {
        if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") || head.contains(&0) {
            let what = "it is no UTF-8 but UTF-16 or binary; convert it: iconv -f UTF-16 -t UTF-8";
            return Err((1, what.to_owned()));
        }
        let mut layout =
            Self { body: if head.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 }, ..Self::default() };
        let mut preamble = Preamble::default();
        let mut rest = &head[layout.body..];
        while let Some((line, after)) = next_line(rest, whole) {
            if preamble.hears(line).map_err(|what| (layout.lines + 1, what))? {
                layout.lines += 1;
                layout.body += rest.len() - after.len();
                rest = after;
            } else {
                break;
            }
        }
        layout.size = preamble.size;
        match preamble.names {
            Some(names) => {
                (layout.order, layout.columns) = (names.order, names.count);
                (layout.unit, layout.unit_is_named) = (names.unit, names.unit.is_some());
            }
            None if preamble.geometry => layout.order = [3, 0, 1, 2],
            None => {}
        }
        let sample = Sample::of(rest, whole, layout.lines);
        sample.check_order(&layout, preamble.names.is_some() || preamble.geometry)?;
        if layout.unit.is_none() {
            layout.unit = Some(sample.unit(&layout)?);
        }
        Ok(layout)
    }

    /// Whether a text that begins so can be one of events.
    pub(crate) fn is_likely(head: &[u8]) -> bool {
        let head = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(head);
        let lines = head.split(|&byte| byte == b'\n').map(line::bare);
        let first = lines.into_iter().find(|line| !line.is_empty() && !line.starts_with(b"#"));
        let Some(first) = first.and_then(|line| std::str::from_utf8(line).ok()) else { return false };
        let fields = line::fields(first);
        first.starts_with("%geometry:")
            || known(&fields) >= 3
            || line::size(&fields).is_some()
            || fields.len() >= 4 && fields.iter().all(|field| is_value(field))
    }
}

fn is_value(field: &str) -> bool {
    field.parse::<f64>().is_ok() || matches!(field, "true" | "True" | "TRUE" | "false" | "False" | "FALSE")
}

/// The first line, and what follows it; `None` if it is not over.
fn next_line(bytes: &[u8], whole: bool) -> Option<(&[u8], &[u8])> {
    match bytes.iter().position(|&byte| byte == b'\n') {
        Some(end) => Some((&bytes[..end], &bytes[end + 1..])),
        None if whole && !bytes.is_empty() => Some((bytes, &[])),
        None => None,
    }
}

impl Preamble {
    /// Takes what a line before the first event says; `false` if it is one of an event.
    fn hears(&mut self, line: &[u8]) -> Result<bool, String> {
        let line = String::from_utf8_lossy(line::bare(line));
        let line = line.as_ref();
        if line.is_empty() {
            return Ok(true);
        }
        if let Some(comment) = line.strip_prefix(['#', '%']) {
            if let Some(geometry) = comment.trim_start().strip_prefix("geometry:") {
                self.size = Some(line::size(&line::fields(geometry)).ok_or_else(|| {
                    format!("`{}` is no size of a sensor; it is written %geometry:1280,720", line.escape_debug())
                })?);
                self.geometry = true;
            } else {
                // A comment that is names more than anything else, as NumPy writes them.
                let words = line::fields(comment.rsplit(':').next().unwrap_or_default());
                if known(&words) >= 3 && known(&words) * 2 > words.len() {
                    self.names = Some(Names::of(&words)?);
                }
            }
            return Ok(true);
        }
        let fields = line::fields(line);
        if self.size.is_none() && line::size(&fields).is_some() {
            self.size = line::size(&fields);
            return Ok(true);
        }
        if fields.first().is_some_and(|first| is_value(first)) {
            return Ok(false);
        }
        match Names::of(&fields) {
            Ok(names) => self.names = Some(names),
            // The columns have names already: this is an event that cannot be read.
            Err(_) if self.names.is_some() => return Ok(false),
            Err(what) => return Err(what),
        }
        Ok(true)
    }
}

/// The first events of a text.
struct Sample<'a> {
    /// Lines, with their numbers.
    lines: Vec<(u64, Vec<&'a str>)>,
}

impl<'a> Sample<'a> {
    fn of(mut bytes: &'a [u8], whole: bool, mut number: u64) -> Self {
        let mut lines = Vec::new();
        while let Some((line, after)) = next_line(bytes, whole) {
            number += 1;
            bytes = after;
            if let Ok(text) = std::str::from_utf8(line::bare(line))
                && !text.is_empty()
                && !text.starts_with(['#', '%'])
            {
                lines.push((number, line::fields(text)));
            }
        }
        Self { lines }
    }

    fn rows(&self, layout: &TextLayout) -> impl Iterator<Item = (u64, Result<Row, String>)> {
        self.lines.iter().map(|(number, fields)| (*number, Row::of(fields, layout)))
    }

    /// How many lines are no events, and in how many time goes back.
    fn faults(&self, layout: &TextLayout) -> [usize; 2] {
        let (mut wrong, mut back, mut last) = (0, 0, 0.0);
        for (_, row) in self.rows(layout) {
            match row {
                Ok(row) => {
                    let now = match row.t {
                        Time::Whole(whole) => whole as f64,
                        Time::Real(real) => real,
                    };
                    back += usize::from(now < last);
                    last = now;
                }
                Err(_) => wrong += 1,
            }
        }
        [wrong, back]
    }

    /// Refuses a text whose lines do not fit the order of its columns.
    fn check_order(&self, layout: &TextLayout, is_named: bool) -> Result<(), Wrong> {
        let [wrong, back] = self.faults(layout);
        let is_wrong = wrong * 2 > self.lines.len();
        // Rows or columns taken for times go back all the time.
        let goes_back = !is_named && self.lines.len() >= 4 && back * 4 >= self.lines.len();
        let Some((number, _)) = self.lines.first().filter(|_| is_wrong || goes_back) else { return Ok(()) };
        let others: [(&str, [usize; 4]); 4] = [
            ("x,y,p,t", [3, 0, 1, 2]),
            ("x,y,t,p", [2, 0, 1, 3]),
            ("t,p,x,y", [0, 2, 3, 1]),
            ("t,x,y,p", [0, 1, 2, 3]),
        ];
        let fits = |order| layout.columns == 4 && self.faults(&TextLayout { order, ..*layout }) == [0, 0];
        if let Some((names, _)) = others.into_iter().find(|(_, order)| *order != layout.order && fits(*order)) {
            let taken =
                if is_named { "what its names say" } else { "t,x,y,p, which is taken where no names are given" };
            return Err((
                *number,
                format!(
                    "the columns are not in the order of {taken}; they look like {names}: put a line `{names}` before"
                ),
            ));
        }
        let first = self.rows(layout).find_map(|(number, row)| Some((number, row.err()?)));
        match first {
            Some((number, what)) if is_wrong && !is_named => Err((
                number,
                format!(
                    "{what}; without a line of names the columns are t,x,y,p, t in microseconds or seconds with a point: put a \
                     line such as `x,y,p,t_us` before"
                ),
            )),
            _ => Ok(()),
        }
    }

    /// The unit of the time, by how all times are written.
    fn unit(&self, layout: &TextLayout) -> Result<TimeUnit, Wrong> {
        let times = || self.rows(layout).filter_map(|(number, row)| Some((number, row.ok()?.t)));
        if times().any(|(_, t)| t.has_fraction()) {
            return Ok(TimeUnit::Seconds);
        }
        match times().find(|(_, t)| matches!(t, Time::Real(_))) {
            Some((number, _)) => Err((
                number,
                "times are written with a point or an exponent and none has a fraction, so that they may be seconds or \
                 microseconds: put a line of names before that says so, such as `t_s,x,y,p` or `t_us,x,y,p`"
                    .to_owned(),
            )),
            None => Ok(TimeUnit::Microseconds),
        }
    }
}
