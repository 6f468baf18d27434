//! Free flight: one acceleration, and a velocity that jumps where the thing bounces.
//!
//! Places at a few instants before and after tell the time of a bounce and both velocities far better than the smooth curve through
//! them, which is a radius away from the thing there; and where a thing is while it is hidden or beside another.

use glam::DVec3;
use nalgebra::DMatrix;

/// Instants are looked at so many at a time, and pieces of them overlap by so many.
const PIECE: usize = 16;
const OVERLAP: usize = 8;
/// So many bounces of a piece at most, and at least so many instants before, between and after.
const MOST: usize = 3;
const INSTANTS_EACH: usize = 3;
/// The same where it is known how things fall: two places tell a flight then, but each two that follow one another nearly tell one.
const MOST_FALLING: usize = 1;
const INSTANTS_EACH_FALLING: usize = 2;
/// So many instants more than numbers for each axis.
const SPARE: usize = 3;
/// Times between two instants that are tried.
const TRIES: usize = 24;
/// A bounce changes the velocity by so much at least, metres per second.
const LEAST_JUMP: f64 = 1.5;
/// Nothing that flies freely accelerates more, metres per second squared.
const MOST_ACCELERATION: f64 = 15.0;
/// Places are right to so many spacings of their points at best, and of what flies they are not farther than so many from its flight.
const RIGHT: f64 = 0.5;
const FLIES: f64 = 1.5;
/// So large a share of the places, and so many, must agree on the flight of what falls as other things do; and so many of those that do
/// not may follow one another, as more of them go another way.
const AGREE: f64 = 0.6;
const FALLING: usize = 4;
const ASTRAY: usize = 1;
/// A flight with bounces must be so much nearer to the places than a smooth curve with more numbers.
const SHARP: f64 = 0.7;
/// A bounce is moved by so many steps of each size at most.
const MOVES: usize = 40;

/// A jump of the velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounce {
    /// When, seconds.
    pub t_s: f64,
    /// Where, metres.
    pub place: DVec3,
    /// The velocities before and after, metres per second.
    pub velocities: [DVec3; 2],
}

/// Where a thing is seen: times in seconds, in order, and the means of its places while the shutter is open.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a> {
    pub times_s: &'a [f64],
    pub places: &'a [DVec3],
    pub exposure_s: f64,
    /// How far points of it are apart, metres.
    pub cell_m: f64,
    /// Spans of time, seconds, within each of which its velocity is known to jump.
    pub jumps_s: &'a [[f64; 2]],
    /// How what flies freely accelerates, where that is known, metres per second squared.
    pub fall: Option<DVec3>,
}

impl<'a> Places<'a> {
    fn instants_each(self) -> usize {
        if self.fall.is_some() { INSTANTS_EACH_FALLING } else { INSTANTS_EACH }
    }

    fn piece(self, from: usize, to: usize) -> Self {
        Self { times_s: &self.times_s[from..to], places: &self.places[from..to], ..self }
    }
}

/// The flight of a thing over a whole take.
#[derive(Clone, Debug, Default)]
pub struct Flights {
    /// Since when each holds, in order, seconds; none where the thing does not fly.
    pieces: Vec<(f64, Option<Flight>)>,
}

impl Flights {
    /// Of a thing that is seen at places.
    pub fn new(seen: Places<'_>) -> Self {
        let count = seen.times_s.len().min(seen.places.len());
        let mut flights = Self::default();
        let mut from = 0;
        while from < count {
            let to = (from + PIECE).min(count);
            // Of two pieces that overlap each tells half of it.
            let since = if from == 0 { f64::NEG_INFINITY } else { seen.times_s[from + OVERLAP / 2] };
            flights.pieces.push((since, Flight::fitted(seen.piece(from, to))));
            if to == count {
                break;
            }
            from = to - OVERLAP;
        }
        flights
    }

    /// Where the thing is at a time; none where it does not fly.
    pub fn at(&self, t_s: f64) -> Option<DVec3> {
        let next = self.pieces.partition_point(|piece| piece.0 <= t_s);
        self.pieces.get(next.checked_sub(1)?)?.1.as_ref().map(|flight| flight.at(t_s))
    }

