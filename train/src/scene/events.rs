//! An event camera: its events counted in bins of time, and what they add up to between any two edges.

use std::{
    io,
    ops::Range,
    path::{Path, PathBuf},
};

use erfgs_dataset::{Camera, CameraEvents};
use erfgs_events::Events;

use super::{
    Bins, SceneError,
    balance::{self, Returns},
    counts::{Counts, Way},
    words::Words,
};
use crate::{
    config::EarlConfig,
    losses::{Sensor, unit},
};

/// The least change of light that is counted as one, units of error. Pixels that were made of many have far smaller thresholds,
/// each of which tells no more than that one of the many fired.
const LEAST: f64 = 0.5;

/// Noise that adds up to less than so many thresholds over the whole recording is left in.
const LEAST_DRIFT: f64 = 0.25;

/// An event camera.
#[derive(Debug)]
pub struct EventView {
    /// Index into the scene's views.
    pub view: usize,
    /// How its sensor turns light into events; the threshold is the change that counts as one.
    pub sensor: Sensor,
    /// How many events it saw.
    pub count: u64,
    /// The edges from and up to which the camera was there; before and after nothing is known.
    pub covers: [usize; 2],
    width: usize,
    /// An ON event's change of light beside an OFF event's, where its events tell another than was stated.
    pub measured_ratio: Option<f64>,
    /// What an ON and an OFF event change, units of the sensor's threshold.
    step: [f32; 2],
    /// The same of each pixel, where a lamp that flickers tells; empty where none does.
    steps: Vec<[f32; 2]>,
    /// What events that nothing caused add up to while the camera was there, in the same units.
    pub drift: f64,
    /// When each edge is, in [0, 1].
    edges: Vec<f64>,
    counts: Counts,
    /// Where the counts' files are, if they are not in memory.
    folder: PathBuf,
}

/// What lies in an event camera's memory or files.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Numbers {
    /// Its events.
    Events,
    /// Counts of all pixels at some edges.
    Images,
}

/// An event camera whose events are being counted, in the order of their times.
#[derive(Debug)]
pub(super) struct EventCounter<'a> {
    view: usize,
    file: &'a CameraEvents,
    bins: &'a Bins,
    covers: [usize; 2],
    size: [usize; 2],
    earl: &'a EarlConfig,
    /// Where the light flickers, and bins are from peak to peak.
    returns: Option<Returns>,
    count: u64,
    /// The bin that is being filled.
    bin: usize,
    /// Pixels and polarities of its events, where they are looked at together.
    pending: Vec<(u32, bool)>,
    counts: Counts,
    folder: PathBuf,
}

impl<'a> EventCounter<'a> {
    /// Of `camera`, view `view` of the scene, where the light `flickers` or not; nothing where it recorded during none of the bins.
    /// What is counted lies in files in `folder`, or in memory.
    ///
    /// # Errors
    /// [`SceneError::Scratch`].
    pub fn new(
        view: usize,
        camera: &'a Camera,
        bins: &'a Bins,
        earl: &'a EarlConfig,
        flickers: bool,
        folder: Option<&Path>,
    ) -> Result<Option<Self>, SceneError> {
        let Some(file) = &camera.events else { return Ok(None) };
        let covers = bins.within(file.covers_ns);
        if covers[0] >= covers[1] {
            return Ok(None);
        }
        let size = [camera.intrinsics.width, camera.intrinsics.height].map(|side| side as usize);
        let place = folder.unwrap_or(Path::new("")).to_owned();
        let counts = Counts::new(size[0] * size[1], folder).map_err(scratch(&place))?;
        let (count, bin, pending) = (0, 0, Vec::new());
        let returns = flickers.then(|| Returns::new(size[0] * size[1]));
        Ok(Some(Self { view, file, bins, covers, size, earl, returns, count, bin, pending, counts, folder: place }))
    }

