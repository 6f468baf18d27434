//! From the bodies of a dataset to control points, nodes and Gaussians.

use erfgs_dataset::{Body, BodyPose};
use glam::{DQuat, DVec3, DVec4};

use super::Piece;
use crate::scene::Point;
use erfgs_splat::{
    gaussians::{Gaussians, Neighbours},
    motion::{
        BodiesOptions, FreeTimeOptions,
        bodies::{CODES, EXTRA_FLOATS, LOOSE, NEIGHBOURS, NEVER, NO_NODE, Start, spline},
    },
};

/// The share of silhouettes that agree on the shape of what is rigid and was followed rightly: that with which carving begins
/// (`bodies/carve.rs` of `erfgs-points`).
pub(crate) const SURE: f64 = 0.86;
/// The share of silhouettes that agree is known no better than this.
const ABOUT: f64 = 0.005;
/// Neighbours that a node looks for.
const NEAREST: usize = 6;
/// The nodes that a Gaussian hangs on.
const HANGS_ON: usize = 4;
/// Fewest nodes of a body.
const FEWEST_NODES: usize = 5;
/// The largest turn from a knot to the next, radians.
const MOST_TURN: f64 = 1.0;
/// Most control points of all bodies and nodes together: 64 MiB of them.
const MOST_CONTROL: usize = 1 << 21;
/// How much third differences of control points count beside errors of poses, squared.
const STIFFNESS: f64 = 1e-3;

/// What a recording is like, as bodies need to know it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recording {
    /// First and last instant, nanoseconds.
    pub span_ns: [i64; 2],
    /// RGB intervals in it.
    pub intervals: f64,
}

impl Recording {
    fn seconds(&self, t_ns: i64) -> f64 {
        1e-9 * t_ns.saturating_sub(self.span_ns[0]) as f64
    }

    /// An instant within it, in [0, 1].
    #[must_use]
    pub fn t01(&self, t_ns: i64) -> f64 {
        (self.seconds(t_ns) / self.length()).clamp(0.0, 1.0)
    }

    /// The instant at `t01` of it, nanoseconds.
    pub(super) fn t_ns(&self, t01: f64) -> i64 {
        self.span_ns[0] + (1e9 * t01 * self.length()) as i64
    }

    /// How long it is, seconds.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.seconds(self.span_ns[1]).max(1e-6)
    }
}

/// Control points, nodes and Gaussians of `pieces`; rows are as long as those of `free` and what bodies need.
#[must_use]
pub fn from_bodies(
    pieces: &[Piece],
    recording: Recording,
    sh_degree: u32,
    options: &BodiesOptions,
    free: &FreeTimeOptions,
) -> Start {
    let bodies: Vec<&Body> = pieces.iter().map(|piece| &piece.body).collect();
    let length = recording.length();
    let interval = length / recording.intervals.max(1e-6);
    let fastest = bodies.iter().map(|body| fastest_turn(body)).fold(0.0, f64::max);
    let spacing = (interval / f64::from(options.knots)).min(MOST_TURN / fastest.max(1e-9));
    // Pieces of a body are there one after the other.
    let total = pieces.iter().map(|piece| piece.share * (piece.body.points.len() as f64).sqrt()).sum::<f64>();
    let mut nodes: Vec<(usize, DVec3, f64)> = Vec::new();
    let mut gaussians = Gaussians { sh_degree, motion_floats: free.floats() + EXTRA_FLOATS, ..Gaussians::default() };
    for (index, body) in bodies.iter().enumerate() {
        let places: Vec<DVec3> = body.points.iter().map(|point| DVec3::from(point.position_m)).collect();
        let share = f64::from(options.nodes) * (places.len() as f64).sqrt() / total.max(1e-9);
        let rests = spread(&places, (share as usize).max(FEWEST_NODES));
        let reach = reach_of(&rests).ln();
        let first = nodes.len();
        nodes.extend(rests.into_iter().map(|rest| (index, rest, reach)));
        add_gaussians(&mut gaussians, body, index, &nodes[first..], first, options, free);
    }
    gaussians.dynamic = gaussians.len();
    let count = bodies.len() + nodes.len();
    let most = (MOST_CONTROL / count.max(1)).max(4);
    let knots = ((length / spacing).ceil() as usize).clamp(1, most - 3) + 3;
    let per_second = (knots - 3) as f64 / length;
    let mut control = vec![0.0_f32; knots * count * 8];
    for (index, body) in bodies.iter().enumerate() {
        for (knot, [x, y, z, qw, qx, qy, qz]) in path(body, recording, knots, per_second).into_iter().enumerate() {
            let turn = DVec4::new(qw, qx, qy, qz).normalize_or(DVec4::X);
            let row = [x, y, z, 0.0, turn.x, turn.y, turn.z, turn.w].map(|value| value as f32);
            control[8 * (knot * count + index)..][..8].copy_from_slice(&row);
        }
    }
    for knot in 0..knots {
        for node in 0..nodes.len() {
            control[8 * (knot * count + bodies.len() + node) + 4] = 1.0;
        }
    }
    let gate = |body: &&Body| {
        let [begin, end] = body.span_ns.map(|t_ns| recording.seconds(t_ns) as f32);
        let comes_or_goes = body.span_ns[0] > recording.span_ns[0] || body.span_ns[1] < recording.span_ns[1];
        [begin, end, f32::from(u8::from(comes_or_goes)), 0.0]
    };
    let node = |(_, rest, reach): &(usize, DVec3, f64)| [rest.x, rest.y, rest.z, *reach].map(|value| value as f32);
    Start {
        bodies: bodies.len(),
        names: bodies.iter().map(|body| body.name.clone()).collect(),
        followed: pieces.iter().map(|piece| guessed(&piece.body) || piece.bends.is_some()).collect(),
        bends: pieces.iter().map(|piece| piece.bends).collect(),
        nodes: nodes.len(),
        node_bodies: nodes.iter().map(|(body, ..)| *body).collect(),
        knots,
        per_second,
        control,
        other: bodies.iter().map(gate).chain(nodes.iter().map(node)).flatten().collect(),
        neighbours: neighbours(&nodes, &pieces.iter().map(|piece| piece.bends.is_some()).collect::<Vec<_>>()),
        gaussians,
    }
}

