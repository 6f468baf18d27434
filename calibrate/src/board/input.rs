//! The frames in which boards are looked for.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_scene::{
    ImageRgb8,
    image::ImageError,
    video::{FrameTimes, Video, VideoError},
};
use rayon::prelude::*;

use super::{
    BoardError, Corner, EventBoard, Plate,
    layout::{Input, TIMES, cameras, list},
    stream::of_events,
};
use crate::evidence::Moment;

/// A frame in which the board was found.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardView {
    /// What frames of other cameras taken at the same instant are called, too.
    pub instant: String,
    /// When it was taken, seconds, where that is known.
    pub time_s: Option<f64>,
    /// The image, the video, the events or the session.
    pub file: PathBuf,
    /// Which frame of it: the number from 0 in a video, the packet's in a session's stream, in events the end of the time that
    /// was looked at, microseconds.
    pub frame: u64,
    /// The corners of the board that were found, of one side: their numbers on it ([`Plate::point`]), and pixels.
    pub corners: Vec<Corner>,
}

impl BoardView {
    /// When it was taken.
    #[must_use]
    pub fn moment(&self) -> Moment {
        Moment { name: self.instant.clone(), t_ns: self.time_s.map(|seconds| (1e9 * seconds).round() as i64) }
    }
}

/// The boards that one camera saw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardDetections {
    /// The camera's name.
    pub camera: String,
    /// Whether the board was found in events, and not in frames.
    pub events: bool,
    /// Width and height of its frames, pixels.
    pub size: [u32; 2],
    /// Number of frames that were looked at.
    pub frames: usize,
    /// Those with a board, in order.
    pub views: Vec<BoardView>,
    /// Pictures that could not be read: how many, and what is wrong with the first one.
    pub unreadable: Option<(usize, String)>,
    /// What was looked at: a folder of pictures, a video, a file of events or a session.
    pub source: PathBuf,
    /// Frames in whose mirror image the board was found and not in themselves, of how many that were looked at in this way.
    pub mirrored: [usize; 2],
}

impl BoardDetections {
    /// The board is seen too rarely: `usable` views show enough of it, and `needed` are needed.
    pub(super) fn too_few(&self, plate: &Plate, usable: usize, needed: usize) -> BoardError {
        BoardError::TooFewViews {
            camera: self.camera.clone(),
            path: self.source.clone(),
            seen: self.views.len(),
            usable,
            hint: self.mirror_hint(plate).map(|hint| hint + ". ").unwrap_or_default().into(),
            frames: self.frames,
            needed,
            target: plate.to_string(),
        }
    }

    /// What the mirror images tell, where the board is not known to be clear.
    #[must_use]
    pub fn mirror_hint(&self, plate: &Plate) -> Option<String> {
        let [found, tried] = self.mirrored;
        (found > 0 && !plate.is_clear()).then(|| {
            format!(
                "in the mirror image the board is found in {found} of {tried} frames that do not show it: say --clear if it is clear and \
                 seen from behind, or record without mirroring if the camera's program mirrors its pictures"
            )
        })
    }
}

/// Looks for a board in all frames below `folder`: for each camera a folder of images or with a video, or a video, or images
/// whose names begin with the camera's name (`layout.rs` says what cameras are called and which images belong together).
/// Pictures that cannot be read are counted. A file `timestamps.csv` with the columns `cam_id` (or `camera`), `frame_time`
/// (seconds) and `sync_index` says which frames of videos belong together; without it the n-th frames do. A file of events
/// for a camera is searched for what `events` says. `progress` gets the
/// number of frames that were looked at and, where it is known, that of all.
///
/// # Errors
/// If nothing is found to look at, or a file cannot be read.
pub fn look(
    folder: &Path,
    plate: impl Into<Plate>,
    events: Option<EventBoard>,
    progress: &(dyn Fn(usize, Option<usize>) + Sync),
) -> Result<Vec<BoardDetections>, BoardError> {
    let plate = &plate.into();
    let cameras = cameras(folder, events.is_some())?;
    if cameras.is_empty() {
        return Err(BoardError::NoImages { path: folder.into(), holds: holds(folder)? });
    }
    let times = Times::read(&folder.join(TIMES))?;
    let count = |input: &Input| match input {
        Input::Images(images) => Some(images.len()),
        Input::Video(path) => Some(usize::try_from(Video::probe(path)?.frames).unwrap_or(usize::MAX)),
        Input::Events(_) => None,
    };
    let counts: Vec<Option<usize>> = cameras.iter().map(|(_, input)| count(input)).collect();
    let total = counts.iter().try_fold(0, |sum: usize, count| Some(sum.saturating_add((*count)?)));
    let done = std::sync::atomic::AtomicUsize::new(0);
    let tick = || progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, total);
    cameras
        .into_iter()
        .zip(counts)
        .map(|((camera, input), count)| match input {
            Input::Images(ref images) => of_images(&camera, images, &input.source(), plate, &tick),
            Input::Events(path) => {
                let board = events.ok_or_else(|| BoardError::NoBlink { path: path.clone() })?;
                of_events(&camera, &path, plate, board, &tick)
            }
            Input::Video(path) => of_video(&camera, (&path, count), times.as_ref(), plate, &tick),
        })
        .collect()
}

