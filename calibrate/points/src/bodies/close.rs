//! Things that fly so close to one another that their hulls are one piece for most of a take.
//!
//! As many flights are looked for as tell the points of a piece apart, though none of them may ever be seen alone. Two that meet pass,
//! or they bounce off one another; their colours tell which, or, where both look the same, how they fly.

use glam::DVec3;

use super::{
    centres::{Cloud, Owners, Track},
    chains::Chain,
    detections::{Detection, FEWEST, Histogram},
    flight::{self, Places},
    mixture::{Mixture, PointClouds},
};

/// So many things more than there are tracks are looked for.
const MORE: usize = 4;
/// Things that meet are so near to one another, compared with how far their points are from their middles.
const MEET: f64 = 2.0;
/// The distance of two things changes by so much, compared with the same; that of parts of one does not.
const CHANGES: f64 = 2.0;
/// Colours must be of one thing for so large a share of the points more if things bounce off one another than if they pass; where they say
/// less, those bounce that fly then and do not if they pass.
const BOUNCE: f64 = 0.01;
/// A thing is seen at so large a share of the instants.
const SEEN: f64 = 0.6;
/// What flies is not farther from its flight than so many spacings, or, as the middle of what is large moves more when a part of it is
/// hidden, than so large a share of how far its points are from their middle.
const FLIES: f64 = 1.5;
const FLIES_SPREAD: f64 = 0.45;

/// What was followed, and by what.
#[derive(Clone, Copy, Debug)]
pub struct Followed<'a> {
    /// Tracks, and which points are theirs.
    pub tracks: &'a [Track],
    pub owners: &'a Owners,
    /// The points of each instant.
    pub clouds: &'a [Cloud<'a>],
    /// The instants, seconds.
    pub times_s: &'a [f64],
    /// How far points of a thing are apart, metres.
    pub cell_m: f64,
    /// For how long the shutter is open, seconds.
    pub exposure_s: f64,
}

/// Things that were told apart.
#[derive(Clone, Debug, Default)]
pub struct Separated {
    /// The things.
    things: Vec<Thing>,
    /// Which tracks these take the place of.
    pub tracks: Vec<usize>,
}

impl Separated {
    /// The chains of all things, with their detections added to those that are known.
    pub fn chained(self, chains: &mut Vec<Chain>, found: &mut [Vec<Detection>]) {
        let mut index = 0;
        chains.retain(|_| {
            index += 1;
            !self.tracks.contains(&(index - 1))
        });
        for thing in self.things {
            let mut chain = Chain { seen: Vec::new(), met: thing.met };
            for (instant, detection) in thing.pieces.into_iter().enumerate() {
                if let Some(detection) = detection {
                    chain.seen.push((instant, found[instant].len()));
                    found[instant].push(detection);
                }
            }
            chains.push(chain);
        }
    }
}

impl Followed<'_> {
    /// Looks for more things than there are tracks where these touch one another or do not fall freely.
    pub fn separated(self) -> Separated {
        let mut all = Separated::default();
        for group in self.groups() {
            // What bounces may be two things that change places. Two things that fly side by side seem to fall as one.
            let falls = |&track: &usize| {
                let flights = self.tracks[track].flights(self.times_s, self.exposure_s, self.cell_m);
                self.times_s.first().is_some_and(|&time| flights.at(time).is_some()) && flights.bounces().is_empty()
            };
            if group.len() == 1 && group.iter().all(falls) {
                continue;
            }
            let pieces = Pieces::of(self, &group);
            let more = (group.len() + 1..=group.len() + MORE).rev();
            if let Some(things) = more.into_iter().find_map(|count| pieces.separated(count)) {
                all.things.extend(things);
                all.tracks.extend(group);
            }
        }
        all
    }

    /// Tracks that touch one another, in groups.
    fn groups(self) -> Vec<Vec<usize>> {
        let touch = |a: usize, b: usize| {
            let [a, b] = [&self.tracks[a], &self.tracks[b]];
            let near = |(a_at, b_at): (&Option<DVec3>, &Option<DVec3>)| {
                a_at.zip(*b_at).is_some_and(|(a_at, b_at)| a_at.distance(b_at) < a.radius_m + b.radius_m)
            };
            std::iter::zip(&a.centres, &b.centres).any(near)
        };
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for track in 0..self.tracks.len() {
            let (near, mut apart): (Vec<_>, Vec<_>) =
                groups.into_iter().partition(|group| group.iter().any(|&other| touch(track, other)));
            apart.push(near.into_iter().flatten().chain([track]).collect());
            groups = apart;
        }
        groups
    }
}

