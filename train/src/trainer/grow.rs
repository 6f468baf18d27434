//! How the population changes: thinning at the start, the step from the coarse to the fine stage, density control, EDS.

use std::{collections::HashMap, sync::Arc};

use erfgs_base::random;

use super::{Model, TrainError, Trainer};
use crate::{
    config::{Guide, MotionModel, Switch},
    density::{Measures, Moments, Population, densify},
    eds,
    scene::{MotionMasks, Point, Scene, classify},
    schedule::Stage,
    start::{birth, unexplained},
};
use erfgs_run::LeftOut;
use erfgs_splat::{gaussians::Gaussians, raster::Region};

const BIN: u64 = 0x0062_696e;
/// Images of few pixels get as many Gaussians as this all the same.
const FEWEST_ALLOWED: u32 = 10_000;

impl Trainer<'_> {
    /// Finds what can move, puts it first, and starts the field. Moments start anew, as in 4DGS.
    pub(super) fn begin_fine(&mut self) -> Result<(), TrainError> {
        let gpu = self.gpu;
        let mut population = self.model.population(gpu)?;
        population.moments = Moments::zero(&population.gaussians);
        let count = population.gaussians.len();
        let means: Vec<[f32; 3]> = (0..count).map(|index| population.gaussians.mean(index)).collect();
        let masks = self.find_regions()?;
        if self.config.static_set.is_some() {
            population = self.fit_static_set(&population)?;
        }
        population = match self.config.motion {
            MotionModel::FreeTime => self.born(population),
            MotionModel::Bodies => self.carried(population)?,
            MotionModel::Still => {
                population.gaussians.dynamic = 0;
                population
            }
            MotionModel::HexPlane | MotionModel::Auto if self.config.dynamic.skip_static => {
                let moves = classify(&self.scene, &masks, &means, self.config.dynamic.share);
                population.partition(&moves)
            }
            MotionModel::HexPlane | MotionModel::Auto => {
                population.gaussians.dynamic = count;
                population
            }
        };
        let count = population.gaussians.len();
        self.note_left_out(&population.gaussians);
        let enclosed = if self.config.field.box_of_moving { population.gaussians.dynamic } else { count };
        let field_box = if self.config.field.box_of_moving {
            let moving: Vec<[f32; 3]> = (0..enclosed).map(|index| population.gaussians.mean(index)).collect();
            enclosing(&moving, 0.005, 0.1)
        } else {
            let initial: Vec<[f32; 3]> = self.scene.points.iter().map(|(position, _)| *position).collect();
            enclosing(&initial, 0.0, 0.0)
        };
        self.model.replace(gpu, &population)?;
        self.model.step = 0;
        self.model.start_motion(gpu, &self.config, &self.scene, field_box)?;
        self.start_following();
        self.statistics.replace(gpu, &vec![Default::default(); count])?;
        self.clock.stage = Stage::Fine;
        self.clock.coarse = self.clock.iteration;
        self.clock.iteration = 0;
        self.clock.stage_start = self.clock.seconds;
        self.clock.stage_start_cpu = self.clock.cpu_seconds;
        if self.model.learning() == 0 {
            // A static set tells all that there is to see.
            self.clock.iteration = self.schedule.length(Stage::Fine);
        }
        Ok(())
    }

    /// The Gaussians of the coarse stage as what stands still, and with them those born from points that move.
    fn born(&self, mut population: Population) -> Population {
        let rows = self.born_of(&self.scene.moving_points(), population.gaussians.sh_degree);
        population.gaussians.dynamic = 0;
        population.with_dynamic(&rows)
    }

    /// The Gaussians that are born from points that move, each at its instant (in [0, 1]).
    fn born_of(&self, points: &[(Point, f64)], degree: u32) -> Gaussians {
        let intervals = self.scene.intervals();
        let points: Vec<_> = points.iter().map(|(point, t01)| (*point, t01 * intervals)).collect();
        let extent = self.scene.extent;
        // A frame that is taken for an instant shows what the shutter stretched as if it were so.
        let exposure = match self.config.blur.model {
            Switch::Off => 0.0,
            Switch::On | Switch::Auto => (self.scene.exposure() * intervals) as f32,
        };
        birth::gaussians(&points, degree, extent, exposure, &self.config.free_time)
    }

    /// The Gaussians of the coarse stage as what stands still, with them those of the bodies, and those born from points that move and
    /// that no body explains.
    fn carried(&self, mut population: Population) -> Result<Population, TrainError> {
        let start = self.scene.bodies(&self.config)?;
        let points = unexplained(&start, &self.scene.moving_points(), self.scene.recording().length());
        let degree = population.gaussians.sh_degree;
        let rest = self.born_of(&points, degree).with_motion_floats(start.gaussians.motion_floats);
        population.gaussians.dynamic = 0;
        Ok(population.with_dynamic(&rest).with_dynamic(&start.gaussians.with_sh_degree(degree)))
    }

    /// Finds where things move, and keeps it for the views whose samples look there alone.
    pub(super) fn find_regions(&mut self) -> Result<MotionMasks, TrainError> {
        self.regions = vec![None; self.scene.views.len()];
        if self.config.motion == MotionModel::Still {
            self.feed.set_regions(self.gpu, &self.scene, &self.regions)?;
            return Ok(MotionMasks { masks: Vec::new() });
        }
        let masks = MotionMasks::new(&self.scene, &self.config.dynamic)?;
        if self.config.dynamic.whole_image_every > 1 || self.config.dynamic.coarse_without_moving {
            // Where nothing moves in a view, its samples look at all of it: there is nothing else to learn.
            for (view, mask) in masks.masks.iter().filter(|(_, mask)| mask.contains(&true)) {
                let size = self.scene.views[*view].view;
                self.regions[*view] = Some(Arc::new(Region::new(mask, size.width, size.height)));
            }
        }
        self.feed.set_regions(self.gpu, &self.scene, &self.regions)?;
        Ok(masks)
    }

    /// Densifies, prunes, resets and adds what events ask for, where it is due.
    pub(super) fn control_density(&mut self) -> Result<(), TrainError> {
        let iteration = self.clock.iteration;
        let progress = self.schedule.progress(&self.clock);
        let mut density = self.config.density.clone();
        density.max_gaussians = most(&self.scene, density.max_gaussians);
        let due = |from: u32, every: u32, until: f32| {
            iteration >= from && iteration.is_multiple_of(every) && progress <= f64::from(until)
        };
        let densifies = due(density.from, density.every, density.until);
        let resets = density.opacity_reset_every > 0
            && iteration.is_multiple_of(density.opacity_reset_every)
            && progress <= f64::from(density.until);
        let eds = &self.config.eds;
        let guided = eds.enabled
            && self.clock.stage == Stage::Fine
            && due(eds.from, eds.every, eds.until)
            && self.model.learning() <= most(&self.scene, eds.max_gaussians)
            && !self.scene.events.is_empty();
        if !(densifies || resets || guided) {
            return Ok(());
        }
        let gpu = self.gpu;
        let mut population = self.model.population(gpu)?;
        let mut statistics = self.statistics.read(gpu)?;
        if guided {
            let rows = self.guided(&population.gaussians)?;
            let at = population.gaussians.dynamic;
            let rows = rows.with_motion_floats(population.gaussians.motion_floats);
            population = population.with_dynamic(&rows);
            statistics.splice(at..at, vec![Default::default(); rows.len()]);
        }
        let learning = population.gaussians.len() - self.model.fixed as usize;
        let [mut population, fixed] = population.split_at(learning);
        if densifies {
            let measures = Measures {
                extent: self.scene.extent,
                width_px: self.scene.views.iter().map(|view| view.view.width).max().unwrap_or(0) as f32,
                seed: self.config.seed,
                iteration: self.schedule.done(&self.clock),
            };
            let grow = population.gaussians.len() < density.max_gaussians as usize;
            let (next, change) = densify(&population, &statistics[..learning], &density, grow, &measures);
            tracing::debug!(?change, gaussians = next.gaussians.len(), "densified");
            statistics = vec![Default::default(); next.gaussians.len() + fixed.gaussians.len()];
            population = next;
        }
        if resets {
            population.reset_opacity(0.01);
        }
        self.model.replace(gpu, &population.followed_by(&fixed))?;
        self.statistics.replace(gpu, &statistics)?;
        Ok(())
    }

    fn guided(&mut self, gaussians: &Gaussians) -> Result<Gaussians, TrainError> {
        let done = self.schedule.done(&self.clock);
        let bins = self.scene.bins.len();
        let drawn = random::uniform(random::key(self.config.seed, &[BIN, done]));
        let bin = ((drawn * bins as f64) as usize).min(bins.saturating_sub(1));
        let edges = [self.scene.bins.edges[bin], self.scene.bins.edges[bin + 1]];
        let model: &mut Model = &mut self.model;
        let start = model.means_at(self.gpu, gaussians, edges[0])?;
        let end = model.means_at(self.gpu, gaussians, edges[1])?;
        let moving = eds::Moving { start: &start, end: &end };
        let free = matches!(self.config.motion, MotionModel::FreeTime | MotionModel::Bodies);
        let birth = free.then(|| eds::Birth {
            time: (0.5 * (edges[0] + edges[1]) * self.scene.intervals()) as f32,
            half: (0.5 * (edges[1] - edges[0]) * self.scene.intervals()) as f32,
            options: &self.config.free_time,
        });
        let draw = eds::Draw { bin, denoise: self.config.earl.denoise, seed: self.config.seed, iteration: done, birth };
        let carry = |canonical: &[[f32; 3]]| model.carried(self.gpu, canonical, edges[1]);
        let (rows, report) = eds::propose(&self.scene, gaussians, moving, &self.config.eds, &draw, carry)?;
        tracing::debug!(?report, bin, "event-guided densification");
        Ok(rows)
    }

    fn note_left_out(&mut self, gaussians: &Gaussians) {
        let every = self.whole_image_every();
        let first = self.config.free_time.floats();
        let rows = gaussians.motion.chunks_exact(gaussians.motion_floats.max(1));
        let carried = rows.filter(|row| row.get(first).is_some_and(|body| *body > 0.0)).count();
        let mut note = |what: &str, why: String, saves: String| {
            self.left_out.push(LeftOut { what: what.into(), why, saves });
        };
        let (count, dynamic) = (gaussians.len(), gaussians.dynamic);
        if self.config.motion == MotionModel::Still {
            note(
                "motion",
                "nothing moves, according to frames, events and points, or the configuration".into(),
                "the motion model and its gradients".into(),
            );
        } else if self.config.motion == MotionModel::Bodies {
            note(
                "paths of their own for Gaussians of bodies",
                format!("{carried} of {dynamic} moving Gaussians are carried by bodies for the whole recording"),
                "planes and network of the deformation field; instants, lives and knots of those Gaussians".into(),
            );
            if let free @ [_, ..] = &self.config.bodies.free[..] {
                note(
                    "bodies that explain less than free-time Gaussians",
                    format!("{}: according to a trial, or the configuration", free.join(", ")),
                    "their paths and nodes".into(),
                );
            }
        } else if self.config.motion == MotionModel::FreeTime {
            note(
                "the deformation field",
                format!(
                    "{dynamic} of {count} Gaussians have a trajectory and a life of their own, the others stand still"
                ),
                "planes, network and their regularisers".into(),
            );
            if self.config.free_time.guide == Guide::Frames && self.config.free_time.knots == 0 {
                note(
                    "knots of paths",
                    "frames determine the motion, and parabolas are enough (free_time.guide)".into(),
                    "half of the parameters of a path".into(),
                );
            }
        } else if self.config.dynamic.skip_static {
            note(
                "the deformation field for static Gaussians",
                format!("{} of {count} Gaussians project onto pixels where nothing moves", count - dynamic),
                format!("{:.0} % of the field's evaluations", 100.0 * (count - dynamic) as f64 / count.max(1) as f64),
            );
        }
        if self.config.earl.enabled && !self.config.earl.still_learn && dynamic > 0 && !self.scene.events.is_empty() {
            note(
                "event gradients of static Gaussians",
                "static Gaussians cause no events; event gradients would only distort them".into(),
                format!("the gradients of {} Gaussians in event samples", count - dynamic),
            );
        }
        if every > 1 && self.regions.iter().any(Option::is_some) {
            let shares: Vec<f64> = self.regions.iter().flatten().map(|region| region.share()).collect();
            let share = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
            note(
                "parts of the images where nothing moves",
                format!("in the fine stage {} of {every} frame samples and all event samples skip them", every - 1),
                format!("{:.0} % of the pixels of those samples", 100.0 * (1.0 - share)),
            );
        }
        if matches!(self.config.motion, MotionModel::HexPlane | MotionModel::Auto) && !self.config.field.sh_head {
            note(
                "the head that deforms colour",
                "colours are assumed to move with their Gaussians, which makes the colour regulariser redundant".into(),
                format!(
                    "{} of {} outputs of the field",
                    3 * (gaussians.sh_degree + 1).pow(2),
                    3 * (gaussians.sh_degree + 1).pow(2) + 11
                ),
            );
        }
        if self.scene.events.is_empty() {
            note(
                "the event loss and event-guided densification",
                match (self.config.earl.enabled, self.config.motion) {
                    (false, _) => "the method does not use events",
                    (true, MotionModel::Still) => "where nothing moves, events hold only noise and flicker",
                    (true, _) => "the dataset has no events",
                }
                .into(),
                "two renderings an event sample".into(),
            );
        }
        if !self.colours_differ {
            let off = !self.config.camera_colour.enabled;
            note(
                "the colours of the cameras",
                if off { "switched off in the configuration" } else { "a single camera has no reference" }.into(),
                "a gain and an offset for each camera".into(),
            );
        }
        let taken_over = self.config.static_set.is_some();
        if self.poses.is_none() || taken_over {
            note(
                "the poses of the cameras",
                if taken_over {
                    "they are those of the static set".into()
                } else if !self.config.camera_pose.enabled {
                    "switched off in the configuration".into()
                } else {
                    format!("fewer than {} cameras take frames", self.config.camera_pose.fewest)
                },
                "a rotation and a translation for each camera".into(),
            );
        }
        if !self.clocks.as_ref().is_some_and(|clocks| clocks.of_frames) {
            let options = &self.config.camera_time;
            let why = if !options.enabled {
                "switched off in the configuration".into()
            } else if !matches!(self.config.motion, MotionModel::FreeTime | MotionModel::Bodies) {
                "the motion model does not determine them".into()
            } else if self.scene.frame_times.len() < 2 {
                "all frames are of one instant".into()
            } else {
                format!("fewer than {} cameras take frames", options.fewest)
            };
            note("the clocks of the cameras", why, "a time offset for each camera".into());
        }
        let (renderings, off) = match self.config.motion {
            MotionModel::Bodies => (self.config.bodies.exposure, self.config.bodies.exposure == 1),
            _ => (self.config.blur.samples, self.config.blur.model == Switch::Off),
        };
        if off || !self.scene.has_blur() {
            note(
                "the model of the exposure",
                if off { "switched off in the configuration" } else { "every frame is an instant" }.into(),
                format!("{} renderings a frame", renderings.saturating_sub(1)),
            );
        }
        if self.config.sh.max_degree < 3 {
            note(
                "higher bands of colour",
                format!("spherical harmonics stop at degree {}", self.config.sh.max_degree),
                format!("{} of 48 colour parameters a Gaussian", 48 - 3 * (self.config.sh.max_degree + 1).pow(2)),
            );
        }
    }
}