    /// Counts events that come after those before, without those that the loss leaves out.
    ///
    /// # Errors
    /// [`SceneError::Scratch`].
    pub fn add(&mut self, events: &Events) -> Result<(), SceneError> {
        self.count += events.len() as u64;
        self.put(events).map_err(scratch(&self.folder))
    }

    fn put(&mut self, events: &Events) -> io::Result<()> {
        for (((&t_us, &x), &y), &on) in events.t_us.iter().zip(&events.x).zip(&events.y).zip(&events.on) {
            while self.bin < self.bins.len() && t_us > self.bins.edges_us[self.bin + 1] {
                self.end_bin()?;
            }
            if self.bin >= self.bins.len() {
                return Ok(());
            }
            if t_us <= self.bins.edges_us[self.bin] {
                continue;
            }
            let pixel = usize::from(y) * self.size[0] + usize::from(x);
            if self.earl.denoise {
                self.pending.push((pixel as u32, on));
            } else {
                self.counts.push(pixel, on)?;
            }
        }
        Ok(())
    }

    fn end_bin(&mut self) -> io::Result<()> {
        let [width, height] = self.size;
        if !self.pending.is_empty() {
            let mut total = vec![0_u32; width * height];
            self.pending.iter().for_each(|&(pixel, _)| total[pixel as usize] += 1);
            for (pixel, on) in std::mem::take(&mut self.pending) {
                let pixel = pixel as usize;
                if neighbourhood(&total, width, height, pixel % width, pixel / width) >= 2 {
                    self.counts.push(pixel, on)?;
                }
            }
        }
        self.bin += 1;
        if let Some(returns) = &mut self.returns {
            returns.edge(self.counts.now());
        }
        self.counts.edge()
    }

    fn end(mut self) -> io::Result<(Counts, Option<Returns>)> {
        while self.bin < self.bins.len() {
            self.end_bin()?;
        }
        Ok((self.counts.finish()?, self.returns))
    }

    /// No other follows.
    ///
    /// # Errors
    /// [`SceneError::Scratch`].
    pub fn finish(self) -> Result<EventView, SceneError> {
        let (earl, view, file, covers, [width, height], count) =
            (self.earl, self.view, self.file, self.covers, self.size, self.count);
        let (folder, edges) = (self.folder.clone(), self.bins.edges.clone());
        let threshold =
            (0.5 * (file.threshold_on + file.threshold_off)).max(LEAST * f64::from(unit(file.linear_light)));
        let sensor = Sensor {
            threshold: threshold as f32,
            lin_log: file.lin_log_threshold as f32,
            linear_light: file.linear_light,
        };
        let (counts, returns) = self.end().map_err(scratch(&folder))?;
        let revealing = |pixel: usize| returns.as_ref().and_then(|returns| returns.revealing(pixel));
        let stated_ratio = file.threshold_on / file.threshold_off;
        let (measured_ratio, noise) = if earl.balance {
            let totals = counts.between(covers[0], covers[1]).map_err(scratch(&folder))?;
            let totals = totals.into_iter().enumerate().filter(|(pixel, _)| revealing(*pixel).is_none());
            let totals: Vec<[u32; 2]> = totals.map(|(_, counts)| counts).collect();
            let noise = balance::noise(&totals);
            (balance::ratio(&totals, noise, stated_ratio), noise)
        } else {
            (None, [0.0; 2])
        };
        // What both change together stays as stated.
        let more = measured_ratio.map_or(1.0, |revealing| (revealing / stated_ratio).sqrt());
        let step = [file.threshold_on * more, file.threshold_off / more].map(|one| (one / threshold) as f32);
        let drift = noise[0] * f64::from(step[0]) - noise[1] * f64::from(step[1]);
        let drift = if drift.abs() < LEAST_DRIFT { 0.0 } else { drift };
        let own = |pixel: usize| revealing(pixel).map_or(step, |counts| balance::own_steps(counts, step));
        let pixels = if returns.is_some() { width * height } else { 0 };
        let steps = (0..pixels).map(own).collect();
        Ok(EventView { view, sensor, count, covers, width, measured_ratio, step, steps, drift, edges, counts, folder })
    }
}

