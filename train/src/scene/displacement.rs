//! How far things go from one frame to the next, before anything is trained.

use erfgs_dataset::{Camera, Dataset, DatasetError, Split};
use glam::{DVec3, Vec3};

use super::load::period_ns;
use crate::start::birth;

/// Points of an instant that are followed, at most: enough to know how fast the fast ones are.
const FOLLOWED: usize = 400;
/// The share of the points that are slower than what counts: few things are fast, and they are what is hard.
const SLOWER: f64 = 0.95;

/// How things move, as the points tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Moves {
    /// How far what moves fastest goes from one frame to the next, as a share of the width of the training cameras' pictures.
    pub displacement: f64,
    /// How much a velocity changes from one frame to the next, as a share of the speed, in the median ([`birth::Way::bend`]); where
    /// any point was found in three frames.
    pub bend: Option<f64>,
}

/// How things move; `None` where no points are known to move, or no camera has two frames. Nothing is faster than `fastest`, metres an
/// interval.
///
/// # Errors
/// [`DatasetError`] where the manifest tells the instants of its points in a way that cannot be, or their file is damaged.
pub(crate) fn moves(dataset: &Dataset, fastest: f32) -> Result<Option<Moves>, DatasetError> {
    let Some(runs) = dataset.point_runs()? else { return Ok(None) };
    let Some((period_ns, cloud)) = period_ns(dataset).zip(dataset.read_points()?) else { return Ok(None) };
    let mut points = Vec::new();
    let mut first = 0;
    for run in &runs {
        let count = run.count as usize;
        if run.moving {
            let step = count.div_ceil(FOLLOWED).max(1);
            let time = run.t_ns as f64 / period_ns;
            points.extend(
                (first..first + count).step_by(step).map(|at| ((cloud.positions[at], cloud.colours[at]), time)),
            );
        }
        first += count;
    }
    let cameras: Vec<&Camera> = dataset.cameras(Split::Train).filter(|camera| !camera.frames.is_empty()).collect();
    let share = |way: &birth::Way| {
        let place = Vec3::from(way.place).as_dvec3();
        let scales: Vec<f64> = cameras.iter().filter_map(|camera| widths_a_metre(camera, place)).collect();
        (!scales.is_empty()).then(|| f64::from(way.speed) * scales.iter().sum::<f64>() / scales.len() as f64)
    };
    let ways = birth::ways(&points, fastest);
    let displacement = quantile(ways.iter().filter_map(share).collect(), SLOWER);
    let bend = quantile(ways.iter().filter_map(|way| way.bend.map(f64::from)).collect(), 0.5);
    Ok(displacement.map(|displacement| Moves { displacement, bend }))
}

/// The value that a share of all are below.
fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let at = ((share * values.len() as f64) as usize).min(values.len().saturating_sub(1));
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// The share of the time during which a training camera exposes, in the mean; 0 where no camera has two frames.
pub(crate) fn exposed(dataset: &Dataset) -> f64 {
    let Some(period_ns) = period_ns(dataset) else { return 0.0 };
    let frames = dataset.cameras(Split::Train).flat_map(|camera| &camera.frames);
    let (sum, count) = frames.fold((0.0, 0), |(sum, count), frame| {
        let [start, end] = frame.exposure_ns;
        (sum + (end.saturating_sub(start) as f64 / period_ns).clamp(0.0, 1.0), count + 1)
    });
    sum / f64::from(count.max(1))
}

