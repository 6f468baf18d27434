//! The cameras of a rig file beside the streams of a recording: a stream and a camera of one name are one viewpoint.

use erfgs_scene::rig_file::{RigCamera, RigFile};
use erfgs_session::source::Description;

use crate::BridgeError;

/// What coordinates of the rig are called, as a frame of reference.
const WORLD: &str = "world";

/// The cameras that a recording shows.
#[derive(Debug, Default)]
pub struct Placed<'a> {
    /// Those of the streams, in the order of the streams.
    cameras: Vec<&'a RigCamera>,
    /// The frame of reference that they stand in.
    pub world: String,
    /// What the user should know, a sentence each.
    pub notes: Vec<String>,
}

/// Where a camera stands in the world.
pub struct Stand<'a> {
    pub camera: &'a str,
    /// Its centre, metres.
    pub centre: [f64; 3],
    /// Its turn, a quaternion x, y, z, w.
    pub turn: [f64; 4],
}

impl<'a> Placed<'a> {
    /// Looks for the streams' cameras in a rig file.
    ///
    /// # Errors
    /// If the file has none of them, or one of another size.
    pub fn find(rig: Option<&'a RigFile>, streams: &[&Description]) -> Result<Self, BridgeError> {
        let Some(rig) = rig else { return Ok(Self::default()) };
        let mut placed = Self { world: WORLD.to_owned(), ..Self::default() };
        for stream in streams {
            let id = &stream.id;
            let Some(camera) = rig.camera(id) else {
                placed.notes.push(format!("stream '{id}' is not in the rig file, and has no calibration"));
                continue;
            };
            let (calibrated, recorded) =
                ([camera.intrinsics.width, camera.intrinsics.height], [stream.width, stream.height]);
            if recorded != [0; 2] && calibrated != recorded {
                let [calibrated, recorded] =
                    [calibrated, recorded].map(|[width, height]| format!("{width} x {height}"));
                return Err(BridgeError::OtherSize { id: id.clone(), calibrated, recorded });
            }
            if camera.pose.is_none() {
                placed.notes.push(format!("camera '{id}' has no pose in the rig file, and gets no transform"));
            }
            placed.cameras.push(camera);
        }
        if placed.cameras.is_empty() {
            let list = |names: Vec<&str>| names.join(", ");
            return Err(BridgeError::OtherRig {
                cameras: list(rig.cameras.iter().map(|camera| camera.name.as_str()).collect()),
                streams: list(streams.iter().map(|stream| stream.id.as_str()).collect()),
            });
        }
        while streams.iter().any(|stream| stream.id == placed.world) {
            placed.world.push('_');
        }
        Ok(placed)
    }

    /// The cameras.
    pub fn cameras(&self) -> &[&'a RigCamera] {
        &self.cameras
    }

    /// The camera of a stream.
    pub fn camera(&self, id: &str) -> Option<&'a RigCamera> {
        self.cameras.iter().find(|camera| camera.name == id).copied()
    }

    /// What is added to the times of a stream to get the rig's, nanoseconds.
    pub fn offset_ns(&self, id: &str) -> i64 {
        self.camera(id).map_or(0, |camera| (1e9 * camera.time_offset_s).round() as i64)
    }

    /// Where the cameras stand, of those of which that is known.
    pub fn stands(&self) -> impl Iterator<Item = Stand<'a>> {
        self.cameras.iter().filter_map(|camera| {
            let of_camera = camera.pose?.inverse();
            let (centre, turn) = (of_camera.translation.to_array(), of_camera.rotation.to_array());
            Some(Stand { camera: &camera.name, centre, turn })
        })
    }
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};

    use super::*;

    fn stream(id: &str, width: u32) -> Description {
        let mut stream = Description::trigger_board(id, Default::default());
        (stream.width, stream.height) = (width, 480);
        stream
    }

    #[test]
    fn streams_find_their_cameras_and_what_does_not_fit_is_named() {
        let (fx, fy, cx, cy) = (500.0, 500.0, 320.0, 240.0);
        let intrinsics = Intrinsics { width: 640, height: 480, fx, fy, cx, cy, distortion: Distortion::None };
        let mut left = RigCamera::new("world", Modality::Rgb, intrinsics, Some(Pose::IDENTITY));
        left.time_offset_s = -0.0015;
        let rig = RigFile::new("board", true, vec![left, RigCamera::new("right", Modality::Rgb, intrinsics, None)]);
        let (both, other) = ([stream("world", 640), stream("right", 640)], stream("third", 640));
        let placed = Placed::find(Some(&rig), &[&both[0], &both[1], &other]).unwrap();
        assert_eq!(placed.cameras().len(), 2);
        assert_eq!(placed.world, "world_", "no frame of reference stands in itself");
        assert_eq!((placed.offset_ns("world"), placed.offset_ns("third")), (-1_500_000, 0));
        assert_eq!(placed.stands().map(|stand| stand.camera).collect::<Vec<_>>(), ["world"]);
        assert_eq!(placed.notes.len(), 2, "{:?}", placed.notes);
        let error = Placed::find(Some(&rig), &[&stream("right", 1280)]).unwrap_err().to_string();
        assert!(error.contains("'right'") && error.contains("640 x 480") && error.contains("1280 x 480"), "{error}");
        let error = Placed::find(Some(&rig), &[&other]).unwrap_err().to_string();
        assert!(error.contains("world, right") && error.contains("third"), "{error}");
        assert!(Placed::find(None, &[&other]).unwrap().cameras().is_empty());
    }
}
