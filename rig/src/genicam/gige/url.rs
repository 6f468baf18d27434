//! Where a camera's description lies in its memory.

use crate::genicam::{
    GenicamError,
    description::{MOST_BYTES, unusable},
};

/// A place in the camera's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Address.
    pub address: u32,
    /// Bytes.
    pub length: usize,
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(url in ".{0,40}") {
            let _ = place(&url);
            let _ = place(&format!("Local:{url}"));
        }
    }
}
