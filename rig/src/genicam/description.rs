//! A camera's description: an XML text, mostly in a ZIP archive, from the camera's memory.

use std::io::{Cursor, Read};

use zip::ZipArchive;

use super::GenicamError;

/// No description is longer, packed or not.
pub(crate) const MOST_BYTES: usize = 32 << 20;

pub(crate) fn unusable(reason: impl Into<String>) -> GenicamError {
    GenicamError::Description { reason: reason.into() }
}

/// The text of a description, which may be in an archive.
///
/// # Errors
/// If the archive is damaged, empty, or holds too much.
pub fn text(bytes: &[u8]) -> Result<String, GenicamError> {
    let unpacked = if bytes.starts_with(b"PK\x03\x04") { Some(unpack(bytes)?) } else { None };
    let text = String::from_utf8_lossy(unpacked.as_deref().unwrap_or(bytes));
    Ok(text.trim_start_matches('\u{feff}').trim_end_matches('\0').to_owned())
}

fn unpack(bytes: &[u8]) -> Result<Vec<u8>, GenicamError> {
    let damaged = |error: &dyn std::error::Error| unusable(format!("its archive is damaged: {error}"));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| damaged(&error))?;
    if archive.is_empty() {
        return Err(unusable("its archive is empty"));
    }
    let file = archive.by_index(0).map_err(|error| damaged(&error))?;
    let mut text = Vec::new();
    // What the archive says of its length may be wrong.
    file.take(MOST_BYTES as u64 + 1).read_to_end(&mut text).map_err(|error| damaged(&error))?;
    if text.len() > MOST_BYTES {
        return Err(unusable(format!("its archive holds more than {MOST_BYTES} bytes")));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use proptest::prelude::*;
    use zip::{ZipWriter, write::SimpleFileOptions};

    use super::*;

    fn packed(text: &[u8]) -> Vec<u8> {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        zip.start_file("camera.xml", SimpleFileOptions::default()).unwrap();
        zip.write_all(text).unwrap();
        zip.finish().unwrap().into_inner()
    }

    #[test]
    fn a_description_is_unpacked_and_no_more_than_is_sensible() {
        assert_eq!(text(b"\xef\xbb\xbf<a/>\0\0").unwrap(), "<a/>");
        assert_eq!(text(&packed(b"<a/>")).unwrap(), "<a/>");
        let bomb = packed(&vec![b' '; MOST_BYTES + 1]);
        assert!(bomb.len() < 100_000);
        assert!(text(&bomb).unwrap_err().to_string().contains("more than"));
        assert!(text(b"PK\x03\x04").unwrap_err().to_string().contains("damaged"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..80), at in 0_usize..100) {
            let mut archive = packed(b"<description/>");
            for (index, byte) in bytes.into_iter().enumerate().skip(60) {
                if let Some(place) = archive.get_mut(at + index) {
                    *place ^= byte;
                }
            }
            let _ = text(&archive);
        }
    }
}
