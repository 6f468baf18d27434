//! Progress of long work: a bar with the time left on a terminal, a line now and then elsewhere, or JSON for a program that shows it.

use std::{
    io::IsTerminal,
    sync::{Mutex, OnceLock},
    time::{Duration, Instant},
};

use erfgs_base::names::printable;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};

/// Work that ends before this shows nothing.
const QUIET_AT_FIRST: Duration = Duration::from_secs(2);
/// How often a line is printed where stderr is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(30);
/// How often a line of JSON is printed, at most.
const JSON_EVERY: Duration = Duration::from_millis(200);
/// Parts that the bar is divided into.
const PARTS: u64 = 10_000;

/// The progress of one piece of work. May be updated from any thread; the display goes when it is dropped.
pub struct Progress {
    label: String,
    bar: ProgressBar,
    style: Style,
    /// Share that was done, and when, at the first update.
    first: OnceLock<(f64, Instant)>,
    last_line: Mutex<Instant>,
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Shown {
    /// A bar, or a line each half minute where stderr is no terminal
    #[default]
    Bar,
    /// A line of JSON up to five times a second on stderr: {"progress": {"task", "share", "text"}}, with "values" of a training
    Json,
}

#[derive(PartialEq)]
enum Style {
    Silent,
    Bar,
    Lines,
    Json,
}

impl Progress {
    /// Starts the clock.
    pub fn new(label: &str, quiet: bool, shown: Shown) -> Self {
        let label = printable(label);
        let style = match shown {
            _ if quiet => Style::Silent,
            Shown::Json => Style::Json,
            Shown::Bar if std::io::stderr().is_terminal() => Style::Bar,
            Shown::Bar => Style::Lines,
        };
        let bar = ProgressBar::hidden();
        bar.set_length(PARTS);
        if let Ok(looks) = ProgressStyle::with_template("{prefix} [{bar:30}] {percent}%, {eta} left, {msg}") {
            bar.set_style(looks.progress_chars("=> "));
        }
        bar.set_prefix(label.clone());
        Self { label, bar, style, first: OnceLock::new(), last_line: Mutex::new(Instant::now()) }
    }

    /// `done` of `total` things called `what` are finished.
    pub fn update(&self, done: u64, total: u64, what: &str) {
        let share = if total > 0 { done as f64 / total as f64 } else { 0.0 };
        self.share(share, || format!("{done} of {total} {what}"));
    }

    /// Nothing new is known, and the work goes on: says so now and then where stderr is no terminal, and keeps the bar moving.
    pub fn still(&self) {
        let Some(&(_, since)) = self.first.get() else { return };
        if matches!(self.style, Style::Silent | Style::Json) || since.elapsed() < QUIET_AT_FIRST {
            return;
        }
        if self.style == Style::Bar {
            if self.bar.is_hidden() {
                self.bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(5));
            }
            self.bar.tick();
            return;
        }
        let Ok(mut last) = self.last_line.lock() else { return };
        if last.elapsed() >= LINE_EVERY {
            *last = Instant::now();
            eprintln!("{}: {} so far", self.label, duration(since.elapsed().as_secs_f64()));
        }
    }

    /// `share` of the work (0 to 1) is finished; `message` says what else is worth knowing.
    pub fn share(&self, share: f64, message: impl FnOnce() -> String) {
        self.values(share, message, false, || Value::Null);
    }

    /// The same with `values` for programs. `now`: they are not to be passed over.
    pub fn values(&self, share: f64, message: impl FnOnce() -> String, now: bool, values: impl FnOnce() -> Value) {
        if self.style == Style::Json {
            self.json(share, message, now, values);
            return;
        }
        let &(first, since) = self.first.get_or_init(|| {
            self.bar.set_position((share * PARTS as f64) as u64);
            self.bar.reset_eta();
            (share, Instant::now())
        });
        if self.style == Style::Silent || since.elapsed() < QUIET_AT_FIRST {
            return;
        }
        if self.style == Style::Bar {
            if self.bar.is_hidden() {
                self.bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(5));
            }
            self.bar.set_position((share * PARTS as f64) as u64);
            self.bar.set_message(message());
            return;
        }
        let Ok(mut last) = self.last_line.lock() else { return };
        if last.elapsed() >= LINE_EVERY {
            *last = Instant::now();
            eprintln!("{}", line(&self.label, share, share - first, since.elapsed(), &message()));
        }
    }

    fn json(&self, share: f64, message: impl FnOnce() -> String, now: bool, values: impl FnOnce() -> Value) {
        let is_first = self.first.set((share, Instant::now())).is_ok();
        let Ok(mut last) = self.last_line.lock() else { return };
        if is_first || now || last.elapsed() >= JSON_EVERY {
            *last = Instant::now();
            let mut progress = json!({ "task": self.label, "share": share, "text": message() });
            let values = values();
            if !values.is_null() {
                progress["values"] = values;
            }
            eprintln!("{}", json!({ "progress": progress }));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// `training: 30 %, 2 min 20 s left, PSNR 21.3 dB`, where `gained` of the work took `elapsed`.
fn line(label: &str, share: f64, gained: f64, elapsed: Duration, message: &str) -> String {
    let mut text = format!("{label}: {:.0} %", 100.0 * share);
    if gained > 0.0 && share < 1.0 {
        text.push_str(&format!(", {} left", duration(elapsed.as_secs_f64() * (1.0 - share) / gained)));
    }
    format!("{text}, {message}")
}

/// Seconds for humans: `8.2 s`, `3 min 20 s`, `2 h 05 min`.
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return "unknown time".into();
    }
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{seconds:.1} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_gives_the_time_left_from_the_pace_since_the_start() {
        // Resumed at 20 %: a tenth took a minute, so that seven more take seven.
        let text = line("training", 0.3, 0.1, Duration::from_secs(60), "PSNR 21.3 dB");
        assert_eq!(text, "training: 30 %, 7 min 00 s left, PSNR 21.3 dB");
        assert_eq!(line("reading", 0.0, 0.0, Duration::ZERO, "0 of 0 files"), "reading: 0 %, 0 of 0 files");
    }

    #[test]
    fn durations_take_the_unit_that_fits() {
        assert_eq!(
            [8.24, 200.0, 7500.0, f64::NAN].map(duration),
            ["8.2 s", "3 min 20 s", "2 h 05 min", "unknown time"]
        );
    }
}