    /// Its acceleration, metres per second squared; none of what does not fly for a piece of the time.
    pub fn fall(&self) -> Option<DVec3> {
        let falls: Option<Vec<DVec3>> = self.pieces.iter().map(|piece| Some(piece.1.as_ref()?.terms[2])).collect();
        let falls = falls?;
        (!falls.is_empty()).then(|| falls.iter().sum::<DVec3>() / falls.len() as f64)
    }

    /// Its bounces, in order.
    pub fn bounces(&self) -> Vec<Bounce> {
        let until = self.pieces.iter().skip(1).map(|piece| piece.0).chain([f64::INFINITY]);
        let of = |(piece, until): (&(f64, Option<Flight>), f64)| {
            let bounces = piece.1.as_ref().map(Flight::bounces).unwrap_or_default();
            let since = piece.0;
            bounces.into_iter().filter(move |bounce| bounce.t_s >= since && bounce.t_s < until)
        };
        std::iter::zip(&self.pieces, until).flat_map(of).collect()
    }
}

/// A free flight with jumps of the velocity.
#[derive(Clone, Debug)]
struct Flight {
    /// When time counts from, seconds.
    from_s: f64,
    /// When the velocity jumps, in order, seconds.
    breaks_s: Vec<f64>,
    /// Place and velocity at `from_s`, acceleration, and the jumps.
    terms: Vec<DVec3>,
    /// The root of the mean square of how far places are apart from it, metres.
    apart_m: f64,
}

impl Flight {
    /// By its own acceleration, or else by the one that is known.
    fn fitted(seen: Places<'_>) -> Option<Self> {
        let bouncing = || seen.fall.and_then(|_| Self::of(seen)).filter(|flight| !flight.breaks_s.is_empty());
        Self::of(Places { fall: None, ..seen }).or_else(bouncing).or_else(|| Self::falling(seen))
    }

    /// The flight of a thing, with as many bounces as its places tell; none of what does not fly.
    fn of(seen: Places<'_>) -> Option<Self> {
        let most = (seen.times_s.len() / seen.instants_each()).saturating_sub(1);
        let most = most.min(if seen.fall.is_some() { MOST_FALLING } else { MOST });
        let mut flight = Self::with_jumps(seen)?;
        let (mut best, known) = (flight.clone(), flight.breaks_s.len());
        for _ in known..most {
            let Some(next) = flight.with_one_more(seen) else { break };
            if next.price(seen) < best.price(seen) {
                best = next.clone();
            }
            flight = next;
        }
        let jumps = best.terms.iter().skip(3).all(|jump| jump.length() > LEAST_JUMP);
        let falls = best.terms[2].length() < MOST_ACCELERATION;
        let smooth_m = if best.breaks_s.len() == known { f64::INFINITY } else { smooth_m(seen, best.terms.len() + 1) };
        (jumps && falls && best.apart_m < (FLIES * seen.cell_m).min(SHARP * smooth_m)).then_some(best)
    }

    /// The flight without bounces of what accelerates as is known, by most of the places; none where they do not agree on one, or lie
    /// nearer to a straight way.
    fn falling(seen: Places<'_>) -> Option<Self> {
        let fall = seen.fall.filter(|_| seen.jumps_s.is_empty())?;
        let from_s = *seen.times_s.first()?;
        let count = seen.times_s.len().min(seen.places.len());
        let fewest = FALLING.max((AGREE * count as f64).ceil() as usize);
        let mut kept = vec![true; count];
        let agree = |kept: &[bool]| {
            let astray = kept.split(|kept| *kept).map(<[bool]>::len).max();
            kept.iter().filter(|kept| **kept).count() >= fewest && astray <= Some(ASTRAY)
        };
        while agree(&kept) {
            let those: Vec<usize> = (0..count).filter(|&at| kept[at]).collect();
            let (times_s, places): (Vec<f64>, Vec<DVec3>) =
                those.iter().map(|&at| (seen.times_s[at], seen.places[at])).unzip();
            let nearest = |fall: DVec3| {
                let seen = Places { times_s: &times_s, places: &places, fall: Some(fall), ..seen };
                Self::nearest(seen, from_s, Vec::new())
            };
            let flight = nearest(fall)?;
            if flight.apart_m < FLIES * seen.cell_m {
                let straight_m = nearest(DVec3::ZERO)?.apart_m;
                return (flight.apart_m < straight_m).then_some(flight);
            }
            let away = |at: usize| flight.at(seen.times_s[at]).distance(seen.places[at]);
            kept[those.into_iter().max_by(|&a, &b| away(a).total_cmp(&away(b)))?] = false;
        }
        None
    }

