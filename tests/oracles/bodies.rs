use erfgs_splat::{
    field::{Outputs, Tape},
    gpu::Gpu,
    motion::{
        Bodies, BodiesOptions, ClockRow, FreeTimeOptions, Motion, MotionRows, Supervision,
        bodies::{CODES, EXTRA_FLOATS, NEIGHBOURS, NEVER, NO_NODE, SOFTNESS, Start},
    },
    raster::Deltas,
};
use serde_json::{Value, json};

use crate::oracles::{Numbers, ask, assert_close, gpus, numbers, wide};

const CORE: usize = 12;
const ROWS: usize = 37;
const SECONDS: f64 = 0.6;
const INTERVALS: f64 = 9.0;
const EXTENT: f32 = 2.5;

/// What the kernels and the oracle are asked about: bodies with as many nodes each, of which each has the next for a neighbour.
struct Case {
    name: &'static str,
    t01: f32,
    start: Start,
    /// Place, turn (of any length), logit.
    rows: Vec<[f32; 8]>,
    body: Vec<usize>,
    /// -1: none.
    hangs: Vec<[i32; 4]>,
    pairs: Vec<[usize; 2]>,
    d_rows: Vec<[f32; 8]>,
}

/// Rows hang on up to `hung` nodes.
fn case(name: &'static str, seed: u64, t01: f32, [bodies, each, knots]: [usize; 3], hung: usize) -> Case {
    let mut random = Numbers(seed << 32);
    let mut list =
        |size: f64, count: usize| -> Vec<f32> { (0..count).map(|_| random.between(-size, size) as f32).collect() };
    let nodes = bodies * each;
    let mut control = Vec::new();
    for index in 0..knots * (bodies + nodes) {
        // Nodes go less far than bodies do.
        let size = if index % (bodies + nodes) < bodies { 1.0 } else { 0.1 };
        control.extend(list(size, 3));
        control.extend([0.0, 1.0]);
        control.extend(list(size, 3));
    }
    let mut other = Vec::new();
    for body in 0..bodies {
        // Each second body appears and vanishes about the moment, so that some of it is there.
        let [begin, end] = [f64::from(t01) * SECONDS - 0.01, f64::from(t01) * SECONDS + 0.02].map(|at| at as f32);
        other.extend([begin, end, (body % 2) as f32, 0.0]);
    }
    for _ in 0..nodes {
        other.extend(list(0.3, 3));
        other.push(-1.8 + list(0.7, 1)[0]);
    }
    let mut neighbours = vec![NO_NODE; nodes * NEIGHBOURS];
    let mut pairs = Vec::new();
    for node in 0..nodes {
        let next = node / each * each + (node % each + 1) % each;
        if next != node {
            pairs.push([node, next]);
        }
    }
    for node in 0..nodes {
        let codes = &mut neighbours[node * NEIGHBOURS..];
        let mut filled = 0;
        for other in 0..nodes {
            let flags = u32::from(pairs.contains(&[node, other])) + 2 * u32::from(pairs.contains(&[other, node]));
            if flags > 0 {
                codes[filled] = CODES * other as u32 + flags;
                filled += 1;
            }
        }
    }
    let row = |numbers: Vec<f32>| <[f32; 8]>::try_from(numbers).expect("eight");
    let rows = (0..ROWS).map(|_| [list(0.4, 3), vec![0.9], list(0.8, 3), list(3.0, 1)].concat()).map(row).collect();
    let body = (0..ROWS).map(|row| row % bodies).collect();
    let hang = |row: usize| {
        std::array::from_fn(|slot| {
            if slot < each.min(hung) { (row % bodies * each + (row / 3 + slot) % each) as i32 } else { -1 }
        })
    };
    let d_rows = (0..ROWS).map(|_| row(list(1.0, 8))).collect();
    let start = Start {
        bodies,
        names: vec![String::new(); bodies],
        followed: vec![false; bodies],
        bends: vec![None; bodies],
        nodes,
        node_bodies: (0..nodes).map(|node| node / each).collect(),
        knots,
        per_second: (knots - 3) as f64 / SECONDS,
        control,
        other,
        neighbours,
        gaussians: Default::default(),
    };
    Case { name, t01, start, rows, body, hangs: (0..ROWS).map(hang).collect(), pairs, d_rows }
}

