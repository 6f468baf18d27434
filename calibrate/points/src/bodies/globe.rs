//! The colours of a ball at an instant in all directions.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::{
    film::{Film, MOST_APART},
    light::Light,
    shades::{Compared, Shades},
    turn::directions,
};

/// Rows from pole to pole, and as many columns for each half turn.
const ROWS: usize = 48;
/// A place that a camera sees more aslant has no colour in it.
const FACING: f64 = 0.3;

/// A ball's colours are compared in so many directions.
const DIRECTIONS: usize = 300;
/// With fewer instants a ball's colours are not compared.
const FEWEST: usize = 3;
/// Each is compared with so many later ones at most.
const MOST_SPANS: usize = 12;
/// So many pairs of instants as far from one another are compared at most.
const MOST_PAIRS: usize = 40;

/// Colours by direction, as a map of equal angles.
#[derive(Clone, Debug)]
pub struct Globe {
    seen: Vec<Facet>,
}

/// What views see of a direction.
#[derive(Clone, Copy, Debug, Default)]
struct Facet {
    /// The mean colour.
    colour: [f32; 3],
    /// How many views face it, and how much; 0 where it is not seen.
    weight: f32,
}

impl Facet {
    fn brightness(&self) -> f32 {
        self.colour.iter().sum()
    }

    /// How far both colours are apart, summed over channels, and how much that counts.
    fn apart(&self, other: &Self) -> (f64, f64) {
        let apart: f32 = std::iter::zip(self.colour, other.colour).map(|(a, b)| (a - b).abs()).sum();
        (f64::from(apart).min(MOST_APART), f64::from(self.weight.min(other.weight)))
    }
}

impl Globe {
    /// Of a ball at an instant.
    pub fn new(film: &Film, moment: usize, centre: DVec3, radius_m: f64) -> Self {
        let seen =
            (0..2 * ROWS * ROWS).into_par_iter().map(|index| seen(film, moment, centre, radius_m * along(index)));
        Self { seen: seen.collect() }
    }

    /// The colour in a direction of length 1, where it is seen.
    pub fn colour(&self, along: DVec3) -> Option<[u8; 3]> {
        let Facet { colour, weight } = self.at(along);
        (*weight > 0.0).then(|| colour.map(|value| value.round() as u8))
    }

    /// What is seen in a direction of length 1.
    fn at(&self, along: DVec3) -> &Facet {
        &self.seen[index(along)]
    }
}

/// The colours of a ball at instants, each compared with some of those that follow.
#[derive(Debug)]
pub struct Globes<'a> {
    /// Times in seconds, in order, and what is seen.
    globes: &'a [(f64, Globe)],
    /// How many instants later what is compared is.
    spans: Vec<usize>,
    directions: Vec<DVec3>,
}

impl<'a> Globes<'a> {
    /// Each instant with the next; then with those up to two later, up to four, and so on: rates that are a little wrong add up, which
    /// tells them apart, once they are so nearly right that what is compared is the same place.
    pub fn longer_and_longer(globes: &'a [(f64, Globe)]) -> Vec<Self> {
        if globes.len() < FEWEST {
            return Vec::new();
        }
        let until = |last: usize| (1..=last).step_by(last.div_ceil(MOST_SPANS)).collect();
        let all = |last: usize| Self { globes, spans: until(last), directions: directions(DIRECTIONS) };
        let powers = std::iter::successors(Some(1), |span| Some(2 * span)).take_while(|&span| span < globes.len() - 1);
        powers.chain([globes.len() - 1]).map(all).collect()
    }

    /// Those of several lengths, and what is compared of a thing that is no ball, as one list.
    pub fn with<'b>(globes: &'b [Self], shades: Option<&'b Shades<'_>>) -> Vec<&'b dyn Compared> {
        let shades = shades.into_iter().map(|shades| shades as &dyn Compared);
        shades.chain(globes.iter().map(|globes| globes as &dyn Compared)).collect()
    }

    fn apart_at(&self, rate: DVec3) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for &span in &self.spans {
            let all = std::iter::zip(self.globes, &self.globes[span..]);
            for ((from_s, from), (to_s, to)) in all.step_by(self.globes.len().div_ceil(MOST_PAIRS)) {
                let turn = DMat3::from_quat(DQuat::from_scaled_axis(rate * (to_s - from_s)));
                for &along in &self.directions {
                    let (apart, weight) = from.at(along).apart(to.at(turn * along));
                    sum += weight * apart;
                    weights += weight;
                }
            }
        }
        if weights > 0.0 { sum / weights } else { MOST_APART }
    }
}

impl Compared for Globes<'_> {
    fn apart(&self, rates: &[DVec3]) -> Vec<f64> {
        rates.par_iter().map(|&rate| self.apart_at(rate)).collect()
    }
}