fn scratch(folder: &Path) -> impl Fn(io::Error) -> SceneError {
    let path = folder.to_owned();
    move |source| SceneError::Scratch { path: path.clone(), source }
}

impl EventView {
    /// Whether the camera was there from one edge to another.
    #[must_use]
    pub fn knows(&self, from: usize, to: usize) -> bool {
        from >= self.covers[0] && to <= self.covers[1]
    }

    /// The signed count of every pixel between two edges, units of the sensor's threshold, less what nothing caused.
    ///
    /// # Errors
    /// [`SceneError::Scratch`] where the events lie in a file that cannot be read any more.
    pub fn between(&self, from: usize, to: usize) -> Result<Vec<f32>, SceneError> {
        let drift = self.drift_between(from, to);
        let mut counts = self.signed(from, to)?;
        for (pixel, count) in counts.iter_mut().enumerate() {
            // What tells of its own thresholds has it in them.
            if self.steps.get(pixel).is_none_or(|own| *own == self.step) {
                *count -= drift;
            }
        }
        Ok(counts)
    }

    /// What events that nothing caused add up to between two edges, units of the sensor's threshold.
    pub(crate) fn drift_between(&self, from: usize, to: usize) -> f32 {
        let [first, last] = self.covers.map(|edge| self.edges[edge]);
        let share = (self.edges[to] - self.edges[from]) / (last - first).max(1e-12);
        (self.drift * share) as f32
    }

    /// How many pixels the camera has.
    pub(crate) fn pixels(&self) -> usize {
        self.counts.pixels()
    }

    /// What an ON and an OFF event change, units of the sensor's threshold: at most pixels, and at each, where pixels tell.
    pub(crate) fn steps(&self) -> ([f32; 2], &[[f32; 2]]) {
        (self.step, &self.steps)
    }

    /// ON and OFF events of every pixel between two edges.
    ///
    /// # Errors
    /// As [`EventView::between`].
    pub(crate) fn pairs(&self, from: usize, to: usize) -> Result<Vec<[u32; 2]>, SceneError> {
        self.counts.between(from, to).map_err(scratch(&self.folder))
    }

    /// What those are added up from.
    pub(crate) fn way(&self, from: usize, to: usize) -> Way {
        self.counts.way(from, to)
    }

    /// How many numbers [`EventView::read`] has of each kind.
    pub(crate) fn numbers(&self) -> [usize; 2] {
        self.counts.words().map(Words::len)
    }

    /// Hands numbers over, piece by piece: of each event twice its pixel, and one more if it is ON, or the images of counts, ON and OFF of
    /// each pixel.
    ///
    /// # Errors
    /// As [`EventView::between`].
    pub(crate) fn read(
        &self,
        kind: Numbers,
        numbers: Range<usize>,
        take: impl FnMut(usize, &[u32]),
    ) -> Result<(), SceneError> {
        let words = self.counts.words()[kind as usize];
        words.read(numbers.start, numbers.len(), take).map_err(scratch(&self.folder))
    }

    /// The signed count of every pixel between two edges as it is, units of the sensor's threshold.
    fn signed(&self, from: usize, to: usize) -> Result<Vec<f32>, SceneError> {
        let signed = |([on, off], step): ([u32; 2], &[f32; 2])| on as f32 * step[0] - off as f32 * step[1];
        let counts = self.pairs(from, to)?;
        let steps = self.steps.iter().chain(std::iter::repeat(&self.step));
        Ok(counts.into_iter().zip(steps).map(signed).collect())
    }

