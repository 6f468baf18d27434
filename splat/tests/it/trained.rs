use std::{fs, path::Path};

use erfgs_scene::{ImageRgb8, Modality};
use erfgs_splat::{
    container,
    field::{FieldConfig, FieldError},
    gaussians::Gaussians,
    gpu::{AdapterChoice, Gpu},
    model::ModelError,
    motion::{FreeTimeOptions, MotionPlan, bodies::EXTRA_FLOATS},
    raster::View,
    trained::{
        CHECKPOINT, Drawing, Reconstruction, Record, RecordedCamera, RecordedEvents, TrainedError, TrainedScene,
    },
};
use serde_json::{Value, json};

use crate::draw::draw;

const VIEW: View = View {
    width: 64,
    height: 48,
    fx: 60.0,
    fy: 60.0,
    cx: 32.0,
    cy: 24.0,
    rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    translation: [0.0; 3],
};

/// A red Gaussian before a camera, which goes to the right by a metre in its two seconds; a green one behind it stands still.
fn learned() -> Reconstruction {
    let mut gaussians =
        Gaussians::from_points(&[([-0.5, 0.0, 2.0], [255, 0, 0]), ([0.0, 0.0, 4.0], [0, 255, 0])], 0, 0.95);
    for (row, size) in gaussians.core.chunks_exact_mut(12).zip([0.2_f32, 3.0]) {
        row[3..6].fill(size.ln());
    }
    let options = FreeTimeOptions { least_life: 50.0, ..FreeTimeOptions::default() };
    gaussians.dynamic = 1;
    gaussians.motion_floats = options.floats();
    // Velocity and instant in intervals, of which there are ten; acceleration; the logarithm of its life.
    gaussians.motion = vec![0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let camera = RecordedCamera {
        name: "left".into(),
        held_out: false,
        modality: Modality::Rgb,
        view: VIEW,
        frames_ns: vec![[0; 3], [2_000_000_000; 3]],
    };
    let record = Record {
        span_ns: [0, 2_000_000_000],
        intervals: 10.0,
        drawing: Drawing { background: [0.0; 3], sh_degree: 0, near_m: 0.2, near_share: 0.5, near_sigmas: 0.0 },
        motion: MotionPlan::FreeTime { options, intervals: 10.0 },
        shared_vectors: 0,
        cameras: vec![camera],
        events: RecordedEvents::default(),
    };
    Reconstruction { record, gaussians, shared: None, points: vec![[0.0, 0.0, 2.0]] }
}

/// The header of a checkpoint.
fn header(learned: &Reconstruction) -> Value {
    let Reconstruction { record, gaussians, points, .. } = learned;
    json!({
        "sh_degree": gaussians.sh_degree,
        "dynamic": gaussians.dynamic,
        "motion_floats": gaussians.motion_floats,
        "field_step": null,
        "record": record,
        "vectors": [
            ["core", gaussians.core.len()], ["sh", gaussians.sh.len()], ["motion", gaussians.motion.len()], ["points", 3 * points.len()],
        ],
    })
}

fn save(run: &Path, header: &Value, learned: &Reconstruction) {
    let Reconstruction { gaussians, points, .. } = learned;
    let vectors = [
        ("core".to_owned(), &gaussians.core[..]),
        ("sh".to_owned(), &gaussians.sh),
        ("motion".to_owned(), &gaussians.motion),
        ("points".to_owned(), points.as_flattened()),
    ];
    fs::write(run.join(CHECKPOINT), container::to_bytes(header.to_string().as_bytes(), &vectors)).expect("a file");
}

#[test]
fn a_run_is_drawn_by_a_program_of_forty_lines() {
    let folder = tempfile::tempdir().expect("a folder");
    let learned = learned();
    save(folder.path(), &header(&learned), &learned);
    assert_eq!(Reconstruction::read(folder.path()).expect("a run"), learned);
    // Where red is brighter than green, in the middle row.
    let red = |seconds: f64| -> Vec<u32> {
        let file = folder.path().join("picture.png");
        draw(folder.path(), &file, Some("left"), seconds).expect("a picture");
        let image = ImageRgb8::read(&file).expect("a picture");
        assert_eq!((image.width, image.height), (64, 48));
        let pixel = |x: u32| &image.data[3 * (24 * 64 + x as usize)..][..3];
        (0..64).filter(|&x| pixel(x)[0] > pixel(x)[1]).collect()
    };
    let middle = |columns: &[u32]| f64::from(columns.iter().sum::<u32>()) / columns.len() as f64 + 0.5;
    // Half a metre at two metres is 15 pixels.
    for (seconds, expected) in [(0.0, 17.0), (1.0, 32.0), (2.0, 47.0), (9.0, 47.0)] {
        let columns = red(seconds);
        assert!(
            (4..20).contains(&columns.len()) && (middle(&columns) - expected).abs() < 1.0,
            "{seconds} s: {columns:?}"
        );
    }
    let refused = draw(folder.path(), &folder.path().join("no.png"), Some("right"), 0.0).expect_err("no such camera");
    assert!(refused.to_string().contains("left"), "{refused}");
}

#[test]
fn a_run_that_cannot_be_drawn_says_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path();
    let refused = || Reconstruction::read(run).expect_err("refused");
    assert!(matches!(refused(), TrainedError::Read { .. }));

    let learned = learned();
    let mut before = header(&learned);
    before.as_object_mut().expect("an object").remove("record");
    save(run, &before, &learned);
    let error = refused();
    assert!(matches!(error, TrainedError::NoRecord { .. }) && error.to_string().contains("--resume"), "{error}");

    // As long as they are, they say other things of each other.
    for (key, value) in
        [("dynamic", json!(3)), ("sh_degree", json!(1)), ("motion_floats", json!(4)), ("sh_degree", json!(u32::MAX))]
    {
        let mut wrong = header(&learned);
        wrong[key] = value;
        save(run, &wrong, &learned);
        assert!(matches!(refused(), TrainedError::Damaged { .. }), "{key}");
    }
    let mut longer = header(&learned);
    longer["vectors"][1][1] = json!(usize::MAX);
    save(run, &longer, &learned);
    assert!(refused().to_string().contains("too long"));
    let mut knots = learned.clone();
    knots.record.motion =
        MotionPlan::FreeTime { options: FreeTimeOptions { knots: 2, ..FreeTimeOptions::default() }, intervals: 10.0 };
    save(run, &header(&knots), &knots);
    assert!(refused().to_string().contains("16"), "{}", refused());

    // Bodies whose paths are not there, and a field of other numbers.
    let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
    let options = FreeTimeOptions::default();
    let (names, floats) = (vec!["ball".into()], options.floats() + EXTRA_FLOATS);
    let bodies = MotionPlan::Bodies { options, intervals: 10.0, seconds: 2.0, names, nodes: usize::MAX, knots: 4 };
    let field = MotionPlan::HexPlane {
        field: FieldConfig { sh_stride: 4, ..FieldConfig::default() },
        aabb: [[0.0; 3], [1.0; 3]],
    };
    for (plan, floats) in [(bodies, floats), (field, 8)] {
        let mut other = learned.clone();
        other.gaussians.motion.resize(floats, 0.0);
        other.gaussians.motion_floats = floats;
        other.record.motion = plan;
        save(run, &header(&other), &other);
        let error = TrainedScene::open(&gpu, run).expect_err("refused");
        assert!(matches!(error, TrainedError::Model(ModelError::Field(FieldError::State { .. }))), "{error}");
    }

    let mut odd = learned.clone();
    odd.gaussians.core[2] = f32::NAN;
    save(run, &header(&odd), &odd);
    assert!(matches!(refused(), TrainedError::Implausible { index: 2, .. }));

    save(run, &header(&learned), &learned);
    let file = run.join(CHECKPOINT);
    let mut bytes = fs::read(&file).expect("a file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&file, bytes).expect("a file");
    assert!(refused().to_string().contains("checksum"));
}

/// The places of all values of a JSON text that hold no others.
fn leaves(value: &Value, at: String, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(key, value)| leaves(value, format!("{at}/{key}"), found)),
        Value::Array(values) => {
            values.iter().enumerate().for_each(|(index, value)| leaves(value, format!("{at}/{index}"), found));
        }
        _ => found.push(at),
    }
}

