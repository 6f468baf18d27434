//! Bodies at the edges of what paths, nodes and gates may be: the kernels against the `f64` twin, and paths that were fitted to poses
//! against the rotation that these were taken from.

use std::{collections::BTreeMap, f64::consts::TAU};

use erfgs_base::random::{key, range};
use erfgs_dataset::{Body, BodyPose, SurfacePoint};
use erfgs_splat::{
    field::{Outputs, Tape},
    gaussians::CORE,
    gpu::Gpu,
    motion::{
        Bodies, BodiesOptions, ClockRow, FreeTimeOptions, Motion, MotionRows, Supervision,
        bodies::{EXTRA_FLOATS, SOFTNESS, Start},
        free_time::GONE,
    },
    raster::Deltas,
    reference::bodies::{self as twin, Gate, Node, Row},
};
use erfgs_train::start::{Piece, Recording, from_bodies};
use glam::{DQuat, DVec3, DVec4};

use crate::{Bound, Case, Expected, Measured, Refusal, Size};

const PART: &str = "motion, bodies";

/// Its name, and the truth of its cases.
pub(crate) const ABOUT: [&str; 2] = [
    PART,
    "Bodies of up to 60 Gaussians. Against the `f64` twin, an error is counted in what the roundings of f32 may make of the number; against a rotation, the path that was fitted to its poses is looked at between them.",
];

const TWIN: &str = "32 roundings of f32 of the place, and of 1 plus the logit and its change: sums of four control points and four nodes";
const ROTATION: &str = "three times what the best cubic spline leaves of a quaternion's sine, 2 x 9.1e-4 (half the turn a knot)^4; at the ends, what the fit's stiffness of 1e-3 bends beside 11 poses a knot, 0.013 (half the turn a knot)^3; 32 roundings of f32";
/// Half a unit in the last place of a number in f32, over the number.
const HALF_ULP: f64 = 1.0 / 16_777_216.0;
const SECONDS: f64 = 0.6;
const INTERVALS: f64 = 9.0;

/// A body that turns about an axis while it goes along a line.
#[derive(Clone, Copy)]
struct Made {
    /// Radians a second.
    rate: f64,
    /// Poses a second.
    poses: f64,
    /// Its points.
    points: u64,
    /// Its size, metres.
    size: f64,
    /// Where it begins, metres, along each axis.
    away: f64,
    /// When it is there, seconds.
    span: [f64; 2],
    /// RGB intervals in the recording, in each of which a path has three knots.
    intervals: f64,
    /// Whether Gaussians hang on each of its nodes.
    all_hang: bool,
}

const USUAL: Made = Made {
    rate: 6.0,
    poses: 500.0,
    points: 60,
    size: 0.3,
    away: 0.0,
    span: [0.0, SECONDS],
    intervals: INTERVALS,
    all_hang: true,
};

impl Made {
    /// Its frame.
    fn pose(&self, seconds: f64) -> (DQuat, DVec3) {
        let axis = DVec3::new(1.0, 2.0, -2.0) / 3.0;
        (
            DQuat::from_axis_angle(axis, self.rate * seconds),
            DVec3::splat(self.away) + seconds * DVec3::new(2.0, -1.0, 0.5),
        )
    }

    fn body(&self) -> Body {
        let nanoseconds = |seconds: f64| (1e9 * seconds).round() as i64;
        let [first, last] = self.span;
        let count = ((last - first) * self.poses).round().max(1.0) as u64;
        let pose = |index: u64| {
            let t_ns = nanoseconds(first + (last - first) * index as f64 / count as f64);
            let (turn, shift) = self.pose(1e-9 * t_ns as f64);
            BodyPose { t_ns, translation_m: shift.to_array(), rotation_wxyz: [turn.w, turn.x, turn.y, turn.z] }
        };
        let point = |index: u64| {
            let at = [0, 1, 2].map(|axis| range(key(81, &[index, axis]), -self.size, self.size));
            SurfacePoint { position_m: at, normal: [0.0, 0.0, 1.0], colour: [128; 3] }
        };
        Body {
            name: "made".into(),
            span_ns: self.span.map(nanoseconds),
            poses: (0..=count).map(pose).collect(),
            points: (0..self.points).map(point).collect(),
            found_by: BTreeMap::new(),
        }
    }

