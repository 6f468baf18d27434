//! Files that appear whole or not at all, and what is said where they do not.

use std::{fs::File, io::BufWriter, path::Path};

use erfgs_base::atomic;

use super::ContainerError;

/// Writes such a file. Of what was written before an error nothing is left, unlike of a recording, and the error does not promise it.
pub(super) fn write_whole<T>(
    out: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> Result<T, ContainerError>,
) -> Result<T, ContainerError> {
    let failed = |source| ContainerError::NotWritten { path: out.to_owned(), source };
    atomic::try_write_with(out, fill, failed).map_err(|error| match error {
        ContainerError::Write { path, source, .. } if path == out => failed(source),
        other => other,
    })
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;

    #[test]
    fn nothing_is_promised_of_a_file_that_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out.mcap");
        let full = || io::Error::from(io::ErrorKind::StorageFull);
        let error = write_whole(&out, |_| -> Result<(), _> {
            Err(ContainerError::Write { path: out.clone(), offset: 4096, source: full() })
        });
        let message = error.unwrap_err().to_string();
        assert!(message.contains("out.mcap") && message.contains("free some space"), "{message}");
        assert!(!message.contains("recover") && !message.contains("readable"), "{message}");
        // What was being read is another matter.
        let other = folder.path().join("other.mcap");
        let error = write_whole(&out, |_| -> Result<(), _> {
            Err(ContainerError::Read { path: other.clone(), offset: 1, source: full() })
        });
        assert!(matches!(error, Err(ContainerError::Read { path, .. }) if path == other));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
