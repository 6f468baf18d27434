//! `rigs.bin` and `frames.bin` of COLMAP 3.12 and later (little-endian): which cameras stand rigidly beside each other, and which images
//! they took together.
//!
//! ```text
//! rigs.bin    u64 n; n x (u32 rig, u32 sensors, i32 0, u32 first camera,
//!                         (sensors - 1) x (i32 0, u32 camera, u8 1, f64 x 4 quaternion wxyz, f64 x 3 translation))
//! frames.bin  u64 n; n x (u32 frame, u32 rig, f64 x 4 quaternion wxyz, f64 x 3 translation,
//!                         u32 m; m x (i32 0, u32 camera, u64 image))
//! ```
//! The 0 says that a sensor is a camera. Poses are those of cameras in the rig, whose frame of reference is the first camera's, and of
//! the rig in the world.

use std::{collections::BTreeMap, path::Path};

use super::{ColmapError, Model, binary, write_file};
use crate::Pose;

/// A sensor that is a camera.
const CAMERA: i32 = 0;
/// The one rig.
const RIG: u32 = 1;

impl Model {
    /// Writes `rigs.bin` and `frames.bin` beside the model's own files ([`Model::write_binary`]): all cameras are one rig, which stands
    /// still, and each of `instants` has the images that were taken together. Without a camera that took an image nothing is written.
    ///
    /// # Errors
    /// If an instant has an image that the model lacks, images of one camera have several poses, or a file cannot be written.
    pub fn write_rig(&self, folder: &Path, instants: &[Vec<u32>]) -> Result<(), ColmapError> {
        let broken = |what| ColmapError::Reference { path: folder.to_owned(), what };
        let mut poses: BTreeMap<u32, Pose> = BTreeMap::new();
        for (id, image) in &self.images {
            if *poses.entry(image.camera).or_insert(image.pose) != image.pose {
                return Err(broken(format!(
                    "image {id} ({}) was taken from elsewhere than others of its camera",
                    image.name
                )));
            }
        }
        let Some((first, rig_from_world)) = poses.pop_first() else { return Ok(()) };
        let mut rigs = binary::counted(1);
        rigs.extend([RIG, poses.len() as u32 + 1].map(u32::to_le_bytes).concat());
        sensor(&mut rigs, first);
        for (camera, pose) in &poses {
            sensor(&mut rigs, *camera);
            rigs.push(1);
            binary::push_pose(&mut rigs, &rig_from_world.inverse().then(pose));
        }
        let mut frames = binary::counted(instants.len());
        for (number, images) in (1_u32..).zip(instants) {
            frames.extend([number, RIG].map(u32::to_le_bytes).concat());
            binary::push_pose(&mut frames, &rig_from_world);
            frames.extend((images.len() as u32).to_le_bytes());
            for id in images {
                let image = self.images.get(id);
                let image = image.ok_or_else(|| broken(format!("an instant has image {id}, which does not exist")))?;
                sensor(&mut frames, image.camera);
                frames.extend(u64::from(*id).to_le_bytes());
            }
        }
        write_file(&folder.join("rigs.bin"), &rigs)?;
        write_file(&folder.join("frames.bin"), &frames)
    }
}

fn sensor(bytes: &mut Vec<u8>, camera: u32) {
    bytes.extend(CAMERA.to_le_bytes());
    bytes.extend(camera.to_le_bytes());
}