    fn start(&self) -> Start {
        let recording = Recording { span_ns: [0, (1e9 * SECONDS) as i64], intervals: self.intervals };
        let free = FreeTimeOptions::default();
        let mut start = from_bodies(&[Piece::whole(self.body())], recording, 0, &BodiesOptions::default(), &free);
        if !self.all_hang {
            // On the first node alone.
            for row in start.gaussians.motion.chunks_exact_mut(free.floats() + EXTRA_FLOATS) {
                row[free.floats() + 1..free.floats() + 5].copy_from_slice(&[1.0, 0.0, 0.0, 0.0]);
            }
        }
        // Nodes that do something.
        let count = start.bodies + start.nodes;
        for (index, point) in start.control.chunks_exact_mut(8).enumerate().filter(|(index, _)| index % count >= 1) {
            for axis in 0..3 {
                point[axis] = range(key(82, &[index as u64, axis as u64]), -0.02, 0.02) as f32;
                point[5 + axis] = range(key(83, &[index as u64, axis as u64]), -0.2, 0.2) as f32;
            }
        }
        start
    }

    /// The largest error against the twin, over what it may be, at these instants.
    fn measure(&self, gpu: &Gpu, instants: &[f64]) -> Result<Measured, Refusal> {
        let start = self.start();
        let mut measured = Measured::default();
        for &t01 in instants {
            let t01 = t01 as f32;
            let (deltas, not_finite) = device(gpu, &start, t01)?;
            measured.not_finite += not_finite;
            for (delta, (row, truth)) in deltas.chunks_exact(CORE).zip(truth(&start, t01)) {
                let of = |computed: f32, truth: f64, size: f64| {
                    let may = 32.0 * HALF_ULP * size;
                    Measured::between([f64::from(computed) / may], [truth / may])
                };
                let size = truth.place.length() + row.place.length() + 1e-3;
                for (moved, way) in delta.iter().zip((truth.place - row.place).to_array()) {
                    measured = measured.and(of(*moved, way, size));
                }
                for (turned, way) in delta[6..].iter().zip((truth.turn - row.turn).to_array()) {
                    measured = measured.and(of(*turned, way, 2.0 * row.turn.length()));
                }
                let change = (truth.logit - row.logit).max(f64::from(GONE));
                measured = measured.and(of(delta[10], change, 1.0 + change.abs() + row.logit.abs()));
            }
        }
        Ok(measured)
    }

    /// How far the fitted path is from the rotation, radians: at points one metre from the middle.
    fn turns(&self, gpu: &Gpu) -> Result<Measured, Refusal> {
        let start = Start { nodes: 0, node_bodies: Vec::new(), ..self.start() };
        // The path of the body alone, with three points that turn with it.
        let count = self.start().nodes + 1;
        let control = start.control.chunks_exact(8 * count).flat_map(|knot| knot[..8].to_vec()).collect();
        let free = FreeTimeOptions::default();
        let mut gaussians = start.gaussians.clone();
        let places = [DVec3::X, DVec3::Y, DVec3::Z];
        gaussians.core.truncate(CORE * places.len());
        gaussians.motion.truncate((free.floats() + EXTRA_FLOATS) * places.len());
        for (core, place) in gaussians.core.chunks_exact_mut(CORE).zip(places) {
            core[..3].copy_from_slice(&place.to_array().map(|at| at as f32));
        }
        for row in gaussians.motion.chunks_exact_mut(free.floats() + EXTRA_FLOATS) {
            row[free.floats() + 1..].fill(0.0);
        }
        gaussians.dynamic = places.len();
        let start = Start { control, other: start.other[..4].to_vec(), neighbours: Vec::new(), gaussians, ..start };
        let mut measured = Measured::default();
        for index in 0..=97 {
            let t01 = (f64::from(index) / 97.0) as f32;
            let (deltas, not_finite) = device(gpu, &start, t01)?;
            measured.not_finite += not_finite;
            let (turn, shift) = self.pose(f64::from(t01) * SECONDS);
            for (delta, place) in deltas.chunks_exact(CORE).zip(places) {
                let there = DVec3::new(delta[0].into(), delta[1].into(), delta[2].into()) + place;
                measured = measured.and(Measured::between([(there - turn * place - shift).length()], [0.0]));
            }
        }
        Ok(measured)
    }
}

