use super::*;
use erfgs_splat::raster::{CORE_STRIDE, Deltas, GaussianBuffers, sh_stride};

const COUNT: usize = 40;
const DYNAMIC: usize = 37;
const CORE: usize = CORE_STRIDE as usize;
const CENTRE: [f32; 3] = [0.3, -0.2, -1.5];
/// So that gradients, which the mean divides by the number of values, are of the order of one.
const WEIGHT: f32 = 3.0 * DYNAMIC as f32;

/// Numbers in -`size`..`size`.
fn numbers(count: usize, seed: u32, size: f32) -> Vec<f32> {
    let value = |i: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(seed * 40_503) >> 8 & 0xffff) as f32 / 32_767.5;
    (0..count as u32).map(|i| size * (value(i.wrapping_mul(7).wrapping_add(seed)) - 1.0)).collect()
}

fn add(a: &[f32], b: &[f32]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| f64::from(*a) + f64::from(*b)).collect()
}

struct Case {
    core: Vec<f32>,
    sh: Vec<f32>,
    /// Core and SH, before and after.
    deltas: [[Vec<f32>; 2]; 2],
    stride: usize,
}

impl Case {
    fn new(allocated: u32) -> Self {
        let stride = sh_stride(allocated) as usize;
        let deltas = |seed| [numbers(DYNAMIC * CORE, seed, 0.4), numbers(DYNAMIC * stride, seed + 1, 1.0)];
        let deltas = [deltas(3), deltas(5)];
        Self { core: numbers(COUNT * CORE, 1, 1.0), sh: numbers(COUNT * stride, 2, 1.5), deltas, stride }
    }

    fn deformed(&self, time: usize) -> (Vec<f64>, Vec<f64>) {
        (add(&self.core, &self.deltas[time][0]), add(&self.sh, &self.deltas[time][1]))
    }
}

fn upload(gpu: &Gpu, [core, sh]: &[Vec<f32>; 2]) -> Deltas {
    Deltas {
        rows: DYNAMIC as u32,
        core: gpu.storage_from("core", core).expect("a buffer"),
        sh: Some(gpu.storage_from("sh", sh).expect("a buffer")),
    }
}

#[test]
fn the_colour_loss_and_its_gradient_match_the_twin() {
    for gpu in gpus() {
        for (allocated, active) in [(0, 0), (1, 1), (2, 2), (3, 1), (3, 3)] {
            check(&gpu, allocated, active);
        }
    }
}

fn check(gpu: &Gpu, allocated: u32, active: u32) {
    let case = Case::new(allocated);
    let losses = Losses::new(gpu);
    let gaussians = GaussianBuffers::from_slices(gpu, allocated, &case.core, &case.sh).expect("Gaussians");
    let [before, after] = case.deltas.each_ref().map(|deltas| upload(gpu, deltas));
    // Both gradients hold something already.
    let d_sh = gpu.storage_from("d_sh", &vec![1.0_f32; COUNT * case.stride]).expect("a buffer");
    let d_deltas = upload(gpu, &[vec![3.0; DYNAMIC * CORE], vec![2.0; DYNAMIC * case.stride]]);
    // Several Gaussians a thread.
    let loss = LossSum::new(gpu, 150).expect("a buffer");
    let change =
        ColourChange { gaussians: &gaussians, before: &before, after: &after, centre: CENTRE, sh_degree: active };
    let mut commands = gpu.commands();
    assert!(losses.colour(gpu, &mut commands, &change, &d_sh, &d_deltas, &loss, WEIGHT));
    commands.submit();

    let (core_before, sh_before) = case.deformed(0);
    let (core_after, sh_after) = case.deformed(1);
    let centre = CENTRE.map(f64::from);
    let colours = |core: &[f64], sh: &[f64]| twin::colours(core, sh, centre, active);
    let constant = colours(&core_before, &sh_before);
    let clamped = colours(&core_after, &sh_after).iter().flatten().filter(|value| **value == 0.0).count();
    assert!(clamped > 0 && clamped < 2 * DYNAMIC, "the clamp matters, in places: {clamped}");
    let want = twin::colour(&constant, &colours(&core_after, &sh_after));
    assert_close(loss.take(gpu).expect("a sum"), want, "loss");

    let gradient: Vec<f32> = gpu.download(&d_sh, COUNT * case.stride).expect("a gradient");
    let delta_sh = d_deltas.sh.as_ref().expect("SH");
    let delta_gradient: Vec<f32> = gpu.download(delta_sh, DYNAMIC * case.stride).expect("a gradient");
    let delta_core: Vec<f32> = gpu.download(&d_deltas.core, DYNAMIC * CORE).expect("a gradient");
    for at in 0..DYNAMIC * case.stride {
        let want = f64::from(WEIGHT)
            * difference(|step| {
                let mut moved = sh_after.clone();
                moved[at] += step;
                twin::colour(&constant, &colours(&core_after, &moved))
            });
        assert_close(f64::from(gradient[at]) - 1.0, want, "gradient of the coefficients");
        assert_close(f64::from(delta_gradient[at]) - 2.0, want, "gradient of their deformation");
    }
    assert!(gradient[DYNAMIC * case.stride..].iter().all(|&value| value == 1.0), "others are left alone");
    assert!(delta_core.iter().all(|&value| value == 3.0), "directions are constants");
}

