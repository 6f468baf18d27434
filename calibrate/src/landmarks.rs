//! Cameras placed by known points of the scene, or the world of a rig set by them.
//!
//! Surveyed marks, corners of a field, points of a drawing: whoever knows where they are and clicks them in the images needs no
//! board that several cameras see. Intrinsics must be known. A table has a line for each point in each image, with the columns
//! `camera`, `u`, `v` (pixels, the centre of the first one at 0.5) and `x`, `y`, `z` (metres).

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use erfgs_scene::{Modality, Pose, rig_file::RigFile};
use glam::{DMat3, DVec2, DVec3};

use crate::{
    board::not_metres,
    bundle::{Bundle, BundleCamera, BundleError, Loss, Observation, Options, Parameter, Placement},
    evidence::Evidence,
    geometry::{Ray, Similarity, nearest_point, resection::resect, rigid, similarity},
};

/// A known point in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Sight {
    /// The camera.
    pub camera: String,
    /// Where it is in the image, pixels.
    pub pixel: DVec2,
    /// Where it is in the scene, metres.
    pub point: DVec3,
}

/// So many points a camera must see.
const FEWEST: usize = 5;
/// A point this far from where it should be was mistaken for another, pixels.
const MISTAKEN_PX: f64 = 15.0;
/// Beyond this root mean square, points and rig contradict each other: as a share of the extent of the points.
const APART: f64 = 0.02;

/// What can go wrong with known points.
#[derive(Debug, thiserror::Error)]
pub enum LandmarkError {
    /// The table cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The table cannot be understood.
    #[error("{}: {what}; write the columns camera,u,v,x,y,z (pixels and metres), a line for each point in each image", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The rig has none of the cameras.
    #[error("the rig file has no camera that the points were seen by ({}); its cameras are {}", seen.join(", "), known.join(", "))]
    NoCamera {
        /// Cameras of the table.
        seen: Vec<String>,
        /// Those of the rig.
        known: Vec<String>,
    },
    /// No pose fits a camera's points.
    #[error(
        "camera {camera}: no place fits {FEWEST} of its {points} points; check which point is which, that x, y, z are metres of a \
         right-handed frame, and that the intrinsics are this camera's"
    )]
    NoPose {
        /// The camera.
        camera: String,
        /// Its points.
        points: usize,
    },
    /// Too few points to set a world by.
    #[error(
        "{found} points were seen by two cameras of the rig or more, and three that are not on a line are needed to set the world"
    )]
    NoWorld {
        /// Usable points.
        found: usize,
    },
    /// The rig does not have the points' shape.
    #[error(
        "the points are {rms_mm:.0} mm (root mean square) from where the rig sees them; check which point is which, their unit, and \
         that no camera moved"
    )]
    Apart {
        /// Root mean square distance, millimetres.
        rms_mm: f64,
    },
    /// The adjustment cannot be set up.
    #[error(transparent)]
    Bundle(#[from] BundleError),
}

/// Reads a table of known points.
///
/// # Errors
/// If it cannot be read or understood.
pub fn read_sights(path: &Path) -> Result<Vec<Sight>, LandmarkError> {
    let text = erfgs_base::text::read(path).map_err(FileError::when("read the known points", path))?;
    let wrong = |what: String| LandmarkError::Malformed { path: path.into(), what };
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let head: Vec<String> = match lines.next() {
        Some((_, head)) => head.split(',').map(|cell| cell.trim().to_ascii_lowercase()).collect(),
        None => return Err(wrong("it is empty".into())),
    };
    let column = |name: &str| {
        head.iter().position(|cell| cell == name).ok_or_else(|| wrong(format!("its first line names no column {name}")))
    };
    let camera = column("camera")?;
    let columns = ["u", "v", "x", "y", "z"].map(column);
    let [Ok(u), Ok(v), Ok(x), Ok(y), Ok(z)] = columns else {
        return Err(columns.into_iter().find_map(Result::err).unwrap_or_else(|| wrong("columns are missing".into())));
    };
    let mut sights = Vec::new();
    for (number, line) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let value = |column: usize| {
            let cell = cells.get(column).and_then(|cell| cell.parse::<f64>().ok()).filter(|value| value.is_finite());
            cell.ok_or_else(|| wrong(format!("line {}: its {} is no number", number + 1, head[column])))
        };
        let Some(camera) = cells.get(camera).filter(|camera| !camera.is_empty()) else {
            return Err(wrong(format!("line {}: it names no camera", number + 1)));
        };
        sights.push(Sight {
            camera: (*camera).into(),
            pixel: DVec2::new(value(u)?, value(v)?),
            point: DVec3::new(value(x)?, value(y)?, value(z)?),
        });
    }
    let extent = extent(&sights);
    if not_metres(extent, FARTHEST_M).is_some() {
        return Err(wrong(format!(
            "its points are up to {extent:.1} m apart if x, y, z are metres, which is too much for a rig; are they millimetres? \
             divide them by 1000"
        )));
    }
    Ok(sights)
}

