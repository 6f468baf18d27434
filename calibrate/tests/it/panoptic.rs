//! The initial cloud of a real rig: one frame of the Panoptic basketball scene.

use erfgs_dataset::import::{ImportOptions, Layout, import};
use erfgs_points::{CloudOptions, Method, initial_cloud};
use erfgs_recordings::shared;
use glam::DVec3;

#[test]
fn known_pose_matching_finds_the_dome_and_the_floor() {
    let Some(source) = shared("data/panoptic_basketball") else { return };
    let folder = tempfile::tempdir().unwrap();
    let import_options = ImportOptions { frames: Some((40, 40)), ..ImportOptions::default() };
    let dataset =
        import(Layout::Panoptic, &source, &import_options, &folder.path().join("ds"), &mut |_| {}).unwrap().dataset;
    let mut options = CloudOptions { method: Method::Colmap, max_points: None, ..CloudOptions::default() };
    options.colmap.enlarge = 1;
    let cloud = initial_cloud(&dataset, &options, folder.path(), &|_, _, _| {}).unwrap();
    // COLMAP's own matching finds 390 to 410 such points in these images.
    assert!(cloud.points.len() > 800, "{} points", cloud.points.len());
    let error: f32 = cloud.points.iter().map(|point| point.reprojection_error_px).sum();
    assert!(error / (cloud.points.len() as f32) < 1.0, "mean error {} px", error / cloud.points.len() as f32);
    // A sphere fitted to the wall's panels, and the floor that the people stand on.
    let background = cloud.points.iter().filter(|point| {
        let from_dome = point.position.distance(DVec3::new(0.0, -1.24, -0.04)) - 2.757;
        from_dome.abs() < 0.2 || (point.position.y.abs() < 0.08 && from_dome < 0.0)
    });
    let share = background.count() as f64 / cloud.points.len() as f64;
    // The people and the ball hold about two fifths of the points at this size.
    assert!((0.45..0.85).contains(&share), "{share} on dome and floor");
}
