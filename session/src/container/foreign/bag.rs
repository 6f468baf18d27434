//! Recordings of rosbag2 as it leaves them: a folder with `metadata.yaml` and the file, or files, beside it.

use std::{
    borrow::Cow,
    path::{Path, PathBuf},
};

use crate::container::ContainerError;
use erfgs_base::order::natural;

/// How a file of SQLite begins.
pub(in crate::container) const SQLITE_MAGIC: &[u8; 16] = b"SQLite format 3\0";

/// The file that holds a recording: `path` itself, or the one in a folder of rosbag2.
///
/// # Errors
/// If the folder holds none, one that is compressed as a whole, or several.
pub fn recording_file(path: &Path) -> Result<Cow<'_, Path>, ContainerError> {
    if !path.join("metadata.yaml").is_file() {
        return Ok(path.into());
    }
    let refused = |what: String| ContainerError::BagFolder { path: path.to_owned(), what };
    let listed = std::fs::read_dir(path).map_err(|error| refused(format!("it cannot be listed: {error}")))?;
    let mut files: Vec<PathBuf> =
        listed.filter_map(|entry| Some(entry.ok()?.path())).filter(|file| is_bag(file)).collect();
    files.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
    let is_packed = |file: &&PathBuf| file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("zstd"));
    match &files[..] {
        [] => Err(refused("it holds no .mcap and no .db3".into())),
        [file] if is_packed(&file) => {
            let name = file.display();
            Err(refused(format!(
                "{name} is compressed as a whole; unpack it first: zstd -d {name}, then give the unpacked file"
            )))
        }
        // Unpacked, with what it was unpacked from beside it.
        [file, packed] if is_packed(&packed) && packed.with_extension("") == *file => Ok(file.clone().into()),
        [file] => Ok(file.clone().into()),
        [first, .., last] => Err(refused(format!(
            "its recording is in {} files, from {} to {}; give one of them, or join them: ros2 bag convert",
            files.len(),
            first.display(),
            last.display()
        ))),
    }
}

fn is_bag(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let name = name.strip_suffix(".zstd").unwrap_or(&name);
    file.is_file() && (name.ends_with(".mcap") || name.ends_with(".db3"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_one_file_of_a_folder_is_found_and_all_else_is_refused_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        let put = |name: &str| std::fs::write(path.join(name), b"x").unwrap();
        // No folder of rosbag2: whoever opens it says what is wrong.
        put("a_0.db3");
        assert_eq!(recording_file(path).unwrap(), path);
        put("metadata.yaml");
        assert_eq!(recording_file(path).unwrap(), path.join("a_0.db3"));
        assert_eq!(recording_file(&path.join("a_0.db3")).unwrap(), path.join("a_0.db3"));
        put("a_0.db3.zstd");
        assert_eq!(recording_file(path).unwrap(), path.join("a_0.db3"), "unpacked already");
        std::fs::remove_file(path.join("a_0.db3")).unwrap();
        let message = recording_file(path).unwrap_err().to_string();
        assert!(message.contains("zstd -d") && message.contains("a_0.db3.zstd"), "{message}");
        for name in ["a_2.mcap", "a_10.mcap", "a_1.mcap"] {
            put(name);
        }
        std::fs::remove_file(path.join("a_0.db3.zstd")).unwrap();
        let message = recording_file(path).unwrap_err().to_string();
        assert!(message.contains("3 files") && message.contains("ros2 bag convert"), "{message}");
        assert!(message.find("a_1.mcap") < message.find("a_10.mcap"), "{message}");
        for name in ["a_2.mcap", "a_10.mcap", "a_1.mcap"] {
            std::fs::remove_file(path.join(name)).unwrap();
        }
        assert!(recording_file(path).unwrap_err().to_string().contains("no .mcap and no .db3"));
    }
}
