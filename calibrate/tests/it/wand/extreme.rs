//! Rigs and recordings at the edge of what can be solved: each gives the right answer.

use erfgs_base::random;
use erfgs_calibrate::wand::{WandCamera, calibrate};
use erfgs_scene::rig_file::RigFile;
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};
use glam::{DVec2, DVec3};

use crate::wand::rig::{self, Station};

/// Calibrates without any first guess, and checks centres (mm) and rotations (degrees).
fn check(cameras: &[WandCamera], stations: &[Station], most_mm: f64, most_deg: f64) -> RigFile {
    let (found, _) = calibrate(cameras, &rig::options()).unwrap();
    let worst = 1e3 * rig::centre_errors(&found, stations, false).into_iter().fold(0.0, f64::max);
    let turned = rig::rotation_error_deg(&found, stations);
    assert!(worst < most_mm && turned < most_deg, "{worst} mm, {turned} degrees");
    found
}

#[test]
fn a_wand_that_stays_in_a_plane_is_enough() {
    let stations = rig::arc(6, 60.0, |i| i == 2);
    for seed in 0..3 {
        let mut wands = rig::wands(100, seed);
        for (middle, along) in &mut wands {
            middle.y = 0.1;
            along.y = 0.0;
            *along = along.normalize();
        }
        check(&rig::observe(&stations, &wands, seed, |_, _| true), &stations, 6.0, 0.15);
    }
}

#[test]
fn a_wand_that_turns_about_one_point_is_enough() {
    let stations = rig::arc(4, 50.0, |_| false);
    let wands: Vec<_> = rig::wands(60, 1).iter().map(|(_, along)| (DVec3::new(0.2, 0.1, 0.0), *along)).collect();
    check(&rig::observe(&stations, &wands, 1, |_, _| true), &stations, 40.0, 0.3);
}

#[test]
fn pairs_of_cameras_are_chained() {
    // Camera i shares wands with i - 1 and i + 1 alone, 25 with each.
    let stations = rig::arc(8, 69.0, |i| i % 3 == 1);
    let cameras = rig::observe(&stations, &rig::wands(175, 1), 1, |camera, wand| {
        camera.abs_diff(wand % 7) == 0 || camera == wand % 7 + 1
    });
    check(&cameras, &stations, 25.0, 0.4);
}

#[test]
fn a_camera_behind_another_is_placed() {
    // The second looks over the shoulder of the first: their base line points at the wand.
    let ahead = rig::station(Modality::Rgb, DVec3::new(0.0, 0.0, -3.0), DVec3::ZERO);
    let behind = rig::station(Modality::Event, DVec3::new(0.04, -0.03, -5.0), DVec3::ZERO);
    let side = rig::station(Modality::Rgb, DVec3::new(2.5, -0.2, -1.5), DVec3::ZERO);
    let both = [ahead.clone(), behind.clone()];
    check(&rig::observe(&both, &rig::wands(150, 2), 2, |_, _| true), &both, 25.0, 0.2);
    let three = [ahead, behind, side];
    check(&rig::observe(&three, &rig::wands(150, 3), 3, |_, _| true), &three, 8.0, 0.15);
}

#[test]
fn three_observations_in_ten_may_be_wrong() {
    let stations = rig::arc(6, 60.0, |i| i == 1);
    for seed in 0..3 {
        let mut cameras = rig::observe(&stations, &rig::wands(200, seed), seed, |_, _| true);
        let (mut wrong, mut all) = (0, 0);
        for (c, camera) in cameras.iter_mut().enumerate() {
            for (s, sighting) in camera.sightings.iter_mut().enumerate() {
                let key = random::key(seed, &[77, c as u64, s as u64]);
                let off = |led| rig::vector(seed, &[78, c as u64, s as u64, led], 120.0).truncate();
                all += 3;
                // The whole wand elsewhere (a reflection), or one LED (another light).
                match random::below(key, 100) {
                    0..20 => {
                        sighting.leds = sighting.leds.map(|led| led.map(|pixel| pixel + off(9)));
                        wrong += 3;
                    }
                    20..50 => {
                        let led = (s % 3) as u64;
                        sighting.leds[s % 3] = sighting.leds[s % 3].map(|pixel| pixel + off(led));
                        wrong += 1;
                    }
                    _ => {}
                }
            }
        }
        assert!(wrong * 100 > all * 27, "{wrong} of {all}");
        let found = check(&cameras, &stations, 4.0, 0.1);
        let marked: usize = found.cameras.iter().map(|camera| camera.outliers).sum();
        assert!(marked.abs_diff(wrong) * 10 < wrong, "{marked} of {wrong}");
        assert!(found.cameras.iter().any(|camera| camera.warnings.iter().any(|w| w.contains("outliers"))));
    }
}

#[test]
fn labels_in_any_order_are_put_right() {
    let stations = rig::arc(5, 60.0, |_| false);
    let mut cameras = rig::observe(&stations, &rig::wands(80, 4), 4, |_, _| true);
    for (c, camera) in cameras.iter_mut().enumerate() {
        for (s, sighting) in camera.sightings.iter_mut().enumerate() {
            let order = random::permutation(random::key(4, &[79, c as u64, s as u64]), 3);
            let leds = sighting.leds;
            sighting.leds = std::array::from_fn(|led| leds[order[led]]);
        }
    }
    check(&cameras, &stations, 5.0, 0.1);
}

#[test]
fn fisheyes_that_see_half_of_the_world_and_more_are_calibrated() {
    let distortion = Distortion::KannalaBrandt([0.01, -0.002, 0.0, 0.0]);
    let intrinsics = Intrinsics { width: 1400, height: 1400, fx: 400.0, fy: 401.0, cx: 702.0, cy: 699.0, distortion };
    let eyes = [
        DVec3::new(-1.2, 0.0, -0.8),
        DVec3::new(1.2, 0.1, -0.9),
        DVec3::new(0.1, -0.9, 1.1),
        DVec3::new(0.0, 0.9, 0.9),
    ];
    // They look past the wand: much of it is beside them.
    let ahead =
        [DVec3::new(-0.4, 0.0, 1.0), DVec3::new(0.5, 0.1, 1.0), DVec3::new(0.2, 1.0, 0.6), DVec3::new(-0.8, -0.3, 0.5)];
    let stations: Vec<Station> = eyes
        .into_iter()
        .zip(ahead)
        .map(|(eye, ahead)| Station {
            modality: Modality::Rgb,
            intrinsics,
            pose: Pose::look_at(eye, eye + ahead, DVec3::new(0.1, 0.7, -0.4)),
            sigma_px: 0.2,
        })
        .collect();
    let wands: Vec<_> = rig::wands(200, 5)
        .into_iter()
        .filter(|(middle, _)| eyes.iter().all(|eye| (*middle - *eye).length() > 0.7))
        .collect();
    let cameras = rig::observe(&stations, &wands, 5, |_, _| true);
    let beside = |camera: &WandCamera| {
        let leds = camera.sightings.iter().flat_map(|s| s.leds).flatten();
        leds.filter(|pixel| pixel.distance(DVec2::new(702.0, 699.0)) > 630.0).count()
    };
    assert!(cameras.iter().map(beside).sum::<usize>() > 20, "some are seen at 90 degrees from the axis and beyond");
    check(&cameras, &stations, 1.5, 0.1);
}