/// When a body was seen best, in [0, 1]: as whoever found it says, or in the middle of the time in which it is in view.
pub(super) fn seen_best(body: &Body, recording: Recording) -> f64 {
    let best_ns = body.found_by.get("best_seen_ns").and_then(serde_json::Value::as_i64);
    let middle = i64::midpoint(body.span_ns[0], body.span_ns[1]);
    recording.t01(best_ns.unwrap_or(middle))
}

/// The share of silhouettes that agree on the shape of a body, as whoever carved it says.
pub(crate) fn agreement(body: &Body) -> Option<f64> {
    body.found_by.get("carving_agreement").and_then(serde_json::Value::as_f64)
}

/// Whether as many silhouettes agree on the shape of a body as on that of what is rigid.
pub(crate) fn silhouettes_agree(body: &Body) -> bool {
    agreement(body).is_some_and(|share| share >= SURE - ABOUT)
}

/// Whether whoever found a body says that it could not be followed by its looks. Poses that come from elsewhere are taken for right.
fn guessed(body: &Body) -> bool {
    body.found_by.get("followed_by_looks").and_then(serde_json::Value::as_bool) == Some(false)
}

/// How fast a body turns at most, radians a second.
fn fastest_turn(body: &Body) -> f64 {
    let rate = |pair: &[BodyPose]| {
        let turn = 2.0 * pair[0].rotation().dot(pair[1].rotation()).abs().min(1.0).acos();
        turn / (1e-9 * pair[1].t_ns.saturating_sub(pair[0].t_ns) as f64).max(1e-9)
    };
    body.poses.windows(2).map(rate).fold(0.0, f64::max)
}

/// Control points of the path of a body: it stays where its poses end.
fn path(body: &Body, recording: Recording, knots: usize, per_second: f64) -> Vec<[f64; 7]> {
    let mut last = DQuat::IDENTITY;
    let mut samples: Vec<(f64, [f64; 7])> = Vec::with_capacity(body.poses.len() + 2 * knots);
    for pose in &body.poses {
        let mut q = pose.rotation();
        if q.dot(last) < 0.0 {
            q = -q;
        }
        last = q;
        let [x, y, z] = pose.translation_m;
        samples.push((per_second * recording.seconds(pose.t_ns), [x, y, z, q.w, q.x, q.y, q.z]));
    }
    let (Some(first), Some(last)) = (samples.first().copied(), samples.last().copied()) else { return Vec::new() };
    let places = (0..2 * knots).map(|half| 0.5 * half as f64).filter(|s| *s <= (knots - 3) as f64);
    for s in places {
        if s < first.0 {
            samples.push((s, first.1));
        } else if s > last.0 {
            samples.push((s, last.1));
        }
    }
    spline::fit(&samples, knots, STIFFNESS)
}

