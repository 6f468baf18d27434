//! What happened during training: quality over time and iterations, losses, Gaussians.

use super::{
    html,
    load::{Run, Scene},
    plot::{Plot, Series, legend},
};
use erfgs_run::CurveRow;

/// More points than this are averaged in groups.
const MAX_POINTS: usize = 150;

type Pick = fn(&CurveRow) -> Option<f64>;

/// PSNR and DPSNR of the held-out views over wall time and over iterations.
pub(super) fn quality(scene: &Scene) -> String {
    let longest = rows(scene).map(|row| row.wall_seconds).fold(0.0, f64::max);
    let (unit, name) = if longest > 300.0 { (60.0, "min") } else { (1.0, "s") };
    let dpsnr = format!("{}, dB", scene.dpsnr_name());
    let marks = stage_marks(scene);
    let mut plots = String::new();
    for (label, pick) in [("PSNR, dB", (|row| row.psnr) as Pick), (dpsnr.as_str(), |row| row.dpsnr)] {
        plots += &Plot {
            y_label: label.into(),
            from_zero: true,
            x_label: format!("training time, {name}"),
            series: series(scene, |row| Some((row.wall_seconds / unit, pick(row)?))),
            ..Plot::default()
        }
        .svg();
        plots += &Plot {
            y_label: label.into(),
            from_zero: true,
            x_label: "iterations".into(),
            series: series(scene, |row| Some((row.iteration as f64, pick(row)?))),
            marks: marks.clone(),
            ..Plot::default()
        }
        .svg();
    }
    if plots.is_empty() {
        return String::new();
    }
    let note = if marks.is_empty() { "" } else { " The vertical line is where the fine stage begins." };
    let body = format!(
        "{}<div class=\"plots\">\n{plots}</div>\n<p class=\"caption\">Held-out views at the evaluations during training, \
         which may look at a part of the frames (<code>evaluation.frame_stride</code>); the summary looks at all of \
         them.{note}</p>\n",
        names(scene)
    );
    html::section(&scene.prefix, "curves", "Error against run time", &body)
}

/// Losses and numbers of Gaussians over iterations.
pub(super) fn losses(scene: &Scene) -> String {
    let quantities: [(&str, bool, Pick); 7] = [
        ("photometric loss", true, |row| row.loss_rgb),
        ("event loss", true, |row| row.loss_event),
        ("trajectory regularisation", true, |row| row.loss_trajectory),
        ("colour regularisation", true, |row| row.loss_colour),
        ("plane regularisation", true, |row| row.loss_plane),
        ("Gaussians", false, |row| Some(row.gaussians as f64)),
        ("dynamic Gaussians", false, |row| Some(row.dynamic as f64)),
    ];
    let plots: String = quantities
        .into_iter()
        .map(|(label, log_y, pick)| {
            Plot {
                y_label: label.into(),
                from_zero: true,
                x_label: "iterations".into(),
                log_y,
                series: series(scene, |row| Some((row.iteration as f64, pick(row)?))),
                marks: stage_marks(scene),
                ..Plot::default()
            }
            .svg()
        })
        .collect();
    if plots.is_empty() {
        return String::new();
    }
    html::section(
        &scene.prefix,
        "losses",
        "Losses and Gaussians",
        &format!("{}<div class=\"plots small\">\n{plots}</div>\n", names(scene)),
    )
}

fn rows(scene: &Scene) -> impl Iterator<Item = &CurveRow> {
    scene.runs.iter().flat_map(|run| &run.curve.rows)
}

fn names(scene: &Scene) -> String {
    legend(scene.runs.iter().enumerate().map(|(at, run)| (at, run.label.as_str())))
}

/// Where the stage changes, where that is the same in all runs.
fn stage_marks(scene: &Scene) -> Vec<(f64, String)> {
    let change = |run: &Run| {
        let mut pairs = run.curve.rows.windows(2);
        pairs.find_map(|pair| match pair {
            [before, after] if before.stage != after.stage => Some((before.iteration, after.stage.clone())),
            _ => None,
        })
    };
    let mut changes = scene.runs.iter().filter(|run| !run.curve.rows.is_empty()).map(change);
    match changes.next().flatten() {
        Some(first) if changes.all(|other| other.is_some_and(|other| other == first)) => {
            vec![(first.0 as f64, format!("the {} stage begins", first.1))]
        }
        _ => Vec::new(),
    }
}

fn series(scene: &Scene, point: impl Fn(&CurveRow) -> Option<(f64, f64)>) -> Vec<Series> {
    let of_run = |(run, of): (usize, &Run)| {
        let points: Vec<(f64, f64)> = of.curve.rows.iter().filter_map(&point).collect();
        Series { name: of.label.clone(), run, points: thin(&points) }
    };
    scene.runs.iter().enumerate().map(of_run).collect()
}

/// Means of groups of neighbours, so that no more than [`MAX_POINTS`] are left.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let group = points.len().div_ceil(MAX_POINTS).max(1);
    let mean = |group: &[(f64, f64)]| {
        let count = group.len() as f64;
        let (x, y) = group.iter().fold((0.0, 0.0), |sum, point| (sum.0 + point.0, sum.1 + point.1));
        (x / count, y / count)
    };
    points.chunks(group).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_curves_are_averaged_and_short_ones_left_alone() {
        let points: Vec<_> = (0..1000).map(|i| (f64::from(i), 2.0 * f64::from(i))).collect();
        let thinned = thin(&points);
        assert!(thinned.len() <= MAX_POINTS, "{}", thinned.len());
        assert!(thinned.iter().all(|(x, y)| *y == 2.0 * x), "means of a straight line lie on it");
        assert_eq!(thin(&points[..10]), points[..10]);
        assert!(thin(&[]).is_empty());
    }
}
