//! Which cameras a rig has, where they stand, and what a user writes into its `RIG.toml`.

use std::{fmt::Write as _, sync::Arc};

use erfgs_hardware_mocks::usb::clock::ClockError;
use erfgs_scene::{
    Intrinsics, Modality, Pose,
    rig_file::{RigCamera, RigFile},
};
use erfgs_stage::{RigOptions, StageError};
use glam::{DQuat, DVec3};

use crate::{fault::Fault, film::Film};

/// What is done before the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Act {
    /// A board blinks on a screen; the cameras lie beside each other on a bench.
    Screen,
    /// A wand with three lights is waved on the stage.
    Wand,
    /// The ball is thrown.
    Performance,
    /// The plan's film is shown to each camera.
    Film,
}

/// What a camera is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A UVC camera, which waits for the trigger or runs freely.
    Uvc {
        /// Whether the trigger board makes it take frames.
        triggered: bool,
    },
    /// A Prophesee EVK4.
    Evk4,
    /// An iniVation DAVIS346.
    Davis346,
}

impl Kind {
    /// Whether it sees events.
    #[must_use]
    pub fn sees_events(self) -> bool {
        !matches!(self, Self::Uvc { .. })
    }

    /// Contrast thresholds of ON and OFF events, natural logarithm of intensity: some percent beside what the makers state,
    /// as those of real sensors are.
    #[must_use]
    pub fn thresholds(self) -> [f64; 2] {
        if self == Self::Davis346 { [0.135, 0.21] } else { [0.23, 0.215] }
    }
}

/// A camera of the rig: what it is, and what only calibration can find.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Its name in the rig.
    pub id: String,
    /// What it is.
    pub kind: Kind,
    /// Its serial number.
    pub serial: String,
    /// Its lens.
    pub lens: Intrinsics,
    /// Where it stands on the stage.
    pub place: Pose,
    /// Where it lies on the bench.
    pub bench: Pose,
    /// Error of its crystal.
    pub clock: ClockError,
}

impl Camera {
    /// Where it is during an act.
    #[must_use]
    pub fn pose(&self, act: Act) -> Pose {
        if act == Act::Screen { self.bench } else { self.place }
    }
}

/// A rig and how long its takes are.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The cameras.
    pub cameras: Vec<Camera>,
    /// Pulses of the trigger board, hertz.
    pub rate_hz: f64,
    /// Exposure of the triggered cameras in the performance, microseconds.
    pub exposure_us: f64,
    /// Frames of the cameras that run freely, hertz.
    pub free_hz: f64,
    /// How long the wand is waved, seconds.
    pub wand_s: f64,
    /// Length of the performance, seconds.
    pub performance_s: f64,
    /// How often the screen is held still.
    pub boards: usize,
    /// Sub-pixel rays of frames along each side of a pixel.
    pub samples: u32,
    /// Seed of noise and jitter.
    pub seed: u64,
    /// What goes wrong.
    pub faults: Vec<Fault>,
    /// Whether progress is worth the words: a small rig is done before it can be read.
    pub small: bool,
    /// What is shown in [`Act::Film`].
    pub film: Option<Arc<Film>>,
}

/// Exposure of calibration takes, and of cameras that run freely, microseconds.
pub const SHORT_US: f64 = 4000.0;
/// What the wand's lights blink at, hertz: the board's nearest to 400, 500 and 640.
pub const LEDS_HZ: [f64; 3] = [5000.0 / 13.0, 500.0, 625.0];
/// Gaps between the wand's lights, metres.
pub const WAND_M: [f64; 2] = [0.13, 0.26];
/// The rig stands still for so long before the performance and after it. The recording begins a second earlier.
pub const BEFORE_S: f64 = 0.5;
/// When the performance begins in its recording, seconds.
pub const BEGINS_S: f64 = 1.0 + BEFORE_S;

