//! Other programs: run to their end, ended where they hang, and never left behind.

use std::{
    io::{self, BufRead, BufReader, Read},
    process::{Child, Command, ExitStatus, Stdio},
    sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel},
    thread,
    time::{Duration, Instant},
};

mod answer;
mod piped;
mod watch;

pub use answer::{Answer, answer};
pub use piped::Piped;

use crate::ending;
use watch::Watch;

/// A line longer than that is passed on in pieces.
const LONGEST_LINE: u64 = 1 << 16;
/// Lines that wait to be looked at, before the program has to wait.
const WAITING: usize = 256;
/// How often it is looked whether the program has ended without closing its output.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// For so long the output of a program that has ended is waited for. Another that it started may hold it open.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// By itself.
    Itself(ExitStatus),
    /// Its threads all slept, used no processor time and said nothing for so long that it was ended.
    Hung,
}

/// Runs `command` without input to its end, and gives each line that it prints to `on_line`. It is ended where it hangs: if for `idle`
/// none of its threads, nor those of what it started, runs or uses processor time, and nothing is printed. That is known on Linux
/// alone; elsewhere it is waited for. It is also ended if this process ends, or is about to ([`ending::clear`]).
///
/// # Errors
/// If the program cannot be started or waited for.
pub fn run(mut command: Command, idle: Duration, mut on_line: impl FnMut(&str)) -> io::Result<Ended> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    end_with_us(&mut command, Signal::Kill);
    let mut child = Group::start(command)?;
    let (sender, lines) = sync_channel(WAITING);
    if let Some(stream) = child.child.stdout.take() {
        follow(stream, sender.clone())?;
    }
    if let Some(stream) = child.child.stderr.take() {
        follow(stream, sender.clone())?;
    }
    drop(sender);
    let mut watch = Watch::new(child.id, idle);
    loop {
        match lines.recv_timeout(LOOK_EVERY.min(watch.look_every)) {
            Ok(line) => {
                watch.is_busy();
                on_line(&line);
                continue;
            }
            Err(RecvTimeoutError::Timeout) => {}
            // All is said: it ends now, or does the rest in silence.
            Err(RecvTimeoutError::Disconnected) => thread::sleep(Duration::from_millis(2)),
        }
        if let Some(status) = child.ended()? {
            let until = Instant::now() + LAST_WORDS;
            loop {
                match lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
                    Ok(line) => on_line(&line),
                    Err(RecvTimeoutError::Disconnected) => break,
                    Err(RecvTimeoutError::Timeout) => {
                        // Something that it started holds the output.
                        end_group(child.id);
                        break;
                    }
                }
            }
            return Ok(Ended::Itself(status));
        }
        if watch.hangs() {
            child.end();
            return Ok(Ended::Hung);
        }
    }
}

/// Sends the lines of a stream, by a thread of its own: it is left to itself where somebody else holds the stream open.
fn follow(stream: impl Read + Send + 'static, lines: SyncSender<String>) -> io::Result<()> {
    let follow = move || {
        let mut reader = BufReader::new(stream);
        let mut line = Vec::new();
        while matches!((&mut reader).take(LONGEST_LINE).read_until(b'\n', &mut line), Ok(bytes) if bytes > 0) {
            let text = String::from_utf8_lossy(&line).trim_end().to_owned();
            line.clear();
            if lines.send(text).is_err() {
                return;
            }
        }
    };
    thread::Builder::new().name("output of a program".into()).spawn(follow).map(drop)
}

/// A program in a process group of its own, with all that it starts.
#[derive(Debug)]
struct Group {
    child: Child,
    id: u32,
    has_ended: bool,
}

impl Group {
    fn start(mut command: Command) -> io::Result<Self> {
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut list = ending::list();
        let child = command.spawn()?;
        let id = child.id();
        list.children.insert(id);
        Ok(Self { child, id, has_ended: false })
    }

    /// How it ended, if it has. With the list held: once a program that ended is asked for, its number may be another's.
    fn ended(&mut self) -> io::Result<Option<ExitStatus>> {
        let mut list = ending::list();
        let status = self.child.try_wait()?;
        if status.is_some() {
            list.children.remove(&self.id);
            self.has_ended = true;
        }
        Ok(status)
    }

    /// Waits for its end, without the list: others end meanwhile.
    fn wait(&mut self) -> io::Result<ExitStatus> {
        loop {
            if let Some(status) = self.ended()? {
                return Ok(status);
            }
            thread::sleep(Duration::from_millis(2));
        }
    }