    /// The absolute signed count between two edges, averaged over 3 x 3 pixels where `smooth`.
    ///
    /// # Errors
    /// As [`EventView::between`].
    pub fn activity(&self, from: usize, to: usize, smooth: bool) -> Result<Vec<f32>, SceneError> {
        let mut activity = self.signed(from, to)?;
        for value in &mut activity {
            *value = value.abs();
        }
        if !smooth {
            return Ok(activity);
        }
        let (width, height) = (self.width, activity.len() / self.width.max(1));
        let mut lone = activity.clone();
        for y in 0..height {
            for x in 0..width {
                let sum: f32 = around(width, height, x, y).map(|index| activity[index]).sum();
                if sum / 9.0 <= 0.2 {
                    lone[y * width + x] = 0.0;
                }
            }
        }
        Ok(lone)
    }
}

/// Events in the 3 x 3 pixels around (and with) a pixel. The released code keeps a pixel whose mean over the nine exceeds
/// 0.2, which is two events or more.
fn neighbourhood(total: &[u32], width: usize, height: usize, x: usize, y: usize) -> u32 {
    around(width, height, x, y).map(|index| total[index]).sum()
}

/// The pixels around (and with) one, inside the picture.
pub(super) fn around(width: usize, height: usize, x: usize, y: usize) -> impl Iterator<Item = usize> {
    let (x0, x1) = (x.saturating_sub(1), (x + 2).min(width));
    let (y0, y1) = (y.saturating_sub(1), (y + 2).min(height));
    (y0..y1).flat_map(move |y| (x0..x1).map(move |x| y * width + x))
}

#[cfg(test)]
mod tests {
    use erfgs_events::Event;
    use erfgs_scene::Modality;

    use super::*;
    use crate::scene::fixtures;

    fn camera() -> Camera {
        Camera {
            modality: Modality::Event,
            events: Some(fixtures::events([0, 50_000_000])),
            ..fixtures::camera("e", [4, 2], 4.0)
        }
    }

    fn earl(denoise: bool) -> EarlConfig {
        EarlConfig { denoise, ..crate::config::Config::default().earl }
    }

    /// A camera's view of these events, in memory.
    fn seen(camera: &Camera, events: &Events, earl: &EarlConfig) -> Option<EventView> {
        let bins = bins();
        let mut counter = EventCounter::new(0, camera, &bins, earl, false, None).expect("memory")?;
        counter.add(events).expect("memory");
        Some(counter.finish().expect("memory"))
    }

    fn bins() -> Bins {
        Bins::new(&[0, 20_000_000, 40_000_000], 2, [0, 50_000_000], 50_000_000)
    }

    #[test]
    fn what_a_camera_did_not_record_is_unknown() {
        let mut camera = camera();
        camera.events.as_mut().expect("events").covers_ns = [9_000_000, 30_000_000];
        let view = seen(&camera, &Events::new(4, 2), &earl(false)).expect("an event camera");
        assert_eq!(view.covers, [1, 3]);
        assert!(view.knows(1, 3) && !view.knows(0, 1) && !view.knows(2, 4));
        camera.events.as_mut().expect("events").covers_ns = [12_000_000, 15_000_000];
        assert!(seen(&camera, &Events::new(4, 2), &earl(false)).is_none());
    }

    #[test]
    fn an_event_on_an_edge_belongs_to_the_bin_before_it() {
        let mut events = Events::new(4, 2);
        for (t_us, on) in [(10_000, true), (10_001, true), (20_000, false), (45_000, true)] {
            events.push(Event { t_us, x: 1, y: 1, on });
        }
        let view = seen(&camera(), &events, &earl(false)).expect("an event camera");
        assert_eq!(view.between(0, 1).expect("memory")[5], 1.0);
        assert_eq!(view.between(1, 2).expect("memory")[5], 0.0);
        assert_eq!(view.between(0, 5).expect("memory")[5], 2.0);
    }

