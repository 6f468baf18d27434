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
        flatten("", config, &mut |key, value| {
            let values = keys.entry(key).or_insert_with(|| vec![None; runs.len()]);
            if let Some(slot) = values.get_mut(at) {
                *slot = Some(value);
            }
        });
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

fn flatten(prefix: &str, table: &toml::Table, found: &mut impl FnMut(String, String)) {
    for (key, value) in table {
        let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            toml::Value::Table(inner) => flatten(&key, inner, found),
            toml::Value::Float(number) => found(key, float(*number)),
            other => found(key, other.to_string()),
        }
    }
}

/// Single-precision fields come as their nearest double: shows what was meant.
fn float(value: f64) -> String {
    let single = value as f32;
    if (f64::from(single) - value).abs() <= value.abs() * 1e-12 { format!("{single:?}") } else { format!("{value:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_tables_become_dotted_keys_and_single_precision_reads_as_meant() {
        let table: toml::Table = "a = 1\n[b]\nc = 0.10000000149011612\n[b.d]\ne = [1, 2]\n".parse().unwrap();
        let mut found = Vec::new();
        flatten("", &table, &mut |key, value| found.push(format!("{key}={value}")));
        assert_eq!(found, ["a=1", "b.c=0.1", "b.d.e=[1, 2]"]);
        assert_eq!([float(1.6e-4), float(0.123_456_789_012_3)], ["0.00016", "0.1234567890123"]);
    }
}
