//! Initial clouds of a small rendered room, whose surfaces are known.

mod bodies;
mod common;
mod moving;

use std::{fs, sync::Mutex};

use common::{BALL_RADIUS, HALF, TIMES, ball, distance_from_surface, film};
use erfgs_dataset::Dataset;
use erfgs_points::{
    Cloud, CloudError, CloudOptions, CloudPoint, CloudStep, ColmapProgram, FrameChoice, Method, attach, initial_cloud,
};
use erfgs_scene::{Distortion, image::ImageRgb8};
use glam::DVec3;

fn cloud(dataset: &Dataset, options: &CloudOptions) -> Result<Cloud, CloudError> {
    let work = tempfile::tempdir().unwrap();
    let cloud = initial_cloud(dataset, options, &work.path().join("deep/er"), &|_, _, _| {});
    let deep = work.path().join("deep/er");
    let left = if deep.exists() { fs::read_dir(deep).unwrap().count() } else { 0 };
    assert_eq!(left, 0, "intermediate files are left");
    cloud
}

/// All points, and depth maps of a quarter of the pixels, which are much sooner made.
fn options(method: Method) -> CloudOptions {
    let mut options = CloudOptions { method, max_points: None, ..CloudOptions::default() };
    options.sweep.max_width = 160;
    options
}

/// The share of points within `tolerance` metres of a surface.
fn share_right(cloud: &Cloud, tolerance: f64) -> f64 {
    let right = cloud.points.iter().filter(|p| distance_from_surface(p.position, p.t_ns) < tolerance).count();
    right as f64 / cloud.points.len() as f64
}

fn check_colmap(program: ColmapProgram) {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film(folder.path(), 6);
    let mut options = options(Method::Colmap);
    options.colmap.program = program;
    let cloud = cloud(&dataset, &options).unwrap();
    assert!(cloud.points.len() > 600, "{} points", cloud.points.len());
    assert!(share_right(&cloud, 0.02) > 0.97, "{}", share_right(&cloud, 0.02));
    assert!(cloud.points.iter().all(|point| point.track >= 3 && point.reprojection_error_px < 2.0));
    for t_ns in TIMES {
        let on_ball: Vec<_> = cloud
            .points
            .iter()
            .filter(|p| (p.position.distance(ball(t_ns)) - BALL_RADIUS).abs() < 0.02 && p.position.y < -0.1)
            .collect();
        assert!(on_ball.len() >= 10, "{} points on the ball at {t_ns} ns", on_ball.len());
        let its_own = on_ball.iter().filter(|point| point.t_ns == t_ns && point.instants == 1).count();
        assert!(its_own * 10 >= on_ball.len() * 9, "{its_own} of {} know their time", on_ball.len());
    }
    let still = cloud.points.iter().filter(|point| point.instants == 2).count();
    assert!(still * 3 > cloud.points.len(), "{still} of {} were found at both instants", cloud.points.len());
}

#[test]
fn colmap_finds_surfaces_and_knows_when_the_ball_was_where() {
    check_colmap(ColmapProgram::Auto);
}

#[test]
fn pycolmap_does_the_same() {
    check_colmap(ColmapProgram::Pycolmap(Some(erfgs_recordings::python())));
}

#[test]
fn the_sweep_covers_floor_and_walls_the_same_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film(folder.path(), 6);
    let options = options(Method::Sweep);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cloud(&dataset, &options).unwrap())
    };
    let found = on(1);
    assert_eq!(found, on(3));
    assert!(found.points.len() > 1500, "{} points", found.points.len());
    assert!(share_right(&found, 0.06) > 0.93, "{}", share_right(&found, 0.06));
    let on_floor = found.points.iter().filter(|p| p.position.y.abs() < 0.05).count();
    assert!(on_floor > 250, "{on_floor} points on the floor");
    assert!(found.points.iter().all(|point| point.track >= 3));
}

#[test]
fn colours_are_those_of_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film(folder.path(), 4);
    let cloud = cloud(&dataset, &options(Method::Sweep)).unwrap();
    // Walls and floor are g = 0.2 + 0.6 r (of 1); the ball is not.
    let walls: Vec<_> = cloud.points.iter().filter(|p| p.position.distance(ball(p.t_ns)) > 0.4).collect();
    let right = walls.iter().filter(|p| {
        let [r, g, _] = p.colour.map(f64::from);
        (g - (51.0 + 0.6 * r)).abs() < 12.0
    });
    assert!(right.count() * 10 > walls.len() * 9);
}

