//! How the Gaussians of a file move: what the header says of it, and the sections that it takes.

use erfgs_splat::{
    field::{FieldState, NamedVector, TimeAxis},
    motion::{
        FreeTimeOptions, MotionPlan,
        bodies::{EXTRA_FLOATS, NEVER, SOFTNESS},
        free_time,
    },
    trained::Reconstruction,
};
use serde::{Deserialize, Serialize};

use super::{Coding, Part};

/// Numbers of a row of the section `hangs`: 1 + body (0: none carries it), 1 + node of up to four (0: none).
pub(super) const HANGS: usize = 5;
/// Floats of a control point: shift and nothing, turn.
const CONTROL: usize = 8;
/// Bytes of the code of each.
const CONTROL_CODES: [u8; CONTROL] = [2, 2, 2, 0, 2, 2, 2, 2];
/// Floats of a gate or a node.
const OTHER: usize = 4;

/// How Gaussians move.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum HeaderMotion {
    /// They do not.
    Still,
    /// Each has a trajectory and a life: section `motion`.
    FreeTime {
        /// RGB intervals in the span: the unit of time of the rows.
        intervals: f32,
        /// The shortest life, intervals.
        least_life: f32,
        /// The logit change that stands for an opacity of nothing.
        gone: f32,
        /// Knots of a path on either side of its instant; 0: a path is a parabola.
        #[serde(default)]
        knots: u32,
        /// Intervals from a knot to the next.
        #[serde(default = "one")]
        spacing: f32,
    },
    /// Bodies carry them: sections `hangs`, `bodies.control` and `bodies.other`. Those of no body are free in time: section `motion`.
    Bodies {
        /// As of those that are free in time.
        intervals: f32,
        /// As of those that are free in time.
        least_life: f32,
        /// As of those that are free in time.
        gone: f32,
        /// As of those that are free in time.
        knots: u32,
        /// As of those that are free in time.
        spacing: f32,
        /// Length of the recording, seconds: the unit of when a body appears and vanishes.
        seconds: f32,
        /// How softly it does, seconds.
        softness: f32,
        /// Control points of the path of a body or node, at least 4.
        control: u32,
        /// Nodes of all bodies.
        nodes: u32,
        /// A name for each body.
        names: Vec<String>,
    },
    /// A deformation field: sections named as in a checkpoint.
    Hexplane {
        /// The box of the planes, metres.
        aabb: [[f32; 3]; 2],
        /// Multipliers of the spatial resolution.
        levels: Vec<u32>,
        /// Features of a plane.
        features: u32,
        /// Width of the network.
        width: u32,
        /// Cells along each axis at multiplier 1.
        spatial_resolution: u32,
        /// Whether [0, 1] falls on the upper half of the rows of time.
        upper_half: bool,
    },
}

fn one() -> f32 {
    1.0
}

/// What bodies and their nodes are to the sections of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Carriers {
    pub bodies: usize,
    pub nodes: usize,
    /// Control points of each.
    pub control: usize,
}

impl Carriers {
    /// Numbers of `bodies.control` and `bodies.other`, where a machine can count them.
    pub fn floats(&self) -> [Option<usize>; 2] {
        let count = self.bodies.checked_add(self.nodes);
        [
            count.and_then(|count| count.checked_mul(self.control)?.checked_mul(CONTROL)),
            count.and_then(|count| count.checked_mul(OTHER)),
        ]
    }
}

impl HeaderMotion {
    /// How the rows of `motion` are to be read, where there are any.
    pub(super) fn free_time(&self) -> Option<FreeTimeOptions> {
        let (&Self::FreeTime { least_life, knots, spacing, .. } | &Self::Bodies { least_life, knots, spacing, .. }) =
            self
        else {
            return None;
        };
        Some(FreeTimeOptions { least_life, knots, spacing, ..FreeTimeOptions::default() })
    }

    /// Bodies and nodes, where there are any.
    pub(super) fn carriers(&self) -> Option<Carriers> {
        let Self::Bodies { control, nodes, names, .. } = self else { return None };
        Some(Carriers { bodies: names.len(), nodes: *nodes as usize, control: *control as usize })
    }

    /// Whether its numbers can be.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(options) = self.free_time() {
            options.check_path().map_err(|error| error.to_string())?;
        }
        let Self::Bodies { seconds, softness, control, nodes, names, .. } = self else { return Ok(()) };
        let positive = |value: f32| value > 0.0 && value.is_finite();
        if *control < 4 || names.is_empty() || names.len() + *nodes as usize > usize::from(u16::MAX) {
            return Err(format!("it has {} bodies, {nodes} nodes and {control} control points", names.len()));
        }
        if !positive(*seconds) || !positive(*softness) {
            return Err("the times of its bodies are none".into());
        }
        Ok(())
    }
}

