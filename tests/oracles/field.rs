use std::collections::BTreeMap;

use erfgs_splat::{
    field::{Field, FieldConfig, HeadInit, Heads, Layout, Outputs, PlaneWeights, SpatialSmoothness, Tape, TimeAxis},
    gpu::Gpu,
    optimiser::AdamConfig,
    raster::Deltas,
    reference::field::{FieldTwin, TwinDeltas},
};
use serde_json::{Value, json};

use crate::oracles::{Numbers, ask, assert_close, gpus, numbers, wide};

const CORE: usize = 12;
const BOX: [[f32; 3]; 2] = [[-1.0, -0.5, 0.2], [1.5, 0.75, 2.0]];
const WEIGHTS: PlaneWeights =
    PlaneWeights { space: 0.3, time: 0.2, time_l1: 0.1, form: SpatialSmoothness::SecondDifference };

struct Case {
    name: &'static str,
    config: FieldConfig,
    t01: f32,
    means: Vec<[f32; 3]>,
    parameters: Vec<f32>,
    d_core: Vec<f32>,
    d_sh: Vec<f32>,
}

fn case(name: &'static str, seed: u64, config: FieldConfig, t01: f32) -> Case {
    let mut random = Numbers(seed << 32);
    let layout = Layout::new(&config).expect("a field");
    let rows = 23;
    // A few means lie outside the box, where they are clamped to it.
    let mean = |random: &mut Numbers| -> [f32; 3] {
        std::array::from_fn(|axis| {
            let along = random.between(-0.15, 1.15) as f32;
            BOX[0][axis] + along * (BOX[1][axis] - BOX[0][axis])
        })
    };
    let means = (0..rows).map(|_| mean(&mut random)).collect();
    // Planes near 1, so that the product of six is not lost; weights of both signs.
    let parameters = (0..layout.total)
        .map(|at| if at < layout.grid { random.between(0.6, 1.4) } else { random.between(-0.5, 0.5) } as f32)
        .collect();
    let mut gradient = |stride: usize| (0..rows * stride).map(|_| random.between(-1.0, 1.0) as f32).collect();
    let (d_core, d_sh) = (gradient(CORE), gradient(config.sh_stride as usize));
    Case { name, config, t01, means, parameters, d_core, d_sh }
}

fn cases() -> Vec<Case> {
    let config = FieldConfig {
        levels: vec![1, 2],
        features: 8,
        spatial_resolution: [5, 4, 6],
        time_resolution: 7,
        width: 16,
        depth: 2,
        heads: Heads::default(),
        sh_stride: 12,
        time_axis: TimeAxis::UpperHalf,
        head_init: HeadInit::Xavier,
    };
    let few = Heads { scale: false, opacity: false, sh: false, ..Heads::default() };
    vec![
        case("all heads, as 4DGS", 1, config.clone(), 0.37),
        case("the last instant", 2, config.clone(), 1.0),
        case(
            "few heads, one layer, all of the time axis",
            3,
            FieldConfig { depth: 0, heads: few, time_axis: TimeAxis::Full, levels: vec![2], ..config },
            0.61,
        ),
    ]
}

/// The parameters by name, with their shapes.
fn shapes(layout: &Layout) -> BTreeMap<String, (Vec<usize>, usize)> {
    let features = layout.config.features as usize;
    let mut shapes: BTreeMap<_, _> = layout
        .planes
        .iter()
        .map(|plane| (plane.name(), (vec![plane.rows, plane.cols, features], plane.offset)))
        .collect();
    let heads = layout.heads.iter().flat_map(|head| [&head.hidden, &head.out]);
    for linear in layout.trunk.iter().chain(heads) {
        shapes.insert(format!("{}.weight", linear.name), (vec![linear.outputs, linear.inputs], linear.weight));
        shapes.insert(format!("{}.bias", linear.name), (vec![linear.outputs], linear.bias));
    }
    shapes
}

impl Case {
    fn layout(&self) -> Layout {
        Layout::new(&self.config).expect("a field")
    }

