//! One camera's pixels.
//!
//! A pixel is the mean of a fixed, stratified pattern of sub-pixel rays. What a ray sees of the static set is traced
//! once and kept; at a time only the moving objects are traced, over the pixels that they can reach. The same function
//! of pixel and time makes frames, events, masks and ground truth.

use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::{
    Stage, StageError,
    actors::{Actors, Moment},
    form::Ray,
    light::Light,
    paint::albedo,
    rig::MOST_PIXELS,
    seconds,
    truth::label,
};

/// What a sub-pixel ray sees of the static set.
#[derive(Clone, Copy, Debug)]
struct Backdrop {
    /// Light that no moving object takes away, linear RGB.
    ambient: [f32; 3],
    /// Light from the lamp, which moving objects may hide.
    direct: [f32; 3],
    /// Distance along the ray, metres.
    distance: f32,
}

impl Backdrop {
    /// The light where moving objects leave so much of the lamp, whose mean is 1.
    fn lit(&self, lamp: f64) -> DVec3 {
        DVec3::from(self.ambient.map(f64::from)) + DVec3::from(self.direct.map(f64::from)) * lamp
    }
}

/// A sphere that holds everything of the static set that a pixel sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    pub centre: DVec3,
    pub radius: f64,
}

/// A camera on the stage, ready to render at any time.
#[derive(Clone, Debug)]
pub struct StageView<'stage> {
    pub(crate) stage: &'stage Stage,
    pub(crate) intrinsics: Intrinsics,
    pub(crate) pose: Pose,
    pub(crate) eye: DVec3,
    camera_to_world: DMat3,
    offsets: Vec<[f64; 2]>,
    backdrop: Vec<Backdrop>,
    still: Vec<[f32; 3]>,
    pub(crate) patches: Vec<Patch>,
}

/// Instants of an exposure in a period of a lamp that flickers.
const SAMPLES_A_PERIOD: f64 = 16.0;

/// Rays to the lamp from each sub-pixel's place on the static set.
const LAMP_RAYS: u32 = 5;

