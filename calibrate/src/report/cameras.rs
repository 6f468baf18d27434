//! Tables of all cameras: where they are, and their lenses.

use erfgs_page::html::{self, Escaped, number};
use erfgs_scene::Distortion;

use erfgs_scene::rig_file::{RigCamera, RigFile};

pub(super) fn tables(rig: &RigFile) -> String {
    if rig.cameras.is_empty() {
        return String::new();
    }
    let places = rig.cameras.iter().map(place).collect::<String>();
    // Without a scale there are no metres.
    let (unit, thousandth) = if rig.metric { ("m", "mm") } else { ("units", "1/1000") };
    let head = format!(
        "<tr><th>Camera</th><th>Residual <small>px</small></th><th>Seen</th><th>Left out</th>\
         <th>Centre <small>{unit}</small></th><th>± <small>{thousandth}</small></th><th>Turn ± <small>deg</small></th>\
         <th>Time offset <small>ms</small></th></tr>"
    );
    let lenses = rig.cameras.iter().map(lens).collect::<String>();
    let lens_head = "<tr><th>Camera</th><th>Image</th><th>fx <small>px</small></th><th>fy <small>px</small></th>\
                     <th>cx <small>px</small></th><th>cy <small>px</small></th><th>Lens</th></tr>";
    html::table("figures", &head, &places)
        + "<p class=\"caption\">Centres in the rig's frame; standard deviations along its x, y and z, and about the camera's \
           axes. The camera whose deviations are zero is the reference.</p>\n"
        + &html::table("figures", lens_head, &lenses)
        + "<p class=\"caption\">Pixel centres at half-integers. Without a deviation a value was given and not estimated.</p>\n"
}

fn place(camera: &RigCamera) -> String {
    let three = |values: &[Option<f64>; 3], scale: f64, digits: usize| {
        let text = values.map(|value| value.map_or("open".into(), |value| number(scale * value, digits)));
        text.join(", ")
    };
    let centre = camera.pose.map(|pose| pose.centre());
    let sigma = camera.sigma.as_ref().filter(|_| camera.pose.is_some());
    let offset = match sigma.and_then(|sigma| sigma.time_offset_s) {
        Some(sigma) => within(1e3 * camera.time_offset_s, 1e3 * sigma, 2),
        None if camera.time_offset_s != 0.0 => number(1e3 * camera.time_offset_s, 2),
        None => "–".into(),
    };
    format!(
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{offset}</td></tr>\n",
        Escaped(&camera.name),
        camera.rms_px.map_or("–".into(), |rms| number(rms, 3)),
        html::count(camera.observations as u64),
        html::count(camera.outliers as u64),
        centre.map_or("–".into(), |c| [c.x, c.y, c.z].map(|value| number(value, 4)).join(", ")),
        sigma.map_or("–".into(), |sigma| three(&sigma.centre_m, 1e3, 2)),
        sigma.map_or("–".into(), |sigma| three(&sigma.rotation_deg, 1.0, 3)),
    )
}

/// A value and its deviation, which stay on one line.
fn within(value: f64, sigma: f64, digits: usize) -> String {
    format!("{}\u{a0}±\u{a0}{}", number(value, digits), number(sigma, digits))
}

fn lens(camera: &RigCamera) -> String {
    let i = &camera.intrinsics;
    let with = |name: &str, value: f64, digits: usize| {
        let sigma = camera.sigma.as_ref().and_then(|sigma| sigma.intrinsics.get(name));
        match sigma {
            Some(Some(sigma)) => within(value, *sigma, digits),
            Some(None) => format!("{} (not determined)", number(value, digits)),
            None => number(value, digits),
        }
    };
    let coefficients = |names: &[&str], values: &[f64]| {
        let known = names.iter().zip(values).filter(|(name, value)| {
            **value != 0.0 || camera.sigma.as_ref().is_some_and(|sigma| sigma.intrinsics.contains_key(**name))
        });
        known.map(|(name, value)| format!("{name}\u{a0}{}", with(name, *value, 5))).collect::<Vec<_>>().join("; ")
    };
    let distortion = match &i.distortion {
        Distortion::None => "pinhole".into(),
        Distortion::BrownConrady(k) => coefficients(&["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"], k),
        Distortion::KannalaBrandt(k) => format!("fisheye: {}", coefficients(&["k1", "k2", "k3", "k4"], k)),
    };
    format!(
        "<tr><td>{}</td><td>{}×{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"words\">{}</td></tr>\n",
        Escaped(&camera.name),
        i.width,
        i.height,
        with("fx", i.fx, 2),
        with("fy", i.fy, 2),
        with("cx", i.cx, 2),
        with("cy", i.cy, 2),
        Escaped(&distortion),
    )
}