/// How the Gaussians move, and what of that a browser cannot compute.
pub(super) fn of(learned: &Reconstruction) -> (HeaderMotion, Option<String>) {
    let record = &learned.record;
    let (intervals, gone) = (record.intervals as f32, free_time::GONE);
    if learned.gaussians.dynamic == 0 {
        return (HeaderMotion::Still, None);
    }
    match &record.motion {
        MotionPlan::Still => (HeaderMotion::Still, None),
        MotionPlan::FreeTime { options, .. } => {
            let &FreeTimeOptions { least_life, knots, spacing, .. } = options;
            (HeaderMotion::FreeTime { intervals, least_life, gone, knots, spacing }, None)
        }
        MotionPlan::Bodies { options, seconds, names, nodes, knots: control, .. } => {
            let &FreeTimeOptions { least_life, knots, spacing, .. } = options;
            let motion = HeaderMotion::Bodies {
                intervals,
                least_life,
                gone,
                knots,
                spacing,
                seconds: *seconds as f32,
                softness: SOFTNESS,
                control: *control as u32,
                nodes: *nodes as u32,
                names: names.clone(),
            };
            (motion, None)
        }
        MotionPlan::HexPlane { field, aabb } => {
            let beyond = if field.heads.sh {
                Some("its field deforms colours")
            } else if field.depth > 1 {
                Some("its network has several hidden layers")
            } else if !field.width.is_multiple_of(4) || !field.features.is_multiple_of(4) {
                Some("its network has a width that is no multiple of four")
            } else {
                None
            };
            let motion = HeaderMotion::Hexplane {
                aabb: *aabb,
                levels: field.levels.clone(),
                features: field.features,
                width: field.width,
                spatial_resolution: field.spatial_resolution[0],
                upper_half: field.time_axis == TimeAxis::UpperHalf,
            };
            (motion, beyond.map(str::to_owned))
        }
    }
}

/// The sections that a motion takes: `rows` are those of the Gaussians, `shared` is what they share.
pub(super) fn parts_of_motion(motion: &HeaderMotion, rows: &[f32], shared: Option<FieldState>) -> Vec<Part> {
    let of_rows = |name: &str, values: Vec<f32>, packed: Coding, row: usize| Part {
        name: name.into(),
        values,
        packed,
        row: Some(row),
        early: false,
    };
    let free =
        |values: Vec<f32>, floats: usize| of_rows("motion", values, Coding::blocks(&motion_codes(floats)), floats);
    match (motion, shared) {
        (HeaderMotion::FreeTime { .. }, _) => {
            let floats = motion.free_time().map_or(1, |options| options.floats());
            vec![free(rows.to_vec(), floats)]
        }
        (HeaderMotion::Bodies { .. }, Some(shared)) => {
            let floats = motion.free_time().map_or(1, |options| options.floats());
            let (paths, hangs) = split_rows(rows, floats);
            let mut parts = vec![free(paths, floats), of_rows("hangs", hangs, Coding::Whole, HANGS)];
            let of = motion.carriers().map_or(0, |carriers| carriers.bodies + carriers.nodes);
            parts.extend(learned(shared).map(|NamedVector { name, values }| {
                // A range for each number of each path.
                let packed = if name == "bodies.control" {
                    Coding::Blocks {
                        rows: (values.len() / CONTROL / of.max(1)).max(1),
                        columns: CONTROL_CODES.repeat(of),
                    }
                } else {
                    Coding::Exact
                };
                Part { name, values, packed, row: None, early: true }
            }));
            parts
        }
        (HeaderMotion::Hexplane { features, .. }, Some(field)) => {
            let features = *features as usize;
            let part = |NamedVector { name, values }: NamedVector| {
                // Planes have a range for each of their features.
                let packed = if name.starts_with("grid.") {
                    Coding::Blocks { rows: (values.len() / features).max(1), columns: vec![1; features] }
                } else {
                    Coding::Half
                };
                Part { name, values, packed, row: None, early: false }
            };
            learned(field).map(part).collect()
        }
        _ => Vec::new(),
    }
}

/// The vectors of what is shared that are parameters, not moments.
fn learned(shared: FieldState) -> impl Iterator<Item = NamedVector> {
    let learned = |name: &str| !name.ends_with(".m") && !name.ends_with(".v");
    shared.vectors.into_iter().filter(move |vector| learned(&vector.name))
}

