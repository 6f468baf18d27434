//! When the frames of a plan were exposed.

use std::path::Path;

use erfgs_base::FileError;
use erfgs_scene::video::FrameTimes;
use erfgs_session::clock::Exposure;

use super::{
    PlanError,
    events::{EventStream, Pulse},
    plan::{Begin, Frames, Mark},
};

/// The exposures of a stream's frames, one after the other.
pub(super) enum Times {
    /// From the first on at a rate; the length of each, if it is known, and what of it the rate marks.
    Even { first_ns: i64, times: FrameTimes, marked: Marked },
    /// Each by itself.
    Each(Vec<Exposure>),
}

/// What is known of exposures whose times are told.
#[derive(Clone, Copy)]
pub(super) struct Marked {
    length_ns: Option<i64>,
    mark: Mark,
}

impl Marked {
    fn exposure(self, at_ns: i64) -> Exposure {
        let half_ns = self.length_ns.unwrap_or(0) / 2;
        let mid_ns = match self.mark {
            Mark::Start => at_ns.saturating_add(half_ns),
            Mark::Middle => at_ns,
            Mark::End => at_ns.saturating_sub(half_ns),
        };
        Exposure { mid_ns, length_ns: self.length_ns }
    }
}

impl Times {
    /// Of a stream that has so many frames, if that is known.
    pub fn of(
        frames: &Frames,
        folder: &Path,
        count: Option<u64>,
        events: &mut [EventStream],
    ) -> Result<Self, PlanError> {
        let length_ns = frames.exposure_us.map(|us| (1e3 * us).round() as i64);
        let marked = Marked { length_ns, mark: frames.marks.unwrap_or(Mark::Middle) };
        if let Some(rate) = frames.fps {
            let first_ns = (1e9 * frames.starts_s.unwrap_or(0.0)) as i64;
            return Ok(Self::Even { first_ns, times: FrameTimes::Even(rate), marked });
        }
        if let Some(path) = &frames.times {
            let path = folder.join(path);
            let text = std::fs::read_to_string(&path).map_err(FileError::when("read", &path))?;
            let wrong = |what| PlanError::File { id: frames.id.clone(), path: path.clone(), what };
            let times = listed(&text, frames.column.as_deref()).map_err(wrong)?;
            return Ok(Self::Each(times.into_iter().map(|at_ns| marked.exposure(at_ns)).collect()));
        }
        let name = frames.pulses_of.as_deref().unwrap_or_default();
        let Some(seen) = events.iter_mut().find(|stream| stream.description.id == name) else {
            return Ok(Self::Each(Vec::new()));
        };
        let pulses = match frames.edge.unwrap_or(Begin::Rising) {
            Begin::Rising => seen.pulses()?.to_vec(),
            Begin::Falling => seen.falls()?,
        };
        if pulses.is_empty() {
            return Err(seen.without_pulses());
        }
        of_pulses(frames, name, count, &pulses, length_ns)
    }

    /// Of the frame of this number.
    pub fn exposure(&self, frame: u64) -> Option<Exposure> {
        match self {
            Self::Even { first_ns, times, marked } => {
                Some(marked.exposure(first_ns.saturating_add(times.since(0, frame)?)))
            }
            Self::Each(exposures) => exposures.get(usize::try_from(frame).ok()?).copied(),
        }
    }

    /// How many there are; `None` for as many as are asked for.
    pub fn count(&self) -> Option<u64> {
        match self {
            Self::Even { .. } => None,
            Self::Each(exposures) => Some(exposures.len() as u64),
        }
    }
}

/// The exposures that begin with pulses.
fn of_pulses(
    frames: &Frames,
    events: &str,
    count: Option<u64>,
    pulses: &[Pulse],
    length_ns: Option<i64>,
) -> Result<Times, PlanError> {
    let first = frames.first_pulse.unwrap_or(0);
    let rest = pulses.get(first..).unwrap_or_default();
    let wanted = count.unwrap_or(rest.len() as u64);
    let enough = rest.len() as u64 >= wanted;
    if !enough || (rest.len() as u64 > wanted && frames.first_pulse.is_none()) {
        return Err(PlanError::Count {
            id: frames.id.clone(),
            frames: wanted,
            events: events.to_owned(),
            pulses: rest.len() as u64,
            from: if first > 0 { format!(" from pulse {first} on") } else { String::new() },
        });
    }
    let exposures = rest.iter().take(usize::try_from(wanted).unwrap_or(usize::MAX));
    let exposure = |pulse: &Pulse| Exposure::beginning(pulse.rise_ns, length_ns.or(pulse.width_ns).unwrap_or(0));
    Ok(Times::Each(exposures.map(exposure).collect()))
}

/// Units that the name of a column tells.
const UNITS: [(&str, f64); 4] = [("s", 1e9), ("ms", 1e6), ("us", 1e3), ("ns", 1.0)];