    /// The flight with jumps at given times that is nearest to the places; none where they do not tell it.
    fn with(seen: Places<'_>, mut breaks_s: Vec<f64>) -> Option<Self> {
        breaks_s.sort_by(f64::total_cmp);
        let from_s = *seen.times_s.first()?;
        let count = seen.times_s.len();
        let free = if seen.fall.is_some() { 2 } else { 3 } + breaks_s.len();
        // Each stretch needs places of its own.
        let ends: Vec<usize> = breaks_s.iter().map(|at| seen.times_s.partition_point(|time| time < at)).collect();
        let ends: Vec<usize> = [0].into_iter().chain(ends).chain([count]).collect();
        if count < free + SPARE || ends.windows(2).any(|pair| pair[1] - pair[0] < seen.instants_each()) {
            return None;
        }
        Self::nearest(seen, from_s, breaks_s)
    }

    /// The flight with jumps at given times that is nearest to the places, however few they are; none where they do not determine it.
    fn nearest(seen: Places<'_>, from_s: f64, breaks_s: Vec<f64>) -> Option<Self> {
        let mut flight = Self { from_s, breaks_s, terms: Vec::new(), apart_m: 0.0 };
        let mut rows: Vec<Vec<f64>> = seen.times_s.iter().map(|&time| flight.basis(time, seen.exposure_s)).collect();
        (flight.terms, flight.apart_m) = match seen.fall {
            Some(fall) => {
                let fallen: Vec<f64> = rows.iter_mut().map(|row| row.remove(2)).collect();
                let bare = std::iter::zip(seen.places, fallen).map(|(&place, fallen)| place - fallen * fall);
                let (mut terms, apart_m) = fitted(&rows, &bare.collect::<Vec<_>>())?;
                terms.insert(2, fall);
                (terms, apart_m)
            }
            None => fitted(&rows, seen.places)?,
        };
        flight.apart_m.is_finite().then_some(flight)
    }

    /// The nearest flight whose velocity jumps where it is known to.
    fn with_jumps(seen: Places<'_>) -> Option<Self> {
        let inside = |span: &&[f64; 2]| seen.times_s.first() <= Some(&span[0]) && Some(&span[1]) <= seen.times_s.last();
        let mut spans: Vec<[f64; 2]> = seen.jumps_s.iter().filter(inside).copied().collect();
        spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let within = |[from, to]: [f64; 2], step: usize| from + (step as f64 + 0.5) / TRIES as f64 * (to - from);
        let mut best = Self::with(seen, spans.iter().map(|&span| within(span, TRIES / 2)).collect())?;
        for (index, &span) in spans.iter().enumerate() {
            let moved = |step: usize| {
                let mut breaks_s = best.breaks_s.clone();
                breaks_s[index] = within(span, step);
                Self::with(seen, breaks_s)
            };
            let nearest = (0..TRIES).filter_map(moved).min_by(|a, b| a.apart_m.total_cmp(&b.apart_m));
            best = nearest.unwrap_or(best);
        }
        Some(best)
    }

    /// With the jump more that brings it nearest, all jumps moved where they are best then.
    fn with_one_more(&self, seen: Places<'_>) -> Option<Self> {
        let nearest = |all: Vec<Self>| all.into_iter().min_by(|a, b| a.apart_m.total_cmp(&b.apart_m));
        let with = |time: f64| {
            let mut breaks_s = self.breaks_s.clone();
            breaks_s.push(time);
            Self::with(seen, breaks_s)
        };
        let grid = seen.times_s.windows(2).flat_map(|pair| {
            (0..TRIES).map(move |step| pair[0] + (step as f64 + 0.5) / TRIES as f64 * (pair[1] - pair[0]))
        });
        let mut best = nearest(grid.filter_map(with).collect())?;
        let finest_s = (seen.times_s.last()? - seen.times_s.first()?) / (seen.times_s.len() * TRIES) as f64;
        for step_s in [16.0, 4.0, 1.0].map(|steps| steps * finest_s) {
            for _ in 0..MOVES {
                let moved = |(index, side): (usize, f64)| {
                    let mut breaks_s = best.breaks_s.clone();
                    breaks_s[index] += side * step_s;
                    Self::with(seen, breaks_s)
                };
                let tries = (0..best.breaks_s.len()).flat_map(|index| [-1.0, 1.0].map(|side| (index, side)));
                match nearest(tries.filter_map(moved).collect()) {
                    Some(next) if next.apart_m < best.apart_m => best = next,
                    _ => break,
                }
            }
        }
        Some(best)
    }

