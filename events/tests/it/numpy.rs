//! Archives that NumPy wrote are read.

use erfgs_events::npz;
use erfgs_recordings::shared;

#[test]
fn events_and_luma_that_numpy_wrote_are_read() {
    let Some(path) = shared("reference/v2e/cam5_noiseless.npz") else { return };
    let events = npz::read_events(&path, Some([640, 360])).unwrap();
    // The archive's header: (2,496,884 - 128) / 4 bytes.
    assert_eq!(events.len(), 624_189);
    let on = events.on.iter().filter(|&&on| on).count();
    assert!(on > 100_000 && on < events.len() - 100_000, "{on} are ON");
    // Without a size, the least that holds all.
    let least = npz::read_events(&path, None).unwrap();
    assert_eq!((least.width, least.height), (635, 360));
    let message = npz::read_events(&path, Some([320, 180])).unwrap_err().to_string();
    assert!(message.contains("outside the sensor of 320 x 180"), "{message}");

    let Some(path) = shared("reference/v2e/cam5_luma_frames.npz") else { return };
    let luma = npz::read_luma(&path).unwrap();
    assert_eq!((luma.frames, luma.width, luma.height, luma.iter().len()), (45, 640, 360, 45));
}