/// A picture that was looked at.
struct Looked {
    size: [u32; 2],
    view: BoardView,
    /// See [`Mirrors::look`].
    mirrored: Option<bool>,
}

fn of_images(
    camera: &str,
    images: &[(String, PathBuf)],
    source: &Path,
    plate: &Plate,
    tick: &(dyn Fn() + Sync),
) -> Result<BoardDetections, BoardError> {
    let mirrors = Mirrors::of(Some(images.len()));
    let looked: Vec<Result<Looked, ImageError>> = images
        .par_iter()
        .enumerate()
        .map(|(number, (instant, file))| {
            let image = ImageRgb8::read(file);
            tick();
            let image = image?;
            let corners = plate.detect(&image);
            let mirrored = mirrors.look(number, &image, &corners, plate);
            let view = BoardView { instant: instant.clone(), time_s: None, file: file.clone(), frame: 0, corners };
            Ok(Looked { size: [image.width, image.height], view, mirrored })
        })
        .collect();
    let (mut views, mut failed): (Vec<Looked>, Vec<ImageError>) = (Vec::new(), Vec::new());
    for looked in looked {
        match looked {
            Ok(looked) => views.push(looked),
            Err(error) => failed.push(error),
        }
    }
    let unreadable = failed.first().map(|error| (failed.len(), error.to_string()));
    if views.is_empty()
        && let Some(error) = failed.into_iter().next()
    {
        return Err(error.into());
    }
    let size = views.first().map_or([0, 0], |looked| looked.size);
    let mut mirrored = [0; 2];
    for looked in &views {
        if looked.size != size {
            let (camera, path) = (camera.into(), looked.view.file.clone());
            return Err(BoardError::Size { camera, path, found: looked.size, expected: size });
        }
        count_mirrored(&mut mirrored, looked.mirrored);
    }
    let frames = views.len();
    let views = views.into_iter().map(|looked| looked.view).filter(|view| !view.corners.is_empty()).collect();
    let source = source.to_owned();
    Ok(BoardDetections { camera: camera.into(), events: false, size, frames, views, unreadable, source, mirrored })
}

fn of_video(
    camera: &str,
    (path, count): (&Path, Option<usize>),
    times: Option<&Times>,
    plate: &Plate,
    tick: &(dyn Fn() + Sync),
) -> Result<BoardDetections, BoardError> {
    /// Frames that are decoded before they are looked at together.
    const BATCH: usize = 16;
    let mut video = Video::open(path)?;
    let labels = times.and_then(|times| times.of(camera));
    // Without a table, frames come when the video says: enough to find out that cameras do not run together.
    let shown = if labels.is_none() { FrameTimes::of(path) } else { None };
    let nominal = |number: usize| shown.as_ref()?.since(0, number as u64).map(|ns| ns as f64 * 1e-9);
    let (mut size, mut frames, mut views) = ([0, 0], 0, Vec::new());
    let (mirrors, mut mirrored) = (Mirrors::of(count), [0; 2]);
    let mut broken: Option<VideoError> = None;
    while broken.is_none() {
        let mut batch: Vec<(usize, ImageRgb8)> = Vec::new();
        while batch.len() < BATCH {
            match video.next_frame() {
                Ok(Some(image)) => batch.push((frames + batch.len(), image)),
                Ok(None) => break,
                // What came before the damage is as good as ever.
                Err(error) if frames + batch.len() > 0 => {
                    broken = Some(error);
                    break;
                }
                Err(error) => return Err(error.into()),
            }
        }
        if batch.is_empty() {
            break;
        }
        frames += batch.len();
        size = [batch[0].1.width, batch[0].1.height];
        let found: Vec<(BoardView, Option<bool>)> = batch
            .par_iter()
            .map(|(number, image)| {
                let label = labels.and_then(|labels| labels.get(*number));
                let instant = label.map_or_else(|| number.to_string(), |(instant, _)| instant.clone());
                let (time_s, corners) = (label.map(|l| l.1).or_else(|| nominal(*number)), plate.detect(image));
                let view = BoardView { instant, time_s, file: path.into(), frame: *number as u64, corners };
                tick();
                let mirrored = mirrors.look(*number, image, &view.corners, plate);
                (view, mirrored)
            })
            .collect();
        found.iter().for_each(|(_, mirror)| count_mirrored(&mut mirrored, *mirror));
        views.extend(found.into_iter().map(|(view, _)| view).filter(|view| !view.corners.is_empty()));
    }
    let unreadable = broken.map(|error| (1, error.to_string()));
    let source = path.to_owned();
    Ok(BoardDetections { camera: camera.into(), events: false, size, frames, views, unreadable, source, mirrored })
}

