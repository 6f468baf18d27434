//! Whether an MP4 file is whole.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    path::Path,
};

/// A file is no film if it has more boxes than that side by side; ffmpeg writes four.
const MOST_BOXES: usize = 1000;

/// Says what an MP4 file lacks, if it does: its boxes follow one another to its very end, and one of them is the index. ffmpeg ends
/// without an error where the disk has no room for what it writes last.
///
/// # Errors
/// If the file cannot be read.
pub(super) fn lacking(path: &Path) -> io::Result<Option<&'static str>> {
    let mut file = File::open(path)?;
    let end = file.metadata()?.len();
    let (mut at, mut has_index, mut has_frames) = (0, false, false);
    for _ in 0..MOST_BOXES {
        if at == end {
            return Ok(match (has_index, has_frames) {
                (false, _) => Some("its index is missing"),
                (_, false) => Some("its frames are missing"),
                _ => None,
            });
        }
        let mut head = [0; 16];
        file.seek(SeekFrom::Start(at))?;
        let read = (&mut file).take(16).read(&mut head)?;
        let size = match u32::from_be_bytes([head[0], head[1], head[2], head[3]]) {
            // The length follows in 64 bits.
            1 if read == 16 => {
                u64::from_be_bytes([head[8], head[9], head[10], head[11], head[12], head[13], head[14], head[15]])
            }
            size => size.into(),
        };
        has_index |= &head[4..8] == b"moov";
        has_frames |= &head[4..8] == b"mdat";
        match at.checked_add(size) {
            Some(next) if size >= 8 && read >= 8 && next <= end => at = next,
            _ => return Ok(Some("it is cut off")),
        }
    }
    Ok(Some("it is none"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn atom(kind: &[u8; 4], bytes: usize) -> Vec<u8> {
        [&(bytes as u32 + 8).to_be_bytes(), &kind[..], &vec![0; bytes]].concat()
    }

    #[test]
    fn every_cut_of_a_film_is_told() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let mut long = [&1_u32.to_be_bytes(), &b"mdat"[..], &24_u64.to_be_bytes(), &[7; 8]].concat();
        for frames in [atom(b"mdat", 40), std::mem::take(&mut long)] {
            let whole = [atom(b"ftyp", 12), atom(b"moov", 30), atom(b"free", 0), frames].concat();
            for cut in 0..=whole.len() {
                std::fs::write(file.path(), &whole[..cut]).unwrap();
                assert_eq!(lacking(file.path()).unwrap().is_none(), cut == whole.len(), "{cut}");
            }
            std::fs::write(file.path(), [&whole[..], &[0; 3]].concat()).unwrap();
            assert!(lacking(file.path()).unwrap().is_some());
        }
        let zeros = vec![0; 4096];
        std::fs::write(file.path(), zeros).unwrap();
        assert!(lacking(file.path()).unwrap().is_some());
    }
}
