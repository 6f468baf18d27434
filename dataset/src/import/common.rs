//! What the importers share: frame times, folders of images, and the choice of test cameras.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{ImportError, ImportOptions};
use crate::Split;
use erfgs_base::{
    FileError,
    order::{natural, order},
    plausible::RATE,
};
use erfgs_scene::{
    Intrinsics, Pose,
    exchange::llff,
    image::{ImageError, is_picture, pictures},
    video::FrameTimes,
};

/// One viewpoint of a recording.
pub(super) struct SourceView {
    pub(super) name: String,
    pub(super) split: Split,
    /// Intrinsics of the source's images.
    pub(super) intrinsics: Intrinsics,
    pub(super) pose: Pose,
    pub(super) frames: Frames,
}

impl SourceView {
    /// Its name and its files, where frames are files.
    pub(super) fn files(&self) -> Option<(&str, &[FileFrame])> {
        match &self.frames {
            Frames::Files(files) => Some((&self.name, files)),
            Frames::Video { .. } => None,
        }
    }
}

/// Where a viewpoint's frames come from.
pub(super) enum Frames {
    Files(Vec<FileFrame>),
    /// The frames `first..=last` of a video, counted from 0; all of them without a `last`.
    Video {
        path: PathBuf,
        first: u64,
        last: Option<u64>,
        times: FrameTimes,
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
    RATE.check(fps).map_err(|wrong| ImportError::Options(format!("--fps: {wrong}")))
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
    let io = |source| ImportError::from(FileError::when("read", folder)(source));
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        found.insert(entry.file_name().to_string_lossy().into_owned(), entry.path());
    }
    Ok(found)
}

/// The images in a folder, in no order that means anything.
pub(super) fn images(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let mut found: Vec<PathBuf> = entries(folder)?
        .into_iter()
        .filter(|(name, path)| is_picture(name) && path.is_file())
        .map(|(_, path)| path)
        .collect();
    found.sort_by(|a, b| natural(&stem(a), &stem(b)));
    Ok(found)
}

/// The images in a folder (PNG, JPEG) as frames that follow each other, by all numbers in their names.
///
/// # Errors
/// The folder cannot be read, or nobody knows which of two comes first.
pub fn frames(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    pictures(folder).map_err(|error| match error {
        ImageError::File(source) => source.into(),
        ImageError::Order { folder: path, doubt } => ImportError::Malformed { path, what: doubt.to_string() },
        other => ImportError::Malformed { path: folder.to_owned(), what: other.to_string() },
    })
}

/// Files or folders in the order of their names; `of` is what lists them.
pub(super) fn in_order(paths: Vec<PathBuf>, of: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let names: Vec<String> =
        paths.iter().map(|path| if path.is_dir() { file_name(path) } else { stem(path) }).collect();
    let order =
        order(&names).map_err(|doubt| ImportError::Malformed { path: of.to_owned(), what: doubt.to_string() })?;
    Ok(order.into_iter().map(|at| paths[at].clone()).collect())
}

/// Refuses names of cameras whose order in the alphabet, in which rows of poses follow them, is not that of their numbers.
pub(super) fn check_rows<'a>(names: impl Iterator<Item = &'a str>, poses: &Path) -> Result<(), ImportError> {
    let mut sorted: Vec<&str> = names.collect();
    sorted.sort_unstable();
    match sorted.windows(2).find(|pair| natural(pair[0], pair[1]).is_gt()) {
        None => Ok(()),
        Some(pair) => Err(ImportError::Malformed {
            path: poses.to_owned(),
            what: format!(
                "its rows belong to the cameras in order, and whether {} or {} comes first is not known; rename the cameras so that \
                 their numbers have as many digits, in the order of the rows",
                pair[0], pair[1]
            ),
        }),
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Says in which order the frames were taken and how far apart, where names gave the order: the first, second and last name, once
/// for all cameras whose frames are called alike.
pub(super) fn order_notes<'a>(views: impl Iterator<Item = (&'a str, &'a [FileFrame])>, rate: &str) -> Vec<String> {
    let mut alike: Vec<([String; 3], usize, Vec<&str>)> = Vec::new();
    for (camera, frames) in views {
        let [first, second, .., last] = frames.iter().map(|frame| &frame.image).collect::<Vec<_>>()[..] else {
            let [first, last] = frames else { continue };
            let names = [&first.image, &last.image, &last.image].map(|path| file_name(path));
            alike.push((names, 2, vec![camera]));
            continue;
        };
        let names = [first, second, last].map(|path| file_name(path));
        match alike.iter_mut().find(|(known, count, _)| *known == names && *count == frames.len()) {
            Some((.., cameras)) => cameras.push(camera),
            None => alike.push((names, frames.len(), vec![camera])),
        }
    }
    let note = |([first, second, last], count, cameras): ([String; 3], usize, Vec<&str>)| {
        let camera = match cameras[..] {
            [one] => one.to_owned(),
            [one, ref others @ ..] => format!("{one} and {} others", others.len()),
            [] => String::new(),
        };
        format!(
            "{camera}: {count} frames in the order of the numbers in their names: {first}, {second}, ... {last}; {rate}"
        )
    };
    alike.into_iter().map(note).collect()
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
