use super::*;
use erfgs_scene::Modality;
use erfgs_splat::{
    field::NamedVector,
    motion::MotionPlan,
    raster::View,
    trained::{Drawing, RecordedCamera, RecordedEvents},
};

fn checkpoint() -> Checkpoint {
    let gaussians = Gaussians::from_points(&[([0.5, 1.0, 2.0], [9, 8, 7]), ([1.5, 1.0, 2.0], [1, 2, 3])], 1, 0.1);
    let moments = Moments::zero(&gaussians);
    Checkpoint {
        config: Config::default(),
        clock: Clock { iteration: 7, seconds: 1.25, ..Clock::default() },
        step: 7,
        population: Population { gaussians, moments },
        fixed: 0,
        field_box: [[-1.0; 3], [1.0; 3]],
        field: Some(FieldState {
            step: 3,
            vectors: vec![NamedVector { name: "grid".into(), values: vec![0.1, -0.0, f32::MIN_POSITIVE] }],
        }),
        statistics: vec![ScreenStatistics { gradient: 0.1, iterations: 2.0, radius_px: 3.0 }; 2],
        camera_colours: None,
        camera_poses: None,
        camera_times: None,
        levels: Vec::new(),
        loss_sums: None,
        left_out: Vec::new(),
        record: None,
        points: Vec::new(),
    }
}

#[test]
fn a_checkpoint_comes_back_to_the_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.bin");
    checkpoint().save(&path).expect("saved");
    assert_eq!(Checkpoint::load(&path).expect("loaded"), checkpoint());
}

#[test]
fn losses_since_the_last_row_of_the_curve_come_back() {
    let mut checkpoint = checkpoint();
    let counts = [640.0, 3.0, 1.0 / 3.0, 2.0, 0.0, f64::MIN_POSITIVE, 1e300];
    checkpoint.loss_sums = Some(LossSums { counts, partial: [vec![0.1, 0.2], Vec::new(), vec![3.0]] });
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
}

#[test]
fn what_drawing_takes_comes_back() {
    let mut checkpoint = checkpoint();
    let view = View {
        width: 40,
        height: 30,
        fx: 0.1 + 0.2,
        fy: 50.0,
        cx: 1.0 / 3.0,
        cy: 15.0,
        rotation: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [f32::MIN_POSITIVE, -0.7, 1e-3],
    };
    checkpoint.record = Some(Record {
        span_ns: [i64::MIN + 1, i64::MAX],
        intervals: 1.0 / 3.0,
        drawing: Drawing { background: [0.1; 3], sh_degree: 1, near_m: 0.2, near_share: 0.3, near_sigmas: 3.0 },
        motion: MotionPlan::Still,
        shared_vectors: 1,
        cameras: vec![RecordedCamera {
            name: "left".into(),
            held_out: true,
            modality: Modality::Both,
            view,
            frames_ns: vec![[1, 2, 3]],
        }],
        events: RecordedEvents { edges: vec![0.0, 0.1 + 0.2, 1.0], counts: vec![3.0, 1e300] },
    });
    checkpoint.points = vec![[0.1, 0.2, 0.3], [1.0, 2.0, 3.0]];
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
}

#[test]
fn poses_of_cameras_come_back() {
    let mut checkpoint = checkpoint();
    let mut poses = CameraPoseState::calibrated(2);
    (poses.steps[1], poses.values[9], poses.moments[1][0]) = (7, 1.5, 0.25);
    checkpoint.camera_poses = Some(poses);
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
    checkpoint.camera_poses.as_mut().expect("poses").values.pop();
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert!(Checkpoint::from_bytes(&bytes).expect_err("refused").contains("poses"));
}

#[test]
fn a_static_set_comes_back_and_is_no_more_than_stands_still() {
    let mut checkpoint = checkpoint();
    checkpoint.population.gaussians.dynamic = 1;
    checkpoint.fixed = 1;
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
    checkpoint.fixed = 2;
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert!(Checkpoint::from_bytes(&bytes).expect_err("refused").contains("different lengths"));
}

#[test]
fn clocks_of_cameras_come_back() {
    let mut checkpoint = checkpoint();
    let mut times = CameraTimeState::labelled(2);
    (times.steps[1], times.values[1], times.moments[1][0], times.sums[3]) = (7, 1.5, 0.25, 4.0);
    checkpoint.camera_times = Some(times);
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
    checkpoint.camera_times.as_mut().expect("times").sums.pop();
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert!(Checkpoint::from_bytes(&bytes).expect_err("refused").contains("times"));
}