/// Takes away what light from one side does.
pub fn without_light(globes: &mut [(f64, Globe)]) {
    let seen = globes.iter().flat_map(|(_, globe)| globe.seen.iter().enumerate());
    let lit = seen.filter(|(_, seen)| seen.weight > 0.0);
    let lit = lit.map(|(index, seen)| (along(index), f64::from(seen.brightness()), f64::from(seen.weight)));
    let Some(light) = Light::new(lit) else { return };
    for (_, globe) in globes {
        for (index, seen) in globe.seen.iter_mut().enumerate() {
            let share = light.away(along(index)) as f32;
            seen.colour = seen.colour.map(|value| value * share);
        }
    }
}

fn seen(film: &Film, moment: usize, centre: DVec3, place: DVec3) -> Facet {
    let mut seen = Facet::default();
    for view in &film.moments[moment].views {
        let eye = &film.eyes[view.eye];
        let facing = (eye.centre - centre - place).normalize_or_zero().dot(place.normalize_or_zero());
        let Some(pixel) = eye.pixel(centre + place).filter(|&pixel| facing > FACING && view.moving[pixel]) else {
            continue;
        };
        let facing = facing as f32;
        seen.weight += facing;
        for (sum, value) in std::iter::zip(&mut seen.colour, view.soft_colour(pixel)) {
            *sum += facing * f32::from(value);
        }
    }
    seen.colour = seen.colour.map(|sum| sum / seen.weight.max(f32::MIN_POSITIVE));
    seen
}

/// The middle of a cell.
fn along(index: usize) -> DVec3 {
    let step = std::f64::consts::PI / ROWS as f64;
    let [up, around] = [index / (2 * ROWS), index % (2 * ROWS)].map(|at| (at as f64 + 0.5) * step);
    DVec3::new(up.sin() * around.cos(), up.cos(), up.sin() * around.sin())
}

fn index(along: DVec3) -> usize {
    let step = std::f64::consts::PI / ROWS as f64;
    let around = along.z.atan2(along.x).rem_euclid(std::f64::consts::TAU);
    let [up, around] = [along.y.clamp(-1.0, 1.0).acos(), around].map(|angle| (angle / step) as usize);
    up.min(ROWS - 1) * 2 * ROWS + around.min(2 * ROWS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_cell_holds_its_own_middle() {
        for cell in 0..2 * ROWS * ROWS {
            assert_eq!(index(along(cell)), cell);
        }
        for pole in [DVec3::Y, DVec3::NEG_Y] {
            assert!(index(pole) < 2 * ROWS * ROWS);
        }
    }

    /// Globes of a ball with spots that turns, lit from one side, seen from the other hemisphere not at all.
    fn globes(rate: DVec3, light: f64) -> Vec<(f64, Globe)> {
        let globe = |at: usize| {
            let t_s = 0.05 * at as f64;
            let seen = |index: usize| {
                let normal = along(index);
                let own = DQuat::from_scaled_axis(-rate * t_s) * normal;
                let spots = 100.0 + 60.0 * (5.0 * own.x).sin() * (4.0 * own.y + own.z).cos();
                let bright = spots * (1.0 + light * normal.x);
                let weight = if normal.z > 0.0 { normal.z as f32 } else { 0.0 };
                Facet { colour: [bright as f32, 0.5 * bright as f32, 20.0], weight }
            };
            (t_s, Globe { seen: (0..2 * ROWS * ROWS).map(seen).collect() })
        };
        (0..9).map(globe).collect()
    }

    #[test]
    fn colours_are_nearest_at_the_rate_at_which_a_ball_turns_and_far_instants_tell_it_best() {
        let rate = DVec3::new(1.0, -3.0, 9.0);
        let globes = globes(rate, 0.0);
        let all = Globes::longer_and_longer(&globes);
        assert_eq!(all.iter().map(|all| all.spans.len()).collect::<Vec<_>>(), [1, 2, 4, 8]);
        let gained = |all: &Globes<'_>| {
            let apart = all.apart(&[rate, 0.9 * rate, DVec3::ZERO]);
            assert!(apart[0] < apart[1] && apart[1] < apart[2], "{apart:?}");
            apart[1] / apart[0]
        };
        assert!(gained(&all[3]) > 1.5 * gained(&all[0]));
        assert!(Globes::longer_and_longer(&globes[..2]).is_empty() && Globes::longer_and_longer(&[]).is_empty());
    }

    #[test]
    fn light_from_one_side_does_not_make_a_ball_seem_to_stand_still() {
        let rate = DVec3::new(1.0, -3.0, 9.0);
        let (mut lit, even) = (globes(rate, 0.5), globes(rate, 0.0));
        let apart = |globes: &[(f64, Globe)]| {
            let apart = Globes::longer_and_longer(globes)[0].apart(&[rate, DVec3::ZERO]);
            apart[0] / apart[1]
        };
        let (before, wanted) = (apart(&lit), apart(&even));
        without_light(&mut lit);
        let after = apart(&lit);
        assert!(before > 2.0 * wanted && after < 0.55 * before, "{before} {after} {wanted}");
        // Of what is not seen at all there is no light.
        let mut unseen = vec![(0.0, Globe { seen: vec![Facet::default(); 2 * ROWS * ROWS] })];
        without_light(&mut unseen);
        assert!(unseen[0].1.seen.iter().all(|seen| seen.colour == [0.0; 3]));
    }
}
