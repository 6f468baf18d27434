//! Bundle adjustment: what the loss, the iterations and the way to solve the cameras' system cost and give.

use std::sync::{Arc, Mutex, PoisonError};

use erfgs_base::random::{extend, key, normal, purpose, uniform};
use erfgs_calibrate::{
    bundle::{Bundle, BundleCamera, Loss, Method, Observation, Options, Parameter, Placement, free_lens},
    geometry::angle,
};
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DQuat, DVec2, DVec3};

use crate::{Bench, Component, Measure, Result, Size, Stopwatch, Study, component::About};

const ABOUT: About = About {
    name: "bundle adjustment",
    truth: "Cameras on an arc of 2.5 m see a board of 6 x 4 corners at many places, each corner off by 0.2 pixels (standard deviation) \
            and one in fifty by up to 30 pixels; poses start off by 5 cm and 3 degrees, focal lengths by 2 %. The truth is the rig that \
            the corners were projected with.",
    work: "the adjustment",
    measures: &[
        Measure { name: "error of a camera's centre, root mean square", unit: "mm", logarithmic: true },
        Measure { name: "error of its orientation, root mean square", unit: "mdeg", logarithmic: true },
        Measure { name: "error of its focal length, root mean square", unit: "px", logarithmic: true },
    ],
};

#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    rig: Rig,
    options: Options,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Rig {
    cameras: usize,
    boards: usize,
    /// Share of corners that are elsewhere.
    wrong: f64,
}

const PURPOSE: u64 = purpose("precision rig");
const SIGMA_PX: f64 = 0.2;

fn vector(index: u64, word: u64, size: f64) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|axis| size * normal(key(4, &[PURPOSE, index, word, axis]))))
}