/// Up to `most` of `places`, each as far from those before it as can be, from the one that is farthest from the middle on.
fn spread(places: &[DVec3], most: usize) -> Vec<DVec3> {
    let middle = places.iter().sum::<DVec3>() / places.len().max(1) as f64;
    let mut away: Vec<f64> = places.iter().map(|place| place.distance_squared(middle)).collect();
    let mut chosen: Vec<DVec3> = Vec::new();
    while chosen.len() < most.min(places.len()) {
        let farthest = (0..places.len()).max_by(|a, b| away[*a].total_cmp(&away[*b]).then(b.cmp(a)));
        let Some(next) = farthest.filter(|&next| chosen.is_empty() || away[next] > 0.0) else { break };
        for (away, place) in away.iter_mut().zip(places) {
            let distance = place.distance_squared(places[next]);
            *away = if chosen.is_empty() { distance } else { away.min(distance) };
        }
        chosen.push(places[next]);
    }
    chosen
}

/// How far nodes are apart, metres: the median distance to the nearest other.
fn reach_of(rests: &[DVec3]) -> f64 {
    let nearest = |index: usize| {
        let others = rests.iter().enumerate().filter(|(other, _)| *other != index);
        others.map(|(_, other)| other.distance(rests[index])).fold(f64::INFINITY, f64::min)
    };
    let mut apart: Vec<f64> = (0..rests.len()).map(nearest).filter(|apart| apart.is_finite()).collect();
    apart.sort_by(f64::total_cmp);
    apart.get(apart.len() / 2).map_or(0.1, |apart| apart.max(1e-4))
}

/// For each node those of the same body that are nearest, and those that it is one of the nearest of.
fn neighbours(nodes: &[(usize, DVec3, f64)], bends: &[bool]) -> Vec<u32> {
    let mut codes: Vec<Vec<(u32, u32)>> = vec![Vec::new(); nodes.len()];
    for (index, (body, rest, _)) in nodes.iter().enumerate() {
        let mut others: Vec<(f64, usize)> = (0..nodes.len())
            .filter(|&other| other != index && nodes[other].0 == *body)
            .map(|other| (nodes[other].1.distance_squared(*rest), other))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(_, other) in others.iter().take(NEAREST) {
            // A node that many look to keeps the first of them: an edge is held at both of its ends or not at all.
            let [mine, yours] = [index, other].map(|node| codes[node].len() < NEIGHBOURS);
            let known = |node: usize, beside: usize| codes[node].iter().any(|(seen, _)| *seen as usize == beside);
            if (mine || known(index, other)) && (yours || known(other, index)) {
                mark(&mut codes[index], other as u32, 1);
                mark(&mut codes[other], index as u32, 2);
            }
        }
    }
    let filled = |codes: Vec<(u32, u32)>| {
        let mut row = [NO_NODE; NEIGHBOURS];
        let loose = |other: u32| if bends[nodes[other as usize].0] { LOOSE } else { 0 };
        row.iter_mut().zip(codes).for_each(|(to, (other, flags))| *to = CODES * other + loose(other) + flags);
        row
    };
    codes.into_iter().flat_map(filled).collect()
}

fn mark(codes: &mut Vec<(u32, u32)>, other: u32, flag: u32) {
    match codes.iter_mut().find(|(seen, _)| *seen == other) {
        Some((_, flags)) => *flags |= flag,
        None => codes.push((other, flag)),
    }
}

