use erfgs_splat::{
    field::{Outputs, Tape},
    gpu::Gpu,
    motion::{FreeTime, FreeTimeOptions, Motion, MotionRows, Supervision},
    raster::Deltas,
};
use serde_json::{Value, json};

use crate::oracles::{Numbers, ask, assert_close, gpus, numbers, wide};

const CORE: usize = 12;
const ROWS: usize = 41;
const INTERVALS: f32 = 7.5;
const EXTENT: f32 = 3.0;

struct Case {
    name: &'static str,
    t01: f32,
    options: FreeTimeOptions,
    logits: Vec<f32>,
    rows: Vec<f32>,
    d_deltas: Vec<f32>,
}

fn case(name: &'static str, seed: u64, t01: f32, least_life: f32, knots: u32) -> Case {
    let mut random = Numbers(seed << 32);
    let options = FreeTimeOptions {
        least_life,
        knots,
        spacing: 0.75,
        weight_presence: 0.4,
        weight_acceleration: 0.6,
        ..FreeTimeOptions::default()
    };
    let mut rows = Vec::new();
    for _ in 0..ROWS {
        let mut row = vec![0.0; options.floats()];
        for vector in row.chunks_exact_mut(4) {
            vector[..3].fill_with(|| random.between(-0.4, 0.4) as f32);
        }
        // Near enough to the moment that all of them are there.
        row[3] = t01 * INTERVALS + random.between(-3.0, 3.0) as f32;
        row[7] = random.between(-0.5, 1.5) as f32;
        rows.extend(row);
    }
    let logits = (0..ROWS).map(|_| random.between(-4.0, 4.0) as f32).collect();
    let mut d_deltas = vec![0.0; ROWS * CORE];
    for row in d_deltas.chunks_exact_mut(CORE) {
        for at in [0, 1, 2, 10] {
            row[at] = random.between(-1.0, 1.0) as f32;
        }
    }
    Case { name, t01, options, logits, rows, d_deltas }
}

impl Case {
    fn question(&self) -> Value {
        let columns = |from: usize, to: usize| -> Vec<&[f32]> {
            self.d_deltas.chunks_exact(CORE).map(|row| &row[from..to]).collect()
        };
        json!({
            "oracle": "motion",
            "time": self.t01 * INTERVALS,
            "least": self.options.least_life,
            "knots": self.options.knots,
            "spacing": self.options.spacing,
            "weight_presence": self.options.weight_presence,
            "weight_acceleration": self.options.weight_acceleration / (EXTENT * EXTENT),
            "logits": self.logits,
            "rows": self.rows.chunks_exact(self.options.floats()).collect::<Vec<_>>(),
            "d_moved": columns(0, 3),
            "d_changed": columns(10, 11).concat(),
        })
    }
}

fn check(gpu: &Gpu, case: &Case, answer: &Value) {
    let what = |name: &str| format!("{}: {:?} kernels: {name}", case.name, gpu.shape);
    let mut core = vec![0.0_f32; ROWS * CORE];
    core.chunks_exact_mut(CORE).zip(&case.logits).for_each(|(row, logit)| row[10] = *logit);
    let core = gpu.storage_from("core", &core).expect("a buffer");
    let values = gpu.storage_from("rows", &case.rows).expect("a buffer");
    let floats = case.options.floats();
    let [d_core, gradients] =
        [CORE, floats].map(|floats| gpu.storage("d", (ROWS * floats * 4) as u64).expect("a buffer"));
    let rows = MotionRows { core: &core, count: ROWS as u32, values: &values, gradients: &gradients };
    let mut motion = Motion::FreeTime(Box::new(FreeTime::new(gpu, &case.options, INTERVALS, EXTENT).expect("room")));
    let mut tape = Tape::new(gpu).expect("a tape");
    motion.forward(gpu, rows, case.t01, &mut tape, Outputs::All).expect("deltas");
    let read = |buffer, floats: usize| wide(&gpu.download::<f32>(buffer, ROWS * floats).expect("read back"));
    let columns = |rows: &[f64], stride: usize, from: usize, to: usize| -> Vec<f64> {
        rows.chunks_exact(stride).flat_map(|row| row[from..to].to_vec()).collect()
    };
    let deltas = read(&tape.deltas.core, CORE);
    assert_close(&what("moved"), &columns(&deltas, CORE, 0, 3), &numbers(answer, "moved"), 1e-5);
    let opacities: Vec<f64> = std::iter::zip(columns(&deltas, CORE, 10, 11), &case.logits)
        .map(|(change, logit)| 1.0 / (1.0 + (-f64::from(*logit) - change).exp()))
        .collect();
    assert_close(&what("opacity"), &opacities, &numbers(answer, "opacity"), 1e-5);

    let d_deltas = Deltas::new(gpu, "d deltas", ROWS as u32, None).expect("buffers");
    gpu.upload(&d_deltas.core, 0, &case.d_deltas);
    motion.backward(gpu, rows, &tape, &d_deltas, &d_core, Supervision::Frame(1.0)).expect("gradients");
    // The rasteriser has the gradient of the changed logit in that of the stored one already.
    let d_changed = wide(&case.d_deltas);
    let d_logits: Vec<f64> =
        std::iter::zip(columns(&read(&d_core, CORE), CORE, 10, 11), columns(&d_changed, CORE, 10, 11))
            .map(|(added, before)| added + before)
            .collect();
    assert_close(&what("d logits"), &d_logits, &numbers(answer, "d_logits"), 1e-4);
    let (got, want) = (read(&gradients, floats), numbers(answer, "d_rows"));
    // The vectors of a path, instants and lives have scales of their own.
    let paths = (0..floats / 4).map(|vector| ("path", 4 * vector, 4 * vector + 3));
    for (name, from, to) in paths.chain([("instant", 3, 4), ("life", 7, 8)]) {
        let (got, want) = (columns(&got, floats, from, to), columns(&want, floats, from, to));
        assert_close(&what(&format!("d {name} {from}")), &got, &want, 1e-4);
    }
}

#[test]
fn deltas_and_gradients_are_the_oracles() {
    let cases = [
        case("in the middle", 1, 0.5, 1.0, 0),
        case("at the start", 2, 0.0, 0.25, 0),
        case("at the end", 3, 1.0, 2.0, 0),
        case("knots, in the middle", 4, 0.5, 1.0, 2),
        case("knots, at the end", 5, 1.0, 0.5, 4),
    ];
    let answers = ask(&cases.iter().map(Case::question).collect::<Vec<_>>());
    let gpus = gpus();
    for (case, answer) in cases.iter().zip(&answers) {
        for gpu in &gpus {
            check(gpu, case, answer);
        }
    }
}
