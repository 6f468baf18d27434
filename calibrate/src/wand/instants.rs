//! Which sightings of different cameras belong together, and where each LED was at that instant.
//!
//! Cameras on one trigger have equal stamps. Where they run free, a camera's LEDs are interpolated to the instant between
//! its neighbouring images (cubic, by the velocities there). The velocity is kept: it ties a camera's time offset to what
//! it saw.

use glam::DVec2;
use nalgebra::DMatrix;

use super::{Sighting, Stick, WandCamera, view};

/// Stamps this near are equal.
const SAME_NS: i64 = 50_000;
/// A velocity is that of so much time before and after; nobody waves a wand faster.
const SMOOTHED_NS: i64 = 30_000_000;

/// How sightings are matched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matching {
    /// A sighting this near to an instant stands for it, moved there by its velocity.
    pub tolerance_ns: i64,
    /// A camera's neighbouring images this near to each other may be interpolated between.
    pub gap_ns: i64,
    /// Images this near to each other tell a velocity.
    pub velocity_gap_ns: i64,
}

impl Default for Matching {
    fn default() -> Self {
        Self { tolerance_ns: 2_000_000, gap_ns: 40_000_000, velocity_gap_ns: 120_000_000 }
    }
}

/// A LED at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Led {
    /// Where, pixels.
    pub pixel: DVec2,
    /// How fast, pixels per second.
    pub velocity: DVec2,
    /// What interpolation may be wrong by, pixels.
    pub extra_px: f64,
}

/// The wand in one camera at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WandView {
    pub camera: usize,
    pub leds: [Option<Led>; 3],
    /// The wand from this view alone, where all LEDs make one.
    pub lone: Option<view::Lone>,
}

/// All that was seen at one instant.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Instant {
    pub t_ns: i64,
    pub views: Vec<WandView>,
}

/// The instants at which two cameras or more saw the wand, in order.
pub(super) fn instants(cameras: &[WandCamera], stick: &Stick, matching: &Matching) -> Vec<Instant> {
    let tracks: Vec<Vec<Sighting>> = cameras.iter().map(|camera| track(camera, stick)).collect();
    let mut order: Vec<usize> = (0..tracks.len()).collect();
    order.sort_by_key(|&camera| std::cmp::Reverse(tracks[camera].len()));
    let mut times: Vec<i64> = Vec::new();
    for camera in order {
        let reach = matching.tolerance_ns.max(matching.gap_ns);
        let new: Vec<i64> = tracks[camera].iter().map(|s| s.t_ns).filter(|t| !is_near(&times, *t, reach)).collect();
        times.extend(new);
        times.sort_unstable();
    }
    let at = |t_ns: i64| {
        let views = tracks.iter().enumerate().filter_map(|(camera, track)| {
            let leds = leds_at(track, t_ns, matching)?;
            let pixels = match leds {
                [Some(a), Some(b), Some(c)] => Some([a.pixel, b.pixel, c.pixel]),
                _ => None,
            };
            let lone = pixels.and_then(|pixels| view::Lone::new(stick, &cameras[camera].intrinsics, pixels));
            Some(WandView { camera, leds, lone })
        });
        Instant { t_ns, views: views.collect() }
    };
    times.into_iter().map(at).filter(|instant| instant.views.len() >= 2).collect()
}

/// A camera's sightings in order of time, labelled, without those that see nothing.
fn track(camera: &WandCamera, stick: &Stick) -> Vec<Sighting> {
    let mut track: Vec<Sighting> = camera
        .sightings
        .iter()
        .filter(|sighting| sighting.leds.iter().any(Option::is_some))
        .map(|sighting| match sighting.leds {
            [Some(a), Some(b), Some(c)] => {
                let leds = view::label(stick, &camera.intrinsics, [a, b, c]).map(Some);
                Sighting { leds, ..*sighting }
            }
            _ => *sighting,
        })
        .collect();
    track.sort_by_key(|sighting| sighting.t_ns);
    track.dedup_by_key(|sighting| sighting.t_ns);
    track
}

