//! The bodies of a dataset, a line each.

use erfgs_dataset::{Bodies, Body, Dataset};
use glam::DVec3;
use serde::Serialize;
use serde_json::Value;

use crate::terminal::thousands;

/// What is known of a body.
#[derive(Debug, Serialize)]
pub(super) struct BodySummary {
    name: String,
    /// When it is in view, seconds from the beginning of the recording.
    in_view_s: [f64; 2],
    points: usize,
    /// Of the middle of its poses, metres a second.
    speed_m_s: f64,
    /// What its rotation was found by, where the file tells.
    rotation: Option<String>,
    rate_rad_s: Option<f64>,
    /// Of a ball, metres.
    radius_m: Option<f64>,
    bounces: usize,
}

/// The bodies that a dataset names; none where it names none.
///
/// # Errors
/// When their file cannot be read.
pub(super) fn of(dataset: &Dataset) -> anyhow::Result<Option<Vec<BodySummary>>> {
    let start_ns = dataset.manifest.span_ns[0];
    let all = |Bodies { bodies, .. }: Bodies| bodies.iter().map(|body| BodySummary::new(body, start_ns)).collect();
    Ok(dataset.read_bodies()?.map(all))
}

impl BodySummary {
    fn new(body: &Body, start_ns: i64) -> Self {
        let found = |what: &str| body.found_by.get(what);
        let vector =
            |value: &Value| -> Option<DVec3> { serde_json::from_value(value.clone()).ok().map(DVec3::from_array) };
        let way: f64 =
            body.poses.windows(2).map(|pair| pair[0].place(DVec3::ZERO).distance(pair[1].place(DVec3::ZERO))).sum();
        let seconds = match (body.poses.first(), body.poses.last()) {
            (Some(first), Some(last)) => 1e-9 * last.t_ns.saturating_sub(first.t_ns) as f64,
            _ => 0.0,
        };
        Self {
            name: body.name.clone(),
            in_view_s: body.span_ns.map(|t_ns| 1e-9 * t_ns.saturating_sub(start_ns) as f64),
            points: body.points.len(),
            speed_m_s: if seconds > 0.0 { way / seconds } else { 0.0 },
            rotation: found("rotation").and_then(Value::as_str).map(str::to_owned),
            rate_rad_s: found("rate_rad_s").and_then(vector).map(DVec3::length),
            // Of others it says how far they reach.
            radius_m: found("discs_off").and_then(|_| found("radius_m")).and_then(Value::as_f64),
            bounces: found("bounces_ns").and_then(Value::as_array).map_or(0, Vec::len),
        }
    }

    /// In words.
    pub(super) fn line(&self) -> String {
        let [begin, end] = self.in_view_s;
        let mut line = format!(
            "{}: in view from {begin:.3} to {end:.3} s, {} points, {:.1} m/s in the mean",
            self.name,
            thousands(self.points as u64),
            self.speed_m_s
        );
        if let Some(radius_m) = self.radius_m {
            line += &format!(", a ball with a radius of {:.1} cm", 100.0 * radius_m);
        }
        match self.bounces {
            0 => {}
            1 => line += ", bounces once",
            more => line += &format!(", bounces {more} times"),
        }
        if let Some(rate) = self.rate_rad_s {
            line += &format!(", turns at {rate:.1} rad/s");
        }
        if let Some(rotation) = &self.rotation {
            line += &format!(" (rotation: {rotation})");
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use erfgs_dataset::BodyPose;
    use serde_json::json;

    use super::*;

    #[test]
    fn balls_have_a_radius_and_others_do_not() {
        let pose = |t_ns: i64| {
            let translation_m = [2e-9 * t_ns as f64, 0.0, 0.0];
            BodyPose { t_ns, translation_m, rotation_wxyz: [1.0, 0.0, 0.0, 0.0] }
        };
        let body = |found_by: &[(&str, Value)]| Body {
            name: "body0".into(),
            span_ns: [100_000_000, 600_000_000],
            poses: vec![pose(100_000_000), pose(300_000_000), pose(600_000_000)],
            points: Vec::new(),
            found_by: found_by.iter().map(|(key, value)| ((*key).into(), value.clone())).collect(),
        };
        let facts = [("radius_m", json!(0.123)), ("rate_rad_s", json!([3.0, 0.0, 4.0])), ("bounces_ns", json!([5, 6]))];
        let carved = BodySummary::new(&body(&facts), 100_000_000).line();
        assert_eq!(
            carved,
            "body0: in view from 0.000 to 0.500 s, 0 points, 2.0 m/s in the mean, bounces 2 times, turns at 5.0 rad/s"
        );
        let ball = BodySummary::new(&body(&[facts[0].clone(), ("discs_off", json!(0.05))]), 0).line();
        assert!(ball.contains("a ball with a radius of 12.3 cm") && !ball.contains("turns"), "{ball}");
    }
}