impl<'stage> StageView<'stage> {
    /// Traces the static set from a viewpoint.
    ///
    /// # Errors
    /// If the camera is distorted, has a size that cannot be rendered, or numbers that are not finite.
    pub fn new(stage: &'stage Stage, intrinsics: &Intrinsics, pose: &Pose) -> Result<Self, StageError> {
        let Intrinsics { width, height, fx, fy, cx, cy, distortion } = *intrinsics;
        if [width, height].iter().any(|side| !(1..=MOST_PIXELS).contains(side)) {
            return Err(StageError::Size { width, height, most: MOST_PIXELS });
        }
        if distortion != Distortion::None {
            return Err(StageError::Camera { why: "the camera is distorted" });
        }
        if !(fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|v| v.is_finite())) {
            return Err(StageError::Camera { why: "the intrinsics are not finite and positive" });
        }
        if !pose.is_finite() {
            return Err(StageError::Camera { why: "the pose is not finite" });
        }
        let mut view = Self {
            stage,
            intrinsics: *intrinsics,
            pose: *pose,
            eye: pose.centre(),
            camera_to_world: DMat3::from_quat(pose.rotation).transpose(),
            offsets: pattern(stage.options.samples_per_axis),
            backdrop: Vec::new(),
            still: Vec::new(),
            patches: Vec::new(),
        };
        let samples = view.offsets.len();
        view.backdrop = (0..view.pixels() * samples)
            .into_par_iter()
            .with_min_len(64)
            .map(|index| view.trace_still(&view.ray(index / samples, index % samples), index % samples))
            .collect();
        view.still = (0..view.pixels()).map(|pixel| view.lit_pixel(pixel, 1.0).as_vec3().to_array()).collect();
        view.patches = (0..view.pixels()).map(|pixel| view.patch(pixel)).collect();
        Ok(view)
    }

    /// How many pixels an image has.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.intrinsics.width as usize * self.intrinsics.height as usize
    }

    /// The image at an instant, in the lamp's mean light: linear light, RGB, row-major.
    #[must_use]
    pub fn frame(&self, t_ns: i64) -> Vec<[f32; 3]> {
        let mut moment = Moment::at(self.stage, seconds(t_ns), Actors::ALL);
        moment.lamp = 1.0;
        self.gathered(&[moment], [t_ns; 2])
    }

    /// The image that an open shutter gathers over `[start, end]` nanoseconds: the mean over `samples` instants at the
    /// middles of equal parts, in linear light, RGB, row-major. 0 `samples` are taken as 1.
    #[must_use]
    pub fn exposure(&self, [start, end]: [i64; 2], samples: u32) -> Vec<[f32; 3]> {
        let samples = samples.max(1);
        let (from, to) = (seconds(start), seconds(end.max(start)));
        let moments: Vec<Moment> = (0..samples)
            .map(|k| from + (to - from) * (f64::from(k) + 0.5) / f64::from(samples))
            .map(|t| Moment::at(self.stage, t, Actors::ALL))
            .collect();
        self.gathered(&moments, [start, end.max(start)])
    }

    /// The mean of the image over `moments`, all of them within `[start, end]` nanoseconds.
    fn gathered(&self, moments: &[Moment], [start, end]: [i64; 2]) -> Vec<[f32; 3]> {
        let mean = |values: DVec3| (values / moments.len() as f64).as_vec3().to_array();
        let changed: Vec<(usize, [f32; 3])> = self
            .reached(seconds(start), seconds(end))
            .into_par_iter()
            .with_min_len(16)
            .map(|(pixel, actors)| {
                let looker = self.looker(pixel);
                let of = |moment: &Moment| {
                    looker.colour(moment, actors).unwrap_or_else(|| self.still_colour(pixel, moment.lamp))
                };
                (pixel, mean(moments.iter().map(of).sum()))
            })
            .collect();
        let lamp = moments.iter().map(|moment| moment.lamp).sum::<f64>() / moments.len() as f64;
        let mut image = self.still.clone();
        if lamp != 1.0 {
            let still =
                |(pixel, still): (usize, &mut [f32; 3])| *still = self.still_colour(pixel, lamp).as_vec3().to_array();
            image.par_iter_mut().enumerate().with_min_len(256).for_each(still);
        }
        for (pixel, colour) in changed {
            image[pixel] = colour;
        }
        image
    }

    /// Enough instants for [`StageView::exposure`]: nothing crosses more than `step_px` pixels from one to the next, and the lamp
    /// flickers slowly.
    #[must_use]
    pub fn exposure_samples(&self, [start, end]: [i64; 2], step_px: f64) -> u32 {
        let (from, to) = (seconds(start), seconds(end.max(start)));
        let path = self.pixel_speed(0.5 * (from + to), 0.5 * (to - from)) * (to - from);
        let periods = self.stage.options.flicker.map_or(0.0, |flicker| flicker.hz * (to - from));
        (path / step_px).max(SAMPLES_A_PERIOD * periods).ceil().clamp(1.0, 4096.0) as u32
    }

    /// Which pixels a moving object or a moving shadow touches at an instant, row-major. Exact: everywhere else the
    /// image is that of the empty room.
    #[must_use]
    pub fn mask(&self, t_ns: i64) -> Vec<bool> {
        let moment = Moment::at(self.stage, seconds(t_ns), Actors::ALL);
        let mut mask = vec![false; self.pixels()];
        for (pixel, actors) in self.reached(seconds(t_ns), seconds(t_ns)) {
            mask[pixel] = self.looker(pixel).colour(&moment, actors).is_some();
        }
        mask
    }

    /// The label of the body that each pixel shows at an instant, row-major, as [`crate::truth`] numbers them: that which covers most of
    /// the pixel, where bodies cover half of it or more, and 0 elsewhere.
    #[must_use]
    pub fn labels(&self, t_ns: i64) -> Vec<u8> {
        let moment = Moment::at(self.stage, seconds(t_ns), Actors::ALL);
        let mut labels = vec![0; self.pixels()];
        for (pixel, actors) in self.reached(seconds(t_ns), seconds(t_ns)) {
            labels[pixel] = self.looker(pixel).body(&moment, actors).map_or(0, label);
        }
        labels
    }

    /// Depth (z in the camera, metres) of what the centre of each pixel sees at an instant, row-major. A moving object
    /// counts where it covers at least half of the ray.
    #[must_use]
    pub fn depth(&self, t_ns: i64) -> Vec<f32> {
        let moment = Moment::at(self.stage, seconds(t_ns), Actors::ALL);
        (0..self.pixels())
            .into_par_iter()
            .map(|pixel| {
                let ray = self.ray_through(pixel, [0.5, 0.5]);
                let still =
                    self.stage.set.hit(ray.origin, ray.direction).map_or(f64::INFINITY, |(hit, _)| hit.distance);
                let fragments = self.stage.fragments(&ray, &moment, moment.actors, still);
                let distance = fragments.iter().find(|f| f.cover >= 0.5).map_or(still, |f| f.distance);
                (distance * self.pose.rotation.mul_vec3(ray.direction).z) as f32
            })
            .collect()
    }

    /// What a ray through a place of the image meets at an instant: the point (metres) and its colour (linear light).
    /// `x` and `y` are pixels; none where the ray leaves the room.
    pub(crate) fn probe(&self, [x, y]: [f64; 2], moment: &Moment) -> Option<(DVec3, DVec3)> {
        let ray = self.ray_through(0, [x, y]);
        let backdrop = self.trace_still(&ray, 0);
        let still = f64::from(backdrop.distance);
        let fragments = self.stage.fragments(&ray, moment, moment.actors, still);
        let (distance, colour) = match fragments.iter().find(|f| f.cover >= 0.5) {
            Some(fragment) => (fragment.distance, fragment.colour),
            None => (still, backdrop.lit(moment.lamp)),
        };
        distance.is_finite().then(|| (ray.origin + ray.direction * distance, colour))
    }

    /// Linear light of one pixel at an instant, seconds; none where nothing touches it.
    pub(crate) fn pixel_at(&self, pixel: usize, t: f64) -> Option<DVec3> {
        self.looker(pixel).colour(&Moment::at(self.stage, t, Actors::ALL), Actors::ALL)
    }

    /// Linear light of one pixel of the empty room when the lamp has so much of its mean light.
    pub(crate) fn still_colour(&self, pixel: usize, lamp: f64) -> DVec3 {
        match lamp {
            1.0 => DVec3::from(self.still[pixel].map(f64::from)),
            _ => self.lit_pixel(pixel, lamp),
        }
    }

    /// The share of the lamp that the moving objects leave to a sample's place on the static set; 1 where the lamp does
    /// not shine anyway.
    fn past_shadows(&self, ray: &Ray, backdrop: &Backdrop, moment: &Moment, actors: Actors) -> f64 {
        if !actors.has(Actors::SHADOWS) || backdrop.direct == [0.0; 3] {
            return 1.0;
        }
        let at = ray.origin + ray.direction * f64::from(backdrop.distance);
        let light = &self.stage.light;
        let mut lit = 1.0;
        for (number, place) in &moment.places {
            let shade = self.stage.cast.parts[*number].shade;
            if let Some(radius) = shade.filter(|_| actors.has(Actors::shadow(*number))) {
                lit *= light.past_sphere(at, place.origin, radius);
            }
        }
        lit
    }

    /// The rays of one pixel, to look along at many times.
    pub(crate) fn looker(&self, pixel: usize) -> Looker<'_> {
        let samples = self.offsets.len();
        let rays = (0..samples).map(|sample| self.ray(pixel, sample)).collect();
        let middle = self.ray_through(pixel, [0.5, 0.5]);
        // A pixel's own corner, and beyond it the half of a sub-pixel's cone: 0.71 + 0.6 pixels at most.
        let margin = 1.5 / self.intrinsics.fx.min(self.intrinsics.fy);
        Looker { view: self, backdrop: &self.backdrop[pixel * samples..(pixel + 1) * samples], rays, middle, margin }
    }

    fn trace_still(&self, ray: &Ray, sample: usize) -> Backdrop {
        let set = &self.stage.set;
        let Some((hit, shape)) = set.hit(ray.origin, ray.direction) else {
            return Backdrop { ambient: [0.0; 3], direct: [0.0; 3], distance: f32::INFINITY };
        };
        let at = ray.origin + ray.direction * hit.distance;
        // Between the footprint across the view and the one along a slanted surface.
        let footprint = hit.distance * ray.spread / (-hit.normal.dot(ray.direction)).max(0.05).sqrt();
        let colour = albedo(hit.paint, set.seed ^ shape as u64, hit.surface, footprint);
        let light = &self.stage.light;
        let lifted = at + hit.normal * 1e-4;
        let turn = sample as f64 / self.offsets.len() as f64;
        let direct = light.direct(at, hit.normal);
        let direct = if direct == DVec3::ZERO { direct } else { direct * light.visible(set, lifted, LAMP_RAYS, turn) };
        let ambient = light.ambient(hit.normal) * Light::openness(at, hit.normal);
        Backdrop {
            ambient: (colour * ambient).as_vec3().to_array(),
            direct: (colour * direct).as_vec3().to_array(),
            distance: hit.distance as f32,
        }
    }

    fn lit_pixel(&self, pixel: usize, lamp: f64) -> DVec3 {
        let samples = self.offsets.len();
        let rays = &self.backdrop[pixel * samples..(pixel + 1) * samples];
        rays.iter().map(|ray| ray.lit(lamp)).sum::<DVec3>() / samples as f64
    }

    fn patch(&self, pixel: usize) -> Patch {
        let samples = self.offsets.len();
        let place = |sample: usize| {
            let ray = self.ray(pixel, sample);
            ray.origin + ray.direction * f64::from(self.backdrop[pixel * samples + sample].distance)
        };
        let centre = (0..samples).map(place).sum::<DVec3>() / samples as f64;
        let radius = (0..samples).map(|sample| (place(sample) - centre).length()).fold(0.0, f64::max);
        Patch { centre, radius }
    }

    fn ray(&self, pixel: usize, sample: usize) -> Ray {
        self.ray_through(pixel, self.offsets[sample])
    }

    fn ray_through(&self, pixel: usize, [dx, dy]: [f64; 2]) -> Ray {
        let width = self.intrinsics.width as usize;
        let (x, y) = ((pixel % width) as f64 + dx, (pixel / width) as f64 + dy);
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        let direction = self.camera_to_world * DVec3::new((x - cx) / fx, (y - cy) / fy, 1.0);
        Ray { origin: self.eye, direction: direction.normalize(), spread: self.spread() }
    }

    /// Width of a sub-pixel's cone at 1 m, metres.
    fn spread(&self) -> f64 {
        1.2 / (self.intrinsics.fx.min(self.intrinsics.fy) * f64::from(self.stage.options.samples_per_axis))
    }
}

