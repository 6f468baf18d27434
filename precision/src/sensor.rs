//! The event simulator: what the step between frames, the update of the low-pass and the interpolation of times cost and save.

use std::sync::{Arc, OnceLock};

use erfgs_events::Events;
use erfgs_replay::{Luma, Mode, Simulator, SimulatorConfig};
use erfgs_stability::pixel::Pixel;
use erfgs_stage::{
    RigOptions, Stage, StageOptions, StageView,
    colour::{encode, luma},
    motion::Ball,
};
use glam::DVec3;

use crate::{
    Bench, Component, Measure, Result, Size, Stopwatch, Study,
    component::About,
    matching::{Fired, Matched},
};

const ABOUT: About = About {
    name: "event simulator",
    truth: "An event camera before the stage while the ball flies past. The truth is the stage's intensity every 20 µs, through a \
            pixel in `f64`; an event of the simulator and one of the truth belong together where polarity and pixel agree and they \
            are less than 10 ms apart. The step is that of the recording and has no default of its own: 1000 frames a second are \
            marked.",
    work: "the simulation of all frames; they are rendered before",
    measures: &[
        Measure { name: "error of an event's time, root mean square", unit: "µs", logarithmic: true },
        Measure { name: "missed events", unit: "% of the true ones", logarithmic: false },
        Measure { name: "false events", unit: "% of the true ones", logarithmic: false },
    ],
};

#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    mode: Mode,
    /// Frames a second.
    fps: u32,
    cutoff_hz: f64,
    /// Whether grey levels are whole.
    whole: bool,
}

const DEFAULT: Setting = Setting { mode: Mode::Parity, fps: 1000, cutoff_hz: 0.0, whole: true };
const LOW_PASS_HZ: f64 = 100.0;
/// The times of the truth, frames a second.
const FINE: u32 = 50_000;

/// What a small camera on the stage sees.
struct Film {
    size: [u32; 2],
    /// Grey levels, 0 to 255, of each pixel every 1 / [`FINE`] seconds.
    frames: Vec<Vec<f32>>,
}

impl Film {
    /// So many seconds of the ball's flight.
    fn new(width: u32, height: u32, seconds: f64) -> Result<Self> {
        let stage = Stage::new(StageOptions::default());
        let rig = RigOptions { width, height, rgb: 0, event: 1, test: 0, ..RigOptions::default() };
        let camera = &rig.cameras(1)?[0];
        let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera)?;
        let start = 0.5 * Ball::default().flight_seconds();
        let frame = |index: usize| {
            let t_ns = (1e9 * (start + index as f64 / f64::from(FINE))).round() as i64;
            // The light grows by a fiftieth: where a pixel comes back to just what it was, a whole number of thresholds away, rounding
            // alone would decide whether there is an event.
            let light = 1.0 + 0.02 * index as f64 / (seconds * f64::from(FINE));
            let level = |linear: &[f32; 3]| {
                let grey = luma(DVec3::from(linear.map(|value| encode(f64::from(value)))));
                (light * 255.0 * grey).min(255.0) as f32
            };
            view.frame(t_ns).iter().map(level).collect()
        };
        Ok(Self { size: [width, height], frames: (0..=(seconds * f64::from(FINE)) as usize).map(frame).collect() })
    }

    /// The events of each pixel, from the intensity itself.
    fn truth(&self, cutoff_hz: f64) -> Vec<Vec<Fired>> {
        let threshold = SimulatorConfig::default().threshold_on;
        let pixel = Pixel { threshold, cutoff_hz, refractory_s: 0.0 };
        let events = |index: usize| {
            let seen = self.frames.iter().enumerate();
            let seen: Vec<(f64, f64)> =
                seen.map(|(k, levels)| (k as f64 / f64::from(FINE), f64::from(levels[index]))).collect();
            pixel.events(&seen).iter().map(|event| Fired { t_us: 1e6 * event.time, on: event.on }).collect()
        };
        (0..(self.size[0] * self.size[1]) as usize).map(events).collect()
    }

    /// The events of each pixel by the simulator.
    fn simulate(&self, stopwatch: &mut Stopwatch, setting: &Setting) -> Result<Vec<Vec<Fired>>> {
        let [width, height] = self.size;
        let config = SimulatorConfig { mode: setting.mode, cutoff_hz: setting.cutoff_hz, ..SimulatorConfig::default() };
        let step = (FINE / setting.fps) as usize;
        let t_ns = |index: usize| (1e9 * (index * step) as f64 / f64::from(FINE)).round() as i64;
        let frames: Vec<&Vec<f32>> = self.frames.iter().step_by(step).collect();
        let whole: Vec<Vec<u8>> =
            frames.iter().map(|frame| frame.iter().map(|level| level.round() as u8).collect()).collect();
        let events = stopwatch.time(|| {
            let mut simulator = Simulator::new(width, height, &config, 0)?;
            let mut events = Events::new(width, height);
            for (index, (levels, whole)) in frames.iter().zip(&whole).enumerate() {
                let luma = if setting.whole { Luma::U8(whole) } else { Luma::F32(levels) };
                simulator.step(luma, t_ns(index), &mut events)?;
            }
            Ok(events)
        })?;
        let mut by_pixel = vec![Vec::new(); (width * height) as usize];
        for event in events.iter() {
            let index = usize::from(event.y) * width as usize + usize::from(event.x);
            by_pixel[index].push(Fired { t_us: event.t_us as f64, on: event.on });
        }
        Ok(by_pixel)
    }
}

