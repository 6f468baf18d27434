//! Other programs: run to their end, ended where they hang, and never left behind.

use std::{
    io::{self, BufRead, BufReader, Read},
    process::{Child, Command, ExitStatus, Stdio},
    sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel},
    thread,
    time::{Duration, Instant},
};

use crate::ending;

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

/// Runs `command` without input to its end, and gives each line that it prints to `said`. It is ended where it hangs: if for `idle`
/// none of its threads, nor those of what it started, runs or uses processor time, and nothing is printed. That is known on Linux
/// alone; elsewhere it is waited for. It is also ended if this process ends, or is about to ([`ending::clear`]).
///
/// # Errors
/// If the program cannot be started or waited for.
pub fn run(mut command: Command, idle: Duration, mut said: impl FnMut(&str)) -> io::Result<Ended> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
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
                said(&line);
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
                    Ok(line) => said(&line),
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
struct Group {
    child: Child,
    id: u32,
    has_ended: bool,
}

impl Group {
    fn start(mut command: Command) -> io::Result<Self> {
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        end_with_us(&mut command, Signal::Kill);
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

/// Looks whether a process group does anything.
struct Watch {
    group: u32,
    limit: Duration,
    look_every: Duration,
    looked: Instant,
    idle: Duration,
    used: Option<u64>,
}

impl Watch {
    fn new(group: u32, limit: Duration) -> Self {
        let look_every = (limit / 16).clamp(Duration::from_millis(5), Duration::from_secs(4));
        Self { group, limit, look_every, looked: Instant::now(), idle: Duration::ZERO, used: None }
    }

    fn is_busy(&mut self) {
        self.idle = Duration::ZERO;
    }

    fn hangs(&mut self) -> bool {
        let since = self.looked.elapsed();
        if since < self.look_every {
            return false;
        }
        self.looked = Instant::now();
        match processor::sleeping(self.group) {
            // No more than two looks' time: this process may have been stopped in between, and the program with it.
            used @ Some(_) if used == self.used => self.idle += since.min(2 * self.look_every),
            used => {
                self.used = used;
                self.is_busy();
            }
        }
        self.idle >= self.limit
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

#[cfg(target_os = "linux")]
mod processor {
    use std::{fs, path::Path};

    /// The processor time of a process group, in ticks, if all of its threads sleep; `None` if one runs, wants to, waits for a disk
    /// or was stopped by somebody, or where nothing is known.
    pub fn sleeping(group: u32) -> Option<u64> {
        let mut used = None;
        for entry in fs::read_dir("/proc").ok()?.flatten() {
            if !entry.file_name().to_str().is_some_and(|name| name.starts_with(|c: char| c.is_ascii_digit())) {
                continue;
            }
            // What has ended since the list was made is not there any more.
            let Some(process) = read(&entry.path()) else { continue };
            if process.group != group {
                continue;
            }
            for thread in fs::read_dir(entry.path().join("task")).ok()?.flatten() {
                if read(&thread.path()).is_some_and(|thread| !matches!(thread.state, 'S' | 'I' | 'Z' | 'X')) {
                    return None;
                }
            }
            *used.get_or_insert(0_u64) += process.used;
        }
        used
    }

    struct Process {
        state: char,
        group: u32,
        used: u64,
    }

    fn read(folder: &Path) -> Option<Process> {
        parse(&fs::read_to_string(folder.join("stat")).ok()?)
    }

    /// State, group, and the times of the process and of what it has waited for. Its name, in parentheses, may hold anything.
    fn parse(stat: &str) -> Option<Process> {
        let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_ascii_whitespace().collect();
        let number = |index: usize| fields.get(index)?.parse::<u64>().ok();
        let used = number(11)?.checked_add(number(12)?)?.checked_add(number(13)?)?.checked_add(number(14)?)?;
        Some(Process { state: fields.first()?.chars().next()?, group: number(2)?.try_into().ok()?, used })
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn the_name_of_a_program_is_no_number() {
            let stat = "12 (a) R 9 (b c) S 1 77 12 0 -1 4194560 1 2 3 4 10 20 30 40 20 0 5";
            let process = parse(stat).unwrap();
            assert_eq!((process.state, process.group, process.used), ('S', 77, 100));
            assert!(parse("12 (a) S 1").is_none() && parse("").is_none());
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod processor {
    pub fn sleeping(_: u32) -> Option<u64> {
        None
    }
}

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
