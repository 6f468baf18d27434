use erfgs_splat::{
    gpu::Gpu,
    raster::{
        CORE_STRIDE, Deltas, Frame, GaussianBuffers, Gradients, Rasteriser, RenderOptions, View, Wanted, sh_stride,
    },
    reference::raster as twin,
};
use serde_json::{Value, json};

use crate::oracles::{Numbers, ask, assert_close, gpus, numbers, wide};

const CORE: usize = CORE_STRIDE as usize;

struct Case {
    name: &'static str,
    view: View,
    options: RenderOptions,
    sh_degree: u32,
    core: Vec<f32>,
    sh: Vec<f32>,
    delta_rows: usize,
    delta_core: Vec<f32>,
    delta_sh: Vec<f32>,
    d_image: Vec<[f32; 4]>,
}

/// A scene of `count` Gaussians in front of a camera that is turned, shifted and off-centre.
fn scene(name: &'static str, seed: u64, count: usize, sh_degree: u32, delta_rows: usize) -> Case {
    let mut random = Numbers(seed << 32);
    let (width, height) = (37, 26);
    let (sin, cos) = (0.4_f32.sin(), 0.4_f32.cos());
    let view = View {
        width,
        height,
        fx: 30.0,
        fy: 32.0,
        cx: 16.4,
        cy: 14.1,
        rotation: [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]],
        translation: [0.2, -0.1, 0.3],
    };
    let stride = sh_stride(sh_degree) as usize;
    let coefficients = 3 * (sh_degree as usize + 1).pow(2);
    let (mut core, mut sh) = (Vec::new(), Vec::new());
    for _ in 0..count {
        // In camera coordinates first: a few lie beside the image, a few behind the near plane.
        let z = random.between(-0.3, 5.0);
        let camera = [random.between(-0.9, 0.9) * z.abs(), random.between(-0.7, 0.7) * z.abs(), z];
        let from_origin: [f64; 3] = std::array::from_fn(|axis| camera[axis] - f64::from(view.translation[axis]));
        core.extend((0..3).map(|axis| (0..3).map(|k| f64::from(view.rotation[k][axis]) * from_origin[k]).sum::<f64>()));
        core.extend((0..3).map(|_| random.between(-3.5, -0.8)));
        core.extend((0..4).map(|_| random.between(-1.0, 1.0)));
        core.extend([random.between(-3.0, 6.0), 0.0]);
        sh.extend((0..stride).map(|k| if k < coefficients { random.between(-0.6, 0.6) } else { 0.0 }));
    }
    let narrow = |values: &[f64]| values.iter().map(|&value| value as f32).collect::<Vec<f32>>();
    let mut deltas = |stride: usize, used: usize| -> Vec<f32> {
        let value = |k: usize| if k % stride < used { random.between(-0.1, 0.1) as f32 } else { 0.0 };
        (0..delta_rows * stride).map(value).collect()
    };
    let (delta_core, delta_sh) = (deltas(CORE, CORE - 1), deltas(stride, coefficients));
    let pixels = (width * height) as usize;
    let d_image = (0..pixels).map(|_| std::array::from_fn(|_| random.between(-1.0, 1.0) as f32)).collect();
    let options =
        RenderOptions { background: [0.3, 0.6, 0.1], sh_degree, near: 0.2, depth: true, ..RenderOptions::default() };
    let (core, sh) = (narrow(&core), narrow(&sh));
    Case { name, view, options, sh_degree, core, sh, delta_rows, delta_core, delta_sh, d_image }
}

fn cases() -> Vec<Case> {
    let mut opaque = scene("opaque", 4, 150, 1, 0);
    opaque.core.chunks_exact_mut(CORE).for_each(|row| row[10] = 9.0);
    let mut lower = scene("active degree below the allocated", 6, 30, 3, 5);
    lower.options.sh_degree = 1;
    vec![
        scene("degree 0", 1, 40, 0, 0),
        scene("degree 2 with deltas", 2, 60, 2, 25),
        scene("degree 3, all dynamic", 3, 60, 3, 60),
        opaque,
        lower,
        scene("one Gaussian", 7, 1, 3, 1),
    ]
}

