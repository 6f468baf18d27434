//! Reading a scene file that someone was sent.

use std::{
    collections::BTreeMap,
    io::{self, Read},
    path::{Path, PathBuf},
};

use erfgs_splat::{
    gaussians::{CORE, Gaussians, sh_stride},
    motion::{FreeTimeOptions, bodies::EXTRA_FLOATS},
};
use flate2::read::GzDecoder;

use super::{
    FIRST_MAGIC, Header, MAGIC, SceneFile, Section,
    motion::{HANGS, check_hangs, joined_rows},
};

/// What a file may unpack to: so many bytes, so many more for each of its own, and never more than the last. Packed scenes
/// unpack to twice their size, and exact ones to less.
const ROOM: u64 = 16 << 20;
const ROOM_FOR_EACH: u64 = 64;
const LARGEST: u64 = 2 << 30;

/// Why a scene file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SceneFileError {
    /// The file cannot be read.
    #[error("could not read the scene file '{path}': {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It is of another kind, damaged, or not of finite numbers.
    #[error("'{path}' is not a complete scene file: {reason}; write it again with `erfgs export RUN --to e4d`")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

impl SceneFile {
    /// Reads a file as [`SceneFile::compressed`] wrote it.
    ///
    /// # Errors
    /// [`SceneFileError`].
    pub fn open(path: &Path) -> Result<Self, SceneFileError> {
        let damaged = |reason: String| SceneFileError::Damaged { path: path.into(), reason };
        let file = std::fs::File::open(path).map_err(|source| SceneFileError::Read { path: path.into(), source })?;
        let length = file.metadata().map_err(|source| SceneFileError::Read { path: path.into(), source })?.len();
        let most = ROOM.saturating_add(length.saturating_mul(ROOM_FOR_EACH)).min(LARGEST);
        let mut bytes = Vec::new();
        let unpacked = GzDecoder::new(file).take(most + 1).read_to_end(&mut bytes);
        unpacked.map_err(|error| damaged(format!("it does not unpack: {error}")))?;
        if bytes.len() as u64 > most {
            return Err(damaged(format!("it unpacks to more than {most} bytes, which no scene of that size does")));
        }
        Self::parse(bytes).map_err(damaged)
    }

    pub(super) fn parse(bytes: Vec<u8>) -> Result<Self, String> {
        let rest = bytes.strip_prefix(MAGIC).or_else(|| bytes.strip_prefix(FIRST_MAGIC));
        let rest = rest.ok_or("it does not begin like one, or like one of a later version")?;
        let (length, rest) = rest.split_first_chunk::<4>().ok_or("it is cut short")?;
        let (text, sections) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or("it is cut short")?;
        let header: Header = serde_json::from_slice(text).map_err(|error| format!("its header: {error}"))?;
        let mut size = 0_usize;
        for section in &header.sections {
            size = size.checked_add(section.coding.size(section.floats)?).ok_or("a section is too long")?;
        }
        if size != sections.len() {
            return Err(format!("its sections have {} bytes, not {size}", sections.len()));
        }
        let file = Self { header, bytes };
        file.check()?;
        Ok(file)
    }

    /// All sections with their bytes, from the last one to the first.
    fn pieces(&self) -> impl Iterator<Item = (&Section, &[u8])> {
        let mut rest = self.bytes.as_slice();
        self.header.sections.iter().rev().map_while(move |section| {
            let (before, bytes) =
                rest.split_at_checked(rest.len().checked_sub(section.coding.size(section.floats).ok()?)?)?;
            rest = before;
            Some((section, bytes))
        })
    }

    /// The numbers of a section.
    pub(super) fn section(&self, name: &str) -> Option<Vec<f32>> {
        let of_name = self.pieces().filter(|(section, _)| section.name == name);
        let mut pieces: Vec<(usize, Vec<f32>)> =
            of_name.map(|(section, bytes)| (section.at, section.coding.read(bytes, section.floats))).collect();
        pieces.sort_by_key(|(at, _)| *at);
        let found = !pieces.is_empty();
        found.then(|| pieces.into_iter().flat_map(|(_, values)| values).collect())
    }

