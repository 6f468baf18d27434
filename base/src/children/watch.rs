//! Whether a program hangs.

use std::time::{Duration, Instant};

/// Looks whether a process group does anything.
pub(super) struct Watch {
    group: u32,
    limit: Duration,
    /// How often it is to be asked.
    pub look_every: Duration,
    looked: Instant,
    idle: Duration,
    used: Option<u64>,
}

impl Watch {
    pub fn new(group: u32, limit: Duration) -> Self {
        let look_every = (limit / 16).clamp(Duration::from_millis(5), Duration::from_secs(4));
        Self { group, limit, look_every, looked: Instant::now(), idle: Duration::ZERO, used: None }
    }

    pub fn is_busy(&mut self) {
        self.idle = Duration::ZERO;
    }

    /// Whether the group has slept for as long as it may.
    pub fn hangs(&mut self) -> bool {
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