fn rows(values: &[f32], stride: usize) -> Vec<Vec<f32>> {
    values.chunks_exact(stride).map(<[f32]>::to_vec).collect()
}

impl Case {
    fn question(&self) -> Value {
        let stride = sh_stride(self.sh_degree) as usize;
        json!({
            "oracle": "raster",
            "view": {
                "width": self.view.width, "height": self.view.height,
                "fx": self.view.fx, "fy": self.view.fy, "cx": self.view.cx, "cy": self.view.cy,
                "rotation": self.view.rotation, "translation": self.view.translation,
            },
            "options": {
                "background": self.options.background,
                "near": self.options.near,
                "sh_degree": self.options.sh_degree,
            },
            "core": rows(&self.core, CORE),
            "sh": rows(&self.sh, stride),
            "delta_rows": self.delta_rows,
            "delta_core": rows(&self.delta_core, CORE),
            "delta_sh": rows(&self.delta_sh, stride),
            "d_image": self.d_image,
            "margin": 2e-4,
        })
    }

    /// Pixels that no precision decides differently, as the oracle says.
    fn clear(&self, answer: &Value) -> Vec<bool> {
        let clear: Vec<bool> = numbers(answer, "clear").iter().map(|&clear| clear == 1.0).collect();
        let undecided = clear.iter().filter(|&&clear| !clear).count();
        assert!(undecided <= clear.len() / 8, "{}: {undecided} of {} pixels are undecided", self.name, clear.len());
        clear
    }
}

/// What the kernels make of a case; the names are the oracle's.
struct Rendered {
    image: Vec<f64>,
    depth: Vec<f64>,
    d_core: Vec<f64>,
    d_sh: Vec<f64>,
    d_delta_core: Vec<f64>,
    d_delta_sh: Vec<f64>,
    screen: Vec<[f32; 4]>,
}

fn render(gpu: &Gpu, case: &Case, clear: &[bool]) -> Rendered {
    let rasteriser = Rasteriser::new(gpu).expect("kernels");
    let gaussians = GaussianBuffers::from_slices(gpu, case.sh_degree, &case.core, &case.sh).expect("Gaussians");
    let gradients = Gradients::new(gpu, &gaussians).expect("gradients");
    let stride = sh_stride(case.sh_degree);
    let new_deltas = || Deltas::new(gpu, "deltas", case.delta_rows as u32, Some(stride)).expect("deltas");
    let (deltas, d_deltas) = (new_deltas(), new_deltas());
    gpu.upload(&deltas.core, 0, &case.delta_core);
    gpu.upload(deltas.sh.as_ref().expect("SH deltas"), 0, &case.delta_sh);
    let dynamic = case.delta_rows > 0;
    let (deltas, d_deltas) = (dynamic.then_some(&deltas), dynamic.then_some(&d_deltas));
    let mut frame = Frame::new(gpu).expect("a frame");
    // A frame that was too small grows.
    for _ in 0..2 {
        rasteriser.forward(gpu, &gaussians, deltas, &case.view, &case.options, &mut frame).expect("rendered");
        if frame.check(gpu).is_ok() {
            break;
        }
    }
    let d_image: Vec<[f32; 4]> =
        case.d_image.iter().zip(clear).map(|(d, &clear)| if clear { *d } else { [0.0; 4] }).collect();
    let d_image = gpu.storage_from("d_image", &d_image).expect("a buffer");
    let (view, options) = (&case.view, &case.options);
    let wanted = Wanted { statistics: true, pose: None };
    rasteriser
        .backward(gpu, &gaussians, deltas, view, options, &frame, &d_image, &gradients, d_deltas, wanted)
        .expect("gradients");
    let pixels = clear.len();
    let count = gaussians.count as usize;
    let read = |buffer, floats: usize| wide(&gpu.download::<f32>(buffer, floats).expect("read back"));
    let delta_sh = d_deltas.and_then(|deltas| deltas.sh.as_ref());
    Rendered {
        image: read(&frame.image, pixels * 4),
        depth: read(frame.depth.as_ref().expect("a depth image"), pixels),
        d_core: read(&gradients.core, count * CORE),
        d_sh: read(&gradients.sh, count * stride as usize),
        d_delta_core: d_deltas.map_or(Vec::new(), |deltas| read(&deltas.core, case.delta_rows * CORE)),
        d_delta_sh: delta_sh.map_or(Vec::new(), |sh| read(sh, case.delta_rows * stride as usize)),
        screen: gpu.download(&gradients.screen, count).expect("read back"),
    }
}