/// One pixel of a view: its rays, and what they see of the static set.
pub(crate) struct Looker<'view> {
    view: &'view StageView<'view>,
    backdrop: &'view [Backdrop],
    rays: Vec<Ray>,
    middle: Ray,
    margin: f64,
}

impl Looker<'_> {
    /// Linear light of the pixel when none but `actors` can touch it; none where none of them does.
    pub(crate) fn colour(&self, moment: &Moment, actors: Actors) -> Option<DVec3> {
        let actors = self.view.stage.within(&self.middle, self.margin, moment, actors);
        if actors == Actors::NONE {
            return None;
        }
        let (mut sum, mut touched) = (DVec3::ZERO, false);
        for (ray, backdrop) in self.rays.iter().zip(self.backdrop) {
            let fragments = self.view.stage.fragments(ray, moment, actors, f64::from(backdrop.distance));
            let lit = self.view.past_shadows(ray, backdrop, moment, actors);
            touched |= lit < 1.0 || !fragments.is_empty();
            let mut colour = backdrop.lit(lit * moment.lamp);
            for fragment in fragments.iter().rev() {
                colour += (fragment.colour - colour) * fragment.cover;
            }
            sum += colour;
        }
        touched.then(|| sum / self.rays.len() as f64)
    }

    /// The body that covers most of the pixel, where bodies cover half of it or more.
    fn body(&self, moment: &Moment, actors: Actors) -> Option<usize> {
        let stage = self.view.stage;
        let actors = stage.within(&self.middle, self.margin, moment, actors);
        let mut shares = vec![0.0; stage.cast.bodies.len()];
        for (ray, backdrop) in self.rays.iter().zip(self.backdrop) {
            let mut left = 1.0;
            for fragment in stage.fragments(ray, moment, actors, f64::from(backdrop.distance)).iter() {
                shares[stage.cast.parts[fragment.part].body] += left * fragment.cover;
                left *= 1.0 - fragment.cover;
            }
        }
        let most = (0..shares.len()).max_by(|&a, &b| shares[a].total_cmp(&shares[b]))?;
        let covered: f64 = shares.iter().sum();
        (covered >= 0.5 * self.rays.len() as f64).then_some(most)
    }
}