/// The changes of the Gaussians of `start` at a time, and how many numbers of the gradients are not finite.
fn device(gpu: &Gpu, start: &Start, t01: f32) -> Result<(Vec<f32>, u64), Refusal> {
    let free = FreeTimeOptions::default();
    let (core, values) = (&start.gaussians.core, &start.gaussians.motion);
    let count = core.len() / CORE;
    let mut bodies = Bodies::new(gpu, start, &BodiesOptions::default(), &free, [SECONDS, INTERVALS], 2.0)?;
    bodies.hang(gpu, values)?;
    let mut motion = Motion::Bodies(Box::new(bodies));
    let d_core = gpu.storage("gradients of the core", 4 * core.len() as u64)?;
    let gradients = gpu.storage("gradients of the rows", 4 * values.len() as u64)?;
    let (core, values) = (gpu.storage_from("core", core)?, gpu.storage_from("rows", values)?);
    let rows = MotionRows { core: &core, count: count as u32, values: &values, gradients: &gradients };
    let mut tape = Tape::new(gpu)?;
    motion.forward(gpu, rows, t01, &mut tape, Outputs::All)?;
    let d_deltas = Deltas::new(gpu, "gradients of the changes", count as u32, None)?;
    gpu.upload(&d_deltas.core, 0, &vec![0.5_f32; count * CORE]);
    motion.backward(gpu, rows, &tape, &d_deltas, &d_core, Supervision::Frame(1.0))?;
    let clock = gpu.storage("clock", 4 * ClockRow::FLOATS as u64)?;
    motion.clock(gpu, rows, &tape, &d_deltas, ClockRow { sums: &clock, row: 0 });
    let odd = |values: &[f32]| values.iter().filter(|value| !value.is_finite()).count() as u64;
    let mut not_finite = odd(&gpu.download(&d_core, CORE * count)?) + odd(&gpu.download(&clock, ClockRow::FLOATS)?);
    if let Some(bodies) = motion.bodies() {
        not_finite += bodies.gradients(gpu)?.iter().map(|values| odd(values)).sum::<u64>();
    }
    Ok((gpu.download(&tape.deltas.core, CORE * count)?, not_finite))
}

/// The Gaussians of `start` as they are stored, and as its body and nodes carry them at a time, which is rounded as the kernels are told it.
fn truth(start: &Start, t01: f32) -> Vec<(Row, Row)> {
    let count = start.bodies + start.nodes;
    let stretch = f64::from((f64::from(t01) * (start.knots - 3) as f64) as f32);
    let seconds = f64::from((f64::from(t01) * SECONDS) as f32);
    let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|value| f64::from(*value)).collect() };
    let (control, other) = (wide(&start.control), wide(&start.other));
    let pose = |entity: usize| {
        let points: Vec<twin::Control> = control
            .chunks_exact(8 * count)
            .map(|knot| {
                let point = &knot[8 * entity..];
                (DVec3::from_slice(point), DVec4::from_slice(&point[4..]))
            })
            .collect();
        let own = &other[4 * entity..];
        let gated = entity < start.bodies && own[2] > 0.0;
        let gate = Gate { times: [own[0], own[1]], softness: f64::from(SOFTNESS) };
        twin::pose(&points, stretch, if gated { gate.log_presence(seconds) } else { 0.0 })
    };
    let poses: Vec<twin::Pose> = (0..count).map(pose).collect();
    let floats = start.gaussians.motion_floats;
    let rows = start.gaussians.core.chunks_exact(CORE).zip(start.gaussians.motion.chunks_exact(floats));
    let carried = |(core, row): (&[f32], &[f32])| {
        let (core, hangs) = (wide(core), &row[floats - EXTRA_FLOATS..]);
        let stored = Row { place: DVec3::from_slice(&core), turn: DVec4::from_slice(&core[6..]), logit: core[10] };
        let nodes: Vec<_> = hangs[1..5]
            .iter()
            .filter(|node| **node > 0.0)
            .map(|node| start.bodies + *node as usize - 1)
            .map(|entity| {
                let own = &other[4 * entity..];
                (Node { rest: DVec3::from_slice(own), log_radius: own[3] }, poses[entity])
            })
            .collect();
        (stored, twin::carried(&stored, &poses[hangs[0] as usize - 1], &nodes))
    };
    rows.map(carried).collect()
}

