//! One line of text: its fields and the event in it.

use super::{Layout, names::TimeUnit};
use crate::{CdEvent, SensorSize};

/// A line without the spaces around it. Tabs may separate empty fields.
pub(super) fn bare(line: &[u8]) -> &[u8] {
    if line.trim_ascii().is_empty() {
        return &[];
    }
    let is_kept = |byte: &u8| !matches!(byte, b' ' | b'\r');
    let from = line.iter().position(is_kept).unwrap_or(0);
    let to = line.iter().rposition(is_kept).map_or(0, |last| last + 1);
    &line[from..to]
}

/// The fields of a line: commas, semicolons and tabs separate, else spaces. An empty field behind the last one is left out.
pub(super) fn fields(line: &str) -> Vec<&str> {
    let bare = |field| str::trim(field).trim_matches('"').trim();
    if !line.contains([',', ';', '\t']) {
        return line.split_whitespace().map(bare).collect();
    }
    let mut fields: Vec<&str> = line.split([',', ';', '\t']).map(bare).collect();
    fields.pop_if(|last| last.is_empty());
    fields
}

/// The size of the sensor that a first line of two numbers tells.
pub(super) fn size(fields: &[&str]) -> Option<SensorSize> {
    let &[width, height] = fields else { return None };
    let side = |text: &str| text.parse().ok().filter(|&side: &u16| side > 0);
    Some(SensorSize { width: side(width)?, height: side(height)? })
}

/// A time as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Time {
    /// Digits alone.
    Whole(u64),
    /// With a point or an exponent.
    Real(f64),
}

impl Time {
    pub fn of(text: &str) -> Option<Self> {
        if let Ok(whole) = text.parse() {
            return Some(Self::Whole(whole));
        }
        let real: f64 = text.parse().ok()?;
        (real.is_finite() && real >= 0.0).then_some(Self::Real(real))
    }

    /// As it is written.
    pub fn value(self) -> f64 {
        match self {
            Self::Whole(whole) => whole as f64,
            Self::Real(real) => real,
        }
    }

    /// Whether it is written with a part of a unit.
    pub fn has_fraction(self) -> bool {
        matches!(self, Self::Real(real) if real.fract() != 0.0)
    }

    /// In microseconds; `None` beyond 64 bits, or beyond 2^53 where it is not whole: there are no microseconds there.
    pub fn microseconds(self, unit: TimeUnit) -> Option<u64> {
        match (self, unit) {
            (Self::Whole(whole), TimeUnit::Microseconds) => Some(whole),
            (Self::Whole(whole), TimeUnit::Milliseconds) => whole.checked_mul(1000),
            (Self::Whole(whole), TimeUnit::Seconds) => whole.checked_mul(1_000_000),
            (Self::Whole(whole), TimeUnit::Nanoseconds) => Some(whole / 1000 + u64::from(whole % 1000 >= 500)),
            (Self::Real(real), unit) => {
                let us = (real * unit.microseconds()).round();
                (0.0..=9.007e15).contains(&us).then_some(us as u64)
            }
        }
    }
}

/// An event as it is written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub t: Time,
    pub x: u16,
    pub y: u16,
    /// 1, 0 or -1.
    pub p: i8,
}

impl Row {
    /// The event of a line.
    ///
    /// # Errors
    /// Which column is wrong.
    pub fn of(fields: &[&str], layout: &Layout) -> Result<Self, String> {
        if fields.len() != layout.columns {
            let count = fields.len();
            return Err(format!("it has {count} column{}, not {}", if count == 1 { "" } else { "s" }, layout.columns));
        }
        let [t, x, y, p] = layout.order;
        let wrong = |at: usize, what: &str| format!("column {} is `{}`, not {what}", at + 1, fields[at].escape_debug());
        Ok(Self {
            t: Time::of(fields[t]).ok_or_else(|| wrong(t, "a time"))?,
            x: whole(fields[x]).ok_or_else(|| wrong(x, "the column of a pixel"))?,
            y: whole(fields[y]).ok_or_else(|| wrong(y, "the row of a pixel"))?,
            p: polarity(fields[p]).ok_or_else(|| wrong(p, "a polarity (1, 0 or -1)"))?,
        })
    }

    /// With its time in microseconds; `None` if these have no room for it.
    pub fn event(self, unit: TimeUnit) -> Option<CdEvent> {
        Some(CdEvent { t_us: self.t.microseconds(unit)?, x: self.x, y: self.y, on: self.p == 1 })
    }
}

fn polarity(text: &str) -> Option<i8> {
    match text {
        "1" | "true" | "True" | "TRUE" => Some(1),
        "0" | "false" | "False" | "FALSE" => Some(0),
        "-1" => Some(-1),
        other => match other.parse::<f64>().ok()? {
            1.0 => Some(1),
            0.0 => Some(0),
            -1.0 => Some(-1),
            _ => None,
        },
    }
}

fn whole(text: &str) -> Option<u16> {
    text.parse().ok().or_else(|| {
        let value = text.parse::<f64>().ok()?;
        (value.fract() == 0.0 && (0.0..=65_535.0).contains(&value)).then_some(value as u16)
    })
}