/// The points of tracks that touch one another.
struct Pieces<'a> {
    followed: Followed<'a>,
    /// Which points of each instant, and where they are.
    members: Vec<Vec<usize>>,
    points: Vec<Vec<DVec3>>,
}

impl<'a> Pieces<'a> {
    fn of(followed: Followed<'a>, tracks: &[usize]) -> Self {
        let mine = |owner: &Option<usize>| owner.is_some_and(|owner| tracks.contains(&owner));
        let members = followed.owners.iter().map(|owners| (0..owners.len()).filter(|&at| mine(&owners[at])).collect());
        let members: Vec<Vec<usize>> = members.collect();
        let places = |(members, cloud): (&Vec<usize>, &Cloud<'_>)| members.iter().map(|&at| cloud.points[at]).collect();
        let points = std::iter::zip(&members, followed.clouds).map(places).collect();
        Self { followed, members, points }
    }

    /// So many things, if each flies by itself.
    fn separated(&self, count: usize) -> Option<Vec<Thing>> {
        let Followed { times_s, cell_m, .. } = self.followed;
        let mixture = Mixture::of(PointClouds { times_s, points: &self.points, cell_m }, count)?;
        let mut things = self.things(&mixture);
        for _ in 0..count {
            if !self.exchange(&mut things) {
                break;
            }
        }
        let apart = pairs(count).all(|[a, b]| things[a].leaves(&things[b]));
        (apart && things.iter().all(|thing| thing.flies(self.followed))).then_some(things)
    }

    /// Lets the two things bounce off one another that keep their colours best then, or fly best; whether there are any.
    fn exchange(&self, things: &mut [Thing]) -> bool {
        let points: usize =
            things.iter().flat_map(|thing| thing.pieces.iter().flatten()).map(|piece| piece.members.len()).sum();
        let instants = things.first().map_or(0, |thing| thing.pieces.len());
        let meetings = pairs(things.len()).flat_map(|pair| (1..instants).map(move |instant| (pair, instant)));
        let known = &*things;
        let meeting = |([a, b], instant): ([usize; 2], usize)| {
            let [one, other] = [&known[a], &known[b]];
            one.meets(other, instant).then(|| (one.keep_colours(other, instant) / points as f64, [a, b], instant))
        };
        let meetings: Vec<(f64, [usize; 2], usize)> = meetings.filter_map(meeting).collect();
        let by_colours =
            meetings.iter().filter(|(gain, ..)| *gain >= BOUNCE).max_by(|a, b| a.0.total_cmp(&b.0)).copied();
        let by_flight = || {
            let bounce = |&(gain, [a, b], instant): &(f64, [usize; 2], usize)| {
                let [one, other] = [&known[a], &known[b]];
                let may_bounce = gain > -BOUNCE && self.farther(one, other) >= 1.0;
                let [one, other] = may_bounce.then(|| one.bounced(other, instant))?;
                Some((self.farther(&one, &other), [a, b], instant)).filter(|(apart, ..)| *apart < 1.0)
            };
            meetings.iter().filter_map(bounce).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let Some((_, [a, b], instant)) = by_colours.or_else(by_flight) else { return false };
        let [one, other] = known[a].bounced(&known[b], instant);
        (things[a], things[b]) = (one, other);
        true
    }

    /// How far the one of two things is from its flight that is farther, compared with how far what flies may be.
    fn farther(&self, one: &Thing, other: &Thing) -> f64 {
        let [one, other] = [one, other].map(|thing| thing.apart(self.followed).unwrap_or(f64::INFINITY));
        one.max(other)
    }

    /// The points of each thing of a mixture at each instant.
    fn things(&self, mixture: &Mixture) -> Vec<Thing> {
        let thing = |&spread_m: &f64| Thing { pieces: Vec::new(), spread_m, met: Vec::new() };
        let mut things: Vec<Thing> = mixture.spreads_m.iter().map(thing).collect();
        for (instant, (members, cloud)) in std::iter::zip(&self.members, self.followed.clouds).enumerate() {
            let mut parts = vec![Vec::new(); things.len()];
            for &at in members {
                parts[mixture.owner(instant, cloud.points[at])].push(at);
            }
            for (thing, part) in std::iter::zip(&mut things, parts) {
                let seen = part.len() >= FEWEST;
                thing.pieces.push(seen.then(|| Detection::new(part, cloud.points, cloud.colours)));
            }
        }
        things
    }
}

/// A thing that was told apart from others.
#[derive(Clone, Debug)]
struct Thing {
    /// Its points at each instant; none where they are too few.
    pieces: Vec<Option<Detection>>,
    /// How far they are from their middle along each axis, the root of the mean square, metres.
    spread_m: f64,
    /// Before which instants it bounces off another.
    met: Vec<usize>,
}

impl Thing {
    /// How many of its points have the colours that it usually has, if it is first one and then another since an instant.
    fn same<'a>(&'a self, then: &'a Self, since: usize) -> f64 {
        let pieces = || self.pieces[..since].iter().chain(&then.pieces[since..]).flatten();
        let usual = Histogram::mean(pieces().map(|piece| &piece.colours));
        pieces().map(|piece| piece.members.len() as f64 * piece.colours.overlap(&usual)).sum()
    }

    /// How many points more have their usual colours if it bounces off another before an instant than if they pass.
    fn keep_colours(&self, other: &Self, instant: usize) -> f64 {
        let bounce = self.same(other, instant) + other.same(self, instant);
        bounce - self.same(self, instant) - other.same(other, instant)
    }

    /// This and another thing, if they bounce off one another before an instant.
    fn bounced(&self, other: &Self, instant: usize) -> [Self; 2] {
        let [mut one, mut other] = [self.clone(), other.clone()];
        one.pieces[instant..].swap_with_slice(&mut other.pieces[instant..]);
        one.met.push(instant);
        other.met.push(instant);
        [one, other]
    }

    /// Where another is from it at the instants at which both are seen, metres.
    fn ways<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = (usize, DVec3)> + 'a {
        let both = std::iter::zip(&self.pieces, &other.pieces).enumerate();
        both.filter_map(|(at, (here, there))| Some((at, there.as_ref()?.centre - here.as_ref()?.centre)))
    }

