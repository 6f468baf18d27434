//! The table of runs.

use std::fmt::Write as _;

use super::{
    html::{self, Escaped, bytes, difference, duration, number},
    load::{Run, Scene},
    plot::swatch,
};
use erfgs_run::Metrics;

/// A column of figures: its heading, the value, digits after the point, which way is better, and how it differs.
struct Column {
    heading: String,
    unit: &'static str,
    value: fn(&Metrics) -> Option<f64>,
    text: fn(f64) -> String,
    better: Better,
    against: Against,
}

#[derive(Clone, Copy, PartialEq)]
enum Better {
    Higher,
    Lower,
    Neither,
}

#[derive(Clone, Copy)]
enum Against {
    Difference(usize),
    Ratio,
    Nothing,
}

fn columns(scene: &Scene) -> Vec<Column> {
    let column = |heading: &str, unit, value, text, better, against| Column {
        heading: heading.into(),
        unit,
        value,
        text,
        better,
        against,
    };
    let two = |value| number(value, 2);
    let four = |value| number(value, 4);
    let kinds = scene.runs.iter().filter_map(|run| run.metrics.as_ref()?.lpips_kind).collect::<Vec<_>>();
    let lpips = match kinds.first() {
        Some(kind) if kinds.iter().all(|other| other == kind) => format!("LPIPS ({kind})"),
        _ => "LPIPS".into(),
    };
    vec![
        column("Iterations", "", |m| Some(m.iterations as f64), |v| number(v, 0), Better::Neither, Against::Nothing),
        column("Training", "", |m| Some(m.train_seconds), duration, Better::Neither, Against::Ratio),
        column("CPU time", "", |m| m.train_cpu_seconds, duration, Better::Neither, Against::Ratio),
        column("PSNR", "dB", |m| Some(m.psnr), two, Better::Higher, Against::Difference(2)),
        column(&scene.dpsnr_name(), "dB", |m| m.dpsnr, two, Better::Higher, Against::Difference(2)),
        column("DPSNR between frames", "dB", |m| m.between_frames.dpsnr, two, Better::Higher, Against::Difference(2)),
        column("PSNR, fast", "dB", |m| m.psnr_fast, two, Better::Higher, Against::Difference(2)),
        column("PSNR, static", "dB", |m| m.psnr_static, two, Better::Higher, Against::Difference(2)),
        column(
            "PSNR, colours matched",
            "dB",
            |m| m.colour_corrected.map(|matched| matched.psnr),
            two,
            Better::Higher,
            Against::Difference(2),
        ),
        column("DPSNR, pooled", "dB", |m| m.dpsnr_pooled, two, Better::Higher, Against::Difference(2)),
        column("SSIM", "", |m| Some(m.ssim), four, Better::Higher, Against::Difference(4)),
        column(&lpips, "", |m| m.lpips, four, Better::Lower, Against::Difference(4)),
        column("PSNR of training views", "dB", |m| m.train_psnr, two, Better::Neither, Against::Difference(2)),
        column("Gaussians", "", |m| Some(m.gaussians as f64), |v| number(v, 0), Better::Neither, Against::Ratio),
        column("Size", "", |m| Some(m.bytes as f64), |v| bytes(v as u64), Better::Neither, Against::Ratio),
        column("Rendering", "frames/s", |m| Some(m.render_fps), |v| number(v, 1), Better::Neither, Against::Ratio),
    ]
}

/// The table of runs.
pub(super) fn section(scene: &Scene) -> String {
    let columns = columns(scene);
    let mut head = String::from("<tr><th>Run</th><th>Method</th><th>Preset</th>");
    for column in &columns {
        let unit = if column.unit.is_empty() { String::new() } else { format!("<small>{}</small>", column.unit) };
        let _ = write!(head, "<th class=\"n\">{} {unit}</th>", Escaped(&column.heading));
    }
    head.push_str("</tr>");
    let rows: String = scene.runs.iter().enumerate().map(|(at, run)| row(scene, &columns, at, run)).collect();
    let mut body = html::table("runs", &head, &rows);
    body.push_str("<p class=\"caption\">Means over all frames of the held-out cameras. ");
    if scene.runs.len() > 1 {
        body.push_str("Small figures: difference from, or ratio to, the first run. Bold: the best. ");
    }
    body.push_str("Training time is without evaluation and without writing files.</p>\n");
    body.push_str(&machines(scene));
    html::section(&scene.prefix, "summary", "Summary", &body)
}

fn row(scene: &Scene, columns: &[Column], at: usize, run: &Run) -> String {
    let mut html = format!(
        "<tr><th>{}{}</th><td>{}</td><td>{}</td>",
        swatch(Some(at)),
        Escaped(&run.label),
        Escaped(&run.info.method),
        Escaped(&run.info.preset)
    );
    for column in columns {
        html.push_str(&cell(scene, column, at, run));
    }
    html + "</tr>\n"
}

fn cell(scene: &Scene, column: &Column, at: usize, run: &Run) -> String {
    let Some(metrics) = &run.metrics else { return "<td class=\"n\">–</td>".into() };
    let Some(value) = (column.value)(metrics) else {
        let why = if column.heading.starts_with("LPIPS") { "<small>no weights</small>" } else { "–" };
        return format!("<td class=\"n\">{why}</td>");
    };
    let values = || scene.runs.iter().filter_map(|run| (column.value)(run.metrics.as_ref()?));
    let best = scene.runs.len() > 1
        && match column.better {
            Better::Higher => values().all(|other| other <= value),
            Better::Lower => values().all(|other| other >= value),
            Better::Neither => false,
        };
    let text = (column.text)(value);
    let text = if best { format!("<b>{text}</b>") } else { text };
    let first = scene.runs.first().and_then(|run| (column.value)(run.metrics.as_ref()?));
    let against = match (column.against, first) {
        (Against::Difference(decimals), Some(first)) if at > 0 => difference(value - first, decimals),
        (Against::Ratio, Some(first)) if at > 0 && first > 0.0 => format!("× {}", number(value / first, 2)),
        _ => String::new(),
    };
    format!("<td class=\"n\">{text}<small>{against}</small></td>")
}

/// What the runs ran on; one line where it was the same.
fn machines(scene: &Scene) -> String {
    let line = |run: &Run| {
        let info = &run.info;
        let (adapter, driver) = (Escaped(&info.adapter), Escaped(&info.driver));
        format!("Adapter {adapter} (driver {driver}), erfgs {}, seed {}.", Escaped(&info.version), info.seed)
    };
    let lines: Vec<String> = scene.runs.iter().map(line).collect();
    match lines.first() {
        Some(first) if lines.iter().all(|line| line == first) => format!("<p class=\"caption\">{first}</p>\n"),
        _ => {
            let labelled =
                scene.runs.iter().zip(&lines).map(|(run, line)| format!("<b>{}</b>: {line}", Escaped(&run.label)));
            format!("<p class=\"caption\">{}</p>\n", labelled.collect::<Vec<_>>().join("<br>\n"))
        }
    }
}
