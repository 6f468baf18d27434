//! What the names of frames say of their times: a clock, or a count in which frames lack.

mod clock;

use std::path::Path;

use erfgs_base::order::numbers;
use erfgs_scene::video::FrameTimes;

use self::clock::clock;
use super::{
    ImportError,
    common::{FileFrame, Frames, SourceView, frame_time, stem},
};

/// What names say.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Named {
    /// The time of the first, nanoseconds since 1970, and of each from it on.
    Clock { first: i64, times: FrameTimes },
    /// They count, and so many are left out: the place of each from the first on.
    Count { places: Vec<u64>, missing: u64 },
    /// They count in uneven steps.
    Uneven,
}

/// What the names of frames say, in their order; `None` where that is no more than that they follow each other. `usual` is the rate that
/// is taken where nothing else is said.
pub(super) fn named(names: &[String], usual: f64) -> Option<Named> {
    by_clock(names, usual).or_else(|| by_count(names))
}

fn by_clock(names: &[String], usual: f64) -> Option<Named> {
    let clocks: Vec<[i64; 2]> = names.iter().map(|name| clock(name)).collect::<Option<_>>()?;
    let [first, step] = *clocks.first()?;
    let times: Vec<i64> = clocks.iter().map(|[time, _]| time - first).collect();
    // A date that stands still, or that is written once a second, is of the recording.
    if clocks.iter().any(|[_, other]| *other != step)
        || times.len() < 2
        || times.windows(2).any(|pair| pair[0] >= pair[1])
    {
        return None;
    }
    let measured = FrameTimes::Uneven(times.clone()).rate();
    let fits = |rate: &f64| {
        *rate > 0.0
            && times.iter().enumerate().all(|(at, time)| (time - frame_time(at as u64, *rate)).abs() <= step.max(1000))
    };
    let even = [usual, measured.round(), measured].into_iter().find(fits);
    Some(Named::Clock { first, times: even.map_or(FrameTimes::Uneven(times), FrameTimes::Even) })
}

fn by_count(names: &[String]) -> Option<Named> {
    let all: Vec<Vec<(&str, &str)>> = names.iter().map(|name| numbers(name)).collect();
    let first = all.first()?;
    if all.iter().any(|own| own.len() != first.len()) {
        return None;
    }
    let differs = |at: &usize| all.iter().any(|own| own[*at].1 != first[*at].1);
    let differing: Vec<usize> = (0..first.len()).filter(differs).collect();
    let [counts] = differing[..] else { return None };
    let counted: Vec<u64> = all.iter().map(|own| own[counts].1.parse().ok()).collect::<Option<_>>()?;
    let mut steps: Vec<u64> = counted.windows(2).map(|pair| pair[1].checked_sub(pair[0])).collect::<Option<_>>()?;
    steps.sort_unstable();
    let (least, most) = (*steps.first()?, *steps.last()?);
    if least == most {
        return None;
    }
    let usual = steps[steps.len() / 2].max(1);
    // Most of them follow each other, and the others leave whole steps out.
    if steps.iter().any(|step| step % usual != 0)
        || steps.iter().filter(|step| **step == usual).count() * 2 < steps.len()
    {
        return Some(Named::Uneven);
    }
    let places: Vec<u64> = counted.iter().map(|count| (count - counted[0]) / usual).collect();
    let missing = places[places.len() - 1] + 1 - places.len() as u64;
    Some(Named::Count { places, missing })
}

/// The names of frames: of their files, or of their folders where the files of all are called alike.
fn labels(files: &[FileFrame]) -> Vec<String> {
    let own = || files.iter().map(|file| stem(&file.image));
    let folder = |file: &FileFrame| {
        file.image.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned()
    };
    match own().all(|name| name == stem(&files[0].image)) {
        true => files.iter().map(folder).collect(),
        false => own().collect(),
    }
}

/// Lays frames of files where their names say, unless a rate is given, and says the rate with its source.
pub(super) fn place(views: &mut [SourceView], given: Option<f64>, usual: f64) -> Result<(f64, String), ImportError> {
    let rate = given.unwrap_or(usual);
    let assumed = match given {
        Some(fps) => format!("{fps} frames a second, as --fps says"),
        None => format!("{usual} frames a second are assumed, --fps says another rate"),
    };
    let several = |view: &&SourceView| matches!(&view.frames, Frames::Files(files) if files.len() > 1);
    let mut known: Option<(String, Named)> = None;
    for view in views.iter().filter(several) {
        let Frames::Files(files) = &view.frames else { continue };
        let names = labels(files);
        let named = if given.is_some() { by_count(&names) } else { named(&names, rate) };
        let Some(named) = named else { return Ok((rate, assumed)) };
        let Some((first, other)) = &known else {
            known = Some((view.name.clone(), named));
            continue;
        };
        let agree = match (&named, other) {
            (Named::Clock { first, times }, Named::Clock { first: other_first, times: other }) => {
                let quarter_ns = (0.25e9 / times.rate()) as u64;
                first.abs_diff(*other_first) <= quarter_ns && times.agree(other, names.len() as u64)
            }
            (own, other) => own == other,
        };
        if !agree {
            let path = files[0].image.parent().unwrap_or(Path::new("")).to_owned();
            let what = match named {
                Named::Clock { .. } => format!(
                    "the names of its frames tell other times than those of camera {first}; give one rate for all with --fps if they belong \
                     together one by one"
                ),
                _ => format!(
                    "by the numbers in their names its frames are not those of camera {first}; take away the frames that not all cameras \
                     have, or number those that belong together alike"
                ),
            };
            return Err(ImportError::Camera { camera: view.name.clone(), path, what });
        }
    }
    let Some((_, named)) = known else { return Ok((rate, assumed)) };
    let (rate, description) = match &named {
        Named::Clock { times: FrameTimes::Even(rate), .. } => {
            (*rate, format!("{rate} frames a second, as their names say"))
        }
        Named::Clock { times, .. } => (times.rate(), "frames at the uneven times that their names say".to_owned()),
        Named::Count { missing, .. } => (
            rate,
            format!(
                "{assumed}; {missing} are missing by the numbers in their names, and the others are where these say"
            ),
        ),
        Named::Uneven => {
            (rate, format!("{assumed}; the numbers in their names step unevenly and are not taken for times"))
        }
    };
    for view in views {
        let Frames::Files(files) = &mut view.frames else { continue };
        for (at, file) in files.iter_mut().enumerate() {
            let time = match &named {
                Named::Clock { times, .. } => times.since(0, at as u64),
                Named::Count { places, .. } => places.get(at).map(|&place| frame_time(place, rate)),
                Named::Uneven => None,
            };
            file.t_ns = time.unwrap_or(file.t_ns);
        }
    }
    Ok((rate, description))
}

