//! `curve.csv`: how a run went, line by line.

use std::{
    fmt::Write as _,
    fs::{File, OpenOptions},
    io::Write,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;

use super::{RunError, json};

const HEADER: &str = "iteration,stage,wall_seconds,loss_rgb,loss_event,loss_trajectory,loss_colour,loss_plane,gaussians,dynamic,psnr,dpsnr,psnr_static,cpu_seconds";
const FIELDS: usize = 14;
/// The header before the last two columns were added; rows of such a file end there.
const OLD_HEADER: &str = "iteration,stage,wall_seconds,loss_rgb,loss_event,loss_trajectory,loss_colour,loss_plane,gaussians,dynamic,psnr,dpsnr";

/// One row of `curve.csv`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CurveRow {
    /// Iterations done, counted over all stages.
    pub iteration: u64,
    /// Name of the stage: `coarse` or `fine`.
    pub stage: String,
    /// Wall seconds since the start of training, without evaluation and without writing files.
    pub wall_seconds: f64,
    /// Photometric loss; empty where the iteration had none.
    pub loss_rgb: Option<f64>,
    /// Event loss.
    pub loss_event: Option<f64>,
    /// Trajectory regularisation.
    pub loss_trajectory: Option<f64>,
    /// Colour regularisation.
    pub loss_colour: Option<f64>,
    /// Plane regularisation, all terms.
    pub loss_plane: Option<f64>,
    /// Gaussians.
    pub gaussians: u64,
    /// Gaussians that move.
    pub dynamic: u64,
    /// Mean PSNR of the held-out frames, dB; empty except at evaluations.
    pub psnr: Option<f64>,
    /// Mean DPSNR of the held-out frames, dB; empty except at evaluations.
    pub dpsnr: Option<f64>,
    /// Mean PSNR of the held-out frames over the pixels that stand still, dB; empty except at evaluations.
    pub psnr_static: Option<f64>,
    /// CPU seconds of all threads, counted like `wall_seconds`; empty where the system does not tell.
    pub cpu_seconds: Option<f64>,
}

impl CurveRow {
    fn line(&self) -> String {
        let mut line =
            format!("{},{},{:.3}", self.iteration, self.stage.replace([',', '\n', '\r', '"'], " "), self.wall_seconds);
        let losses = [self.loss_rgb, self.loss_event, self.loss_trajectory, self.loss_colour, self.loss_plane];
        for loss in losses {
            push_field(&mut line, loss);
        }
        let _ = write!(line, ",{},{}", self.gaussians, self.dynamic);
        push_field(&mut line, self.psnr);
        push_field(&mut line, self.dpsnr);
        push_field(&mut line, self.psnr_static);
        push_field(&mut line, self.cpu_seconds);
        line.push('\n');
        line
    }

    fn parse(line: &str, old: bool) -> Result<Self, String> {
        let mut fields: Vec<&str> = line.split(',').collect();
        if old {
            fields.extend(["", ""]);
        }
        let [
            iteration,
            stage,
            wall,
            rgb,
            event,
            trajectory,
            colour,
            plane,
            gaussians,
            dynamic,
            psnr,
            dpsnr,
            still,
            cpu,
        ] = <[&str; FIELDS]>::try_from(fields).map_err(|got| format!("{} fields instead of {FIELDS}", got.len()))?;
        Ok(Self {
            iteration: number(iteration, "iteration")?,
            stage: stage.into(),
            wall_seconds: number(wall, "wall_seconds")?,
            loss_rgb: optional(rgb, "loss_rgb")?,
            loss_event: optional(event, "loss_event")?,
            loss_trajectory: optional(trajectory, "loss_trajectory")?,
            loss_colour: optional(colour, "loss_colour")?,
            loss_plane: optional(plane, "loss_plane")?,
            gaussians: number(gaussians, "gaussians")?,
            dynamic: number(dynamic, "dynamic")?,
            psnr: optional(psnr, "psnr")?,
            dpsnr: optional(dpsnr, "dpsnr")?,
            psnr_static: optional(still, "psnr_static")?,
            cpu_seconds: optional(cpu, "cpu_seconds")?,
        })
    }
}

