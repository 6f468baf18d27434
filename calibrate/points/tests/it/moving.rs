//! Points of what moves, from silhouettes, in a room where only a ball does.

use erfgs_dataset::Dataset;
use erfgs_points::{CloudOptions, CloudPoint, Method, attach, initial_cloud};
use erfgs_scene::image::ImageRgb8;

use crate::common::{BALL_RADIUS, ball, film_at};

/// The ball moves by its diameter from one to the next.
const PASSING: [i64; 4] = [-250_000_000, 83_333_333, 416_666_667, 750_000_000];

/// The points that are of what moves.
fn moving(dataset: &Dataset, instants: u32, max_points: u32) -> Vec<CloudPoint> {
    let mut options = CloudOptions { method: Method::Random, random_points: 20, ..CloudOptions::default() };
    (options.hull.instants, options.hull.max_points) = (instants, max_points);
    let work = tempfile::tempdir().unwrap();
    let cloud = initial_cloud(dataset, &options, work.path(), &|_, _, _| {}).unwrap();
    assert_eq!(cloud.parameters["moving_points"], cloud.points.len() - 20);
    cloud.points.into_iter().filter(|point| point.track > 0).collect()
}

#[test]
fn points_lie_where_the_ball_was_at_their_time_and_have_its_colour() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film_at(folder.path(), 7, &PASSING);
    let points = moving(&dataset, 4, 2000);
    for t_ns in PASSING {
        let of_time: Vec<_> = points.iter().filter(|point| point.t_ns == t_ns).collect();
        assert!((200..=500).contains(&of_time.len()), "{} points at {t_ns}", of_time.len());
        // A hull of seven views of one side is deeper than the ball.
        let near = of_time.iter().filter(|point| point.position.distance(ball(t_ns)) < 1.5 * BALL_RADIUS).count();
        assert!(near * 10 >= of_time.len() * 7, "{near} of {} near the ball at {t_ns}", of_time.len());
        for camera in &dataset.manifest.cameras[..7] {
            let pose = &camera.world_to_camera;
            let centre = pose.transform(ball(t_ns));
            let widest = (BALL_RADIUS / centre.length()).asin() + 0.03;
            let inside = |point: &&&CloudPoint| pose.transform(point.position).angle_between(centre) < widest;
            let inside = of_time.iter().filter(inside).count();
            assert!(inside * 20 >= of_time.len() * 19, "{inside} of {} in {}", of_time.len(), camera.name);
        }
        let mean = of_time.iter().map(|point| point.position - ball(t_ns)).sum::<glam::DVec3>() / of_time.len() as f64;
        assert!(mean.length() < 0.7 * BALL_RADIUS, "off by {mean} m");
        // The ball is red; walls and floor are nearly grey.
        let red = of_time.iter().filter(|point| f64::from(point.colour[0]) > 1.5 * f64::from(point.colour[2])).count();
        assert!(red * 10 >= of_time.len() * 8, "{red} of {} are red", of_time.len());
    }
}

#[test]
fn the_dataset_tells_which_points_move_and_when() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = film_at(folder.path(), 7, &PASSING);
    let mut options = CloudOptions { method: Method::Random, random_points: 20, ..CloudOptions::default() };
    options.hull.instants = 4;
    let work = tempfile::tempdir().unwrap();
    let cloud = initial_cloud(&dataset, &options, work.path(), &|_, _, _| {}).unwrap();
    attach(&mut dataset, &cloud).unwrap();
    let positions = dataset.read_points().unwrap().unwrap().positions;
    let runs = dataset.point_runs().unwrap().expect("runs");
    let (mut next, mut near, mut moving) = (0, 0, 0);
    for run in &runs {
        for position in &positions[next..next + run.count as usize] {
            let centre = ball(run.t_ns).as_vec3();
            moving += u32::from(run.moving);
            near += u32::from(run.moving && glam::Vec3::from(*position).distance(centre) < 2.0 * BALL_RADIUS as f32);
        }
        next += run.count as usize;
    }
    assert_eq!((next, moving as usize), (positions.len(), positions.len() - 20));
    assert!(near * 10 > moving * 8, "{near} of {moving} where the ball was at their time");

    let file = dataset.manifest.points.as_mut().unwrap();
    file.parameters.insert("runs".into(), serde_json::json!([{"t_ns": 1, "found_again": false, "count": 3}]));
    let error = dataset.point_runs().unwrap_err().to_string();
    assert!(error.contains("do not add up") && error.contains("dataset.json"), "{error}");
}

#[test]
fn nothing_moves_where_the_light_changes_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = film_at(folder.path(), 5, &PASSING);
    for camera in &dataset.manifest.cameras[..5] {
        let path = folder.path().join(&camera.frames[3].file);
        let mut image = ImageRgb8::read(&path).unwrap();
        image.data.iter_mut().for_each(|level| *level = level.saturating_add(60));
        image.write_png(&path).unwrap();
    }
    let points = moving(&dataset, 4, 2000);
    assert!(points.iter().any(|point| point.t_ns == PASSING[1]));
    assert!(points.iter().all(|point| point.t_ns != PASSING[3]));
}