    /// Numbers of each name. Pieces lie one behind the other.
    fn lengths(&self) -> Result<BTreeMap<&str, usize>, String> {
        let mut sections: Vec<&Section> = self.header.sections.iter().collect();
        sections.sort_by_key(|section| section.at);
        let mut lengths = BTreeMap::new();
        for Section { name, at, floats, .. } in sections {
            let length = lengths.entry(name.as_str()).or_insert(0);
            if length != at {
                return Err(format!("the pieces of its section '{name}' do not join"));
            }
            *length = at.checked_add(*floats).ok_or("a section is too long")?;
        }
        Ok(lengths)
    }

    /// Whether the sections fit each other.
    fn check(&self) -> Result<(), String> {
        let Header { count, dynamic, sh_degree, active_sh_degree, motion, .. } = &self.header;
        if *sh_degree > 3 || active_sh_degree > sh_degree || dynamic > count {
            return Err("its header contradicts itself".into());
        }
        let mut rows = vec![("core", count.checked_mul(CORE)), ("sh", count.checked_mul(sh_stride(*sh_degree)))];
        motion.check()?;
        self.header.check_plausible()?;
        if let Some(options) = motion.free_time() {
            rows.push(("motion", dynamic.checked_mul(options.floats())));
        }
        if let Some(carriers) = motion.carriers() {
            let [control, other] = carriers.floats();
            rows.extend([("hangs", dynamic.checked_mul(HANGS)), ("bodies.control", control), ("bodies.other", other)]);
        }
        let lengths = self.lengths()?;
        for (name, floats) in rows {
            let found = lengths.get(name).copied();
            if found.is_none() || found != floats {
                return Err(format!("its section '{name}' has {} numbers", found.unwrap_or(0)));
            }
        }
        // Each once: a file may have any number of them.
        for (Section { name, floats, coding, .. }, bytes) in self.pieces() {
            let values = coding.read(bytes, *floats);
            if values.iter().any(|value| !value.is_finite()) {
                return Err(format!("its section '{name}' holds what is no number"));
            }
        }
        if let Some(carriers) = motion.carriers() {
            check_hangs(&self.section("hangs").unwrap_or_default(), carriers)?;
        }
        let still = count - dynamic;
        if self.header.coarse.iter().any(|part| part.dynamic > *dynamic || part.still > still) {
            return Err("it says that parts of it have more Gaussians than all of it".into());
        }
        Ok(())
    }

