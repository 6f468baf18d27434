//! Samples that lie together: connected pixels, and the centre of what they hold.

use std::collections::HashMap;

use glam::DVec2;

use super::Light;

/// Something at a pixel: an event (weight 1) at a time, or a brightness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    pub x: u16,
    pub y: u16,
    pub weight: f64,
    /// Time from the instant that the place is asked for, in any unit; 0 where there is none.
    pub t: f64,
}

/// Groups of samples whose pixels lie no farther than `reach` from another of the group, in x and y, of at least `pixels`
/// pixels; the strongest first.
pub(super) fn spots(samples: &[Sample], reach: u16, pixels: usize) -> Vec<Light> {
    let mut by_pixel: HashMap<(u16, u16), Vec<usize>> = HashMap::new();
    for (index, sample) in samples.iter().enumerate() {
        by_pixel.entry((sample.x, sample.y)).or_default().push(index);
    }
    // In order of place: the result must not depend on how a table hashes.
    let mut places: Vec<(u16, u16)> = by_pixel.keys().copied().collect();
    places.sort_unstable();
    let mut lights = Vec::new();
    for place in places {
        let Some(first) = by_pixel.remove(&place) else { continue };
        let (mut members, mut open, mut count) = (first, vec![place], 1);
        while let Some((x, y)) = open.pop() {
            for nx in x.saturating_sub(reach)..=x.saturating_add(reach) {
                for ny in y.saturating_sub(reach)..=y.saturating_add(reach) {
                    if let Some(more) = by_pixel.remove(&(nx, ny)) {
                        members.extend(more);
                        open.push((nx, ny));
                        count += 1;
                    }
                }
            }
        }
        if count >= pixels {
            members.sort_unstable();
            lights.extend(centre(members.iter().map(|index| &samples[*index])));
        }
    }
    lights.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    lights
}

/// The weighed mean place at time 0: a line through place over time where the samples' times tell one.
fn centre<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> Option<Light> {
    let place = |sample: &Sample| DVec2::new(f64::from(sample.x) + 0.5, f64::from(sample.y) + 0.5);
    let weight: f64 = samples.clone().map(|sample| sample.weight).sum();
    if weight <= 0.0 {
        return None;
    }
    let mean = samples.clone().map(|sample| place(sample) * sample.weight).sum::<DVec2>() / weight;
    let at = samples.clone().map(|sample| sample.t * sample.weight).sum::<f64>() / weight;
    let spread = samples.clone().map(|sample| (sample.t - at).powi(2) * sample.weight).sum::<f64>();
    let along: DVec2 = samples.map(|sample| (place(sample) - mean) * ((sample.t - at) * sample.weight)).sum();
    let velocity = if spread > 0.0 { along / spread } else { DVec2::ZERO };
    Some(Light { pixel: mean - velocity * at, weight })
}
