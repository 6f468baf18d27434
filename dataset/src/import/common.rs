//! What the importers share: frame times, folders of images, and the choice of test cameras.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{ImportError, ImportOptions};
use crate::Split;
use erfgs_scene::{Intrinsics, Pose, exchange::llff};

/// One viewpoint of a recording.
pub(super) struct SourceView {
    pub(super) name: String,
    pub(super) split: Split,
    /// Intrinsics of the source's images.
    pub(super) intrinsics: Intrinsics,
    pub(super) pose: Pose,
    pub(super) frames: Frames,
}

/// Where a viewpoint's frames come from.
pub(super) enum Frames {
    Files(Vec<FileFrame>),
    /// The frames `first..=last` of a video, counted from 0; all of them without a `last`.
    Video {
        path: PathBuf,
        first: u64,
        last: Option<u64>,
        fps: f64,
    },
}

pub(super) struct FileFrame {
    pub(super) image: PathBuf,
    pub(super) mask: Option<PathBuf>,
    pub(super) t_ns: i64,
}

/// The rate to use: the option, else what is usual for the layout.
pub(super) fn fps(options: &ImportOptions, usual: f64) -> Result<f64, ImportError> {
    let fps = options.fps.unwrap_or(usual);
    if fps > 0.0 && fps.is_finite() {
        Ok(fps)
    } else {
        Err(ImportError::Options(format!("--fps {fps} is no frame rate; give a positive number")))
    }
}

/// The time of frame `index` after the first one, nanoseconds.
pub(super) fn frame_time(index: u64, fps: f64) -> i64 {
    (index as f64 * 1e9 / fps).round() as i64
}

/// The part of `items` that the option `frames` (both ends included) leaves, where items are counted from 0.
pub(super) fn in_range<T>(items: Vec<T>, options: &ImportOptions, path: &Path) -> Result<Vec<T>, ImportError> {
    let Some((first, last)) = checked_range(options)? else { return Ok(items) };
    let count = items.len() as u64;
    if last >= count {
        return Err(ImportError::Malformed {
            path: path.to_owned(),
            what: format!("the frames {first}..{last} were asked for, but there are {count} (0..{})", count.max(1) - 1),
        });
    }
    Ok(items.into_iter().skip(first as usize).take((last - first) as usize + 1).collect())
}

/// The option `frames`, refused where it runs backwards.
pub(super) fn checked_range(options: &ImportOptions) -> Result<Option<(u64, u64)>, ImportError> {
    match options.frames {
        Some((first, last)) if first > last => Err(ImportError::Options(format!(
            "--frames {first}..{last} runs backwards; give the first and the last frame, both included"
        ))),
        range => Ok(range),
    }
}

/// The cameras of an LLFF file, in its order.
pub(super) fn poses_bounds(path: &Path) -> Result<Vec<llff::Row>, ImportError> {
    if !path.is_file() {
        let remedy = "the folder must hold the poses that LLFF made";
        return Err(ImportError::Missing { path: path.to_owned(), remedy });
    }
    Ok(llff::rows(path)?)
}

/// The entries of a folder with their names, in order of the names.
pub(super) fn entries(folder: &Path) -> Result<BTreeMap<String, PathBuf>, ImportError> {
    let io = |source| ImportError::Io { doing: "read", path: folder.to_owned(), source };
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        found.insert(entry.file_name().to_string_lossy().into_owned(), entry.path());
    }
    Ok(found)
}

/// Whether a file of this name is an image, and not one that is hidden.
pub(super) fn is_image(name: &str) -> bool {
    let extension = name.rsplit_once('.').map(|(_, extension)| extension.to_ascii_lowercase());
    !name.starts_with('.') && matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg"))
}

/// The images in a folder, ordered by the last number in their names, then by name.
pub(super) fn images(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let mut found: Vec<(Option<u64>, String, PathBuf)> = entries(folder)?
        .into_iter()
        .filter(|(name, path)| is_image(name) && path.is_file())
        .map(|(name, path)| (number(&stem(&path)), name, path))
        .collect();
    found.sort();
    Ok(found.into_iter().map(|(_, _, path)| path).collect())
}

/// A file's name without its extension.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The last run of digits in a name.
pub(super) fn number(name: &str) -> Option<u64> {
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = name[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + name[at..].chars().next().map_or(0, char::len_utf8));
    name[start..end].parse().ok()
}

/// Marks the cameras named by the option `test_cameras` as test cameras and all others as training cameras; a name may
/// also be a camera's number. Without the option nothing changes.
pub(super) fn override_split(views: &mut [SourceView], options: &ImportOptions) -> Result<(), ImportError> {
    let Some(wanted) = &options.test_cameras else { return Ok(()) };
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    let splits = splits(&names, wanted)?;
    views.iter_mut().zip(splits).for_each(|(view, split)| view.split = split);
    Ok(())
}

/// The split of each camera where `tested` names the test cameras; a name may also be a camera's number.
pub(super) fn splits(names: &[&str], tested: &[String]) -> Result<Vec<Split>, ImportError> {
    let mut splits = vec![Split::Train; names.len()];
    for wanted in tested {
        let by_name = names.iter().position(|name| *name == wanted);
        let by_number = || {
            let wanted: u64 = wanted.parse().ok()?;
            names.iter().position(|name| number(name) == Some(wanted))
        };
        match by_name.or_else(by_number) {
            Some(at) => splits[at] = Split::Test,
            None => {
                let what = format!("there is no camera {wanted} to test on; there are {}", names.join(", "));
                return Err(ImportError::Options(what));
            }
        }
    }
    Ok(splits)
}

/// Every eighth view for testing, from the first, as LLFF and its successors split a set without a split of its own.
pub(super) fn every_eighth(views: &mut [SourceView]) {
    if views.len() > 1 {
        views.iter_mut().step_by(8).for_each(|view| view.split = Split::Test);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_number_of_a_name_orders_it() {
        let numbers = [("cam05", Some(5)), ("5", Some(5)), ("a12b007c", Some(7)), ("none", None), ("é3", Some(3))];
        for (name, expected) in numbers {
            assert_eq!(number(name), expected, "{name}");
        }
        assert_eq!(number("99999999999999999999999"), None);
    }
}