/// Sub-pixel positions in [0, 1)²: a square grid, sheared so that no two share a row or a column.
fn pattern(per_axis: u32) -> Vec<[f64; 2]> {
    let n = f64::from(per_axis);
    (0..per_axis * per_axis)
        .map(|index| {
            let (column, row) = (f64::from(index % per_axis), f64::from(index / per_axis));
            [(column + (row + 0.5) / n) / n, (row + (column + 0.5) / n) / n]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RigOptions, StageOptions};
    use proptest::prelude::*;

    /// The colour of a pixel with every object tried on every ray.
    fn brute(view: &StageView<'_>, pixel: usize, moment: &Moment) -> DVec3 {
        let looker = view.looker(pixel);
        let actors = if view.stage.options.shadows { Actors::ALL } else { Actors::ALL.without(Actors::SHADOWS) };
        let colours = looker.rays.iter().zip(looker.backdrop).map(|(ray, backdrop)| {
            let lit = view.past_shadows(ray, backdrop, moment, actors);
            let mut colour = backdrop.lit(lit * moment.lamp);
            let fragments = view.stage.fragments(ray, moment, actors, f64::from(backdrop.distance));
            for fragment in fragments.iter().rev() {
                colour += (fragment.colour - colour) * fragment.cover;
            }
            colour
        });
        colours.sum::<DVec3>() / looker.rays.len() as f64
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn pruning_never_changes_a_pixel(t_ms in -3000_i64..3000, camera in 0_usize..7, shadows: bool, seed in 0_u64..4) {
            let stage = Stage::new(StageOptions { shadows, samples_per_axis: 2, ..StageOptions::default() });
            let rig = RigOptions { width: 48, height: 36, rgb: 5, event: 1, test: 1, ..RigOptions::default() };
            let camera = &rig.cameras(seed).unwrap()[camera];
            let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
            let t_ns = t_ms * 1_000_000 + 321;
            let (frame, mask) = (view.frame(t_ns), view.mask(t_ns));
            let moment = Moment::at(&stage, seconds(t_ns), Actors::ALL);
            for pixel in 0..view.pixels() {
                let expected = brute(&view, pixel, &moment);
                let got = DVec3::from(frame[pixel].map(f64::from));
                prop_assert!((got - expected).length() < 1e-6, "pixel {pixel} of {}: {got} and {expected}", camera.name);
                prop_assert!(mask[pixel] || (expected - view.still_colour(pixel, 1.0)).length() < 1e-6, "pixel {pixel} is not in the mask");
            }
        }

        #[test]
        fn what_is_reached_in_an_interval_is_reached_at_each_time_in_it(t in -2.0..2.0_f64, length in 0.0..0.05_f64, share in 0.0..1.0_f64) {
            let stage = Stage::new(StageOptions { shadows: true, samples_per_axis: 2, ..StageOptions::default() });
            let rig = RigOptions { width: 48, height: 36, rgb: 1, event: 0, test: 0, ..RigOptions::default() };
            let camera = &rig.cameras(1).unwrap()[0];
            let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
            let reached: std::collections::BTreeSet<usize> = view.reached(t, t + length).into_iter().map(|(pixel, _)| pixel).collect();
            let inside = ((t + share * length) * 1e9) as i64;
            for (pixel, moving) in view.mask(inside).into_iter().enumerate() {
                prop_assert!(!moving || reached.contains(&pixel), "pixel {pixel} moves but was not expected to");
            }
        }
    }

    #[test]
    fn cameras_that_cannot_be_rendered_are_typed_errors() {
        let stage = Stage::new(StageOptions::default());
        let camera = &RigOptions { width: 1, height: 1, ..RigOptions::default() }.cameras(1).unwrap()[0];
        let fails = |intrinsics: Intrinsics, pose: Pose| StageView::new(&stage, &intrinsics, &pose).is_err();
        let (good, pose) = (camera.intrinsics, camera.world_to_camera);
        assert!(!fails(good, pose), "one pixel is an image");
        assert!(fails(Intrinsics { width: 0, ..good }, pose));
        assert!(fails(Intrinsics { height: u32::MAX, ..good }, pose));
        assert!(fails(Intrinsics { fx: f64::NAN, ..good }, pose));
        assert!(fails(Intrinsics { fy: 0.0, ..good }, pose));
        assert!(fails(Intrinsics { distortion: Distortion::KannalaBrandt([0.0; 4]), ..good }, pose));
        assert!(fails(good, Pose { translation: DVec3::NAN, ..pose }));
    }
}
