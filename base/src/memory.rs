//! How much memory is free.

use std::{fs, path::Path};

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

    #[cfg(target_os = "linux")]
    #[test]
    fn this_machine_has_some() {
        assert!(available().is_some_and(|bytes| bytes > 1 << 20));
    }
}
