//! Rigs and datasets written as `transforms.json`.

use std::path::Path;

use erfgs_base::{FileError, atomic};
use glam::{DMat3, DVec3};
use serde_json::{Value, json};

use crate::{
    Intrinsics, Pose,
    exchange::{ExchangeError, Format, Lens, lens, losses, pose},
    rig_file::{RigCamera, RigFile},
};

pub(in crate::exchange) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ExchangeError> {
    let frames = rig.cameras.iter().map(frame).collect::<Result<Vec<Value>, _>>()?;
    save(json!({ "frames": frames }), out)?;
    Ok(losses::common(rig, Format::Nerfstudio))
}

/// One image of a dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The image, relative to the file's folder.
    pub file: String,
    /// Name of its camera, for messages.
    pub camera: String,
    /// Sensor and lens.
    pub intrinsics: Intrinsics,
    /// World-to-camera pose.
    pub pose: Pose,
    /// When it was taken, 0 to 1.
    pub time: f64,
    /// Whether it is for testing.
    pub held_out: bool,
}

/// Writes images with their cameras, times and split, and names the file of the initial points (PLY).
///
/// # Errors
/// If the file cannot be written, or has no model of a lens.
pub fn write_shots(shots: &[Shot], points: Option<&str>, out: &Path) -> Result<(), ExchangeError> {
    let frame = |shot: &Shot| {
        let mut frame = image(&shot.camera, &shot.file, &shot.intrinsics, &shot.pose)?;
        frame["time"] = shot.time.into();
        Ok(frame)
    };
    let frames = shots.iter().map(frame).collect::<Result<Vec<Value>, ExchangeError>>()?;
    let files = |held_out: bool| -> Vec<&str> {
        shots.iter().filter(|shot| shot.held_out == held_out).map(|shot| shot.file.as_str()).collect()
    };
    // nerfstudio validates on what it tests on.
    let mut file = json!({
        "frames": frames, "train_filenames": files(false), "val_filenames": files(true), "test_filenames": files(true),
    });
    if let Some(points) = points {
        file["ply_file_path"] = points.into();
    }
    save(file, out)
}

fn save(mut file: Value, out: &Path) -> Result<(), ExchangeError> {
    let io = |source| ExchangeError::from(FileError::when("write", out)(source));
    // Programs that know one model for all images look for it here; nerfstudio itself does.
    let model = file["frames"][0]["camera_model"].clone();
    let frames = file["frames"].as_array().into_iter().flatten();
    if !model.is_null() && frames.into_iter().all(|frame| frame["camera_model"] == model) {
        file["camera_model"] = model;
    }
    let text = serde_json::to_vec_pretty(&file).map_err(|error| io(error.into()))?;
    atomic::write(out, &text).map_err(io)
}

fn frame(camera: &RigCamera) -> Result<Value, ExchangeError> {
    let file = format!("images/{}.png", camera.name);
    image(&camera.name, &file, &camera.intrinsics, &pose(camera, Format::Nerfstudio)?)
}

/// An image with its camera, which is called `camera` in messages.
fn image(camera: &str, file: &str, i: &Intrinsics, to_camera: &Pose) -> Result<Value, ExchangeError> {
    let to_world = to_camera.inverse();
    let r = DMat3::from_quat(to_world.rotation) * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let t = to_world.translation;
    let row = |at: usize| [r.row(at).x, r.row(at).y, r.row(at).z, t[at]];
    let mut frame = json!({
        "file_path": file,
        "w": i.width, "h": i.height, "fl_x": i.fx, "fl_y": i.fy, "cx": i.cx, "cy": i.cy,
        "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    });
    // OPENCV has a third radial coefficient; a fourth would be another than ours.
    const BROWN: [&str; 5] = ["k1", "k2", "p1", "p2", "k3"];
    let (model, names, values) = match lens(i) {
        Lens::None => ("OPENCV", &BROWN[..4], vec![0.0; 4]),
        Lens::Brown(k) if k.len() <= 5 => ("OPENCV", &BROWN[..], k),
        Lens::Brown(_) => {
            let (format, what, remedy) = (Format::Nerfstudio, "it is rational: its k4, k5 or k6 is not 0", "fisheye");
            return Err(ExchangeError::Lens { camera: camera.into(), format, what, remedy });
        }
        Lens::Fisheye(k) => ("OPENCV_FISHEYE", &["k1", "k2", "k3", "k4"][..], k.to_vec()),
    };
    frame["camera_model"] = model.into();
    for (name, value) in names.iter().zip(values) {
        frame[*name] = value.into();
    }
    Ok(frame)
}