/// No two points that a rig sees are farther apart, metres.
const FARTHEST_M: f64 = 500.0;

/// The diagonal of the box about the points.
fn extent(sights: &[Sight]) -> f64 {
    let mut points = sights.iter().map(|sight| sight.point);
    let Some(first) = points.next() else { return 0.0 };
    let (low, high) = points.fold((first, first), |(low, high), point| (low.min(point), high.max(point)));
    (high - low).length()
}

/// Places each camera of `rig` that saw enough of the points; lenses are kept. Cameras without points are left out, and the rig
/// says so.
///
/// # Errors
/// If no camera is known, or a camera's points fit no place.
pub fn place(rig: &RigFile, sights: &[Sight]) -> Result<(RigFile, Evidence), LandmarkError> {
    let mut by_camera: BTreeMap<&str, Vec<(DVec3, DVec2)>> = BTreeMap::new();
    for sight in sights {
        by_camera.entry(&sight.camera).or_default().push((sight.point, sight.pixel));
    }
    let mut bundle = Bundle { placements: vec![Placement::Fixed], ..Bundle::default() };
    let (mut modalities, mut left_out): (Vec<Modality>, Vec<&str>) = Default::default();
    for camera in &rig.cameras {
        let seen = by_camera.get(camera.name.as_str()).filter(|seen| seen.len() >= FEWEST);
        let Some(seen) = seen else {
            left_out.push(&camera.name);
            continue;
        };
        let failed = || LandmarkError::NoPose { camera: camera.name.clone(), points: seen.len() };
        let start = resect(&camera.intrinsics, seen, MISTAKEN_PX, 0).ok_or_else(failed)?;
        for (&(on_target, pixel), &used) in seen.iter().zip(&start.inliers) {
            let (camera, velocity) = (bundle.cameras.len(), DVec2::ZERO);
            bundle.observations.push(Observation {
                camera,
                placement: 0,
                on_target,
                side: None,
                pixel,
                sigma_px: 1.0,
                velocity,
                used,
            });
        }
        modalities.push(camera.modality);
        bundle.cameras.push(BundleCamera {
            name: camera.name.clone(),
            intrinsics: camera.intrinsics,
            pose: start.pose,
            time_offset_s: camera.time_offset_s,
            free: Parameter::POSE.into(),
        });
    }
    if bundle.cameras.is_empty() {
        let seen = by_camera.keys().map(|camera| String::from(*camera)).collect();
        let known = rig.cameras.iter().map(|camera| camera.name.clone()).collect();
        return Err(LandmarkError::NoCamera { seen, known });
    }
    let solution = bundle.solve(&Options::default())?;
    let uncertainty = bundle.uncertainty(Loss::Squared)?;
    let mut found = bundle.rig("points", &uncertainty, &modalities);
    let mut evidence = Evidence::default();
    evidence.pass("all cameras", &solution);
    evidence.observe(&bundle);
    for camera in &mut found.cameras {
        let before = rig.camera(&camera.name).and_then(|before| before.sigma.clone());
        camera.sigma.get_or_insert_default().intrinsics = before.unwrap_or_default().intrinsics;
        if camera.outliers > 0 {
            camera.warnings.push(format!(
                "{} of its {} points are far from their predicted places and were left out: are points mixed up?",
                camera.outliers,
                camera.outliers + camera.observations
            ));
        }
    }
    if !left_out.is_empty() {
        found.warnings.push(format!("left out, with fewer than {FEWEST} points: {}", left_out.join(", ")));
    }
    Ok((found, evidence))
}

