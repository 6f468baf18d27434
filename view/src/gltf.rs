//! Gaussians at an instant as binary glTF (`.glb`) with the extension `KHR_gaussian_splatting`, as Khronos ratified it: linear scales, opacities from
//! 0 to 1, unit quaternions x, y, z, w, the harmonics of 3D Gaussian splatting, colours as they are displayed.
//!
//! All is in the axes of OpenGL (`upright.rs`).

use erfgs_scene::{ply::GaussianCloud, srgb};
use erfgs_splat::gaussians::SH_C0;
use serde_json::{Map, Value, json};

use crate::upright::{HARMONICS, NothingSeen, Written, opacity, place, rotation, seen};

const FLOAT: u32 = 5126;
const UNSIGNED_BYTE: u32 = 5121;
const ARRAY_BUFFER: u32 = 34962;

/// The file while it grows.
#[derive(Default)]
struct Glb {
    accessors: Vec<Value>,
    views: Vec<Value>,
    attributes: Map<String, Value>,
    bytes: Vec<u8>,
}

impl Glb {
    /// Adds an attribute of so many numbers for each Gaussian.
    fn floats(&mut self, name: &str, kind: &str, values: &[f32], more: Value) {
        let width = match kind {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        let count = values.len() / width;
        self.attribute(name, json!({ "componentType": FLOAT, "count": count, "type": kind }), more);
        self.append(values.iter().flat_map(|value| value.to_le_bytes()));
    }

    fn attribute(&mut self, name: &str, mut accessor: Value, more: Value) {
        let index = self.accessors.len();
        accessor["bufferView"] = index.into();
        if let (Some(accessor), Value::Object(more)) = (accessor.as_object_mut(), more) {
            accessor.extend(more);
        }
        self.accessors.push(accessor);
        self.attributes.insert(name.to_owned(), index.into());
    }

    /// The file: a header, a chunk of JSON, a chunk of numbers.
    fn file(self) -> Result<Vec<u8>, GltfError> {
        let Self { accessors, views, attributes, bytes } = self;
        let splats = json!({ "kernel": "ellipse", "colorSpace": "srgb_rec709_display" });
        let json = json!({
            "asset": { "version": "2.0", "generator": concat!("erfgs ", env!("CARGO_PKG_VERSION")) },
            "extensionsUsed": ["KHR_gaussian_splatting"],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{
                "mode": 0,
                "attributes": attributes,
                "extensions": { "KHR_gaussian_splatting": splats },
            }] }],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{ "byteLength": bytes.len() }],
        });
        let mut json = json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        // All attributes are multiples of four bytes.
        let length = u32::try_from(28 + json.len() + bytes.len()).map_err(|_| GltfError::TooLong)?;
        let word = |value: u32| value.to_le_bytes();
        let head = [*b"glTF", word(2), word(length), word(json.len() as u32), *b"JSON"];
        let between = [word(bytes.len() as u32), *b"BIN\0"];
        Ok([head.as_flattened(), &json, between.as_flattened(), &bytes].concat())
    }

    fn append(&mut self, bytes: impl Iterator<Item = u8>) {
        let from = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - from;
        self.views.push(json!({ "buffer": 0, "byteOffset": from, "byteLength": length, "target": ARRAY_BUFFER }));
    }
}

/// Why there is no file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GltfError {
    /// None is left.
    #[error(transparent)]
    Nothing(#[from] NothingSeen),
    /// Lengths in such a file have 32 bits.
    #[error("the Gaussians take more than the 4 GiB that a binary glTF file has room for")]
    TooLong,
}

