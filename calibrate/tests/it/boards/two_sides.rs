//! Boards with a target on either side, before cameras that face each other.

use erfgs_base::random;
use erfgs_calibrate::{
    board::{
        BoardDetections, BoardError, BoardOptions, BoardView, Corner, Face, LensModel, Plate, Target, calibrate, look,
        look_session, pictures,
    },
    evidence::Evidence,
    report::{page, telling},
};
use erfgs_scene::{Distortion, ImageRgb8, Intrinsics, Pose, pixel::PixelFormat, rig_file::RigFile};
use erfgs_session::{
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, Packet},
};
use glam::{DQuat, DVec2, DVec3};

use super::scene::{Rays, Sheet, photograph};

const LENS: Intrinsics =
    Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 322.0, cy: 238.0, distortion: Distortion::None };

/// Another kind of target on either side.
fn plate() -> Plate {
    let (front, back) = ("charuco:6x5:0.06:0.045:DICT_4X4_50", "aprilgrid:4x3:0.08:0.3");
    Plate::two_sided(front.parse().unwrap(), back.parse().unwrap()).unwrap()
}

/// The same kind, told apart by its numbers.
fn grids() -> Plate {
    let (front, back) = ("aprilgrid:4x3:0.08:0.3", "aprilgrid:4x3:0.08:0.3:first=12");
    Plate::two_sided(front.parse().unwrap(), back.parse().unwrap()).unwrap()
}

/// How a plate is glued: on the front's sheet to the right, down and into it, metres, and turns about these axes, degrees.
#[derive(Clone, Copy)]
struct Glued {
    middle: DVec3,
    turn: DVec3,
}

const EXACT: Glued = Glued { middle: DVec3::new(0.0, 0.0, 0.006), turn: DVec3::ZERO };
const ASKEW: Glued = Glued { middle: DVec3::new(0.004, -0.003, 0.006), turn: DVec3::new(0.3, -0.2, 2.0) };

fn middle(target: &Target) -> DVec3 {
    let (columns, rows) = target.corners();
    0.5 * (target.point(0).unwrap() + target.point(columns * rows - 1).unwrap())
}

/// From a target's frame to that of its sheet: y down, z into it.
fn sheet(target: &Target) -> DQuat {
    let up = matches!(target, Target::AprilGrid { .. });
    if up { DQuat::from_axis_angle(DVec3::X, std::f64::consts::PI) } else { DQuat::IDENTITY }
}

impl Glued {
    /// Takes the back's frame to that of the front.
    fn pose(self, plate: &Plate) -> Pose {
        let (front, back) = (plate.front(), plate.back().unwrap());
        let turn = DQuat::from_scaled_axis(self.turn * std::f64::consts::PI / 180.0);
        let over = DQuat::from_axis_angle(DVec3::Y, std::f64::consts::PI);
        let to_front = sheet(front).conjugate();
        let rotation = to_front * turn * over * sheet(back);
        Pose { rotation, translation: middle(front) + to_front * self.middle - rotation * middle(back) }
    }
}

/// World-to-camera pose of a camera on a ring, by its angle in degrees.
fn place(angle: f64, radius: f64) -> Pose {
    let angle = angle.to_radians();
    Pose::look_at(DVec3::new(angle.sin(), -0.15, -angle.cos()) * radius, DVec3::ZERO, DVec3::Y)
}

/// The front's pose when the plate's middle is at `at` and it is turned by `turn` (axis times angle) from upright.
fn held(plate: &Plate, at: DVec3, turn: DVec3) -> Pose {
    let rotation = DQuat::from_scaled_axis(turn) * sheet(plate.front());
    Pose { rotation, translation: at - rotation * middle(plate.front()) }
}

/// The side of the plate that a camera sees, and its pose before the camera.
fn shown(plate: &Plate, glued: Glued, held: &Pose, camera: &Pose) -> (Face, Pose) {
    let front = held.then(camera);
    // Into the sheet is away from who looks at it.
    let into = front.rotation * sheet(plate.front()).conjugate() * DVec3::Z;
    if into.dot(front.transform(middle(plate.front()))) > 0.0 {
        (Face::Front, front)
    } else {
        (Face::Back, glued.pose(plate).then(&front))
    }
}

fn vector(seed: u64, index: u64, scale: f64) -> DVec3 {
    let part = |axis| random::range(random::key(seed, &[index, axis]), -scale, scale);
    DVec3::new(part(0), part(1), part(2))
}