/// Bytes of a code for each float of a row of `motion`: vectors of the path, the instant beside the first, the life beside the second.
fn motion_codes(floats: usize) -> Vec<u8> {
    let mut codes = [2, 2, 2, 0].repeat(floats / 4);
    (codes[3], codes[7]) = (2, 1);
    codes
}

/// Rows of bodies as paths of `floats` numbers and what they hang on. The instant of what a body carries is never, which no range of codes
/// has room for: it is written as 0.
fn split_rows(rows: &[f32], floats: usize) -> (Vec<f32>, Vec<f32>) {
    let (mut paths, mut hangs) = (Vec::new(), Vec::new());
    for row in rows.chunks_exact(floats + EXTRA_FLOATS) {
        let (path, extra) = row.split_at(floats);
        let at = paths.len();
        paths.extend_from_slice(path);
        if extra[0] > 0.0 {
            paths[at + 3] = 0.0;
        }
        hangs.extend_from_slice(&extra[..HANGS]);
    }
    (paths, hangs)
}

/// The rows that [`split_rows`] took apart.
pub(super) fn joined_rows(paths: &[f32], floats: usize, hangs: &[f32]) -> Vec<f32> {
    let row = |(path, hangs): (&[f32], &[f32])| {
        let mut row = path.to_vec();
        if hangs[0] > 0.0 {
            row[3] = NEVER;
        }
        row.extend_from_slice(hangs);
        row.resize(floats + EXTRA_FLOATS, 0.0);
        row
    };
    paths.chunks_exact(floats.max(1)).zip(hangs.chunks_exact(HANGS)).flat_map(row).collect()
}

