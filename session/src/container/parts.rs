//! A session in several files: how they are named, and what each says of itself.
//!
//! `take.mcap` goes on in `take.001.mcap`, `take.002.mcap` and so on in the same folder. The names are made of that of the first file,
//! never of what a file says.

use std::{
    collections::BTreeMap,
    fmt, io,
    path::{Path, PathBuf},
    str::FromStr,
};

use serde_json::{Map, Value};

/// Name of the metadata record with [`PartOf`].
pub(super) const PART_METADATA: &str = "erfgs.part";

/// No part has a higher number.
pub const MAX_PART: u32 = 9999;

/// Tells a session from all others: 128 random bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SessionId(pub [u8; 16]);

impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl FromStr for SessionId {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        if text.len() != 32 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return Err(());
        }
        u128::from_str_radix(text, 16).map(|bits| Self(bits.to_be_bytes())).map_err(drop)
    }
}

/// Which part of which session a file is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartOf {
    /// The session.
    pub session: SessionId,
    /// The part, counted from 0.
    pub number: u32,
    /// Settings that were changed in earlier parts and hold from the start of this one on, by the stream's id.
    pub adjusted: BTreeMap<String, Map<String, Value>>,
}

impl PartOf {
    /// As the entries of a metadata record.
    pub(super) fn to_metadata(&self) -> BTreeMap<String, String> {
        let adjusted = self.adjusted.iter().map(|(id, changed)| {
            let changed = Value::Object(changed.clone()).to_string();
            (format!("adjusted.{id}"), changed)
        });
        let about = [("session".to_owned(), self.session.to_string()), ("number".to_owned(), self.number.to_string())];
        adjusted.chain(about).collect()
    }

    /// From the entries of a metadata record; `None` if they are none of a part.
    pub(super) fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        let adjusted = metadata.iter().filter_map(|(key, value)| {
            let id = key.strip_prefix("adjusted.")?;
            Some((id.to_owned(), serde_json::from_str(value).ok()?))
        });
        Some(Self {
            session: metadata.get("session")?.parse().ok()?,
            number: metadata.get("number")?.parse().ok().filter(|number| *number <= MAX_PART)?,
            adjusted: adjusted.collect(),
        })
    }
}

/// The file of a part of the session whose first file is `first`: `take.001.mcap` beside `take.mcap`.
#[must_use]
pub fn part_path(first: &Path, number: u32) -> PathBuf {
    if number == 0 {
        return first.to_owned();
    }
    let (stem, extension) = split_name(first);
    first.with_file_name(format!("{stem}.{number:03}{extension}"))
}

/// The files that are named as further parts of the session `first`, by their numbers.
///
/// # Errors
/// If the folder cannot be listed.
pub fn parts_beside(first: &Path) -> io::Result<Vec<(u32, PathBuf)>> {
    let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (stem, extension) = split_name(first);
    let mut parts = Vec::new();
    for entry in folder.read_dir()? {
        let name = entry?.file_name();
        let digits = name.to_str().and_then(|name| name.strip_prefix(&*stem)?.strip_prefix('.'));
        let digits = digits.and_then(|rest| rest.strip_suffix(&*extension));
        let number =
            digits.and_then(|digits| digits.parse::<u32>().ok()).filter(|number| (1..=MAX_PART).contains(number));
        if let Some(number) = number.filter(|number| digits == Some(&*format!("{number:03}"))) {
            parts.push((number, part_path(first, number)));
        }
    }
    parts.sort();
    Ok(parts)
}

/// A file's name before its suffix, and the suffix with its dot.
fn split_name(file: &Path) -> (String, String) {
    let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let extension = file.extension().map(|extension| format!(".{}", extension.to_string_lossy()));
    (text(file.file_stem()), extension.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_named_after_the_first_file_and_found_by_their_names_alone() {
        let folder = tempfile::tempdir().unwrap();
        let first = folder.path().join("take.mcap");
        assert_eq!(part_path(&first, 0), first);
        assert_eq!(part_path(Path::new("a/take.v2.mcap"), 7), Path::new("a/take.v2.007.mcap"));
        assert_eq!(part_path(Path::new("take.mcap"), 1234), Path::new("take.1234.mcap"));
        for name in [
            "take.mcap",
            "take.002.mcap",
            "take.001.mcap",
            "take.1000.mcap",
            "take.000.mcap",
            "take.0001.mcap",
            "take.1.mcap",
            "take.10000.mcap",
            "take.+01.mcap",
            "take.001.recovered.mcap",
            "take.001.mcap.before",
            "take.recovered.mcap",
            "other.003.mcap",
        ] {
            std::fs::write(folder.path().join(name), b"x").unwrap();
        }
        let found = parts_beside(&first).unwrap();
        assert_eq!(found, [1, 2, 1000].map(|number| (number, part_path(&first, number))));
    }

    #[test]
    fn what_a_part_says_of_itself_comes_back_and_nonsense_is_refused() {
        let changed = serde_json::from_str(r#"{"bias_fo": 3}"#).unwrap();
        let part = PartOf { session: SessionId([0xa7; 16]), number: 12, adjusted: [("ev0".into(), changed)].into() };
        let metadata = part.to_metadata();
        assert_eq!(PartOf::from_metadata(&metadata), Some(part));
        for (key, value) in
            [("session", "+0000000000000000000000000000001"), ("session", "a7"), ("number", "10000"), ("number", "-1")]
        {
            let mut wrong = metadata.clone();
            wrong.insert(key.into(), value.into());
            assert_eq!(PartOf::from_metadata(&wrong), None, "{key} {value}");
        }
    }
}
