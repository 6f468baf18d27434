//! Cameras and datasets of the tests.

use std::path::Path;

use erfgs_dataset::{Camera, CameraEvents, Dataset, Frame, Manifest, Provenance, Split};
use erfgs_events::{Event, Events};
use erfgs_scene::{Distortion, ImageRgb8, Intrinsics, Modality, Pose};

use super::{Bins, EventView, events::EventCounter};
use crate::config::EarlConfig;

/// A training camera at the origin that looks along z, without frames and events: `focal` pixels, its axis in the middle.
pub(crate) fn camera(name: &str, [width, height]: [u32; 2], focal: f64) -> Camera {
    let [cx, cy] = [width, height].map(|size| f64::from(size) / 2.0);
    Camera {
        name: name.into(),
        modality: Modality::Rgb,
        split: Split::Train,
        intrinsics: Intrinsics { width, height, fx: focal, fy: focal, cx, cy, distortion: Distortion::None },
        world_to_camera: Pose::IDENTITY,
        pose_sigma: None,
        clock_sigma_s: None,
        frames: Vec::new(),
        events: None,
    }
}

/// Events of a camera, none of which is in a file.
pub(crate) fn events(covers_ns: [i64; 2]) -> CameraEvents {
    CameraEvents {
        file: "e.npz".into(),
        count: 0,
        threshold_on: 0.2,
        threshold_off: 0.2,
        lin_log_threshold: 20.0,
        linear_light: false,
        covers_ns,
        simulator: None,
    }
}

/// The events of a camera of so many pixels: pixel and polarity of those of each bin, a millisecond long. `flickers` is whether pixels
/// tell of their own thresholds.
pub(crate) fn seen([width, height]: [u32; 2], bins: &[Vec<(usize, bool)>], flickers: bool) -> EventView {
    let end_ns = 1_000_000 * bins.len() as i64;
    let mut camera = Camera { events: Some(events([0, end_ns])), ..camera("e", [width, height], 4.0) };
    let file = camera.events.as_mut().expect("events");
    (file.threshold_on, file.threshold_off) = (0.25, 0.2);
    let earl = EarlConfig { denoise: false, ..crate::config::Config::default().earl };
    let mut all = Events::new(width, height);
    for (t_us, &(pixel, on)) in (0..).zip(bins).flat_map(|(bin, of)| of.iter().map(move |one| (1000 * bin + 500, one)))
    {
        let (x, y) = ((pixel % width as usize) as u16, (pixel / width as usize) as u16);
        all.push(Event { t_us, x, y, on });
    }
    let bins = Bins::new(&[0, end_ns], bins.len(), [0, end_ns], end_ns);
    let counter = EventCounter::new(0, &camera, &bins, &earl, flickers, None).expect("memory");
    let mut counter = counter.expect("an event camera");
    counter.add(&all).expect("memory");
    counter.finish().expect("memory")
}

/// A dataset of one camera of 4 x 2 pixels, whose frames are of one colour each: their index, 1 and 2.
pub(crate) fn painted(root: &Path, frames: usize) -> Dataset {
    let frame = |index: usize| {
        let name = format!("{index}.png");
        let data = [index as u8, 1, 2].repeat(8);
        ImageRgb8 { width: 4, height: 2, data }.write_png(&root.join(&name)).expect("written");
        Frame { file: name.into(), t_ns: index as i64, exposure_ns: [index as i64; 2], mask: None }
    };
    let camera = Camera { frames: (0..frames).map(frame).collect(), ..camera("a", [4, 2], 4.0) };
    dataset(root, vec![camera], [0, frames as i64])
}

/// A dataset of these cameras in a folder, which it does not write.
pub(crate) fn dataset(root: &Path, cameras: Vec<Camera>, span_ns: [i64; 2]) -> Dataset {
    let manifest = Manifest {
        format: Manifest::FORMAT.into(),
        version: Manifest::VERSION,
        name: "test".into(),
        provenance: Provenance::default(),
        span_ns,
        seed: 0,
        variant: Vec::new(),
        linear_exposure: false,
        points: None,
        bodies: None,
        cameras,
        sha256: Default::default(),
    };
    Dataset::new(root, manifest)
}
