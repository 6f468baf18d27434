//! Tables by held-out camera and by frame.

use std::fmt::Write as _;

use super::{
    html::{self, Escaped, number},
    load::{Run, Scene},
};
use erfgs_run::PerView;

struct Quantity {
    name: &'static str,
    decimals: usize,
    pick: fn(&PerView) -> Option<f64>,
}

fn quantities(scene: &Scene) -> Vec<Quantity> {
    let mut all = vec![
        Quantity { name: "PSNR", decimals: 2, pick: |view| Some(view.psnr) },
        Quantity { name: "DPSNR", decimals: 2, pick: |view| view.dpsnr },
        Quantity { name: "SSIM", decimals: 4, pick: |view| Some(view.ssim) },
    ];
    if scene.runs.iter().flat_map(|run| &run.views).any(|view| view.lpips.is_some()) {
        all.push(Quantity { name: "LPIPS", decimals: 4, pick: |view| view.lpips });
    }
    all
}

/// Means by camera, and each frame below.
pub(super) fn section(scene: &Scene) -> String {
    let runs: Vec<&Run> = scene.runs.iter().filter(|run| !run.views.is_empty()).collect();
    if runs.is_empty() {
        return String::new();
    }
    let quantities = quantities(scene);
    let body = by_camera(&runs, &quantities) + &by_frame(&runs, &quantities);
    html::section(&scene.prefix, "views", "Held-out views", &body)
}

/// Two rows of headings: quantities, and the runs below each.
fn head(leading: &[&str], runs: &[&Run], quantities: &[Quantity]) -> String {
    let mut html = String::from("<tr>");
    for name in leading {
        let _ = write!(html, "<th rowspan=\"2\">{name}</th>");
    }
    for quantity in quantities {
        let unit = if quantity.decimals == 2 { " <small>dB</small>" } else { "" };
        let _ = write!(html, "<th class=\"group\" colspan=\"{}\">{}{unit}</th>", runs.len(), quantity.name);
    }
    html.push_str("</tr><tr>");
    for _ in quantities {
        for (at, run) in runs.iter().enumerate() {
            let first = if at == 0 { " first" } else { "" };
            let _ = write!(html, "<th class=\"n{first}\">{}</th>", Escaped(&run.label));
        }
    }
    html + "</tr>"
}

fn cells<'a>(runs: &[&'a Run], quantities: &[Quantity], value: impl Fn(&'a Run, &Quantity) -> Option<f64>) -> String {
    let mut html = String::new();
    for quantity in quantities {
        for (at, run) in runs.iter().enumerate() {
            let text = value(run, quantity).map_or("–".into(), |value| number(value, quantity.decimals));
            let first = if at == 0 { " first" } else { "" };
            let _ = write!(html, "<td class=\"n{first}\">{text}</td>");
        }
    }
    html
}

fn by_camera(runs: &[&Run], quantities: &[Quantity]) -> String {
    let mut cameras: Vec<&str> = Vec::new();
    for view in runs.iter().flat_map(|run| &run.views) {
        if !cameras.contains(&view.camera.as_str()) {
            cameras.push(&view.camera);
        }
    }
    let mean = |run: &Run, quantity: &Quantity, camera: Option<&str>| {
        let of_camera = run.views.iter().filter(|view| camera.is_none_or(|camera| view.camera == camera));
        let values: Vec<f64> = of_camera.filter_map(quantity.pick).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let mut rows = String::new();
    for camera in &cameras {
        let figures = cells(runs, quantities, |run, quantity| mean(run, quantity, Some(camera)));
        let _ = writeln!(rows, "<tr><th>{}</th>{figures}</tr>", Escaped(camera));
    }
    let all = cells(runs, quantities, |run, quantity| mean(run, quantity, None));
    let _ = writeln!(rows, "<tr class=\"total\"><th>all frames</th>{all}</tr>");
    html::table("grouped", &head(&["Camera"], runs, quantities), &rows)
}

fn by_frame(runs: &[&Run], quantities: &[Quantity]) -> String {
    let mut keys: Vec<(&str, u32, i64)> = Vec::new();
    for run in runs {
        keys.extend(run.views.iter().map(|view| (view.camera.as_str(), view.index, view.t_ns)));
    }
    keys.sort_unstable();
    keys.dedup();
    let mut rows = String::new();
    for (camera, index, t_ns) in &keys {
        let figures = cells(runs, quantities, |run, quantity| run.view(camera, *index).and_then(quantity.pick));
        let time = number(*t_ns as f64 / 1e9, 4);
        let _ = writeln!(
            rows,
            "<tr><th>{}</th><td class=\"n\">{index}</td><td class=\"n\">{time}</td>{figures}</tr>",
            Escaped(camera)
        );
    }
    let head = head(&["Camera", "Frame", "Time <small>s</small>"], runs, quantities);
    format!(
        "<details><summary>Every frame ({})</summary>\n{}</details>\n",
        keys.len(),
        html::table("grouped dense", &head, &rows)
    )
}
