//! ROS 2's messages.

use erfgs_scene::{exchange::CameraInfo, rig_file::RigCamera};

use super::pixels::RosPixels;
use crate::{cdr::Cdr, rig::Placed};

/// Whose a message is, and when: nanoseconds since 1970.
#[derive(Clone, Copy)]
pub struct Head<'a> {
    pub stamp_ns: u64,
    pub frame_id: &'a str,
}

impl Head<'_> {
    fn after(self, cdr: Cdr) -> Cdr {
        let [seconds, nanos] = [self.stamp_ns / 1_000_000_000, self.stamp_ns % 1_000_000_000];
        // ROS's seconds end in 2038.
        cdr.i32(i32::try_from(seconds).unwrap_or(i32::MAX)).u32(nanos as u32).text(self.frame_id)
    }

    fn begin(self) -> Cdr {
        self.after(Cdr::new())
    }
}

/// Words of EVT 3.
pub fn event_packet(head: Head<'_>, [width, height]: [u32; 2], sequence: u64, words: &[u8]) -> Vec<u8> {
    // Of EVT 3 the base is not defined: the words tell the sensor's time.
    head.begin().u32(height).u32(width).u64(sequence).u64(0).text("evt3").u8(0).bytes(words).into_bytes()
}

/// A picture as an array.
pub fn image(head: Head<'_>, picture: &RosPixels<'_>) -> Vec<u8> {
    let RosPixels { encoding, width, height, step, data } = picture;
    head.begin().u32(*height).u32(*width).text(encoding).u8(0).u32(*step).bytes(data).into_bytes()
}

/// A JPEG file.
pub fn compressed_image(head: Head<'_>, jpeg: &[u8]) -> Vec<u8> {
    head.begin().text("jpeg").bytes(jpeg).into_bytes()
}

/// The lens of a camera.
pub fn camera_info(head: Head<'_>, camera: &RigCamera) -> Vec<u8> {
    let info = CameraInfo::new(&camera.intrinsics);
    let sized = head.begin().u32(camera.intrinsics.height).u32(camera.intrinsics.width);
    let lens = sized.text(info.model).sequence(&info.coefficients).doubles(&info.matrix);
    let lens = lens.doubles(&CameraInfo::RECTIFICATION).doubles(&info.projection);
    // No binning, and the whole picture.
    (0..6).fold(lens, |cdr, _| cdr.u32(0)).u8(0).into_bytes()
}

/// Where the cameras of a rig stand; `None` where that is known of none.
pub fn transforms(stamp_ns: u64, rig: &Placed<'_>) -> Option<Vec<u8>> {
    let stands: Vec<_> = rig.stands().collect();
    let head = Head { stamp_ns, frame_id: &rig.world };
    let all = stands.iter().fold(Cdr::new().u32(stands.len() as u32), |cdr, stand| {
        head.after(cdr).text(stand.camera).doubles(&stand.centre).doubles(&stand.turn)
    });
    (!stands.is_empty()).then(|| all.into_bytes())
}
