//! Bodies: what moves in a recording as a few things that are carried through it, each with a shape of its own.
//!
//! `bodies.json` holds for each body its surface, in a frame that moves with it, and where that frame was:
//!
//! ```text
//! world = rotation(t) * position + translation(t)      metres
//! ```
//!
//! Poses are samples of a path, dense enough that it turns by less than [`Bodies::MOST_TURN`] from one to the next, so that which
//! way it turned is never a question. `erfgs dataset bodies` writes the file, `erfgs train --motion bodies` starts from it.

use std::{
    collections::{BTreeMap, HashSet},
    path::PathBuf,
};

use erfgs_base::{
    FileError,
    plausible::{INSTANT, POSITION},
};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::{Dataset, DatasetError};

/// A place of a body on its path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyPose {
    /// When, nanoseconds on the session clock.
    pub t_ns: i64,
    /// Where the body's frame has its origin, metres.
    pub translation_m: [f64; 3],
    /// How it is turned: from the body's frame to the world, w x y z, of length 1.
    pub rotation_wxyz: [f64; 4],
}

impl BodyPose {
    /// The rotation from the body's frame to the world.
    #[must_use]
    pub fn rotation(&self) -> DQuat {
        let [w, x, y, z] = self.rotation_wxyz;
        DQuat::from_xyzw(x, y, z, w)
    }

    /// Where a place in the body's frame is in the world, metres.
    #[must_use]
    pub fn place(&self, position_m: DVec3) -> DVec3 {
        self.rotation() * position_m + DVec3::from(self.translation_m)
    }
}

/// A place on the surface of a body, in its frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfacePoint {
    /// Where, metres.
    pub position_m: [f64; 3],
    /// Outwards, of length 1.
    pub normal: [f64; 3],
    /// Its colour, sRGB.
    pub colour: [u8; 3],
}

/// A thing that moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// A name that no other body has.
    pub name: String,
    /// `[first, last]` instant at which it is in view, nanoseconds on the session clock; that of the recording if it always is.
    pub span_ns: [i64; 2],
    /// Its path, ordered by time.
    pub poses: Vec<BodyPose>,
    /// Its surface.
    pub points: Vec<SurfacePoint>,
    /// What its path and shape were found by: numbers for reports, which nothing depends on.
    #[serde(default)]
    pub found_by: BTreeMap<String, serde_json::Value>,
}

/// What `bodies.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bodies {
    /// Always `erfgs-bodies`.
    pub format: String,
    /// Version of the format; this program writes and reads [`Bodies::VERSION`].
    pub version: u32,
    /// The bodies.
    pub bodies: Vec<Body>,
}

/// The bodies of a dataset, as its manifest names them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodiesFile {
    /// JSON file, relative to the dataset's folder.
    pub file: PathBuf,
    /// How many bodies it holds.
    pub count: u64,
    /// How they were found.
    #[serde(default)]
    pub parameters: BTreeMap<String, serde_json::Value>,
}

/// More of either no recording holds: what is larger is no file of this program.
const MOST_BODIES: usize = 1024;
const MOST_POSES: usize = 1 << 20;
const MOST_POINTS: usize = 1 << 22;

impl Bodies {
    /// The value of [`Bodies::format`].
    pub const FORMAT: &str = "erfgs-bodies";
    /// The version of the format.
    pub const VERSION: u32 = 1;
    /// The file's name in a dataset's folder.
    pub const FILE: &str = "bodies.json";
    /// The largest turn from one pose to the next, radians: at half a turn both ways are as long.
    pub const MOST_TURN: f64 = 2.5;

    /// These bodies, as a file.
    #[must_use]
    pub fn new(bodies: Vec<Body>) -> Self {
        Self { format: Self::FORMAT.into(), version: Self::VERSION, bodies }
    }