/// The cases of bodies.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    const SPREAD: [f64; 5] = [0.0, 0.17, 0.43, 0.9, 1.0];
    // About where it comes and goes, to 1 ms, and far from there.
    const GATES: [f64; 8] = [0.0, 0.3, 0.332, 0.334, 0.45, 0.49, 0.51, 1.0];
    let within = |unit, most, why| Expected::Within(Bound { most, unit, why });
    let mut cases = Vec::new();
    let mut against_twin = |name: String, made: Made, instants: &'static [f64]| {
        let expected = within("of the roundings", 1.0, TWIN);
        cases.push(Case::new(PART, name, expected, move |bench| made.measure(&bench.gpu, instants)));
    };
    against_twin("a thing of 30 cm that turns once a second, for comparison".into(), USUAL, &SPREAD);
    against_twin("one stretch between knots".into(), Made { rate: 1.0, intervals: 1.0 / 3.0, ..USUAL }, &SPREAD);
    against_twin("one node".into(), Made { points: 1, ..USUAL }, &SPREAD);
    against_twin("nodes without Gaussians".into(), Made { all_hang: false, ..USUAL }, &SPREAD);
    against_twin("appears and vanishes".into(), Made { span: [0.2, 0.3], ..USUAL }, &GATES);
    against_twin("there for 10 us".into(), Made { span: [0.2, 0.20001], ..USUAL }, &GATES);
    against_twin("100 turns a second".into(), Made { rate: 100.0 * TAU, poses: 5000.0, ..USUAL }, &SPREAD);
    for decade in [2, 3, 4, 5] {
        if size == Size::Full || decade == 4 {
            let name = format!("1e{decade} m from the origin");
            against_twin(name, Made { away: 10_f64.powi(decade), ..USUAL }, &SPREAD);
        }
    }
    for (size_m, name) in [(1e-3, "a thing of 1 mm"), (100.0, "a thing of 100 m")] {
        against_twin(name.into(), Made { size: size_m, ..USUAL }, &SPREAD);
    }
    // Three knots an interval turn by so much of a radian each; what is faster gets more knots, a radian apart.
    let slowest = 3.0 * INTERVALS / SECONDS;
    for (turns, poses) in [(0.1, 500.0), (0.3, 500.0), (1.0, 500.0), (10.0, 5000.0)] {
        let rate = turns * slowest;
        let turn_a_knot = f64::min(turns, 1.0);
        let half = 0.5 * turn_a_knot;
        let most = 6.0 * 9.1e-4 * half.powi(4) + 0.013 * half.powi(3) + 32.0 * HALF_ULP * 3.0;
        let name =
            format!("{:.1} turns a second, {turn_a_knot} rad a knot, {:.2} rad a pose", rate / TAU, rate / poses);
        let made = Made { rate, poses, ..USUAL };
        cases.push(Case::new(PART, name, within("rad", most, ROTATION), move |bench| made.turns(&bench.gpu)));
    }
    cases
}