/// In which frames that show no board its mirror image is looked for.
pub(super) struct Mirrors {
    every: usize,
}

impl Mirrors {
    /// Of so many frames in all, where that is known: in some, evenly spread, as each takes as long as the frame itself.
    pub fn of(frames: Option<usize>) -> Self {
        const MOST: usize = 60;
        const UNKNOWN: usize = 30;
        Self { every: frames.map_or(UNKNOWN, |frames| frames.div_ceil(MOST).max(1)) }
    }

    /// Whether the board is in the mirror image of a frame; `None` where that was not looked at.
    pub fn look(&self, number: usize, image: &ImageRgb8, corners: &[Corner], plate: &Plate) -> Option<bool> {
        (corners.is_empty() && number.is_multiple_of(self.every)).then(|| plate.is_mirrored_in(image)).flatten()
    }
}

/// Adds a frame to those in whose mirror image the board was found, and to those that were looked at.
pub(super) fn count_mirrored([found, tried]: &mut [usize; 2], mirror: Option<bool>) {
    *tried += usize::from(mirror.is_some());
    *found += usize::from(mirror == Some(true));
}

/// The first names in a folder, for the user who expected something else there.
fn holds(folder: &Path) -> Result<String, BoardError> {
    const SHOWN: usize = 8;
    let names: Vec<String> = list(folder)?
        .iter()
        .map(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let name: String = name.escape_debug().take(40).collect();
            if path.is_dir() { format!("{name}/") } else { name }
        })
        .collect();
    Ok(match names.len() {
        0 => " (it is empty)".into(),
        count if count > SHOWN => format!(" (it holds {} and {} more)", names[..SHOWN].join(", "), count - SHOWN),
        _ => format!(" (it holds {})", names.join(", ")),
    })
}

/// The times of videos' frames: by camera, in the order of the frames, the instant and the time in seconds.
struct Times(BTreeMap<String, Vec<(String, f64)>>);

impl Times {
    fn read(path: &Path) -> Result<Option<Self>, BoardError> {
        if !path.exists() {
            return Ok(None);
        }
        let error = |what: String| BoardError::Times { path: path.into(), what };
        let text = erfgs_base::text::read(path).map_err(|source| error(format!("it cannot be read: {source}")))?;
        let mut lines = text.lines();
        let head: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
        let column = |names: &[&str]| {
            head.iter()
                .position(|name| names.contains(name))
                .ok_or_else(|| error(format!("its first line names no column {}", names.join(" or "))))
        };
        let (camera, time) = (column(&["cam_id", "camera"])?, column(&["frame_time"])?);
        let instant = column(&["sync_index"])?;
        let mut cameras: BTreeMap<String, Vec<(String, f64)>> = BTreeMap::new();
        for (number, line) in lines.enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let seconds = cells.get(time).and_then(|cell| cell.parse::<f64>().ok()).filter(|t| t.is_finite());
            let (Some(camera), Some(seconds), Some(instant)) = (cells.get(camera), seconds, cells.get(instant)) else {
                return Err(error(format!("line {}: it has no camera, time and instant", number + 2)));
            };
            cameras.entry((*camera).to_owned()).or_default().push(((*instant).to_owned(), seconds));
        }
        cameras.values_mut().for_each(|frames| frames.sort_by(|a, b| a.1.total_cmp(&b.1)));
        Ok(Some(Self(cameras)))
    }

    /// The frames of a camera, which the file calls by its name or by the number at its end.
    fn of(&self, camera: &str) -> Option<&Vec<(String, f64)>> {
        let number = camera.trim_start_matches(|c: char| !c.is_ascii_digit());
        self.0.get(camera).or_else(|| self.0.get(number))
    }
}