/// What cameras on a ring see at `count` instants of a plate that is held as `turn` says; corners are off by 0.15 px.
fn seen(
    plate: &Plate,
    glued: Glued,
    angles: &[f64],
    seed: u64,
    count: u64,
    turn: &dyn Fn(u64) -> DVec3,
) -> Vec<BoardDetections> {
    noisy(plate, glued, angles, seed, count, turn, 0.15)
}

/// The same; corners are off by `noise_px`.
fn noisy(
    plate: &Plate,
    glued: Glued,
    angles: &[f64],
    seed: u64,
    count: u64,
    turn: &dyn Fn(u64) -> DVec3,
    noise_px: f64,
) -> Vec<BoardDetections> {
    let ids = |face: Face| (0..).map_while(|id| Some((id, plate.point(id)?))).filter(move |(_, (of, _))| *of == face);
    let view = |camera: u64, angle: f64, instant: u64| {
        let held = held(plate, vector(seed, 2 * instant, 0.12), turn(instant));
        let (face, pose) = shown(plate, glued, &held, &place(angle, 1.2));
        // Too flat to be found.
        let edge_on = (pose.rotation * DVec3::Z).dot(pose.transform(DVec3::ZERO).normalize()).abs() < 0.35;
        let corner = |(id, (_, point)): (u32, (Face, DVec3))| {
            let key = random::key(seed, &[99, camera, instant, u64::from(id)]);
            let noise = DVec2::new(random::normal(key), random::normal(random::extend(key, 1))) * noise_px;
            Some(Corner { id, pixel: LENS.project(pose.transform(point))? + noise })
        };
        let corners: Vec<Corner> = ids(face).filter_map(corner).collect();
        let view = BoardView { instant: instant.to_string(), time_s: None, file: "drawn".into(), frame: 0, corners };
        (!edge_on).then_some(view)
    };
    let of = |(number, &angle): (usize, &f64)| BoardDetections {
        camera: format!("cam{number}"),
        size: [LENS.width, LENS.height],
        frames: count as usize,
        views: (0..count).filter_map(|instant| view(number as u64, angle, instant)).collect(),
        ..BoardDetections::default()
    };
    angles.iter().enumerate().map(of).collect()
}

fn options() -> BoardOptions {
    BoardOptions { model: LensModel::Pinhole, ..BoardOptions::default() }
}

/// With the lenses given.
fn given(cameras: usize) -> BoardOptions {
    let known = (0..cameras).map(|number| (format!("cam{number}"), LENS)).collect();
    BoardOptions { known, ..options() }
}

fn solve(seen: &[BoardDetections], plate: &Plate, options: &BoardOptions) -> Result<(RigFile, Evidence), BoardError> {
    calibrate(seen, plate, options, &|_, _, _| {})
}

/// Each camera's distance from where it stands, as seen from the first one, and its deviation, metres.
fn off(rig: &RigFile, angles: &[f64], radius: f64) -> Vec<(f64, f64)> {
    let world = place(angles[0], radius);
    let of = |(camera, angle): (&erfgs_scene::rig_file::RigCamera, &f64)| {
        let truth = world.inverse().then(&place(*angle, radius));
        let sigma = camera.sigma.as_ref().unwrap().centre_m.iter().flatten().map(|s| s * s).sum::<f64>().sqrt();
        (camera.pose.unwrap().centre().distance(truth.centre()), sigma)
    };
    rig.cameras.iter().zip(angles).skip(1).map(of).collect()
}

