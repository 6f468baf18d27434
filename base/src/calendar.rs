//! The Gregorian calendar in UTC, both ways (after H. Hinnant, "chrono-Compatible Low-Level Date Algorithms").

use std::fmt;

const SECONDS_A_DAY: i64 = 86_400;
/// Days of an era of 400 years, after which the calendar repeats.
const DAYS_AN_ERA: i64 = 146_097;
/// Days from 0000-03-01 to 1970-01-01. Years are counted from March, so that the leap day comes last.
const DAYS_TO_1970: i64 = 719_468;

/// A date and a time of day in UTC. Shown as `YYYY-MM-DD hh:mm:ss`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DateTime {
    /// Year; 0 is 1 BC.
    pub year: i64,
    /// Month, 1 to 12.
    pub month: i64,
    /// Day of the month, from 1.
    pub day: i64,
    /// Hour.
    pub hour: i64,
    /// Minute.
    pub minute: i64,
    /// Second.
    pub second: i64,
}

impl DateTime {
    /// Of seconds since 1970, before it where they are negative.
    #[must_use]
    pub fn of_seconds(seconds: i64) -> Self {
        let (days, second) = (seconds.div_euclid(SECONDS_A_DAY) + DAYS_TO_1970, seconds.rem_euclid(SECONDS_A_DAY));
        let (era, day) = (days.div_euclid(DAYS_AN_ERA), days.rem_euclid(DAYS_AN_ERA));
        let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
        let day = day - (365 * year + year / 4 - year / 100);
        let month = (5 * day + 2) / 153;
        let day = day - (153 * month + 2) / 5 + 1;
        let month = if month < 10 { month + 3 } else { month - 9 };
        let year = year + era * 400 + i64::from(month <= 2);
        Self { year, month, day, hour: second / 3600, minute: second / 60 % 60, second: second % 60 }
    }

    /// Of nanoseconds since 1970; what is left of a second is dropped.
    #[must_use]
    pub fn of_ns(ns: i64) -> Self {
        Self::of_seconds(ns.div_euclid(1_000_000_000))
    }

    /// Seconds since 1970; `None` where month or day are none, or the year is too far off. Times of day beyond 24 hours
    /// reach into the next days, as leap seconds do.
    #[must_use]
    pub fn seconds(&self) -> Option<i64> {
        if !(1..=12).contains(&self.month) || !(1..=31).contains(&self.day) {
            return None;
        }
        let year = self.year.checked_sub(i64::from(self.month <= 2))?;
        let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
        let of_year = (153 * ((self.month + 9) % 12) + 2) / 5 + self.day - 1;
        let days = era
            .checked_mul(DAYS_AN_ERA)?
            .checked_add(of_era * 365 + of_era / 4 - of_era / 100 + of_year - DAYS_TO_1970)?;
        let of_day =
            self.hour.checked_mul(3600)?.checked_add(self.minute.checked_mul(60)?)?.checked_add(self.second)?;
        days.checked_mul(SECONDS_A_DAY)?.checked_add(of_day)
    }

    /// From six numbers, year to second, with anything but digits between them.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut numbers = text.split(|letter: char| !letter.is_ascii_digit()).map(|number| number.parse().ok());
        let mut next = || numbers.next().flatten();
        let read =
            Self { year: next()?, month: next()?, day: next()?, hour: next()?, minute: next()?, second: next()? };
        numbers.next().is_none().then_some(read)
    }
}

impl fmt::Display for DateTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { year, month, day, hour, minute, second } = self;
        write!(f, "{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}")
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01 00:00:00"),
            (951_782_399, "2000-02-28 23:59:59"),
            (951_782_400, "2000-02-29 00:00:00"),
            (1_750_000_000, "2025-06-15 15:06:40"),
        ] {
            assert_eq!(DateTime::of_seconds(seconds).to_string(), text);
            assert_eq!(DateTime::parse(text).and_then(|date| date.seconds()), Some(seconds));
        }
        assert_eq!(DateTime::of_seconds(-1).to_string(), "1969-12-31 23:59:59");
        assert_eq!(DateTime::of_ns(-1), DateTime::of_seconds(-1));
    }

    #[test]
    fn what_is_no_date_is_none() {
        for wrong in ["", "yesterday", "2025-13-01 00:00:00", "2025-06-15", "99999999999999999999-01-01 0:0:0"] {
            assert_eq!(DateTime::parse(wrong).and_then(|date| date.seconds()), None, "{wrong}");
        }
        let far = [i64::MIN, i64::MAX].map(|year| DateTime { year, ..DateTime::of_seconds(0) }.seconds());
        assert_eq!(far, [None, None]);
    }

    proptest! {
        #[test]
        fn seconds_to_date_and_back_is_the_same(seconds in i64::MIN / 2..i64::MAX / 2, near in -1_i64 << 36..1 << 36) {
            for seconds in [seconds, near] {
                prop_assert_eq!(DateTime::of_seconds(seconds).seconds(), Some(seconds));
            }
        }

        #[test]
        fn a_date_reads_back_from_its_text(seconds in -62_167_219_200_i64..1 << 40) {
            let date = DateTime::of_seconds(seconds);
            prop_assert_eq!(DateTime::parse(&date.to_string()), Some(date));
        }
    }
}
