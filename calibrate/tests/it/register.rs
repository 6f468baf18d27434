//! Event cameras that saw light come up from darkness, added to a rig of frame cameras: simulated events, pictures of them,
//! registration.

use crate::room as common;

use erfgs_calibrate::{
    geometry::angle,
    intensity::dark_ramp,
    sfm::{CameraView, KnownIntrinsics, RegisterOptions, Setting, read_views, register},
};
use erfgs_events::Events;
use erfgs_replay::{
    Luma, Mode, Simulator, SimulatorConfig,
    simulator::{camera_key, linear_of_srgb},
};
use erfgs_scene::rig_file::{RigCamera, RigFile};
use erfgs_scene::{Modality, image::ImageGrey8};

/// What an event camera makes of light that rises from black onto a picture, so many times.
fn ramps(name: &str, picture: &ImageGrey8, ramps: u64, config: &SimulatorConfig) -> Events {
    const STEPS: u64 = 100;
    const STEP_NS: i64 = 4_000_000;
    let mut simulator = Simulator::new(picture.width, picture.height, config, camera_key(name)).unwrap();
    let mut events = Events::new(picture.width, picture.height);
    let linear: Vec<f64> =
        picture.data.iter().map(|level| 255.0 * linear_of_srgb(f64::from(*level) / 255.0).max(2e-3)).collect();
    for frame in 0..ramps * STEPS {
        // From black up to four times white.
        let step = frame % STEPS;
        let gain = if step == 0 { 0.0 } else { 4.0 * (6.0 * (step as f64 / STEPS as f64 - 1.0)).exp() };
        let levels: Vec<f32> = linear.iter().map(|value| (gain * value) as f32).collect();
        simulator.step(Luma::F32(&levels), frame as i64 * STEP_NS, &mut events).unwrap();
    }
    events
}

#[test]
fn event_cameras_that_saw_light_come_up_are_placed_among_the_rig_s_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let mut room = common::film_at(folder.path(), 7, &[0]);
    room.manifest.cameras.truncate(7);
    room.manifest.span_ns = [0, 1];
    room.save().unwrap();
    // Two of the cameras become event cameras: one that hardly errs and sees light come up once, and a noisy one that sees it
    // four times.
    let mut model = read_views(folder.path(), 0, &KnownIntrinsics::Dataset).unwrap();
    let options = RegisterOptions::default();
    let options = RegisterOptions { setting: Setting { enlarge: 1.0, ..options.setting }, ..options };
    let events: Vec<CameraView> = [("noisy", 4, model.remove(4)), ("clean", 1, model.remove(2))]
        .into_iter()
        .map(|(preset, count, view)| {
            let config = SimulatorConfig { mode: Mode::Enhanced, ..SimulatorConfig::preset(preset).unwrap() };
            let seen = dark_ramp(&ramps(&view.name, &view.image, count, &config), config.threshold_on);
            CameraView { image: seen.picture(options.radius_px), modality: Modality::Event, ..view }
        })
        .collect();
    let pose = |name: &str| room.camera(name).unwrap().world_to_camera;
    let entry =
        |view: &CameraView| RigCamera::new(&view.name, view.modality, view.intrinsics.unwrap(), Some(pose(&view.name)));
    let rig = RigFile::new("board", true, model.iter().map(entry).collect());
    let (whole, evidence) = register(&rig, &model, &events, &options, folder.path(), &|_, _, _| {}).unwrap();
    assert_eq!(whole.cameras[..5], rig.cameras[..], "the rig's own cameras stay");
    assert_eq!((whole.method.as_str(), evidence.tables[0].rows.len()), ("register", 2));
    for view in &events {
        let found = whole.camera(&view.name).unwrap();
        let (found_pose, truth) = (found.pose.unwrap(), pose(&view.name));
        let off_mm = 1e3 * found_pose.centre().distance(truth.centre());
        let turned_deg = angle(found_pose.rotation, truth.rotation).to_degrees();
        println!("{}: {off_mm:.2} mm, {turned_deg:.3} deg, {} points", view.name, found.observations);
        assert_eq!(found.modality, Modality::Event);
        assert!(off_mm < 10.0 && turned_deg < 0.4, "{}: {off_mm} mm, {turned_deg} deg", view.name);
    }
}