impl Rig {
    fn cameras(&self) -> Vec<BundleCamera> {
        let camera = |index: usize| {
            let turn = 1.6 * (index as f64 / (self.cameras - 1) as f64 - 0.5);
            let height = -0.4 - 0.5 * (index % 3) as f64;
            let eye = DVec3::new(2.5 * turn.sin(), height, -2.5 * turn.cos());
            let mut free = free_lens(2);
            if index > 0 {
                free.extend(Parameter::POSE);
            }
            let focal = 900.0 + 10.0 * vector(index as u64, 1, 1.0).x;
            let distortion = Distortion::BrownConrady([-0.1, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
            let intrinsics =
                Intrinsics { width: 1280, height: 720, fx: focal, fy: focal, cx: 640.0, cy: 360.0, distortion };
            BundleCamera {
                name: format!("{index}"),
                intrinsics,
                pose: Pose::look_at(eye, vector(index as u64, 2, 0.05), DVec3::Y),
                time_offset_s: 0.0,
                free,
            }
        };
        (0..self.cameras).map(camera).collect()
    }

    /// What the cameras saw, and where they are.
    fn observed(&self) -> (Bundle, Vec<BundleCamera>) {
        let truth = self.cameras();
        let mut bundle = Bundle { cameras: truth.clone(), ..Bundle::default() };
        for board in 0..self.boards {
            let number = board as u64;
            let turn = DQuat::from_scaled_axis(vector(number, 3, 0.4));
            let pose = Pose { rotation: turn, translation: vector(number, 4, 0.35) };
            bundle.placements.push(Placement::Board(pose));
            for corner in 0..24_u64 {
                let on_target = DVec3::new(0.08 * (corner % 6) as f64 - 0.2, 0.08 * (corner / 6) as f64 - 0.12, 0.0);
                for (camera, state) in truth.iter().enumerate() {
                    let at = key(5, &[PURPOSE, number, corner, camera as u64]);
                    self.see(&mut bundle, (camera, state), board, on_target, at);
                }
            }
        }
        for (index, camera) in bundle.cameras.iter_mut().enumerate() {
            let number = index as u64;
            if index > 0 {
                camera.pose.rotation *= DQuat::from_scaled_axis(vector(number, 5, 0.05 / 3_f64.sqrt()));
                camera.pose.translation += vector(number, 6, 0.05 / 3_f64.sqrt());
            }
            let longer = 1.0 + vector(number, 7, 0.02).x;
            (camera.intrinsics.fx, camera.intrinsics.fy) =
                (longer * camera.intrinsics.fx, longer * camera.intrinsics.fy);
        }
        for (index, placement) in bundle.placements.iter_mut().enumerate() {
            if let Placement::Board(pose) = placement {
                pose.rotation *= DQuat::from_scaled_axis(vector(index as u64, 8, 0.03));
                pose.translation += vector(index as u64, 9, 0.03);
            }
        }
        (bundle, truth)
    }

    fn see(
        &self,
        bundle: &mut Bundle,
        (camera, state): (usize, &BundleCamera),
        placement: usize,
        on_target: DVec3,
        at: u64,
    ) {
        let world = bundle.placements[placement].world(on_target);
        let Some(pixel) = state.intrinsics.project(state.pose.transform(world)) else { return };
        let inside = (0.0..1280.0).contains(&pixel.x) && (0.0..720.0).contains(&pixel.y);
        if !inside {
            return;
        }
        let noise = DVec2::new(normal(extend(at, 0)), normal(extend(at, 1)));
        let away = DVec2::new(uniform(extend(at, 2)) - 0.5, uniform(extend(at, 3)) - 0.5);
        let wrong = if uniform(extend(at, 4)) < self.wrong { 60.0 } else { 0.0 };
        bundle.observations.push(Observation {
            camera,
            placement,
            on_target,
            side: None,
            pixel: pixel + SIGMA_PX * noise + wrong * away,
            sigma_px: SIGMA_PX,
            velocity: DVec2::ZERO,
            used: true,
        });
    }
}

fn errors(bundle: &Bundle, truth: &[BundleCamera]) -> Vec<f64> {
    let pairs = || bundle.cameras.iter().zip(truth);
    let rms = |sum: f64, count: usize| (sum / count as f64).sqrt();
    // The first camera is where the world begins.
    let centre = pairs().map(|(found, truth)| found.pose.centre().distance_squared(truth.pose.centre())).sum();
    let turn = pairs().map(|(found, truth)| angle(found.pose.rotation, truth.pose.rotation).to_degrees().powi(2)).sum();
    let focal = pairs().map(|(found, truth)| (found.intrinsics.fx - truth.intrinsics.fx).powi(2)).sum();
    vec![1e3 * rms(centre, truth.len() - 1), 1e3 * rms(turn, truth.len() - 1), rms(focal, truth.len())]
}

/// The problem of the rig that was last asked for: settings of one rig follow each other.
type Last = Option<(Rig, Arc<(Bundle, Vec<BundleCamera>)>)>;

/// The knobs of the adjustment.
#[must_use]
pub fn component(size: Size) -> Component {
    let last: Mutex<Last> = Mutex::default();
    let run = move |_: &Bench, stopwatch: &mut Stopwatch, setting: &Setting| -> Result<Vec<f64>> {
        let observed = {
            let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
            match &*last {
                Some((rig, observed)) if *rig == setting.rig => observed.clone(),
                _ => last.insert((setting.rig, Arc::new(setting.rig.observed()))).1.clone(),
            }
        };
        let (bundle, truth) = &*observed;
        let solved = stopwatch.time(|| {
            let mut bundle = bundle.clone();
            bundle.solve(&setting.options)?;
            Ok(bundle)
        })?;
        Ok(errors(&solved, truth))
    };
    // What all calibrations begin with.
    let options = Options { loss: Loss::Cauchy(3.0), ..Options::default() };
    let few = size == Size::Small;
    let rig =
        if few { Rig { cameras: 3, boards: 8, wrong: 0.02 } } else { Rig { cameras: 8, boards: 40, wrong: 0.02 } };
    let default = Setting { rig, options };
    let iterations = [1, 2, 3, 4, 5, 7, 10, 20, 100];
    let iterations = iterations.into_iter().filter(|of| !few || [2, 100].contains(of));
    let study = Study::new(ABOUT, run).knob(
        "most iterations",
        &default,
        iterations
            .map(|iterations| (iterations.to_string(), Setting { options: Options { iterations, ..options }, rig })),
    );
    if few {
        return study.component();
    }
    let loss = |name: &str, loss: Loss| (name.to_owned(), Setting { options: Options { loss, ..options }, rig });
    let cauchy = |width: f64| loss(&format!("Cauchy {width}"), Loss::Cauchy(width));
    let losses = [0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0].map(cauchy).into_iter().chain([loss("squares", Loss::Squared)]);
    let clean = Rig { wrong: 0.0, ..rig };
    let on_clean = |(name, setting): (String, Setting)| (name, Setting { rig: clean, ..setting });
    let by = |rig: Rig| {
        let of = |method: Method| Setting { rig, options: Options { method, ..options } };
        [
            ("by size", of(Method::Auto)),
            ("factored", of(Method::Cholesky)),
            ("conjugate gradients", of(Method::ConjugateGradients)),
        ]
    };
    let tolerances = [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13];
    study
        .knob(
            "least share by which a step lowers the cost",
            &default,
            tolerances.map(|tolerance| {
                (format!("{tolerance:.0e}"), Setting { options: Options { tolerance, ..options }, rig })
            }),
        )
        .knob("loss, one corner in fifty is wrong", &default, losses.clone())
        .knob("the cameras' system, 8 cameras", &default, by(rig))
        .knob("loss, no corner is wrong", &on_clean((String::new(), default)).1, losses.map(on_clean))
        .component()
}
