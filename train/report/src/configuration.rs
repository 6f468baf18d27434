//! The effective configurations, and where they differ.

use std::{collections::BTreeMap, fmt::Write as _};

use super::{
    html::{self, Escaped},
    load::{Run, Scene},
};

/// What differs between the runs, and everything below.
pub(super) fn section(scene: &Scene) -> String {
    let runs: Vec<(&Run, &toml::Table)> =
        scene.runs.iter().filter_map(|run| Some((run, run.config.as_ref()?))).collect();
    let mut keys: BTreeMap<String, Vec<Option<String>>> = BTreeMap::new();
    for (at, (_, config)) in runs.iter().enumerate() {
        for (key, value) in erfgs_run::flat(config) {
            let values = keys.entry(key).or_insert_with(|| vec![None; runs.len()]);
            if let Some(slot) = values.get_mut(at) {
                *slot = Some(value);
            }
        }
    }
    if keys.is_empty() {
        return String::new();
    }
    let differs = |values: &[Option<String>]| values.iter().any(|value| Some(value) != values.first());
    let mut head = String::from("<tr><th>Field</th>");
    for (run, _) in &runs {
        let _ = write!(head, "<th>{}</th>", Escaped(&run.label));
    }
    head.push_str("</tr>");
    let row = |key: &str, values: &[Option<String>]| {
        let class = if differs(values) { " class=\"differs\"" } else { "" };
        let mut html = format!("<tr{class}><th><code>{}</code></th>", Escaped(key));
        for value in values {
            match value {
                Some(value) => {
                    let _ = write!(html, "<td><code>{}</code></td>", Escaped(value));
                }
                None => html.push_str("<td>–</td>"),
            }
        }
        html + "</tr>\n"
    };
    let different: String =
        keys.iter().filter(|(_, values)| differs(values)).map(|(key, values)| row(key, values)).collect();
    let all: String = keys.iter().map(|(key, values)| row(key, values)).collect();
    let mut body = String::new();
    if runs.len() > 1 {
        body += &if different.is_empty() {
            "<p>The runs have the same configuration.</p>\n".into()
        } else {
            html::table("configuration", &head, &different)
        };
    }
    let _ = write!(
        body,
        "<details><summary>Everything ({} fields)</summary>\n{}</details>\n",
        keys.len(),
        html::table("configuration", &head, &all)
    );
    html::section(&scene.prefix, "configuration", "Configuration", &body)
}
