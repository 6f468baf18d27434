use erfgs_base::random;
use glam::{DVec3, DVec4};

use super::*;
use crate::{
    field::Tape,
    gpu::{AdapterChoice, Gpu, Shape},
    motion::{ClockRow, FreeTimeOptions, MotionRows, Shown, Supervision, free_time::GONE},
    raster::Deltas,
    reference::bodies::{self as twin, Control, Gate, Node, Pose, Row},
};

const CORE: usize = 12;
const SECONDS: f64 = 0.6;
const INTERVALS: f64 = 9.0;
const EXTENT: f32 = 2.5;

fn open(shape: Shape) -> Gpu {
    Gpu::open(&AdapterChoice { shape: Some(shape), ..Default::default() }).expect("an adapter")
}

fn between(seed: u64, low: f64, high: f64) -> f64 {
    random::range(random::key(seed, &[]), low, high)
}

fn vector(seed: u64, size: f64) -> DVec3 {
    DVec3::from_array([1, 2, 3].map(|k| between(100 * seed + k, -size, size)))
}

/// A turn by up to some `angle` from none.
fn turn(seed: u64, angle: f64) -> DVec4 {
    let v = vector(seed, angle);
    DVec4::new(1.0, v.x, v.y, v.z).normalize()
}

/// Everything that the kernels are given, in double precision.
#[derive(Clone)]
struct Case {
    /// Of bodies, then of nodes.
    control: Vec<Vec<Control>>,
    gates: Vec<Option<Gate>>,
    nodes: Vec<(usize, Node)>,
    rows: Vec<(usize, Vec<usize>, Row)>,
    neighbours: Vec<u32>,
}

const SOFTNESS: f64 = 0.012;

impl Case {
    /// `bodies` of `nodes` nodes each (0: none of them is named by a row), with `rows` Gaussians, and paths of `knots` knots.
    fn new(bodies: usize, nodes: usize, rows: usize, knots: usize) -> Self {
        let path = |seed: u64, shift: f64, angle: f64| -> Vec<Control> {
            (0..knots as u64).map(|k| (vector(9000 * seed + k, shift), turn(7000 * seed + k, angle))).collect()
        };
        let mut control: Vec<Vec<Control>> = (0..bodies as u64).map(|body| path(body + 1, 1.0, 1.0)).collect();
        control.extend((0..(bodies * nodes) as u64).map(|node| path(node + 50, 0.05, 0.3)));
        let gate = |body: usize| (body % 2 == 1).then_some(Gate { times: [0.28, 0.4], softness: SOFTNESS });
        let node = |index: usize| {
            (
                index / nodes.max(1),
                Node { rest: vector(index as u64 + 400, 0.3), log_radius: between(index as u64, -2.5, -1.0) },
            )
        };
        let all: Vec<(usize, Node)> = (0..bodies * nodes).map(node).collect();
        let row = |index: usize| {
            let body = index % bodies.max(1);
            let hangs: Vec<usize> = (0..nodes.min(4)).map(|k| body * nodes + (index / 3 + k) % nodes).collect();
            let seed = index as u64;
            let size = between(seed + 77, 0.5, 2.0);
            let row = Row {
                place: vector(seed + 1000, 0.4),
                turn: size * turn(seed + 5000, 1.0),
                logit: between(seed + 31, -3.0, 4.0),
            };
            (body, hangs, row)
        };
        // Each node has the next two of its body for neighbours.
        let mut neighbours = vec![NO_NODE; all.len() * NEIGHBOURS];
        let mut mark = |node: usize, other: usize, flag: u32| {
            let slots = &mut neighbours[node * NEIGHBOURS..(node + 1) * NEIGHBOURS];
            let known = slots.iter().position(|code| *code != NO_NODE && code / CODES == other as u32);
            let at = known.or_else(|| slots.iter().position(|code| *code == NO_NODE)).expect("room");
            slots[at] = if known.is_some() { slots[at] | flag } else { CODES * other as u32 + flag };
        };
        for node in 0..all.len() {
            // The third body bends.
            let bends = if node / nodes == 2 { LOOSE } else { 0 };
            for step in 1..nodes.min(3) {
                let other = node / nodes * nodes + (node % nodes + step) % nodes;
                mark(node, other, bends | 1);
                mark(other, node, bends | 2);
            }
        }
        Self {
            control,
            gates: (0..bodies).map(gate).collect(),
            nodes: all,
            rows: (0..rows).map(row).collect(),
            neighbours,
        }
    }

