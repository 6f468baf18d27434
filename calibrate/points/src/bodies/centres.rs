//! Where each tracked thing is at every instant: points go to the nearest thing in place and colour, and tracks go on beyond the ends
//! of their chains.

use glam::DVec3;

use super::{
    chains::Chain,
    detections::{Detection, Histogram, mean},
    flight::{Flights, Places},
    path::fitted,
};

/// A point belongs to a thing within so many of its radii.
const NEAR: f64 = 1.25;
/// A thing is found at an instant if it has so large a share of its usual points.
const FOUND: f64 = 0.35;
/// What flies is not there where it seems to be so many spacings from its flight: other things or parts of it are.
const STRAYS: f64 = 4.0;
/// Beyond the ends of its chain a thing must be more surely there: in points and in colours.
const FOUND_BEYOND: f64 = 0.4;
const SAME_BEYOND: f64 = 0.55;

/// A thing that is followed through the instants.
#[derive(Clone, Debug)]
pub struct Track {
    /// Where its centre is at each instant; none where it was not followed.
    pub centres: Vec<Option<DVec3>>,
    /// Whether its detection stood alone then, and was as large as usual.
    pub sure: Vec<bool>,
    /// Before which instants it bounces off another thing.
    pub met: Vec<usize>,
    /// Nine tenths of its points are nearer to its centre, metres.
    pub radius_m: f64,
    /// How what flies freely accelerates, where that is known, metres per second squared.
    pub fall: Option<DVec3>,
    /// Its colours.
    pub colours: Histogram,
    /// How many points it usually has.
    pub usual_points: f64,
}

impl Track {
    /// The instants at which it was followed.
    pub fn instants(&self) -> impl DoubleEndedIterator<Item = usize> {
        self.centres.iter().enumerate().filter(|(_, centre)| centre.is_some()).map(|(instant, _)| instant)
    }

    /// How it flies, by the instants at which it was seen alone.
    pub fn flights(&self, times_s: &[f64], exposure_s: f64, cell_m: f64) -> Flights {
        let sure = self.instants().filter(|&instant| self.sure[instant]);
        let (seen_s, places): (Vec<f64>, Vec<DVec3>) =
            sure.filter_map(|instant| Some((times_s[instant], self.centres[instant]?))).unzip();
        let jumps_s = &self.jumps_s(times_s);
        Flights::new(Places { times_s: &seen_s, places: &places, exposure_s, cell_m, jumps_s, fall: self.fall })
    }

    /// The spans of time in which it bounces off another thing, seconds.
    fn jumps_s(&self, times_s: &[f64]) -> Vec<[f64; 2]> {
        self.met.iter().map(|&instant| [times_s[instant - 1], times_s[instant]]).collect()
    }

    /// Times and centres of the instants at which it was followed.
    pub fn places(&self, times_s: &[f64]) -> (Vec<f64>, Vec<DVec3>) {
        std::iter::zip(times_s, &self.centres).filter_map(|(&time, &centre)| Some((time, centre?))).unzip()
    }
}

/// Which track each point of each instant belongs to.
pub type Owners = Vec<Vec<Option<usize>>>;

/// The points and colours of an instant.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    /// Places, metres.
    pub points: &'a [DVec3],
    /// Colours, sRGB.
    pub colours: &'a [[u8; 3]],
}

