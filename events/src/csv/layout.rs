//! What the beginning of a text says of all of it: order of the columns, unit of the time, size of the sensor.

use std::borrow::Cow;

use super::{
    line,
    names::{TextColumns, TimeUnit, known},
    sample::Sample,
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
pub(super) type Wrong = (u64, String);

/// Who says what the columns are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Source {
    /// Nobody.
    #[default]
    None,
    /// A line of names, or OpenEB's geometry.
    File,
    /// The user.
    User,
}

/// What of lines is read before the first event.
#[derive(Default)]
struct Preamble {
    names: Option<TextColumns>,
    source: Source,
    size: Option<SensorSize>,
    /// A line `%geometry:W,H`, as OpenEB's decoders write before `x,y,p,t`.
    geometry: bool,
    /// A line of names that does not count, since the user gave others.
    overridden: bool,
    /// The last comment that tells a unit of time.
    unit: Option<(u64, TimeUnit)>,
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

    /// The layout of a text that begins with `head`, `whole` if that is all of it; its columns are `given` where the user says so.
    ///
    /// # Errors
    /// The line, and what in it is not understood or contradicts the others.
    pub(crate) fn of(head: &[u8], whole: bool, given: Option<TextColumns>) -> Result<Self, Wrong> {
        if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") || head.contains(&0) {
            let what = "it is no UTF-8 but UTF-16 or binary; convert it: iconv -f UTF-16 -t UTF-8";
            return Err((1, what.to_owned()));
        }
        let mut layout =
            Self { body: if head.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 }, ..Self::default() };
        let mut preamble = Preamble { names: given, ..Preamble::default() };
        if given.is_some() {
            preamble.source = Source::User;
        }
        let mut rest = &head[layout.body..];
        while let Some((line, after)) = next_line(rest, whole) {
            if preamble.takes(line, layout.lines + 1).map_err(|what| (layout.lines + 1, what))? {
                layout.lines += 1;
                layout.body += rest.len() - after.len();
                rest = after;
            } else {
                break;
            }
        }
        layout.size = preamble.size;
        match preamble.names {
            Some(names) => layout.name(&names),
            None if preamble.geometry => layout.order = [3, 0, 1, 2],
            None => {}
        }
        let sample = Sample::of(rest, whole, layout.lines);
        sample.check_words(&layout)?;
        sample.check_order(&layout, preamble.source)?;
        if layout.unit.is_none() {
            let unit = sample.unit(&layout)?;
            preamble.check_unit(unit)?;
            layout.unit = Some(unit);
        }
        sample.check_times(&layout, preamble.source)?;
        Ok(layout)
    }

    /// Takes what names say.
    pub(super) fn name(&mut self, names: &TextColumns) {
        (self.order, self.columns) = (names.order, names.count);
        (self.unit, self.unit_is_named) = (names.unit, names.unit.is_some());
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

/// A line as text: of what is no UTF-8 each byte is a letter, as in headers of other formats.
fn latin1_or_utf8(line: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(line) {
        Ok(text) => text.into(),
        Err(_) => line.iter().map(|&byte| char::from(byte)).collect::<String>().into(),
    }
}

/// The first line, and what follows it; `None` if it is not over.
pub(super) fn next_line(bytes: &[u8], whole: bool) -> Option<(&[u8], &[u8])> {
    match bytes.iter().position(|&byte| byte == b'\n') {
        Some(end) => Some((&bytes[..end], &bytes[end + 1..])),
        None if whole && !bytes.is_empty() => Some((bytes, &[])),
        None => None,
    }
}

/// What to do about names that are not understood.
const RENAME: &str =
    "rename or remove that column, or say what all are, as `--columns t_us,x,y,p` (`-` for one that is none of these)";

impl Preamble {
    /// Takes what a line before the first event says; `false` if it is one of an event.
    fn takes(&mut self, line: &[u8], number: u64) -> Result<bool, String> {
        let line = latin1_or_utf8(line::bare(line));
        let line = line.as_ref();
        if line.is_empty() {
            return Ok(true);
        }
        if let Some(comment) = line.strip_prefix(['#', '%']) {
            return self.takes_comment(comment, line, number).map(|()| true);
        }
        let fields = line::fields(line);
        if self.size.is_none() && line::size(&fields).is_some() {
            self.size = line::size(&fields);
            return Ok(true);
        }
        if let (Source::User, Some(names)) = (self.source, &self.names) {
            // One line without a number where numbers must be is one of other names.
            let is_event = names.order.iter().any(|&at| fields.get(at).is_some_and(|field| is_value(field)));
            return Ok(!is_event && !std::mem::replace(&mut self.overridden, true));
        }
        if fields.first().is_some_and(|first| is_value(first)) {
            return Ok(false);
        }
        match TextColumns::of(&fields) {
            Ok(names) => self.is_named(names),
            // A line of units below the names.
            Err(_) if self.takes_units(&fields) => {}
            // The columns have names already: this is an event that cannot be read.
            Err(_) if self.names.is_some() => return Ok(false),
            Err(what) => return Err(format!("{what}: {RENAME}")),
        }
        Ok(true)
    }

    /// Takes the unit of times from a line of units.
    fn takes_units(&mut self, fields: &[&str]) -> bool {
        let Some(names) = self.names.as_mut().filter(|names| names.count == fields.len()) else { return false };
        let Some(unit) = TimeUnit::of_cell(fields[names.order[0]]) else { return false };
        if names.unit.is_none_or(|named| named == unit) {
            names.unit = Some(unit);
            return true;
        }
        false
    }

    fn is_named(&mut self, names: TextColumns) {
        (self.names, self.source) = (Some(names), Source::File);
    }

    fn takes_comment(&mut self, comment: &str, line: &str, number: u64) -> Result<(), String> {
        if let Some(geometry) = comment.trim_start().strip_prefix("geometry:") {
            self.size = Some(line::size(&line::fields(geometry)).ok_or_else(|| {
                format!("`{}` is no size of a sensor; it is written %geometry:1280,720", line.escape_debug())
            })?);
            self.geometry = true;
            if self.source == Source::None {
                self.source = Source::File;
            }
            return Ok(());
        }
        if self.source == Source::User {
            return Ok(());
        }
        // A comment that is names more than anything else, as NumPy writes them.
        let words = line::fields(comment.rsplit(':').next().unwrap_or_default());
        if known(&words) >= 3 && known(&words) * 2 > words.len() {
            self.is_named(TextColumns::of(&words).map_err(|what| format!("{what}: {RENAME}"))?);
        } else if let Some(unit) = TimeUnit::in_prose(comment) {
            self.unit = Some((number, unit));
        }
        Ok(())
    }

    /// Refuses a unit that a comment contradicts.
    fn check_unit(&self, taken: TimeUnit) -> Result<(), Wrong> {
        match self.unit {
            Some((number, unit)) if unit != taken && self.source != Source::User => Err((
                number,
                format!(
                    "a comment tells of times in {unit}, and as they are written they would be taken for {taken}: put a line of names \
                     before that says which (t_s, t_ms, t_us, t_ns), or say it, as `--columns t_ms,x,y,p`"
                ),
            )),
            _ => Ok(()),
        }
    }
}
