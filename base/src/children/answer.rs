//! Programs that are asked a question.

use std::{
    io::{self, Read},
    process::{Command, ExitStatus, Stdio},
    sync::mpsc::{Receiver, sync_channel},
    thread,
    time::{Duration, Instant},
};

use super::{Group, LAST_WORDS, Signal, end_with_us};

/// How often it is looked whether the program has ended.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// What a program answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// How it ended.
    pub status: ExitStatus,
    /// What it printed.
    pub out: String,
    /// What it printed of errors.
    pub errors: String,
}

/// Runs `command` without input to its end, and gives what it printed. It ends with this process.
///
/// # Errors
/// If the program cannot be started; with [`io::ErrorKind::TimedOut`] if it was ended since it went on for longer than `patience`,
/// and with [`io::ErrorKind::FileTooLarge`] if it printed more than `most` bytes.
pub fn answer(mut command: Command, patience: Duration, most: usize) -> io::Result<Answer> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    end_with_us(&mut command, Signal::Kill);
    let mut child = Group::start(command)?;
    let out = child.child.stdout.take().map(|stream| listen(stream, most)).transpose()?;
    let errors = child.child.stderr.take().map(|stream| listen(stream, most)).transpose()?;
    let begun = Instant::now();
    let (mut outputs, mut waiting) = ([None, None], [out, errors]);
    let status = loop {
        for (output, stream) in std::iter::zip(&mut outputs, &mut waiting) {
            if let Some(bytes) = stream.as_ref().and_then(|stream| stream.try_recv().ok()) {
                within(&bytes, most)?;
                (*output, *stream) = (Some(bytes), None);
            }
        }
        if let Some(status) = child.ended()? {
            break status;
        }
        if begun.elapsed() > patience {
            let what = format!("it did not end within {} s, and was ended", patience.as_secs_f64());
            return Err(io::Error::new(io::ErrorKind::TimedOut, what));
        }
        thread::sleep(LOOK_EVERY);
    };
    let until = Instant::now() + LAST_WORDS;
    let [out, errors] = [0, 1].map(|which| {
        let last = |stream: &Receiver<Vec<u8>>| {
            // Nothing comes where something that it started holds the output.
            stream.recv_timeout(until.saturating_duration_since(Instant::now())).ok()
        };
        outputs[which].take().or_else(|| waiting[which].as_ref().and_then(last)).unwrap_or_default()
    });
    within(&out, most)?;
    within(&errors, most)?;
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    Ok(Answer { status, out: text(out), errors: text(errors) })
}

fn within(bytes: &[u8], most: usize) -> io::Result<()> {
    if bytes.len() <= most {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("it printed more than {most} bytes, and was ended")))
}

/// Reads a stream to its end, or one byte further than `most`, by a thread of its own.
fn listen(stream: impl Read + Send + 'static, most: usize) -> io::Result<Receiver<Vec<u8>>> {
    let (sender, receiver) = sync_channel(1);
    let listen = move || {
        let mut bytes = Vec::new();
        // What was read before an error is what it said.
        let _ = stream.take(most as u64 + 1).read_to_end(&mut bytes);
        let _ = sender.send(bytes);
    };
    thread::Builder::new().name("output of a program".into()).spawn(listen)?;
    Ok(receiver)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn shell(script: &str, ms: u64, most: usize) -> Result<Answer, io::ErrorKind> {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        answer(command, Duration::from_millis(ms), most).map_err(|error| error.kind())
    }

    #[test]
    fn what_a_program_prints_is_told_whole_and_how_it_ended() {
        // More than a pipe holds, so that it has to be read while the program runs.
        let output = shell("seq 100000; echo no >&2; exit 3", 60_000, 1 << 20).unwrap();
        assert_eq!((output.status.code(), output.errors.as_str()), (Some(3), "no\n"));
        assert!(output.out.len() > 500_000 && output.out.ends_with("100000\n"));
    }

    #[test]
    fn what_goes_on_or_never_stops_talking_is_ended() {
        assert_eq!(shell("sleep 600", 50, 1000), Err(io::ErrorKind::TimedOut));
        assert_eq!(shell("yes", 60_000, 1000), Err(io::ErrorKind::FileTooLarge));
        assert_eq!(shell("yes >&2", 60_000, 1000), Err(io::ErrorKind::FileTooLarge));
        let none = answer(Command::new("no-such-program"), Duration::from_secs(1), 10);
        assert_eq!(none.map_err(|error| error.kind()), Err(io::ErrorKind::NotFound));
        // Something that it started holds the output.
        assert!(shell("sleep 600 & exit 0", 60_000, 1000).is_ok_and(|output| output.status.success()));
    }
}