/// How many widths of the picture a metre across the view is at a place; `None` behind the camera.
fn widths_a_metre(camera: &Camera, place: DVec3) -> Option<f64> {
    let depth = camera.world_to_camera.transform(place).z;
    (depth > 1e-6).then(|| camera.intrinsics.fx / (depth * f64::from(camera.intrinsics.width)))
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;
    use erfgs_dataset::{Frame, PointCloudFile, PointRun};
    use erfgs_scene::{PointCloud, Pose};

    use super::*;
    use crate::{
        config::{Config, Guide, MotionModel},
        scene::fixtures,
    };

    /// A camera of 100 px, two metres before a plane that it sees two metres of, and points that go along it and turn by so many degrees
    /// on the way: a fifth of them by `fast` metres an interval, the others by a centimetre.
    fn dataset(root: &std::path::Path, fast: f64, turn: f64, frames: i64) -> Dataset {
        let frame = |index: i64| Frame {
            file: format!("{index}.png").into(),
            t_ns: 50_000_000 * index,
            exposure_ns: [50_000_000 * index; 2],
            mask: None,
        };
        let camera = Camera {
            world_to_camera: Pose { translation: DVec3::Z * 2.0, ..Pose::IDENTITY },
            pose_sigma: None,
            clock_sigma_s: None,
            frames: (0..frames).map(frame).collect(),
            ..fixtures::camera("a", [100, 100], 100.0)
        };
        let mut dataset = fixtures::dataset(root, vec![camera], [0, 1_000_000_000]);
        let mut cloud = PointCloud::default();
        let mut runs = Vec::new();
        for t in 0..3_u32 {
            for point in 0..125_u8 {
                let quick = point < 25;
                let at = |axis: u64| random::range(random::key(7, &[point.into(), axis]), -0.1, 0.1);
                let (speed, colour, aside) =
                    if quick { (fast, [250, 10, 10], 0.9) } else { (0.01, [10, 10, 250], 0.0) };
                let (before, after) = (f64::from(t.min(1)), f64::from(t.saturating_sub(1)));
                let (up, on) = turn.to_radians().sin_cos();
                let place = [speed * (before + after * on) + at(0), aside + speed * after * up + at(1), at(2)];
                cloud.positions.push(place.map(|p| p as f32));
                cloud.colours.push(colour);
            }
            runs.push(PointRun { t_ns: 50_000_000 * i64::from(t), found_again: false, moving: true, count: 125 });
        }
        let parameters = [(PointCloudFile::RUNS.to_owned(), serde_json::json!(runs))].into();
        std::fs::create_dir_all(root).unwrap();
        dataset.set_points(&cloud, "test", parameters).unwrap();
        dataset
    }

    #[test]
    fn what_exposures_miss_decides_what_paths_are_fitted_to() {
        let folder = tempfile::tempdir().unwrap();
        let settled_on = |fast: f64, turn: f64, exposure_ns: i64, set: &[&str]| {
            let mut dataset = dataset(folder.path(), fast, turn, 3);
            for frame in dataset.manifest.cameras.iter_mut().flat_map(|camera| &mut camera.frames) {
                frame.exposure_ns[1] += exposure_ns;
            }
            assert!((exposed(&dataset) - exposure_ns as f64 / 5e7).abs() < 1e-12);
            let mut config = Config { motion: MotionModel::FreeTime, ..Config::default() };
            config.free_time.fastest = 1e3;
            set.iter().for_each(|set| config.set(set).unwrap());
            config.settle(&dataset, false).unwrap();
            config
        };
        let settled = |fast, exposure_ns, set: &[&str]| settled_on(fast, 90.0, exposure_ns, set);
        // A fifth goes 15 % of the width from frame to frame, of which 12 % are unseen, or 0.6 %.
        let (short, long) = (settled(0.3, 10_000_000, &[]), settled(0.3, 48_000_000, &[]));
        assert_eq!((short.free_time.guide, short.free_time.knots), (Guide::Events, 2));
        assert_eq!(long.free_time.guide, Guide::Frames);
        assert_eq!((long.free_time.knots, long.free_time.first_life, long.free_time.least_life), (0, 1.0, 0.5));
        // Straight on, frames tell of it, too, but not of what goes 40 % of the width.
        let straight = settled_on(0.3, 0.0, 10_000_000, &[]);
        assert_eq!(straight.free_time.guide, Guide::Frames);
        // Of what bends events tell more, where there are any.
        let [beside, without] =
            [[].as_slice(), &["earl.enabled=false"]].map(|set| settled_on(0.3, 60.0, 10_000_000, set));
        assert_eq!([beside, without].map(|config| config.free_time.guide), [Guide::Events, Guide::Frames]);
        // Beside frames that tell of paths events count half.
        assert_eq!((short.event_weight(), straight.event_weight()), (short.earl.weight, 0.5 * short.earl.weight));
        let set = settled_on(0.3, 0.0, 10_000_000, &["earl.beside_frames=1"]);
        assert_eq!(set.event_weight(), short.earl.weight);
        assert_eq!(settled_on(0.8, 0.0, 10_000_000, &[]).free_time.guide, Guide::Events);
        // What is set is kept.
        for set in ["free_time.guide=events", "free_time.knots=3", "free_time.first_life=0.6"] {
            let config = settled(0.3, 48_000_000, &[set]);
            assert_eq!(config.free_time.guide, Guide::Events, "{set}");
            assert!(config.free_time.knots >= 2, "{set}");
        }
        assert_eq!(settled(0.3, 10_000_000, &["free_time.guide=frames"]).free_time.knots, 0);
        // Where things go far, lives are short, and some begin between frames, but only with events to tell what is there.
        let lives =
            |config: Config| (config.free_time.first_life, config.free_time.least_life, config.free_time.between);
        assert_eq!(lives(settled(0.3, 10_000_000, &[])), (0.5, 0.25, 0));
        assert_eq!(lives(settled(0.8, 10_000_000, &[])), (0.25, 0.125, 1));
        assert_eq!(lives(settled(0.8, 10_000_000, &["earl.enabled=false"])), (0.5, 0.25, 0));
    }

    #[test]
    fn the_fast_fifth_counts_as_a_share_of_the_width() {
        let folder = tempfile::tempdir().unwrap();
        for fast in [0.05, 0.3] {
            let found = moves(&dataset(folder.path(), fast, 0.0, 3), 10.0).unwrap().unwrap();
            let bent = moves(&dataset(folder.path(), fast, 90.0, 3), 10.0).unwrap().unwrap();
            assert!(found.bend.unwrap() < 0.3 && (1.2..1.6).contains(&bent.bend.unwrap()), "{found:?} {bent:?}");
            let found = found.displacement;
            assert!((found - fast / 2.0).abs() < 0.2 * fast, "{found} of {}", fast / 2.0);
        }
        assert_eq!(moves(&dataset(folder.path(), 0.3, 0.0, 1), 10.0).unwrap(), None, "a single frame");
        assert_eq!(exposed(&dataset(folder.path(), 0.3, 0.0, 1)), 0.0);
        let mut still = dataset(folder.path(), 0.3, 0.0, 3);
        still.manifest.points = None;
        assert_eq!(moves(&still, 10.0).unwrap(), None, "no points");
    }
}
