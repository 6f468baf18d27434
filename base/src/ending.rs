//! What must not outlive this process: files and folders that were begun and are not whole yet, and children that are not trusted
//! to end by themselves.
//!
//! They go by themselves when their owners are dropped. A program that ends by [`std::process::exit`], as one does that was asked
//! to stop, calls [`clear`] before.

#[cfg(feature = "children")]
use std::collections::BTreeSet;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

static LIST: Mutex<List> = Mutex::new(List {
    paths: BTreeMap::new(),
    #[cfg(feature = "children")]
    children: BTreeSet::new(),
});

pub(crate) struct List {
    /// What is not whole yet, and where it will be; nowhere, if it is to be removed in any case.
    pub paths: BTreeMap<PathBuf, Option<PathBuf>>,
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
    list.paths.keys().for_each(|path| remove(path));
    std::mem::forget(list);
}

/// By which name the user knows a path: what lies in a folder that is not whole yet is named by the folder's place.
#[must_use]
pub fn place_of(path: &Path) -> PathBuf {
    let list = list();
    let within = |(begun, place): (&PathBuf, &Option<PathBuf>)| {
        let (rest, place) = (path.strip_prefix(begun).ok()?, place.as_ref()?);
        Some(if rest.as_os_str().is_empty() { place.clone() } else { place.join(rest) })
    };
    list.paths.iter().find_map(within).unwrap_or_else(|| path.to_owned())
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
        list.paths.insert(path.clone(), None);
        Ok((made, Self(path)))
    }

    /// Says where this will be, for errors.
    pub fn becomes(&self, place: &Path) {
        list().paths.insert(self.0.clone(), Some(place.to_owned()));
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