/// What is said of the back against how it was glued: error and deviation of each of six figures (mm, degrees).
fn of_back(rig: &RigFile, glued: Glued) -> Vec<(&'static str, f64, f64)> {
    let measures = &rig.quality.as_ref().unwrap().measures;
    let names = [
        "back_offset_to_the_right_mm",
        "back_offset_down_mm",
        "back_thickness_mm",
        "back_tilt_about_the_right_axis_deg",
        "back_tilt_about_the_down_axis_deg",
        "back_turn_deg",
    ];
    let truth = [(glued.middle * 1e3).to_array(), glued.turn.to_array()].concat();
    let error = |(name, truth): (&'static str, f64)| (name, measures[name] - truth, measures[&format!("{name}_sigma")]);
    names.into_iter().zip(truth).map(error).collect()
}

#[test]
fn a_ring_of_cameras_and_a_plate_glued_askew_come_out_within_their_deviations() {
    let (plate, angles) = (grids(), [0.0, 60.0, 120.0, 180.0, 240.0, 300.0]);
    let (mut squares, mut of_cameras) = (Vec::new(), Vec::new());
    for seed in 0..8 {
        // Once around, tilting.
        let turn = |instant: u64| {
            let around = DQuat::from_rotation_y(instant as f64 * 0.37);
            (around * DQuat::from_scaled_axis(vector(seed, 2 * instant + 1, 0.5))).to_scaled_axis()
        };
        let seen = seen(&plate, ASKEW, &angles, seed, 40, &turn);
        let (rig, evidence) = solve(&seen, &plate, &options()).unwrap();
        assert!(rig.warnings.is_empty() && rig.cameras.len() == 6, "{:?}", rig.warnings);
        of_cameras.extend(off(&rig, &angles, 1.2));
        let back = of_back(&rig, ASKEW);
        for (name, error, sigma) in &back {
            assert!(error.abs() < 4.0 * sigma && *sigma < 0.1, "{name}: {error} ± {sigma}");
        }
        squares.extend(back.iter().map(|(_, error, sigma)| (error / sigma).powi(2)));
        if seed == 0 {
            let words = &evidence.tables[0].note;
            println!("{words}");
            assert!(words.contains("behind the front") && page(&rig, &evidence).contains("The back of the board"));
        }
    }
    let rms = |squares: &[f64]| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    let most =
        of_cameras.iter().fold((0.0, 0.0), |most: (f64, f64), (off, sigma)| (most.0.max(*off), most.1.max(*sigma)));
    let cameras = rms(&of_cameras.iter().map(|(off, sigma)| (off / sigma).powi(2)).collect::<Vec<_>>());
    let back = rms(&squares);
    println!(
        "cameras off by {:.2} mm at most (sigma up to {:.2}), {cameras:.2} of their deviations; the back by {back:.2} of its own",
        1e3 * most.0,
        1e3 * most.1
    );
    // 1 if the deviations are right; of 48 figures, and of 40 places with three coordinates each.
    assert!((0.5..1.35).contains(&back) && cameras < 1.35 && most.1 < 3e-3, "{back} {cameras} {most:?}");
}

#[test]
fn cameras_that_see_one_side_each_are_tied_by_how_the_plate_turns() {
    let (plate, angles) = (plate(), [-25.0, 25.0, 155.0, 205.0]);
    let turn = |instant: u64| vector(5, 2 * instant + 1, 0.5);
    let seen = seen(&plate, ASKEW, &angles, 5, 40, &turn);
    let faces = |seen: &BoardDetections| {
        let back = seen.views.iter().filter(|view| matches!(plate.point(view.corners[0].id), Some((Face::Back, _))));
        (back.count(), seen.views.len())
    };
    for (number, seen) in seen.iter().enumerate() {
        let (back, all) = faces(seen);
        assert_eq!(back, if number < 2 { 0 } else { all }, "a camera sees one side alone");
    }
    for thickness_m in [None, Some(0.006)] {
        let options = BoardOptions { back_thickness_m: thickness_m, ..options() };
        let (rig, _) = solve(&seen, &plate, &options).unwrap();
        for (off, sigma) in off(&rig, &angles, 1.2) {
            println!("off by {:.2} ± {:.2} mm", 1e3 * off, 1e3 * sigma);
            assert!(off < 3.0 * sigma && sigma < 4e-3, "{off} ± {sigma}");
        }
        for (name, error, sigma) in of_back(&rig, ASKEW) {
            println!("  {name}: {error:+.3} ± {sigma:.3}");
            assert!(error.abs() < 3.0 * sigma && sigma < 1.0, "{name}: {error} ± {sigma}");
        }
    }
    // One side alone ties two and two.
    let front: Plate = plate.front().into();
    let mut of_front = seen.clone();
    of_front.iter_mut().for_each(|seen| seen.views.retain(|view| front.point(view.corners[0].id).is_some()));
    let (rig, _) = solve(&of_front, &front, &options()).unwrap();
    assert!(
        rig.cameras.len() == 2 && rig.warnings.iter().any(|warning| warning.contains("cam2")),
        "{:?}",
        rig.warnings
    );
}

#[test]
fn a_back_that_the_views_leave_open_is_refused_until_its_thickness_is_stated() {
    let (plate, angles) = (grids(), [-25.0, 25.0, 155.0, 205.0]);
    let stated = BoardOptions { back_thickness_m: Some(0.006), ..given(4) };
    // It nods; corners that are off by pixels only look as if it did more.
    for noise_px in [0.15, 3.0] {
        let turn = |instant: u64| DVec3::X * vector(6, 2 * instant + 1, 0.5).x;
        let seen = noisy(&plate, EXACT, &angles, 6, 12, &turn, noise_px);
        let error = solve(&seen, &plate, &given(4)).map(|_| ()).unwrap_err();
        println!("{noise_px} px: {error}");
        assert!(
            error.to_string().contains("--back-thickness") && error.to_string().contains("cam0, cam1 see the front")
        );
        let BoardError::BackOpen { front, back, alone, .. } = error else { panic!("{error}") };
        assert_eq!([front, back], [["cam0", "cam1"], ["cam2", "cam3"]]);
        assert!(alone.0.cameras.len() == 4 && alone.0.cameras.iter().all(|camera| camera.pose.is_none()));
        let (rig, evidence) = solve(&seen, &plate, &stated).unwrap();
        assert!(
            evidence.tables.is_empty() && !rig.quality.as_ref().unwrap().measures.contains_key("back_thickness_mm")
        );
        assert!(rig.warnings.iter().any(|warning| warning.contains("as it was stated: 6.0 mm")), "{:?}", rig.warnings);
        for (off, sigma) in off(&rig, &angles, 1.2) {
            println!("off by {:.2} ± {:.2} mm", 1e3 * off, 1e3 * sigma);
            assert!(off < 3.5 * sigma && sigma < 0.03 * noise_px, "{off} ± {sigma}");
        }
    }
    // By a degree or so about the other axes: too little to begin with, enough once the thickness says where.
    let turn = |instant: u64| DVec3::X * vector(6, 2 * instant + 1, 0.5).x + vector(7, instant, 0.03);
    let seen = seen(&plate, ASKEW, &angles, 6, 24, &turn);
    assert!(matches!(solve(&seen, &plate, &given(4)), Err(BoardError::BackOpen { .. })));
    let (rig, _) = solve(&seen, &plate, &stated).unwrap();
    for (name, error, sigma) in of_back(&rig, ASKEW) {
        println!("  {name}: {error:+.3} ± {sigma:.3}");
        assert!(error.abs() < 3.0 * sigma && sigma < 5.0, "{name}: {error} ± {sigma}");
    }
    // Four instants and corners that are off by two pixels: the adjustment says that it does not know, or hardly.
    let few = |seed: u64| noisy(&plate, EXACT, &angles, seed, 4, &|instant| vector(seed, 2 * instant + 1, 0.4), 2.0);
    let error = solve(&few(10), &plate, &given(4)).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("cam0, cam1 see the front") && error.contains("it is known to 3"), "{error}");
    let (rig, _) = solve(&few(10), &plate, &stated).unwrap();
    assert!(rig.warnings.iter().any(|warning| warning.contains("as it was stated: 6.0 mm")), "{:?}", rig.warnings);
    let (rig, _) = solve(&few(7), &plate, &given(4)).unwrap();
    assert!(rig.warnings.iter().any(|warning| warning.contains("is known only to")), "{:?}", rig.warnings);
    let thick = BoardOptions { back_thickness_m: Some(6.0), ..given(4) };
    assert!(matches!(solve(&seen, &plate, &thick), Err(BoardError::Thickness { .. })));
}