/// Whether the rows of `hangs` name bodies and nodes that there are.
pub(super) fn check_hangs(hangs: &[f32], carriers: Carriers) -> Result<(), String> {
    let whole = |value: f32, most: usize| value >= 0.0 && value <= most as f32 && value.fract() == 0.0;
    let names =
        |row: &[f32]| whole(row[0], carriers.bodies) && row[1..].iter().all(|&node| whole(node, carriers.nodes));
    match hangs.chunks_exact(HANGS).position(|row| !names(row)) {
        None => Ok(()),
        Some(row) => Err(format!("its Gaussian {row} hangs on a body or a node that is not there")),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::{
        Precision, SceneFile,
        scene_file::{Header, Learned},
    };

    /// Two bodies of a node each, with five control points: a Gaussian of each, and one that is free in time.
    pub fn with_bodies() -> Learned {
        let motion = HeaderMotion::Bodies {
            intervals: 9.0,
            least_life: 0.25,
            gone: -30.0,
            knots: 0,
            spacing: 1.0,
            seconds: 0.6,
            softness: 0.012,
            control: 5,
            nodes: 2,
            names: vec!["fan".into(), "ball".into()],
        };
        let hung =
            |body: f32, node: f32| [0.0, 0.0, 0.0, NEVER, 0.0, 0.0, 0.0, 0.0, body, node, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let free = [0.5, -1.0, 2.0, 7.51, 0.1, 0.2, 0.3, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let rows = [hung(1.0, 1.0), free, hung(2.0, 2.0)].concat();
        let entities = 4;
        let control: Vec<f32> = (0..5 * entities)
            .flat_map(|at| [0.1 * at as f32, (at as f32).sin(), 2.0, 0.0, 1.0, 0.01 * at as f32, 0.0, -0.02])
            .collect();
        let vector = |name: &str, values: Vec<f32>| NamedVector { name: name.into(), values };
        let vectors = vec![
            vector("bodies.control", control),
            vector("bodies.control.m", vec![9.0; 160]),
            vector("bodies.other", (0..4 * entities).map(|at| at as f32 / 7.0).collect()),
        ];
        let mut parts = parts_of_motion(&motion, &rows, Some(FieldState { step: 3, vectors }));
        let rows_of = |name: &str, floats: usize| Part {
            name: name.into(),
            values: (0..3 * floats).map(|at| at as f32).collect(),
            packed: Coding::blocks(&vec![2; floats]),
            row: Some(floats),
            early: false,
        };
        parts.extend([rows_of("sh", 4)]);
        parts.insert(0, rows_of("core", 12));
        parts.push(Part { name: "points".into(), values: Vec::new(), packed: Coding::Exact, row: None, early: true });
        let header = Header { count: 3, dynamic: 3, motion, sections: Vec::new(), ..SceneFile::for_tests().header };
        Learned { header, parts }
    }

    #[test]
    fn a_file_with_bodies_comes_back() {
        let learned = with_bodies();
        let exact = SceneFile::parse(learned.file(Precision::Exact).bytes).unwrap();
        let packed = SceneFile::parse(learned.file(Precision::Packed).bytes).unwrap();
        let gaussians = exact.gaussians().unwrap();
        assert_eq!(gaussians.motion_floats, 16);
        let rows: Vec<&[f32]> = gaussians.motion.chunks_exact(16).collect();
        assert_eq!([rows[0][3], rows[1][3], rows[2][3]], [NEVER, 7.51, NEVER]);
        let close = |a: &[f32], b: &[f32], off: f32| {
            assert_eq!(a.len(), b.len());
            a.iter().zip(b).for_each(|(a, b)| assert!((a - b).abs() <= off, "{a} {b}"));
        };
        let again = packed.gaussians().unwrap();
        // Instants keep their sixteen bits, and what a row hangs on is kept to the bit.
        for (row, again) in gaussians.motion.chunks_exact(16).zip(again.motion.chunks_exact(16)) {
            close(&row[..8], &again[..8], 5e-3);
            close(&row[3..4], &again[3..4], 2e-4);
            assert_eq!(row[8..], again[8..]);
        }
        assert_eq!(exact.section("bodies.other"), packed.section("bodies.other"));
        let [a, b] = [&exact, &packed].map(|file| file.section("bodies.control").unwrap());
        close(&a, &b, 5e-5);
        assert_eq!(exact.section("bodies.control.m"), None);
        // Before the first Gaussians of a large scene can be seen, what carries them is there.
        let early: Vec<&str> = packed.header.sections[..3].iter().map(|section| section.name.as_str()).collect();
        assert_eq!(early, ["bodies.control", "bodies.other", "points"]);
    }

    #[test]
    fn bodies_that_cannot_be_are_refused() {
        type Change = fn(&mut HeaderMotion);
        let of = |change: Change| {
            let mut learned = with_bodies();
            change(&mut learned.header.motion);
            SceneFile::parse(learned.file(Precision::Exact).bytes)
        };
        assert!(of(|_| ()).is_ok());
        let changes: [Change; 7] = [
            |motion| {
                if let HeaderMotion::Bodies { control, .. } = motion {
                    *control = 3
                }
            },
            |motion| {
                if let HeaderMotion::Bodies { control, .. } = motion {
                    *control = u32::MAX
                }
            },
            |motion| {
                if let HeaderMotion::Bodies { nodes, .. } = motion {
                    *nodes = u32::MAX
                }
            },
            |motion| {
                if let HeaderMotion::Bodies { nodes, .. } = motion {
                    *nodes = 1
                }
            },
            |motion| {
                if let HeaderMotion::Bodies { names, .. } = motion {
                    names.clear()
                }
            },
            |motion| {
                if let HeaderMotion::Bodies { softness, .. } = motion {
                    *softness = 0.0
                }
            },
            |motion| {
                if let HeaderMotion::Bodies { knots, .. } = motion {
                    *knots = 99
                }
            },
        ];
        for (index, change) in changes.into_iter().enumerate() {
            assert!(of(change).is_err(), "change {index}");
        }
    }

    #[test]
    fn rows_come_back_and_never_is_no_instant_of_the_file() {
        let free = [0.5, -1.0, 2.0, 7.5, 0.0, 0.1, 0.0, -0.5];
        let rows = [
            [&free[..], &[0.0; 8]].concat(),
            [&[0.0, 0.0, 0.0, NEVER, 0.0, 0.0, 0.0, 0.0][..], &[2.0, 300.0, 4096.0, 1.0, 0.0, 0.0, 0.0, 0.0]].concat(),
        ]
        .concat();
        let (paths, hangs) = split_rows(&rows, 8);
        assert_eq!(paths[3], 7.5);
        assert_eq!(paths[11], 0.0);
        assert_eq!(joined_rows(&paths, 8, &hangs), rows);
        let carriers = Carriers { bodies: 2, nodes: 4096, control: 4 };
        assert_eq!(check_hangs(&hangs, carriers), Ok(()));
        for (at, odd) in [(5, 3.0), (5, 0.5), (6, 4097.0), (7, -1.0), (7, f32::NAN)] {
            let mut hangs = hangs.clone();
            hangs[at] = odd;
            assert!(check_hangs(&hangs, carriers).unwrap_err().contains("Gaussian 1"), "{odd}");
        }
    }
}