#[test]
fn the_union_keeps_colmaps_points_and_its_limit_and_tells_every_step_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film(folder.path(), 5);
    // Fewer points than of enlarged images are enough to tell whether they are kept.
    let options = |method: Method| {
        let mut options = options(method);
        options.colmap.enlarge = 1;
        options
    };
    let colmap = cloud(&dataset, &options(Method::Colmap)).unwrap();
    let limit = colmap.points.len() + 800;
    let union = CloudOptions { max_points: Some(limit), ..options(Method::ColmapSweep) };
    let (work, seen) = (tempfile::tempdir().unwrap(), Mutex::new(Vec::new()));
    let union = initial_cloud(&dataset, &union, work.path(), &|step, done, total| {
        assert!(done <= total);
        seen.lock().unwrap().push((step, done == total));
    })
    .unwrap();
    let seen = seen.into_inner().unwrap();
    for step in [
        CloudStep::Images,
        CloudStep::Features,
        CloudStep::Matching,
        CloudStep::Triangulation,
        CloudStep::Sweep,
        CloudStep::Fusion,
    ] {
        assert!(seen.contains(&(step, true)), "{step} never ends");
    }
    assert!(union.points.len() <= limit && union.points.len() > limit - 300, "{}", union.points.len());
    // COLMAP's threads add in another order each time, which decides what is just good enough.
    let kept = |point: &&CloudPoint| union.points.iter().any(|other| other.position.distance(point.position) < 1e-3);
    let kept = colmap.points.iter().filter(kept).count();
    assert!(kept * 20 > colmap.points.len() * 19, "{kept} of {}", colmap.points.len());
    let mut dataset = dataset;
    let file = attach(&mut dataset, &union).unwrap();
    let runs = dataset.point_runs().unwrap().expect("runs");
    assert_eq!(Some(&runs), file.runs().unwrap().as_ref());
    let times: Vec<_> = runs.iter().flat_map(|run| vec![(run.t_ns, run.found_again); run.count as usize]).collect();
    let found: Vec<_> = union.points.iter().map(|point| (point.t_ns, point.instants > 1)).collect();
    assert_eq!(times, found, "the manifest tells the time of every point");
}

#[test]
fn random_points_fill_the_box_and_follow_the_seed() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film(folder.path(), 3);
    let mut options = options(Method::Random);
    options.random_points = 2000;
    options.bounds_m = Some([[-1.0, -1.0, -1.0], [1.0, 0.0, 1.5]]);
    let one = cloud(&dataset, &options).unwrap();
    assert_eq!(one.points.len(), 2000);
    assert_eq!(one, cloud(&dataset, &options).unwrap());
    for point in &one.points {
        assert!(point.position.cmpge(DVec3::new(-1.0, -1.0, -1.0)).all());
        assert!(point.position.cmplt(DVec3::new(1.0, 0.0, 1.5)).all());
    }
    options.seed = 1;
    assert_ne!(one.points[0].position, cloud(&dataset, &options).unwrap().points[0].position);
    options.bounds_m = None;
    let spread = cloud(&dataset, &options).unwrap();
    assert!(spread.points.iter().any(|point| point.position.z > 0.8 * HALF), "the far wall is in the box");
    options.bounds_m = Some([[1.0; 3], [0.0; 3]]);
    assert!(cloud(&dataset, &options).unwrap_err().to_string().contains("bounds_m"));
    options.bounds_m = Some([[0.0, 50.0, 0.0], [1.0, 51.0, 1.0]]);
    let nowhere = cloud(&dataset, &options).unwrap_err();
    assert!(matches!(nowhere, CloudError::TooFewPoints { found: 0, .. }), "{nowhere}");
}

#[test]
fn a_cloud_is_attached_to_its_dataset_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = film(folder.path(), 3);
    // Cameras without files cannot be loaded again.
    dataset.manifest.cameras.truncate(3);
    let mut options = options(Method::Random);
    options.random_points = 50;
    let cloud = cloud(&dataset, &options).unwrap();
    let file = attach(&mut dataset, &cloud).unwrap();
    assert_eq!((file.count, file.method.as_str()), (50, "random"));
    let loaded = Dataset::load(folder.path()).unwrap();
    assert_eq!(loaded.manifest.points.as_ref(), Some(&file));
    let points = loaded.read_points().unwrap().unwrap();
    assert_eq!(points.positions[7], cloud.points[7].position.as_vec3().to_array());
    assert_eq!(points.colours[7], cloud.points[7].colour);
    dataset.hash_files().unwrap();
    attach(&mut dataset, &cloud).unwrap();
    Dataset::load(folder.path()).unwrap().verify().unwrap();
}

#[test]
fn black_images_and_missing_frames_and_programs_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film(folder.path(), 3);
    let mut options = options(Method::Colmap);
    options.frames = FrameChoice::Spread(1);
    options.colmap.program = ColmapProgram::Binary("no/such/colmap".into());
    let missing = cloud(&dataset, &options).unwrap_err();
    assert!(matches!(missing, CloudError::ColmapMissing { .. }), "{missing}");
    options.colmap.program = ColmapProgram::Auto;
    for camera in &dataset.manifest.cameras[..3] {
        for frame in &camera.frames {
            ImageRgb8::new(320, 240).write_png(&folder.path().join(&frame.file)).unwrap();
        }
    }
    let black = cloud(&dataset, &options).unwrap_err();
    assert!(matches!(black, CloudError::TooFewFeatures { found: 0, images: 3 }), "{black}");
    options.method = Method::Sweep;
    let black = cloud(&dataset, &options).unwrap_err();
    assert!(matches!(black, CloudError::TooFewPoints { found: 0, .. }), "{black}");
    fs::remove_file(folder.path().join(&dataset.manifest.cameras[1].frames[1].file)).unwrap();
    let gone = cloud(&dataset, &options).unwrap_err().to_string();
    assert!(gone.contains("view_1") && gone.contains("0001.png"), "{gone}");
}

#[test]
fn distorted_images_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = film(folder.path(), 3);
    dataset.manifest.cameras[2].intrinsics.distortion =
        Distortion::BrownConrady([0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for method in Method::ALL {
        let message = cloud(&dataset, &options(method)).unwrap_err().to_string();
        assert!(message.contains("view_2") && message.contains("distorted"), "{message}");
    }
}