/// What is computed once: the film, and the true events without and with the low-pass.
struct Truth {
    film: Film,
    events: [Vec<Vec<Fired>>; 2],
}

/// The simulator's knobs.
#[must_use]
pub fn component(size: Size) -> Component {
    let truth: Arc<OnceLock<std::result::Result<Truth, String>>> = Arc::default();
    let run = move |_: &Bench, stopwatch: &mut Stopwatch, setting: &Setting| {
        let truth = truth.get_or_init(|| {
            let film = match size {
                Size::Small => Film::new(24, 18, 0.02),
                Size::Full => Film::new(96, 72, 0.1),
            };
            let film = film.map_err(|error| error.to_string())?;
            Ok(Truth { events: [film.truth(0.0), film.truth(LOW_PASS_HZ)], film })
        });
        let Truth { film, events } = truth.as_ref().map_err(Clone::clone)?;
        let computed = film.simulate(stopwatch, setting)?;
        let matched = Matched::of(&events[usize::from(setting.cutoff_hz > 0.0)], &computed);
        let of_true = |count: usize| 100.0 * count as f64 / matched.truths() as f64;
        Ok(vec![matched.rms_us(), of_true(matched.missed), of_true(matched.false_ones)])
    };
    let rates = match size {
        Size::Small => vec![500, 1000, 5000],
        Size::Full => vec![50, 100, 200, 500, 1000, 2000, 5000, 10_000],
    };
    let steps = |base: Setting| {
        let rates = rates.clone().into_iter();
        rates.map(move |fps| (format!("{fps} /s"), Setting { fps, ..base }))
    };
    let enhanced = Setting { mode: Mode::Enhanced, ..DEFAULT };
    let study = Study::new(ABOUT, run)
        .knob("frames a second, parity", &DEFAULT, steps(DEFAULT))
        .knob("frames a second, enhanced", &enhanced, steps(enhanced))
        .knob(
            "interpolation of times",
            &DEFAULT,
            [("parity: a grid for all pixels", DEFAULT), ("enhanced: each pixel its own", enhanced)],
        );
    if size == Size::Small {
        return study.component();
    }
    let filtered = Setting { cutoff_hz: LOW_PASS_HZ, ..DEFAULT };
    let filtered_exactly = Setting { cutoff_hz: LOW_PASS_HZ, ..enhanced };
    let unrounded = |of: Setting| Setting { whole: false, ..of };
    study
        .knob("frames a second, low-pass of 100 Hz by v2e's step (parity)", &filtered, steps(filtered))
        .knob(
            "frames a second, low-pass of 100 Hz by its exact response (enhanced)",
            &filtered_exactly,
            steps(filtered_exactly),
        )
        .knob("grey levels, parity", &DEFAULT, [("whole", DEFAULT), ("unrounded", unrounded(DEFAULT))])
        .knob("grey levels, enhanced", &enhanced, [("whole", enhanced), ("unrounded", unrounded(enhanced))])
        .component()
}
