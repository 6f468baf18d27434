//! The rasteriser: what its thresholds, its extent rule, the degree of its colours and single precision cost and save.

use std::sync::{Arc, OnceLock};

use erfgs_base::random::{key, normal, purpose, range, uniform};
use erfgs_splat::{
    gpu::{AdapterChoice, Gpu, Shape},
    raster::{
        Frame, GaussianBuffers, Gradients, RasterError, Rasteriser, RenderOptions, Thresholds, View, Wanted, sh_stride,
    },
    reference::raster::{Gaussians, SplatGradient, blend_backward},
};
use glam::{DVec3, DVec4};

use crate::{
    Bench, Component, Measure, Result, Size, Stopwatch, Study,
    component::About,
    exact::{Rules, exact},
};

const ABOUT: About = About {
    name: "rasteriser",
    truth: "Gaussians of mixed sizes, shapes and opacities, several layers deep. The truth is the same sum in `f64` where every \
            Gaussian is looked at in every pixel and no rule leaves any out; rounding is told from `f64` by the rules of the setting.",
    work: "a picture and its gradients",
    measures: &[
        Measure { name: "error of a pixel, root mean square", unit: "of white", logarithmic: true },
        Measure { name: "largest rounding error", unit: "of white", logarithmic: true },
    ],
};

/// What computes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Arithmetic {
    /// The kernels of the adapter's own shape, in `f32`.
    Kernels,
    /// The kernels of the other shape.
    OtherShape,
    /// The twin.
    Twin,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    arithmetic: Arithmetic,
    thresholds: Thresholds,
    three_sigma: bool,
    sh_degree: u32,
}

const DEFAULT: Setting = Setting {
    arithmetic: Arithmetic::Kernels,
    thresholds: Thresholds { negligible_alpha: 1.0 / 255.0, least_transmittance: 1e-4 },
    three_sigma: false,
    sh_degree: 3,
};

/// Gaussians before a camera that looks along z.
struct Cloud {
    gaussians: Gaussians,
    view: View,
}

impl Cloud {
    /// `count` Gaussians 1 to 5 m away, of 2.5 pixels and all shapes.
    fn random(count: u64, width: u32, height: u32) -> Self {
        let focal = width as f32;
        let view = View {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 0.5 * width as f32,
            cy: 0.5 * height as f32,
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
        };
        let stride = u64::from(sh_stride(3));
        let (mut core, mut sh) = (Vec::new(), Vec::new());
        for index in 0..count {
            let at = |word: u64| key(1, &[purpose("precision cloud"), index, word]);
            let z = range(at(0), 1.0, 5.0);
            let pixel = [uniform(at(1)) * f64::from(width), uniform(at(2)) * f64::from(height)];
            let focal = f64::from(focal);
            core.extend([(pixel[0] - f64::from(view.cx)) / focal * z, (pixel[1] - f64::from(view.cy)) / focal * z, z]);
            let size = (2.5 * z / focal).ln() + 0.5 * normal(at(3));
            core.extend([4, 5, 6].map(|word| size + 0.5 * normal(at(word))));
            core.extend([7, 8, 9, 10].map(|word| normal(at(word))));
            core.extend([1.5 * normal(at(11)), 0.0]);
            // What is seen from the side differs less than the mean does from Gaussian to Gaussian.
            sh.extend((0..stride).map(|k| if k < 3 { 1.0 } else { 0.15 } * normal(at(100 + k))));
        }
        // Numbers that single precision holds: what is lost before the rasteriser is no error of it.
        let held = |values: Vec<f64>| values.into_iter().map(|x| f64::from(x as f32)).collect();
        Self { gaussians: Gaussians { sh_degree: 3, core: held(core), sh: held(sh) }, view }
    }

    fn options(&self, setting: &Setting) -> RenderOptions {
        RenderOptions {
            background: [0.2, 0.5, 0.9],
            sh_degree: setting.sh_degree,
            three_sigma: setting.three_sigma,
            ..RenderOptions::default()
        }
    }

    fn exact(&self, setting: &Setting, rules: &Rules) -> Vec<DVec4> {
        exact(&self.gaussians, &self.view, &self.options(setting), rules)
    }

    /// The picture by kernels.
    fn kernels(
        &self,
        gpu: &Gpu,
        rasteriser: &Rasteriser,
        stopwatch: &mut Stopwatch,
        setting: &Setting,
    ) -> Result<Vec<DVec4>> {
        let narrow = |values: &[f64]| values.iter().map(|x| *x as f32).collect::<Vec<f32>>();
        let gaussians =
            GaussianBuffers::from_slices(gpu, 3, &narrow(&self.gaussians.core), &narrow(&self.gaussians.sh))?;
        let (view, options) = (&self.view, self.options(setting));
        let pixels = (view.width * view.height) as usize;
        let gradient = gpu.storage_from("gradient of a picture", &vec![GRADIENT.map(|x| x as f32); pixels])?;
        let gradients = Gradients::new(gpu, &gaussians)?;
        let mut frame = Frame::new(gpu)?;
        let wanted = Wanted { statistics: true, pose: None };
        let mut draw = || -> Result<()> {
            rasteriser.forward(gpu, &gaussians, None, view, &options, &mut frame)?;
            rasteriser.backward(gpu, &gaussians, None, view, &options, &frame, &gradient, &gradients, None, wanted)?;
            Ok(gpu.wait("a picture and its gradients")?)
        };
        // Drivers compile at the first use, and the first picture finds how much room it needs.
        draw()?;
        draw()?;
        stopwatch.time(draw)?;
        match frame.check(gpu) {
            Err(RasterError::Overflow { .. }) => return Err("a frame did not grow".into()),
            other => other?,
        }
        let image: Vec<[f32; 4]> = gpu.download(&frame.image, pixels)?;
        Ok(image.into_iter().map(|pixel| DVec4::from_array(pixel.map(f64::from))).collect())
    }