impl Plan {
    /// The rig of the demo: eight triggered and two free UVC cameras, two EVK4 and a DAVIS346.
    ///
    /// # Errors
    /// If the stage has no room for the cameras.
    pub fn full() -> Result<Self, StageError> {
        Self::of([8, 2, 2], [320, 240], 0.5)
    }

    /// A rig that records in seconds: four triggered and a free UVC camera, an EVK4 and a DAVIS346.
    ///
    /// # Errors
    /// If the stage has no room for the cameras.
    pub fn small() -> Result<Self, StageError> {
        let plan = Self::of([4, 1, 1], [160, 120], 0.3)?;
        Ok(Self { wand_s: 5.0, performance_s: 0.2, boards: 8, samples: 1, small: true, ..plan })
    }

    /// `counts`: UVC cameras that are triggered and free, EVK4. `wide`: focal length of an EVK4 over that of the others.
    fn of([triggered, free, evk4]: [usize; 3], [width, height]: [u32; 2], wide: f64) -> Result<Self, StageError> {
        let frames = RigOptions { width, height, rgb: triggered, event: 0, test: free, ..RigOptions::default() };
        let mut cameras = Vec::new();
        for (index, camera) in frames.cameras(1)?.into_iter().enumerate() {
            let is_triggered = index < triggered;
            let id = if is_triggered { format!("rgb{index}") } else { format!("free{}", index - triggered) };
            let serial = format!("UVC{index:05}");
            cameras.push((id, Kind::Uvc { triggered: is_triggered }, serial, camera));
        }
        let of_size = |[width, height]: [u32; 2]| {
            RigOptions { width, height, rgb: 0, event: evk4 + 1, test: 0, ..RigOptions::default() }.cameras(1)
        };
        // The DAVIS346 stands in the middle of them.
        let middle = evk4.div_ceil(2);
        let small = of_size([346, 260])?;
        for (index, mut camera) in of_size([1280, 720])?.into_iter().enumerate() {
            if index == middle {
                let serial = "00000336".to_owned();
                cameras.push(("davis".to_owned(), Kind::Davis346, serial, small[index].clone()));
                continue;
            }
            camera.intrinsics.fx *= wide;
            camera.intrinsics.fy *= wide;
            let serial = format!("{:08x}", 0x0005_0101 + index);
            cameras.push((format!("event{}", index - usize::from(index > middle)), Kind::Evk4, serial, camera));
        }
        let cameras = cameras.into_iter().enumerate().map(|(index, (id, kind, serial, camera))| Camera {
            id,
            kind,
            serial,
            lens: camera.intrinsics,
            place: camera.world_to_camera,
            bench: bench(index),
            clock: crystal(index),
        });
        Ok(Self { cameras: cameras.collect(), ..Self::empty() })
    }

    /// A rig without a camera.
    pub(crate) fn empty() -> Self {
        Self {
            cameras: Vec::new(),
            rate_hz: 20.0,
            exposure_us: 33_000.0,
            free_hz: 60.0,
            wand_s: 12.0,
            performance_s: 0.5,
            boards: 16,
            samples: 2,
            seed: 1,
            faults: Vec::new(),
            small: false,
            film: None,
        }
    }

    /// How long a take is, seconds.
    #[must_use]
    pub fn seconds(&self, act: Act) -> f64 {
        match act {
            Act::Screen => self.boards as f64 * super::screen::EACH_S + 0.5,
            Act::Wand => self.wand_s,
            Act::Performance => BEFORE_S + self.performance_s + BEFORE_S,
            // It begins with a pulse.
            Act::Film => BEFORE_S + 1.0 / self.rate_hz + self.performance_s + BEFORE_S,
        }
    }