    fn question(&self) -> Value {
        let layout = self.layout();
        let parameters: BTreeMap<String, Value> = shapes(&layout)
            .into_iter()
            .map(|(name, (shape, at))| {
                let values = &self.parameters[at..][..shape.iter().product()];
                (name, json!({ "shape": shape, "values": values }))
            })
            .collect();
        let on = self.config.heads;
        let heads: Vec<&str> = [
            (on.position, "position"),
            (on.scale, "scale"),
            (on.rotation, "rotation"),
            (on.opacity, "opacity"),
            (on.sh, "sh"),
        ]
        .into_iter()
        .filter_map(|(on, name)| on.then_some(name))
        .collect();
        let rows = |values: &[f32], stride: usize| values.chunks_exact(stride).map(<[f32]>::to_vec).collect::<Vec<_>>();
        json!({
            "oracle": "field",
            "levels": self.config.levels.len(),
            "depth": self.config.depth,
            "heads": heads,
            "sh_stride": self.config.sh_stride,
            "upper_half": self.config.time_axis == TimeAxis::UpperHalf,
            "aabb": BOX,
            "t01": self.t01,
            "means": self.means,
            "parameters": parameters,
            "d_core": rows(&self.d_core, CORE),
            "d_sh": rows(&self.d_sh, self.config.sh_stride as usize),
            "plane_weights": [WEIGHTS.space, WEIGHTS.time, WEIGHTS.time_l1],
        })
    }

    /// An answer's gradient of the parameters in the order of the layout.
    fn flat(&self, answer: &Value, name: &str) -> Vec<f64> {
        let layout = self.layout();
        let mut flat = vec![0.0; layout.total];
        for (parameter, (shape, at)) in shapes(&layout) {
            flat[at..][..shape.iter().product()].copy_from_slice(&numbers(&answer[name], &parameter));
        }
        flat
    }
}

fn compare_parameters(case: &Case, who: &str, got: &[f64], want: &[f64], tolerance: f64) {
    // Planes and network have scales of their own.
    for (name, (shape, at)) in shapes(&case.layout()) {
        let range = at..at + shape.iter().product::<usize>();
        assert_close(&format!("{}: {who}: d {name}", case.name), &got[range.clone()], &want[range], tolerance);
    }
}

fn check_twin(case: &Case, answer: &Value) {
    let aabb = BOX.map(|corner| corner.map(f64::from));
    let twin = FieldTwin::new(&case.config, aabb, wide(&case.parameters)).expect("a twin");
    let means: Vec<[f64; 3]> = case.means.iter().map(|mean| mean.map(f64::from)).collect();
    let t01 = f64::from(case.t01);
    let deltas = twin.forward(&means, t01, Outputs::All);
    let what = |name: &str| format!("{}: twin: {name}", case.name);
    assert_close(&what("core"), &deltas.core, &numbers(answer, "core"), 1e-9);
    assert_close(&what("sh"), &deltas.sh, &numbers(answer, "sh"), 1e-9);
    let d_deltas = TwinDeltas { core: wide(&case.d_core), sh: wide(&case.d_sh) };
    let gradients = twin.backward(&means, t01, Outputs::All, &d_deltas);
    let d_means: Vec<f64> = gradients.means.concat();
    assert_close(&what("d_means"), &d_means, &numbers(answer, "d_means"), 1e-8);
    compare_parameters(case, "twin", &gradients.parameters, &case.flat(answer, "d_parameters"), 1e-8);
    let (losses, d_planes) = twin.regularise(&WEIGHTS);
    let losses = [losses.space, losses.time, losses.time_l1];
    assert_close(&what("plane losses"), &losses, &numbers(answer, "plane_losses"), 1e-9);
    compare_parameters(case, "twin's regularisers", &d_planes, &case.flat(answer, "d_planes"), 1e-6);
}

/// A field on the device with the parameters of the case.
fn field(gpu: &Gpu, case: &Case) -> Field {
    let mut field = Field::new(gpu, &case.config, BOX, 1).expect("a field");
    let mut state = field.state(gpu).expect("a state");
    let shapes = shapes(&case.layout());
    for vector in &mut state.vectors {
        if let Some((shape, at)) = shapes.get(&vector.name) {
            vector.values = case.parameters[*at..][..shape.iter().product()].to_vec();
        }
    }
    field.restore(gpu, &state).expect("restored");
    field
}