    /// What its terms are multiplied by for the mean place around a time.
    fn basis(&self, t_s: f64, exposure_s: f64) -> Vec<f64> {
        let after_s = t_s - self.from_s;
        let jumps = self.breaks_s.iter().map(|at| mean_after(t_s - at, exposure_s));
        [1.0, after_s, 0.5 * after_s * after_s].into_iter().chain(jumps).collect()
    }

    fn at(&self, t_s: f64) -> DVec3 {
        sum(&self.basis(t_s, 0.0), &self.terms)
    }

    fn bounces(&self) -> Vec<Bounce> {
        let bounce = |(index, &t_s): (usize, &f64)| {
            let falling = self.terms[1] + (t_s - self.from_s) * self.terms[2];
            let before = falling + self.terms[3..3 + index].iter().sum::<DVec3>();
            Bounce { t_s, place: self.at(t_s), velocities: [before, before + self.terms[3 + index]] }
        };
        self.breaks_s.iter().enumerate().map(bounce).collect()
    }

    /// What it costs to tell the places by it: the Bayesian information criterion.
    fn price(&self, seen: Places<'_>) -> f64 {
        let values = 3.0 * seen.times_s.len() as f64;
        let free_terms = self.terms.len() - usize::from(seen.fall.is_some());
        let numbers = (3 * free_terms + self.breaks_s.len()) as f64;
        values * self.apart_m.max(RIGHT * seen.cell_m).powi(2).ln() + numbers * values.ln()
    }
}

/// How far a thing is apart from the nearest flight that jumps where it is known to, and nowhere else: the root of the mean square,
/// metres; none where its places do not tell it.
pub fn apart_m(seen: Places<'_>) -> Option<f64> {
    Flight::with_jumps(seen).map(|flight| flight.apart_m)
}

/// The terms by which rows of numbers come nearest to places, and how far apart these are then: the root of the mean square, metres.
pub fn fitted(rows: &[Vec<f64>], places: &[DVec3]) -> Option<(Vec<DVec3>, f64)> {
    let (count, terms) = (rows.len(), rows.first()?.len());
    let design = DMatrix::from_row_iterator(count, terms, rows.iter().flatten().copied());
    let right = DMatrix::from_row_iterator(count, 3, places.iter().flat_map(|place| place.to_array()));
    let across = design.transpose();
    let solved = (&across * design).cholesky()?.solve(&(across * right));
    let terms: Vec<DVec3> = solved.row_iter().map(|row| DVec3::new(row[0], row[1], row[2])).collect();
    let apart = |(row, place): (&Vec<f64>, &DVec3)| sum(row, &terms).distance_squared(*place);
    let apart_m = (std::iter::zip(rows, places).map(apart).sum::<f64>() / count as f64).sqrt();
    Some((terms, apart_m))
}

/// The sum of terms, each multiplied by its value of a row.
pub fn sum(row: &[f64], terms: &[DVec3]) -> DVec3 {
    std::iter::zip(row, terms).map(|(value, term)| *value * *term).sum()
}

/// How far places are apart from the nearest smooth curve of so many terms, a cubic spline with even knots, metres.
fn smooth_m(seen: Places<'_>, terms: usize) -> f64 {
    let (Some(&first), Some(&last)) = (seen.times_s.first(), seen.times_s.last()) else { return 0.0 };
    let knots = terms.saturating_sub(4);
    let row = |time: &f64| -> Vec<f64> {
        // From -1 to 1, so that powers are told apart well.
        let at = 2.0 * (time - first) / (last - first).max(1e-9) - 1.0;
        let after = (1..=knots).map(|knot| (at - (2.0 * knot as f64 / (knots + 1) as f64 - 1.0)).max(0.0).powi(3));
        [1.0, at, at * at, at.powi(3)].into_iter().chain(after).collect()
    };
    let rows: Vec<Vec<f64>> = seen.times_s.iter().map(row).collect();
    fitted(&rows, seen.places).map_or(0.0, |(_, apart_m)| apart_m)
}

