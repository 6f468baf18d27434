//! What a page needs to know of a run, in one file; `docs/reference/scene-file.md` describes it.
//!
//! A magic, the length of a JSON header (u32, little-endian), the header, and sections in the order that the header lists, which
//! says how each is written ([`Coding`]). The most important Gaussians come first, so that a picture of them is there before the
//! rest is. A file on a disk is all this in gzip.

mod coding;
mod fidelity;
mod motion;
mod order;
mod plausible;
mod read;

use std::{io::Write as _, ops::Range};

use erfgs_splat::{
    gaussians::{CORE, select_rows, sh_stride},
    raster::View,
    trained::{Reconstruction, RecordedCamera},
};
use flate2::{Compression, write::GzEncoder};
use serde::{Deserialize, Serialize};

pub use self::{
    coding::Coding,
    fidelity::{FidelityError, fidelity},
    motion::HeaderMotion,
    read::SceneFileError,
};
use self::{
    motion::parts_of_motion,
    order::{Order, order},
};

/// What a file begins with.
pub const MAGIC: &[u8; 8] = b"ERFGS4D2";
/// What files of the first version begin with: each of their sections is whole.
pub const FIRST_MAGIC: &[u8; 8] = b"ERFGS4D1";
/// Points of the initial cloud that tell how near to a camera there is something to see.
const POINTS: usize = 4000;
const POINTS_NAME: &str = "points";

/// A scene as bytes, and whether a browser can draw it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    /// The file.
    pub bytes: Vec<u8>,
    /// What is said of it.
    pub header: Header,
}

/// The header of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Gaussians.
    pub count: usize,
    /// How many of them move; they come first.
    pub dynamic: usize,
    /// SH degree that the rows have room for.
    pub sh_degree: u32,
    /// SH degree in use.
    pub active_sh_degree: u32,
    /// Colour behind everything.
    pub background: [f32; 3],
    /// The least near plane, metres, and the share of the depth of the nearest points at which it lies.
    pub near: [f32; 2],
    /// Standard deviations of a Gaussian that must lie in front of a camera.
    pub near_sigmas: f32,
    /// First and last instant, session nanoseconds.
    pub span_ns: [i64; 2],
    /// How the first rows move.
    pub motion: HeaderMotion,
    /// What of the model a browser's kernels cannot compute, so that the server must draw it.
    pub only_server: Option<String>,
    /// The cameras.
    pub cameras: Vec<HeaderCamera>,
    /// Edges (in [0, 1]) and events (all cameras together) of bins of time.
    pub events: HeaderEvents,
    /// What follows the header: points, the rows of the most important Gaussians, all else.
    pub sections: Vec<Section>,
    /// What can be shown before all is there, from little to more.
    #[serde(default)]
    pub coarse: Vec<Coarse>,
}

/// What can be shown before all of a file is there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Coarse {
    /// Sections that it takes, from the first on.
    pub sections: usize,
    /// Rows that are there then: the first of those that move...
    pub dynamic: usize,
    /// ...and the first of those that stand still.
    pub still: usize,
}

/// A section of a file, or a piece of one: pieces have one name, and leave nothing out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// Its name.
    pub name: String,
    /// At which of the numbers of that name it begins.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub at: usize,
    /// Numbers in it.
    pub floats: usize,
    /// How they are written.
    pub coding: Coding,
}

/// How well a file keeps the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// To the bit.
    Exact,
    /// In a sixth of the room and less; pictures differ by what is hard to see.
    Packed,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn is_zero(number: &usize) -> bool {
    *number == 0
}

/// A camera of the recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeaderCamera {
    /// Its name.
    pub name: String,
    /// `train` or `test`.
    pub split: String,
    /// `rgb`, `event` or `both`.
    pub modality: String,
    /// Image size, intrinsics and pose.
    #[serde(flatten)]
    pub view: View,
    /// Its near plane, metres.
    pub near: f32,
    /// Time, start and end of exposure of each frame, in [0, 1].
    pub frames: Vec<[f64; 3]>,
}

/// When events came.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeaderEvents {
    /// Edges of the bins, in [0, 1].
    pub edges: Vec<f64>,
    /// Events in each bin, over all cameras.
    pub counts: Vec<f64>,
}

/// What a run learned, in rows, from which files are made.
#[derive(Clone, Debug)]
pub struct Learned {
    header: Header,
    parts: Vec<Part>,
}

#[derive(Clone, Debug)]
struct Part {
    name: String,
    values: Vec<f32>,
    /// How it is written where not exactly.
    packed: Coding,
    /// Floats of the row of a Gaussian, if these are rows of Gaussians.
    row: Option<usize>,
    /// Whether it comes before all rows of Gaussians, where it is none itself.
    early: bool,
}

/// Bytes of a code for each float of a row of `core`: means finer than all else.
const CORE_CODES: [u8; CORE] = [2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 0];

