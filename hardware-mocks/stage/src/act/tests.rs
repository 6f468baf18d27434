//! What must hold for every act and any seed.

use glam::DVec3;

use super::*;
use crate::{
    RigOptions, Stage, StageOptions, StageView,
    actors::{Actors, Moment},
    set::{ROOM_HIGH, ROOM_LOW},
    truth::truth_bodies,
};

const SECONDS: f64 = 0.6;

fn stage(act: Act, seed: u64) -> Stage {
    Stage::new(StageOptions { acts: vec![act], seed, seconds: SECONDS, samples_per_axis: 2, ..StageOptions::default() })
}

fn instants(count: u32) -> impl Iterator<Item = f64> {
    (0..count).map(move |index| SECONDS * f64::from(index) / f64::from(count - 1))
}

#[test]
fn names_are_read_as_they_are_written() {
    for act in Act::ALL {
        assert_eq!(act.name().parse(), Ok(act));
    }
    assert!("juggle".parse::<Act>().unwrap_err().contains("throw"));
}

#[test]
fn nothing_leaves_the_room_and_everything_keeps_its_speed_limit() {
    let step = 1e-4;
    for act in Act::ALL {
        for seed in 0..4 {
            let stage = stage(act, seed);
            for part in &stage.cast.parts {
                let samples = part.form.samples(16);
                let reach = part.form.reach();
                for t in instants(20) {
                    let (place, next) = (part.path.place(t), part.path.place(t + step));
                    let speed = part.path.speed(t + 0.5 * step, 0.5 * step);
                    for sample in &samples {
                        let at = part.form.carried(sample, &place);
                        let name = &stage.cast.bodies[part.body].name;
                        let skin = 1e-3;
                        assert!(
                            at.cmpge(ROOM_LOW - skin).all() && at.cmple(ROOM_HIGH + skin).all(),
                            "{name} of {act}, seed {seed}, at {at}, {t} s"
                        );
                        let limit = speed.origin + speed.turn * reach + part.form.bends();
                        let moved = (part.form.carried(sample, &next) - at).length();
                        assert!(moved <= limit * step * (1.0 + 1e-6) + 1e-9, "{name} of {act}: {moved} in {step} s");
                        let held =
                            part.spheres.iter().any(|&(c, r)| (place.world(c) - at).length() <= r * (1.0 + 1e-9));
                        assert!(held, "{name} of {act} is not held by its spheres");
                    }
                }
            }
        }
    }
}

#[test]
fn nothing_but_what_comes_out_of_a_pot_touches_the_furniture() {
    for act in Act::ALL.into_iter().filter(|act| *act != Act::Debris) {
        for seed in 0..4 {
            let stage = stage(act, seed);
            for part in &stage.cast.parts {
                for (t, sample) in instants(12).flat_map(|t| part.form.samples(10).into_iter().map(move |s| (t, s))) {
                    let place = part.path.place(t);
                    let (at, centre) = (part.form.carried(&sample, &place), place.world(part.spheres[0].0));
                    let (way, length) = (at - centre).normalize_and_length();
                    let through = length > 1e-3
                        && stage
                            .set
                            .hit(centre, way)
                            .is_some_and(|(hit, shape)| shape > 0 && hit.distance < length - 2e-3);
                    // Blades and rods begin within what carries them.
                    let carried = matches!(act, Act::Fan | Act::Pendulum | Act::Cloth);
                    assert!(!through || carried, "{} of seed {seed} at {at}, {t} s", stage.cast.bodies[part.body].name);
                }
            }
        }
    }
}

#[test]
fn a_pixel_is_a_continuous_function_of_time() {
    let rig = RigOptions { width: 40, height: 30, rgb: 1, event: 0, test: 0, ..RigOptions::default() };
    let camera = &rig.cameras(1).unwrap()[0];
    for act in Act::ALL {
        let stage = stage(act, 3);
        let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
        for t_ns in [120_000_000, 333_000_000] {
            let (now, soon) = (view.frame(t_ns), view.frame(t_ns + 1000));
            for (pixel, (a, b)) in now.iter().zip(&soon).enumerate() {
                let change = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(change < 0.02, "{act}: pixel {pixel} changes by {change} in a microsecond");
            }
        }
    }
}

