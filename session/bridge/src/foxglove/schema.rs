//! What Foxglove's messages look like, in Protobuf's own words: a `FileDescriptorSet`, which readers ask of every channel. The numbers
//! of the fields are those of Foxglove's published schemas.

use crate::{log::Schema, protobuf::Message};

/// A type of a field, with its number in descriptors.
#[derive(Clone, Copy)]
enum Type {
    Double,
    Int64,
    Int32,
    Fixed32,
    Text,
    Bytes,
    Message(&'static str),
}

/// Name, number, type, and whether there may be several.
type Field = (&'static str, i64, Type, bool);

/// A file with one message.
struct File {
    package: &'static str,
    message: &'static str,
    imports: &'static [&'static File],
    fields: &'static [Field],
}

const STAMP: Field = ("timestamp", 1, Type::Message(".google.protobuf.Timestamp"), false);

static TIMESTAMP: File = File {
    package: "google.protobuf",
    message: "Timestamp",
    imports: &[],
    fields: &[("seconds", 1, Type::Int64, false), ("nanos", 2, Type::Int32, false)],
};

static VECTOR3: File = File {
    package: "foxglove",
    message: "Vector3",
    imports: &[],
    fields: &[("x", 1, Type::Double, false), ("y", 2, Type::Double, false), ("z", 3, Type::Double, false)],
};

static QUATERNION: File = File {
    package: "foxglove",
    message: "Quaternion",
    imports: &[],
    fields: &[
        ("x", 1, Type::Double, false),
        ("y", 2, Type::Double, false),
        ("z", 3, Type::Double, false),
        ("w", 4, Type::Double, false),
    ],
};

static FRAME_TRANSFORM: File = File {
    package: "foxglove",
    message: "FrameTransform",
    imports: &[&TIMESTAMP, &VECTOR3, &QUATERNION],
    fields: &[
        STAMP,
        ("parent_frame_id", 2, Type::Text, false),
        ("child_frame_id", 3, Type::Text, false),
        ("translation", 4, Type::Message(".foxglove.Vector3"), false),
        ("rotation", 5, Type::Message(".foxglove.Quaternion"), false),
    ],
};

static FRAME_TRANSFORMS: File = File {
    package: "foxglove",
    message: "FrameTransforms",
    imports: &[&FRAME_TRANSFORM],
    fields: &[("transforms", 1, Type::Message(".foxglove.FrameTransform"), true)],
};

static COMPRESSED_IMAGE: File = File {
    package: "foxglove",
    message: "CompressedImage",
    imports: &[&TIMESTAMP],
    fields: &[
        STAMP,
        ("data", 2, Type::Bytes, false),
        ("format", 3, Type::Text, false),
        ("frame_id", 4, Type::Text, false),
    ],
};

static CAMERA_CALIBRATION: File = File {
    package: "foxglove",
    message: "CameraCalibration",
    imports: &[&TIMESTAMP],
    fields: &[
        STAMP,
        ("width", 2, Type::Fixed32, false),
        ("height", 3, Type::Fixed32, false),
        ("distortion_model", 4, Type::Text, false),
        ("D", 5, Type::Double, true),
        ("K", 6, Type::Double, true),
        ("R", 7, Type::Double, true),
        ("P", 8, Type::Double, true),
        ("frame_id", 9, Type::Text, false),
    ],
};

/// Of pictures.
pub fn compressed_image() -> Schema {
    of("foxglove.CompressedImage", &COMPRESSED_IMAGE)
}

/// Of lenses.
pub fn camera_calibration() -> Schema {
    of("foxglove.CameraCalibration", &CAMERA_CALIBRATION)
}

/// Of poses.
pub fn frame_transforms() -> Schema {
    of("foxglove.FrameTransforms", &FRAME_TRANSFORMS)
}

fn of(name: &'static str, file: &'static File) -> Schema {
    let mut all = Vec::new();
    file.gather(&mut all);
    let set = all.into_iter().fold(Message::default(), |set, file| set.message(1, &file.descriptor()));
    Schema { name, encoding: "protobuf", data: set.into_bytes(), messages: "protobuf" }
}

impl File {
    fn path(&self) -> String {
        let (folder, name) = (self.package.replace('.', "/"), self.message);
        match self.package {
            // Where protoc looks for its own.
            "google.protobuf" => format!("{folder}/{}.proto", name.to_lowercase()),
            _ => format!("{folder}/{name}.proto"),
        }
    }

    /// This file behind all that it imports, each once.
    fn gather(&'static self, all: &mut Vec<&'static Self>) {
        self.imports.iter().for_each(|import| import.gather(all));
        if !all.iter().any(|there| std::ptr::eq(*there, self)) {
            all.push(self);
        }
    }

    /// A `FileDescriptorProto`.
    fn descriptor(&self) -> Message {
        let named = Message::default().text(1, &self.path()).text(2, self.package);
        let importing = self.imports.iter().fold(named, |file, import| file.text(3, &import.path()));
        let message = Message::default().text(1, self.message);
        let message = self.fields.iter().fold(message, |message, field| message.message(2, &described(field)));
        importing.message(4, &message).text(12, "proto3")
    }
}

/// A `FieldDescriptorProto`.
fn described(&(name, number, kind, repeated): &Field) -> Message {
    let field = Message::default().text(1, name).int(3, number).int(4, if repeated { 3 } else { 1 });
    let (number, message) = match kind {
        Type::Double => (1, None),
        Type::Int64 => (3, None),
        Type::Int32 => (5, None),
        Type::Fixed32 => (7, None),
        Type::Text => (9, None),
        Type::Message(name) => (11, Some(name)),
        Type::Bytes => (12, None),
    };
    let field = field.int(5, number);
    message.map_or(field.clone(), |name| field.text(6, name))
}
