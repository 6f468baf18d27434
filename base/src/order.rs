//! The order of names as a person sees it: by all numbers in them, as numbers, from left to right.
//!
//! `img_9.png` comes before `img_10.png`, and `2024-05-01_12-00-01-999` before `2024-05-01_12-00-02-032`. Where names can be
//! read in two ways that give two orders, nobody is to guess: [`order`] says which names those are.

use std::{cmp::Ordering, collections::HashMap};

/// Two names whose order is not known.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the order of `{first}` and `{second}` is ambiguous: {why}; rename them so that all numbers have the same number of digits"
)]
pub struct Doubt {
    /// The one.
    pub first: String,
    /// The other.
    pub second: String,
    /// Why.
    pub why: &'static str,
}

/// A part of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part<'a> {
    Text(&'a str),
    /// Digits.
    Number(&'a str),
}

fn parts(name: &str) -> Vec<Part<'_>> {
    let mut parts = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.bytes().next() {
        let is_number = first.is_ascii_digit();
        let end = rest.bytes().position(|byte| byte.is_ascii_digit() != is_number).unwrap_or(rest.len());
        let (part, after) = rest.split_at(end);
        parts.push(if is_number { Part::Number(part) } else { Part::Text(part) });
        rest = after;
    }
    parts
}

/// Digits as a number of any size.
fn number(a: &str, b: &str) -> Ordering {
    let [a, b] = [a, b].map(|digits| digits.trim_start_matches('0'));
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

/// Digits behind a point.
fn fraction(a: &str, b: &str) -> Ordering {
    a.trim_end_matches('0').cmp(b.trim_end_matches('0'))
}

/// Compares two names by their texts and numbers from left to right; where all are equal, by their letters.
#[must_use]
pub fn natural(a: &str, b: &str) -> Ordering {
    by_parts(a, b, false).then_with(|| a.cmp(b))
}

/// As [`natural`] without what tells equal numbers apart; digits behind a point between digits are a fraction if asked for.
fn by_parts(a: &str, b: &str, with_fractions: bool) -> Ordering {
    let [a, b] = [a, b].map(parts);
    for (at, (own, other)) in a.iter().zip(&b).enumerate() {
        let order = match (*own, *other) {
            (Part::Number(x), Part::Number(y)) if with_fractions && is_fraction(&a, at) && is_fraction(&b, at) => {
                fraction(x, y)
            }
            (Part::Number(x), Part::Number(y)) => number(x, y),
            (Part::Text(x), Part::Text(y)) => x.to_lowercase().cmp(&y.to_lowercase()),
            (Part::Number(_), Part::Text(_)) => Ordering::Less,
            (Part::Text(_), Part::Number(_)) => Ordering::Greater,
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    a.len().cmp(&b.len())
}

/// Whether the number at a place can be the fraction of that before: of two numbers with a point between, and no third.
fn is_fraction(parts: &[Part<'_>], at: usize) -> bool {
    let is_point = |at: Option<usize>| at.and_then(|at| parts.get(at)) == Some(&Part::Text("."));
    is_point(at.checked_sub(1)) && at >= 2 && !is_point(at.checked_sub(3)) && !is_point(Some(at + 1))
}

/// The numbers of a name as they are written, each with the text before it.
#[must_use]
pub fn numbers(name: &str) -> Vec<(&str, &str)> {
    let mut before = "";
    let mut numbers = Vec::new();
    for part in parts(name) {
        match part {
            Part::Text(text) => before = text,
            Part::Number(digits) => numbers.push((std::mem::take(&mut before), digits)),
        }
    }
    numbers
}

/// The numbers of a name, without zeros before them.
fn values(name: &str) -> Vec<&str> {
    numbers(name).into_iter().map(|(_, digits)| digits.trim_start_matches('0')).collect()
}

/// The texts of a name.
fn texts(name: &str) -> Vec<String> {
    let texts = parts(name).into_iter().map(|part| match part {
        Part::Number(_) => "0".to_owned(),
        Part::Text(text) => text.to_lowercase(),
    });
    texts.collect()
}

/// A date with the year last, as its three numbers: nobody knows whether day or month comes first, and the year does not.
fn day_of_year_last(name: &str) -> Option<[&str; 3]> {
    let parts = parts(name);
    parts.windows(5).find_map(|window| match window {
        &[Part::Number(a), Part::Text(s), Part::Number(b), Part::Text(t), Part::Number(year)]
            if s == t
                && matches!(s, "-" | "." | "_" | "/")
                && a.len() <= 2
                && b.len() <= 2
                && year.len() == 4
                && (year.starts_with("19") || year.starts_with("20")) =>
        {
            Some([a, b, year])
        }
        _ => None,
    })
}

/// The places of `names` in their order.
///
/// # Errors
/// Two names of which nobody knows which comes first.
pub fn order<T: AsRef<str>>(names: &[T]) -> Result<Vec<usize>, Doubt> {
    let name = |at: usize| names[at].as_ref();
    let doubt = |[a, b]: [usize; 2], why| Err(Doubt { first: name(a).to_owned(), second: name(b).to_owned(), why });
    let mut by_numbers: HashMap<Vec<&str>, usize> = HashMap::new();
    for at in 0..names.len() {
        let own = values(name(at));
        if let Some(other) = by_numbers.insert(own.clone(), at).filter(|_| !own.is_empty()) {
            return doubt([other, at], "their numbers are the same");
        }
    }
    let sorted = |compare: &dyn Fn(&str, &str) -> Ordering| {
        let mut order: Vec<usize> = (0..names.len()).collect();
        order.sort_by(|&a, &b| compare(name(a), name(b)));
        order
    };
    let differ = |a: &[usize], b: &[usize]| a.iter().zip(b).find(|(a, b)| a != b).map(|(&a, &b)| [a, b]);
    let order = sorted(&natural);
    let fractions = sorted(&|a, b| by_parts(a, b, true).then_with(|| a.cmp(b)));
    if let Some(pair) = differ(&order, &fractions) {
        return doubt(pair, "a number behind a point may be a fraction or count by itself");
    }
    let days: Vec<Option<[&str; 3]>> = order.iter().map(|&at| day_of_year_last(name(at))).collect();
    if let Some(at) = days.windows(2).position(|pair| matches!(pair, [Some(a), Some(b)] if a != b)) {
        return doubt([order[at], order[at + 1]], "their dates do not begin with the year");
    }
    let first = order.first().map(|&at| texts(name(at)));
    if order.iter().any(|&at| Some(texts(name(at))) != first) {
        // Names that are made in different ways: their last numbers may count, or their texts.
        let by_last = sorted(&|a, b| {
            let last = |name| values(name).pop();
            match (last(a), last(b)) {
                (Some(x), Some(y)) => number(x, y),
                (x, y) => x.is_some().cmp(&y.is_some()),
            }
            .then_with(|| natural(a, b))
        });
        if let Some(pair) = differ(&order, &by_last) {
            return doubt(pair, "they follow different patterns, and numbers and letters give different orders");
        }
    }
    Ok(order)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    /// Names of frames as recorders and tools make them; the n-th of some.
    fn families() -> Vec<Box<dyn Fn(u64) -> String>> {
        let clock = |n: u64| {
            let ms = 500 + n * 333;
            (ms / 3_600_000 % 24, ms / 60_000 % 60, ms / 1000 % 60, ms % 1000)
        };
        vec![
            Box::new(|n| n.to_string()),
            Box::new(|n| format!("{n:06}")),
            Box::new(|n| format!("frame{n}_cam2")),
            Box::new(|n| format!("IMG_{n}.v10")),
            Box::new(|n| format!("take3_{n:04}_left")),
            Box::new(|n| {
                format!(
                    "{}.{:06}",
                    1_305_031_102 + (867_000 + n * 33_000) / 1_000_000,
                    (867_000 + n * 33_000) % 1_000_000
                )
            }),
            Box::new(|n| format!("image_{}_{}", 1_294_886_362 + n / 30, n % 30 * 33_333_333)),
            Box::new(move |n| {
                let (h, m, s, ms) = clock(n);
                format!("img_2024-05-01_{h:02}-{m:02}-{s:02}-{ms:03}")
            }),
            Box::new(|n| format!("2024-12-{:02}T{}.{:02}.00.123Z", 1 + n / 9, n % 9 * 2 + 1, 59 - n % 9)),
            Box::new(move |n| {
                let (h, m, s, _) = clock(n * 3 + 2);
                format!("31.12.2023 {h}h{m}m{s}s")
            }),
            Box::new(|n| format!("{}", 99_999_999_999_999_999_999_998_u128 + u128::from(n))),
            Box::new(|n| ["alpha", "beta", "delta", "gamma"][n as usize].to_owned()),
        ]
    }

    #[test]
    fn names_of_recorders_come_in_the_order_in_which_they_were_made() {
        for (family, name) in families().into_iter().enumerate() {
            let count = if family == 11 { 4 } else { 45 };
            let right: Vec<String> = (0..count).map(&name).collect();
            let mut shuffled: Vec<usize> = (0..right.len()).collect();
            let key = |at: usize| random::key(family as u64, &[random::purpose("order"), at as u64]);
            shuffled.sort_by_key(|&at| key(at));
            let names: Vec<&str> = shuffled.iter().map(|&at| right[at].as_str()).collect();
            let found: Vec<&str> = order(&names).unwrap().into_iter().map(|at| names[at]).collect();
            assert_eq!(found, right, "family {family}");
        }
    }

    #[test]
    fn what_can_be_read_in_two_ways_is_refused_by_name() {
        for (names, why) in [
            (&["1.png", "01.png"][..], "the same"),
            (&["frame_1", "frame_2", "frame_1_mask"], "the same"),
            (&["left_1", "right_1"], "the same"),
            (&["1.9", "1.867", "2.0"], "fraction"),
            (&["31-04-2024 1", "01-05-2024 2"], "year"),
            (&["04.30.2024_7", "05.01.2024_8"], "year"),
            (&["DSC_0005", "IMG_0001"], "different patterns"),
            (&["a9", "b3", "b4"], "different patterns"),
        ] {
            let doubt = order(names).unwrap_err();
            let message = doubt.to_string();
            assert!(message.contains(why), "{names:?}: {message}");
            assert!(names.contains(&doubt.first.as_str()) && names.contains(&doubt.second.as_str()), "{message}");
        }
        for names in [&["1.900", "1.867"][..], &["1.2.10", "1.2.9"], &["a", "b"], &["DSC_0001", "IMG_0002"], &[]] {
            assert!(order(names).is_ok(), "{names:?}");
        }
    }
}
