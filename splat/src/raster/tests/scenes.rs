//! Random scenes, rendered on the device and by the twin.

use std::sync::{Arc, OnceLock};

use erfgs_base::random::{key, normal, purpose, range, uniform};
use glam::DVec4;

use crate::{
    gpu::{AdapterChoice, Gpu, Shape},
    raster::{
        CORE_STRIDE, Deltas, Frame, GaussianBuffers, Gradients, PoseRow, Rasteriser, Region, RenderOptions, View,
        Wanted, sh_stride,
    },
    reference::raster::{Gaussians, Image},
};

/// The forms of the kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Cpu,
    /// The CPU shape on a device without subgroups of eight.
    CpuWithoutSubgroups,
    Gpu,
    /// The GPU shape on a device without subgroups.
    GpuWithoutSubgroups,
}

pub(super) const FORMS: [Form; 4] = [Form::Cpu, Form::CpuWithoutSubgroups, Form::Gpu, Form::GpuWithoutSubgroups];

impl Form {
    pub(super) fn shape(self) -> Shape {
        match self {
            Form::Cpu | Form::CpuWithoutSubgroups => Shape::Cpu,
            Form::Gpu | Form::GpuWithoutSubgroups => Shape::Gpu,
        }
    }
}

/// A device with compiled kernels, shared by all tests.
pub(super) fn device(form: Form) -> &'static (Gpu, Rasteriser) {
    static DEVICES: [OnceLock<(Gpu, Rasteriser)>; 4] = [const { OnceLock::new() }; 4];
    DEVICES[form as usize].get_or_init(|| {
        let mut gpu = Gpu::open(&AdapterChoice { name: None, shape: Some(form.shape()) }).expect("an adapter");
        if let Form::CpuWithoutSubgroups | Form::GpuWithoutSubgroups = form {
            gpu.subgroup = 0;
        }
        let rasteriser = Rasteriser::new(&gpu).expect("kernels that compile");
        (gpu, rasteriser)
    })
}

/// Gaussians, a camera and a gradient of the image.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    pub(super) sh_degree: u32,
    pub(super) core: Vec<f32>,
    pub(super) sh: Vec<f32>,
    /// Rows of deltas: core and SH.
    pub(super) deltas: Option<(Vec<f32>, Option<Vec<f32>>)>,
    pub(super) view: View,
    pub(super) options: RenderOptions,
    pub(super) d_image: Vec<[f32; 4]>,
}

/// What came back from the device.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rendered {
    pub(super) image: Vec<[f32; 4]>,
    pub(super) depth: Option<Vec<f32>>,
    pub(super) d_core: Vec<f32>,
    pub(super) d_sh: Vec<f32>,
    pub(super) screen: Vec<[f32; 4]>,
    pub(super) d_delta_core: Vec<f32>,
    pub(super) d_delta_sh: Vec<f32>,
    pub(super) d_pose: [f32; 6],
}

/// A turned camera with an off-centre principal point.
pub(super) fn camera(width: u32, height: u32) -> View {
    let turn = glam::Mat3::from_euler(glam::EulerRot::XYZ, 0.1, -0.2, 0.15).transpose().to_cols_array_2d();
    View {
        width,
        height,
        fx: 0.9 * width as f32,
        fy: 0.95 * width as f32,
        cx: 0.56 * width as f32,
        cy: 0.43 * height as f32,
        rotation: turn,
        translation: [0.2, -0.1, 0.3],
    }
}

impl Scene {
    /// `count` Gaussians in front of `view`, with standard deviations around `sigma_px` pixels.
    pub(super) fn random(seed: u64, count: u32, sh_degree: u32, view: View, sigma_px: f64) -> Self {
        let number = |index: u32, word: u64| key(seed, &[purpose("raster test"), u64::from(index), word]);
        let stride = sh_stride(sh_degree);
        let (c, r) = (view.centre().map(f64::from), view.rotation.map(|row| row.map(f64::from)).concat());
        let (mut core, mut sh) = (Vec::new(), Vec::new());
        for index in 0..count {
            let random = |word| number(index, word);
            let z = range(random(0), 1.5, 4.0);
            let pixel = [range(random(1), -0.1, 1.1), range(random(2), -0.1, 1.1)];
            let x = (pixel[0] * f64::from(view.width) - f64::from(view.cx)) / f64::from(view.fx) * z;
            let y = (pixel[1] * f64::from(view.height) - f64::from(view.cy)) / f64::from(view.fy) * z;
            let mean: [f64; 3] = std::array::from_fn(|k| c[k] + r[k] * x + r[3 + k] * y + r[6 + k] * z);
            let log_size = (sigma_px * z / f64::from(view.fx)).ln();
            core.extend(mean);
            core.extend([3, 4, 5].map(|word| log_size + 0.5 * normal(random(word))));
            core.extend([6, 7, 8, 9].map(|word| normal(random(word))));
            core.extend([range(random(10), -1.5, 1.5), 0.0]);
            sh.extend((0..u64::from(stride)).map(|k| 0.3 * normal(random(20 + k))));
        }
        let pixels = view.width * view.height;
        let d_image = (0..pixels)
            .map(|pixel| std::array::from_fn(|k| uniform(number(pixel, 1000 + k as u64)) as f32 - 0.5))
            .collect();
        Self {
            sh_degree,
            core: core.into_iter().map(|x| x as f32).collect(),
            sh: sh.into_iter().map(|x| x as f32).collect(),
            deltas: None,
            view,
            options: RenderOptions { background: [0.2, 0.5, 0.9], sh_degree, ..RenderOptions::default() },
            d_image,
        }
    }