fn push_field(line: &mut String, value: Option<f64>) {
    line.push(',');
    if let Some(value) = value {
        // The shortest text that reads back as the same number.
        let _ = write!(line, "{value}");
    }
}

fn number<T: std::str::FromStr>(field: &str, name: &str) -> Result<T, String> {
    field.parse().map_err(|_| format!("{name} is '{field}', not a number"))
}

fn optional(field: &str, name: &str) -> Result<Option<f64>, String> {
    if field.is_empty() { Ok(None) } else { number(field, name).map(Some) }
}

/// The rows of a `curve.csv`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// The rows, as written.
    pub rows: Vec<CurveRow>,
    /// Set where the last line is cut short (the run was killed while it wrote): what is wrong with it. The line is
    /// not among the rows.
    pub cut: Option<String>,
}

impl Curve {
    /// Reads `curve.csv`.
    ///
    /// # Errors
    /// [`RunError::Missing`], [`RunError::File`], and [`RunError::Malformed`] for a wrong header or a bad line that is
    /// not the last one.
    pub fn read(path: &Path) -> Result<Self, RunError> {
        let text = json::read_text(path, "the run has not begun to train; start it with `erfgs train`")?;
        let malformed = |message| RunError::Malformed {
            path: path.to_owned(),
            what: "training curve",
            message,
            remedy: "correct the line, or train the run again",
        };
        let complete = text.ends_with('\n');
        let mut lines = text.lines().enumerate().peekable();
        let mut old = false;
        match lines.next() {
            Some((_, header)) if !text.contains('\n') && HEADER.starts_with(header) => {
                return Ok(Self { rows: Vec::new(), cut: Some("the header is cut short".into()) });
            }
            Some((_, HEADER)) => {}
            Some((_, OLD_HEADER)) => old = true,
            None => return Ok(Self { rows: Vec::new(), cut: Some("the file is empty".into()) }),
            Some(_) => return Err(malformed(format!("line 1 should read '{HEADER}'"))),
        }
        let mut curve = Self::default();
        while let Some((index, line)) = lines.next() {
            let last = lines.peek().is_none();
            match CurveRow::parse(line, old) {
                // A last line without its newline may have lost digits of its last number.
                _ if last && !complete => curve.cut = Some(format!("line {} is cut short", index + 1)),
                Ok(row) => curve.rows.push(row),
                Err(message) => return Err(malformed(format!("line {}: {message}", index + 1))),
            }
        }
        Ok(curve)
    }
}

/// Appends rows to `curve.csv`; each is on disk when [`CurveWriter::append`] returns.
#[derive(Debug)]
pub struct CurveWriter {
    path: PathBuf,
    file: File,
}