    /// Where the cameras stand, and their lenses, as a calibration without error would tell. `method`: how it is known.
    #[must_use]
    pub fn rig_file(&self, method: &str) -> RigFile {
        let rig_camera = |camera: &Camera| {
            let modality = if camera.kind.sees_events() { Modality::Event } else { Modality::Rgb };
            RigCamera::new(&camera.id, modality, camera.lens, Some(camera.place))
        };
        RigFile::new(method, true, self.cameras.iter().map(rig_camera).collect())
    }

    /// Exposure of a camera in an act, microseconds.
    #[must_use]
    pub fn exposure_us(&self, kind: Kind, act: Act) -> f64 {
        match (act, kind, &self.film) {
            (Act::Performance | Act::Film, Kind::Uvc { triggered: true }, _) => self.exposure_us,
            (Act::Film, Kind::Uvc { triggered: false }, Some(film)) => film.free_exposure_us(),
            _ => SHORT_US,
        }
    }

    /// The rig file of an act, as a user of a real rig would write it.
    #[must_use]
    pub fn rig_toml(&self, act: Act) -> String {
        let mut text = String::from("[rig]\nname = \"emulated\"\n");
        for camera in &self.cameras {
            let Camera { id, serial, lens, kind, .. } = camera;
            let exposure_us = self.exposure_us(*kind, act);
            // Writing to a string does not fail.
            let _ = match kind {
                Kind::Evk4 => writeln!(text, "\n[[evk4]]\nid = \"{id}\"\nserial = \"{serial}\""),
                Kind::Davis346 => writeln!(
                    text,
                    "\n[[davis346]]\nid = \"{id}\"\nserial = \"{serial}\"\nframes = {{ enabled = false }}\nimu = {{ divider = 10 }}"
                ),
                Kind::Uvc { triggered } => writeln!(
                    text,
                    "\n[[camera]]\nid = \"{id}\"\ncamera = \"{serial}\"\nwidth = {}\nheight = {}\nrate_hz = {:.4}\n\
                     exposure_us = {exposure_us:.1}\ntriggered = {triggered}",
                    lens.width, lens.height, self.free_hz
                ),
            };
        }
        let exposure_us = self.exposure_us(Kind::Uvc { triggered: true }, act);
        let leds =
            if act == Act::Wand { LEDS_HZ.map(|hz| format!("{hz:.4}")) } else { [(); 3].map(|()| "\"off\"".into()) };
        let _ = writeln!(
            text,
            "\n[[trigger]]\nid = \"board\"\nport = \"/dev/ttyACM0\"\nrate_hz = {:.4}\nexposure_us = {exposure_us:.1}\n\
             leds = [{}]",
            self.rate_hz,
            leds.join(", ")
        );
        text
    }
}

/// The error of the crystal of a camera: up to 45 parts in a million, and drifting.
pub(crate) fn crystal(index: usize) -> ClockError {
    let spread = |step: usize| ((index * step) % 11) as f64 - 5.0;
    ClockError { offset_ppm: 9.0 * spread(7), drift_ppm_per_min: 0.1 * spread(3), ..ClockError::default() }
}

/// Beside each other on a bench, some centimetres apart and not quite parallel.
fn bench(index: usize) -> Pose {
    let (column, row) = ((index % 5) as f64 - 2.0, (index / 5) as f64 - 1.0);
    let eye = DVec3::new(0.03 * column, 0.03 * row, 0.0);
    let turn = DQuat::from_scaled_axis(DVec3::new(0.02 * row, -0.015 * column, 0.01 * column));
    Pose { rotation: turn, translation: -(turn * eye) }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use erfgs_recorder::RigConfig;

    use super::*;

    #[test]
    fn the_rig_files_are_those_of_the_recorder() {
        for plan in [Plan::full().unwrap(), Plan::small().unwrap()] {
            for act in [Act::Screen, Act::Wand, Act::Performance] {
                let rig = RigConfig::parse(&plan.rig_toml(act), Path::new("RIG.toml")).unwrap();
                assert_eq!(rig.devices.len(), plan.cameras.len() + 1);
            }
        }
    }
}
