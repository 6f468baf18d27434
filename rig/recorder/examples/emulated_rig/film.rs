//! The stage, filmed once: what the sensors and cameras see is kept in a folder, and read from there the next time.

use std::{
    env,
    error::Error,
    fs,
    io::{IsTerminal, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use erfgs_base::atomic;
use erfgs_events::{Events, npz};
use erfgs_scene::image::jpeg;
use erfgs_stage::{EventOptions, RigOptions, Stage, StageOptions, StageView, events::record, film::image};

/// Counts what changes the films, so that old ones are not taken for new ones.
const VERSION: u32 = 1;

/// Where the stage is filmed from.
#[derive(Clone, Copy)]
pub struct Place {
    /// What it is called, in messages and files.
    pub name: &'static str,
    /// Cameras of the rig: RGB and event cameras.
    pub rig: [usize; 2],
    /// Which of them.
    pub index: usize,
    /// Columns and rows.
    pub size: [u32; 2],
}

/// Films that are kept, and the folder that they are kept in.
pub struct Films {
    folder: PathBuf,
    stage: Stage,
}

impl Films {
    /// Films kept below the user's cache, or where `ERFGS_FILMS` says.
    pub fn open() -> Result<Self, Box<dyn Error>> {
        let cache = || Some(PathBuf::from(env::var_os("XDG_CACHE_HOME")?));
        let home = || Some(PathBuf::from(env::var_os("HOME")?).join(".cache"));
        let folder = match env::var_os("ERFGS_FILMS") {
            Some(folder) => PathBuf::from(folder),
            None => cache().or_else(home).unwrap_or_else(env::temp_dir).join("erfgs/emulated-rig"),
        };
        fs::create_dir_all(&folder)?;
        let stage = Stage::new(StageOptions { samples_per_axis: 1, ..StageOptions::default() });
        Ok(Self { folder, stage })
    }

    /// Where the films are.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn view(&self, place: &Place) -> Result<StageView<'_>, Box<dyn Error>> {
        let [width, height] = place.size;
        let [rgb, event] = place.rig;
        let cameras = RigOptions { width, height, rgb, event, test: 0, ..RigOptions::default() }.cameras(1)?;
        let camera = &cameras[place.index];
        Ok(StageView::new(&self.stage, &camera.intrinsics, &camera.world_to_camera)?)
    }

    /// The events of a sensor at `place` over so many microseconds.
    pub fn events(
        &self,
        place: &Place,
        length_us: u64,
        options: &EventOptions,
        stream: u64,
    ) -> Result<Arc<Events>, Box<dyn Error>> {
        let [width, height] = place.size;
        let thresholds = format!("{}-{}", options.threshold_on, options.threshold_off);
        let name = format!("v{VERSION}-{}-{width}x{height}-{length_us}us-{thresholds}.npz", place.name);
        let path = self.folder.join(name);
        // A film that does not read is filmed anew.
        if let Ok(events) = npz::read_events(&path, None) {
            return Ok(Arc::new(events));
        }
        let view = self.view(place)?;
        let shown = Shown::new(place.name);
        let end_ns = i64::try_from(length_us.saturating_mul(1000))?;
        let events = record(&view, [0, end_ns], options, 1, stream, &|share| shown.share(share))?;
        shown.done();
        npz::write_events(&path, &events)?;
        Ok(Arc::new(events))
    }

    /// So many JPEG pictures of a camera at `place`, `period_ns` apart, each exposed for `exposure_ns`.
    pub fn pictures(
        &self,
        place: &Place,
        count: usize,
        period_ns: i64,
        exposure_ns: i64,
    ) -> Result<Vec<Vec<u8>>, Box<dyn Error>> {
        let [width, height] = place.size;
        let path = |number: usize| {
            let name = place.name;
            self.folder.join(format!("v{VERSION}-{name}-{width}x{height}-{period_ns}-{exposure_ns}-{number}.jpg"))
        };
        let kept: Result<Vec<Vec<u8>>, _> = (0..count).map(|number| fs::read(path(number))).collect();
        if let Ok(kept) = kept {
            return Ok(kept);
        }
        let view = self.view(place)?;
        let shown = Shown::new(place.name);
        let picture = |number: usize| -> Result<Vec<u8>, Box<dyn Error>> {
            let start = number as i64 * period_ns;
            let picture = image(&view, &view.exposure([start, start + exposure_ns], 3));
            let jpeg = jpeg(&picture.data, picture.width, picture.height, 90).ok_or("a picture without pixels")?;
            atomic::write(&path(number), &jpeg)?;
            shown.share((number + 1) as f64 / count as f64);
            Ok(jpeg)
        };
        let pictures = (0..count).map(picture).collect();
        shown.done();
        pictures
    }
}

/// A line that says how far the filming is.
struct Shown {
    name: &'static str,
    last: Mutex<(Option<Instant>, u32)>,
    is_terminal: bool,
}

impl Shown {
    fn new(name: &'static str) -> Self {
        let shown = Self { name, last: Mutex::new((None, 0)), is_terminal: std::io::stderr().is_terminal() };
        shown.share(0.0);
        shown
    }

    fn share(&self, share: f64) {
        let percent = (100.0 * share.clamp(0.0, 1.0)) as u32;
        let Ok(mut last) = self.last.lock() else { return };
        // On a terminal one line that moves; elsewhere one every quarter.
        if self.is_terminal {
            if last.0.is_some_and(|at| at.elapsed() < Duration::from_millis(200)) {
                return;
            }
            eprint!("\r\x1b[2Kfilming the stage, which is kept for the next time: {} {percent} %", self.name);
            let _ = std::io::stderr().flush();
        } else if last.0.is_none() || percent / 25 > last.1 / 25 {
            eprintln!("filming the stage: {} {percent} %", self.name);
        } else {
            return;
        }
        *last = (Some(Instant::now()), percent);
    }

    fn done(&self) {
        if self.is_terminal {
            eprint!("\r\x1b[2K");
        }
    }
}
