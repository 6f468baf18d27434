//! The first events of a text: whether they fit what is said of the columns, and what they tell of the unit of time.

use erfgs_base::plausible::INSTANT;

use super::{
    TextLayout,
    layout::{Source, Wrong, next_line},
    line::{self, Row, Time},
    names::TimeUnit,
};

/// The first events of a text.
pub(super) struct Sample<'a> {
    /// Lines, with their numbers.
    lines: Vec<(u64, Vec<&'a str>)>,
}

impl<'a> Sample<'a> {
    pub fn of(mut bytes: &'a [u8], whole: bool, mut number: u64) -> Self {
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
                    let now = row.t.value();
                    back += usize::from(now < last);
                    last = now;
                }
                Err(_) => wrong += 1,
            }
        }
        [wrong, back]
    }

    /// Refuses a text whose lines do not fit the order of its columns.
    pub fn check_order(&self, layout: &TextLayout, source: Source) -> Result<(), Wrong> {
        let is_named = source != Source::None;
        let [wrong, back] = self.faults(layout);
        let is_wrong = wrong * 2 > self.lines.len();
        // Rows or columns taken for times go back, or stand still; times taken for pixels are too large. Where another order fits every
        // line, a single fault is enough.
        let goes_back = !is_named && self.lines.len() >= 4 && (wrong + back > 0 || self.stands_still(layout));
        let Some((number, _)) = self.lines.first().filter(|_| is_wrong || goes_back) else { return Ok(()) };
        let others: [(&str, [usize; 4]); 4] = [
            ("x,y,p,t", [3, 0, 1, 2]),
            ("x,y,t,p", [2, 0, 1, 3]),
            ("t,p,x,y", [0, 2, 3, 1]),
            ("t,x,y,p", [0, 1, 2, 3]),
        ];
        let fits = |order| {
            let other = TextLayout { order, ..*layout };
            layout.columns == 4 && self.faults(&other) == [0, 0] && !(goes_back && self.stands_still(&other))
        };
        if let Some((names, _)) = others.into_iter().find(|(_, order)| *order != layout.order && fits(*order)) {
            let taken = match source {
                Source::None => "t,x,y,p, which is taken where no names are given",
                Source::File => "what its names say",
                Source::User => "what --columns says",
            };
            return Err((
                *number,
                format!(
                    "the columns are not in the order of {taken}; they look like {names}: put a line `{names}` before, or say \
                     `--columns {names}`"
                ),
            ));
        }
        let first = self.rows(layout).find_map(|(number, row)| Some((number, row.err()?)));
        match (first, source) {
            (Some((number, what)), Source::None) if is_wrong => Err((
                number,
                format!(
                    "{what}; without a line of names the columns are t,x,y,p, t in microseconds or seconds with a point: put a \
                     line such as `x,y,p,t_us` before, or say `--columns x,y,p,t_us` (`-` for a column that is none of these)"
                ),
            )),
            (Some((number, what)), Source::User) if is_wrong => Err((
                number,
                format!("{what}, as --columns says; name every column, with `-` for one that is none of t, x, y and p"),
            )),
            _ => Ok(()),
        }
    }

    /// Whether all events have one time.
    fn stands_still(&self, layout: &TextLayout) -> bool {
        let mut times = self.rows(layout).filter_map(|(_, row)| Some(row.ok()?.t));
        let first = times.next();
        first.is_some_and(|first| times.all(|t| t == first))
    }

    /// Refuses numbers that stand where polarities and times do and are none, if more than one line has them: a line that is damaged is
    /// told as such.
    pub fn check_words(&self, layout: &TextLayout) -> Result<(), Wrong> {
        let [t, x, y, p] = layout.order;
        let mut seen: Vec<(&str, f64)> = Vec::new();
        for (number, fields) in self.lines.iter().filter(|(_, fields)| fields.len() == layout.columns) {
            let is_pixel = [x, y].iter().all(|&at| fields[at].parse::<u16>().is_ok());
            let (time, sign) = (fields[t].parse::<f64>(), fields[p].parse::<f64>());
            let (true, Ok(time), Ok(sign)) = (is_pixel, time, sign) else { continue };
            let what = match (time < 0.0, [0.0, 1.0, -1.0].contains(&sign)) {
                (true, true) => ("time", -1.0),
                (false, false) => ("polarity", sign),
                _ => continue,
            };
            if !seen.contains(&what) {
                seen.push(what);
                continue;
            }
            return Err((
                *number,
                match what.0 {
                    "time" => format!(
                        "the time {time} is before zero; add the same to all times, so that they count from zero"
                    ),
                    _ => format!("the polarity {sign} is none: write 1 for ON, and 0 or -1 for OFF"),
                },
            ));
        }
        Ok(())
    }

    /// Refuses times that no clock has, or of which the unit leaves nothing.
    pub fn check_times(&self, layout: &TextLayout, source: Source) -> Result<(), Wrong> {
        let Some(unit) = layout.unit else { return Ok(()) };
        let times = || self.rows(layout).filter_map(|(number, row)| Some((number, row.ok()?.t)));
        let us = |t: Time| t.microseconds(unit).map_or(f64::INFINITY, |us| us as f64);
        let remedy = "say the unit by a line of names (t_s, t_ms, t_us, t_ns), or as `--columns t_ms,x,y,p`";
        let far = times().filter(|(_, t)| !INSTANT.holds(us(*t) * 1e-6)).count();
        let Some((number, first)) = times().next() else { return Ok(()) };
        if far == times().count() {
            return Err((
                number,
                format!("taken for {unit} its time is {:.1e} s, which no clock has; {remedy}", us(first) * 1e-6),
            ));
        }
        // Seconds that are called microseconds are all the same one, or lie in two that follow each other. Who says so twice is believed.
        let [mut least, mut most] = [f64::INFINITY, f64::NEG_INFINITY];
        let mut written: Vec<f64> = Vec::new();
        for (_, t) in times() {
            [least, most] = [least.min(us(t)), most.max(us(t))];
            let value = t.value();
            if written.len() < 4 && !written.contains(&value) {
                written.push(value);
            }
        }
        let is_lost = most <= 0.0 && written.len() >= 2 && self.lines.len() >= 4;
        if is_lost || (most - least <= 1.0 && written.len() >= 4 && source != Source::User) {
            return Err((
                number,
                format!(
                    "taken for {unit} all times are within a microsecond, and as they are written they differ; {remedy}"
                ),
            ));
        }
        Ok(())
    }

    /// The unit of the time, by how all times are written.
    pub fn unit(&self, layout: &TextLayout) -> Result<TimeUnit, Wrong> {
        let times = || self.rows(layout).filter_map(|(number, row)| Some((number, row.ok()?.t)));
        if times().any(|(_, t)| t.has_fraction()) {
            return Ok(TimeUnit::Seconds);
        }
        match times().find(|(_, t)| matches!(t, Time::Real(_))) {
            Some((number, _)) => Err((
                number,
                "times are written with a point or an exponent and none has a fraction, so that they may be seconds or \
                 microseconds: put a line of names before that says so, such as `t_s,x,y,p` or `t_us,x,y,p`, or say it: `--columns t_s,x,y,p`"
                    .to_owned(),
            )),
            None => Ok(TimeUnit::Microseconds),
        }
    }
}