impl CurveWriter {
    /// Starts a new curve at `path`.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn create(path: &Path) -> Result<Self, RunError> {
        json::write_atomically(path, format!("{HEADER}\n").as_bytes())?;
        Self::open(path)
    }

    /// Continues the curve at `path` from a checkpoint taken after `iteration` iterations: later rows, and a last line
    /// that was cut short, are dropped. A missing file is started anew.
    ///
    /// # Errors
    /// Those of [`Curve::read`], and [`RunError::File`].
    pub fn resume(path: &Path, iteration: u64) -> Result<Self, RunError> {
        let curve = match Curve::read(path) {
            Err(RunError::Missing { .. }) => return Self::create(path),
            read => read?,
        };
        let mut text = format!("{HEADER}\n");
        for row in curve.rows.iter().filter(|row| row.iteration <= iteration) {
            text.push_str(&row.line());
        }
        json::write_atomically(path, text.as_bytes())?;
        Self::open(path)
    }

    /// Writes one row.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn append(&mut self, row: &CurveRow) -> Result<(), RunError> {
        let written = self.file.write_all(row.line().as_bytes()).and_then(|()| self.file.flush());
        Ok(written.map_err(FileError::when("write", &self.path))?)
    }

    fn open(path: &Path) -> Result<Self, RunError> {
        let file = OpenOptions::new().append(true).open(path).map_err(FileError::when("write", path))?;
        Ok(Self { path: path.to_owned(), file })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn row(iteration: u64) -> CurveRow {
        CurveRow {
            iteration,
            stage: "fine".into(),
            wall_seconds: iteration as f64 / 8.0,
            loss_rgb: Some(0.03),
            gaussians: 1000 + iteration,
            psnr: iteration.is_multiple_of(100).then_some(24.5),
            ..CurveRow::default()
        }
    }

    fn written(rows: &[CurveRow]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.csv");
        let mut writer = CurveWriter::create(&path).unwrap();
        for row in rows {
            writer.append(row).unwrap();
        }
        (folder, path)
    }

    #[test]
    fn resuming_drops_the_rows_after_the_checkpoint() {
        let (_folder, path) = written(&[row(50), row(100), row(150), row(200)]);
        let mut writer = CurveWriter::resume(&path, 100).unwrap();
        writer.append(&row(110)).unwrap();
        let iterations: Vec<u64> = Curve::read(&path).unwrap().rows.iter().map(|row| row.iteration).collect();
        assert_eq!(iterations, [50, 100, 110]);
    }

    #[test]
    fn a_curve_from_before_cpu_time_was_told_is_read_and_resumed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.csv");
        std::fs::write(&path, format!("{OLD_HEADER}\n50,fine,6.25,0.03,,,,,1050,0,,\n")).unwrap();
        assert_eq!(Curve::read(&path).unwrap().rows, [row(50)]);
        CurveWriter::resume(&path, 50).unwrap().append(&row(100)).unwrap();
        assert_eq!(Curve::read(&path).unwrap().rows, [row(50), row(100)]);
    }

    #[test]
    fn resuming_without_a_curve_starts_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.csv");
        CurveWriter::resume(&path, 10).unwrap().append(&row(11)).unwrap();
        assert_eq!(Curve::read(&path).unwrap().rows, [row(11)]);
    }

    #[test]
    fn any_truncation_loses_at_most_the_line_it_cuts() {
        let rows = [row(50), row(100), row(150)];
        let (_folder, path) = written(&rows);
        let whole = std::fs::read(&path).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let curve = Curve::read(&path).unwrap();
            let lines = whole[..length].iter().filter(|&&byte| byte == b'\n').count();
            assert_eq!(curve.rows, rows[..lines.saturating_sub(1)], "cut at {length}");
            let at_line_end = length > 0 && whole[length - 1] == b'\n';
            assert_eq!(curve.cut.is_some(), !at_line_end, "cut at {length}");
        }
    }

    #[test]
    fn a_bad_line_in_the_middle_is_an_error_that_names_the_line() {
        let (_folder, path) = written(&[row(50), row(100)]);
        let text = std::fs::read_to_string(&path).unwrap().replacen("50,fine", "fifty,fine", 1);
        std::fs::write(&path, text).unwrap();
        let message = Curve::read(&path).unwrap_err().to_string();
        assert!(message.contains("line 2") && message.contains("fifty"), "{message}");
    }

    #[test]
    fn a_foreign_csv_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.csv");
        std::fs::write(&path, "a,b\n1,2\n").unwrap();
        assert!(matches!(Curve::read(&path), Err(RunError::Malformed { .. })));
    }

    proptest! {
        #[test]
        fn numbers_survive_the_round_trip_exactly(loss in any::<f64>(), psnr in proptest::option::of(-50.0..150.0), n in any::<u64>()) {
            let row = CurveRow { iteration: n, loss_rgb: Some(loss), psnr, gaussians: n, ..row(8) };
            let back = CurveRow::parse(row.line().trim_end(), false).unwrap();
            let back_loss = back.loss_rgb.unwrap();
            prop_assert!(back_loss.to_bits() == loss.to_bits() || (back_loss.is_nan() && loss.is_nan()));
            prop_assert_eq!(back.psnr, psnr);
            prop_assert_eq!(back.gaussians, n);
        }

        #[test]
        fn arbitrary_text_never_panics(text in "\\PC{0,200}") {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("curve.csv");
            std::fs::write(&path, format!("{HEADER}\n{text}")).unwrap();
            let _ = Curve::read(&path);
        }
    }
}