/// The mean of the time since a jump, 0 before it, over an exposure whose middle is so long after the jump.
fn mean_after(after_s: f64, exposure_s: f64) -> f64 {
    let half = 0.5 * exposure_s;
    if after_s.abs() >= half { after_s.max(0.0) } else { (after_s + half).powi(2) / (2.0 * exposure_s) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use erfgs_base::random;

    const CELL_M: f64 = 0.018;
    const GRAVITY: DVec3 = DVec3::new(0.0, 9.81, 0.0);

    fn noise(key: u64, size: f64) -> DVec3 {
        let normal = |axis: u64| random::normal(random::key(key, &[axis]));
        size * DVec3::new(normal(0), normal(1), normal(2))
    }

    fn found(times_s: &[f64], place: impl Fn(f64) -> DVec3) -> Vec<Bounce> {
        let places: Vec<DVec3> =
            times_s.iter().enumerate().map(|(at, &time)| place(time) + noise(at as u64, 0.006)).collect();
        Flights::new(Places { times_s, places: &places, exposure_s: 0.0, cell_m: CELL_M, jumps_s: &[], fall: None })
            .bounces()
    }

    fn fifteen_hertz(count: usize) -> Vec<f64> {
        (0..count).map(|at| 0.01 + at as f64 / 15.0).collect()
    }

    /// A fall that ends at `t_s` in a bounce.
    fn bouncing(t_s: f64, velocities: [DVec3; 2]) -> impl Fn(f64) -> DVec3 {
        move |time| {
            let after = time - t_s;
            velocities[usize::from(after > 0.0)] * after + 0.5 * GRAVITY * after * after
        }
    }

    #[test]
    fn a_bounce_is_found_to_a_few_milliseconds_and_a_throw_has_none() {
        let velocities = [DVec3::new(-1.8, 2.9, -0.1), DVec3::new(-1.5, -2.8, 0.2)];
        for step in 0..8 {
            let t_s = 0.22 + 0.013 * f64::from(step);
            let found = found(&fifteen_hertz(9), bouncing(t_s, velocities));
            assert_eq!(found.len(), 1, "{t_s} s: {found:?}");
            assert!((found[0].t_s - t_s).abs() < 0.006, "{} at {t_s} s", found[0].t_s);
            assert!(found[0].place.length() < 0.04);
            for (found, truth) in std::iter::zip(found[0].velocities, velocities) {
                assert!(found.distance(truth) < 0.4, "{found} and {truth} at {t_s} s");
            }
        }
        assert_eq!(found(&fifteen_hertz(9), |time| DVec3::new(3.0 * time, 0.0, 1.0) + 0.5 * GRAVITY * time * time), []);
    }

    #[test]
    fn what_swings_turns_or_walks_has_none() {
        let pendulum = |time: f64| {
            let angle = 0.9 * (4.5 * time).cos();
            0.5 * DVec3::new(angle.sin(), angle.cos(), 0.0)
        };
        assert_eq!(found(&fifteen_hertz(9), pendulum), []);
        assert_eq!(found(&fifteen_hertz(60), pendulum), []);
        let round = |time: f64| 0.4 * DVec3::new((7.0 * time).cos(), 0.0, (7.0 * time).sin());
        assert_eq!(found(&fifteen_hertz(30), round), []);
        assert_eq!(found(&fifteen_hertz(2), round), []);
        assert_eq!(found(&[], round), []);
    }

    #[test]
    fn each_bounce_of_a_long_take_is_found_once() {
        // A ball that keeps its height: it bounces every 0.8 s.
        let place = |time: f64| {
            let after = (time / 0.8).fract() * 0.8;
            DVec3::new(0.5 * time, -3.924 * after + 4.905 * after * after, 0.0)
        };
        let found = found(&fifteen_hertz(150), place);
        let truth: Vec<f64> = (1..13).map(|bounce| 0.8 * f64::from(bounce)).filter(|time| *time < 9.8).collect();
        assert_eq!(found.len(), truth.len(), "{found:?}");
        for (bounce, truth) in std::iter::zip(found, truth) {
            assert!((bounce.t_s - truth).abs() < 0.01, "{} instead of {truth} s", bounce.t_s);
        }
    }

    #[test]
    fn what_falls_as_other_things_do_is_told_by_few_places_of_which_some_are_wrong() {
        let times_s = fifteen_hertz(7);
        let way = |time: f64| DVec3::new(0.4 * time, -3.0 * time, 0.1) + 0.5 * time * time * GRAVITY;
        let mut places: Vec<DVec3> =
            times_s.iter().enumerate().map(|(at, &time)| way(time) + noise(at as u64, 0.006)).collect();
        // A neighbour's hull is taken for a part of it at both ends.
        places[0].x += 0.3;
        places[6].y -= 0.2;
        let of = |places: &[DVec3], fall| {
            Flights::new(Places { times_s: &times_s, places, exposure_s: 0.0, cell_m: CELL_M, jumps_s: &[], fall })
        };
        assert_eq!(of(&places, None).at(0.5), None);
        let falls = of(&places, Some(GRAVITY));
        for time in [0.01, 0.2, 0.5] {
            let there = falls.at(time).expect("a flight");
            assert!(there.distance(way(time)) < 0.03, "{there} at {time}");
        }
        assert_eq!(falls.fall(), Some(GRAVITY));
        // What goes straight on, or on its own curve, does not fall.
        let straight: Vec<DVec3> = times_s[..4].iter().map(|&time| DVec3::X * time).collect();
        assert_eq!(of(&straight, Some(GRAVITY)).at(0.1), None);
        let swings: Vec<DVec3> = times_s.iter().map(|&time| DVec3::X * 0.4 * (9.0 * time).sin()).collect();
        assert_eq!(of(&swings, Some(GRAVITY)).at(0.1), None);
    }

    #[test]
    fn what_falls_as_other_things_do_bounces_two_instants_before_the_end() {
        let times_s = fifteen_hertz(9);
        for t_s in [0.43, 0.45, 0.47] {
            let way = bouncing(t_s, [DVec3::new(1.2, 3.5, 0.3), DVec3::new(1.0, -3.0, 0.3)]);
            let places: Vec<DVec3> =
                times_s.iter().enumerate().map(|(at, &time)| way(time) + noise(at as u64, 0.003)).collect();
            let seen = Places {
                times_s: &times_s,
                places: &places,
                exposure_s: 0.0,
                cell_m: CELL_M,
                jumps_s: &[],
                fall: None,
            };
            assert_eq!(Flights::new(seen).bounces(), [], "its own places do not tell it");
            let falls = Flights::new(Places { fall: Some(GRAVITY), ..seen });
            let bounces = falls.bounces();
            assert_eq!(bounces.len(), 1, "{t_s} s: {bounces:?}");
            assert!((bounces[0].t_s - t_s).abs() < 0.008, "{} at {t_s} s", bounces[0].t_s);
            for &time in &times_s {
                let off = falls.at(time).expect("a flight").distance(way(time));
                assert!(off < 0.02, "{off} m at {time} s");
            }
        }
    }

    #[test]
    fn places_that_follow_one_another_and_lie_beside_a_fall_are_no_mistakes() {
        // Something else carries it on from the fifth instant.
        let times_s = fifteen_hertz(8);
        let way = |time: f64| DVec3::new(0.4 * time, -3.0 * time, 0.1) + 0.5 * time * time * GRAVITY;
        let mut places: Vec<DVec3> = times_s.iter().map(|&time| way(time)).collect();
        places[6].x += 0.3;
        let flies = |places: &[DVec3]| {
            let fall = Some(GRAVITY);
            Flights::new(Places { times_s: &times_s, places, exposure_s: 0.0, cell_m: CELL_M, jumps_s: &[], fall })
                .at(0.1)
                .is_some()
        };
        assert!(flies(&places));
        places[5].x += 0.2;
        places[7].x -= 0.4;
        assert!(!flies(&places));
    }
}
