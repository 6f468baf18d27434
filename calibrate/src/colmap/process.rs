//! Running a program while reading what it prints.

use std::{
    collections::VecDeque,
    io::{self, BufRead, BufReader, Read},
    process::{Command, ExitStatus, Stdio},
    sync::Mutex,
    thread,
};

/// How many of the last lines are kept for an error message.
const TAIL_LINES: usize = 15;

/// How a program ended.
#[derive(Debug)]
pub struct Outcome {
    /// Its exit status.
    pub status: ExitStatus,
    /// The last lines it printed.
    pub tail: String,
}

/// Runs `command` to its end. `progress` is called for each line that counts items, as in `Processed file [3/81]`.
pub fn run(mut command: Command, progress: &(dyn Fn(usize, usize) + Sync)) -> io::Result<Outcome> {
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let tail = Mutex::new(VecDeque::new());
    let follow = |stream: &mut dyn Read| {
        let mut reader = BufReader::new(stream);
        let mut line = Vec::new();
        while matches!(reader.read_until(b'\n', &mut line), Ok(bytes) if bytes > 0) {
            let text = String::from_utf8_lossy(&line).trim_end().to_owned();
            line.clear();
            if let Some((done, total)) = count(&text) {
                progress(done, total);
            }
            if !text.is_empty() {
                let mut tail = tail.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                if tail.len() == TAIL_LINES {
                    tail.pop_front();
                }
                tail.push_back(text);
            }
        }
    };
    let (mut stdout, mut stderr) = (child.stdout.take(), child.stderr.take());
    thread::scope(|scope| {
        if let Some(stream) = stdout.as_mut() {
            scope.spawn(|| follow(stream));
        }
        if let Some(stream) = stderr.as_mut() {
            scope.spawn(|| follow(stream));
        }
    });
    let status = child.wait()?;
    let tail = tail.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    Ok(Outcome { status, tail: Vec::from(tail).join("\n") })
}

/// The counts in `... [3/81] ...`.
fn count(line: &str) -> Option<(usize, usize)> {
    let inside = line.split('[').skip(1).filter_map(|part| part.split(']').next());
    inside.filter_map(|part| part.split_once('/')).find_map(|(done, total)| {
        let (done, total) = (done.trim().parse().ok()?, total.trim().parse().ok()?);
        (done <= total && total > 0).then_some((done, total))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_from_the_log_of_either_version() {
        assert_eq!(count("Processed file [3/81]"), Some((3, 81)));
        assert_eq!(count("I20250101 12:00:00 1 feature_extraction.cc:258] Processed file [27/27]"), Some((27, 27)));
        assert_eq!(count("Triangulating image #5 (3)"), None);
        assert_eq!(count("[1/0] [a/b] ["), None);
    }
}