/// The greatest number of Gaussians that a setting stands for: more than the images have pixels cost time and add
/// nothing that can be seen.
pub(super) fn most(scene: &Scene, setting: u32) -> u32 {
    if setting > 0 { setting } else { scene.max_pixels().max(FEWEST_ALLOWED) }
}

/// The box around `points` without the share `outside` of them at either end of each axis, grown by `margin` of its size.
fn enclosing(points: &[[f32; 3]], outside: f64, margin: f32) -> [[f32; 3]; 2] {
    let mut lower = [-1.0; 3];
    let mut upper = [1.0; 3];
    if points.is_empty() {
        return [lower, upper];
    }
    let mut longest = 0.0_f32;
    for axis in 0..3 {
        let mut values: Vec<f32> = points.iter().map(|point| point[axis]).filter(|value| value.is_finite()).collect();
        if values.is_empty() {
            continue;
        }
        values.sort_unstable_by(f32::total_cmp);
        let cut = ((values.len() - 1) as f64 * outside) as usize;
        let (low, high) = (values[cut], values[values.len() - 1 - cut]);
        longest = longest.max(high - low);
        let grow = margin * (high - low);
        (lower[axis], upper[axis]) = (low - grow, high + grow);
    }
    // A millimetre more, so that it is nowhere flat; less where everything is smaller than a metre.
    let more = if longest > 0.0 { f32::min(1e-3, 1e-3 * longest) } else { 1e-3 };
    lower.iter_mut().for_each(|low| *low -= more);
    upper.iter_mut().for_each(|high| *high += more);
    [lower, upper]
}

