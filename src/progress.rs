//! Progress of long work: a bar with the time left on a terminal, a line now and then elsewhere.

use std::{
    io::IsTerminal,
    sync::Mutex,
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Work that ends before this shows nothing.
const QUIET_AT_FIRST: Duration = Duration::from_secs(2);
/// How often a line is printed where stderr is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(30);

/// The progress of one piece of work. May be updated from any thread; the display goes when it is dropped.
pub struct Progress {
    label: String,
    bar: ProgressBar,
    style: Style,
    started: Instant,
    last_line: Mutex<Instant>,
}

#[derive(PartialEq)]
enum Style {
    Silent,
    Bar,
    Lines,
}

impl Progress {
    /// Starts the clock.
    pub fn new(label: &str, quiet: bool) -> Self {
        let style = match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => Style::Silent,
            (false, true) => Style::Bar,
            (false, false) => Style::Lines,
        };
        let bar = ProgressBar::hidden();
        let template = "{prefix} [{bar:30}] {pos}/{len} {percent}%, {eta} left {msg}";
        if let Ok(looks) = ProgressStyle::with_template(template) {
            bar.set_style(looks.progress_chars("=> "));
        }
        bar.set_prefix(label.to_owned());
        let now = Instant::now();
        Self { label: label.to_owned(), bar, style, started: now, last_line: Mutex::new(now) }
    }

    /// `done` of `total` steps are finished; `message` says what else is worth knowing.
    pub fn update(&self, done: u64, total: u64, message: &str) {
        if self.style == Style::Silent {
            return;
        }
        self.bar.set_length(total);
        self.bar.set_position(done);
        if self.bar.message() != message {
            self.bar.set_message(message.to_owned());
        }
        let elapsed = self.started.elapsed();
        if elapsed < QUIET_AT_FIRST {
            return;
        }
        if self.style == Style::Bar {
            if self.bar.is_hidden() {
                self.bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(5));
            }
            return;
        }
        let Ok(mut last) = self.last_line.lock() else { return };
        if last.elapsed() >= LINE_EVERY {
            *last = Instant::now();
            eprintln!("{}", line(&self.label, done, total, elapsed, message));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// `training: 300 of 1000 (30 %), 2 min 20 s left, PSNR 21.3 dB`
fn line(label: &str, done: u64, total: u64, elapsed: Duration, message: &str) -> String {
    let mut text = format!("{label}: {done} of {total}");
    if total > 0 {
        text.push_str(&format!(" ({} %)", done * 100 / total));
    }
    if done > 0 && total > done {
        let left = elapsed.as_secs_f64() * (total - done) as f64 / done as f64;
        text.push_str(&format!(", {} left", duration(left)));
    }
    if !message.is_empty() {
        text.push_str(", ");
        text.push_str(message);
    }
    text
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
    fn a_line_gives_the_time_left_from_the_pace_so_far() {
        let text = line("training", 300, 1000, Duration::from_secs(60), "PSNR 21.3 dB");
        assert_eq!(text, "training: 300 of 1000 (30 %), 2 min 20 s left, PSNR 21.3 dB");
        assert_eq!(line("reading", 0, 0, Duration::ZERO, ""), "reading: 0 of 0");
    }

    #[test]
    fn durations_take_the_unit_that_fits() {
        assert_eq!(
            [8.24, 200.0, 7500.0, f64::NAN].map(duration),
            ["8.2 s", "3 min 20 s", "2 h 05 min", "unknown time"]
        );
    }
}