/// Sets the world of a rig with poses to that of the points, which are found where its cameras see them. A rig whose unit is not
/// the metre is made larger or smaller.
///
/// # Errors
/// If too few points are seen by two cameras, or they are not where the rig says.
pub fn set_world(rig: &RigFile, sights: &[Sight]) -> Result<RigFile, LandmarkError> {
    // Points are told apart by where they are.
    let mut points: Vec<(DVec3, Vec<Ray>)> = Vec::new();
    for sight in sights {
        let camera = rig.camera(&sight.camera);
        let ray = camera.and_then(|camera| Ray::of_pixel(&camera.intrinsics, &camera.pose?, sight.pixel));
        let Some(ray) = ray else { continue };
        match points.iter_mut().find(|(point, _)| *point == sight.point) {
            Some((_, rays)) => rays.push(ray),
            None => points.push((sight.point, vec![ray])),
        }
    }
    let pairs: Vec<(DVec3, DVec3, f64)> =
        points.iter().filter_map(|(point, rays)| Some((nearest_point(rays)?, *point, 1.0))).collect();
    let motion =
        if rig.metric { rigid(&pairs).map(|pose| Similarity { scale: 1.0, pose }) } else { similarity(&pairs) };
    let Some(motion) = motion else { return Err(LandmarkError::NoWorld { found: pairs.len() }) };
    let squares = pairs.iter().map(|(from, to, _)| motion.transform(*from).distance_squared(*to));
    let rms = (squares.sum::<f64>() / pairs.len() as f64).sqrt();
    let middle = pairs.iter().map(|pair| pair.1).sum::<DVec3>() / pairs.len() as f64;
    let extent = pairs.iter().map(|pair| pair.1.distance(middle)).fold(0.0, f64::max);
    if rms > APART * extent {
        return Err(LandmarkError::Apart { rms_mm: 1e3 * rms });
    }
    let mut moved = moved(rig, &motion);
    moved.metric = true;
    if let Some(quality) = &mut moved.quality {
        quality.measures.insert("world_points_rms_mm".into(), 1e3 * rms);
    }
    Ok(moved)
}