fn options() -> BodiesOptions {
    BodiesOptions { rigid: 3.0, away: 2.0, alike: 0.7, ..BodiesOptions::default() }
}

impl Case {
    fn stretches(&self) -> f64 {
        (self.start.knots - 3) as f64
    }

    fn question(&self) -> Value {
        let Start { bodies, nodes, knots, control, other, .. } = &self.start;
        let points: Vec<[&[f32]; 2]> = control.chunks_exact(8).map(|point| [&point[..3], &point[4..]]).collect();
        let control: Vec<Vec<Vec<f32>>> =
            points.chunks(points.len() / knots).map(|knot| knot.iter().map(|point| point.concat()).collect()).collect();
        let (gates, rests): (Vec<&[f32]>, Vec<&[f32]>) = {
            let all: Vec<&[f32]> = other.chunks_exact(4).collect();
            (all[..*bodies].to_vec(), all[*bodies..].to_vec())
        };
        let column = |rows: &[&[f32]], at: usize| -> Vec<f32> { rows.iter().map(|row| row[at]).collect() };
        let each = 1.0 / (*nodes).max(1) as f64;
        let squared = each / f64::from(EXTENT * EXTENT);
        let BodiesOptions { rigid, away, alike, .. } = options();
        let [rigid, away, alike] = [rigid, away, alike].map(f64::from);
        json!({
            "oracle": "bodies",
            "stretch": f64::from(self.t01) * self.stretches(),
            "seconds": f64::from(self.t01) * SECONDS,
            "softness": SOFTNESS,
            "weights": [rigid * squared, away * squared, alike * each],
            "rows": self.rows,
            "control": control,
            "gates": gates.iter().map(|gate| &gate[..2]).collect::<Vec<_>>(),
            "gated": column(&gates, 2),
            "rests": rests.iter().map(|node| &node[..3]).collect::<Vec<_>>(),
            "reaches": column(&rests, 3),
            "body": self.body,
            "hangs": self.hangs,
            "pairs": self.pairs,
            "d_rows": self.d_rows,
        })
    }

    /// Core rows with these numbers of a row.
    fn cores(rows: &[[f32; 8]]) -> Vec<f32> {
        rows.iter()
            .flat_map(|[x, y, z, w, i, j, k, logit]| [*x, *y, *z, 0.0, 0.0, 0.0, *w, *i, *j, *k, *logit, 0.0])
            .collect()
    }
}

/// The numbers of a row of a [`Case`] in a core row.
const COLUMNS: [usize; 8] = [0, 1, 2, 6, 7, 8, 9, 10];

fn columns(cores: &[f64]) -> Vec<f64> {
    cores.chunks_exact(CORE).flat_map(|row| COLUMNS.map(|at| row[at])).collect()
}

