//! What a dataset needs of this machine, before anything of it is read.

use erfgs_base::memory::{self, Shortage};
use erfgs_dataset::{Camera, Dataset, Split};

use super::SceneError;
use crate::config::{Config, MotionModel};

/// Bytes a pixel of an event camera while its events are counted and looked at for flicker: counts so far, counts between two edges,
/// steps, and what is known of its light.
const EVENT_PIXEL: u64 = 64;
/// Bytes a pixel of a frame while it is decoded and compared. What it takes on the device is held against the device's own limits.
const FRAME_PIXEL: u64 = 32;

/// Whether this machine has the memory that a training on the dataset takes at the least.
///
/// # Errors
/// [`SceneError::Memory`] names the camera that takes most of it.
pub(crate) fn check(dataset: &Dataset, config: &Config) -> Result<(), SceneError> {
    let (needed, largest) = needed(dataset, config);
    let Err(shortage) = memory::afford(needed) else { return Ok(()) };
    Err(refusal(dataset, largest, shortage))
}

fn refusal(dataset: &Dataset, largest: Option<&Camera>, shortage: Shortage) -> SceneError {
    let size = largest.map_or([0; 2], |camera| [camera.intrinsics.width, camera.intrinsics.height]);
    let camera = largest.map(|camera| camera.name.clone()).unwrap_or_default();
    SceneError::Memory { path: dataset.root.clone(), camera, size, shortage }
}

/// Bytes, and the camera that takes most of them. Event cameras are read side by side; of frames one is enough.
fn needed<'a>(dataset: &'a Dataset, config: &Config) -> (u64, Option<&'a Camera>) {
    let uses_events = (config.earl.enabled || config.eds.enabled) && config.motion != MotionModel::Still;
    let bytes = |camera: &Camera| {
        let pixels = u64::from(camera.intrinsics.width) * u64::from(camera.intrinsics.height);
        let events = uses_events && camera.split == Split::Train && camera.events.is_some();
        let frames = if camera.frames.is_empty() { 0 } else { pixels.saturating_mul(FRAME_PIXEL) };
        (if events { pixels.saturating_mul(EVENT_PIXEL) } else { 0 }, frames)
    };
    let cameras = || dataset.manifest.cameras.iter();
    let events = cameras().fold(0_u64, |sum, camera| sum.saturating_add(bytes(camera).0));
    let frames = cameras().map(|camera| bytes(camera).1).max().unwrap_or(0);
    (events.saturating_add(frames), cameras().max_by_key(|camera| bytes(camera).0.max(bytes(camera).1)))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::fixtures;

    #[test]
    fn what_is_needed_grows_with_the_pixels_and_is_refused_with_the_camera_that_has_most() {
        let camera = |name: &str, size: [u32; 2]| Camera {
            events: Some(fixtures::events([0, 1])),
            ..fixtures::camera(name, size, 4.0)
        };
        let mut dataset = fixtures::dataset(
            Path::new("ds"),
            vec![camera("small", [640, 480]), camera("large", [60_000, 60_000])],
            [0, 1],
        );
        let config = Config::default();
        let (bytes, largest) = needed(&dataset, &config);
        assert_eq!(bytes, 64 * (640 * 480 + 3_600_000_000));
        assert_eq!(largest.map(|camera| camera.name.as_str()), Some("large"));
        let error = refusal(&dataset, largest, Shortage { needed: bytes, free: 1 << 30 }).to_string();
        for word in ["'large'", "60000 x 60000", "230.4 GB", "1.1 GB", "smaller"] {
            assert!(error.contains(word), "{word}: {error}");
        }
        // More than any machine has.
        let many = dataset.manifest.cameras[1].clone();
        dataset.manifest.cameras.extend(std::iter::repeat_n(many, 4096));
        assert!(matches!(check(&dataset, &config), Err(SceneError::Memory { .. })));
        dataset.manifest.cameras.truncate(1);
        assert!(check(&dataset, &config).is_ok());
        let still = Config { motion: MotionModel::Still, ..config };
        assert_eq!(needed(&dataset, &still).0, 0, "events are not looked at");
    }
}
