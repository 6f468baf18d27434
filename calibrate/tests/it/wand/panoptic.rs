//! Event cameras that a waved wand places among many frame cameras, on clocks of their own. What they see is only projected.

use erfgs_calibrate::wand::{KnownRig, WandOptions, calibrate};
use erfgs_recordings::shared;
use erfgs_scene::Modality;
use erfgs_scene::rig_file::{RigCamera, RigFile};

use crate::wand::{
    dome::{self, Eye},
    rig,
};

/// Places the event cameras among the others, which stay, and checks poses and clocks.
fn check(eyes: &[Eye], events: usize, seed: u64) {
    let cameras = dome::observe(eyes, &rig::stick(), 60.0, seed);
    let frames = eyes.iter().filter(|eye| eye.modality == Modality::Rgb);
    let known = frames.map(|eye| RigCamera::new(&eye.name, Modality::Rgb, eye.intrinsics, Some(eye.pose)));
    let known = RigFile::new("truth", true, known.collect());
    assert_eq!(known.cameras.len() + events, eyes.len());
    let options = WandOptions { known: Some(KnownRig::new(known)), most: 400, ..WandOptions::new(rig::stick()) };
    let (found, _) = calibrate(&cameras, &options).unwrap();
    let mut late_s = dome::LATE_S.into_iter();
    for (name, modality, mm, deg) in dome::errors(&found, eyes) {
        let event = modality == Modality::Event;
        let [most_mm, most_deg] = if event { [4.0, 0.05] } else { [1e-6, 1e-5] };
        assert!(mm < most_mm && deg < most_deg, "{name}: {mm} mm, {deg} degrees");
        // Stamps of frames are right, those of events milliseconds off. All cameras but one could be taken for early together.
        let late_s = if event { late_s.next().unwrap() } else { 0.0 };
        let offset_s = found.camera(&name).unwrap().time_offset_s;
        assert!((offset_s + late_s).abs() < 2.5e-4, "{name}: {offset_s} s, {late_s} s late");
    }
}

#[test]
fn two_event_cameras_are_placed_among_the_cameras_of_a_ring() {
    check(&dome::ring(20, 2), 2, 3);
}

#[test]
fn four_event_cameras_are_placed_among_the_cameras_of_the_dome() {
    let Some(source) = shared(dome::PANOPTIC) else { return };
    check(&dome::panoptic(&source), 4, 7);
}
