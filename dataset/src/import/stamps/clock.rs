//! The time that a name tells.

use erfgs_base::{calendar::DateTime, order::numbers};

/// Seconds since 1970 that recorders write: 2001 to 2039.
const SINCE_1970: std::ops::Range<i64> = 1_000_000_000..2_200_000_000;
pub(super) const SECOND_NS: i64 = 1_000_000_000;

/// Digits behind a whole second as nanoseconds, and the least step that so many tell.
fn fraction(number: Option<&(&str, &str)>) -> Option<[i64; 2]> {
    let (before, digits) = *number?;
    let is_fraction = match before {
        "." | "," => (1..=9).contains(&digits.len()),
        "-" | "_" => [3, 6, 9].contains(&digits.len()),
        _ => false,
    };
    let step = 10_i64.pow(9_u32.checked_sub(digits.len() as u32)?);
    is_fraction.then(|| Some([digits.parse::<i64>().ok()? * step, step]))?
}

/// The time that a name tells, nanoseconds since 1970, and its least step.
pub(super) fn clock(name: &str) -> Option<[i64; 2]> {
    let numbers = numbers(name);
    let with_fraction = |seconds: i64, next: usize| {
        let [own, step] = fraction(numbers.get(next)).unwrap_or([0, SECOND_NS]);
        Some([seconds.checked_mul(SECOND_NS)?.checked_add(own)?, step])
    };
    for (at, (_, digits)) in numbers.iter().enumerate() {
        let whole = || digits.parse::<i64>().ok();
        let step = match digits.len() {
            10 => SECOND_NS,
            13 => 1_000_000,
            16 => 1000,
            19 => 1,
            _ => 0,
        };
        if step > 0
            && let Some(value) = whole()
            && SINCE_1970.contains(&(value / (SECOND_NS / step)))
        {
            return if step == SECOND_NS {
                with_fraction(value, at + 1)
            } else {
                Some([value.checked_mul(step)?, step])
            };
        }
        if let Some((seconds, next)) = date(&numbers[at..]) {
            return with_fraction(seconds, at + next);
        }
    }
    None
}

/// A date and a time of day at the beginning of these numbers, in seconds, and how many of them it takes.
fn date(numbers: &[(&str, &str)]) -> Option<(i64, usize)> {
    let lengths: Vec<usize> = numbers.iter().map(|(_, digits)| digits.len()).collect();
    let (together, taken) = match lengths[..] {
        [14, ..] => (numbers[0].1.to_owned(), 1),
        [8, 6, ..] => (numbers[0].1.to_owned() + numbers[1].1, 2),
        [4, 2, 2, 2, 2, 2, ..] => (numbers[..6].iter().map(|(_, digits)| *digits).collect(), 6),
        _ => return None,
    };
    let part = |from: usize, to: usize| together.get(from..to)?.parse::<i64>().ok();
    let [month, day, hour, minute, second] = [4, 6, 8, 10, 12].map(|from| part(from, from + 2));
    let time = DateTime { year: part(0, 4)?, month: month?, day: day?, hour: hour?, minute: minute?, second: second? };
    let is_time = time.hour < 24 && time.minute < 60 && time.second < 61;
    let seconds = time.seconds().filter(|_| is_time)?;
    SINCE_1970.contains(&seconds).then_some((seconds, taken))
}
