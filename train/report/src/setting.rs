//! What the runs started from: the dataset, and what was left out because the scene does not need it.

use std::fmt::Write as _;

use erfgs_dataset::{Camera, Manifest, Split};
use erfgs_scene::Modality;
use glam::DVec3;

use super::{
    html::{self, Escaped, count, number},
    load::Scene,
    rig,
};

/// What each run left out.
pub(super) fn left_out(scene: &Scene) -> String {
    let mut rows = String::new();
    for run in &scene.runs {
        for (at, item) in run.info.left_out.iter().enumerate() {
            rows.push_str("<tr>");
            if at == 0 {
                let _ = write!(rows, "<th rowspan=\"{}\">{}</th>", run.info.left_out.len(), Escaped(&run.label));
            }
            let (what, why, saves) = (Escaped(&item.what), Escaped(&item.why), Escaped(&item.saves));
            let _ = writeln!(rows, "<td>{what}</td><td>{why}</td><td>{saves}</td></tr>");
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let head = "<tr><th>Run</th><th>Left out</th><th>Why</th><th>Saved</th></tr>";
    html::section(&scene.prefix, "left-out", "What was left out", &html::table("prose", head, &rows))
}

/// What a camera is for, in a word or two.
pub(super) fn role(camera: &Camera) -> &'static str {
    match (camera.split, camera.modality) {
        (Split::Test, _) => "held out",
        (Split::Train, Modality::Rgb) => "RGB",
        (Split::Train, Modality::Event) => "events",
        (Split::Train, Modality::Both) => "RGB and events",
    }
}

/// The dataset of the first run that has one.
pub(super) fn dataset(scene: &Scene) -> String {
    let Some(dataset) = scene.dataset() else { return String::new() };
    let cameras = |wanted: &str| dataset.cameras.iter().filter(|camera| role(camera) == wanted).count();
    let roles = ["RGB", "events", "RGB and events", "held out"];
    let numbers: Vec<String> = roles
        .into_iter()
        .filter(|role| cameras(role) > 0)
        .map(|role| format!("{} {role}", count(cameras(role) as u64)))
        .collect();
    let length = dataset.span_ns[1].saturating_sub(dataset.span_ns[0]) as f64 / 1e9;
    let mut body = format!(
        "<p><b>{}</b>: {} cameras ({}), {} s. Imported from {} (<code>{}</code>).",
        Escaped(&dataset.name),
        dataset.cameras.len(),
        numbers.join(", "),
        number(length, 3),
        Escaped(&dataset.provenance.importer),
        Escaped(&dataset.provenance.name)
    );
    if let Some(points) = &dataset.points {
        let _ = write!(body, " Initial cloud: {} points ({}).", count(points.count), Escaped(&points.method));
    }
    body.push_str("</p>\n");
    body += &steps(dataset);
    let _ = write!(body, "<div class=\"beside\">\n{}{}</div>\n", rig::figure(dataset), table(dataset));
    html::section(&scene.prefix, "dataset", "Dataset", &body)
}

fn steps(dataset: &Manifest) -> String {
    if dataset.variant.is_empty() {
        return String::new();
    }
    let mut html = String::from("<ol class=\"steps\">\n");
    for step in &dataset.variant {
        let parameters: Vec<String> = step.parameters.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let _ = writeln!(
            html,
            "<li>{} <code>{}</code></li>",
            Escaped(&step.step.replace('_', " ")),
            Escaped(&parameters.join(", "))
        );
    }
    html + "</ol>\n"
}

fn table(dataset: &Manifest) -> String {
    let calibrated = dataset.cameras.iter().any(|camera| camera.pose_sigma.is_some() || camera.clock_sigma_s.is_some());
    let mut head = String::from(
        "<tr><th>Camera</th><th>Role</th><th class=\"n\">Pixels</th><th class=\"n\">Frames</th>\
         <th class=\"n\">Exposure <small>ms</small></th><th class=\"n\">Events</th>",
    );
    if calibrated {
        head += "<th class=\"n\">Place <small>± mm</small></th><th class=\"n\">Turn <small>± degrees</small></th>\
                 <th class=\"n\">Clock <small>± µs</small></th>";
    }
    head += "</tr>";
    let mut rows = String::new();
    for camera in &dataset.cameras {
        let exposures = camera.frames.iter().map(|frame| (frame.exposure_ns[1] - frame.exposure_ns[0]) as f64 / 1e6);
        let exposure = exposures.reduce(f64::max).map_or("–".into(), |exposure| number(exposure, 2));
        let events = camera.events.as_ref().map_or("–".into(), |events| count(events.count));
        let frames = if camera.frames.is_empty() { "–".into() } else { count(camera.frames.len() as u64) };
        let _ = write!(
            rows,
            "<tr><th>{}</th><td>{}</td><td class=\"n\">{} × {}</td><td class=\"n\">{frames}</td><td class=\"n\">{exposure}</td>\
             <td class=\"n\">{events}</td>",
            Escaped(&camera.name),
            role(camera),
            camera.intrinsics.width,
            camera.intrinsics.height
        );
        if calibrated {
            rows += &deviations(camera);
        }
        rows.push_str("</tr>\n");
    }
    let table = html::table("dense", &head, &rows);
    if !calibrated {
        return table;
    }
    let text = "<p>± are standard deviations from the calibration: of position and direction, all three axes together, and of frame \
    times. The reference camera has none.</p>\n";
    format!("<div>{table}{text}</div>\n")
}

/// What the calibration of a camera tells of its own errors, three cells of a row.
fn deviations(camera: &Camera) -> String {
    let cell = |of: Option<f64>, digits| of.map_or("–".into(), |of| number(of, digits));
    let place = camera.pose_sigma.as_ref().map(|sigma| 1e3 * DVec3::from(sigma.centre_m).length());
    let turn = camera.pose_sigma.as_ref().map(|sigma| DVec3::from(sigma.rotation_deg).length());
    let clock = camera.clock_sigma_s.map(|sigma| 1e6 * sigma);
    format!(
        "<td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>",
        cell(place, 2),
        cell(turn, 3),
        cell(clock, 1)
    )
}
