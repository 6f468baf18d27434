//! What tags say of each other: which are mistaken, and where the corners of those that could not be read are.

use std::collections::BTreeMap;

use glam::{DMat3, DVec2};

use super::{Saddle, tag::Tag};
use crate::{
    board::{Corner, Target, detect::Grey},
    geometry::homography::{apply, homography},
    statistics::median,
};

/// Tags farther apart than this, in rows or columns, are not compared: lenses bend the plane.
const REACH: u32 = 3;
/// Corners that tell where another is.
const NEIGHBOURS: usize = 10;

/// Numbers of a tag's corners: below left, below right, above right, above left.
fn ids(tag: u32, columns: u32) -> [u32; 4] {
    let width = 2 * columns;
    let first = tag / columns * 2 * width + tag % columns * 2;
    [first, first + 1, first + width + 1, first + width]
}

/// The largest set of tags each of which lies where another one says; none where fewer than two agree.
pub(super) fn consistent(tags: Vec<Tag>, target: &Target) -> Vec<Tag> {
    let &Target::AprilGrid { columns, .. } = target else { return Vec::new() };
    let plane = |tag: &Tag| ids(tag.id, columns).map(|id| on_plane(target, id));
    let maps: Vec<Option<DMat3>> = tags.iter().map(|tag| homography(&plane(tag), &tag.corners)).collect();
    let predicts = |from: usize, to: usize| {
        let (a, b) = (&tags[from], &tags[to]);
        let steps = (a.id % columns).abs_diff(b.id % columns).max((a.id / columns).abs_diff(b.id / columns));
        // A tag's own perspective is known to some percent, which adds up from tag to tag.
        let slack = 0.15 * f64::from(1 + steps) * side(&b.corners);
        let Some(map) = &maps[from] else { return false };
        let lies = |(at, seen): (DVec2, &DVec2)| apply(map, at).is_some_and(|at| at.distance(*seen) < slack);
        (1..=REACH).contains(&steps) && plane(b).into_iter().zip(&b.corners).all(lies)
    };
    let agree = |a: usize, b: usize| predicts(a, b) || predicts(b, a);
    let mut group: Vec<usize> = (0..tags.len()).collect();
    for a in 0..tags.len() {
        for b in 0..a {
            if group[a] != group[b] && agree(a, b) {
                let (from, to) = (group[a], group[b]);
                group.iter_mut().filter(|of| **of == from).for_each(|of| *of = to);
            }
        }
    }
    let count = |of: usize| group.iter().filter(|other| **other == of).count();
    let Some(largest) = group.iter().copied().max_by_key(|of| (count(*of), std::cmp::Reverse(*of))) else {
        return Vec::new();
    };
    if count(largest) < 2 {
        return Vec::new();
    }
    let mut best: BTreeMap<u32, Tag> = BTreeMap::new();
    for (tag, _) in tags.iter().zip(&group).filter(|(_, of)| **of == largest) {
        let kept = best.entry(tag.id).or_insert(*tag);
        if tag.wrong < kept.wrong {
            *kept = *tag;
        }
    }
    best.into_values().collect()
}

/// The corners of the tags, and those besides that lie where their neighbours say and look as they should.
pub(super) fn complete(grey: &Grey, tags: &[Tag], saddles: &[Saddle], target: &Target) -> Vec<Corner> {
    let &Target::AprilGrid { columns, rows, .. } = target else { return Vec::new() };
    let mut known: BTreeMap<u32, DVec2> =
        tags.iter().flat_map(|tag| ids(tag.id, columns).into_iter().zip(tag.corners)).collect();
    let contrast = median(tags.iter().map(|tag| tag.contrast)).unwrap_or(f64::INFINITY);
    // What is found tells where more is.
    loop {
        let missing = (0..4 * columns * rows).filter(|id| !known.contains_key(id));
        let found: Vec<(u32, DVec2)> = missing
            .filter_map(|id| {
                let map = local(&known, id, target)?;
                let at = apply(&map, on_plane(target, id))?;
                let size = scale(&map, target, id)?;
                let near =
                    saddles.iter().map(|saddle| saddle.at).min_by(|a, b| a.distance(at).total_cmp(&b.distance(at)));
                let at = near.filter(|near| near.distance(at) < 0.1 * size)?;
                crosses(grey, &map, at, id, target, 0.3 * contrast).then_some((id, at))
            })
            .collect();
        if found.is_empty() {
            break;
        }
        known.extend(found);
    }
    let corners = known.into_iter().map(|(id, pixel)| Corner { id, pixel }).collect();
    without_strays(corners, target, 2.0)
}