fn is_near(times: &[i64], t_ns: i64, reach_ns: i64) -> bool {
    let next = times.partition_point(|time| *time < t_ns.saturating_sub(reach_ns));
    times.get(next).is_some_and(|time| *time <= t_ns.saturating_add(reach_ns))
}

fn seconds(from_ns: i64, to_ns: i64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 * 1e-9
}

/// Velocity of a LED at a time near sighting `index`, pixels per second: the slope of a polynomial through the images around,
/// of degree 3 at most. Noise in it would make time offsets look smaller than they are, so that it takes in all images of
/// [`SMOOTHED_NS`] to either side, and two at least.
fn velocity(track: &[Sighting], index: usize, led: usize, t_ns: i64, gap_ns: i64) -> Option<DVec2> {
    let at = |index: usize| Some((track[index].t_ns, track[index].leds[led]?));
    let mut near = vec![at(index)?];
    for forward in [false, true] {
        let (mut last, mut count) = (index, 0);
        while let Some(next) = if forward { Some(last + 1) } else { last.checked_sub(1) }.filter(|n| *n < track.len()) {
            let gap = (track[next].t_ns - track[last].t_ns).abs();
            if gap > gap_ns || (count >= 2 && (track[next].t_ns - t_ns).abs() > SMOOTHED_NS) {
                break;
            }
            let Some(sample) = at(next) else { break };
            near.push(sample);
            (last, count) = (next, count + 1);
        }
    }
    let unit = near.iter().map(|(t, _)| seconds(t_ns, *t).abs()).fold(1e-6, f64::max);
    let size = match near.len() {
        0 | 1 => return None,
        2 => 2,
        3 | 4 => 3,
        // Over a longer time a parabola is too straight.
        _ if unit > 1.5e-9 * SMOOTHED_NS as f64 => 4,
        _ => 3,
    };
    let (mut matrix, mut right) = (DMatrix::<f64>::zeros(size, size), DMatrix::<f64>::zeros(size, 2));
    for (t, pixel) in near {
        let u = seconds(t_ns, t) / unit;
        for row in 0..size {
            for column in 0..size {
                matrix[(row, column)] += u.powi((row + column) as i32);
            }
            right[(row, 0)] += u.powi(row as i32) * pixel.x;
            right[(row, 1)] += u.powi(row as i32) * pixel.y;
        }
    }
    let solution = matrix.cholesky()?.solve(&right);
    let velocity = DVec2::new(solution[(1, 0)], solution[(1, 1)]) / unit;
    velocity.is_finite().then_some(velocity)
}

fn leds_at(track: &[Sighting], t_ns: i64, matching: &Matching) -> Option<[Option<Led>; 3]> {
    let after = track.partition_point(|sighting| sighting.t_ns < t_ns);
    let before = after.checked_sub(1);
    let distance = |index: &usize| (track[*index].t_ns - t_ns).abs();
    let nearest = [Some(after).filter(|i| *i < track.len()), before].into_iter().flatten().min_by_key(distance)?;
    let leds: [Option<Led>; 3] = match before {
        Some(before)
            if distance(&nearest) > SAME_NS
                && after < track.len()
                && track[after].t_ns - track[before].t_ns <= matching.gap_ns =>
        {
            std::array::from_fn(|led| between(track, before, led, t_ns, matching))
        }
        _ if distance(&nearest) <= matching.tolerance_ns.max(SAME_NS) => std::array::from_fn(|led| {
            let known = velocity(track, nearest, led, t_ns, matching.velocity_gap_ns);
            let velocity = known.unwrap_or(DVec2::ZERO);
            let dt = seconds(track[nearest].t_ns, t_ns);
            let pixel = track[nearest].leds[led]? + velocity * dt;
            Some(Led { pixel, velocity, extra_px: 0.0 })
        }),
        _ => return None,
    };
    leds.iter().any(Option::is_some).then_some(leds)
}

