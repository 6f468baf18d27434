//! Text files, whatever editor wrote them.

use std::{io, path::Path};

/// Reads a text of UTF-8, with or without a byte order mark, or of UTF-16 with one; the mark is left out. It serves in place of
/// [`std::fs::read_to_string`].
///
/// # Errors
/// If the file cannot be read, or is in another encoding, with the line where that shows.
pub fn read(path: &Path) -> io::Result<String> {
    crate::regular::check(path)?;
    decode(std::fs::read(path)?)
}

/// A cell of a table of comma-separated values, in quotes where it needs them (RFC 4180).
#[must_use]
pub fn csv_cell(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn decode(bytes: Vec<u8>) -> io::Result<String> {
    let wrong = |what: String| io::Error::new(io::ErrorKind::InvalidData, what);
    let units = |of: fn([u8; 2]) -> u16| {
        let (pairs, rest) = bytes[2..].as_chunks::<2>();
        let text = String::from_utf16(&pairs.iter().map(|&pair| of(pair)).collect::<Vec<_>>()).ok();
        text.filter(|_| rest.is_empty()).ok_or_else(|| wrong("it is damaged UTF-16; save it as UTF-8".to_owned()))
    };
    match bytes[..] {
        [0xFF, 0xFE, ..] => units(u16::from_le_bytes),
        [0xFE, 0xFF, ..] => units(u16::from_be_bytes),
        _ => {
            let mut text = String::from_utf8(bytes).map_err(|error| {
                let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
                let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
                wrong(format!(
                    "line {line} is no UTF-8; save the file as UTF-8, or convert it: iconv -f LATIN1 -t UTF-8"
                ))
            })?;
            if text.starts_with('\u{feff}') {
                text.drain(..'\u{feff}'.len_utf8());
            }
            Ok(text)
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_text_is_the_same_however_it_was_saved(text in "[^\u{feff}]{0,40}") {
            let utf16 = |order: fn(u16) -> [u8; 2]| -> Vec<u8> {
                "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(order).collect()
            };
            let marked = format!("\u{feff}{text}").into_bytes();
            for bytes in [text.clone().into_bytes(), marked, utf16(u16::to_le_bytes), utf16(u16::to_be_bytes)] {
                prop_assert_eq!(&decode(bytes).unwrap(), &text);
            }
        }

        #[test]
        fn any_bytes_are_text_or_an_error(bytes: Vec<u8>) {
            let _ = decode(bytes);
        }
    }

    #[test]
    fn another_encoding_is_refused_with_its_line() {
        let message = decode(b"a: 1\nb: Andr\xe9\n".to_vec()).unwrap_err().to_string();
        assert!(message.contains("line 2") && message.contains("iconv"), "{message}");
    }
}