/// The gradients that a field has gathered: a first step of Adam leaves a tenth of them as first moments.
fn gathered(gpu: &Gpu, field: &mut Field, case: &Case) -> Vec<f64> {
    let adam = AdamConfig::default();
    field.step(gpu, 0.0, 0.0, &adam).expect("a step");
    let state = field.state(gpu).expect("a state");
    let mut flat = vec![0.0; case.layout().total];
    for (name, (_, at)) in shapes(&case.layout()) {
        let moment = state.vectors.iter().find(|vector| vector.name == format!("{name}.m")).expect("a moment");
        for (to, value) in flat[at..].iter_mut().zip(&moment.values) {
            *to = f64::from(*value) / (1.0 - f64::from(adam.beta1));
        }
    }
    flat
}

fn check_kernels(gpu: &Gpu, case: &Case, answer: &Value) {
    let who = format!("{:?} kernels", gpu.shape);
    let what = |name: &str| format!("{}: {who}: {name}", case.name);
    let mut field = field(gpu, case);
    let rows = case.means.len();
    let mut core = vec![0.0_f32; rows * CORE];
    core.chunks_exact_mut(CORE).zip(&case.means).for_each(|(row, mean)| row[..3].copy_from_slice(mean));
    let core = gpu.storage_from("core", &core).expect("a buffer");
    let mut tape = Tape::new(gpu).expect("a tape");
    field.forward(gpu, &core, rows as u32, case.t01, &mut tape, Outputs::All).expect("deltas");
    let read = |buffer, floats: usize| wide(&gpu.download::<f32>(buffer, floats).expect("read back"));
    assert_close(&what("core"), &read(&tape.deltas.core, rows * CORE), &numbers(answer, "core"), 1e-4);
    let stride = case.config.sh_stride as usize;
    if let Some(sh) = &tape.deltas.sh {
        assert_close(&what("sh"), &read(sh, rows * stride), &numbers(answer, "sh"), 1e-4);
    }
    let d_deltas = Deltas::new(gpu, "d_deltas", rows as u32, case.config.heads.sh.then_some(stride as u32));
    let d_deltas = d_deltas.expect("buffers");
    gpu.upload(&d_deltas.core, 0, &case.d_core);
    if let Some(sh) = &d_deltas.sh {
        gpu.upload(sh, 0, &case.d_sh);
    }
    let d_core = gpu.storage("d_core", (rows * CORE * 4) as u64).expect("a buffer");
    field.backward(gpu, &tape, &d_deltas, &d_core).expect("gradients");
    let d_means: Vec<f64> = read(&d_core, rows * CORE).chunks_exact(CORE).flat_map(|row| row[..3].to_vec()).collect();
    assert_close(&what("d_means"), &d_means, &numbers(answer, "d_means"), 1e-3);
    let gradient = gathered(gpu, &mut field, case);
    compare_parameters(case, &who, &gradient, &case.flat(answer, "d_parameters"), 1e-3);

    let mut field = self::field(gpu, case);
    let losses = field.regularise(gpu, &WEIGHTS).expect("losses");
    let losses = [losses.space, losses.time, losses.time_l1];
    assert_close(&what("plane losses"), &losses, &numbers(answer, "plane_losses"), 1e-4);
    let gradient = gathered(gpu, &mut field, case);
    compare_parameters(case, &format!("{who}' regularisers"), &gradient, &case.flat(answer, "d_planes"), 1e-3);
}

#[test]
fn deltas_and_gradients_are_the_oracles() {
    let cases = cases();
    let answers = ask(&cases.iter().map(Case::question).collect::<Vec<_>>());
    let gpus = gpus();
    for (case, answer) in cases.iter().zip(&answers) {
        check_twin(case, answer);
        for gpu in &gpus {
            check_kernels(gpu, case, answer);
        }
    }
}
