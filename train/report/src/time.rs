//! Quality against the time in the scene: how well the instants between RGB frames are reconstructed.

use std::{collections::BTreeMap, fmt::Write as _};

use super::{
    html::{self, Escaped, difference, number},
    load::{Run, Scene},
    plot::{Plot, Series, legend},
};
use erfgs_run::PerView;

/// A held-out frame counts as being at an RGB frame if their times differ by no more than this.
const SAME_NS: i64 = 1000;
/// More RGB frames than this are not marked one by one.
const MAX_MARKS: usize = 120;

type Pick = fn(&PerView) -> Option<f64>;
const PSNR: Pick = |view| Some(view.psnr);
const DPSNR: Pick = |view| view.dpsnr;

/// Plots over the scene's time, and means at and between RGB frames.
pub(super) fn section(scene: &Scene) -> String {
    let start = scene.dataset().map(|dataset| dataset.span_ns[0]);
    let Some(start) = start.or_else(|| scene.runs.iter().flat_map(|run| &run.views).map(|view| view.t_ns).min()) else {
        return String::new();
    };
    let seconds = |t_ns: i64| t_ns.saturating_sub(start) as f64 / 1e9;
    let rgb = scene.rgb_frames();
    let (mut marks, mut bands) = (Vec::new(), Vec::new());
    if rgb.len() <= MAX_MARKS {
        marks.extend(
            rgb.iter().map(|(t_ns, _)| (seconds(*t_ns), format!("RGB frame at {} s", number(seconds(*t_ns), 4)))),
        );
        bands.extend(rgb.iter().map(|(_, exposure)| exposure.map(seconds)));
    }
    let has_bands = bands.iter().any(|[from, to]| to > from);
    let plot = |label: String, pick: Pick| {
        let line = |(run, of): (usize, &Run)| Series {
            name: of.label.clone(),
            run,
            points: mean_over_cameras(of, pick).into_iter().map(|(t_ns, value)| (seconds(t_ns), value)).collect(),
        };
        Plot {
            y_label: label,
            x_label: "time in the scene, s".into(),
            series: scene.runs.iter().enumerate().map(line).collect(),
            marks: marks.clone(),
            bands: bands.clone(),
            ..Plot::default()
        }
        .svg()
    };
    let plots = plot(format!("{}, dB", scene.dpsnr_name()), DPSNR) + &plot("PSNR, dB".into(), PSNR);
    if plots.is_empty() {
        return String::new();
    }
    let mut caption = String::from("Mean over the held-out cameras at each time.");
    if !marks.is_empty() {
        caption.push_str(" Vertical lines: the times that RGB frames for training are labelled with.");
    }
    if has_bands {
        caption.push_str(" Shaded: their exposure.");
    }
    let names = legend(scene.runs.iter().enumerate().map(|(at, run)| (at, run.label.as_str())));
    let body = format!(
        "{names}<div class=\"plots\">\n{plots}</div>\n<p class=\"caption\">{caption}</p>\n{}",
        table(scene, &rgb.iter().map(|frame| frame.0).collect::<Vec<_>>())
    );
    html::section(&scene.prefix, "time", "Quality between RGB frames", &body)
}

fn mean_over_cameras(run: &Run, pick: Pick) -> BTreeMap<i64, f64> {
    let mut sums: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    for view in &run.views {
        if let Some(value) = pick(view) {
            let sum = sums.entry(view.t_ns).or_default();
            *sum = (sum.0 + value, sum.1 + 1.0);
        }
    }
    sums.into_iter().map(|(t_ns, (sum, count))| (t_ns, sum / count)).collect()
}

/// Means over held-out frames at the times of RGB frames and between them.
fn table(scene: &Scene, rgb_ns: &[i64]) -> String {
    let at_rgb = |view: &PerView| {
        let next = rgb_ns.partition_point(|t_ns| *t_ns < view.t_ns.saturating_sub(SAME_NS));
        rgb_ns.get(next).is_some_and(|t_ns| t_ns.abs_diff(view.t_ns) <= SAME_NS.unsigned_abs())
    };
    let views = || scene.runs.iter().flat_map(|run| &run.views);
    if rgb_ns.is_empty() || views().all(at_rgb) || !views().any(at_rgb) {
        return String::new();
    }
    let mut head = String::from("<tr><th>Run</th>");
    for name in ["DPSNR", "PSNR"] {
        let _ = write!(
            head,
            "<th class=\"n\">{name} at RGB frames <small>dB</small></th><th class=\"n\">{name} between <small>dB</small></th>\
             <th class=\"n\">between − at <small>dB</small></th>"
        );
    }
    head.push_str("</tr>");
    let mut rows = String::new();
    for run in &scene.runs {
        let _ = write!(rows, "<tr><th>{}</th>", Escaped(&run.label));
        for pick in [DPSNR, PSNR] {
            let mean = |wanted: bool| {
                let values: Vec<f64> =
                    run.views.iter().filter(|view| at_rgb(view) == wanted).filter_map(pick).collect();
                (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
            };
            let (at, between) = (mean(true), mean(false));
            let text = |value: Option<f64>| value.map_or("–".into(), |value| number(value, 2));
            let change = at.zip(between).map_or("–".into(), |(at, between)| difference(between - at, 2));
            let _ = write!(
                rows,
                "<td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{change}</td>",
                text(at),
                text(between)
            );
        }
        rows.push_str("</tr>\n");
    }
    html::table("", &head, &rows)
}
