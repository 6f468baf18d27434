//! Cameras and datasets of the tests.

use std::path::Path;

use erfgs_dataset::{Camera, CameraEvents, Dataset, Manifest, Provenance, Split};
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};

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
