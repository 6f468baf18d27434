//! What a user corrects of the bodies that were found, as a file of TOML says it.
//!
//! Names are those of a finding without corrections; they stay what they are whatever else is corrected. Things are first merged, then
//! split, then forgotten; the parts of a split `body2` are `body2.0`, `body2.1` and so on.

use std::path::Path;

use erfgs_base::FileError;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{
    centres::{Cloud, Owners, Track, radius_m},
    detections::{Histogram, mean},
    parts::{far_apart, nearest, settled},
};
use crate::CloudError;

/// A thing may be split into so many parts.
const PARTS: std::ops::RangeInclusive<usize> = 2..=16;
/// Nothing that bodies are for turns faster, radians per second.
const FASTEST: f64 = 1000.0;
/// A part is found at an instant if it has so large a share of an even one.
const LEAST_SHARE: f64 = 0.2;

/// Corrections of the bodies of a dataset.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodyEdits {
    /// Bodies that are none. What lies on them is left to Gaussians that are free in time.
    pub forget: Vec<String>,
    /// Bodies that are one thing, which has the name of the first.
    pub merge: Vec<Vec<String>>,
    /// Bodies that are several things.
    pub split: Vec<SplitBody>,
    /// How bodies turn.
    pub turn: Vec<TurnBody>,
    /// Bodies that are carved even if they look like balls.
    pub carve: Vec<String>,
}

impl BodyEdits {
    /// Reads a file of TOML.
    ///
    /// # Errors
    /// When it cannot be read or has something else in it.
    pub fn read(path: &Path) -> Result<Self, CloudError> {
        let text = std::fs::read_to_string(path).map_err(FileError::when("read", path))?;
        toml::from_str(&text)
            .map_err(|error| CloudError::BodyEditsFile { path: path.to_owned(), why: error.to_string() })
    }
}

/// A body that is several things.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitBody {
    /// Its name.
    pub body: String,
    /// One thing before, another after this time: seconds since the beginning of the recording.
    pub at_s: Option<f64>,
    /// So many things beside each other.
    pub parts: Option<usize>,
}

/// How a body turns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TurnBody {
    /// Its name.
    pub body: String,
    /// Axis in the world times rate, radians per second; zeros: it does not turn.
    pub rate_rad_s: [f64; 3],
}

/// What is followed, with its name and what the user says of how it turns.
#[derive(Clone, Debug)]
pub struct Named {
    pub name: String,
    pub track: Track,
    pub rate: Option<DVec3>,
    /// Whether it may be a ball.
    pub may_be_round: bool,
}

/// Corrects tracks, which are called by their numbers, and whose points are whose.
pub fn apply(
    edits: &BodyEdits,
    tracks: Vec<Track>,
    owners: &mut Owners,
    clouds: &[Cloud<'_>],
    times_s: &[f64],
) -> Result<Vec<Named>, CloudError> {
    let named = |(number, track)| Some(Named { name: format!("body{number}"), track, rate: None, may_be_round: true });
    let mut edited = Edited { things: tracks.into_iter().enumerate().map(named).collect(), owners, clouds, times_s };
    for names in &edits.merge {
        edited.merge(names)?;
    }
    for split in &edits.split {
        edited.split(split)?;
    }
    for TurnBody { body, rate_rad_s } in &edits.turn {
        let (index, rate) = (edited.find(body)?, DVec3::from(*rate_rad_s));
        if !rate.is_finite() || rate.length() > FASTEST {
            return Err(wrong(format!(
                "{body} cannot turn at {rate_rad_s:?} rad/s; at most {FASTEST} can be followed"
            )));
        }
        edited.thing(index).rate = Some(rate);
    }
    for name in &edits.carve {
        let index = edited.find(name)?;
        edited.thing(index).may_be_round = false;
    }
    for name in &edits.forget {
        let index = edited.find(name)?;
        edited.things[index] = None;
    }
    let things = edited.left();
    if things.is_empty() && !edits.forget.is_empty() {
        return Err(wrong("all bodies are forgotten; train without bodies instead (--motion free-time)".into()));
    }
    Ok(things)
}

fn wrong(why: String) -> CloudError {
    CloudError::BodyEdits { why }
}

struct Edited<'a> {
    /// Things by the number that owns points; none where a thing became another or was forgotten.
    things: Vec<Option<Named>>,
    owners: &'a mut Owners,
    clouds: &'a [Cloud<'a>],
    times_s: &'a [f64],
}