    /// Whether another comes near to it between the instant before one and that, on a straight way.
    fn meets(&self, other: &Self, instant: usize) -> bool {
        let ways: Vec<DVec3> =
            self.ways(other).filter(|(at, _)| *at == instant || at + 1 == instant).map(|(_, way)| way).collect();
        let [from, to] = ways[..] else { return false };
        let share = -from.dot(to - from) / (to - from).length_squared().max(f64::MIN_POSITIVE);
        (from + (to - from) * share.clamp(0.0, 1.0)).length() < MEET * (self.spread_m + other.spread_m)
    }

    /// Whether it comes to another or leaves it; parts of one thing do neither.
    fn leaves(&self, other: &Self) -> bool {
        let range = |(low, high): (f64, f64), away: f64| (low.min(away), high.max(away));
        let (low, high) = self.ways(other).map(|(_, way)| way.length()).fold((f64::INFINITY, 0.0), range);
        high - low > CHANGES * (self.spread_m + other.spread_m)
    }

    /// Whether it flies, and is seen for most of the time.
    fn flies(&self, followed: Followed<'_>) -> bool {
        let often = self.pieces.iter().flatten().count() as f64 >= SEEN * followed.times_s.len() as f64;
        often && self.apart(followed).is_some_and(|apart| apart < 1.0)
    }

    /// How far it is from the flight that is nearest, compared with how far what flies may be; none where it is seen too rarely.
    fn apart(&self, followed: Followed<'_>) -> Option<f64> {
        let Followed { times_s, cell_m, exposure_s, .. } = followed;
        let seen = std::iter::zip(times_s, &self.pieces);
        let (seen_s, places): (Vec<f64>, Vec<DVec3>) =
            seen.filter_map(|(&time, piece)| Some((time, piece.as_ref()?.centre))).unzip();
        let jumps_s: Vec<[f64; 2]> = self.met.iter().map(|&at| [times_s[at - 1], times_s[at]]).collect();
        let places = Places { times_s: &seen_s, places: &places, exposure_s, cell_m, jumps_s: &jumps_s, fall: None };
        let most_m = (FLIES * cell_m).max(FLIES_SPREAD * self.spread_m);
        flight::apart_m(places).map(|apart_m| apart_m / most_m)
    }
}