    fn end(&mut self) {
        let mut list = ending::list();
        if !std::mem::replace(&mut self.has_ended, true) {
            end_group(self.id);
            // Where there are no groups.
            let _ = self.child.kill();
            let _ = self.child.wait();
            list.children.remove(&self.id);
        }
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        self.end();
    }
}

/// What a program is sent when this process ends without ending it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// It is asked to end, and can save what it has.
    Terminate,
    /// It is ended.
    Kill,
}

/// Has the program end when the thread that starts it does, however that happens: that thread has to stay until the program has
/// ended. On Linux; elsewhere nothing changes.
#[cfg(target_os = "linux")]
#[expect(unsafe_code, reason = "what is done between fork and exec cannot be checked")]
pub fn end_with_us(command: &mut Command, signal: Signal) {
    use std::os::unix::process::CommandExt;
    let us = std::process::id();
    let signal = match signal {
        Signal::Terminate => libc::SIGTERM,
        Signal::Kill => libc::SIGKILL,
    };
    let before = move || {
        // SAFETY: two system calls without pointers, which are allowed between fork and exec.
        let (done, parent) = unsafe { (libc::prctl(libc::PR_SET_PDEATHSIG, signal), libc::getppid()) };
        if done != 0 {
            return Err(io::Error::last_os_error());
        }
        // This process may have ended before the child asked to be told.
        if u32::try_from(parent) == Ok(us) { Ok(()) } else { Err(io::ErrorKind::NotFound.into()) }
    };
    // SAFETY: the closure calls the system alone, and allocates nothing.
    unsafe { command.pre_exec(before) };
}

/// Has the program end when the thread that starts it does, on Linux; elsewhere nothing changes.
#[cfg(not(target_os = "linux"))]
pub fn end_with_us(_: &mut Command, _: Signal) {}

/// Ends all processes of a group.
#[cfg(unix)]
#[expect(unsafe_code, reason = "the standard library ends single processes alone")]
pub(crate) fn end_group(group: u32) {
    // Numbers 0 and 1 would mean others.
    if let Some(group) = i32::try_from(group).ok().filter(|&group| group > 1) {
        // SAFETY: a system call without pointers. The group is one of a child that was not waited for, so that it is no other's.
        unsafe { libc::kill(-group, libc::SIGKILL) };
    }
}

#[cfg(not(unix))]
pub(crate) fn end_group(_: u32) {}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(600);

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn both_outputs_are_told_line_by_line_and_the_status_kept() {
        let mut lines = Vec::new();
        let ended = run(shell("echo a; echo b >&2; printf c; exit 3"), LONG, |line| lines.push(line.to_owned()));
        assert!(matches!(ended, Ok(Ended::Itself(status)) if status.code() == Some(3)));
        lines.sort();
        assert_eq!(lines, ["a", "b", "c"]);
    }

    #[test]
    fn what_holds_the_output_of_a_program_that_has_ended_keeps_nobody() {
        let ended = run(shell("sleep 600 & exit 0"), LONG, |_| {}).unwrap();
        assert!(matches!(ended, Ended::Itself(status) if status.success()));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_program_that_hangs_is_ended_with_all_that_it_started() {
        let folder = tempfile::tempdir().unwrap();
        let id = folder.path().join("id");
        let script = format!("sleep 600 & echo $! > '{}'; wait", id.display());
        assert_eq!(run(shell(&script), Duration::from_secs(1), |_| {}).unwrap(), Ended::Hung);
        let id = std::fs::read_to_string(id).unwrap();
        let begun = Instant::now();
        // Where nobody waits for what is left, it stays as a dead process.
        while std::fs::read_to_string(format!("/proc/{}/stat", id.trim()))
            .is_ok_and(|stat| !stat.contains(") Z ") && !stat.contains(") X "))
        {
            assert!(begun.elapsed() < Duration::from_secs(60), "it goes on");
            thread::sleep(Duration::from_millis(10));
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_program_that_computes_or_talks_does_not_hang() {
        let limit = Duration::from_millis(300);
        let ended = run(shell("i=0; while [ $i -lt 1000000 ]; do i=$((i+1)); done"), limit, |_| {}).unwrap();
        assert!(matches!(ended, Ended::Itself(status) if status.success()), "{ended:?}");
    }
}