/// Follows the things of `chains` at all instants; what flies freely is known to accelerate by `fall`, where that is known.
pub fn follow(
    chains: &[Chain],
    detections: &[Vec<Detection>],
    clouds: &[Cloud<'_>],
    times_s: &[f64],
    [cell_m, exposure_s]: [f64; 2],
    fall: Option<DVec3>,
) -> (Vec<Track>, Owners) {
    let begin = |chain| Track { fall, ..begin(chain, detections, clouds, times_s) };
    let tracks = chains.iter().map(begin).collect();
    let owners = clouds.iter().map(|cloud| vec![None; cloud.points.len()]).collect();
    let mut followed = Followed { tracks, owners, clouds, times_s, cell_m };
    followed.assign(6);
    followed.extend();
    followed.assign(4);
    followed.fly(exposure_s);
    (followed.tracks, followed.owners)
}

/// A track by its chain alone; between its detections by what is around.
fn begin(chain: &Chain, detections: &[Vec<Detection>], clouds: &[Cloud<'_>], times_s: &[f64]) -> Track {
    let of = |&(instant, index): &(usize, usize)| (instant, &detections[instant][index]);
    let mut sizes: Vec<usize> = chain.seen.iter().map(|at| of(at).1.members.len()).collect();
    sizes.sort_unstable();
    let usual_points = sizes[sizes.len() / 2] as f64;
    // Where two things are one piece, it is larger than usual and its centre between them.
    let alone = |detection: &Detection| {
        let share = detection.members.len() as f64 / usual_points;
        share > 0.6 && share < 1.4
    };
    let mut certain: Vec<(usize, &Detection)> = chain.seen.iter().map(of).filter(|(_, found)| alone(found)).collect();
    if certain.len() < 2 {
        certain = chain.seen.iter().map(of).collect();
    }
    let mut radii: Vec<f64> = certain
        .iter()
        .map(|(instant, found)| radius_m(clouds[*instant].points, &found.members, found.centre))
        .collect();
    radii.sort_unstable_by(f64::total_cmp);
    let (first, last) = (chain.seen[0].0, chain.seen[chain.seen.len() - 1].0);
    let (mut centres, mut sure) = (vec![None; times_s.len()], vec![false; times_s.len()]);
    let known: (Vec<f64>, Vec<DVec3>) =
        certain.iter().map(|(instant, found)| (times_s[*instant], found.centre)).unzip();
    for instant in first..=last {
        let here = certain.iter().find(|(of, _)| *of == instant);
        sure[instant] = here.is_some();
        centres[instant] = Some(here.map_or_else(|| between(&known, times_s[instant]), |(_, found)| found.centre));
    }
    Track {
        centres,
        sure,
        met: chain.met.clone(),
        radius_m: radii[radii.len() / 2],
        fall: None,
        colours: Histogram::mean(certain.iter().map(|(_, found)| &found.colours)),
        usual_points,
    }
}

/// How far nine tenths of a thing's points are from its centre at most, metres; 0 without points.
pub fn radius_m(points: &[DVec3], members: &[usize], centre: DVec3) -> f64 {
    let mut away: Vec<f64> = members.iter().map(|&at| points[at].distance(centre)).collect();
    away.sort_unstable_by(f64::total_cmp);
    away.get(away.len() * 9 / 10).copied().unwrap_or(0.0)
}

/// Where a thing is at a time by the nearest places that are known: on a parabola between them, straight on beyond them.
fn between((times_s, places): &(Vec<f64>, Vec<DVec3>), t_s: f64) -> DVec3 {
    let mut near: Vec<usize> = (0..times_s.len()).collect();
    near.sort_by(|&a, &b| (times_s[a] - t_s).abs().total_cmp(&(times_s[b] - t_s).abs()));
    near.truncate(4);
    let inside = near.iter().any(|&at| times_s[at] <= t_s) && near.iter().any(|&at| times_s[at] >= t_s);
    if !inside {
        near.truncate(2);
    }
    let times: Vec<f64> = near.iter().map(|&at| times_s[at] - t_s).collect();
    let places: Vec<DVec3> = near.iter().map(|&at| places[at]).collect();
    fitted(&times, &places, if inside { 2 } else { 1 })
}

struct Followed<'a> {
    tracks: Vec<Track>,
    owners: Owners,
    clouds: &'a [Cloud<'a>],
    times_s: &'a [f64],
    cell_m: f64,
}

