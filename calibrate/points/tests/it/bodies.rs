//! Bodies of a room where only a ball moves, which does not turn and has no events.

use erfgs_dataset::{Dataset, Split};
use erfgs_points::{
    BodyEdits, BodyOptions, BodyStep, CloudError, CloudOptions, Method, attach, attach_bodies, find_bodies,
    initial_cloud,
};
use glam::DVec3;

use crate::common::{BALL_RADIUS, ball, film_at};

/// The ball moves by its radius from one to the next.
const TIMES: [i64; 7] = [-200_000_000, -33_333_333, 133_333_333, 300_000_000, 466_666_667, 633_333_333, 800_000_000];

/// Gives a dataset points, of what moves at so many instants.
fn with_points(dataset: &mut Dataset, instants: u32) {
    let mut options = CloudOptions { method: Method::Random, random_points: 20, ..CloudOptions::default() };
    options.hull.instants = instants;
    let work = tempfile::tempdir().unwrap();
    let cloud = initial_cloud(dataset, &options, work.path(), &|_, _, _| {}).unwrap();
    attach(dataset, &cloud).unwrap();
}

#[test]
fn the_ball_is_the_only_body_and_lies_where_it_flies_the_same_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let mut dataset = film_at(folder.path(), 6, &TIMES);
    // Those whose files do not exist: the one of events, and the one that is held out.
    dataset.manifest.cameras.retain(|camera| camera.modality.has_frames() && camera.split == Split::Train);
    with_points(&mut dataset, 0);
    let options = BodyOptions { page: true, ..BodyOptions::default() };
    let error = find_bodies(&dataset, &options, &|step, _, _| assert_eq!(step, BodyStep::Frames)).unwrap_err();
    assert!(matches!(error, CloudError::NoMovingPoints { instants: 0 }), "{error}");
    assert!(error.to_string().contains("erfgs dataset points"), "{error}");

    with_points(&mut dataset, TIMES.len() as u32);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| find_bodies(&dataset, &options, &|_, _, _| {}).unwrap())
    };
    let found = on(1);
    assert_eq!(found, on(3));
    assert_eq!(found.bodies.len(), 1, "{:?}", found.parameters);
    let body = &found.bodies[0];
    assert_eq!(body.span_ns, dataset.manifest.span_ns);
    for pose in &body.poses {
        let off = DVec3::from(pose.translation_m).distance(ball(pose.t_ns));
        assert!(off < 0.7 * BALL_RADIUS, "off by {off} m at {} ns", pose.t_ns);
    }
    // It does not turn; the hull of cameras at one side does a little, as the ball passes them, and a ball of one colour looks the same
    // however it is turned.
    assert_eq!(body.found_by["event_windows"], 0);
    let rate: [f64; 3] = serde_json::from_value(body.found_by["rate_rad_s"].clone()).unwrap();
    assert!(DVec3::from(rate).length() < 1.2, "{:?}", body.found_by);
    let pose = body.poses[body.poses.len() / 2];
    // A hull of views of one side is deeper than the ball.
    let near = body.points.iter().filter(|point| {
        let away = pose.place(DVec3::from(point.position_m)).distance(ball(pose.t_ns));
        away > 0.5 * BALL_RADIUS && away < 1.6 * BALL_RADIUS
    });
    assert!(near.count() * 10 > body.points.len() * 7);
    let red = body.points.iter().filter(|point| point.colour[0] > point.colour[2]).count();
    assert!(red * 10 > body.points.len() * 8, "{red} of {} are red", body.points.len());

    let page = found.page.as_ref().unwrap();
    assert!(page.contains("id=\"body-0\"") && page.contains(">body0</a>"), "the body has a section and a row");
    // Its strip of pictures, and four of the points of all bodies.
    assert_eq!(page.matches("src=\"data:image/jpeg").count(), 5);

    // The user knows better: it turns, and is no body after half of the time.
    let edits = "forget = ['body0.1']\n[[split]]\nbody = 'body0'\nat_s = 0.5\n[[turn]]\nbody = 'body0.0'\nrate_rad_s = [0, 3, 0]";
    let edits: BodyEdits = toml::from_str(edits).unwrap();
    let corrected = find_bodies(&dataset, &BodyOptions { edits, page: false }, &|_, _, _| {}).unwrap();
    let [half] = &corrected.bodies[..] else { panic!("{:?}", corrected.parameters) };
    assert_eq!((half.name.as_str(), &half.found_by["rotation"]), ("body0.0", &"as was said".into()));
    assert!(half.span_ns[1] < 500_000_000 && corrected.page.is_none(), "{:?}", half.span_ns);
    assert_eq!(corrected.parameters["edits"]["forget"][0], "body0.1");
    let none = BodyOptions { edits: BodyEdits { forget: vec!["body0".into()], ..BodyEdits::default() }, page: false };
    let error = find_bodies(&dataset, &none, &|_, _, _| {}).unwrap_err();
    assert!(matches!(error, CloudError::BodyEdits { .. }), "{error}");

    let file = attach_bodies(&mut dataset, &found).unwrap();
    let read = Dataset::load(folder.path()).unwrap();
    assert_eq!((read.read_bodies().unwrap().unwrap().bodies, file.count), (found.bodies, 1));
}
