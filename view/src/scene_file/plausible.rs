//! Whether the numbers of a header can be those of a recording: a file may come from anybody.

use erfgs_base::plausible::{INSTANT, Implausible, Lens, OVERHANG, POSITION, Quantity, SPAN, check_lens};
use erfgs_splat::raster::View;

use super::{Header, HeaderCamera, HeaderEvents, HeaderMotion};

const AGAIN: &str = "write the file anew with `erfgs export RUN --to e4d`";
const BACKGROUND: Quantity = Quantity::new("the background's colour", "", 0.0, 1.0, AGAIN);
const NEAR: Quantity = Quantity::new("a near plane", "m", 0.0, 1e8, AGAIN);
const SHARE: Quantity = Quantity::new("the near plane's share of the depth", "", 0.0, 1.0, AGAIN);
const SIGMAS: Quantity = Quantity::new("how far Gaussians lie before a camera", "standard deviations", 0.0, 1e3, AGAIN);
const ROTATION: Quantity = Quantity::new("the error of a rotation matrix", "", 0.0, 1e-3, AGAIN);
const UNIT_TIME: Quantity = Quantity::new("the edge of a bin of events", "of the recording", 0.0, 1.0, AGAIN);
const EVENTS: Quantity = Quantity::new("a number of events", "", 0.0, 1e15, AGAIN);
const INTERVALS: Quantity = Quantity::new("the number of RGB intervals", "", 0.0, 1e9, AGAIN);
const LIFE: Quantity = Quantity::new("a life of Gaussians", "RGB intervals", 0.0, 1e6, AGAIN);
const SPACING: Quantity = Quantity::new("the spacing of knots", "RGB intervals", 1e-3, 1e6, AGAIN);
const GONE: Quantity = Quantity::new("the logit of what is gone", "", -1e6, 0.0, AGAIN);
const SECONDS: Quantity = Quantity::new("a time of bodies", "s", 1e-9, SPAN.most, AGAIN);
const CELLS: Quantity = Quantity::new("a size of the deformation field", "", 1.0, 4096.0, AGAIN);
const LEVELS: Quantity = Quantity::new("the number of the field's levels", "", 1.0, 16.0, AGAIN);
/// What is rounded on the way through single precision, seconds.
const SLACK_S: f64 = 1.0;

impl Header {
    /// Whether its numbers can be; those of sections are looked at elsewhere.
    pub(super) fn check_plausible(&self) -> Result<(), String> {
        INSTANT.check_all_ns(self.span_ns)?;
        SPAN.check_between_ns(self.span_ns)?;
        BACKGROUND.check_all(self.background.map(f64::from))?;
        NEAR.check(self.near[0].into())?;
        SHARE.check(self.near[1].into())?;
        SIGMAS.check(self.near_sigmas.into())?;
        let span_s = (self.span_ns[1] - self.span_ns[0]) as f64 * 1e-9;
        for camera in &self.cameras {
            camera.check(span_s).map_err(|error| format!("its camera '{}': {error}", camera.name.escape_debug()))?;
        }
        self.events.check()?;
        Ok(self.motion.check_plausible()?)
    }
}

impl HeaderCamera {
    fn check(&self, span_s: f64) -> Result<(), Implausible> {
        check_view(&self.view)?;
        NEAR.check(self.near.into())?;
        let beyond = OVERHANG.most + SLACK_S;
        let time = Quantity::new("the time of a frame", "s of the recording", -beyond, span_s + beyond, AGAIN);
        time.check_all(self.frames.iter().flatten().map(|unit| unit * span_s))
    }
}

fn check_view(view: &View) -> Result<(), Implausible> {
    check_lens(&Lens {
        size: [view.width, view.height],
        focal: [view.fx, view.fy].map(f64::from),
        centre: [view.cx, view.cy].map(f64::from),
        distortion: &[],
    })?;
    let rows = view.rotation.map(|row| row.map(f64::from));
    let dot = |a: usize, b: usize| (0..3).map(|k| rows[a][k] * rows[b][k]).sum::<f64>();
    let of_unit = (0..3).flat_map(|a| (0..=a).map(move |b| (a, b)));
    ROTATION.check_all(of_unit.map(|(a, b)| (dot(a, b) - f64::from(u8::from(a == b))).abs()))?;
    POSITION.check_all(view.translation.map(f64::from))
}

impl HeaderEvents {
    fn check(&self) -> Result<(), String> {
        let bins = self.edges.len().saturating_sub(1);
        if self.counts.len() != bins || !self.edges.is_sorted() {
            return Err(format!(
                "its {} bins of events have {} edges in disorder",
                self.counts.len(),
                self.edges.len()
            ));
        }
        UNIT_TIME.check_all(self.edges.iter().copied())?;
        Ok(EVENTS.check_all(self.counts.iter().copied())?)
    }
}