/// The times in a text, nanoseconds: a line each, below a line of names. One of these is `t_s`, `t_ms`, `t_us` or `t_ns`, or is `asked` for.
fn listed(text: &str, asked: Option<&str>) -> Result<Vec<i64>, String> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let (_, head) = lines.next().ok_or("it is empty")?;
    let split = |line: &str| line.split([',', ';', '\t']).map(|field| field.trim().to_owned()).collect::<Vec<_>>();
    let names = split(head);
    let unit = |name: &str| {
        let (what, unit) = name.rsplit_once('_')?;
        let is_it = asked.map_or(what.eq_ignore_ascii_case("t"), |asked| name == asked);
        UNITS.iter().find(|(known, _)| is_it && unit.eq_ignore_ascii_case(known)).map(|(_, ns)| *ns)
    };
    let columns: Vec<(usize, f64)> =
        names.iter().enumerate().filter_map(|(at, name)| Some((at, unit(name)?))).collect();
    let [(column, ns)] = columns[..] else {
        return Err(match asked {
            Some(asked) => format!(
                "its first line is '{head}'; none or several of these columns are '{asked}' with a unit (_s, _ms, _us or _ns) at its end"
            ),
            None => format!(
                "its first line is '{head}'; it must name the columns, one of them t_s, t_ms, t_us or t_ns, the time of a frame, or say \
                 with column which of them it is"
            ),
        });
    };
    let mut times: Vec<i64> = Vec::new();
    for (at, line) in lines {
        let wrong = |what: &str| format!("line {}: '{line}' {what}", at + 1);
        let fields = split(line);
        let field = fields.get(column).ok_or_else(|| wrong("has too few columns"))?;
        // Whole numbers keep all their digits.
        let time = match field.parse::<i64>() {
            Ok(whole) => i128::from(whole) * ns as i128,
            Err(_) => {
                let time = field.parse::<f64>().ok().filter(|time| time.is_finite());
                (time.ok_or_else(|| wrong("has no time"))? * ns).round() as i128
            }
        };
        let time = i64::try_from(time).ok().filter(|time| time.unsigned_abs() < 1 << 62);
        let time = time.ok_or_else(|| wrong("has no time of a recording"))?;
        if times.last().is_some_and(|last| *last >= time) {
            return Err(wrong("is not later than the line before"));
        }
        times.push(time);
    }
    Ok(times)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn whatever_a_text_says_times_rise_or_are_refused_with_a_reason(
            text in "(t_(s|ms|us|ns)|a)(,(t_s|b))?\n(-?[0-9]{0,19}(\\.[0-9]{1,3})?(e[0-9]{1,3})?(,|;|x|-)?[0-9]{0,2}\n){0,6}",
            column in proptest::option::of("t_s|t_us|a"),
        ) {
            match listed(&text, column.as_deref()) {
                Ok(times) => prop_assert!(times.is_sorted_by(|a, b| a < b), "{:?}", times),
                Err(what) => prop_assert!(!what.is_empty()),
            }
        }

        #[test]
        fn whole_times_come_back_to_the_nanosecond(mut times in proptest::collection::btree_set(-(1_i64 << 61)..1 << 61, 1..50)) {
            let text: String = std::iter::once("t_ns".to_owned()).chain(times.iter().map(i64::to_string)).collect::<Vec<_>>().join("\n");
            prop_assert_eq!(listed(&text, None), Ok(times.iter().copied().collect()));
            let last = times.pop_last().unwrap();
            let doubled = format!("{text}\n{last}");
            prop_assert!(listed(&doubled, None).is_err());
        }
    }

    #[test]
    fn times_are_read_by_the_name_of_their_column() {
        assert_eq!(listed("t_us\n5\n7.5\n\n9000000000001\n", None), Ok(vec![5000, 7500, 9_000_000_000_001_000]));
        assert_eq!(listed("frame; T_s ;x\r\n0;-0.5;a\r\n1;0.25;b", None), Ok(vec![-500_000_000, 250_000_000]));
        let ours = "frame,sequence,arrival_ns,exposure_mid_ns\n0,0,243,218\n1,1,293,268\n";
        assert_eq!(listed(ours, Some("exposure_mid_ns")), Ok(vec![218, 268]));
        assert!(listed(ours, None).is_err_and(|what| what.contains("say with column")));
        for other in ["frame", "mid_ns", "EXPOSURE_MID_NS"] {
            assert!(listed(ours, Some(other)).is_err_and(|what| what.contains(&format!("'{other}'"))));
        }
        for (text, says) in [
            ("", "empty"),
            ("1\n2\n", "must name the columns"),
            ("t_s,t_ms\n1,2\n", "must name the columns"),
            ("time\n1\n", "must name the columns"),
            ("n,t_s\n1\n", "line 2: '1' has too few"),
            ("t_s\n1\nsoon\n", "line 3: 'soon' has no time"),
            ("t_s\n1\n1\n", "line 3: '1' is not later"),
            ("t_s\n1e300\n", "no time of a recording"),
            ("t_s\nnan\n", "line 2: 'nan' has no time"),
        ] {
            let wrong = listed(text, None);
            assert!(wrong.clone().is_err_and(|what| what.contains(says)), "{text:?}: {wrong:?}");
        }
    }
}