    /// Adds random deltas to the first `rows` Gaussians.
    pub(super) fn with_deltas(mut self, seed: u64, rows: usize, sh: bool) -> Self {
        let noise = |from: u64, count: usize, size: f64| -> Vec<f32> {
            (0..count).map(|i| (size * normal(key(seed, &[from, i as u64]))) as f32).collect()
        };
        let core = noise(1, rows * CORE_STRIDE as usize, 0.05);
        let sh = sh.then(|| noise(2, rows * sh_stride(self.sh_degree) as usize, 0.1));
        self.deltas = Some((core, sh));
        self
    }

    pub(super) fn count(&self) -> usize {
        self.core.len() / CORE_STRIDE as usize
    }

    /// The twin's Gaussians, deltas added.
    pub(super) fn twin(&self) -> Gaussians {
        let mut twin = Gaussians {
            sh_degree: self.sh_degree,
            core: self.core.iter().map(|x| f64::from(*x)).collect(),
            sh: self.sh.iter().map(|x| f64::from(*x)).collect(),
        };
        if let Some((core, sh)) = &self.deltas {
            for (value, delta) in twin.core.iter_mut().zip(core) {
                *value += f64::from(*delta);
            }
            for (value, delta) in twin.sh.iter_mut().zip(sh.iter().flatten()) {
                *value += f64::from(*delta);
            }
        }
        twin
    }

    /// `sum of d_image . image` of the twin.
    pub(super) fn loss(&self, gaussians: &Gaussians) -> f64 {
        self.loss_of(&gaussians.render(&self.view, &self.options))
    }

    /// The same of an image.
    pub(super) fn loss_of(&self, image: &Image) -> f64 {
        image.pixels.iter().zip(&self.d_image).map(|(pixel, d)| pixel.dot(DVec4::from(d.map(f64::from)))).sum()
    }

    /// Renders and differentiates on the device.
    pub(super) fn run(&self, form: Form) -> Rendered {
        self.run_in(form, None)
    }

    /// Renders and differentiates a part of the image.
    pub(super) fn run_in(&self, form: Form, region: Option<Arc<Region>>) -> Rendered {
        let (gpu, rasteriser) = device(form);
        let gaussians = GaussianBuffers::from_slices(gpu, self.sh_degree, &self.core, &self.sh).expect("room");
        let gradients = Gradients::new(gpu, &gaussians).expect("room");
        let deltas = self.deltas.as_ref().map(|(core, sh)| Deltas {
            rows: core.len() as u32 / CORE_STRIDE,
            core: gpu.storage_from("delta core", core).expect("room"),
            sh: sh.as_ref().map(|sh| gpu.storage_from("delta sh", sh).expect("room")),
        });
        // The gradients of the deltas are written, not added to: what was there must not matter.
        let d_deltas = self.deltas.as_ref().map(|(core, sh)| Deltas {
            rows: core.len() as u32 / CORE_STRIDE,
            core: gpu.storage_from("d delta core", &vec![7.0f32; core.len()]).expect("room"),
            sh: sh.as_ref().map(|sh| gpu.storage_from("d delta sh", &vec![7.0f32; sh.len()]).expect("room")),
        });
        let d_image = gpu.storage_from("d image", &self.d_image).expect("room");
        // Added to the second of three cameras.
        let poses = gpu.storage_from("poses", &[[1.0_f32; PoseRow::FLOATS]; 3]).expect("room");
        let mut frame = Frame::new(gpu).expect("room");
        frame.region = region;
        rasteriser.forward(gpu, &gaussians, deltas.as_ref(), &self.view, &self.options, &mut frame).expect("a render");
        frame.check(gpu).expect("a complete render");
        rasteriser
            .backward(
                gpu,
                &gaussians,
                deltas.as_ref(),
                &self.view,
                &self.options,
                &frame,
                &d_image,
                &gradients,
                d_deltas.as_ref(),
                Wanted { statistics: true, pose: Some(PoseRow { sums: &poses, row: 1 }) },
            )
            .expect("gradients");
        let pixels = (self.view.width * self.view.height) as usize;
        let all = |buffer: &wgpu::Buffer, count: usize| gpu.download::<f32>(buffer, count).expect("a read back");
        let rows = self.deltas.as_ref().map_or(0, |(core, _)| core.len());
        let poses: Vec<f32> = all(&poses, 3 * PoseRow::FLOATS);
        assert!(poses[..8].iter().chain(&poses[16..]).all(|&other| other == 1.0));
        assert_eq!([poses[11], poses[15]], [2.0; 2], "renderings are counted");
        let sh_rows = self.deltas.as_ref().and_then(|(_, sh)| sh.as_ref()).map_or(0, Vec::len);
        Rendered {
            image: gpu.download(&frame.image, pixels).expect("a read back"),
            depth: frame.depth.as_ref().map(|depth| all(depth, pixels)),
            d_core: all(&gradients.core, self.core.len()),
            d_sh: all(&gradients.sh, self.sh.len()),
            screen: gpu.download(&gradients.screen, self.count()).expect("a read back"),
            d_delta_core: d_deltas.as_ref().map_or(Vec::new(), |d| all(&d.core, rows)),
            d_delta_sh: d_deltas.as_ref().and_then(|d| d.sh.as_ref()).map_or(Vec::new(), |sh| all(sh, sh_rows)),
            d_pose: [8, 9, 10, 12, 13, 14].map(|at| poses[at] - 1.0),
        }
    }
}