impl HeaderMotion {
    fn check_plausible(&self) -> Result<(), Implausible> {
        let paths = |numbers: [&f32; 4]| {
            [INTERVALS, LIFE, GONE, SPACING]
                .into_iter()
                .zip(numbers)
                .try_for_each(|(quantity, &value)| quantity.check(value.into()).map(drop))
        };
        match self {
            Self::Still => Ok(()),
            Self::FreeTime { intervals, least_life, gone, spacing, .. } => {
                paths([intervals, least_life, gone, spacing])
            }
            Self::Bodies { intervals, least_life, gone, spacing, seconds, softness, .. } => {
                paths([intervals, least_life, gone, spacing])?;
                SECONDS.check_all([*seconds, *softness].map(f64::from))
            }
            Self::Hexplane { aabb, levels, features, width, spatial_resolution, .. } => {
                POSITION.check_all(aabb.iter().flatten().map(|&value| value.into()))?;
                LEVELS.check(levels.len() as f64)?;
                let sizes = levels.iter().chain([features, width, spatial_resolution]);
                CELLS.check_all(sizes.map(|&size| size.into()))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scene_file::{Header, HeaderCamera, HeaderMotion, SceneFile};

    fn header() -> Header {
        let camera = serde_json::json!({
            "name": "00", "split": "train", "modality": "rgb", "width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0,
            "cy": 240.0, "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "translation": [0.0, 0.0, 2.0],
            "near": 0.2, "frames": [[0.0, -0.01, 0.01], [1.0, 0.99, 1.01]],
        });
        let camera: HeaderCamera = serde_json::from_value(camera).unwrap();
        let mut header = SceneFile::for_tests().header;
        header.cameras = vec![camera];
        // Nothing moves, so that the rows of what does are none.
        let mut none = header.sections.iter().find(|section| section.floats == 0).unwrap().clone();
        none.name = "motion".into();
        header.sections.push(none);
        header.events.edges = vec![0.0, 0.5, 1.0];
        header.events.counts = vec![3.0, 4.0];
        header.motion =
            HeaderMotion::FreeTime { intervals: 9.0, least_life: 0.25, gone: -30.0, knots: 0, spacing: 1.0 };
        header
    }

    /// Every number of a header, by its place.
    fn numbers(value: &serde_json::Value, at: &str, found: &mut Vec<String>) {
        match value {
            serde_json::Value::Number(_) => found.push(at.to_owned()),
            serde_json::Value::Array(items) => {
                items.iter().enumerate().for_each(|(n, item)| numbers(item, &format!("{at}/{n}"), found));
            }
            serde_json::Value::Object(fields) => {
                fields.iter().for_each(|(name, field)| numbers(field, &format!("{at}/{name}"), found));
            }
            _ => {}
        }
    }

    fn parsed(header: &Header) -> Result<(), String> {
        SceneFile::parse(SceneFile::new(header.clone(), &[0; 16 * 4]).bytes).map(drop)
    }

    #[test]
    fn what_a_recording_has_is_taken() {
        parsed(&header()).unwrap();
        for motion in [HeaderMotion::Still, header().motion] {
            parsed(&Header { motion, events: crate::scene_file::HeaderEvents::default(), ..header() }).unwrap();
        }
    }

    #[test]
    fn no_number_of_a_header_is_beyond_all_cameras() {
        let whole = serde_json::to_value(header()).unwrap();
        let mut places = Vec::new();
        numbers(&whole, "", &mut places);
        assert!(places.len() > 40, "{places:?}");
        let mut refused = 0;
        for (place, value) in places.iter().flat_map(|place| [1e38, -1e38, 1e18, -1e18].map(|value| (place, value))) {
            let mut changed = whole.clone();
            *changed.pointer_mut(place).unwrap() = value.into();
            // What is a whole number is none any more, and refused as such.
            if let Ok(header) = serde_json::from_value::<Header>(changed) {
                assert!(parsed(&header).is_err(), "{place} may be {value}");
                refused += 1;
            }
        }
        assert!(refused > 100, "{refused}");
    }

    #[test]
    fn whole_numbers_of_a_header_have_bounds_too() {
        for place in ["/cameras/0/width", "/cameras/0/height", "/span_ns/1", "/motion/knots"] {
            let mut changed = serde_json::to_value(header()).unwrap();
            let Some(field) = changed.pointer_mut(place) else { panic!("{place}") };
            *field = if place.contains("span") { i64::MAX.into() } else { u32::MAX.into() };
            let error = parsed(&serde_json::from_value(changed).unwrap()).unwrap_err();
            assert!(!error.is_empty() && !error.contains("sections"), "{place}: {error}");
        }
    }

    #[test]
    fn a_camera_is_named_with_what_is_wrong() {
        let mut wrong = header();
        wrong.cameras[0].view.fx = 1e30;
        let error = parsed(&wrong).unwrap_err();
        assert!(error.contains("camera '00'") && error.contains("focal length"), "{error}");
        let mut wrong = header();
        wrong.events.counts.pop();
        assert!(parsed(&wrong).unwrap_err().contains("bins of events"));
        wrong.events.edges = vec![0.0, 1.0, 0.5];
        assert!(parsed(&wrong).is_err());
    }
}