#[test]
fn the_front_is_the_world_where_only_the_back_was_seen_as_well() {
    let (plate, angles) = (plate(), [0.0, 60.0, 120.0, 180.0, 240.0, 300.0]);
    let turn = |instant: u64| DVec3::Y * instant as f64 * 0.37 + vector(9, 2 * instant + 1, 0.2);
    let mut seen = seen(&plate, ASKEW, &angles, 9, 30, &turn);
    for seen in &mut seen {
        let shows_front = |view: &BoardView| matches!(plate.point(view.corners[0].id), Some((Face::Front, _)));
        seen.views.retain(|view| view.instant != "17" || !shows_front(view));
    }
    let options = BoardOptions { origin: Some("17".into()), ..given(6) };
    let (rig, _) = solve(&seen, &plate, &options).unwrap();
    let held = held(&plate, vector(9, 34, 0.12), turn(17));
    // z out of the sheet, and y up it.
    let upright = Pose { rotation: DQuat::from_rotation_x(std::f64::consts::PI), translation: DVec3::ZERO };
    for (camera, angle) in rig.cameras.iter().zip(angles) {
        let truth = upright.then(&held).then(&place(angle, 1.2));
        let (found, turned) = (camera.pose.unwrap(), camera.pose.unwrap().rotation.angle_between(truth.rotation));
        let off = found.centre().distance(truth.centre());
        assert!(off < 5e-3 && turned < 5e-3, "{}: {off} m, {turned} rad", camera.name);
    }
}