#[test]
fn whatever_a_header_says_is_drawn_or_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path();
    let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
    let learned = learned();
    let good = header(&learned);
    let mut places = Vec::new();
    leaves(&good, String::new(), &mut places);
    assert!(places.len() > 60, "{places:?}");
    let (mut drawn, drawing) = (0, [json!(-1), json!(3e38)]);
    for place in &places {
        for odd in [json!(-1), json!(0), json!(3e38), json!(u64::MAX), json!(i64::MIN), Value::Null, json!("x")] {
            let mut header = good.clone();
            header.pointer_mut(place).expect("a value").clone_from(&odd);
            save(run, &header, &learned);
            let Ok(learned) = Reconstruction::read(run) else { continue };
            // Kernels take a while to be made: two of them are drawn.
            if !drawing.contains(&odd) {
                continue;
            }
            let Ok(mut scene) = TrainedScene::new(&gpu, learned) else { continue };
            let t01 = scene.record().share(1.0);
            drawn += u32::from(scene.render(&VIEW, t01).is_ok());
            scene.gaussians_at(t01).expect("Gaussians");
        }
    }
    assert!(drawn > 20, "{drawn}");
    // Nobody is there, either.
    let mut nobody = learned;
    nobody.gaussians = Gaussians { motion_floats: nobody.gaussians.motion_floats, ..Gaussians::default() };
    save(run, &header(&nobody), &nobody);
    let picture = TrainedScene::open(&gpu, run).expect("a scene").render(&VIEW, 0.5).expect("a picture");
    assert!(picture.rgb.iter().all(|value| *value == 0.0) && picture.transmittance.iter().all(|light| *light == 1.0));
}