/// Those Gaussians of a cloud that can be seen.
///
/// # Errors
/// [`GltfError`].
pub fn write(cloud: &GaussianCloud) -> Result<Written, GltfError> {
    let seen = seen(cloud)?;
    let mut glb = Glb::default();
    let each = |of: &dyn Fn(usize) -> Vec<f32>| -> Vec<f32> { seen.iter().flat_map(|&index| of(index)).collect() };
    let positions: Vec<[f32; 3]> = seen.iter().map(|&index| place(cloud.positions[index])).collect();
    let end = |better: fn(f32, f32) -> f32| {
        positions.iter().copied().reduce(|a, b| std::array::from_fn(|axis| better(a[axis], b[axis])))
    };
    let bounds = json!({ "min": end(f32::min), "max": end(f32::max) });
    glb.floats("POSITION", "VEC3", positions.as_flattened(), bounds);
    glb.floats(
        "KHR_gaussian_splatting:ROTATION",
        "VEC4",
        &each(&|index| rotation(cloud.rotations[index]).to_vec()),
        Value::Null,
    );
    glb.floats(
        "KHR_gaussian_splatting:SCALE",
        "VEC3",
        &each(&|index| cloud.log_scales[index].map(f32::exp).to_vec()),
        Value::Null,
    );
    glb.floats("KHR_gaussian_splatting:OPACITY", "SCALAR", &each(&|index| vec![opacity(cloud, index)]), Value::Null);
    let stride = cloud.sh_stride();
    let mut first = 0;
    for (degree, signs) in HARMONICS.iter().enumerate().take(cloud.sh_degree as usize + 1) {
        for (index, sign) in signs.iter().enumerate() {
            let coefficient = |row: usize| -> Vec<f32> {
                let from = row * stride + 3 * (first + index);
                cloud.sh[from..from + 3].iter().map(|value| value * sign).collect()
            };
            let name = format!("KHR_gaussian_splatting:SH_DEGREE_{degree}_COEF_{index}");
            glb.floats(&name, "VEC3", &each(&coefficient), Value::Null);
        }
        first += signs.len();
    }
    // For programs that do not know the extension: points in linear colours.
    let colours = seen.iter().flat_map(|&index| {
        let [r, g, b] =
            [0, 1, 2].map(|channel| srgb::decode((0.5 + SH_C0 * cloud.sh[index * stride + channel]).clamp(0.0, 1.0)));
        [r, g, b, opacity(cloud, index)].map(|value| (value * 255.0).round() as u8)
    });
    let accessor = json!({ "componentType": UNSIGNED_BYTE, "normalized": true, "count": seen.len(), "type": "VEC4" });
    glb.attribute("COLOR_0", accessor, Value::Null);
    glb.append(colours);
    Ok(Written { bytes: glb.file()?, gaussians: seen.len() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::upright::tests::harmonics;

    #[test]
    fn what_can_be_seen_is_written_in_the_axes_and_terms_of_gltf() {
        let degree = 3;
        let count = 2;
        let sh: Vec<f32> = (0..48 * count).map(|k| k as f32 / 100.0).collect();
        let cloud = GaussianCloud {
            sh_degree: degree,
            positions: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            log_scales: vec![[0.0, -1.0, -2.0], [-3.0, -4.0, -5.0]],
            rotations: vec![[2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]],
            opacity_logits: vec![-40.0, 0.0],
            sh: sh.clone(),
        };
        let Written { bytes, gaussians } = write(&cloud).unwrap();
        assert_eq!(gaussians, 1);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let end = 20 + word(12);
        let json: Value = serde_json::from_slice(&bytes[20..end]).unwrap();
        assert_eq!((word(end) + end + 8, &bytes[end + 4..end + 8]), (bytes.len(), &b"BIN\0"[..]));
        let primitive = &json["meshes"][0]["primitives"][0];
        let floats = |name: &str| -> Vec<f32> {
            let accessor = &json["accessors"][primitive["attributes"][name].as_u64().unwrap() as usize];
            let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let at = end + 8 + view["byteOffset"].as_u64().unwrap() as usize;
            let all = &bytes[at..at + view["byteLength"].as_u64().unwrap() as usize];
            all.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
        };
        assert_eq!(floats("POSITION"), [4.0, -5.0, -6.0]);
        assert_eq!(floats("KHR_gaussian_splatting:ROTATION"), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(floats("KHR_gaussian_splatting:SCALE"), [-3.0, -4.0, -5.0].map(f32::exp));
        assert_eq!(floats("KHR_gaussian_splatting:OPACITY"), [0.5]);
        // A colour seen along a way is that of the turned harmonics along the turned way.
        let flat: Vec<f32> = (0..=degree)
            .flat_map(|of| (0..2 * of + 1).map(move |k| format!("KHR_gaussian_splatting:SH_DEGREE_{of}_COEF_{k}")))
            .flat_map(|name| floats(&name))
            .collect();
        for way in [[0.6, -0.64, 0.48], [-0.36, 0.48, 0.8], [0.0, 0.0, 1.0]] {
            let [own, there] = [(&sh[48..], way), (&flat[..], place(way))].map(|(sh, way)| {
                let basis = harmonics(way);
                (0..3).map(|channel| (0..16).map(|k| basis[k] * sh[3 * k + channel]).sum::<f32>()).sum::<f32>()
            });
            assert!((own - there).abs() < 1e-5 * own.abs(), "{way:?}: {own} {there}");
        }
        let nothing = GaussianCloud { opacity_logits: vec![-40.0; 2], ..cloud };
        assert_eq!(write(&nothing), Err(GltfError::Nothing(NothingSeen)));
    }
}
