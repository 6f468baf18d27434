//! How much of what the baseline lacks to an oracle is made up for by events.

use std::collections::BTreeSet;

use erfgs_run::{Metrics, PerView, RunError, RunFolder};

use super::{
    html::{self, Escaped, number},
    load::{Run, Scene},
};

/// A run of the baseline that saw what the others did not.
pub(super) struct Oracle {
    name: String,
    metrics: Metrics,
    views: Vec<PerView>,
}

impl Oracle {
    /// Reads a run that was evaluated.
    pub fn read(folder: &RunFolder) -> Result<Self, RunError> {
        Ok(Self { name: folder.name(), metrics: folder.read_metrics()?, views: folder.read_per_view()? })
    }
}

/// A line for each run with events and each baseline, where all were measured on the frames of the oracle.
pub(super) fn section(scene: &mut Scene, oracle: &Oracle) -> String {
    let frames = |views: &[PerView]| -> BTreeSet<(String, i64)> {
        views.iter().map(|view| (view.camera.clone(), view.t_ns)).collect()
    };
    let measured = |method: &str| -> Vec<&Run> {
        let same = |run: &&Run| frames(&run.views) == frames(&oracle.views);
        scene.runs.iter().filter(|run| run.info.method == method).filter(same).collect()
    };
    let mut rows = String::new();
    for baseline in measured("4dgs") {
        for events in measured("erf-gs") {
            let (Some(low), Some(got)) = (&baseline.metrics, &events.metrics) else { continue };
            let high = &oracle.metrics;
            let shares = [
                share(Some(low.psnr), Some(got.psnr), Some(high.psnr)),
                share(low.dpsnr, got.dpsnr, high.dpsnr),
                share(low.between_frames.dpsnr, got.between_frames.dpsnr, high.between_frames.dpsnr),
            ];
            let cells: String = shares.iter().map(|share| format!("<td class=\"n\">{share}</td>")).collect();
            rows +=
                &format!("<tr><th>{}</th><td>{}</td>{cells}</tr>\n", Escaped(&events.label), Escaped(&baseline.label));
        }
    }
    if rows.is_empty() {
        scene.notes.push(format!(
            "the oracle {} cannot be used: a run of each method is needed, evaluated on the same frames",
            oracle.name
        ));
        return String::new();
    }
    let head = "<tr><th>Run</th><th>against</th><th class=\"n\">PSNR</th><th class=\"n\">DPSNR</th>\
                <th class=\"n\">DPSNR between frames</th></tr>";
    let body = format!(
        "{}<p class=\"caption\">The share of the gap between the baseline and the oracle {} ({} dB, moving {}) that is \
         closed: 100 % is as good as having had the frames that the oracle was trained on.</p>\n",
        html::table("oracle", head, &rows),
        Escaped(&oracle.name),
        number(oracle.metrics.psnr, 2),
        oracle.metrics.dpsnr.map_or("–".into(), |value| format!("{} dB", number(value, 2)))
    );
    html::section(&scene.prefix, "oracle", "Share of the gap that events close", &body)
}

/// How far `got` is from `low` to `high`, in percent, where there is a gap.
fn share(low: Option<f64>, got: Option<f64>, high: Option<f64>) -> String {
    match (low, got, high) {
        (Some(low), Some(got), Some(high)) if high - low > 0.01 => {
            format!("{} %", number(100.0 * (got - low) / (high - low), 0))
        }
        (Some(_), Some(_), Some(_)) => "no gap".into(),
        _ => "–".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_that_of_the_way_to_the_oracle() {
        assert_eq!(share(Some(20.0), Some(21.0), Some(24.0)), "25 %");
        assert_eq!(share(Some(20.0), Some(19.0), Some(24.0)), "−25 %");
        assert_eq!(share(Some(20.0), Some(21.0), Some(20.0)), "no gap");
        assert_eq!(share(None, Some(21.0), Some(20.0)), "–");
    }
}