    fn knots(&self) -> usize {
        self.control[0].len()
    }

    fn pairs(&self) -> Vec<(usize, usize)> {
        let codes = self.neighbours.iter().enumerate().filter(|(_, code)| **code != NO_NODE && *code & 1 == 1);
        codes.map(|(at, code)| (at / NEIGHBOURS, (code / CODES) as usize)).collect()
    }

    fn poses(&self, t01: f64) -> Vec<Pose> {
        let s = t01 * (self.knots() - 3) as f64;
        let log_presence = |entity: usize| match self.gates.get(entity) {
            Some(Some(gate)) => gate.log_presence(t01 * SECONDS),
            _ => 0.0,
        };
        self.control.iter().enumerate().map(|(entity, control)| twin::pose(control, s, log_presence(entity))).collect()
    }

    fn carried(&self, poses: &[Pose]) -> Vec<Row> {
        let bodies = self.gates.len();
        let one = |(body, hangs, row): &(usize, Vec<usize>, Row)| {
            let nodes: Vec<_> = hangs.iter().map(|&node| (self.nodes[node].1, poses[bodies + node])).collect();
            twin::carried(row, &poses[*body], &nodes)
        };
        self.rows.iter().map(one).collect()
    }

    /// What the gradients of deltas and regularisers are those of.
    fn value(&self, t01: f64, d: &[f32], weights: [f64; 3]) -> f64 {
        let poses = self.poses(t01);
        let carried = self.carried(&poses);
        let terms = carried.iter().zip(d.chunks_exact(CORE)).map(|(row, d)| {
            let d = |k: usize| f64::from(d[k]);
            row.place.dot(DVec3::new(d(0), d(1), d(2)))
                + row.turn.dot(DVec4::new(d(6), d(7), d(8), d(9)))
                + row.logit.max(f64::from(GONE)) * d(10)
        });
        let bodies = self.gates.len();
        let nodes: Vec<_> = self.nodes.iter().zip(&poses[bodies..]).map(|((_, node), pose)| (*node, *pose)).collect();
        terms.sum::<f64>() + self.together(&nodes, weights)
    }

    /// What holds nodes together, and those of the third body less.
    fn together(&self, nodes: &[(Node, Pose)], [rigid, away, alike]: [f64; 3]) -> f64 {
        let bends = |node: usize| self.nodes[node].0 == 2;
        let of = |loose: bool| {
            let times = if loose { f64::from(BodiesOptions::default().loose) } else { 1.0 };
            let pairs: Vec<_> = self.pairs().into_iter().filter(|(node, _)| bends(*node) == loose).collect();
            let own: Vec<_> = (0..nodes.len()).filter(|&node| bends(node) == loose).map(|node| nodes[node]).collect();
            twin::together(nodes, &pairs, [times * rigid, 0.0, alike])
                + twin::together(&own, &[], [0.0, times * away, 0.0])
        };
        of(false) + of(true)
    }