impl Followed<'_> {
    /// Gives points to tracks and moves centres to the mean of their points, by turns.
    fn assign(&mut self, rounds: usize) {
        for _ in 0..rounds {
            for instant in 0..self.clouds.len() {
                self.assign_at(instant);
            }
        }
    }

    /// The tracks that are followed at an instant, and where they are.
    fn here(&self, instant: usize) -> Vec<(usize, DVec3)> {
        let at = |(index, track): (usize, &Track)| Some((index, track.centres[instant]?));
        self.tracks.iter().enumerate().filter_map(at).collect()
    }

    /// Gives points of an instant to tracks.
    fn own(&mut self, instant: usize) {
        let Cloud { points, colours } = self.clouds[instant];
        let here = self.here(instant);
        for (at, owner) in self.owners[instant].iter_mut().enumerate() {
            let nearest = here.iter().map(|&(index, centre)| {
                let track = &self.tracks[index];
                let away = points[at].distance(centre) / (track.radius_m + self.cell_m);
                (away - 0.12 * track.colours.speaks_for(colours[at]), away, index)
            });
            let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
            *owner = nearest.and_then(|(_, away, index)| (away < NEAR).then_some(index));
        }
    }

    fn assign_at(&mut self, instant: usize) {
        self.own(instant);
        let points = self.clouds[instant].points;
        for (index, centre) in self.here(instant) {
            let members = self.owners[instant].iter().zip(points).filter(|(owner, _)| **owner == Some(index));
            let members: Vec<DVec3> = members.map(|(_, &point)| point).collect();
            let track = &mut self.tracks[index];
            if members.len() as f64 > FOUND * track.usual_points {
                let step = (mean(members) - centre).clamp_length_max(0.5 * track.radius_m);
                let trust = if track.sure[instant] { 1.0 } else { 0.7 };
                track.centres[instant] = Some(centre + trust * step);
            }
        }
    }

    /// What was not seen alone is where its flight has it, if it flies; points go to where things are then.
    fn fly(&mut self, exposure_s: f64) {
        for track in &mut self.tracks {
            let flights = track.flights(self.times_s, exposure_s, self.cell_m);
            let all = std::iter::zip(&mut track.centres, &mut track.sure);
            for ((centre, sure), &t_s) in std::iter::zip(all, self.times_s) {
                let (Some(centre), Some(flown)) = (centre, flights.at(t_s)) else { continue };
                *sure &= centre.distance(flown) < STRAYS * self.cell_m;
                if !*sure {
                    *centre = flown;
                }
            }
        }
        for instant in 0..self.clouds.len() {
            self.own(instant);
        }
    }

    /// Follows tracks beyond their ends, as long as there are points of such a thing that no other track has.
    fn extend(&mut self) {
        let mut order: Vec<usize> = (0..self.tracks.len()).collect();
        order.sort_by(|&a, &b| self.tracks[b].usual_points.total_cmp(&self.tracks[a].usual_points));
        let mut ended = vec![[false; 2]; self.tracks.len()];
        for _ in 0..self.times_s.len() {
            let mut grown = false;
            for &index in &order {
                for (side, ended) in ended[index].iter_mut().enumerate() {
                    if *ended {
                        continue;
                    }
                    match self.beyond(index, side == 1) {
                        Some((instant, centre)) => {
                            self.tracks[index].centres[instant] = Some(centre);
                            self.tracks[index].sure[instant] = false;
                            grown = true;
                        }
                        None => *ended = true,
                    }
                }
            }
            if !grown {
                break;
            }
            self.assign(2);
        }
    }

    /// The next instant before or after a track, and where it is then, if it is anywhere.
    fn beyond(&self, index: usize, after: bool) -> Option<(usize, DVec3)> {
        let track = &self.tracks[index];
        let end = if after { track.instants().next_back()? + 1 } else { track.instants().next()?.checked_sub(1)? };
        let &t_s = self.times_s.get(end)?;
        let known = track.places(self.times_s);
        if known.0.len() < 2 {
            return None;
        }
        // Half by the parabola of its last places and half straight on: the one follows a fall, the other noise less.
        let last = known.0.len().min(4);
        let tail = if after { known.0.len() - last..known.0.len() } else { 0..last };
        let times: Vec<f64> = known.0[tail.clone()].iter().map(|time| time - t_s).collect();
        let bent = fitted(&times, &known.1[tail], if known.0.len() > 4 { 2 } else { 1 });
        let mut centre = 0.5 * (bent + between(&known, t_s));
        let Cloud { points, colours } = self.clouds[end];
        let free = |at: usize| {
            self.owners[end][at].is_none_or(|other| {
                let other = &self.tracks[other];
                other.centres[end].is_none_or(|centre| points[at].distance(centre) > 0.9 * other.radius_m)
            })
        };
        let reach = NEAR * (track.radius_m + self.cell_m);
        let mut members = Vec::new();
        for _ in 0..8 {
            members = (0..points.len()).filter(|&at| points[at].distance(centre) < reach && free(at)).collect();
            if (members.len() as f64) < FOUND_BEYOND * track.usual_points {
                return None;
            }
            centre += 0.7 * (mean(members.iter().map(|&at| points[at])) - centre);
        }
        let looks = Histogram::of(members.iter().map(|&at| &colours[at]));
        (looks.overlap(&track.colours) > SAME_BEYOND).then_some((end, centre))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{chains::chains, detections::detections, turn::directions};

    /// Points on a sphere.
    fn sphere(centre: DVec3, radius: f64) -> impl Iterator<Item = DVec3> {
        directions(200).into_iter().map(move |along| centre + radius * along)
    }

    #[test]
    fn two_balls_that_pass_as_one_piece_are_told_apart_and_followed_to_the_ends() {
        let ways = [|t: f64| DVec3::new(4.0 * t, 0.0, 0.0), |t: f64| DVec3::new(2.2 - 4.0 * t, 0.15 + t * t, 0.1)];
        let times: Vec<f64> = (0..11).map(|k| 0.05 * f64::from(k)).collect();
        let paints = [[210, 40, 40], [40, 60, 210]];
        let instants: Vec<(Vec<DVec3>, Vec<[u8; 3]>)> = times
            .iter()
            .map(|&t| {
                let of = |ball: usize| sphere(ways[ball](t), 0.15).map(move |point| (point, paints[ball]));
                of(0).chain(of(1)).unzip()
            })
            .collect();
        let clouds: Vec<Cloud<'_>> = instants.iter().map(|(points, colours)| Cloud { points, colours }).collect();
        let cell = 0.03;
        let found: Vec<Vec<Detection>> =
            clouds.iter().map(|cloud| detections(cloud.points, cloud.colours, cell)).collect();
        assert!(found.iter().any(|pieces| pieces.len() == 1), "they are one piece somewhere");
        let (tracks, owners) = follow(&chains(&found, &times), &found, &clouds, &times, [cell, 0.0], None);
        assert_eq!(tracks.len(), 2);
        for (index, track) in tracks.iter().enumerate() {
            assert_eq!(track.instants().count(), times.len());
            let first = track.centres[0].unwrap();
            let way = ways.iter().min_by(|a, b| a(0.0).distance(first).total_cmp(&b(0.0).distance(first))).unwrap();
            for (instant, &t) in times.iter().enumerate() {
                let off = track.centres[instant].unwrap().distance(way(t));
                assert!(off < 0.06, "{off} m at {t} s");
            }
            assert!((track.radius_m - 0.15).abs() < 0.01);
            let mine = owners.iter().flatten().filter(|owner| **owner == Some(index)).count();
            assert!(mine.abs_diff(200 * times.len()) < 40 * times.len(), "{mine} points");
        }
    }

    #[test]
    fn a_ball_that_is_hidden_where_it_bounces_is_where_its_flight_has_it() {
        let velocities = [DVec3::new(2.0, 2.8, 0.0), DVec3::new(1.6, -2.6, 0.2)];
        let way = |t: f64| {
            let after = t - 0.31;
            velocities[usize::from(after > 0.0)] * after + 4.905 * after * after * DVec3::Y
        };
        let times: Vec<f64> = (0..10).map(|k| 0.0667 * f64::from(k)).collect();
        let seen = |t: f64| (t - 0.31_f64).abs() > 0.05;
        let instants: Vec<Vec<DVec3>> =
            times.iter().map(|&t| if seen(t) { sphere(way(t), 0.1).collect() } else { Vec::new() }).collect();
        let colours = [[200, 60, 30]; 200];
        let clouds: Vec<Cloud<'_>> =
            instants.iter().map(|points| Cloud { points, colours: &colours[..points.len()] }).collect();
        let found: Vec<Vec<Detection>> =
            clouds.iter().map(|cloud| detections(cloud.points, cloud.colours, 0.02)).collect();
        let (tracks, _) = follow(&chains(&found, &times), &found, &clouds, &times, [0.02, 0.0], None);
        assert_eq!(tracks.len(), 1);
        for (instant, &t) in times.iter().enumerate() {
            let off = tracks[0].centres[instant].unwrap().distance(way(t));
            assert!(off < 0.02, "{off} m at {t} s, seen: {}", seen(t));
        }
        let bounces = tracks[0].flights(&times, 0.0, 0.02).bounces();
        assert!(bounces.len() == 1 && (bounces[0].t_s - 0.31).abs() < 0.005, "{bounces:?}");
    }
}