/// Leaves out corners that lie elsewhere than their neighbours say, by more than `least_px` and more than most do.
pub(in crate::board) fn without_strays(corners: Vec<Corner>, target: &Target, least_px: f64) -> Vec<Corner> {
    /// How much farther off than half of the corners a stray is.
    const FAR: f64 = 5.0;
    let mut known: BTreeMap<u32, DVec2> = corners.into_iter().map(|corner| (corner.id, corner.pixel)).collect();
    loop {
        let off = |(&id, &at): (&u32, &DVec2)| {
            let map = local(&known, id, target)?;
            Some((apply(&map, on_plane(target, id))?.distance(at), id))
        };
        let mut all: Vec<(f64, u32)> = known.iter().filter_map(off).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let limit = all.get(all.len() / 2).map_or(least_px, |(median, _)| least_px.max(FAR * median));
        // One after the other, since a stray makes its neighbours look like ones.
        match all.last() {
            Some((most, id)) if *most > limit => known.remove(id),
            _ => return known.into_iter().map(|(id, pixel)| Corner { id, pixel }).collect(),
        };
    }
}

/// The map from the plane to the picture around a corner, from others near it; `None` where too few are near.
fn local(known: &BTreeMap<u32, DVec2>, id: u32, target: &Target) -> Option<DMat3> {
    let here = on_plane(target, id);
    let mut near: Vec<(f64, DVec2, DVec2)> = known
        .iter()
        .filter(|(other, _)| **other != id)
        .map(|(&other, &pixel)| (on_plane(target, other), pixel))
        .map(|(plane, pixel)| (plane.distance(here), plane, pixel))
        .filter(|(far, ..)| *far < 2.5 * target.square_m())
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    near.truncate(NEIGHBOURS);
    let (plane, pixels): (Vec<DVec2>, Vec<DVec2>) = near.into_iter().map(|(_, plane, pixel)| (plane, pixel)).unzip();
    homography(&plane, &pixels)
}

/// Whether black and white cross at a corner as they do on the sheet: black within the tag and in the small square across.
fn crosses(grey: &Grey, map: &DMat3, at: DVec2, id: u32, target: &Target, least: f64) -> bool {
    let &Target::AprilGrid { columns, tag_m, spacing, .. } = target else { return false };
    let plane = on_plane(target, id);
    let Some(centre) = apply(map, plane) else { return false };
    let step = 0.35 * spacing.min(0.25) * tag_m;
    let look = |x: f64, y: f64| {
        let place = apply(map, plane + DVec2::new(x, y) * step)?;
        grey.sample(place - centre + at)
    };
    let (right, above) = (id % (2 * columns) % 2 == 1, id / (2 * columns) % 2 == 1);
    // A tag lies to the left of its right corners and below its upper ones.
    let sign = if right == above { 1.0 } else { -1.0 };
    match (look(1.0, sign), look(-1.0, -sign), look(1.0, -sign), look(-1.0, sign)) {
        (Some(a), Some(b), Some(c), Some(d)) => c.min(d) - a.max(b) > least,
        _ => false,
    }
}

fn on_plane(target: &Target, id: u32) -> DVec2 {
    target.point(id).map_or(DVec2::NAN, |point| point.truncate())
}

/// The shorter side of a tag at a corner, pixels.
fn scale(map: &DMat3, target: &Target, id: u32) -> Option<f64> {
    let (here, tag) = (on_plane(target, id), target.square_m());
    let at = apply(map, here)?;
    let step = |way: DVec2| Some(apply(map, here + way * 0.1 * tag)?.distance(at) / 0.1);
    Some(step(DVec2::X)?.min(step(DVec2::Y)?))
}

fn side(corners: &[DVec2; 4]) -> f64 {
    (0..4).map(|index| corners[index].distance(corners[(index + 1) % 4])).fold(f64::INFINITY, f64::min)
}