#[test]
fn pruning_never_changes_a_pixel_and_every_act_is_in_view() {
    let rig = RigOptions { width: 40, height: 30, rgb: 2, event: 0, test: 0, ..RigOptions::default() };
    let camera = &rig.cameras(2).unwrap()[1];
    for act in Act::ALL {
        let stage = stage(act, 2);
        let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
        let t_ns = 401_000_000;
        let moment = Moment::at(&stage, 0.401, Actors::ALL);
        let (mask, frame) = (view.mask(t_ns), view.frame(t_ns));
        let moving = mask.iter().filter(|moves| **moves).count();
        assert!(moving >= 8, "{act} moves {moving} pixels");
        for pixel in 0..view.pixels() {
            // Without the search for what is reached.
            let whole = view.looker(pixel).colour(&moment, Actors::ALL);
            assert_eq!(mask[pixel], whole.is_some(), "{act}: pixel {pixel}");
            let whole = whole.unwrap_or_else(|| view.still_colour(pixel, 1.0));
            assert!((whole - DVec3::from(frame[pixel].map(f64::from))).length() < 1e-6);
        }
    }
}

#[test]
fn true_surfaces_lie_on_what_the_labels_show() {
    let rig = RigOptions { width: 120, height: 90, rgb: 0, event: 0, test: 1, ..RigOptions::default() };
    let camera = &rig.cameras(1).unwrap()[0];
    for act in [Act::Fan, Act::Throw, Act::Tumble, Act::Pendulum, Act::Articulated, Act::Crossing, Act::Gloss] {
        let stage = stage(act, 5);
        let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
        let truth = truth_bodies(&stage, [0, 600_000_000]);
        truth.check().unwrap();
        let t_ns = 300_000_000;
        let (labels, depth) = (view.labels(t_ns), view.depth(t_ns));
        let (mut seen, mut on) = (0, 0);
        for (number, body) in truth.bodies.iter().enumerate() {
            let pose = body.pose_at(t_ns).unwrap();
            assert!((pose.t_ns - t_ns).abs() < 1_000_000, "{}", body.name);
            for point in &body.points {
                let world = pose.place(DVec3::from(point.position_m));
                let there = camera.world_to_camera.transform(world);
                let at = camera.intrinsics.project_pinhole(there);
                let outwards = (pose.rotation() * DVec3::from(point.normal)).dot((world - view.eye).normalize());
                let inside = at.x > 1.0 && at.y > 1.0 && at.x < 119.0 && at.y < 89.0;
                if !inside || outwards > -0.6 {
                    continue;
                }
                let pixel = at.y as usize * 120 + at.x as usize;
                // What another thing hides is not looked for. (Labels are those of what covers half a pixel: a thin rod has gaps.)
                if f64::from(depth[pixel]) < there.z - 0.015 {
                    continue;
                }
                seen += 1;
                on += usize::from(labels[pixel] == crate::truth::label(number));
            }
        }
        assert!(seen > 50 && on as f64 > 0.85 * seen as f64, "{act}: {on} of {seen}");
    }
}

#[test]
fn a_rigid_body_is_one_and_its_poses_are_dense() {
    for act in Act::ALL {
        for seed in 0..3 {
            let stage = stage(act, seed);
            let truth = truth_bodies(&stage, [0, 600_000_000]);
            truth.check().unwrap();
            for body in &truth.bodies {
                for pair in body.poses.windows(2) {
                    assert!(pair[1].t_ns - pair[0].t_ns <= 2_000_000);
                    let turn = pair[0].rotation().angle_between(pair[1].rotation());
                    assert!(turn < 1.0 && pair[0].rotation().dot(pair[1].rotation()) >= 0.0, "{}: {turn}", body.name);
                }
            }
            for (number, body) in stage.cast.bodies.iter().enumerate().filter(|(_, body)| body.rigid) {
                let mut parts = stage.cast.parts_of(number);
                let frame = parts.next().unwrap();
                let offset = |part: &crate::cast::Part, t: f64| {
                    frame.path.place(t).local(part.path.place(t).world(DVec3::new(0.1, 0.2, 0.3)))
                };
                for part in parts {
                    assert!((offset(part, 0.0) - offset(part, 0.37)).length() < 1e-9, "{}", body.name);
                }
            }
        }
    }
}

#[test]
fn acts_combine_and_a_seed_means_the_same_among_others() {
    let all = Stage::new(StageOptions { acts: Act::ALL.to_vec(), seconds: SECONDS, ..StageOptions::default() });
    assert!(all.cast.parts.len() <= 128 && all.cast.bodies.len() < 255, "a bit and a label for each");
    let mut names: Vec<&String> = all.cast.bodies.iter().map(|body| &body.name).collect();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), all.cast.bodies.len());
    let twice = Stage::new(StageOptions { acts: vec![Act::Fan, Act::Fan], ..StageOptions::default() });
    assert_eq!(twice.cast.bodies.len(), 1);
    let alone = stage(Act::Fan, 1);
    let blade = |stage: &Stage| stage.cast.parts[0].path.place(0.2).axes;
    assert_eq!(blade(&alone), blade(&all));
}
