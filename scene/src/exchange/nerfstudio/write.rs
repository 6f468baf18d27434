//! Rigs written as `transforms.json`.

use std::path::Path;

use erfgs_base::atomic;
use glam::{DMat3, DVec3};
use serde_json::{Value, json};

use crate::{
    exchange::{ExchangeError, Format, Lens, lens, losses, pose},
    rig_file::{RigCamera, RigFile},
};

pub(in crate::exchange) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ExchangeError> {
    let frames = rig.cameras.iter().map(frame).collect::<Result<Vec<Value>, _>>()?;
    let io = |source| ExchangeError::Io { doing: "write", path: out.into(), source };
    let text = serde_json::to_vec_pretty(&json!({ "frames": frames })).map_err(|error| io(error.into()))?;
    atomic::write(out, &text).map_err(io)?;
    Ok(losses::common(rig, Format::Nerfstudio))
}

fn frame(camera: &RigCamera) -> Result<Value, ExchangeError> {
    let i = &camera.intrinsics;
    let to_world = pose(camera, Format::Nerfstudio)?.inverse();
    let r = DMat3::from_quat(to_world.rotation) * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let t = to_world.translation;
    let row = |at: usize| [r.row(at).x, r.row(at).y, r.row(at).z, t[at]];
    let mut frame = json!({
        "file_path": format!("images/{}.png", camera.name),
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
            return Err(ExchangeError::Lens { camera: camera.name.clone(), format, what, remedy });
        }
        Lens::Fisheye(k) => ("OPENCV_FISHEYE", &["k1", "k2", "k3", "k4"][..], k.to_vec()),
    };
    frame["camera_model"] = model.into();
    for (name, value) in names.iter().zip(values) {
        frame[*name] = value.into();
    }
    Ok(frame)
}
