//! How much memory is free, and whether that is enough.

use std::{fmt, fs, path::Path};

/// More memory is needed than there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{} of memory are needed, and {} are free", Size(*needed), Size(*free))]
pub struct Shortage {
    /// Bytes that are needed.
    pub needed: u64,
    /// Bytes that are free.
    pub free: u64,
}

/// Whether so many bytes more can be taken. What a file or a user asked for is held against this before it is allocated: an allocation
/// that fails ends the process. Where the system does not tell what is free, everything can.
///
/// # Errors
/// [`Shortage`] if they are more than what is free.
pub fn afford(needed: u64) -> Result<(), Shortage> {
    within(needed, available())
}

fn within(needed: u64, free: Option<u64>) -> Result<(), Shortage> {
    match free {
        Some(free) if needed > free => Err(Shortage { needed, free }),
        _ => Ok(()),
    }
}

struct Size(u64);

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} GB", self.0 as f64 * 1e-9)
    }
}

/// Bytes of memory that this process can still take before the system, or the limit of its control group (a container, a job on a
/// cluster), has no more; `None` where the system does not tell.
#[must_use]
pub fn available() -> Option<u64> {
    below(Path::new("/"))
}

/// What `/proc/meminfo` says is available, bytes.
#[must_use]
pub fn of_system(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

fn below(root: &Path) -> Option<u64> {
    let system = of_system(&fs::read_to_string(root.join("proc/meminfo")).ok()?)?;
    Some(of_group(root).map_or(system, |group| group.min(system)))
}

/// The least that this process's control group (version 2) and those above it leave; `None` without limits.
fn of_group(root: &Path) -> Option<u64> {
    let groups = fs::read_to_string(root.join("proc/self/cgroup")).ok()?;
    let name = groups.lines().find_map(|line| line.strip_prefix("0::"))?;
    let top = root.join("sys/fs/cgroup");
    let own = top.join(name.trim_start_matches('/'));
    let number = |folder: &Path, file: &str| fs::read_to_string(folder.join(file)).ok()?.trim().parse::<u64>().ok();
    // A group without a limit says "max", which is no number.
    let left = |folder: &Path| {
        let limit = number(folder, "memory.max")?;
        Some(limit.saturating_sub(number(folder, "memory.current").unwrap_or(0)))
    };
    own.ancestors().take_while(|folder| folder.starts_with(&top)).filter_map(left).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(root: &Path, files: &[(&str, &str)]) {
        for (file, text) in files {
            let path = root.join(file);
            fs::create_dir_all(path.parent().expect("a folder")).expect("written");
            fs::write(path, text).expect("written");
        }
    }

    #[test]
    fn the_least_of_system_and_groups_is_available() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(below(folder.path()), None);
        write(folder.path(), &[("proc/meminfo", "MemTotal: 8000000 kB\nMemAvailable:    4000 kB\n")]);
        assert_eq!(below(folder.path()), Some(4_096_000));
        // A job whose own group has no limit, in one that has.
        write(
            folder.path(),
            &[
                ("proc/self/cgroup", "1:cpu:/elsewhere\n0::/slurm/job\n"),
                ("sys/fs/cgroup/slurm/job/memory.max", "max\n"),
                ("sys/fs/cgroup/slurm/memory.max", "3000000\n"),
                ("sys/fs/cgroup/slurm/memory.current", "1000000\n"),
            ],
        );
        assert_eq!(below(folder.path()), Some(2_000_000));
        write(folder.path(), &[("sys/fs/cgroup/slurm/memory.max", "900000\n")]);
        assert_eq!(below(folder.path()), Some(0));
    }

    #[test]
    fn what_is_not_there_cannot_be_taken() {
        assert_eq!(within(10, Some(10)), Ok(()));
        assert_eq!(within(u64::MAX, None), Ok(()));
        let shortage = within(206_000_000_000, Some(4_000_000_000)).unwrap_err();
        assert_eq!(shortage.to_string(), "206.0 GB of memory are needed, and 4.0 GB are free");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn this_machine_has_some() {
        assert!(available().is_some_and(|bytes| bytes > 1 << 20));
    }
}