    /// The picture by the twin.
    fn twin(&self, stopwatch: &mut Stopwatch, setting: &Setting) -> Result<Vec<DVec4>> {
        let options = self.options(setting);
        let d_image = vec![DVec4::from_array(GRADIENT); (self.view.width * self.view.height) as usize];
        let (image, _): (_, Vec<SplatGradient>) = stopwatch.time(|| {
            let splats = self.gaussians.splats(&self.view, &options);
            let image = erfgs_splat::reference::raster::blend(&splats, &self.view, &options);
            let gradients = blend_backward(&splats, &image, DVec3::from(options.background.map(f64::from)), &d_image);
            Ok((image, gradients))
        })?;
        Ok(image.pixels)
    }
}

/// Of the loss by r, g, b and the transmittance of a pixel.
const GRADIENT: [f64; 4] = [0.4, -0.3, 0.5, 0.2];

/// The root of the mean square and the largest of the differences of colours.
fn differences(one: &[DVec4], other: &[DVec4]) -> [f64; 2] {
    let squares = one.iter().zip(other).map(|(a, b)| (a.truncate() - b.truncate()).length_squared() / 3.0);
    let largest = one.iter().zip(other).map(|(a, b)| (a.truncate() - b.truncate()).abs().max_element());
    [(squares.sum::<f64>() / one.len() as f64).sqrt(), largest.fold(0.0, f64::max)]
}

fn other_shape(gpu: &Gpu) -> Result<Gpu> {
    let shape = if gpu.shape == Shape::Cpu { Shape::Gpu } else { Shape::Cpu };
    Ok(Gpu::open(&AdapterChoice { name: Some(gpu.info.name.clone()), shape: Some(shape) })?)
}

/// The rasteriser's knobs.
#[must_use]
pub fn component(size: Size) -> Component {
    let cloud = Arc::new(match size {
        Size::Small => Cloud::random(300, 48, 36),
        Size::Full => Cloud::random(6000, 192, 144),
    });
    let truth: Arc<OnceLock<Vec<DVec4>>> = Arc::default();
    let run = move |bench: &Bench, stopwatch: &mut Stopwatch, setting: &Setting| {
        let truth = truth.get_or_init(|| cloud.exact(&DEFAULT, &Rules::NONE));
        let picture = match setting.arithmetic {
            Arithmetic::Kernels if setting.thresholds == DEFAULT.thresholds => {
                cloud.kernels(&bench.gpu, &bench.rasteriser, stopwatch, setting)?
            }
            Arithmetic::Kernels => {
                let rasteriser = Rasteriser::with_thresholds(&bench.gpu, setting.thresholds)?;
                cloud.kernels(&bench.gpu, &rasteriser, stopwatch, setting)?
            }
            Arithmetic::OtherShape => {
                let gpu = other_shape(&bench.gpu)?;
                cloud.kernels(&gpu, &Rasteriser::new(&gpu)?, stopwatch, setting)?
            }
            Arithmetic::Twin => cloud.twin(stopwatch, setting)?,
        };
        let rules = Rules { thresholds: Some(setting.thresholds), three_sigma: setting.three_sigma };
        let [_, rounding] = differences(&picture, &cloud.exact(setting, &rules));
        let [error, _] = differences(&picture, truth);
        Ok(vec![error, rounding])
    };
    let degrees = (0..=3).map(|sh_degree| (sh_degree.to_string(), Setting { sh_degree, ..DEFAULT }));
    let study = Study::new(ABOUT, run)
        .knob(
            "extent rule",
            &DEFAULT,
            [
                ("3 sigma square, in tiles", Setting { three_sigma: true, ..DEFAULT }),
                ("as far as alpha counts", DEFAULT),
            ],
        )
        .knob("SH degree", &DEFAULT, degrees);
    if size == Size::Small {
        return study.component();
    }
    let alpha = |one_in: f32| {
        let thresholds = Thresholds { negligible_alpha: 1.0 / one_in, ..DEFAULT.thresholds };
        (format!("1/{one_in}"), Setting { thresholds, ..DEFAULT })
    };
    let transmittance = |least_transmittance: f32| {
        let thresholds = Thresholds { least_transmittance, ..DEFAULT.thresholds };
        (format!("{least_transmittance:e}"), Setting { thresholds, ..DEFAULT })
    };
    let alphas = [16.0, 32.0, 64.0, 128.0, 255.0, 512.0, 1024.0, 4096.0, 65_536.0];
    study
        .knob("negligible alpha", &DEFAULT, alphas.map(alpha))
        .knob(
            "transmittance at which a pixel is finished",
            &DEFAULT,
            [0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6].map(transmittance),
        )
        .knob(
            "arithmetic",
            &DEFAULT,
            [
                ("f32, the adapter's shape", DEFAULT),
                ("f32, the other shape", Setting { arithmetic: Arithmetic::OtherShape, ..DEFAULT }),
                ("f64, the twin", Setting { arithmetic: Arithmetic::Twin, ..DEFAULT }),
            ],
        )
        .component()
}