/// Each two of so many things, the later first.
fn pairs(count: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..count).flat_map(|a| (0..a).map(move |b| [a, b]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{centres::follow, chains::chains, detections::detections, turn::directions};

    const CELL_M: f64 = 0.02;
    const PAINTS: [[u8; 3]; 4] = [[220, 40, 40], [40, 60, 220], [230, 220, 60], [30, 140, 60]];

    fn times() -> Vec<f64> {
        (0..10).map(|at| f64::from(at) / 15.0).collect()
    }

    /// What is followed in points of things that are where `way` has them.
    fn things(ways: &[&dyn Fn(f64) -> DVec3], paints: [[u8; 3]; 4], shape: &[DVec3]) -> Separated {
        let of = |t: f64, thing: usize| shape.iter().map(move |point| (ways[thing](t) + *point, paints[thing]));
        let instants: Vec<(Vec<DVec3>, Vec<[u8; 3]>)> =
            times().into_iter().map(|t| (0..ways.len()).flat_map(|thing| of(t, thing)).unzip()).collect();
        let clouds: Vec<Cloud<'_>> = instants.iter().map(|(points, colours)| Cloud { points, colours }).collect();
        let found: Vec<_> = clouds.iter().map(|cloud| detections(cloud.points, cloud.colours, CELL_M)).collect();
        let times_s = times();
        let (tracks, owners) = follow(&chains(&found, &times_s), &found, &clouds, &times_s, [CELL_M, 0.0], None);
        let followed = Followed {
            tracks: &tracks,
            owners: &owners,
            clouds: &clouds,
            times_s: &times_s,
            cell_m: CELL_M,
            exposure_s: 0.0,
        };
        followed.separated()
    }

    fn fall(t: f64) -> DVec3 {
        DVec3::new(0.0, 4.905 * (t - 0.3) * (t - 0.3), 2.0)
    }

    #[test]
    fn four_that_fly_in_touching_pairs_are_told_apart_and_two_of_them_bounce() {
        // The nearer they come to one another the more each pair falls as one thing would.
        for nearest_m in [0.09, 0.05] {
            four_in_pairs(nearest_m, PAINTS);
        }
        // The two that bounce look the same: as they fly tells that they do.
        four_in_pairs(0.09, [PAINTS[0], PAINTS[0], PAINTS[2], PAINTS[3]]);
    }

    fn four_in_pairs(nearest_m: f64, paints: [[u8; 3]; 4]) {
        let ball: Vec<DVec3> = directions(120).into_iter().map(|along| 0.09 * along).collect();
        // The inner two meet in the middle and fly back, the outer two pass, so that each pair changes a partner.
        let back = |t: f64, side: f64| fall(t) + side * (nearest_m + 2.2 * (t - 0.3).abs()) * DVec3::X;
        let past = |t: f64, side: f64| fall(t) + DVec3::new(side * 2.2 * (t - 0.3), side * 0.18, 0.0);
        let ways: [&dyn Fn(f64) -> DVec3; 4] =
            [&|t| back(t, -1.0), &|t| back(t, 1.0), &|t| past(t, 1.0), &|t| past(t, -1.0)];
        let apart = things(&ways, paints, &ball);
        assert_eq!(apart.things.len(), 4, "in the place of {:?}", apart.tracks);
        for way in ways {
            let off = |thing: &Thing| {
                let off = |(piece, t): (&Option<Detection>, f64)| {
                    piece.as_ref().map_or(0.0, |piece| piece.centre.distance(way(t)))
                };
                std::iter::zip(&thing.pieces, times()).map(off).fold(0.0, f64::max)
            };
            let nearest = apart.things.iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.07, "{nearest} m");
        }
        let met: Vec<&Thing> = apart.things.iter().filter(|thing| !thing.met.is_empty()).collect();
        assert_eq!(met.len(), 2);
        for thing in met {
            assert!((4..=5).contains(&thing.met[0]), "before instant {}", thing.met[0]);
        }
    }

    #[test]
    fn what_swings_and_what_is_long_stay_one() {
        let rod: Vec<DVec3> = (0..200)
            .map(|at| {
                let along = f64::from(at) / 200.0 - 0.5;
                let around = 2.4 * f64::from(at);
                DVec3::new(0.5 * along, 0.03 * around.cos(), 0.03 * around.sin())
            })
            .collect();
        let swinging = |t: f64| DVec3::new(0.8 * (9.0 * t).sin(), 0.2 * (18.0 * t).cos(), 2.0);
        assert_eq!(things(&[&swinging], PAINTS, &rod).things.len(), 0);
        assert_eq!(things(&[&fall], PAINTS, &rod).things.len(), 0);
        let zigzag = |t: f64| DVec3::new((10.0 * t).fract(), 0.0, 2.0);
        assert_eq!(things(&[&zigzag], PAINTS, &rod).things.len(), 0);
    }
}
