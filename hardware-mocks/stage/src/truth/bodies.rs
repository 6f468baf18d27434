//! The rigid bodies: where each is, every two milliseconds, and its surface.

use std::collections::BTreeMap;

use erfgs_dataset::{Bodies, Body, BodyPose, SurfacePoint};
use glam::{DQuat, DVec3};

use crate::{
    Stage,
    cast::{self, Part},
    colour::to_u8,
    form::Sample,
    paint::albedo,
    path::Place,
    seconds,
};

/// From one pose to the next, nanoseconds, where nothing turns too fast for it.
const STEP_NS: i64 = 2_000_000;
/// The most that a body turns from one pose to the next, radians.
const MOST_TURN: f64 = 0.9;
/// One point of a surface for so much of it, square metres, within these bounds.
const AREA: f64 = 1.5e-4;
const POINTS: [usize; 2] = [60, 1500];
/// A colour is the mean over so many instants of the take.
const INSTANTS: u32 = 9;
/// The width that a colour is averaged over, metres.
const FOOTPRINT: f64 = 0.006;

/// The rigid bodies of a stage over a span of nanoseconds: paths and surfaces, coloured as they are lit in the mean.
#[must_use]
pub fn truth_bodies(stage: &Stage, span_ns: [i64; 2]) -> Bodies {
    let empty = stage.options.empty;
    let rigid = stage.cast.bodies.iter().enumerate().filter(|(_, body)| body.rigid && !empty);
    Bodies::new(rigid.filter_map(|(number, body)| one(stage, number, body, span_ns)).collect())
}

fn one(stage: &Stage, number: usize, body: &cast::Body, [from, to]: [i64; 2]) -> Option<Body> {
    let frame = stage.cast.parts_of(number).next()?;
    let (begin, end) = (seconds(from), seconds(to));
    let turn = frame.path.speed(0.5 * (begin + end), 0.5 * (end - begin)).turn;
    let turn = if turn.is_finite() { turn } else { 0.0 };
    let step = STEP_NS.min((MOST_TURN / turn.max(1e-3) * 1e9) as i64).max(1000);
    let mut times: Vec<i64> = (0..).map(|index| from + index * step).take_while(|t| *t < to).collect();
    times.push(to);
    let mut known: Option<DQuat> = None;
    let pose = |t_ns: i64| {
        let place = frame.path.place(seconds(t_ns));
        let turned = DQuat::from_mat3(&place.axes).normalize();
        // Of the two quaternions the one that is nearer to that before.
        let turned = if known.is_some_and(|known| known.dot(turned) < 0.0) { -turned } else { turned };
        known = Some(turned);
        let [x, y, z, w] = turned.to_array();
        BodyPose { t_ns, translation_m: place.origin.to_array(), rotation_wxyz: [w, x, y, z] }
    };
    let first = if body.appears.is_finite() { (body.appears * 1e9) as i64 } else { from };
    Some(Body {
        name: body.name.clone(),
        span_ns: [first.clamp(from, to), to],
        poses: times.into_iter().map(pose).collect(),
        points: stage.cast.parts_of(number).flat_map(|part| points(stage, part, frame, [begin, end])).collect(),
        found_by: BTreeMap::from([("by".to_owned(), "stage".into())]),
    })
}

/// The surface of a part in the frame of its body, which is that of the body's first part.
fn points(stage: &Stage, part: &Part, frame: &Part, [begin, end]: [f64; 2]) -> Vec<SurfacePoint> {
    let count = ((part.form.area() / AREA) as usize).clamp(POINTS[0], POINTS[1]);
    let instants: Vec<Place> = (0..INSTANTS)
        .map(|index| begin + (end - begin) * (f64::from(index) + 0.5) / f64::from(INSTANTS))
        .map(|t| part.path.place(t))
        .collect();
    let (own, body) = (part.path.place(begin), frame.path.place(begin));
    let to_body = |v: DVec3| body.axes.transpose() * (own.axes * v);
    let of = |sample: Sample| SurfacePoint {
        position_m: body.local(own.world(sample.position)).to_array(),
        normal: to_body(sample.normal).normalize().to_array(),
        colour: colour(stage, part, &sample, &instants),
    };
    part.form.samples(count).into_iter().map(of).collect()
}

/// The colour of a place on a part's surface, in the mean light of these instants, seconds.
pub(crate) fn colour_at(stage: &Stage, part: &Part, sample: &Sample, instants: &[f64]) -> [u8; 3] {
    colour(stage, part, sample, &instants.iter().map(|&t| part.path.place(t)).collect::<Vec<_>>())
}

fn colour(stage: &Stage, part: &Part, sample: &Sample, instants: &[Place]) -> [u8; 3] {
    // A ball's surface is measured in radii.
    let unit = if sample.surface == sample.normal { sample.position.length() } else { 1.0 };
    let albedo = albedo(part.paint, stage.set.seed, sample.surface, FOOTPRINT / unit);
    let lit = |place: &Place| {
        let (at, normal) = (place.world(sample.position), place.axes * sample.normal);
        stage.light.ambient(normal) + stage.light.direct(at, normal)
    };
    to_u8(albedo * instants.iter().map(lit).sum::<DVec3>() / instants.len().max(1) as f64)
}