    #[test]
    fn pixels_that_were_made_of_many_count_changes_of_light_and_not_firings() {
        let mut camera = camera();
        let file = camera.events.as_mut().expect("events");
        // Of 8 x 8 pixels with a threshold of 0.24 each.
        (file.threshold_on, file.threshold_off) = (0.24 / 64.0, 0.24 / 64.0);
        let mut events = Events::new(4, 2);
        (1..65).for_each(|t_us| events.push(Event { t_us, x: 1, y: 1, on: true }));
        events.push(Event { t_us: 90, x: 2, y: 1, on: false });
        let counts = |camera: &Camera| {
            let view = seen(camera, &events, &earl(false)).expect("an event camera");
            (view.sensor, view.between(0, 1).expect("memory"))
        };
        let (sensor, seen) = counts(&camera);
        assert!((seen[5] * sensor.threshold - 0.24).abs() < 1e-6, "all of it: {}", seen[5]);
        assert!(seen[6].abs() < 0.05, "one of 64 tells little: {}", seen[6]);
        // What an error of so much light costs does not depend on how many pixels were made one.
        let file = camera.events.as_mut().expect("events");
        (file.threshold_on, file.threshold_off) = (0.24, 0.24);
        let (whole, _) = counts(&camera);
        let cost = |sensor: &Sensor| sensor.worth() / sensor.threshold;
        assert!((cost(&whole) - cost(&sensor)).abs() < 1e-6 && whole.threshold > 2.0 * sensor.threshold);
    }

    #[test]
    fn a_lone_event_is_noise_and_a_pair_is_not() {
        let mut events = Events::new(4, 2);
        events.push(Event { t_us: 5_000, x: 3, y: 0, on: true });
        events.push(Event { t_us: 15_000, x: 0, y: 0, on: true });
        events.push(Event { t_us: 16_000, x: 1, y: 1, on: true });
        let view = seen(&camera(), &events, &earl(true)).expect("an event camera");
        assert_eq!(view.between(0, 2).expect("memory").iter().sum::<f32>(), 2.0);
        assert_eq!(view.activity(0, 1, false).expect("memory").iter().sum::<f32>(), 0.0);
    }

    #[test]
    fn thresholds_that_were_stated_wrong_are_taken_from_what_comes_back() {
        let mut camera = camera();
        (camera.intrinsics.width, camera.intrinsics.height) = (30, 30);
        let file = camera.events.as_mut().expect("events");
        (file.threshold_on, file.threshold_off) = (0.2, 0.2);
        // At each third pixel six steps up, and the same way down in four.
        let mut events = Events::new(30, 30);
        for t_us in 1..11 {
            (0..900).step_by(3).for_each(|at| events.push(Event { t_us, x: at % 30, y: at / 30, on: t_us < 7 }));
        }
        let change = |earl: &EarlConfig| {
            let view = seen(&camera, &events, earl).expect("an event camera");
            (view.measured_ratio, view.between(0, 1).expect("memory")[6])
        };
        let (ratio, left) = change(&earl(false));
        assert!((ratio.expect("another ratio") - 4.0 / 6.0).abs() < 1e-6 && left.abs() < 1e-5, "{ratio:?} {left}");
        assert_eq!(change(&EarlConfig { balance: false, ..earl(false) }), (None, 2.0));
    }