/// Adds a Gaussian for each point of a body: a disc on its surface.
fn add_gaussians(
    all: &mut Gaussians,
    body: &Body,
    index: usize,
    nodes: &[(usize, DVec3, f64)],
    first_node: usize,
    options: &BodiesOptions,
    free: &FreeTimeOptions,
) {
    let points: Vec<Point> =
        body.points.iter().map(|point| (point.position_m.map(|at| at as f32), point.colour)).collect();
    let mut born = Gaussians::from_points(&points, all.sh_degree, options.opacity);
    let places: Vec<[f32; 3]> = points.iter().map(|(place, _)| *place).collect();
    let size = disc_size(&places).ln();
    let stride = born.core.len() / points.len().max(1);
    for (core, point) in born.core.chunks_exact_mut(stride).zip(&body.points) {
        let normal = DVec3::from(point.normal).normalize_or(DVec3::Z);
        let turn = DQuat::from_rotation_arc(DVec3::Z, normal);
        core[3..6].copy_from_slice(&[size, size, size - std::f32::consts::LN_2]);
        core[6..10].copy_from_slice(&[turn.w, turn.x, turn.y, turn.z].map(|q| q as f32));
        let place = DVec3::from(point.position_m);
        let mut order: Vec<(f64, usize)> =
            nodes.iter().enumerate().map(|(node, (_, rest, _))| (rest.distance_squared(place), node)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut row = vec![0.0_f32; free.floats() + EXTRA_FLOATS];
        row[3] = NEVER;
        row[free.floats()] = (1 + index) as f32;
        for (slot, (_, node)) in row[free.floats() + 1..].iter_mut().zip(order.iter().take(HANGS_ON)) {
            *slot = (1 + first_node + node) as f32;
        }
        all.motion.extend(row);
    }
    all.core.extend(born.core);
    all.sh.extend(born.sh);
}

/// How large the discs on a surface of such points are, metres.
fn disc_size(places: &[[f32; 3]]) -> f32 {
    let around = Neighbours::new(places);
    let mut apart: Vec<f32> = places
        .iter()
        .map(|place| {
            let near = around.nearest(place, 4);
            near.iter().skip(1).map(|(_, squared)| squared.sqrt()).sum::<f32>() / (near.len().max(2) - 1) as f32
        })
        .collect();
    apart.sort_by(f32::total_cmp);
    (0.6 * apart.get(apart.len() / 2).copied().unwrap_or(0.02)).clamp(1e-3, 0.1)
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;
    use erfgs_dataset::SurfacePoint;

    use super::*;
    use erfgs_splat::{
        gaussians::CORE,
        reference::bodies::{Control, pose},
    };

    const SPAN_NS: [i64; 2] = [1_000_000_000, 1_600_000_000];
    const RECORDING: Recording = Recording { span_ns: SPAN_NS, intervals: 9.0 };

    /// A ball that flies along x and turns about z at `rate` radians a second.
    fn ball(name: &str, rate: f64, span_ns: [i64; 2], points: u64) -> Body {
        let pose = |k: i64| {
            let t_ns = SPAN_NS[0] + 5_000_000 * k;
            let seconds = 5e-3 * k as f64;
            let turn = DQuat::from_rotation_z(rate * seconds);
            BodyPose { t_ns, translation_m: [2.0 * seconds, 1.0, 0.0], rotation_wxyz: [turn.w, turn.x, turn.y, turn.z] }
        };
        let point = |i: u64| {
            let at = DVec3::from_array([0, 1, 2].map(|axis| random::range(random::key(5, &[i, axis]), -1.0, 1.0)));
            let normal = at.normalize_or(DVec3::X);
            SurfacePoint { position_m: (0.2 * normal).to_array(), normal: normal.to_array(), colour: [10, 20, 200] }
        };
        Body {
            name: name.into(),
            span_ns,
            poses: (0..=120).map(pose).collect(),
            points: (0..points).map(point).collect(),
            found_by: Default::default(),
        }
    }

    fn start(bodies: &[Body], options: &BodiesOptions) -> Start {
        let pieces = super::super::pieces(bodies.to_vec(), options, &[], RECORDING);
        from_bodies(&pieces, RECORDING, 1, options, &FreeTimeOptions { knots: 2, ..FreeTimeOptions::default() })
    }

    /// The control points of a body or node.
    fn control(start: &Start, entity: usize) -> Vec<Control> {
        let count = start.bodies + start.nodes;
        let point = |knot: usize| {
            let at: Vec<f64> =
                start.control[8 * (knot * count + entity)..][..8].iter().map(|v| f64::from(*v)).collect();
            (DVec3::new(at[0], at[1], at[2]), DVec4::new(at[4], at[5], at[6], at[7]))
        };
        (0..start.knots).map(point).collect()
    }

    #[test]
    fn paths_follow_the_poses_however_fast_they_turn() {
        for rate in [0.0, 15.0, 250.0] {
            let bodies = [ball("slow", 0.5, SPAN_NS, 50), ball("fast", rate, SPAN_NS, 80)];
            let start = start(&bodies, &BodiesOptions::default());
            let rate_a_knot = rate / start.per_second;
            assert!(rate_a_knot <= 1.01 && start.per_second >= 44.9, "{rate_a_knot} radians a knot");
            for (entity, body) in bodies.iter().enumerate() {
                let path = control(&start, entity);
                for at in &body.poses {
                    let seconds = RECORDING.seconds(at.t_ns);
                    let found = pose(&path, seconds * start.per_second, 0.0);
                    let turn = found.turn.dot(DVec4::from_array(at.rotation_wxyz)).abs().min(1.0).acos() * 2.0;
                    let apart = found.shift.distance(DVec3::from(at.translation_m));
                    assert!(turn < 0.03 && apart < 1e-3, "{} at {seconds}: {turn} radians, {apart} m", body.name);
                }
            }
        }
    }

    #[test]
    fn every_gaussian_hangs_on_nodes_of_its_body() {
        let gone = [SPAN_NS[0] + 100_000_000, SPAN_NS[1]];
        let bodies = [ball("a", 1.0, SPAN_NS, 300), ball("b", 1.0, gone, 900), ball("dot", 0.0, SPAN_NS, 1)];
        let options = BodiesOptions { nodes: 40, bend: vec!["b".into()], ..BodiesOptions::default() };
        let start = start(&bodies, &options);
        assert_eq!(start.followed, [false, true, false]);
        let seen_best = start.bends[1].unwrap();
        assert!((seen_best - 3.5 / 6.0).abs() < 1e-9, "in the middle of its time: {seen_best}");
        assert_eq!((start.bodies, start.gaussians.len(), start.gaussians.dynamic), (3, 1201, 1201));
        assert!((30..=45).contains(&start.nodes), "{}", start.nodes);
        let floats = start.gaussians.motion_floats;
        let mut seen = vec![0; start.nodes];
        let mut body_of = vec![0.0; start.nodes];
        for row in start.gaussians.motion.chunks_exact(floats) {
            let ids = &row[floats - EXTRA_FLOATS..];
            let nodes: Vec<usize> = ids[1..5].iter().filter(|id| **id > 0.0).map(|id| *id as usize - 1).collect();
            assert!((nodes.len() == 4 || ids[0] == 3.0) && row[3] == NEVER, "{row:?}");
            nodes.iter().for_each(|&node| {
                seen[node] += 1;
                assert!(body_of[node] == 0.0 || body_of[node] == ids[0], "a node of two bodies");
                body_of[node] = ids[0];
            });
        }
        assert!(seen.iter().all(|&seen| seen > 0));
        assert!(std::iter::zip(&start.node_bodies, &body_of).all(|(body, id)| (1 + body) as f32 == *id));
        let gates: Vec<&[f32]> = start.other.chunks_exact(4).take(3).collect();
        assert_eq!((gates[0][2], gates[1], gates[2][2]), (0.0, &[0.1, 0.6, 1.0, 0.0][..], 0.0));
        // An edge is held at both of its ends.
        for (node, codes) in start.neighbours.chunks_exact(NEIGHBOURS).enumerate() {
            for code in codes.iter().filter(|code| **code != NO_NODE) {
                let (other, flags) = ((code / CODES) as usize, code % LOOSE);
                assert_eq!(code & LOOSE != 0, body_of[node] == 2.0, "the second bends");
                let back = start.neighbours[other * NEIGHBOURS..][..NEIGHBOURS]
                    .iter()
                    .find(|code| **code != NO_NODE && (**code / CODES) as usize == node)
                    .map(|code| code % LOOSE);
                assert_eq!(back, Some((flags & 1) << 1 | flags >> 1), "{node} and {other}");
                assert_eq!(body_of[node], body_of[other]);
            }
        }
    }

    #[test]
    fn discs_lie_on_the_surface() {
        let bodies = [ball("a", 1.0, SPAN_NS, 400)];
        let start = start(&bodies, &BodiesOptions::default());
        for (core, point) in start.gaussians.core.chunks_exact(CORE).zip(&bodies[0].points) {
            let q = DQuat::from_xyzw(core[7].into(), core[8].into(), core[9].into(), core[6].into());
            assert!((q * DVec3::Z).dot(DVec3::from(point.normal)) > 0.999 && core[5] < core[4]);
        }
    }

    #[test]
    fn odd_bodies_are_taken_without_failing() {
        let mut still = ball("still", 0.0, SPAN_NS, 3);
        still.poses.truncate(1);
        still.points.iter_mut().for_each(|point| point.position_m = [0.0; 3]);
        let mut wild = ball("wild", 0.0, [i64::MIN, i64::MAX], 2);
        wild.poses = vec![
            wild.poses[0],
            BodyPose { t_ns: wild.poses[0].t_ns + 1, rotation_wxyz: [0.0, 1.0, 0.0, 0.0], ..wild.poses[0] },
        ];
        let start = start(&[still, wild], &BodiesOptions { nodes: 1, ..BodiesOptions::default() });
        assert!(start.control.len() <= 8 * MOST_CONTROL);
        assert!(start.control.iter().chain(&start.other).chain(&start.gaussians.core).all(|value| value.is_finite()));
        let none = from_bodies(&[], RECORDING, 0, &BodiesOptions::default(), &FreeTimeOptions::default());
        assert_eq!((none.bodies, none.nodes, none.gaussians.len()), (0, 0, 0));
    }
}