    fn start(&self) -> Start {
        let (bodies, nodes, knots) = (self.gates.len(), self.nodes.len(), self.knots());
        let point = |knot: usize, control: &Vec<Control>| {
            let (shift, turn) = control[knot];
            [shift.x, shift.y, shift.z, 0.0, turn.x, turn.y, turn.z, turn.w].map(|value| value as f32)
        };
        let control = (0..knots).flat_map(|knot| self.control.iter().flat_map(move |control| point(knot, control)));
        let gate = |gate: &Option<Gate>| match gate {
            Some(Gate { times: [begin, end], .. }) => [*begin as f32, *end as f32, 1.0, 0.0],
            None => [0.0; 4],
        };
        let node = |(_, node): &(usize, Node)| {
            [node.rest.x, node.rest.y, node.rest.z, node.log_radius].map(|value| value as f32)
        };
        Start {
            bodies,
            names: (0..bodies).map(|body| body.to_string()).collect(),
            followed: vec![false; bodies],
            bends: (0..bodies).map(|body| (body == 2).then_some(0.5)).collect(),
            nodes,
            node_bodies: self.nodes.iter().map(|(body, _)| *body).collect(),
            knots,
            per_second: (knots - 3) as f64 / SECONDS,
            control: control.collect(),
            other: self.gates.iter().map(gate).chain(self.nodes.iter().map(node)).flatten().collect(),
            neighbours: self.neighbours.clone(),
            gaussians: Default::default(),
        }
    }

    /// Core rows and rows of motion.
    fn device_rows(&self, free: &FreeTimeOptions) -> [Vec<f32>; 2] {
        let core = self.rows.iter().flat_map(|(_, _, row)| {
            let [x, y, z] = row.place.to_array();
            let [w, i, j, k] = row.turn.to_array();
            [x, y, z, 0.0, 0.0, 0.0, w, i, j, k, row.logit, 0.0].map(|value| value as f32)
        });
        let motion = self.rows.iter().flat_map(|(body, hangs, _)| {
            let mut row = vec![0.0_f32; free.floats() + EXTRA_FLOATS];
            row[3] = 1e9;
            row[free.floats()] = (1 + body) as f32;
            row[free.floats() + 1..].iter_mut().zip(hangs).for_each(|(slot, node)| *slot = (1 + node) as f32);
            row
        });
        [core.collect(), motion.collect()]
    }

    /// The same with single precision's numbers.
    fn rounded(mut self) -> Self {
        let single = |value: f64| f64::from(value as f32);
        for (shift, turn) in self.control.iter_mut().flatten() {
            (*shift, *turn) = (shift.map(single), turn.map(single));
        }
        for (_, node) in &mut self.nodes {
            (node.rest, node.log_radius) = (node.rest.map(single), single(node.log_radius));
        }
        for (_, _, row) in &mut self.rows {
            *row = Row { place: row.place.map(single), turn: row.turn.map(single), logit: single(row.logit) };
        }
        self
    }
}

/// What the kernels make of a case: deltas, gradients of the core, of control points, of gates and nodes, and of a clock.
fn run(
    gpu: &Gpu,
    case: &Case,
    options: &BodiesOptions,
    d: &[f32],
    t01: f32,
    supervision: Supervision,
) -> [Vec<f32>; 5] {
    let free = FreeTimeOptions { knots: 2, ..FreeTimeOptions::default() };
    let count = case.rows.len();
    let [core, motion] = case.device_rows(&free);
    let mut bodies = Bodies::new(gpu, &case.start(), options, &free, [SECONDS, INTERVALS], EXTENT).expect("room");
    bodies.hang(gpu, &motion).expect("room");
    let core = gpu.storage_from("core", &core).expect("a buffer");
    let floats = free.floats() + EXTRA_FLOATS;
    let values = gpu.storage_from("rows", &motion).expect("a buffer");
    let [d_core, gradients] =
        [CORE, floats].map(|stride| gpu.storage("gradients", (count * stride * 4) as u64).expect("a buffer"));
    let rows = MotionRows { core: &core, count: count as u32, values: &values, gradients: &gradients };
    let mut tape = Tape::new(gpu).expect("a tape");
    bodies.forward(gpu, rows, f64::from(t01).into(), &mut tape).expect("deltas");
    let d_deltas = Deltas::new(gpu, "gradients of the deltas", count as u32, None).expect("buffers");
    gpu.upload(&d_deltas.core, 0, d);
    bodies.backward(gpu, rows, &tape, &d_deltas, &d_core, supervision).expect("gradients");
    let sums = gpu.storage("clocks", 16).expect("a buffer");
    bodies.clock(gpu, rows, &tape, &d_deltas, ClockRow { sums: &sums, row: 1 });
    let read = |buffer, floats: usize| gpu.download::<f32>(buffer, floats).expect("read back");
    let [control, other] = bodies.gradients(gpu).expect("read back");
    assert!(
        read(&gradients, count * floats).iter().all(|gradient| *gradient == 0.0),
        "rows of bodies have no path of their own"
    );
    [read(&tape.deltas.core, count * CORE), read(&d_core, count * CORE), control, other, read(&sums, 4)]
}

