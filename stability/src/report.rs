//! The suite as a document.

use crate::{Bound, Expected, Row, Verdict};

/// What the table is of.
#[derive(Clone, Debug)]
pub struct Made {
    /// The command that made it.
    pub command: String,
    /// The program's version.
    pub version: String,
    /// The adapter that the kernels ran on.
    pub adapter: String,
}

/// How a row was judged, short: what had to come of it, the reason, and what was measured.
#[must_use]
pub fn cells(row: &Row) -> [String; 5] {
    let bound = |bound: &Bound| format!("{} {}", figure(bound.most), bound.unit);
    let (must, why) = match &row.expected {
        Expected::Within(within) => (bound(within), within.why.to_owned()),
        Expected::Refusal(names) => (format!("a refusal that names `{names}`"), "there is no answer".to_owned()),
        Expected::Either(within, names) => {
            (format!("{}, or a refusal that names `{names}`", bound(within)), within.why.to_owned())
        }
    };
    let measured = row.measured.map_or("-".into(), |measured| figure(measured.error));
    let cpu = row.cpu_seconds.map_or("-".into(), |seconds| format!("{seconds:.2}"));
    let not_finite = row.measured.map_or("-".into(), |measured| measured.not_finite.to_string());
    [must, why, measured, not_finite, cpu]
}

/// Three digits: `0.0123`, `1.2e-7`.
#[must_use]
pub fn figure(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if (1e-2..1e4).contains(&size) => {
            let digits = (2 - size.log10().floor() as i32).clamp(0, 4) as usize;
            let text = format!("{value:.digits$}");
            if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
        }
        _ => format!("{value:.1e}"),
    }
}

/// The document, in Markdown.
#[must_use]
pub fn markdown(rows: &[Row], made: &Made) -> String {
    let failed = rows.iter().filter(|row| row.failed()).count();
    let refused = rows.iter().filter(|row| matches!(row.verdict, Verdict::Refused(_))).count();
    let mut text = format!(
        "# Stability\n\n\
         Results of stiff and extreme cases. `{}` made this file (version {}, kernels on {}); run it again for the figures of your \
         machine. Its exit code is 1 if a case fails.\n\n\
         The expected result of each case is stated beforehand: finite numbers with an error within a bound, which has a reason, \
         against an independent reference; or an error that names the cause. CPU time is that of all \
         threads.\n\n\
         {} cases: {} finite and within their bounds, {refused} refused as they must be, {failed} failed.\n",
        made.command,
        made.version,
        made.adapter,
        rows.len(),
        rows.len() - failed - refused,
    );
    let mut part = "";
    for row in rows {
        if row.part != part {
            part = row.part;
            text.push_str(&format!(
                "\n## {}\n\n{}\n\n| case | bound | its reason | error | not finite | CPU s | verdict |\n|---|---|---|---|---|---|---|\n",
                capital(part),
                crate::truth(part)
            ));
        }
        let [must, why, measured, not_finite, cpu] = cells(row);
        let line = [row.name.clone(), must, why, measured, not_finite, cpu, row.verdict.to_string()]
            .map(|cell| cell.replace('|', "\\|").replace('\n', " "));
        text.push_str(&format!("| {} |\n", line.join(" | ")));
    }
    text
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Measured;

    #[test]
    fn the_document_has_each_part_once_and_counts_what_failed() {
        let bound = Bound { most: 2e-4, unit: "of white", why: "rounding" };
        let row = |part, name: &str, error, verdict| Row {
            part,
            name: name.into(),
            expected: Expected::Within(bound),
            measured: Some(Measured { error, not_finite: 0 }),
            cpu_seconds: Some(0.125),
            verdict,
        };
        let rows = [
            row("rasteriser", "needles", 1.23456e-5, Verdict::Within),
            row("rasteriser", "a | b", 0.3, Verdict::Fail("too much".into())),
            row("clock fits", "an hour", 0.0, Verdict::Within),
        ];
        let made = Made { command: "erfgs bench stability".into(), version: "1".into(), adapter: "a card".into() };
        let text = markdown(&rows, &made);
        assert!(
            text.contains("3 cases: 2 finite and within their bounds, 0 refused as they must be, 1 failed."),
            "{text}"
        );
        assert_eq!((text.matches("## Rasteriser").count(), text.matches("## Clock fits").count()), (1, 1));
        let needles = "| needles | 2.0e-4 of white | rounding | 1.2e-5 | 0 | 0.12 | finite, within its bound |";
        assert!(text.contains(needles), "{text}");
        assert!(text.contains("| a \\| b |"), "{text}");
    }

    #[test]
    fn figures_have_three_digits() {
        let all = [0.0, 0.0123, 1.0, 1000.0, 95_000.0, 1.2e-7, 31.45].map(figure);
        assert_eq!(all, ["0", "0.0123", "1", "1000", "9.5e4", "1.2e-7", "31.4"]);
    }
}
