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

/// What error is shown against: its name and its value.
type Axis = (&'static str, Pick);

/// PSNR and DPSNR of the held-out views over CPU time, wall time and iterations.
pub(super) fn quality(scene: &Scene) -> String {
    const AXES: [Axis; 3] = [
        ("CPU time", |row| row.cpu_seconds),
        ("training time", |row| Some(row.wall_seconds)),
        ("iterations", |row| Some(row.iteration as f64)),
    ];
    let dpsnr = format!("{}, dB", scene.dpsnr_name());
    let marks = stage_marks(scene);
    let mut plots = String::new();
    for (label, pick) in [("PSNR, dB", (|row| row.psnr) as Pick), (dpsnr.as_str(), |row| row.dpsnr)] {
        for (axis, along) in AXES {
            let iterations = axis == "iterations";
            let longest = rows(scene).filter_map(along).fold(0.0, f64::max);
            let (unit, name) = match longest {
                _ if iterations => (1.0, axis.to_owned()),
                longest if longest > 300.0 => (60.0, format!("{axis}, min")),
                _ => (1.0, format!("{axis}, s")),
            };
            plots += &Plot {
                y_label: label.into(),
                from_zero: true,
                x_label: name,
                series: series(scene, |row| Some((along(row)? / unit, pick(row)?))),
                marks: if iterations { marks.clone() } else { Vec::new() },
                ..Plot::default()
            }
            .svg();
        }
    }
    if plots.is_empty() {
        return String::new();
    }
    let note = if marks.is_empty() { "" } else { " The vertical line is where the fine stage begins." };
    let body = format!(
        "{}<div class=\"plots\">\n{plots}</div>\n{}<p class=\"caption\">Held-out views at the evaluations during training, \
         which look at a part of the frames (<code>evaluation.frames</code>); the summary looks at all of them. CPU time is \
         that of all threads, and what an evaluation takes does not count.{note}</p>\n",
        names(scene),
        crossings(scene)
    );
    html::section(&scene.prefix, "curves", "Error against run time", &body)
}

/// A sentence for each pair of runs of the two methods: from when on the one with events is ahead.
fn crossings(scene: &Scene) -> String {
    let of = |method: &'static str| scene.runs.iter().filter(move |run| run.info.method == method);
    let curve = |run: &Run, pick: Pick| -> Vec<(f64, f64)> {
        run.curve.rows.iter().filter_map(|row| Some((row.cpu_seconds?, pick(row)?))).collect()
    };
    let mut sentences = String::new();
    for baseline in of("4dgs") {
        for events in of("erf-gs") {
            for (name, pick) in [("PSNR", (|row| row.psnr) as Pick), ("DPSNR", |row| row.dpsnr)] {
                let when = match ahead_from(&curve(events, pick), &curve(baseline, pick)) {
                    None => continue,
                    Some(Ahead::Always) => "from the first evaluation on".to_owned(),
                    Some(Ahead::From(seconds)) => format!("for good after {} of CPU time", html::duration(seconds)),
                    Some(Ahead::Not) => "at no time that lasts".to_owned(),
                };
                sentences += &format!(
                    "<p>In {name}, {} is ahead of {} {when}.</p>\n",
                    html::Escaped(&events.label),
                    html::Escaped(&baseline.label)
                );
            }
        }
    }
    sentences
}

/// From when on one curve stays above another.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Ahead {
    Always,
    From(f64),
    Not,
}

/// From which place on `a` is not below `b`, both of points in ascending order, where both are known.
fn ahead_from(a: &[(f64, f64)], b: &[(f64, f64)]) -> Option<Ahead> {
    let (from, to) = (a.first()?.0.max(b.first()?.0), a.last()?.0.min(b.last()?.0));
    let mut places: Vec<f64> = a.iter().chain(b).map(|point| point.0).filter(|x| (from..=to).contains(x)).collect();
    places.sort_unstable_by(f64::total_cmp);
    let lead: Vec<(f64, f64)> = places.iter().map(|&x| (x, at(a, x) - at(b, x))).collect();
    let last_behind = lead.iter().rposition(|(_, lead)| *lead < 0.0);
    match (lead.is_empty(), last_behind) {
        (true, _) => None,
        (false, None) => Some(Ahead::Always),
        (false, Some(index)) => Some(match (lead[index], lead.get(index + 1)) {
            ((x, behind), Some(&(next, lead))) => Ahead::From(x + (next - x) * behind / (behind - lead)),
            (_, None) => Ahead::Not,
        }),
    }
}

/// The value of a curve at `x`, on the straight line between its points.
fn at(curve: &[(f64, f64)], x: f64) -> f64 {
    let after = curve.partition_point(|point| point.0 < x);
    match (after.checked_sub(1).and_then(|before| curve.get(before)), curve.get(after)) {
        (Some(before), Some(after)) if after.0 > before.0 => {
            before.1 + (after.1 - before.1) * (x - before.0) / (after.0 - before.0)
        }
        (_, Some(point)) | (Some(point), None) => point.1,
        (None, None) => f64::NAN,
    }
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
    fn one_curve_passes_another_where_the_lines_cross_for_the_last_time() {
        let below = [(0.0, 1.0), (10.0, 1.0), (20.0, 1.0)];
        assert_eq!(ahead_from(&[(0.0, 2.0), (20.0, 3.0)], &below), Some(Ahead::Always));
        assert_eq!(ahead_from(&[(0.0, 0.0), (5.0, 0.0), (15.0, 2.0), (30.0, 2.0)], &below), Some(Ahead::From(10.0)));
        assert_eq!(ahead_from(&[(0.0, 3.0), (20.0, 0.5)], &below), Some(Ahead::Not));
        assert_eq!(ahead_from(&[(30.0, 3.0)], &below), None);
        assert_eq!(ahead_from(&[], &below), None);
    }

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