/// A LED between two images of a camera.
fn between(track: &[Sighting], before: usize, led: usize, t_ns: i64, matching: &Matching) -> Option<Led> {
    let (a, b) = (&track[before], &track[before + 1]);
    let (from, to) = (a.leds[led]?, b.leds[led]?);
    let span = seconds(a.t_ns, b.t_ns);
    let u = seconds(a.t_ns, t_ns) / span;
    let slope =
        |index: usize, t_ns| velocity(track, index, led, t_ns, matching.velocity_gap_ns).unwrap_or((to - from) / span);
    let (start, end) = (slope(before, a.t_ns) * span, slope(before + 1, b.t_ns) * span);
    // Hermite's cubic.
    let (u2, u3) = (u * u, u * u * u);
    let pixel =
        from * (2.0 * u3 - 3.0 * u2 + 1.0) + start * (u3 - 2.0 * u2 + u) + to * (3.0 * u2 - 2.0 * u3) + end * (u3 - u2);
    let straight = from.lerp(to, u);
    // Of the slopes at both ends, and not one at the instant itself: its noise would be correlated with the position's, which
    // makes offsets that are not there fit better.
    let velocity = start.lerp(end, u) / span;
    Some(Led { pixel, velocity, extra_px: 0.25 * (pixel - straight).length() })
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Modality};

    use super::*;

    /// A wand that swings across the image, seen every `period_ms` from `start_ms` on.
    fn camera(name: &str, start_ms: f64, period_ms: f64, count: usize) -> WandCamera {
        let at = |ms: f64| {
            let middle = DVec2::new(600.0 + 200.0 * (ms * 0.003).sin(), 300.0 + 0.2 * ms);
            [-60.0, -20.0, 60.0].map(|x| Some(middle + DVec2::new(x, 0.1 * x)))
        };
        let sightings = (0..count).map(|i| start_ms + period_ms * i as f64);
        WandCamera {
            name: name.into(),
            modality: Modality::Rgb,
            intrinsics: Intrinsics {
                width: 1280,
                height: 720,
                fx: 900.0,
                fy: 900.0,
                cx: 640.0,
                cy: 360.0,
                distortion: Distortion::None,
            },
            sigma_px: Some(0.2),
            sightings: sightings.map(|ms| Sighting { t_ns: (ms * 1e6) as i64, leds: at(ms) }).collect(),
        }
    }

    #[test]
    fn equal_stamps_are_one_instant_and_carry_the_velocity() {
        let stick = Stick::new([0.13, 0.26]).unwrap();
        let cameras = [camera("a", 0.0, 20.0, 50), camera("b", 0.02, 20.0, 50)];
        let found = instants(&cameras, &stick, &Matching::default());
        assert_eq!(found.len(), 50);
        let led = found[20].views[0].leds[0].unwrap();
        let expected = DVec2::new(200.0 * 3.0 * (400.0_f64 * 0.003).cos(), 200.0);
        assert!((led.velocity - expected).length() < 1.0, "{} {expected}", led.velocity);
    }

    #[test]
    fn free_running_cameras_are_interpolated() {
        let stick = Stick::new([0.13, 0.26]).unwrap();
        let cameras = [camera("a", 0.0, 20.0, 50), camera("b", 7.0, 16.0, 60)];
        let found = instants(&cameras, &stick, &Matching::default());
        assert!(found.len() > 45, "{}", found.len());
        for instant in found.iter().filter(|instant| instant.views.len() == 2) {
            let [a, b] = [0, 1].map(|view| instant.views[view].leds[2].unwrap());
            // The last image of a track is as good as linear interpolation: 16 ms in a curve of 1800 px/s^2.
            assert!((a.pixel - b.pixel).length() < 0.06, "{}: {} {}", instant.t_ns, a.pixel, b.pixel);
        }
    }

    #[test]
    fn what_one_camera_alone_saw_is_left_out() {
        let stick = Stick::new([0.13, 0.26]).unwrap();
        let cameras = [camera("a", 0.0, 20.0, 10), camera("b", 1000.0, 20.0, 10)];
        assert!(instants(&cameras, &stick, &Matching::default()).is_empty());
        assert!(instants(&[], &stick, &Matching::default()).is_empty());
    }
}