/// A rig in another world.
#[must_use]
pub(crate) fn moved(rig: &RigFile, motion: &Similarity) -> RigFile {
    let mut rig = rig.clone();
    let turn = DMat3::from_quat(motion.pose.rotation);
    for camera in &mut rig.cameras {
        camera.pose = camera.pose.map(|pose: Pose| motion.of_camera(&pose));
        if let Some(sigma) = &mut camera.sigma
            && let [Some(x), Some(y), Some(z)] = sigma.centre_m
        {
            let squares = DVec3::new(x * x, y * y, z * z);
            let along = |axis: usize| {
                let row = turn.row(axis);
                motion.scale * (row * row).dot(squares).sqrt()
            };
            sigma.centre_m = [0, 1, 2].map(|axis| Some(along(axis)));
        }
    }
    rig
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;
    use erfgs_scene::{Distortion, Intrinsics, rig_file::RigCamera};

    use super::*;

    fn rig() -> RigFile {
        let intrinsics = Intrinsics {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 502.0,
            cx: 322.0,
            cy: 241.0,
            distortion: Distortion::BrownConrady([-0.1, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        };
        let camera = |(index, x): (usize, f64)| {
            let pose = Pose::look_at(DVec3::new(x, 0.5, -3.0), DVec3::ZERO, DVec3::Y);
            RigCamera::new(&format!("c{index}"), Modality::Rgb, intrinsics, Some(pose))
        };
        RigFile::new("board", true, [-1.5, 0.2, 1.4].into_iter().enumerate().map(camera).collect())
    }

    /// Ten points of the scene in all cameras, off by about half a pixel.
    fn sights(rig: &RigFile) -> Vec<Sight> {
        let draw = |number: u64, of: u64| random::range(random::key(3, &[number, of]), -0.8, 0.8);
        let mut sights = Vec::new();
        for number in 0..10 {
            let point = DVec3::new(draw(number, 0), draw(number, 1), draw(number, 2));
            for (index, camera) in rig.cameras.iter().enumerate() {
                let key = random::key(4, &[number, index as u64]);
                let noise = DVec2::new(random::normal(key), random::normal(random::extend(key, 1))) * 0.5;
                let pixel = camera.intrinsics.project(camera.pose.unwrap().transform(point)).unwrap() + noise;
                sights.push(Sight { camera: camera.name.clone(), pixel, point });
            }
        }
        sights
    }

    #[test]
    fn points_in_millimetres_are_refused_with_what_they_would_span() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field.csv");
        for (unit, is_read) in [(1.0, true), (1e3, false)] {
            let lines = sights(&rig()).iter().fold("camera,u,v,x,y,z\n".to_owned(), |text, sight| {
                let [x, y, z] = (sight.point * unit).to_array();
                text + &format!("{},{},{},{x},{y},{z}\n", sight.camera, sight.pixel.x, sight.pixel.y)
            });
            std::fs::write(&path, lines).unwrap();
            let read = read_sights(&path);
            assert_eq!(read.is_ok(), is_read, "{read:?}");
            let message = read.err().map(|error| error.to_string()).unwrap_or_default();
            assert!(is_read || message.contains("m apart") && message.contains("millimetres"), "{message}");
        }
    }

    #[test]
    fn cameras_are_placed_within_their_deviations_and_a_mistaken_point_is_named() {
        let truth = rig();
        let mut sights = sights(&truth);
        (sights[0].pixel.x, sights[0].pixel.y) = (20.0, 400.0);
        sights.retain(|sight| sight.camera != "c2");
        let mut lenses = truth.clone();
        lenses.cameras.iter_mut().for_each(|camera| camera.pose = None);
        let (found, _) = place(&lenses, &sights).unwrap();
        assert!(found.warnings[0].contains("c2") && found.cameras[0].warnings[0].contains("1 of its 10 points"));
        for camera in &found.cameras {
            let off = camera.pose.unwrap().centre() - truth.camera(&camera.name).unwrap().pose.unwrap().centre();
            let sigma = camera.sigma.as_ref().unwrap().centre_m;
            for axis in 0..3 {
                assert!(off[axis].abs() < 4.0 * sigma[axis].unwrap(), "{} {off} {sigma:?}", camera.name);
            }
            assert!(off.length() < 0.02, "{off}");
        }
        sights.iter_mut().for_each(|sight| sight.camera = "other".into());
        assert!(place(&lenses, &sights).unwrap_err().to_string().contains("its cameras are c0, c1, c2"));
    }

    #[test]
    fn the_world_of_a_rig_is_set_by_points_and_its_unit_too() {
        let truth = rig();
        let sights = sights(&truth);
        for (scale, metric) in [(1.0, true), (0.2, false)] {
            let pose = Pose {
                rotation: glam::DQuat::from_scaled_axis(DVec3::new(0.3, 1.2, -0.4)),
                translation: DVec3::new(3.0, 1.0, -2.0),
            };
            let mut elsewhere = moved(&truth, &Similarity { scale, pose });
            elsewhere.metric = metric;
            let found = set_world(&elsewhere, &sights).unwrap();
            assert!(found.metric);
            for (a, b) in found.cameras.iter().zip(&truth.cameras) {
                let off = a.pose.unwrap().centre().distance(b.pose.unwrap().centre());
                assert!(off < 0.01, "{off}");
            }
            if metric {
                let millimetres: Vec<Sight> =
                    sights.iter().map(|sight| Sight { point: sight.point * 1e3, ..sight.clone() }).collect();
                assert!(matches!(set_world(&elsewhere, &millimetres), Err(LandmarkError::Apart { .. })));
            }
        }
        assert!(matches!(set_world(&truth, &sights[..5]), Err(LandmarkError::NoWorld { found: 2 })));
    }

    #[test]
    fn tables_are_read_by_the_names_of_their_columns() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.csv");
        std::fs::write(&path, "# clicked\nname,camera,x,y,z,u,v\na, left,1,2,3,10.5,20\n\n").unwrap();
        let sights = read_sights(&path).unwrap();
        let expected = Sight { camera: "left".into(), pixel: DVec2::new(10.5, 20.0), point: DVec3::new(1.0, 2.0, 3.0) };
        assert_eq!(sights, [expected]);
        for (text, reason) in [
            ("", "empty"),
            ("camera,u,v,x,y\n", "no column z"),
            ("camera,u,v,x,y,z\nleft,1,2,3,nan,4\n", "line 2: its y"),
            ("camera,u,v,x,y,z\nleft,1,2\n", "line 2: its x"),
            ("camera,u,v,x,y,z\n,1,2,3,4,5\n", "line 2: it names no camera"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = read_sights(&path).unwrap_err().to_string();
            assert!(message.contains(reason) && message.contains("p.csv"), "{text:?}: {message}");
        }
    }
}
