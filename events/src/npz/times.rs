//! What times mean where an array does not say it.

use std::io::{Read, Seek};

use erfgs_base::plausible::{INSTANT, SPAN};

use super::{Archive, NpzError};

impl<R: Read + Seek> Archive<'_, R> {
    /// Refuses arrays that say something of times and are not understood.
    pub(super) fn check_names(&self) -> Result<(), NpzError> {
        let names = || {
            let names = self.zip.file_names_raw().filter_map(|name| std::str::from_utf8(name).ok());
            names.filter_map(|name| name.strip_suffix(".npy"))
        };
        if names().any(|name| name == "t") && names().any(|name| name == "t_us") {
            return Err(self.content("it holds both `t` and `t_us`; remove the one that is not to be taken".into()));
        }
        not_understood(names()).map_or(Ok(()), |what| Err(self.content(what)))
    }
}

/// What is wrong where a name says something of times that is not understood.
pub(super) fn not_understood<'a>(mut names: impl Iterator<Item = &'a str>) -> Option<String> {
    let is_of_times = |name: &&str| {
        let name = name.to_lowercase();
        name != "t_us" && (name.starts_with("t_") || name.contains("unit") || name.contains("offset"))
    };
    names.find(is_of_times).map(|name| {
        format!(
            "its array `{}` says something of times that is not understood; write `t` as integers in microseconds with that taken \
             in, and remove it",
            name.escape_debug()
        )
    })
}

/// Microseconds of floating-point times: seconds where one has a fraction.
///
/// # Errors
/// If they may be either, or no clock has them.
pub(super) fn microseconds(times: &[f64], are_named: bool) -> Result<Vec<i64>, String> {
    let has_fraction = times.iter().any(|time| time.fract() != 0.0);
    let most = times.iter().fold(0.0, |most: f64, time| most.max(time.abs()));
    // As seconds they would be longer than a recording is.
    let are_long = most > SPAN.most;
    if !are_named && !has_fraction && !are_long && most > 0.0 {
        return Err("its times are floating-point numbers of which none has a fraction, so that they may be seconds or microseconds: write \
                    microseconds as integers, or call the field t_us"
            .into());
    }
    let unit = if has_fraction && !are_named { 1e6 } else { 1.0 };
    let to_us = |&time: &f64| INSTANT.check(time * unit * 1e-6).map(|_| (time * unit).round() as i64);
    let all = times.iter().map(to_us).collect::<Result<Vec<i64>, _>>().map_err(String::from)?;
    let range = all.iter().min().zip(all.iter().max()).map_or(0, |(first, last)| last - first);
    let differ = times.windows(2).filter(|pair| pair[0] != pair[1]).count() >= 3;
    if are_named && has_fraction && differ && range <= 1 {
        return Err("its field t_us holds times within a microsecond, which differ as they are written: if they are seconds, write integers in \
                    microseconds"
            .into());
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::{super::tests::archive_with, *};

    #[test]
    fn floating_point_times_are_what_they_show_or_asked_for() {
        assert_eq!(microseconds(&[0.5, 1.0, 2.0], false), Ok(vec![500_000, 1_000_000, 2_000_000]));
        assert_eq!(microseconds(&[1.0, 5e6], false), Ok(vec![1, 5_000_000]));
        assert_eq!(microseconds(&[1.0, 2.0], true), Ok(vec![1, 2]));
        assert_eq!(microseconds(&[1.25, 2.0], true), Ok(vec![1, 2]));
        assert_eq!(microseconds(&[0.0, 0.0], false), Ok(vec![0, 0]));
        assert!(microseconds(&[0.25, 0.5, 0.5625, 0.875], true).unwrap_err().contains("within a microsecond"));
        assert!(microseconds(&[1.0, 2.0], false).unwrap_err().contains("t_us"));
        for wrong in [f64::NAN, f64::INFINITY, 1e300, -1e17] {
            assert!(microseconds(&[wrong, 0.5], false).unwrap_err().contains("plausible"), "{wrong}");
        }
    }

    #[test]
    fn arrays_that_tell_of_times_are_taken_or_refused_by_name() {
        for name in ["t_offset", "t_ms", "T_NS", "time_unit", "units", "Offset_us"] {
            let message = archive_with(name).unwrap_err().to_string();
            assert!(message.contains(&format!("`{name}`")), "{message}");
        }
        assert!(archive_with("t_us").unwrap_err().to_string().contains("both `t` and `t_us`"));
        for name in ["frames", "note", "ms_to_idx", "threshold", "exposure"] {
            assert!(archive_with(name).is_ok(), "{name}");
        }
    }
}