/// Pictures of a two-sided plate by four cameras, two before each side.
fn film(plate: &Plate, angles: &[f64], count: u64) -> Vec<Vec<ImageRgb8>> {
    let sheets =
        [(plate.front(), 0.0075), (plate.back().unwrap(), 0.008)].map(|(target, unit_m)| Sheet::of(target, unit_m));
    let rays = Rays::<2>::of(&LENS);
    let picture = |number: u64, angle: f64, instant: u64| {
        let held = held(plate, vector(11, 2 * instant, 0.08), vector(11, 2 * instant + 1, 0.5));
        let (face, pose) = shown(plate, ASKEW, &held, &place(angle, 0.75));
        let sheet = &sheets[usize::from(face == Face::Back)];
        photograph(&rays.light(sheet, &pose, 0.7), [640, 480], 3.0, random::key(12, &[number, instant]))
    };
    let of =
        |(number, &angle): (usize, &f64)| (0..count).map(|instant| picture(number as u64, angle, instant)).collect();
    angles.iter().enumerate().map(of).collect()
}

/// The first pictures of each camera, ten a second, as a session.
fn record(films: &[Vec<ImageRgb8>], path: &std::path::Path) {
    let start = SessionStart { host_ns: 0, epoch_ns: 0, program: "test".into(), machine: Default::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    for (number, film) in films.iter().enumerate() {
        let description = Description {
            id: format!("cam{number}"),
            model: "camera".into(),
            serial: String::new(),
            encoding: Encoding::Frames(PixelFormat::Rgb8),
            width: LENS.width,
            height: LENS.height,
            start_order: 0,
            settings: serde_json::Map::new(),
        };
        let stream = writer.add_stream(&description).unwrap();
        for (sequence, picture) in (0..).zip(&film[..3]) {
            let host_ns = sequence as i64 * 100_000_000;
            let payload = picture.data.clone().into();
            let packet = Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp: None, payload };
            writer.packet(stream, &packet).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn pictures_of_both_sides_calibrate_cameras_that_face_each_other() {
    let (plate, angles) = (plate(), [-25.0, 25.0, 155.0, 205.0]);
    let films = film(&plate, &angles, 12);
    let folder = tempfile::tempdir().unwrap();
    for (number, film) in films.iter().enumerate() {
        let own = folder.path().join(format!("cam{number}"));
        std::fs::create_dir(&own).unwrap();
        for (instant, picture) in film.iter().enumerate() {
            picture.write_png(&own.join(format!("{instant:02}.png"))).unwrap();
        }
    }
    let seen = look(folder.path(), &plate, None, &|_, _| {}).unwrap();
    for (number, seen) in seen.iter().enumerate() {
        assert!(seen.views.len() >= 10, "{}: {} views", seen.camera, seen.views.len());
        let face = if number < 2 { Face::Front } else { Face::Back };
        let corners = seen.views.iter().flat_map(|view| &view.corners);
        assert!(corners.map(|corner| plate.point(corner.id).unwrap().0).all(|of| of == face), "{}", seen.camera);
    }
    let (rig, mut evidence) = solve(&seen, &plate, &options()).unwrap();
    println!("{}\n{:?}, rms {:.3} px", evidence.tables[0].note, rig.warnings, rig.quality.as_ref().unwrap().rms_px);
    for (off, sigma) in off(&rig, &angles, 0.75) {
        println!("off by {:.2} ± {:.2} mm", 1e3 * off, 1e3 * sigma);
        assert!(off < 3.0 * sigma && sigma < 5e-3, "{off} ± {sigma}");
    }
    for (name, error, sigma) in of_back(&rig, ASKEW) {
        println!("  {name}: {error:+.3} ± {sigma:.3}");
        assert!(error.abs() < 3.0 * sigma && sigma < 1.5, "{name}: {error} ± {sigma}");
    }
    // The report's pictures show the side that they show.
    let wanted = telling(&rig, &evidence);
    // Not of the pictures, whose bytes may spell anything.
    assert!(!page(&rig, &evidence).contains("NaN"));
    evidence.pictures = pictures(&seen, &plate, None, &evidence, &wanted, None).unwrap();
    assert!(evidence.pictures.len() == 4 && evidence.pictures.iter().all(|picture| picture.found.len() >= 6));
    // A session shows what its pictures show.
    let path = folder.path().join("s.mcap");
    record(&films, &path);
    let of_session = look_session(&mut Session::open(&path).unwrap(), &plate, None, None, &|_, _| {}).unwrap();
    for (a, b) in of_session.iter().zip(&seen) {
        assert_eq!((&a.camera, a.frames), (&b.camera, 3));
        assert!(!a.views.is_empty() && a.views.iter().zip(&b.views).all(|(a, b)| a.corners == b.corners));
    }
}