    /// The Gaussians, in the order of the file.
    ///
    /// # Errors
    /// What is missing; no file that was opened or made here gives one.
    pub fn gaussians(&self) -> Result<Gaussians, String> {
        let need = |name: &str| self.section(name).ok_or_else(|| format!("it has no section '{name}'"));
        let floats = self.header.motion.free_time().as_ref().map_or(0, FreeTimeOptions::floats);
        let paths = if floats > 0 { need("motion")? } else { Vec::new() };
        let (motion_floats, motion) = match self.header.motion.carriers() {
            Some(_) => (floats + EXTRA_FLOATS, joined_rows(&paths, floats, &need("hangs")?)),
            None => (floats, paths),
        };
        Ok(Gaussians {
            sh_degree: self.header.sh_degree,
            dynamic: self.header.dynamic,
            core: need("core")?,
            sh: need("sh")?,
            motion_floats,
            motion,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::{Coarse, Coding, Precision, motion::tests::with_bodies};

    #[test]
    fn a_file_comes_back_and_sections_are_found_by_name() {
        let folder = std::env::temp_dir().join(format!("erfgs-scene-{}", std::process::id()));
        let file = SceneFile::for_tests();
        std::fs::write(&folder, file.compressed()).unwrap();
        assert_eq!(SceneFile::open(&folder).unwrap(), file);
        std::fs::remove_file(&folder).unwrap();
        assert_eq!(file.section("sh").unwrap(), [0.0; 4]);
        assert_eq!(file.section("points").unwrap(), [0.0; 0]);
        assert_eq!(file.section("motion"), None);
        assert_eq!(file.gaussians().unwrap().len(), 1);
    }

    #[test]
    fn a_file_that_was_made_to_fill_memory_is_refused() {
        let path = std::env::temp_dir().join(format!("erfgs-bomb-{}", std::process::id()));
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        std::io::Write::write_all(&mut encoder, &vec![0; 2 * ROOM as usize]).unwrap();
        let bytes = encoder.finish().unwrap();
        assert!(bytes.len() as u64 * ROOM_FOR_EACH < ROOM, "{} bytes", bytes.len());
        std::fs::write(&path, bytes).unwrap();
        let message = SceneFile::open(&path).unwrap_err().to_string();
        std::fs::remove_file(&path).unwrap();
        assert!(message.contains("unpacks to more than"), "{message}");
    }

    /// Time in proportion to the square of their number would be an hour.
    #[test]
    fn a_file_of_very_many_empty_sections_is_read_at_once() {
        let mut file = SceneFile::for_tests();
        let before = file.header.sections.len();
        let empty = |number: usize| Section {
            name: format!("x{number}"),
            at: 0,
            floats: 0,
            coding: file.header.sections[0].coding.clone(),
        };
        let more: Vec<Section> = (0..600_000).map(empty).collect();
        file.header.sections.extend(more);
        let text = serde_json::to_vec(&file.header).unwrap();
        let numbers: usize = file.header.sections[..before].iter().map(|of| of.coding.size(of.floats).unwrap()).sum();
        let mut bytes = MAGIC.to_vec();
        bytes.extend(u32::try_from(text.len()).unwrap().to_le_bytes());
        bytes.extend(text);
        bytes.extend(&file.bytes[file.bytes.len() - numbers..]);
        let begun = erfgs_base::cpu::thread_seconds().unwrap_or(0.0);
        assert_eq!(SceneFile::parse(bytes).unwrap().header.sections.len(), before + 600_000);
        let took = erfgs_base::cpu::thread_seconds().unwrap_or(0.0) - begun;
        assert!(took < 120.0, "{took} s of processor time");
    }

    #[test]
    fn whatever_is_changed_is_refused_or_still_a_scene() {
        for file in [SceneFile::for_tests(), with_bodies().file(Precision::Packed)] {
            changed_everywhere(&file.bytes);
        }
    }

    fn changed_everywhere(whole: &[u8]) {
        for end in 0..whole.len() {
            assert!(SceneFile::parse(whole[..end].to_vec()).is_err(), "{end} bytes");
        }
        for at in 0..whole.len() {
            for flip in [1, 0x10, 0x80, 0xff] {
                let mut bytes = whole.to_vec();
                bytes[at] ^= flip;
                // What still parses can be read.
                if let Ok(file) = SceneFile::parse(bytes) {
                    file.gaussians().unwrap();
                }
            }
        }
    }

    #[test]
    fn counts_that_claim_too_much_and_numbers_that_are_none_are_refused() {
        let changed = |change: &dyn Fn(&mut Header)| {
            let mut header = SceneFile::for_tests().header;
            change(&mut header);
            SceneFile::parse(SceneFile::new(header, &[0; 16 * 4]).bytes)
        };
        assert!(changed(&|_| ()).is_ok());
        assert!(changed(&|header| header.count = usize::MAX).is_err());
        assert!(changed(&|header| header.dynamic = 2).is_err());
        assert!(changed(&|header| header.sh_degree = 9).is_err());
        assert!(changed(&|header| header.sections[0].floats = usize::MAX).is_err());
        let exact = |floats| Section { name: "more".into(), at: 0, floats, coding: Coding::Exact };
        assert!(changed(&|header| header.sections.extend([exact(usize::MAX / 4), exact(usize::MAX / 4)])).is_err());
        assert!(changed(&|header| header.coarse.push(Coarse { sections: 1, dynamic: 0, still: 2 })).is_err());
        assert!(changed(&|header| header.sections[0].at = 1).unwrap_err().contains("do not join"));
        let mut bytes = SceneFile::for_tests().bytes;
        let last = bytes.len() - 4;
        bytes[last..].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(SceneFile::parse(bytes).unwrap_err().contains("no number"));
    }
}