fn check(gpu: &Gpu, case: &Case, answer: &Value) {
    let what = |name: &str| format!("{}: {:?} kernels: {name}", case.name, gpu.shape);
    let free = FreeTimeOptions::default();
    let floats = free.floats() + EXTRA_FLOATS;
    let mut motion_rows = Vec::new();
    for (body, hangs) in case.body.iter().zip(&case.hangs) {
        let mut row = vec![0.0_f32; floats];
        row[3] = NEVER;
        row[free.floats()] = (1 + body) as f32;
        row[free.floats() + 1..].iter_mut().zip(hangs).for_each(|(to, node)| *to = (1 + node) as f32);
        motion_rows.extend(row);
    }
    let mut bodies =
        Bodies::new(gpu, &case.start, &options(), &free, [SECONDS, INTERVALS], EXTENT).expect("room for bodies");
    bodies.hang(gpu, &motion_rows).expect("room for rows");
    let mut motion = Motion::Bodies(Box::new(bodies));
    let core = gpu.storage_from("core", &Case::cores(&case.rows)).expect("a buffer");
    let values = gpu.storage_from("rows", &motion_rows).expect("a buffer");
    let [d_core, gradients] =
        [CORE, floats].map(|floats| gpu.storage("d", (ROWS * floats * 4) as u64).expect("a buffer"));
    let rows = MotionRows { core: &core, count: ROWS as u32, values: &values, gradients: &gradients };
    let mut tape = Tape::new(gpu).expect("a tape");
    motion.forward(gpu, rows, case.t01, &mut tape, Outputs::All).expect("deltas");
    let read = |buffer, floats: usize| wide(&gpu.download::<f32>(buffer, floats).expect("read back"));
    // The changed parameters: stored and change.
    let stored = columns(&wide(&Case::cores(&case.rows)));
    let carried: Vec<f64> = columns(&read(&tape.deltas.core, ROWS * CORE))
        .iter()
        .zip(&stored)
        .map(|(delta, stored)| delta + stored)
        .collect();
    assert_close(&what("carried"), &carried, &numbers(answer, "carried"), 1e-5);

    let d_deltas = Deltas::new(gpu, "d deltas", ROWS as u32, None).expect("buffers");
    let d_cores = Case::cores(&case.d_rows);
    gpu.upload(&d_deltas.core, 0, &d_cores);
    motion.backward(gpu, rows, &tape, &d_deltas, &d_core, Supervision::Frame(1.0)).expect("gradients");
    // The rasteriser has the gradient of the changed parameter in that of the stored one already.
    let d_rows: Vec<f64> = columns(&read(&d_core, ROWS * CORE))
        .iter()
        .zip(columns(&wide(&d_cores)))
        .map(|(added, before)| added + before)
        .collect();
    assert_close(&what("d rows"), &d_rows, &numbers(answer, "d_rows"), 1e-4);
    let Some(bodies) = motion.bodies() else { unreachable!("bodies") };
    let [control, other] = bodies.gradients(gpu).expect("read back").map(|values| wide(&values));
    let seven: Vec<f64> = control.chunks_exact(8).flat_map(|point| [&point[..3], &point[4..]].concat()).collect();
    assert_close(&what("d control"), &seven, &numbers(answer, "d_control"), 1e-4);
    let (gates, nodes) = other.split_at(4 * case.start.bodies);
    let gates: Vec<f64> = gates.chunks_exact(4).flat_map(|gate| gate[..2].to_vec()).collect();
    assert_close(&what("d gates"), &gates, &numbers(answer, "d_gates"), 1e-4);
    let reaches: Vec<f64> = nodes.chunks_exact(4).map(|node| node[3]).collect();
    assert_close(&what("d reaches"), &reaches, &numbers(answer, "d_reaches"), 1e-4);

    // What rows say of a camera's clock: what holds nodes together says nothing of it.
    let clock = gpu.storage("clock", 4 * ClockRow::FLOATS as u64).expect("a buffer");
    motion.clock(gpu, rows, &tape, &d_deltas, ClockRow { sums: &clock, row: 0 });
    let late = read(&clock, ClockRow::FLOATS)[0];
    let wanted = numbers(answer, "d_stretch")[0] * case.stretches() / INTERVALS;
    // A sum of all rows, in which some cancel.
    assert!(
        (late - wanted).abs() <= 1e-4 * (wanted.abs() + ROWS as f64),
        "{}: {late} instead of {wanted}",
        what("clock")
    );
}

#[test]
fn bodies_carry_as_the_oracle_does() {
    let cases = [
        case("three bodies of five nodes", 11, 0.57, [3, 5, 9], 4),
        case("one stretch, at the start", 12, 0.0, [2, 3, 4], 4),
        case("rigid, with nodes that nothing hangs on, at the end", 13, 1.0, [2, 3, 6], 0),
        case("one node", 14, 0.3, [2, 1, 7], 4),
    ];
    let answers = ask(&cases.iter().map(Case::question).collect::<Vec<_>>());
    let gpus = gpus();
    for (case, answer) in cases.iter().zip(&answers) {
        for gpu in &gpus {
            check(gpu, case, answer);
        }
    }
}