impl Edited<'_> {
    fn find(&self, name: &str) -> Result<usize, CloudError> {
        let index = self.things.iter().position(|thing| thing.as_ref().is_some_and(|thing| thing.name == name));
        index.ok_or_else(|| {
            let names: Vec<&str> = self.things.iter().flatten().map(|thing| thing.name.as_str()).collect();
            wrong(format!("there is no body {name:?} (any more); there are {}", names.join(", ")))
        })
    }

    /// The thing of an index that [`Edited::find`] gave.
    fn thing(&mut self, index: usize) -> &mut Named {
        self.things[index].as_mut().unwrap_or_else(|| unreachable!("found a moment ago"))
    }

    fn merge(&mut self, names: &[String]) -> Result<(), CloudError> {
        let all: Vec<usize> = names.iter().map(|name| self.find(name)).collect::<Result<_, _>>()?;
        let [first, others @ ..] = &all[..] else { return Err(wrong("merge names no body".into())) };
        if others.is_empty() || all.iter().enumerate().any(|(at, index)| all[..at].contains(index)) {
            return Err(wrong(format!("merge takes two or more bodies that differ, not {names:?}")));
        }
        for owner in self.owners.iter_mut().flatten() {
            if owner.is_some_and(|owner| others.contains(&owner)) {
                *owner = Some(*first);
            }
        }
        let sure = (0..self.times_s.len()).map(|instant| {
            // Where one of them was not followed, the middle of the others is not that of all.
            all.iter().all(|&index| self.things[index].as_ref().is_some_and(|thing| thing.track.sure[instant]))
        });
        let sure: Vec<bool> = sure.collect();
        for &other in others {
            self.things[other] = None;
        }
        let track = &mut self.thing(*first).track;
        track.sure = sure;
        track.met.clear();
        self.measure(*first);
        Ok(())
    }

    fn split(&mut self, split: &SplitBody) -> Result<(), CloudError> {
        let SplitBody { body, at_s, parts } = split;
        let index = self.find(body)?;
        let Some(thing) = self.things[index].take() else { return Ok(()) };
        let first = self.things.len();
        let number = match (at_s, parts) {
            (Some(at_s), None) => {
                let after = |instant: usize| usize::from(self.times_s[instant] >= *at_s);
                let sides = thing.track.instants().fold([0, 0], |mut sides, instant| {
                    sides[after(instant)] += 1;
                    sides
                });
                if sides.contains(&0) {
                    return Err(wrong(format!(
                        "{body} is not in view before and after {at_s} s; it cannot be split there"
                    )));
                }
                for instant in 0..self.times_s.len() {
                    let part = first + after(instant);
                    self.owners[instant]
                        .iter_mut()
                        .filter(|owner| **owner == Some(index))
                        .for_each(|owner| *owner = Some(part));
                }
                2
            }
            (None, Some(parts)) if PARTS.contains(parts) => {
                self.part(&thing.track, index, first, *parts);
                *parts
            }
            (None, Some(parts)) => {
                let [least, most] = [PARTS.start(), PARTS.end()];
                return Err(wrong(format!("{body} can be split into {least} to {most} parts, not {parts}")));
            }
            _ => return Err(wrong(format!("how to split {body}? give either at_s or parts"))),
        };
        for part in 0..number {
            self.things.push(Some(Named { name: format!("{body}.{part}"), ..thing.clone() }));
            self.measure(first + part);
        }
        Ok(())
    }

    /// Gives the points of a thing to `parts` others from `first` on: those that are near each other, from the instant at which it has
    /// most points to both sides.
    fn part(&mut self, track: &Track, index: usize, first: usize, parts: usize) {
        let members: Vec<Vec<usize>> = self.owners.iter().map(|owners| owned(owners, index)).collect();
        let instants: Vec<usize> = track.instants().collect();
        let Some(start) = (0..instants.len()).max_by_key(|&at| members[instants[at]].len()) else { return };
        let places =
            |instant: usize| members[instant].iter().map(|&at| self.clouds[instant].points[at]).collect::<Vec<_>>();
        let begin = settled(&places(instants[start]), far_apart(&places(instants[start]), parts));
        let mut given: Vec<(usize, Vec<DVec3>)> = vec![(instants[start], begin.clone())];
        for side in [&mut (start + 1..instants.len()) as &mut dyn Iterator<Item = usize>, &mut (0..start).rev()] {
            let (mut last, mut middles) = (instants[start], begin.clone());
            for instant in side.map(|at| instants[at]) {
                let moved = track.centres[instant].unwrap_or_default() - track.centres[last].unwrap_or_default();
                middles = settled(&places(instant), middles.iter().map(|middle| *middle + moved).collect());
                given.push((instant, middles.clone()));
                last = instant;
            }
        }
        for (instant, middles) in given {
            for &at in &members[instant] {
                self.owners[instant][at] = Some(first + nearest(&middles, self.clouds[instant].points[at]));
            }
        }
    }

    /// Where a thing is and how large, by the points that are its own now.
    fn measure(&mut self, index: usize) {
        let members: Vec<Vec<usize>> = self.owners.iter().map(|owners| owned(owners, index)).collect();
        let mut counts: Vec<usize> = members.iter().map(Vec::len).filter(|count| *count > 0).collect();
        counts.sort_unstable();
        let usual = counts.get(counts.len() / 2).copied().unwrap_or(0) as f64;
        let clouds = self.clouds;
        let track = &mut self.thing(index).track;
        let (mut radii, mut looks) = (Vec::new(), Vec::new());
        for (instant, members) in members.iter().enumerate() {
            if (members.len() as f64) < LEAST_SHARE * usual || members.is_empty() {
                (track.centres[instant], track.sure[instant]) = (None, false);
                continue;
            }
            let Cloud { points, colours } = clouds[instant];
            let centre = mean(members.iter().map(|&at| points[at]));
            radii.push(radius_m(points, members, centre));
            looks.push(Histogram::of(members.iter().map(|&at| &colours[at])));
            track.centres[instant] = Some(centre);
        }
        radii.sort_unstable_by(f64::total_cmp);
        track.radius_m = radii.get(radii.len() / 2).copied().unwrap_or(track.radius_m);
        track.colours = Histogram::mean(&looks);
        track.usual_points = usual;
    }

    /// What is left, numbered anew; points of what was forgotten are nobody's.
    fn left(self) -> Vec<Named> {
        let mut numbers = vec![None; self.things.len()];
        let mut left = Vec::new();
        for (thing, number) in std::iter::zip(self.things, &mut numbers) {
            if let Some(thing) = thing {
                *number = Some(left.len());
                left.push(thing);
            }
        }
        for owner in self.owners.iter_mut().flatten() {
            *owner = owner.and_then(|owner| numbers[owner]);
        }
        left
    }
}

