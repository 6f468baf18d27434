//! Whether what is not whole belongs to nobody any more.
//!
//! On a disk of this machine a lock tells it. File systems that several machines share may know no locks, or keep those of each machine
//! to itself (NFS with `local_lock`, Lustre with `localflock`): there the name says by which process on which machine it was begun, and
//! what is another machine's is left alone for as long as it may be written.

use std::{
    fs::File,
    hash::{DefaultHasher, Hash, Hasher},
    path::Path,
    time::{Duration, SystemTime},
};

/// What another machine began and did not write to for so long is nobody's.
const ABANDONED: Duration = Duration::from_secs(3 * 86_400);

/// Who began something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Owner {
    /// Where numbers of processes mean what they mean here: a machine since it was started, or a container of it.
    place: u32,
    /// The number of the process.
    process: u32,
}

impl Owner {
    /// This process.
    pub fn us() -> Self {
        let mut hasher = DefaultHasher::new();
        std::fs::read("/proc/sys/kernel/random/boot_id").unwrap_or_default().hash(&mut hasher);
        std::fs::read_link("/proc/self/ns/pid").unwrap_or_default().hash(&mut hasher);
        let hash = hasher.finish();
        Self { place: (hash >> 32) as u32 ^ hash as u32, process: std::process::id() }
    }

    /// What a name has behind its prefix.
    pub fn mark(self) -> String {
        format!("{:08x}-{}-", self.place, self.process)
    }

    /// From what follows the prefix of a name.
    pub fn of(rest: &str) -> Option<Self> {
        let mut parts = rest.splitn(3, '-');
        let (place, process, _) = (parts.next()?, parts.next()?, parts.next()?);
        let place =
            Some(place).filter(|place| place.len() == 8).and_then(|place| u32::from_str_radix(place, 16).ok())?;
        Some(Self { place, process: process.parse().ok()? })
    }

    /// Whether it has ended; `None` if that cannot be told from here.
    fn has_ended(self) -> Option<bool> {
        (self.place == Self::us().place && Path::new("/proc/self").exists())
            .then(|| !Path::new("/proc").join(self.process.to_string()).exists())
    }
}

/// What taking the lock of something came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lock {
    Ours,
    Another,
    Unknown,
}

/// Whether something is nobody's, by its lock, its owner, and for how long nobody wrote to it.
pub(super) fn is_left(lock: Lock, is_shared: bool, owner: Option<Owner>, unwritten: Duration) -> bool {
    match (lock, is_shared, owner.and_then(Owner::has_ended)) {
        (Lock::Another, ..) => false,
        (Lock::Ours, false, _) => true,
        (_, _, Some(ended)) => ended,
        (_, _, None) => unwritten >= ABANDONED,
    }
}

/// For how long nobody wrote to `found`, by the clock of its file system, which has just made `ours`.
pub(super) fn unwritten(found: &std::fs::Metadata, ours: &std::fs::Metadata) -> Duration {
    let at = |of: &std::fs::Metadata| of.modified().unwrap_or(SystemTime::UNIX_EPOCH);
    match ours.modified() {
        Ok(now) => now.duration_since(at(found)).unwrap_or_default(),
        Err(_) => Duration::ZERO,
    }
}

/// Whether other machines may write to the file system of a file, too: all but those that are known to be of one machine.
#[cfg(target_os = "linux")]
pub(super) fn is_shared(file: &File) -> bool {
    // ext, XFS, Btrfs, tmpfs, overlayfs, ZFS, F2FS, bcachefs, ramfs.
    const LOCAL: [u32; 9] = [
        0xEF53,
        0x5846_5342,
        0x9123_683E,
        0x0102_1994,
        0x794C_7630,
        0x2FC1_2FC1,
        0xF2F5_2010,
        0xCA45_1A4E,
        0x8584_58F6,
    ];
    rustix::fs::fstatfs(file).map_or(true, |found| !LOCAL.contains(&(found.f_type as u32)))
}

#[cfg(not(target_os = "linux"))]
pub(super) fn is_shared(_: &File) -> bool {
    false
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn names_say_who_began_something() {
        let us = Owner::us();
        assert_eq!(Owner::of(&format!("{}Ab3-x", us.mark())), Some(us));
        assert_eq!(us.has_ended(), Some(false));
        for rest in ["Ab3xYz", "", "0123-1-a", "0123456g-1-a", "01234567-x-a", "01234567-1"] {
            assert_eq!(Owner::of(rest), None, "{rest}");
        }
    }

    #[test]
    fn what_another_machine_writes_is_never_taken_away() {
        let us = Owner::us();
        // Numbers of processes end far below.
        let dead = Owner { process: u32::MAX, ..us };
        let far = Owner { place: !us.place, process: u32::MAX };
        let (now, long_ago) = (Duration::from_secs(60), ABANDONED);
        for age in [now, long_ago] {
            for (owner, shared) in [(Some(us), true), (Some(dead), true), (Some(far), true), (None, false)] {
                assert!(!is_left(Lock::Another, shared, owner, age), "somebody holds it");
            }
            // Locks of one machine tell all.
            assert!([Some(us), Some(dead), Some(far), None].into_iter().all(|owner| is_left(
                Lock::Ours,
                false,
                owner,
                age
            )));
            // Those of a shared file system may be each machine's own.
            for lock in [Lock::Ours, Lock::Unknown] {
                assert!(!is_left(lock, true, Some(us), age), "this process lives");
                assert!(is_left(lock, true, Some(dead), age));
                for owner in [Some(far), None] {
                    assert_eq!(is_left(lock, true, owner, age), age == long_ago);
                }
            }
        }
        assert!(!is_shared(&File::open("/dev/shm").unwrap()));
        assert!(is_shared(&File::open("/proc").unwrap()), "what is not known may be shared");
    }
}