/// Keeps the columns of a row that a parameter group has, so that each group is compared on its own scale.
fn columns(values: &[f64], stride: usize, range: std::ops::Range<usize>) -> Vec<f64> {
    values.chunks_exact(stride).flat_map(|row| row[range.clone()].to_vec()).collect()
}

/// Compares image and depth where no precision decides differently.
fn compare_image(
    case: &Case,
    answer: &Value,
    clear: &[bool],
    who: &str,
    (image, depth): (&[f64], &[f64]),
    tolerance: f64,
) {
    for (name, got, channels) in [("image", image, 4), ("depth", depth, 1)] {
        let only_clear = |values: &[f64]| -> Vec<f64> {
            values.iter().enumerate().map(|(i, value)| if clear[i / channels] { *value } else { 0.0 }).collect()
        };
        let what = format!("{}: {who}: {name}", case.name);
        assert_close(&what, &only_clear(got), &only_clear(&numbers(answer, name)), tolerance);
    }
}

fn compare_twin(case: &Case, answer: &Value, clear: &[bool]) {
    let deformed = |values: &[f32], deltas: &[f32]| -> Vec<f64> {
        let deltas = wide(deltas).into_iter().chain(std::iter::repeat(0.0));
        wide(values).into_iter().zip(deltas).map(|(value, delta)| value + delta).collect()
    };
    let gaussians = twin::Gaussians {
        sh_degree: case.sh_degree,
        core: deformed(&case.core, &case.delta_core),
        sh: deformed(&case.sh, &case.delta_sh),
    };
    let image = gaussians.render(&case.view, &case.options);
    let pixels: Vec<f64> = image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
    compare_image(case, answer, clear, "twin", (&pixels, &image.depth), 1e-6);
}

fn compare(case: &Case, answer: &Value, clear: &[bool], got: &Rendered, who: &str, tolerance: f64) {
    let what = |name: &str| format!("{}: {who}: {name}", case.name);
    compare_image(case, answer, clear, who, (&got.image, &got.depth), tolerance);
    let groups = [("mean", 0..3), ("log-scale", 3..6), ("quaternion", 6..10), ("opacity", 10..11), ("rest", 11..12)];
    for (name, values) in [("d_core", &got.d_core), ("d_delta_core", &got.d_delta_core)] {
        let want = numbers(answer, name);
        for (group, range) in groups.clone() {
            let (got, want) = (columns(values, CORE, range.clone()), columns(&want, CORE, range));
            assert_close(&what(&format!("{name} {group}")), &got, &want, 10.0 * tolerance);
        }
    }
    assert_close(&what("d_sh"), &got.d_sh, &numbers(answer, "d_sh"), 10.0 * tolerance);
    assert_close(&what("d_delta_sh"), &got.d_delta_sh, &numbers(answer, "d_delta_sh"), 10.0 * tolerance);
}

#[test]
fn images_and_gradients_are_the_oracles() {
    let cases = cases();
    let answers = ask(&cases.iter().map(Case::question).collect::<Vec<_>>());
    let gpus = gpus();
    for (case, answer) in cases.iter().zip(&answers) {
        let clear = case.clear(answer);
        compare_twin(case, answer, &clear);
        for gpu in &gpus {
            let got = render(gpu, case, &clear);
            compare(case, answer, &clear, &got, &format!("{:?} kernels", gpu.shape), 1e-4);
            let half = [f64::from(case.view.width) / 2.0, f64::from(case.view.height) / 2.0];
            let want: Vec<f64> =
                numbers(answer, "d_mean2d").iter().zip(half.iter().cycle()).map(|(d, h)| d * h).collect();
            let moved: Vec<f64> = got.screen.iter().flat_map(|row| wide(&row[..2])).collect();
            assert_close(&format!("{}: {:?}: screen", case.name, gpu.shape), &moved, &want, 1e-3);
        }
    }
}