impl Learned {
    /// What a run has learned.
    #[must_use]
    pub fn of(learned: &Reconstruction) -> Self {
        let Reconstruction { record, gaussians, shared, points } = learned;
        let drawing = &record.drawing;
        let (motion, only_server) = motion::of(learned);
        let every = points.len().div_ceil(POINTS).max(1);
        let some_points: Vec<f32> = points.iter().step_by(every).flatten().copied().collect();
        let header = Header {
            count: gaussians.len(),
            dynamic: if motion == HeaderMotion::Still { 0 } else { gaussians.dynamic },
            sh_degree: gaussians.sh_degree,
            active_sh_degree: drawing.sh_degree,
            background: drawing.background,
            near: [drawing.near_m, drawing.near_share],
            near_sigmas: drawing.near_sigmas,
            span_ns: record.span_ns,
            motion,
            only_server,
            cameras: record.cameras.iter().map(|camera| header_camera(learned, camera)).collect(),
            events: HeaderEvents { edges: record.events.edges.clone(), counts: record.events.counts.clone() },
            sections: Vec::new(),
            coarse: Vec::new(),
        };
        let stride = sh_stride(gaussians.sh_degree);
        // What pads a row of harmonics is nothing.
        let used = 3 * (gaussians.sh_degree as usize + 1).pow(2);
        let sh_codes: Vec<u8> = (0..stride).map(|column| u8::from(column < used)).collect();
        let rows = |name: &str, values, codes: &[u8]| Part {
            name: name.into(),
            values,
            packed: Coding::blocks(codes),
            row: Some(codes.len()),
            early: false,
        };
        let mut parts =
            vec![rows("core", gaussians.core.clone(), &CORE_CODES), rows("sh", gaussians.sh.clone(), &sh_codes)];
        parts.extend(parts_of_motion(&header.motion, &gaussians.motion, shared.clone()));
        let packed = Coding::blocks(&[2; 3]);
        parts.push(Part { name: POINTS_NAME.into(), values: some_points, packed, row: None, early: true });
        Self { header, parts }
    }

    /// The file.
    #[must_use]
    pub fn file(&self, precision: Precision) -> SceneFile {
        let Header { count, dynamic, .. } = self.header;
        let (rows, others): (Vec<&Part>, Vec<&Part>) = self.parts.iter().partition(|part| part.row.is_some());
        let (early, others): (Vec<&Part>, Vec<&Part>) = others.into_iter().partition(|part| part.early);
        let Order { rows: order, parts } = order(&rows[0].values, dynamic, precision);
        let mut writer = Writer { header: self.header.clone(), written: Vec::new(), precision };
        writer.parts(&early);
        let mut from = [0, 0];
        for (index, &to) in parts.iter().enumerate() {
            // Rows of `motion` end with those that move.
            for part in &rows {
                if parts.len() == 1 {
                    writer.rows(part, &order, 0..count);
                } else {
                    writer.rows(part, &order, from[0]..to[0]);
                    writer.rows(part, &order, dynamic + from[1]..dynamic + to[1]);
                }
            }
            if index + 1 < parts.len() {
                let sections = writer.header.sections.len();
                writer.header.coarse.push(Coarse { sections, dynamic: to[0], still: to[1] });
            }
            if index == 0 {
                writer.parts(&others);
            }
            from = to;
        }
        let Writer { header, written, .. } = writer;
        SceneFile::new(header, &written)
    }
}

/// A file while it grows.
struct Writer {
    header: Header,
    written: Vec<u8>,
    precision: Precision,
}

impl Writer {
    fn section(&mut self, part: &Part, at: usize, values: &[f32]) {
        let coding = if self.precision == Precision::Exact { &Coding::Exact } else { &part.packed };
        let section = Section { name: part.name.clone(), at, floats: values.len(), coding: coding.clone() };
        self.header.sections.push(section);
        self.written.extend(coding.write(values));
    }

    fn parts(&mut self, parts: &[&Part]) {
        for part in parts {
            self.section(part, 0, &part.values);
        }
    }

    /// The rows of the file in a range, as far as the part has them.
    fn rows(&mut self, part: &Part, order: &[usize], range: Range<usize>) {
        let Some(row) = part.row else { return };
        let has = part.values.len() / row;
        let range = range.start.min(has)..range.end.min(has);
        if !range.is_empty() || range.start == 0 && has == 0 {
            self.section(part, range.start * row, &select_rows(&part.values, row, &order[range]));
        }
    }
}

impl SceneFile {
    fn new(header: Header, sections: &[u8]) -> Self {
        // A header of numbers, names and lists is always JSON.
        let mut text = serde_json::to_vec(&header).unwrap_or_default();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bytes = MAGIC.to_vec();
        bytes.extend((text.len() as u32).to_le_bytes());
        bytes.extend(text);
        bytes.extend(sections);
        Self { bytes, header }
    }

