//! The range of every number of a configuration: the one place where they are kept.

use erfgs_base::plausible::Brief;
use toml::{Table, Value};

use super::{Config, ConfigError};
use erfgs_splat::motion::{MOST_BETWEEN, MOST_KNOTS, MOST_NODES};

/// Fields, and the least and the greatest value of each; both may be taken. Lists hold values of that range.
struct Range(&'static [&'static str], f64, f64);

/// Above what any field holds: the field has no upper bound of its own.
const ANY: f64 = u64::MAX as f64;
/// Learning rates may be as high as numbers go: a training that diverges says so.
const HIGHEST: f64 = f32::MAX as f64;
/// What is divided by or taken the logarithm of.
const TINY: f64 = f32::MIN_POSITIVE as f64;
const WEIGHTIEST: f64 = 1e9;
/// Iterations, Gaussians and points beyond this many no machine gets through.
const MANY: f64 = 1e8;

const RANGES: [Range; 41] = [
    Range(&["seed", "learning_rate.decay_steps", "density.from", "earl.from", "eds.from"], 0.0, ANY),
    Range(&["density.prune_above", "density.opacity_reset_every"], 0.0, ANY),
    Range(&["evaluation.every", "evaluation.frames", "evaluation.checkpoint_every"], 0.0, ANY),
    Range(&["sh.raise_every", "density.every", "eds.every", "field.regularise_every"], 1.0, ANY),
    Range(&["dynamic.whole_image_every", "evaluation.frame_stride", "evaluation.log_every"], 1.0, ANY),
    Range(&["coarse_iterations", "fine_iterations", "bodies.trial"], 0.0, MANY),
    Range(&["init.max_points", "init.random_points", "density.max_gaussians", "eds.max_gaussians"], 0.0, MANY),
    Range(&["batch", "bodies.knots", "bodies.exposure", "field.features"], 1.0, 64.0),
    Range(&["background", "near_share", "init.opacity", "free_time.opacity", "free_time.event_opacity"], 0.0, 1.0),
    Range(&["density.until", "density.min_opacity", "earl.share", "eds.until", "camera_colour.from"], 0.0, 1.0),
    Range(&["camera_colour.rate", "camera_pose.from", "camera_time.from", "camera_time.rate"], 0.0, 1.0),
    Range(&["blur.instant", "dynamic.motion_threshold", "dynamic.share", "bodies.follow", "bodies.opacity"], 0.0, 1.0),
    Range(&["near_m"], TINY, 1e8),
    Range(&["near_sigmas", "bodies.spacing_px"], 0.0, 1e3),
    Range(&["sh.max_degree"], 0.0, 3.0),
    Range(&["learning_rate.position", "learning_rate.network", "learning_rate.planes"], 0.0, HIGHEST),
    Range(&["learning_rate.sh_dc", "learning_rate.sh_rest", "learning_rate.opacity"], 0.0, HIGHEST),
    Range(&["learning_rate.scale", "learning_rate.rotation", "free_time.velocity"], 0.0, HIGHEST),
    Range(
        &["free_time.acceleration", "free_time.instant", "free_time.life", "bodies.reach", "bodies.gate"],
        0.0,
        HIGHEST,
    ),
    Range(
        &["bodies.path", "bodies.turn", "bodies.node_path", "bodies.node_turn", "bodies.bend_path", "bodies.bend_turn"],
        TINY,
        HIGHEST,
    ),
    Range(&["learning_rate.adam_epsilon"], TINY, 1.0),
    Range(&["field.levels", "blur.samples"], 1.0, 16.0),
    Range(&["field.spatial_resolution"], 2.0, 4096.0),
    Range(&["field.time_resolution"], 0.0, 65_536.0),
    Range(&["field.width"], 1.0, 1024.0),
    Range(&["field.depth"], 0.0, 16.0),
    Range(&["free_time.between"], 0.0, MOST_BETWEEN as f64),
    Range(&["free_time.knots"], 0.0, MOST_KNOTS as f64),
    Range(
        &[
            "field.weight_spatial",
            "field.weight_time",
            "field.weight_l1_time",
            "earl.weight",
            "earl.weight_trajectory",
            "earl.weight_colour",
            "camera_colour.prior",
            "free_time.weight_presence",
            "free_time.weight_acceleration",
            "bodies.rigid",
            "bodies.away",
            "bodies.loose",
            "bodies.alike",
            "bodies.smooth_path",
            "bodies.smooth_turn",
        ],
        0.0,
        WEIGHTIEST,
    ),
    Range(
        &[
            "density.gradient_threshold",
            "density.split_extent",
            "density.max_extent",
            "density.max_screen",
            "eds.min_events",
            "eds.max_distance",
            "free_time.least_life",
            "free_time.first_life",
            "evaluation.checkpoint_minutes",
            "bodies.nodes_from",
            "bodies.piece",
            "eds.count",
        ],
        0.0,
        1e6,
    ),
    Range(&["earl.beside_frames"], 0.0, 1e3),
    Range(&["earl.bins", "eds.tolerance_px", "dynamic.grow_px", "evaluation.count", "eds.sources"], 0.0, 4096.0),
    Range(&["eds.depths"], 2.0, 4096.0),
    Range(&["eds.stride", "eds.neighbours"], 1.0, 4096.0),
    Range(&["bodies.nodes"], 1.0, MOST_NODES as f64),
    Range(&["eds.opacity_logit"], -100.0, 100.0),
    Range(&["camera_pose.rate"], 0.0, 10.0),
    Range(&["camera_pose.within", "camera_time.within", "free_time.fastest"], 0.0, WEIGHTIEST),
    Range(&["free_time.spacing"], 1e-3, 1e6),
    Range(&["camera_pose.fewest"], 3.0, ANY),
    Range(&["camera_time.fewest"], 2.0, ANY),
];