#[cfg(test)]
mod tests {
    use erfgs_base::calendar::DateTime;
    use proptest::prelude::*;

    use super::{clock::SECOND_NS, *};

    const WRITTEN: [fn(i64) -> String; 8] = [
        |ns| format!("{}.{:09}", ns / SECOND_NS, ns % SECOND_NS),
        |ns| format!("rgb_{}.{:06}_left", ns / SECOND_NS, ns % SECOND_NS / 1000),
        |ns| format!("cam2_{ns}"),
        |ns| format!("{}", ns / 1000),
        |ns| format!("{}", ns / 1_000_000),
        |ns| format!("img_{}-{:03}", date_of(ns, ["-", "-", "_", "-", "-"]), ns % SECOND_NS / 1_000_000),
        |ns| format!("{}.{:06}", date_of(ns, ["", "", "T", "", ""]), ns % SECOND_NS / 1000),
        |ns| format!("{}_{:03}", date_of(ns, ["", "", "", "", ""]), ns % SECOND_NS / 1_000_000),
    ];

    fn date_of(ns: i64, [a, b, c, d, e]: [&str; 5]) -> String {
        let DateTime { year, month, day, hour, minute, second } = DateTime::of_ns(ns);
        format!("{year}{a}{month:02}{b}{day:02}{c}{hour:02}{d}{minute:02}{e}{second:02}")
    }

    proptest! {
        #[test]
        fn times_in_names_of_recorders_are_found_to_their_step(
            start_s in 1_100_000_000..2_000_000_000_i64,
            steps in proptest::collection::vec(2_000_000..900_000_000_i64, 1..30),
            way in 0..WRITTEN.len(),
            is_even: bool,
        ) {
            let mut ns = vec![start_s * SECOND_NS];
            for step in &steps {
                let step = if is_even { steps[0] } else { *step };
                ns.push(ns[ns.len() - 1] + step);
            }
            let names: Vec<String> = ns.iter().map(|&ns| WRITTEN[way](ns)).collect();
            let Some(Named::Clock { times, .. }) = named(&names, 30.0) else { return Err(TestCaseError::fail(names.join(" "))) };
            for (at, ns) in ns.iter().enumerate() {
                let off = times.since(0, at as u64).unwrap() - (ns - start_s * SECOND_NS);
                prop_assert!(off.abs() <= 2_000_001, "{:?} {names:?}", times);
            }
            prop_assert!(!is_even || matches!(times, FrameTimes::Even(_)), "{:?} {names:?}", times);
        }

        #[test]
        fn frames_that_lack_in_a_count_leave_their_places_free(
            first in 0..2000_u64,
            step in prop_oneof![Just(1_u64), Just(5), 2..40_u64],
            keep in proptest::collection::vec(prop::bool::weighted(0.9), 12..60),
        ) {
            let kept: Vec<u64> = (0..keep.len() as u64).filter(|&at| at < 6 || keep[at as usize]).collect();
            let names: Vec<String> = kept.iter().map(|at| format!("cam3/frame_{:04}", first + step * at)).collect();
            let missing = kept[kept.len() - 1] + 1 - kept.len() as u64;
            let expected = (missing > 0).then(|| Named::Count { places: kept.clone(), missing });
            prop_assert_eq!(named(&names, 30.0), expected);
        }
    }

    #[test]
    fn a_date_of_the_recording_and_uneven_counts_are_no_times() {
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        for (of, expected) in [
            (&["2024-05-01_12-00-00_0001", "2024-05-01_12-00-00_0002", "2024-05-01_12-00-00_0003"][..], None),
            (&["f_0033", "f_0067", "f_0100", "f_0133"], Some(Named::Uneven)),
            (&["a", "b", "c"], None),
            (&["9999999999", "9999999998"], None),
            (&["20249901120000", "20249901120001"], None),
        ] {
            assert_eq!(named(&names(of), 30.0), expected, "{of:?}");
        }
    }
}