#[test]
fn the_colour_loss_needs_gaussians_whose_colour_is_deformed() {
    for gpu in gpus() {
        let case = Case::new(1);
        let losses = Losses::new(&gpu);
        let gaussians = GaussianBuffers::from_slices(&gpu, 1, &case.core, &case.sh).expect("Gaussians");
        let d_sh = gpu.storage("d_sh", (COUNT * case.stride * 4) as u64).expect("a buffer");
        let loss = LossSum::new(&gpu, 150).expect("a buffer");
        let deformed = upload(&gpu, &case.deltas[0]);
        let nobody = Deltas::new(&gpu, "nobody", 0, Some(case.stride as u32)).expect("a buffer");
        let colourless = Deltas { sh: None, ..deformed.clone() };
        for (before, after) in [(&nobody, &nobody), (&colourless, &colourless)] {
            let change = ColourChange { gaussians: &gaussians, before, after, centre: CENTRE, sh_degree: 1 };
            let mut commands = gpu.commands();
            assert!(!losses.colour(&gpu, &mut commands, &change, &d_sh, after, &loss, 1.0));
            commands.submit();
        }
        assert_eq!(loss.take(&gpu).expect("a sum"), 0.0);
        let gradient: Vec<f32> = gpu.download(&d_sh, COUNT * case.stride).expect("a gradient");
        assert!(gradient.iter().all(|&value| value == 0.0));
    }
}

#[test]
fn a_gaussian_at_the_camera_keeps_the_colour_loss_finite() {
    let [gpu, _] = gpus();
    let mut case = Case::new(3);
    for row in 0..DYNAMIC {
        case.core[row * CORE..][..3].copy_from_slice(&CENTRE);
        for time in 0..2 {
            case.deltas[time][0][row * CORE..][..3].fill(0.0);
        }
    }
    let losses = Losses::new(&gpu);
    let gaussians = GaussianBuffers::from_slices(&gpu, 3, &case.core, &case.sh).expect("Gaussians");
    let [before, after] = case.deltas.each_ref().map(|deltas| upload(&gpu, deltas));
    let d_sh = gpu.storage("d_sh", (COUNT * case.stride * 4) as u64).expect("a buffer");
    let d_deltas = Deltas::new(&gpu, "gradients", DYNAMIC as u32, Some(case.stride as u32)).expect("a buffer");
    let loss = LossSum::new(&gpu, 150).expect("a buffer");
    let change = ColourChange { gaussians: &gaussians, before: &before, after: &after, centre: CENTRE, sh_degree: 3 };
    let mut commands = gpu.commands();
    losses.colour(&gpu, &mut commands, &change, &d_sh, &d_deltas, &loss, 1.0);
    commands.submit();
    let value = loss.take(&gpu).expect("a sum");
    assert!(value.is_finite() && value > 0.0, "{value}");
    let gradient: Vec<f32> = gpu.download(&d_sh, COUNT * case.stride).expect("a gradient");
    assert!(gradient.iter().all(|value| value.is_finite()));
}