#[test]
fn colours_of_cameras_come_back() {
    let mut checkpoint = checkpoint();
    let mut colours = CameraColourState::neutral(&[true, false]);
    (colours.steps[1], colours.values[9], colours.moments[1][0]) = (7, 1.5, 0.25);
    checkpoint.camera_colours = Some(colours);
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
    checkpoint.camera_colours.as_mut().expect("colours").steps.pop();
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert!(Checkpoint::from_bytes(&bytes).expect_err("refused").contains("different lengths"));
}

#[test]
fn levels_of_event_cameras_come_back() {
    let mut checkpoint = checkpoint();
    checkpoint.levels = vec![vec![1.5, 9.0, -2.0, 0.0], vec![0.5, 1.0]];
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
}

#[test]
fn rows_of_motion_come_back_and_are_as_many_as_move() {
    let mut checkpoint = checkpoint();
    let gaussians = &mut checkpoint.population.gaussians;
    (gaussians.motion_floats, gaussians.motion) = (8, (0..16).map(|i| i as f32).collect());
    checkpoint.population.moments = Moments::zero(gaussians);
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert_eq!(Checkpoint::from_bytes(&bytes).expect("read"), checkpoint);
    checkpoint.population.gaussians.motion.pop();
    let bytes = checkpoint.to_bytes().expect("bytes");
    assert!(Checkpoint::from_bytes(&bytes).expect_err("refused").contains("different lengths"));
}

#[test]
fn a_checkpoint_with_a_number_that_is_none_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.bin");
    let whole = checkpoint();
    let names: Vec<(String, usize)> =
        whole.vectors(&whole.statistics_floats()).into_iter().map(|(name, values)| (name, values.len())).collect();
    for (at, (name, length)) in names.into_iter().enumerate().filter(|(_, (_, length))| *length > 0) {
        for (index, value) in [(0, f32::NAN), (length - 1, f32::INFINITY), (length / 2, f32::NEG_INFINITY)] {
            let mut spoilt = checkpoint();
            let Population { gaussians, moments } = &mut spoilt.population;
            match at {
                0 => gaussians.core[index] = value,
                1 => gaussians.sh[index] = value,
                2 => moments.core_first[index] = value,
                3 => moments.core_second[index] = value,
                4 => moments.sh_first[index] = value,
                5 => moments.sh_second[index] = value,
                6 => {
                    let ScreenStatistics { gradient, iterations, radius_px } = &mut spoilt.statistics[index / 3];
                    *[gradient, iterations, radius_px][index % 3] = value;
                }
                _ => spoilt.field.as_mut().expect("a field").vectors[0].values[index] = value,
            }
            spoilt.save(&path).expect("saved");
            let error = Checkpoint::load(&path).expect_err("refused");
            assert!(matches!(error, CheckpointError::Implausible { .. }), "{error}");
            let text = error.to_string();
            assert!(text.contains(&name) && text.contains("checkpoint.bin") && text.contains("move it"), "{text}");
        }
    }
}

#[test]
fn gaussians_that_are_nowhere_or_larger_than_everything_are_refused() {
    let spoilt = |index: usize, value: f32| {
        let mut checkpoint = checkpoint();
        checkpoint.population.gaussians.core[index] = value;
        checkpoint.implausible()
    };
    for (index, value) in [(0, 9e18), (CORE + 2, -1e30), (4, 60.0), (CORE + 5, 1e9)] {
        assert_eq!(spoilt(index, value), Some(("core".into(), index, value)));
    }
    for (index, value) in [(0, 1e6), (CORE + 2, -1e6), (4, 7.0), (CORE + 5, -90.0)] {
        assert_eq!(spoilt(index, value), None);
    }
    let mut checkpoint = checkpoint();
    checkpoint.field_box[1][2] = 1e30;
    assert_eq!(checkpoint.implausible(), Some(("field box".into(), 5, 1e30)));
}

#[test]
fn a_checkpoint_cut_or_changed_anywhere_is_refused() {
    let bytes = checkpoint().to_bytes().expect("bytes");
    for length in 0..bytes.len() {
        assert!(Checkpoint::from_bytes(&bytes[..length]).is_err(), "cut at {length}");
    }
    for at in (0..bytes.len()).step_by(13) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x10;
        assert!(Checkpoint::from_bytes(&changed).is_err(), "changed at {at}");
    }
}
