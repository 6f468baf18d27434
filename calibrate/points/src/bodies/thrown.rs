//! Balls that are seen alone at two instants and no more: thrown and caught between others, and faster than frames follow.
//!
//! Chains need three pieces, since two of anything lie on a line. Two that are discs of one size in all views are a ball all the same. It
//! is there from half an interval before the first to half an interval after the second: before and after that it is in somebody's hands.

use super::{
    centres::{Cloud, Owners, Track, radius_m},
    chains::FASTEST,
    detections::{Detection, Histogram},
    film::Film,
    path::Path,
    round::Ball,
    shades::Shape,
};

/// A piece of which so large a share is of tracks is of them.
const OWNED: f64 = 0.3;
/// The larger of both has at most so many times the points of the smaller.
const SIZE: f64 = 3.0;
/// So many pieces of an instant that are of no track are looked at, the largest.
const MOST_PIECES: usize = 4;

/// Adds the balls among `found` that no track follows to tracks and owners.
pub fn follow(
    film: &Film,
    clouds: &[Cloud<'_>],
    found: &[Vec<Detection>],
    tracks: &mut Vec<Track>,
    owners: &mut Owners,
) {
    let mut balls = pairs(film, clouds, found, owners);
    balls.sort_by(|a, b| a.off.total_cmp(&b.off));
    for Pair { pieces, track, .. } in balls {
        let taken = pieces.iter().any(|(instant, piece)| is_owned(piece, &owners[*instant]));
        if taken {
            continue;
        }
        for (instant, piece) in pieces {
            piece.members.iter().for_each(|&at| owners[instant][at] = Some(tracks.len()));
        }
        tracks.push(track);
    }
}

/// A ball by its pieces at two instants.
struct Pair<'a> {
    pieces: [(usize, &'a Detection); 2],
    track: Track,
    /// How far its discs are off.
    off: f64,
}

fn pairs<'a>(film: &Film, clouds: &[Cloud<'_>], found: &'a [Vec<Detection>], owners: &Owners) -> Vec<Pair<'a>> {
    let free = |instant: usize| {
        found[instant].iter().filter(move |piece| !is_owned(piece, &owners[instant])).take(MOST_PIECES)
    };
    let next = |instant: usize| {
        free(instant).flat_map(move |a| free(instant + 1).map(move |b| [(instant, a), (instant + 1, b)]))
    };
    let pairs = (0..found.len().saturating_sub(1)).flat_map(next);
    pairs.filter_map(|pieces| ball(film, clouds, pieces)).collect()
}

/// Whether a piece is mostly of tracks.
fn is_owned(piece: &Detection, owners: &[Option<usize>]) -> bool {
    let owned = piece.members.iter().filter(|&&at| owners[at].is_some()).count();
    owned as f64 > OWNED * piece.members.len() as f64
}

/// Two pieces as a ball that goes farther than it is wide.
fn ball<'a>(film: &Film, clouds: &[Cloud<'_>], pieces: [(usize, &'a Detection); 2]) -> Option<Pair<'a>> {
    let [a, b] = pieces.map(|(_, piece)| piece);
    let larger = (a.members.len() as f64 / b.members.len() as f64).ln().abs();
    let radii = pieces.map(|(instant, piece)| radius_m(clouds[instant].points, &piece.members, piece.centre));
    let times_s = pieces.map(|(instant, _)| film.moments[instant].t_s);
    let far_m = a.centre.distance(b.centre);
    if larger > SIZE.ln() || far_m < radii[0] + radii[1] || far_m > FASTEST * (times_s[1] - times_s[0]) {
        return None;
    }
    let mut centres = vec![None; clouds.len()];
    let mut sure = vec![false; clouds.len()];
    for (instant, piece) in pieces {
        (centres[instant], sure[instant]) = (Some(piece.centre), true);
    }
    let track = Track {
        centres,
        sure,
        met: Vec::new(),
        radius_m: radii[0].min(radii[1]),
        fall: None,
        colours: Histogram::mean([&a.colours, &b.colours]),
        usual_points: 0.5 * (a.members.len() + b.members.len()) as f64,
    };
    let shape = |(instant, piece): (usize, &Detection)| {
        let Cloud { points, colours } = clouds[instant];
        Shape::new(instant, piece.centre, piece.members.iter().map(|&at| (points[at], colours[at])))
    };
    let path = Path::bouncing(&times_s, &[a.centre, b.centre], &[], 0.0);
    let off = Ball::new(film, &track, &path, &pieces.map(shape))?.off;
    Some(Pair { pieces, track, off })
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::bodies::{
        carve::{Place, tests::film},
        detections::detections,
        turn::directions,
    };

    const RADIUS: f64 = 0.12;

    /// Four instants, at the two in the middle of which a ball is seen alone, with its hull.
    fn thrown(hull: impl Fn(DVec3) -> DVec3, far: f64) -> (Film, Vec<Vec<DVec3>>) {
        let centre = |at: usize| DVec3::new(far * (at as f64 - 1.5), 0.1, 0.0);
        let place = |moment: usize| {
            let (centre, rotation) = (centre(moment), DQuat::IDENTITY);
            Place { moment, centre, rotation, exposed: [(centre, rotation); 2] }
        };
        let mut film = film(RADIUS, &[0, 1, 2, 3].map(place));
        for (at, moment) in film.moments.iter_mut().enumerate() {
            moment.t_s = 0.25 * at as f64;
        }
        let points = |at: usize| -> Vec<DVec3> {
            let all = directions(200).into_iter().map(|along| centre(at) + 1.2 * RADIUS * hull(along));
            if at == 1 || at == 2 { all.collect() } else { Vec::new() }
        };
        (film, [0, 1, 2, 3].map(points).to_vec())
    }

    /// The tracks that are added where the points of some instants are of a track already.
    fn added(film: &Film, points: &[Vec<DVec3>], owned: &[usize]) -> (Vec<Track>, Owners) {
        let colours = vec![[200, 40, 40]; 400];
        let clouds: Vec<Cloud<'_>> =
            points.iter().map(|points| Cloud { points, colours: &colours[..points.len()] }).collect();
        let found: Vec<Vec<Detection>> =
            clouds.iter().map(|cloud| detections(cloud.points, cloud.colours, film.cell_m)).collect();
        let owner = |at: usize| owned.contains(&at).then_some(7);
        let mut owners: Owners = (0..4).map(|at| vec![owner(at); points[at].len()]).collect();
        let mut tracks = Vec::new();
        follow(film, &clouds, &found, &mut tracks, &mut owners);
        (tracks, owners)
    }

    #[test]
    fn a_ball_that_is_seen_twice_is_followed_from_the_one_to_the_other() {
        let (film, points) = thrown(|along| along, 0.6);
        let (tracks, owners) = added(&film, &points, &[]);
        let [track] = &tracks[..] else { panic!("{tracks:?}") };
        assert_eq!(track.instants().collect::<Vec<_>>(), [1, 2]);
        assert!(track.centres[1].is_some_and(|at| at.distance(DVec3::new(-0.3, 0.1, 0.0)) < 0.01));
        assert!(owners.iter().flatten().all(|owner| *owner == Some(0)));
        // What another track has is not it.
        let (tracks, owners) = added(&film, &points, &[2]);
        assert!(tracks.is_empty() && owners[1].iter().all(Option::is_none));
    }

    #[test]
    fn what_is_not_round_or_hardly_moves_is_left() {
        // Its silhouettes are those of a ball somewhere else, of which a part is seen.
        let (mut film, points) = thrown(|along| along, 0.6);
        for view in film.moments.iter_mut().flat_map(|moment| &mut moment.views) {
            view.moving.iter_mut().enumerate().for_each(|(pixel, moves)| *moves &= pixel / 320 % 4 == 0);
        }
        assert!(added(&film, &points, &[]).0.is_empty());
        let (film, points) = thrown(|along| along, 0.2);
        assert!(
            added(&film, &points, &[]).0.is_empty(),
            "a limb that moves by its own width is no ball that is thrown"
        );
        // No time between two instants, as a damaged recording may have it.
        let (mut film, points) = thrown(|along| along, 0.6);
        film.moments.iter_mut().for_each(|moment| moment.t_s = 0.0);
        assert!(added(&film, &points, &[]).0.is_empty());
        assert!(added(&film, &vec![Vec::new(); 4], &[]).0.is_empty());
    }
}
