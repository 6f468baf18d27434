//! What must not outlive this process: files and folders that were begun and are not whole yet, and children that are not trusted
//! to end by themselves.
//!
//! They go by themselves when their owners are dropped. A program that ends by [`std::process::exit`], as one does that was asked
//! to stop, calls [`clear`] before.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

static LIST: Mutex<List> = Mutex::new(List {
    paths: BTreeSet::new(),
    #[cfg(feature = "children")]
    children: BTreeSet::new(),
});

pub(crate) struct List {
    pub paths: BTreeSet<PathBuf>,
    /// Process groups.
    #[cfg(feature = "children")]
    pub children: BTreeSet<u32>,
}

/// The list, for whoever begins or finishes something: as long as it is held, [`clear`] waits.
pub(crate) fn list() -> MutexGuard<'static, List> {
    LIST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends the children and removes what is not whole. To be followed by the end of the process: whoever wants to begin or finish
/// something from now on, in another thread, waits for that.
pub fn clear() {
    let list = list();
    #[cfg(feature = "children")]
    list.children.iter().for_each(|&group| crate::children::end_group(group));
    list.paths.iter().for_each(|path| remove(path));
    std::mem::forget(list);
}

/// Removes a file or a folder. Children that were just ended may still write into it for an instant.
fn remove(path: &Path) {
    const TRIES: u32 = 40;
    for _ in 0..TRIES {
        let Ok(found) = path.symlink_metadata() else { return };
        let removed = if found.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        if removed.is_ok() {
            return;
        }
        std::thread::sleep(Duration::from_millis(25));
    }
}

/// A path on the list, until it is dropped.
#[cfg(feature = "files")]
#[derive(Debug)]
pub(crate) struct Listed(PathBuf);

#[cfg(feature = "files")]
impl Listed {
    /// Makes something and puts its path on the list, so that there is no instant at which it is there and not listed.
    pub fn make<T, E>(make: impl FnOnce() -> Result<T, E>, path: impl Fn(&T) -> &Path) -> Result<(T, Self), E> {
        let mut list = list();
        let made = make()?;
        let path = path(&made).to_owned();
        list.paths.insert(path.clone());
        Ok((made, Self(path)))
    }

    /// Takes the path off the list while `finish` puts what is there into its place.
    pub fn finish<T>(self, finish: impl FnOnce() -> T) -> T {
        let mut list = list();
        let finished = finish();
        list.paths.remove(&self.0);
        drop(list);
        std::mem::forget(self);
        finished
    }
}

#[cfg(feature = "files")]
impl Drop for Listed {
    fn drop(&mut self) {
        list().paths.remove(&self.0);
    }
}
