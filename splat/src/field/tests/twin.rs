//! The twin's gradients against finite differences of the twin.

use super::*;

fn twin(config: &FieldConfig) -> FieldTwin {
    let layout = Layout::new(config).unwrap();
    let parameters = layout.initial(3).into_iter().zip(noise(4, layout.total));
    let parameters = parameters.map(|(value, noise)| f64::from(value + 0.1 * noise)).collect();
    FieldTwin::new(config, BOX.map(|corner| corner.map(f64::from)), parameters).unwrap()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Central difference of `loss` as `value` moves.
fn difference<T>(state: &mut T, value: fn(&mut T, usize) -> &mut f64, at: usize, loss: impl Fn(&T) -> f64) -> f64 {
    const STEP: f64 = 1e-6;
    let start = *value(state, at);
    *value(state, at) = start + STEP;
    let above = loss(state);
    *value(state, at) = start - STEP;
    let below = loss(state);
    *value(state, at) = start;
    (above - below) / (2.0 * STEP)
}

fn assert_same(what: &str, at: usize, gradient: f64, difference: f64) {
    assert!((gradient - difference).abs() < 1e-6 * (1.0 + difference.abs()), "{what} {at}: {gradient} {difference}");
}

#[test]
fn gradients_of_all_parameters_and_means_match_finite_differences() {
    for (time_axis, t01, what) in
        [(TimeAxis::UpperHalf, 0.37, Outputs::All), (TimeAxis::Full, 0.81, Outputs::PositionOnly)]
    {
        let mut twin = twin(&FieldConfig { time_axis, ..small() });
        let rows = 6;
        let mut means = means(&core_rows(rows));
        let weights = twin_d_deltas(rows, 12);
        let gradients = twin.backward(&means, t01, what, &weights);
        let loss = |twin: &FieldTwin, means: &[[f64; 3]]| {
            let deltas = twin.forward(means, t01, what);
            dot(&deltas.core, &weights.core) + dot(&deltas.sh, &weights.sh)
        };
        for at in 0..twin.parameters.len() {
            let expected = difference(&mut twin, |twin, at| &mut twin.parameters[at], at, |twin| loss(twin, &means));
            assert_same("parameter", at, gradients.parameters[at], expected);
        }
        for at in 0..3 * rows {
            let expected =
                difference(&mut means, |means, at| &mut means[at / 3][at % 3], at, |means| loss(&twin, means));
            assert_same("mean", at, gradients.means[at / 3][at % 3], expected);
        }
        assert_eq!(gradients.means[rows - 1][0], 0.0, "a point outside is clamped");
    }
}

#[test]
fn gradients_of_the_regularisers_match_finite_differences() {
    for form in [SpatialSmoothness::SecondDifference, SpatialSmoothness::TotalVariation] {
        let mut twin = twin(&FieldConfig { spatial_resolution: [4, 3, 5], time_resolution: 4, ..small() });
        let weights = PlaneWeights { space: 0.7, time: 1.3, time_l1: 0.2, form };
        let (_, gradient) = twin.regularise(&weights);
        let loss = |twin: &FieldTwin| {
            let (losses, _) = twin.regularise(&weights);
            let [space, time, time_l1] = [weights.space, weights.time, weights.time_l1].map(f64::from);
            space * losses.space + time * losses.time + time_l1 * losses.time_l1
        };
        // They are of the planes alone, which come first.
        let planes = twin.layout.grid;
        assert!(planes < gradient.len() && gradient[planes..].iter().all(|&gradient| gradient == 0.0));
        for (at, &gradient) in gradient[..planes].iter().enumerate() {
            let expected = difference(&mut twin, |twin, at| &mut twin.parameters[at], at, loss);
            assert_same("parameter", at, gradient, expected);
        }
        let before = loss(&twin);
        twin.parameters[planes..].iter_mut().for_each(|other| *other += 1.0);
        assert_eq!(loss(&twin), before);
    }
}

#[test]
fn second_differences_run_along_y_z_z_and_t() {
    // A plane that is a parabola along one axis has a second difference of 2 along it, and none along the other.
    let config = FieldConfig { levels: vec![1], ..small() };
    let layout = Layout::new(&config).unwrap();
    for (index, plane) in layout.planes.iter().enumerate() {
        for along_rows in [true, false] {
            let mut parameters = vec![1.0; layout.total];
            for row in 0..plane.rows {
                for col in 0..plane.cols {
                    let along = if along_rows { row } else { col } as f64;
                    parameters[plane.offset + (row * plane.cols + col) * 4..][..4].fill(along * along);
                }
            }
            let twin = FieldTwin { layout: layout.clone(), aabb: [[0.0; 3], [1.0; 3]], parameters };
            let (losses, _) = twin.regularise(&PlaneWeights::default());
            let expected = if along_rows { 4.0 } else { 0.0 };
            let (found, other) =
                if plane.is_time() { (losses.time, losses.space) } else { (losses.space, losses.time) };
            assert!((found - expected).abs() < 1e-12 && other == 0.0, "plane {index}: {found} {other}");
        }
    }
    let names: Vec<_> = layout.planes.iter().map(|plane| plane.name()).collect();
    let last: String = names.iter().filter_map(|name| name.chars().last()).collect();
    assert_eq!(last, "yztztt");
}
