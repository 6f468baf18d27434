//! The head of the page: what was found, what to beware of and, over several scenes, a table of them.

use std::fmt::Write as _;

use super::{
    html::{self, Escaped, count, difference, duration, number},
    load::{Run, Scene},
    plot::swatch,
};
use erfgs_run::Metrics;

/// The title of the page.
pub(super) fn title(scenes: &[Scene]) -> String {
    let runs: usize = scenes.iter().map(|scene| scene.runs.len()).sum();
    match scenes {
        [Scene { name, runs, .. }] if runs.len() == 1 => format!("{name}: {}", runs[0].label),
        [scene] => format!("{}: {runs} runs compared", scene.name),
        _ => format!("{} scenes, {runs} runs", scenes.len()),
    }
}

/// What was found, in sentences, and what to beware of.
pub(super) fn head(scenes: &[Scene]) -> String {
    let mut findings = String::new();
    for scene in scenes {
        let [first, others @ ..] = scene.runs.as_slice() else { continue };
        let place = if scenes.len() > 1 { format!("{}: ", Escaped(&scene.name)) } else { String::new() };
        for text in others.iter().filter_map(|other| finding(first, other)) {
            let _ = writeln!(findings, "<li>{place}{text}</li>");
        }
    }
    let mut html = String::new();
    if !findings.is_empty() {
        let _ = write!(html, "<ul class=\"findings\">\n{findings}</ul>\n");
    }
    let notes: Vec<&String> = scenes.iter().flat_map(|scene| &scene.notes).collect();
    if !notes.is_empty() {
        html.push_str("<aside class=\"notes\"><h2>To beware of</h2><ul>\n");
        for note in notes {
            let _ = writeln!(html, "<li>{}</li>", Escaped(note));
        }
        html.push_str("</ul></aside>\n");
    }
    html
}

fn finding(first: &Run, other: &Run) -> Option<String> {
    let (a, b) = (first.metrics.as_ref()?, other.metrics.as_ref()?);
    let mut text = format!("<b>{}</b> against <b>{}</b>: ", Escaped(&other.label), Escaped(&first.label));
    if let (Some(a), Some(b)) = (a.dpsnr, b.dpsnr) {
        let _ = write!(text, "DPSNR <b>{}&nbsp;dB</b>, ", difference(b - a, 2));
    }
    let _ = write!(text, "PSNR <b>{}&nbsp;dB</b>; ", difference(b.psnr - a.psnr, 2));
    if a.iterations == b.iterations {
        let _ = write!(text, "{} iterations each, ", count(a.iterations));
    } else {
        let _ = write!(text, "{} iterations against {}, ", count(b.iterations), count(a.iterations));
    }
    let _ = write!(text, "{} against {}.", duration(b.train_seconds), duration(a.train_seconds));
    Some(text)
}

/// The heading of the part of the page that a scene has.
pub(super) fn heading(scene: &Scene) -> String {
    format!("<h2 class=\"scene\" id=\"{0}top\">{1}</h2>\n", scene.prefix, Escaped(&scene.name))
}

type Pick = fn(&Metrics) -> Option<f64>;

/// The scenes, the runs over each, and their differences from the first of them.
pub(super) fn table(scenes: &[Scene]) -> String {
    let quantities: [(&str, &str, usize, Pick); 4] = [
        ("PSNR", "dB", 2, |metrics| Some(metrics.psnr)),
        ("DPSNR", "dB", 2, |metrics| metrics.dpsnr),
        ("SSIM", "", 4, |metrics| Some(metrics.ssim)),
        ("LPIPS", "", 4, |metrics| metrics.lpips),
    ];
    let mut head = String::from("<tr><th>Scene</th><th>Run</th><th>Method</th>");
    for (name, unit, ..) in &quantities {
        let _ = write!(head, "<th class=\"n\">{name} <small>{unit}</small></th>");
    }
    head.push_str("</tr>");
    let mut rows = String::new();
    for scene in scenes {
        for (at, run) in scene.runs.iter().enumerate() {
            rows.push_str("<tr>");
            if at == 0 {
                let (height, name) = (scene.runs.len(), Escaped(&scene.name));
                let _ = write!(rows, "<th rowspan=\"{height}\"><a href=\"#{}top\">{name}</a></th>", scene.prefix);
            }
            let (label, method) = (Escaped(&run.label), Escaped(&run.info.method));
            let _ = write!(rows, "<td>{}{label}</td><td>{method}</td>", swatch(Some(at)));
            for (_, _, decimals, pick) in &quantities {
                let value = |run: &Run| run.metrics.as_ref().and_then(pick);
                let text = value(run).map_or("–".into(), |value| number(value, *decimals));
                let change = match (scene.runs.first().and_then(value), value(run)) {
                    (Some(first), Some(value)) if at > 0 => difference(value - first, *decimals),
                    _ => String::new(),
                };
                let _ = write!(rows, "<td class=\"n\">{text}<small>{change}</small></td>");
            }
            rows.push_str("</tr>\n");
        }
    }
    format!("<section id=\"scenes\">\n<h2>Scenes</h2>\n{}</section>\n", html::table("", &head, &rows))
}
