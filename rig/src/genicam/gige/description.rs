//! Where a camera's description lies, and what it is: an XML text, mostly in a ZIP archive, in the camera's memory.

use std::io::{Cursor, Read};

use zip::ZipArchive;

use crate::genicam::GenicamError;

/// No description is longer, packed or not.
const MOST_BYTES: usize = 32 << 20;

/// A place in the camera's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Address.
    pub address: u32,
    /// Bytes.
    pub length: usize,
}

fn unusable(reason: impl Into<String>) -> GenicamError {
    GenicamError::Description { reason: reason.into() }
}

/// Reads `Local:name.zip;ADDRESS;LENGTH`, as the registers of a camera hold it; cameras put spaces into it, and versions behind.
///
/// # Errors
/// If the description is not in the camera's memory, or its place cannot be read.
pub fn place(url: &str) -> Result<Place, GenicamError> {
    let shown: String = url.chars().take(80).collect();
    let (scheme, rest) = url.split_once(':').ok_or_else(|| unusable(format!("its address {shown:?} is none")))?;
    if !scheme.trim().eq_ignore_ascii_case("local") {
        return Err(unusable(format!(
            "the camera does not have it itself, but at {shown:?}; erfgs reads it from cameras alone. A newer firmware may \
             have it in the camera"
        )));
    }
    let number = |text: &str| {
        let text = text.split('?').next().unwrap_or_default().trim();
        u32::from_str_radix(text.trim_start_matches("0x").trim_start_matches("0X"), 16).ok()
    };
    let mut parts = rest.rsplit(';');
    let (length, address) = (parts.next().and_then(number), parts.next().and_then(number));
    let (Some(address), Some(length)) = (address, length.filter(|_| parts.next().is_some())) else {
        return Err(unusable(format!("its address {shown:?} does not say where it lies")));
    };
    let length = length as usize;
    if length == 0 || length > MOST_BYTES || address.checked_add(length as u32).is_none() {
        return Err(unusable(format!("its address {shown:?} says {length} bytes; it can be 1 to {MOST_BYTES}")));
    }
    Ok(Place { address, length })
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
    fn places_are_read_as_cameras_write_them() {
        let at = |address, length| Place { address, length };
        assert_eq!(place("Local:camera.zip;10000;1F3A").unwrap(), at(0x1_0000, 0x1f3a));
        assert_eq!(place("local: a;b .xml; 0xC0000000 ; 12a?SchemaVersion=1.1.0").unwrap(), at(0xc000_0000, 0x12a));
        for (wrong, says) in [
            ("File:///camera.xml", "from cameras alone"),
            ("http://maker/camera.xml", "from cameras alone"),
            ("camera.xml", "is none"),
            ("Local:camera.xml", "does not say where"),
            ("Local:camera.xml;10000", "does not say where"),
            ("Local:camera.xml;zz;10", "does not say where"),
            ("Local:camera.xml;10000;0", "0 bytes"),
            ("Local:camera.xml;10000;7fffffff", "2147483647 bytes"),
            ("Local:camera.xml;fffffff0;20", "32 bytes"),
        ] {
            let error = place(wrong).unwrap_err().to_string();
            assert!(error.contains(says), "{wrong}: {error}");
        }
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
        fn any_bytes_are_read_or_refused(url in ".{0,40}", bytes in prop::collection::vec(any::<u8>(), 0..80), at in 0_usize..100) {
            let _ = place(&url);
            let _ = place(&format!("Local:{url}"));
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
