//! Foxglove's messages.

use erfgs_scene::{exchange::CameraInfo, rig_file::RigCamera};

use crate::{protobuf::Message, rig::Placed};

/// A moment, nanoseconds since 1970.
fn stamp(t_ns: u64) -> Message {
    let [seconds, nanos] = [t_ns / 1_000_000_000, t_ns % 1_000_000_000].map(u64::cast_signed);
    Message::default().int(1, seconds).int(2, nanos)
}

/// A picture of the camera `id`; `format` is `jpeg` or `png`.
pub fn compressed_image(t_ns: u64, id: &str, format: &str, data: &[u8]) -> Vec<u8> {
    Message::default().message(1, &stamp(t_ns)).bytes(2, data).text(3, format).text(4, id).into_bytes()
}

/// The lens of a camera.
pub fn camera_calibration(t_ns: u64, camera: &RigCamera) -> Vec<u8> {
    let info = CameraInfo::new(&camera.intrinsics);
    // Foxglove's own name for what ROS calls so.
    let model = if info.model == "equidistant" { "kannala_brandt" } else { info.model };
    Message::default()
        .message(1, &stamp(t_ns))
        .fixed32(2, camera.intrinsics.width)
        .fixed32(3, camera.intrinsics.height)
        .text(4, model)
        .doubles(5, &info.coefficients)
        .doubles(6, &info.matrix)
        .doubles(7, &CameraInfo::RECTIFICATION)
        .doubles(8, &info.projection)
        .text(9, &camera.name)
        .into_bytes()
}

/// Where the cameras of a rig stand; `None` where that is known of none.
pub fn frame_transforms(t_ns: u64, rig: &Placed<'_>) -> Option<Vec<u8>> {
    let numbers = |values: &[f64]| (1..).zip(values).fold(Message::default(), |all, (field, &v)| all.double(field, v));
    let transforms = rig.stands().map(|stand| {
        Message::default()
            .message(1, &stamp(t_ns))
            .text(2, &rig.world)
            .text(3, stand.camera)
            .message(4, &numbers(&stand.centre))
            .message(5, &numbers(&stand.turn))
    });
    let transforms: Vec<Message> = transforms.collect();
    let all = transforms.iter().fold(Message::default(), |all, transform| all.message(1, transform));
    (!transforms.is_empty()).then(|| all.into_bytes())
}
