//! Which boards, wands or points fit worst.

use std::collections::BTreeMap;

use erfgs_page::html::{self, Escaped, number};

use crate::evidence::Evidence;

/// Placements that are listed.
const LISTED: usize = 10;

pub(super) fn table(evidence: &Evidence) -> String {
    let mut sums: BTreeMap<usize, (f64, usize, usize)> = BTreeMap::new();
    for residual in &evidence.residuals {
        let entry = sums.entry(residual.placement).or_default();
        match residual.residual {
            Some(off) if residual.used => {
                entry.0 += off.length_squared();
                entry.1 += 1;
            }
            _ => entry.2 += 1,
        }
    }
    let mut worst: Vec<(usize, f64, usize, usize)> = sums
        .into_iter()
        .map(|(placement, (sum, used, out))| (placement, (sum / used.max(1) as f64).sqrt(), used, out))
        .collect();
    worst.sort_by(|a, b| b.1.total_cmp(&a.1));
    worst.truncate(LISTED);
    if worst.is_empty() {
        return String::new();
    }
    let rows = worst.iter().map(|(placement, rms, used, out)| {
        let moment =
            evidence.moments.get(*placement).map_or_else(|| placement.to_string(), |moment| moment.name.clone());
        let moment = Escaped(&moment);
        format!("<tr><td>{moment}</td><td>{}</td><td>{used}</td><td>{out}</td></tr>\n", number(*rms, 3))
    });
    let head = "<tr><th>Placement</th><th>Root mean square <small>px</small></th><th>Seen</th><th>Left out</th></tr>";
    html::table("figures", head, &rows.collect::<String>())
}