fn gradients(rows: usize) -> Vec<f32> {
    let wanted = |k: usize| matches!(k, 0..3 | 6..11);
    (0..rows * CORE)
        .map(|i| if wanted(i % CORE) { between(7_000_000 + i as u64, -1.0, 1.0) as f32 } else { 0.0 })
        .collect()
}

/// The derivative of the value by a number of the case.
fn slope(case: &Case, t01: f64, d: &[f32], weights: [f64; 3], change: impl Fn(&mut Case, f64)) -> f64 {
    const STEP: f64 = 1e-5;
    let [after, before] = [STEP, -STEP].map(|step| {
        let mut changed = case.clone();
        change(&mut changed, step);
        changed.value(t01, d, weights)
    });
    (after - before) / (2.0 * STEP)
}

fn assert_close(what: impl std::fmt::Display, got: f32, want: f64, scale: f64) {
    assert!((f64::from(got) - want).abs() <= 1e-4 * (want.abs() + scale), "{what}: {got} instead of {want}");
}

fn unit(axis: usize) -> DVec4 {
    let mut unit = DVec4::ZERO;
    unit[axis] = 1.0;
    unit
}

fn follows_the_twin(case: &Case, gpus: &[Gpu], t01: f64) {
    let t01 = f64::from(t01 as f32);
    let d = gradients(case.rows.len());
    let options = BodiesOptions { rigid: 3.0, away: 2.0, alike: 0.7, ..BodiesOptions::default() };
    let (bodies, nodes) = (case.gates.len(), case.nodes.len());
    let each = 1.0 / nodes.max(1) as f64;
    let squared = each / f64::from(EXTENT * EXTENT);
    let weights = [3.0 * squared, 2.0 * squared, 0.7 * each];
    let carried = case.carried(&case.poses(t01));
    let first = (t01 * (case.knots() - 3) as f64).floor() as usize;
    for gpu in gpus {
        let [deltas, d_core, control, other, clock] = run(gpu, case, &options, &d, t01 as f32, Supervision::Frame(1.0));
        for (index, ((_, _, row), carried)) in case.rows.iter().zip(&carried).enumerate() {
            let at = &deltas[index * CORE..(index + 1) * CORE];
            for (moved, way) in at.iter().zip((carried.place - row.place).to_array()) {
                assert_close("place", *moved, way, 1.0);
            }
            for axis in 0..4 {
                assert_close("turn", at[6 + axis], carried.turn[axis] - row.turn[axis], 1.0);
            }
            assert_close("logit", at[10], (carried.logit - row.logit).max(f64::from(GONE)), 1.0);
            assert_eq!([at[3], at[4], at[5], at[11]], [0.0; 4]);
        }
        for index in (0..case.rows.len()).step_by(case.rows.len() / 12 + 1) {
            let at = &d_core[index * CORE..(index + 1) * CORE];
            let d = |k: usize| f64::from(d[index * CORE + k]);
            for (axis, found) in at.iter().enumerate().take(3) {
                let want = slope(case, t01, &gradients(case.rows.len()), weights, |case, step| {
                    case.rows[index].2.place[axis] += step
                });
                assert_close("d place", *found, want - d(axis), 1.0);
            }
            for axis in 0..4 {
                let want = slope(case, t01, &gradients(case.rows.len()), weights, |case, step| {
                    case.rows[index].2.turn[axis] += step
                });
                assert_close("d turn", at[6 + axis], want - d(6 + axis), 1.0);
            }
            let want =
                slope(case, t01, &gradients(case.rows.len()), weights, |case, step| case.rows[index].2.logit += step);
            assert_close("d logit", at[10], want - d(10), 1.0);
        }
        let count = bodies + nodes;
        let some = (0..bodies).chain((bodies..count).step_by(nodes / 5 + 1));
        for entity in some {
            let scale = if entity < bodies { case.rows.len() as f64 } else { 30.0 };
            for knot in [first, first + 3] {
                let at = &control[8 * (knot * count + entity)..][..8];
                for (axis, found) in at.iter().enumerate().take(3) {
                    let want = slope(case, t01, &d, weights, |case, step| case.control[entity][knot].0[axis] += step);
                    assert_close(format_args!("d shift of {entity} at {knot}"), *found, want, scale);
                }
                for axis in 0..4 {
                    let want =
                        slope(case, t01, &d, weights, |case, step| case.control[entity][knot].1 += step * unit(axis));
                    assert_close(format_args!("d turn of {entity} at {knot}"), at[4 + axis], want, scale);
                }
            }
            if let Some(Some(_)) = case.gates.get(entity) {
                for end in 0..2 {
                    let want = slope(case, t01, &d, weights, |case, step| {
                        if let Some(gate) = &mut case.gates[entity] {
                            gate.times[end] += 0.01 * step;
                        }
                    });
                    assert_close("d gate", other[4 * entity + end], 100.0 * want, 100.0 * scale);
                }
            } else if entity >= bodies {
                let want = slope(case, t01, &d, weights, |case, step| case.nodes[entity - bodies].1.log_radius += step);
                assert_close("d reach", other[4 * entity + 3], want, scale);
            }
        }
        // A later time: paths alone, since gates are not shifted by a camera's clock.
        let ungated = Case { gates: case.poses(t01)[..bodies].iter().map(|_| None).collect(), ..case.clone() };
        let by_time = |case: &Case| {
            let step = 1e-6;
            let value = |t: f64| case.value(t, &d, [0.0; 3]);
            (value(t01 + step) - value(t01 - step)) / (2.0 * step) / INTERVALS
        };
        let [_, _, _, _, clock_alone] = run(
            gpu,
            &ungated,
            &BodiesOptions { rigid: 0.0, away: 0.0, alike: 0.0, ..options.clone() },
            &d,
            t01 as f32,
            Supervision::Events,
        );
        assert_close("clock", clock_alone[2], by_time(&ungated), 10.0 * case.rows.len() as f64);
        assert_eq!([clock[0], clock[1], clock[3]], [0.0, 0.0, 1.0]);
    }
}