    /// Whether the numbers make sense.
    ///
    /// # Errors
    /// What does not, with the name of the body.
    pub fn check(&self) -> Result<(), String> {
        if self.format != Self::FORMAT || self.version != Self::VERSION {
            return Err(format!(
                "it is '{}' of version {}, and this program reads '{}' of version {}",
                self.format,
                self.version,
                Self::FORMAT,
                Self::VERSION
            ));
        }
        if self.bodies.len() > MOST_BODIES {
            return Err(format!("{} bodies; at most {MOST_BODIES} are allowed", self.bodies.len()));
        }
        let mut names = HashSet::new();
        for body in &self.bodies {
            if body.name.is_empty() || !names.insert(&body.name) {
                return Err(format!("two bodies are called '{}', or one has no name", body.name));
            }
            body.check().map_err(|reason| format!("body '{}': {reason}", body.name))?;
        }
        Ok(())
    }
}

impl Body {
    /// The pose nearest to an instant; poses are a few milliseconds apart at most where a thing is fast.
    #[must_use]
    pub fn pose_at(&self, t_ns: i64) -> Option<&BodyPose> {
        let after = self.poses.partition_point(|pose| pose.t_ns < t_ns);
        let near = after.checked_sub(1).into_iter().chain([after]).filter_map(|index| self.poses.get(index));
        near.min_by_key(|pose| pose.t_ns.abs_diff(t_ns))
    }

    fn check(&self) -> Result<(), String> {
        let unit = |length_squared: f64| (length_squared - 1.0).abs() < 1e-3;
        if self.span_ns[0] > self.span_ns[1] {
            return Err("`span_ns` ends before it begins".into());
        }
        INSTANT.check_all_ns(self.span_ns.into_iter().chain(self.poses.iter().map(|pose| pose.t_ns)))?;
        if self.poses.is_empty() || self.poses.len() > MOST_POSES {
            return Err(format!("{} poses; 1 to {MOST_POSES} are allowed", self.poses.len()));
        }
        if self.points.is_empty() || self.points.len() > MOST_POINTS {
            return Err(format!("{} points; 1 to {MOST_POINTS} are allowed", self.points.len()));
        }
        for pose in &self.poses {
            let near = POSITION.check_all(pose.translation_m);
            near.map_err(|wrong| format!("its pose at {} ns: {wrong}", pose.t_ns))?;
        }
        if let Some(pose) = self.poses.iter().find(|pose| !unit(pose.rotation_wxyz.iter().map(|q| q * q).sum())) {
            return Err(format!("its rotation at {} ns is no quaternion of length 1", pose.t_ns));
        }
        for pair in self.poses.windows(2) {
            if pair[0].t_ns >= pair[1].t_ns {
                return Err(format!("its poses are not in the order of time at {} ns", pair[1].t_ns));
            }
            let turn = 2.0 * pair[0].rotation().dot(pair[1].rotation()).abs().min(1.0).acos();
            if turn > Bodies::MOST_TURN {
                return Err(format!(
                    "it rotates by {turn:.2} rad between its poses at {} and {} ns; at most {} rad are unambiguous; give more poses",
                    pair[0].t_ns,
                    pair[1].t_ns,
                    Bodies::MOST_TURN
                ));
            }
        }
        for (index, point) in self.points.iter().enumerate() {
            POSITION.check_all(point.position_m).map_err(|wrong| format!("its point {index}: {wrong}"))?;
            if !unit(point.normal.iter().map(|n| n * n).sum()) {
                return Err(format!("the normal of its point {index} is not of length 1"));
            }
        }
        Ok(())
    }
}

impl Dataset {
    /// Reads the bodies, where there are any.
    ///
    /// # Errors
    /// If the file is missing or malformed, or its numbers make no sense.
    pub fn read_bodies(&self) -> Result<Option<Bodies>, DatasetError> {
        let Some(named) = &self.manifest.bodies else { return Ok(None) };
        let path = self.path(&named.file)?;
        let text = std::fs::read(&path).map_err(FileError::when("read", &path))?;
        let wrong = |reason: String| DatasetError::Bodies { path: path.clone(), reason };
        let bodies: Bodies = serde_json::from_slice(&text).map_err(|error| wrong(error.to_string()))?;
        bodies.check().map_err(&wrong)?;
        if bodies.bodies.len() as u64 != named.count {
            return Err(wrong(format!("{} bodies, and the manifest says {}", bodies.bodies.len(), named.count)));
        }
        Ok(Some(bodies))
    }

