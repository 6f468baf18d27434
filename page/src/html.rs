//! Text for HTML: escaping, numbers, and the frame of the page.

use std::fmt::{self, Display, Write as _};

/// Text with what means something in HTML escaped. Every name and value from a file goes through it.
pub struct Escaped<'a>(pub &'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for character in self.0.chars() {
            match character {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                other => f.write_char(other)?,
            }
        }
        Ok(())
    }
}

/// A number with `decimals` digits after the point, groups of three parted by thin spaces, and a real minus sign.
#[must_use]
pub fn number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return if value.is_nan() {
            "NaN".into()
        } else if value > 0.0 {
            "∞".into()
        } else {
            "−∞".into()
        };
    }
    let plain = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = plain.split_once('.').unwrap_or((&plain, ""));
    let mut text = String::new();
    if value < 0.0 && plain.bytes().any(|digit| (b'1'..=b'9').contains(&digit)) {
        text.push('−');
    }
    for (at, digit) in whole.chars().enumerate() {
        // Four digits stand together; five and more are grouped.
        if at > 0 && (whole.len() - at).is_multiple_of(3) && whole.len() > 4 {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    if !fraction.is_empty() {
        text.push('.');
        text.push_str(fraction);
    }
    text
}

/// A whole number.
#[must_use]
pub fn count(value: u64) -> String {
    number(value as f64, 0)
}

/// A difference, with its sign.
#[must_use]
pub fn difference(value: f64, decimals: usize) -> String {
    let text = number(value, decimals);
    if value.is_nan() || text.starts_with('−') {
        return text;
    }
    if text.bytes().any(|byte| (b'1'..=b'9').contains(&byte)) || value.is_infinite() {
        format!("+{text}")
    } else {
        format!("±{text}")
    }
}

/// Seconds as people say them.
#[must_use]
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return number(seconds, 1);
    }
    let whole = seconds.round() as u64;
    match whole {
        0..100 => format!("{} s", number(seconds, 1)),
        100..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

/// Bytes in decimal units.
#[must_use]
pub fn bytes(value: u64) -> String {
    let value = value as f64;
    match value {
        ..1e3 => format!("{} B", number(value, 0)),
        ..1e6 => format!("{} kB", number(value / 1e3, 1)),
        ..1e9 => format!("{} MB", number(value / 1e6, 1)),
        _ => format!("{} GB", number(value / 1e9, 2)),
    }
}

/// A section with a heading; `prefix` goes before its id. Nothing where the body is empty.
#[must_use]
pub fn section(prefix: &str, id: &str, heading: &str, body: &str) -> String {
    if body.is_empty() {
        return String::new();
    }
    format!("<section id=\"{}{id}\">\n<h2>{}</h2>\n{body}</section>\n", prefix, Escaped(heading))
}

/// A table in a box that scrolls where the page is narrow. `head` and `rows` are HTML.
#[must_use]
pub fn table(class: &str, head: &str, rows: &str) -> String {
    format!(
        "<div class=\"scroll\"><table class=\"{class}\"><thead>{head}</thead>\n<tbody>{rows}</tbody></table></div>\n"
    )
}

/// The page: `head` goes below the title.
#[must_use]
pub fn page(title: &str, head: &str, body: &str) -> String {
    let title = Escaped(title);
    let style = include_str!("style.css");
    let version = env!("CARGO_PKG_VERSION");
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<style>\n{style}</style>\n</head>\n\
         <body>\n<main>\n<header>\n<h1>{title}</h1>\n{head}</header>\n{body}\
         <footer>Written by erfgs {version}.</footer>\n</main>\n</body>\n</html>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_names_is_shown_and_not_run() {
        assert_eq!(Escaped("<a b='c' d=\"e\">&").to_string(), "&lt;a b=&#39;c&#39; d=&quot;e&quot;&gt;&amp;");
    }

    #[test]
    fn numbers_are_grouped_and_signed() {
        assert_eq!(number(1234.0, 0), "1234");
        assert_eq!(number(-1234567.891, 2), "−1\u{2009}234\u{2009}567.89");
        assert_eq!(number(-0.001, 2), "0.00");
        assert_eq!([0.5, -0.5, 0.001].map(|value| difference(value, 2)), ["+0.50", "−0.50", "±0.00"].map(String::from));
        assert_eq!(number(f64::NAN, 1), "NaN");
    }

    #[test]
    fn durations_and_sizes_take_the_unit_that_fits() {
        assert_eq!([12.34, 754.0, 7384.0].map(duration), ["12.3 s", "12 min 34 s", "2 h 03 min"]);
        assert_eq!([999, 12_345, 12_345_678].map(bytes), ["999 B", "12.3 kB", "12.3 MB"]);
    }
}