    #[test]
    fn bins_from_peak_to_peak_see_nothing_of_a_lamp_and_all_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut camera = camera();
        (camera.name, camera.intrinsics.width, camera.intrinsics.height) = ("a".into(), 20, 20);
        let file = camera.events.as_mut().expect("events");
        (file.file, file.covers_ns, file.lin_log_threshold) = ("a.npz".into(), [0, 1_000_000_000], 20.0);
        (file.threshold_on, file.threshold_off) = (0.2, 0.2);
        // Three steps up and down 100 times a second at half of the pixels, of which some take four steps down; at one of them
        // something brightens for good after half a second.
        let mut all = Vec::new();
        for period in 0..100_i64 {
            for at in (0..400_u16).filter(|at| at % 20 < 10) {
                let (x, y) = (at % 20, at / 20);
                let falls = if y < 5 { 4 } else { 3 };
                let mut push = |t_us: i64, on| all.push(Event { t_us: 10_000 * period + t_us, x, y, on });
                (0..3).for_each(|step| push(1000 + 500 * step, true));
                (0..falls).for_each(|step| push(6000 + 500 * step, false));
                if (period, x, y) == (50, 3, 9) {
                    (0..5).for_each(|step| push(4000 + step, true));
                }
            }
        }
        all.sort_by_key(|event| event.t_us);
        let mut events = Events::new(20, 20);
        all.into_iter().for_each(|event| events.push(event));
        file.count = events.len() as u64;
        erfgs_events::npz::write_events(&folder.path().join("a.npz"), &events).expect("a file");
        let mut dataset = crate::scene::fixtures::dataset(folder.path(), vec![camera], [0, 1_000_000_000]);
        dataset.hash_files().expect("a file");
        let flicker = crate::scene::Flicker::find(&dataset).expect("read").expect("a lamp");
        assert!((flicker.hz - 100.0).abs() < 0.1 && (flicker.share - 0.5).abs() < 1e-9, "{flicker:?}");
        let every_4_ms = Bins::new(&[0, 500_000_000, 1_000_000_000], 125, [0, 1_000_000_000], 1_000_000_000);
        let bins = every_4_ms.at_peaks(&flicker, [0, 1_000_000_000]).expect("peaks");
        assert_eq!(Bins::new(&[0], 1, [0, 4_000_000], 4_000_000).at_peaks(&flicker, [0, 4_000_000]), None);
        assert!(bins.edges_us.windows(2).all(|pair| (pair[1] - pair[0] - 10_000).abs() < 50), "{:?}", bins.edges_us);
        // Between the last step up and the first one down, a little after the middle of those.
        assert!(bins.edges_us.iter().all(|t| (2000..6000).contains(&t.rem_euclid(10_000))), "{:?}", bins.edges_us);
        assert!((97..=100).contains(&bins.len()) && bins.per_interval == 50, "{} {}", bins.len(), bins.per_interval);
        let (camera, earl) = (&dataset.manifest.cameras[0], earl(false));
        let mut counter =
            EventCounter::new(0, camera, &bins, &earl, true, None).expect("memory").expect("an event camera");
        counter.add(&events).expect("memory");
        let view = counter.finish().expect("memory");
        for (from, to) in [(0, 1), (3, 30), (0, 96)] {
            for (pixel, count) in view.between(from, to).expect("memory").into_iter().enumerate() {
                let brighter = if (pixel, to) == (9 * 20 + 3, 96) { 5.0 } else { 0.0 };
                assert!((count - brighter).abs() < 0.25, "{count} at {pixel} from {from} to {to}");
            }
        }
    }

    #[test]
    fn what_leaks_is_taken_away_as_time_goes_on() {
        let mut camera = camera();
        (camera.intrinsics.width, camera.intrinsics.height) = (20, 20);
        // A leak a millisecond at each pixel, and a step of five up and down at a few.
        let mut events = Events::new(20, 20);
        for t_us in (500..50_000).step_by(1000) {
            (0..400).for_each(|at| events.push(Event { t_us, x: at % 20, y: at / 20, on: true }));
            let caused = [(10_500, true), (30_500, false)].into_iter().find(|(when, _)| *when == t_us);
            if let Some((_, on)) = caused {
                (0..5).for_each(|_| events.push(Event { t_us, x: 3, y: 0, on }));
            }
        }
        let view = seen(&camera, &events, &earl(false)).expect("an event camera");
        assert!(
            (view.drift - 50.0).abs() < 1e-6 && view.measured_ratio.is_none(),
            "{} {:?}",
            view.drift,
            view.measured_ratio
        );
        for (to, seen) in [(1, 0.0), (2, 5.0), (3, 5.0), (4, 0.0), (5, 0.0)] {
            let counts = view.between(0, to).expect("memory");
            assert!(counts[0].abs() < 0.01 && (counts[3] - seen).abs() < 0.01, "{to}: {} {}", counts[0], counts[3]);
        }
        assert!(view.activity(0, 1, false).expect("memory")[0] > 9.0, "what moved is told by the events themselves");
    }
}