    /// Writes bodies into the folder and names them in the manifest, which is not saved yet.
    ///
    /// # Errors
    /// If they make no sense, or the file cannot be written.
    pub fn set_bodies(
        &mut self,
        bodies: &Bodies,
        parameters: BTreeMap<String, serde_json::Value>,
    ) -> Result<(), DatasetError> {
        let (named, text) = self.bodies_file(bodies, parameters)?;
        self.manifest.bodies = Some(named);
        let path = self.root.join(Bodies::FILE);
        Ok(erfgs_base::atomic::write(&path, &text).map_err(FileError::when("write", &path))?)
    }

    /// How a manifest names bodies, and what their file is to hold.
    pub(crate) fn bodies_file(
        &self,
        bodies: &Bodies,
        parameters: BTreeMap<String, serde_json::Value>,
    ) -> Result<(BodiesFile, Vec<u8>), DatasetError> {
        let wrong = |reason: String| DatasetError::Bodies { path: self.root.join(Bodies::FILE), reason };
        bodies.check().map_err(wrong)?;
        let mut text = serde_json::to_vec(bodies).map_err(|error| wrong(error.to_string()))?;
        text.push(b'\n');
        let count = bodies.bodies.len() as u64;
        Ok((BodiesFile { file: Bodies::FILE.into(), count, parameters }, text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(name: &str) -> Body {
        let pose = |t_ns: i64, angle: f64| BodyPose {
            t_ns,
            translation_m: [0.1, 0.2, 0.3],
            rotation_wxyz: [(0.5 * angle).cos(), 0.0, 0.0, (0.5 * angle).sin()],
        };
        Body {
            name: name.into(),
            span_ns: [0, 100],
            poses: vec![pose(0, 0.0), pose(50, 1.5), pose(100, 3.0)],
            points: vec![SurfacePoint { position_m: [1.0, 0.0, 0.0], normal: [1.0, 0.0, 0.0], colour: [1, 2, 3] }],
            found_by: BTreeMap::new(),
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_its_body() {
        assert_eq!(Bodies::new(vec![body("fan"), body("ball")]).check(), Ok(()));
        let refused = |change: &dyn Fn(&mut Body), why: &str| {
            let mut odd = body("fan");
            change(&mut odd);
            let message = Bodies::new(vec![body("ball"), odd]).check().unwrap_err();
            assert!(message.contains(why), "{message}");
        };
        refused(&|body| body.name = "ball".into(), "two bodies are called 'ball'");
        refused(&|body| body.span_ns = [5, 4], "body 'fan': `span_ns`");
        refused(&|body| body.poses.clear(), "0 poses");
        refused(&|body| body.points.clear(), "0 points");
        refused(&|body| body.poses[1].t_ns = 100, "order of time at 100 ns");
        refused(&|body| body.poses[1].translation_m[2] = f64::NAN, "at 50 ns: a coordinate");
        refused(&|body| body.poses[2].translation_m[0] = 1e300, "1e300 m");
        refused(&|body| body.poses[0].rotation_wxyz = [0.0; 4], "at 0 ns is no quaternion");
        refused(&|body| body.poses.retain(|pose| pose.t_ns != 50), "rotates by");
        refused(&|body| body.points[0].normal = [0.0; 3], "normal of its point 0");
        refused(&|body| body.points[0].position_m[1] = f64::INFINITY, "point 0");
        assert!(Bodies { version: 9, ..Bodies::new(vec![]) }.check().unwrap_err().contains("version 9"));
    }

    #[test]
    fn a_pose_takes_places_of_the_body_to_the_world() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let pose = BodyPose {
            t_ns: 0,
            translation_m: [0.0, 0.0, 2.0],
            rotation_wxyz: [(0.5 * quarter).cos(), 0.0, 0.0, (0.5 * quarter).sin()],
        };
        assert!(pose.place(DVec3::X).abs_diff_eq(DVec3::new(0.0, 1.0, 2.0), 1e-12));
    }
}