/// At most `limit` points: the first of every cell of the finest grid that leaves so few.
pub(super) fn thin(points: &[Point], limit: usize) -> Vec<Point> {
    let points: Vec<_> =
        points.iter().filter(|(position, _)| position.iter().all(|p| p.is_finite())).copied().collect();
    if points.len() <= limit || limit == 0 {
        return points;
    }
    let positions: Vec<[f32; 3]> = points.iter().map(|(position, _)| *position).collect();
    let [lower, upper] = enclosing(&positions, 0.0, 0.0);
    let longest = (0..3).map(|axis| upper[axis] - lower[axis]).fold(0.0, f32::max);
    let voxels = |size: f32| {
        let mut cells: HashMap<[i64; 3], usize> = HashMap::new();
        let mut kept = Vec::new();
        for (index, position) in positions.iter().enumerate() {
            let cell = std::array::from_fn(|axis| ((position[axis] - lower[axis]) / size).floor() as i64);
            cells.entry(cell).or_insert_with(|| {
                kept.push(index);
                index
            });
        }
        kept
    };
    let (mut fine, mut coarse) = (longest * 1e-5, longest);
    for _ in 0..30 {
        let middle = (fine * coarse).sqrt();
        if voxels(middle).len() > limit { fine = middle } else { coarse = middle }
    }
    voxels(coarse).into_iter().map(|index| points[index]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_points_everywhere() {
        let points: Vec<_> =
            (0..1000).map(|i| ([(i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32], [i as u8; 3])).collect();
        let kept = thin(&points, 200);
        assert!(kept.len() <= 200 && kept.len() > 50, "{}", kept.len());
        assert!(kept.iter().any(|(p, _)| p[0] > 6.0) && kept.iter().any(|(p, _)| p[2] > 6.0));
        assert_eq!(thin(&points, 1000).len(), 1000);
    }

    #[test]
    fn the_box_leaves_out_stragglers() {
        let mut points = vec![[0.0; 3]; 500];
        points.extend(vec![[1.0; 3]; 500]);
        points.push([1000.0; 3]);
        let [lower, upper] = enclosing(&points, 0.005, 0.1);
        assert!(lower[0] < 0.0 && upper[0] > 1.0 && upper[0] < 2.0);
    }
}