/// Whether every number of a configuration is within its range; NaN never is.
///
/// # Errors
/// [`ConfigError::OutOfRange`] names the first that is not.
pub(super) fn check(config: &Config) -> Result<(), ConfigError> {
    let table = Table::try_from(config)?;
    for range in &RANGES {
        for &key in range.0 {
            find(&table, key).map_or(Ok(()), |value| range.check(key, value))?;
        }
    }
    Ok(())
}

/// The field of a dotted name; fields that may be absent may have none.
fn find<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    match key.split_once('.') {
        Some((section, field)) => table.get(section)?.as_table()?.get(field),
        None => table.get(key),
    }
}

impl Range {
    fn check(&self, key: &'static str, value: &Value) -> Result<(), ConfigError> {
        let number = match value {
            Value::Array(values) => return values.iter().try_for_each(|value| self.check(key, value)),
            Value::Integer(whole) => *whole as f64,
            Value::Float(number) => *number,
            _ => return Ok(()),
        };
        if (self.1..=self.2).contains(&number) {
            return Ok(());
        }
        Err(ConfigError::OutOfRange { key, value: Brief(number).to_string(), reason: self.to_string() })
    }
}

impl std::fmt::Display for Range {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self(_, least, most) = *self;
        match (least == TINY, most >= HIGHEST.min(ANY)) {
            (true, true) => f.write_str("above 0, and a number"),
            (true, false) => write!(f, "above 0, and {} at most", Brief(most)),
            (false, true) => write!(f, "{} or more", Brief(least)),
            (false, false) => write!(f, "{} to {}", Brief(least), Brief(most)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    /// The dotted names of all numbers and lists of numbers, in the configuration with every optional one.
    fn numbers() -> BTreeSet<String> {
        let mut config = Config::default();
        config.blur.instant = Some(0.5);
        let is_number = |value: &Value| match value {
            Value::Array(values) => values.iter().any(|value| value.is_integer() || value.is_float()),
            value => value.is_integer() || value.is_float(),
        };
        let mut names = BTreeSet::new();
        for (name, value) in Table::try_from(&config).unwrap() {
            match value {
                Value::Table(section) => {
                    let own = section.iter().filter(|(_, value)| is_number(value));
                    names.extend(own.map(|(field, _)| format!("{name}.{field}")));
                }
                value if is_number(&value) => drop(names.insert(name)),
                _ => {}
            }
        }
        names
    }

    fn ranges() -> Vec<(&'static str, f64, f64)> {
        RANGES.iter().flat_map(|Range(keys, least, most)| keys.iter().map(|key| (*key, *least, *most))).collect()
    }

    /// What sets a field, as text: a list of as many as there are.
    fn assignment(key: &str, value: f64) -> String {
        let mut table = Table::try_from(Config::default()).unwrap();
        table["blur"].as_table_mut().unwrap().insert("instant".into(), 0.5.into());
        let text = |like: &Value| match like {
            Value::Float(_) if value.is_finite() => format!("{value:e}"),
            _ if value.is_finite() => format!("{value}"),
            _ => format!("{value}").to_lowercase(),
        };
        match find(&table, key).unwrap() {
            Value::Array(values) => {
                let all: Vec<String> = values.iter().map(text).collect();
                format!("{key}=[{}]", all.join(", "))
            }
            one => format!("{key}={}", text(one)),
        }
    }

    #[test]
    fn every_number_has_a_range_and_every_range_a_number() {
        let known: Vec<&str> = ranges().into_iter().map(|(key, ..)| key).collect();
        let distinct: BTreeSet<String> = known.iter().map(|key| (*key).to_owned()).collect();
        assert_eq!(known.len(), distinct.len(), "a field comes twice");
        assert_eq!(distinct, numbers());
    }

    #[test]
    fn no_field_takes_what_is_no_number_or_beyond_all() {
        for (key, ..) in ranges() {
            for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e9, 1e300] {
                let mut config = Config::default();
                let error = config.set(&assignment(key, value)).unwrap_err();
                assert_eq!(config, Config::default());
                // Whole numbers that are none are refused as they are read.
                let named = error.to_string().contains(key);
                assert!(
                    named || matches!(error, ConfigError::Parse(_) | ConfigError::NotAnAssignment(_)),
                    "{key}: {error}"
                );
            }
        }
    }

    #[test]
    fn counts_of_a_thousand_million_are_refused_by_name() {
        for key in [
            "fine_iterations",
            "init.max_points",
            "init.random_points",
            "density.max_gaussians",
            "eds.count",
            "eds.depths",
        ] {
            let error = Config::default().set(&format!("{key}=1000000000")).unwrap_err().to_string();
            assert!(error.contains(key) && error.contains("1e9") && error.contains(" to "), "{error}");
        }
    }

    proptest! {
        #[test]
        fn a_value_beyond_its_range_is_refused_by_name(
            (key, least, most) in prop::sample::select(ranges()),
            factor in 1.5..1e3_f64,
        ) {
            let outside = [(least, least - factor), (most, most * factor + 1.0)];
            for (bound, value) in outside {
                // What does not fit the field's type is refused as it is read.
                if bound >= HIGHEST.min(ANY) || (bound == TINY && value == 0.0) {
                    continue;
                }
                let value = if bound == least { value.min(-1.0) } else { value.round() };
                let error = Config::default().set(&assignment(key, value)).unwrap_err();
                let named = error.to_string().contains(key);
                prop_assert!(named || matches!(error, ConfigError::Parse(_)), "{}: {}", key, error);
            }
        }
    }
}