fn owned(owners: &[Option<usize>], index: usize) -> Vec<usize> {
    (0..owners.len()).filter(|&at| owners[at] == Some(index)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::turn::directions;

    const TIMES: [f64; 6] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];

    /// Points and their colours.
    type Instant = (Vec<DVec3>, Vec<[u8; 3]>);

    /// Balls of 60 points that fly along x, one above the other, each a track of its own.
    fn balls(heights: &[f64]) -> (Vec<Track>, Owners, Vec<Instant>) {
        let at = |height: f64, t_s: f64| DVec3::new(2.0 * t_s, height, 0.0);
        let points = |t_s: f64| {
            let of = |height: &f64| {
                let centre = at(*height, t_s);
                directions(60).into_iter().map(move |along| centre + 0.1 * along)
            };
            let points: Vec<DVec3> = heights.iter().flat_map(of).collect();
            let colours = vec![[9; 3]; points.len()];
            (points, colours)
        };
        let track = |height: &f64| Track {
            fall: None,
            centres: TIMES.iter().map(|t_s| Some(at(*height, *t_s))).collect(),
            sure: vec![true; TIMES.len()],
            met: Vec::new(),
            radius_m: 0.1,
            colours: Histogram::of(&[[9; 3]]),
            usual_points: 60.0,
        };
        let owners = TIMES.map(|_| (0..60 * heights.len()).map(|at| Some(at / 60)).collect()).to_vec();
        (heights.iter().map(track).collect(), owners, TIMES.map(points).to_vec())
    }

    fn edited(heights: &[f64], text: &str) -> Result<(Vec<Named>, Owners), CloudError> {
        let (tracks, mut owners, instants) = balls(heights);
        let clouds: Vec<Cloud<'_>> = instants.iter().map(|(points, colours)| Cloud { points, colours }).collect();
        let edits: BodyEdits = toml::from_str(text).unwrap();
        Ok((apply(&edits, tracks, &mut owners, &clouds, &TIMES)?, owners))
    }

    fn names(things: &[Named]) -> Vec<&str> {
        things.iter().map(|thing| thing.name.as_str()).collect()
    }

    #[test]
    fn without_corrections_everything_stays() {
        let (things, owners) = edited(&[0.0, 1.0], "").unwrap();
        let (tracks, before, _) = balls(&[0.0, 1.0]);
        assert_eq!((names(&things), owners), (vec!["body0", "body1"], before));
        for (thing, track) in std::iter::zip(things, tracks) {
            assert_eq!((thing.track.centres, thing.rate), (track.centres, None));
        }
    }

    #[test]
    fn what_is_forgotten_owns_nothing_and_names_stay() {
        let text = "forget = ['body1']\n[[turn]]\nbody = 'body2'\nrate_rad_s = [0, 0, 15]";
        let (things, owners) = edited(&[0.0, 1.0, 2.0], text).unwrap();
        assert_eq!(names(&things), ["body0", "body2"]);
        assert_eq!([things[0].rate, things[1].rate], [None, Some(DVec3::Z * 15.0)]);
        for owners in owners {
            let count = |of| owners.iter().filter(|owner| **owner == of).count();
            assert_eq!([count(Some(0)), count(Some(1)), count(None)], [60; 3]);
        }
    }

    #[test]
    fn what_is_to_be_carved_may_be_no_ball() {
        let (things, _) = edited(&[0.0, 1.0], "carve = ['body1']").unwrap();
        assert_eq!([things[0].may_be_round, things[1].may_be_round], [true, false]);
        let (things, _) = edited(&[0.0], "carve = ['body0.1']\n[[split]]\nbody = 'body0'\nat_s = 0.25").unwrap();
        assert_eq!([things[0].may_be_round, things[1].may_be_round], [true, false]);
    }

    #[test]
    fn merged_things_are_one_and_split_they_are_two_again() {
        let (things, owners) = edited(&[0.0, 1.0, 5.0], "merge = [['body2', 'body0']]").unwrap();
        assert_eq!(names(&things), ["body1", "body2"]);
        let both = &things[1].track;
        assert!(both.centres[3].unwrap().abs_diff_eq(DVec3::new(0.6, 2.5, 0.0), 0.01), "{:?}", both.centres);
        assert!((both.usual_points, both.sure[2]) == (120.0, true) && (both.radius_m - 2.5).abs() < 0.1);
        assert_eq!(owners[0].iter().filter(|owner| **owner == Some(1)).count(), 120);

        let text = "merge = [['body2', 'body0']]\n[[split]]\nbody = 'body2'\nparts = 2";
        let (things, _) = edited(&[0.0, 1.0, 5.0], text).unwrap();
        assert_eq!(names(&things), ["body1", "body2.0", "body2.1"]);
        for (instant, t_s) in TIMES.iter().enumerate() {
            let mut heights = [1, 2].map(|part: usize| things[part].track.centres[instant].unwrap());
            heights.sort_by(|a, b| a.y.total_cmp(&b.y));
            for (found, height) in std::iter::zip(heights, [0.0, 5.0]) {
                assert!(found.abs_diff_eq(DVec3::new(2.0 * t_s, height, 0.0), 0.01), "{found}");
            }
        }
    }

    #[test]
    fn a_thing_split_in_time_is_one_before_and_another_after() {
        let text = "forget = ['body0.0']\n[[split]]\nbody = 'body0'\nat_s = 0.3";
        let (things, owners) = edited(&[0.0, 1.0], text).unwrap();
        assert_eq!(names(&things), ["body1", "body0.1"]);
        assert_eq!(things[1].track.instants().collect::<Vec<_>>(), [3, 4, 5]);
        assert_eq!(
            owners.iter().map(|of| of.iter().filter(|owner| owner.is_none()).count()).collect::<Vec<_>>(),
            [60, 60, 60, 0, 0, 0]
        );
    }

    #[test]
    fn what_cannot_be_is_refused_and_said() {
        let refused = |text: &str, part: &str| {
            let why = edited(&[0.0, 1.0], text).unwrap_err().to_string();
            assert!(why.contains(part), "{text}: {why}");
        };
        refused("forget = ['body7']", "there are body0, body1");
        refused("carve = ['body7']", "there are body0, body1");
        refused("forget = ['body0', 'body1']", "--motion free-time");
        refused("forget = ['body0', 'body0']", "\"body0\"");
        refused("merge = [['body0']]", "two or more");
        refused("merge = [['body0', 'body0']]", "two or more");
        refused("merge = [[]]", "no body");
        refused("merge = [['body0', 'body1']]\nforget = ['body1']", "there are body0");
        refused("[[split]]\nbody = 'body0'", "either at_s or parts");
        refused("[[split]]\nbody = 'body0'\nat_s = 0.2\nparts = 2", "either at_s or parts");
        refused("[[split]]\nbody = 'body0'\nparts = 1000000000", "2 to 16");
        for time in ["9", "-inf", "nan"] {
            refused(&format!("[[split]]\nbody = 'body0'\nat_s = {time}"), "before and after");
        }
        for rate in ["nan", "inf", "1e9"] {
            refused(&format!("[[turn]]\nbody = 'body0'\nrate_rad_s = [0, 0, {rate}]"), "cannot turn");
        }
        assert!(toml::from_str::<BodyEdits>("forgot = ['body0']").is_err());
    }
}