#[test]
fn both_shapes_follow_the_double_precision_twin() {
    let gpus = [Shape::Cpu, Shape::Gpu].map(open);
    follows_the_twin(&Case::new(3, 6, 300, 9).rounded(), &gpus, 0.57);
}

#[test]
fn extremes_are_followed_too() {
    let gpus = [Shape::Cpu, Shape::Gpu].map(open);
    // One stretch, one node a body, at the beginning; a body without nodes; nodes that nothing hangs on, at the end.
    follows_the_twin(&Case::new(2, 1, 40, 4).rounded(), &gpus, 0.02);
    follows_the_twin(&Case::new(2, 0, 40, 5).rounded(), &gpus, 0.3);
    let mut idle = Case::new(2, 7, 30, 6).rounded();
    idle.rows.iter_mut().for_each(|(_, hangs, _)| hangs.retain(|node| node % 7 < 3));
    follows_the_twin(&idle, &gpus, 0.99);
}

#[test]
fn what_is_free_beside_bodies_is_shown_at_a_time_of_its_own() {
    const FREE: usize = 20;
    let (case, free) = (Case::new(2, 5, 60, 7), FreeTimeOptions { knots: 2, ..FreeTimeOptions::default() });
    let d = gradients(60);
    for gpu in [Shape::Cpu, Shape::Gpu].map(open) {
        let [core, mut motion] = case.device_rows(&free);
        let floats = free.floats() + EXTRA_FLOATS;
        for row in motion.chunks_exact_mut(floats).take(FREE) {
            // In view about the middle, on its way.
            let way = [1.0, 2.0, 3.0, 0.5 * INTERVALS as f32, 0.1, 0.2, 0.3, 2.0];
            row[..way.len()].copy_from_slice(&way);
            row[free.floats()..].fill(0.0);
        }
        let options = BodiesOptions::default();
        let mut bodies = Bodies::new(&gpu, &case.start(), &options, &free, [SECONDS, INTERVALS], EXTENT).expect("room");
        bodies.hang(&gpu, &motion).expect("room");
        let [core, values] = [core, motion].map(|rows| gpu.storage_from("rows", &rows).expect("a buffer"));
        let mut pass = |time: Shown| -> [Vec<f32>; 3] {
            let [d_core, gradients] =
                [CORE, floats].map(|stride| gpu.storage("gradients", (60 * stride * 4) as u64).expect("a buffer"));
            let rows = MotionRows { core: &core, count: 60, values: &values, gradients: &gradients };
            let mut tape = Tape::new(&gpu).expect("a tape");
            bodies.clear_gradients(&gpu);
            bodies.forward(&gpu, rows, time, &mut tape).expect("deltas");
            let d_deltas = Deltas::new(&gpu, "gradients of the deltas", 60, None).expect("buffers");
            gpu.upload(&d_deltas.core, 0, &d);
            bodies.backward(&gpu, rows, &tape, &d_deltas, &d_core, Supervision::Events).expect("gradients");
            let read = |buffer, floats: usize| gpu.download::<f32>(buffer, 60 * floats).expect("read back");
            let [control, _] = bodies.gradients(&gpu).expect("read back");
            [read(&tape.deltas.core, CORE), read(&d_core, CORE), control]
        };
        let (early, late) = (0.4, 0.55);
        let [both, of_bodies, of_free] =
            [Shown { t01: early, free_t01: late }, early.into(), late.into()].map(&mut pass);
        assert_ne!(of_bodies, of_free);
        for of in 0..2 {
            assert_eq!(both[of][..FREE * CORE], of_free[of][..FREE * CORE]);
            assert_eq!(both[of][FREE * CORE..], of_bodies[of][FREE * CORE..]);
        }
        assert_ne!(of_bodies[0][..FREE * CORE], of_free[0][..FREE * CORE]);
        assert_eq!(both[2], of_bodies[2]);
    }
}

#[test]
fn events_and_shares_of_frames_say_as_much_as_they_should() {
    let gpu = open(Shape::Cpu);
    let case = Case::new(2, 5, 60, 7);
    let (d, options) = (gradients(60), BodiesOptions::default());
    let [_, _, of_frame, gates, _] = run(&gpu, &case, &options, &d, 0.5, Supervision::Frame(1.0));
    let [_, _, of_events, unmoved, _] = run(&gpu, &case, &options, &d, 0.5, Supervision::Events);
    assert_ne!(of_frame, of_events, "what holds nodes together is told with frames alone");
    assert!(gates[4].abs() + gates[5].abs() > 0.0 && unmoved[4] == 0.0 && unmoved[5] == 0.0, "motion explains events");
}
