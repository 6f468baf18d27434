//! What ROS 2's messages look like, in its own words: each definition, and behind it those of the messages within. Names and types of the
//! fields are those of the published packages.

use crate::log::Schema;

const HEADER: (&str, &str) = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");

/// Of packets of events.
pub fn event_packet() -> Schema {
    let fields = "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n\
                  bool is_bigendian\nuint8[] events\n";
    of("event_camera_msgs/msg/EventPacket", fields, &[HEADER, TIME])
}

/// Of pictures as arrays.
pub fn image() -> Schema {
    let fields = "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n\
                  uint8[] data\n";
    of("sensor_msgs/msg/Image", fields, &[HEADER, TIME])
}

/// Of pictures as files.
pub fn compressed_image() -> Schema {
    of("sensor_msgs/msg/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n", &[HEADER, TIME])
}

/// Of lenses.
pub fn camera_info() -> Schema {
    let fields = "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
                  float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n";
    let region = "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n";
    of("sensor_msgs/msg/CameraInfo", fields, &[("sensor_msgs/RegionOfInterest", region), HEADER, TIME])
}

/// Of poses.
pub fn transforms() -> Schema {
    let stamped = "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n";
    let within = [
        ("geometry_msgs/TransformStamped", stamped),
        ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"),
        ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
        ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"),
        HEADER,
        TIME,
    ];
    of("tf2_msgs/msg/TFMessage", "geometry_msgs/TransformStamped[] transforms\n", &within)
}

fn of(name: &'static str, fields: &str, within: &[(&str, &str)]) -> Schema {
    let rule = "=".repeat(80);
    let mut text = fields.to_owned();
    for (name, fields) in within {
        text += &format!("{rule}\nMSG: {name}\n{fields}");
    }
    Schema { name, encoding: "ros2msg", data: text.into_bytes(), messages: "cdr" }
}