    /// The file as it stands on a disk: compressed.
    #[must_use]
    pub fn compressed(&self) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        // Memory takes all that is written to it.
        let written = encoder.write_all(&self.bytes).and_then(|()| encoder.finish());
        written.unwrap_or_default()
    }
}

#[cfg(test)]
impl SceneFile {
    /// One Gaussian that stands still.
    pub(crate) fn for_tests() -> Self {
        let sections = [("core", 12), ("sh", 4), ("points", 0)];
        let section =
            |(name, floats): (&str, usize)| Section { name: name.into(), at: 0, floats, coding: Coding::Exact };
        let header = Header {
            count: 1,
            dynamic: 0,
            sh_degree: 0,
            active_sh_degree: 0,
            background: [0.0; 3],
            near: [0.2, 0.0],
            near_sigmas: 3.0,
            span_ns: [0, 1_000_000_000],
            motion: HeaderMotion::Still,
            only_server: None,
            cameras: Vec::new(),
            events: HeaderEvents::default(),
            sections: sections.map(section).to_vec(),
            coarse: Vec::new(),
        };
        Self::new(header, &[0; 16 * 4])
    }
}

fn header_camera(learned: &Reconstruction, camera: &RecordedCamera) -> HeaderCamera {
    let Reconstruction { record, points, .. } = learned;
    HeaderCamera {
        name: camera.name.clone(),
        split: if camera.held_out { "test".into() } else { "train".into() },
        modality: serde_json::to_value(camera.modality)
            .ok()
            .and_then(|v| Some(v.as_str()?.to_owned()))
            .unwrap_or_default(),
        view: camera.view,
        near: record.near(points, &camera.view),
        frames: camera.frames_ns.iter().map(|times| times.map(|t_ns| record.to_unit(t_ns))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_shown_early_comes_first_and_all_rows_are_there() {
        let (count, dynamic) = (600, 100);
        let core = (0..count).flat_map(|row| (0..CORE).map(move |i| if i == 10 { row as f32 / 100.0 } else { 0.25 }));
        let motion = HeaderMotion::FreeTime { intervals: 5.0, least_life: 0.5, gone: -40.0, knots: 0, spacing: 1.0 };
        let header = Header {
            count,
            dynamic,
            motion,
            sections: Vec::new(),
            cameras: Vec::new(),
            ..SceneFile::for_tests().header
        };
        let part = |name: &str, values: Vec<f32>, row: usize| {
            let row = (row > 0).then_some(row);
            Part { name: name.into(), values, packed: Coding::Exact, row, early: name == POINTS_NAME }
        };
        let rows = |floats: usize, count: usize| (0..count).flat_map(|row| vec![row as f32; floats]).collect();
        let parts = vec![
            part("core", core.collect(), CORE),
            part("sh", rows(4, count), 4),
            part("motion", rows(8, dynamic), 8),
            part(POINTS_NAME, vec![1.0, 2.0, 3.0], 0),
        ];
        let file = Learned { header, parts }.file(Precision::Exact);
        let parsed = SceneFile::parse(file.bytes.clone()).unwrap();
        assert_eq!(parsed, file);
        let Header { sections, coarse, .. } = &file.header;
        assert_eq!(sections[0].name, POINTS_NAME);
        let seen: Vec<[usize; 3]> = coarse.iter().map(|part| [part.sections, part.dynamic, part.still]).collect();
        assert_eq!(seen, [[6, 13, 63], [11, 50, 250]]);
        for part in coarse {
            let floats = |name: &str| -> usize {
                let there = sections[..part.sections].iter().filter(|section| section.name == name);
                there.map(|section| section.floats).sum()
            };
            let rows = part.dynamic + part.still;
            assert_eq!([floats("core"), floats("sh"), floats("motion")], [CORE * rows, 4 * rows, 8 * part.dynamic]);
        }
        // Opacities grow with the rows, and rows of all kinds go the same way.
        let gaussians = parsed.gaussians().unwrap();
        let came_from: Vec<f32> = gaussians.core.chunks(CORE).map(|row| (row[10] * 100.0).round()).collect();
        assert!(came_from[..13].iter().all(|&row| (87.0..100.0).contains(&row)));
        assert!(came_from[100..163].iter().all(|&row| row >= 537.0));
        assert!(gaussians.sh.chunks(4).zip(&came_from).all(|(row, &from)| (row[0] - from).abs() < 1e-3));
        assert!(gaussians.motion.chunks(8).zip(&came_from).all(|(row, &from)| (row[0] - from).abs() < 1e-3));
    }

    #[test]
    fn files_of_the_first_version_open() {
        let mut bytes = SceneFile::for_tests().bytes;
        let read = SceneFile::parse(bytes.clone()).unwrap();
        bytes[..8].copy_from_slice(FIRST_MAGIC);
        assert_eq!(SceneFile::parse(bytes.clone()).unwrap().gaussians(), read.gaussians());
        bytes[7] = b'3';
        assert!(SceneFile::parse(bytes).unwrap_err().contains("later version"));
    }
}
