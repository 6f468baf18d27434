//! The one writer of all importers.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use serde_json::json;

use super::{
    ImportError, ImportOptions, Imported,
    common::{FileFrame, Frames, SourceView, frame_time},
};
use crate::{Camera, Dataset, DatasetError, Frame, Manifest, Provenance, layout};
use erfgs_base::progress::{Progress, in_parallel};
use erfgs_scene::{
    ImageGrey8, ImageRgb8, Intrinsics, Modality,
    image::{self, FEW_BITS, Resample},
    ply::PointCloud,
    video::Video,
};

/// All that an importer found out.
pub(super) struct SourceRecording<'a> {
    /// The importer's name, as in [`Provenance::importer`].
    pub(super) importer: &'static str,
    pub(super) source: &'a Path,
    pub(super) views: Vec<SourceView>,
    /// Whether images may be larger or smaller than the intrinsics say, which are then resized to them.
    pub(super) any_size: bool,
    /// Frames a second.
    pub(super) fps: f64,
    /// The initial points that the source has, and how they were made.
    pub(super) points: Option<(PointCloud, &'static str)>,
    /// What was left out or should be known, a sentence for each.
    pub(super) notes: Vec<String>,
}

/// What one thread does at a time.
enum Task {
    File { view: usize, frame: usize },
    Video { view: usize },
}

/// Writes the dataset into a folder beside `out`, which becomes `out` once it is whole.
pub(super) fn write(
    recording: SourceRecording,
    options: &ImportOptions,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Imported, ImportError> {
    let scale = options.scale.unwrap_or(1.0);
    if !(scale > 0.0 && scale <= 16.0) {
        return Err(ImportError::Options(format!("--scale {scale} makes no image; give a fraction such as 0.5")));
    }
    let building = DatasetError::new_folder(out)?;

    let targets: Vec<Target> =
        recording.views.iter().map(|view| Target::of(view, recording.any_size, scale)).collect::<Result<_, _>>()?;
    let tasks = recording.views.iter().enumerate().flat_map(|(view, source)| match &source.frames {
        Frames::Files(files) => (0..files.len()).map(|frame| Task::File { view, frame }).collect(),
        Frames::Video { .. } => vec![Task::Video { view }],
    });
    let largest = AtomicU32::new(0);
    let write = |task: &Task, tick: &dyn Fn()| -> Result<usize, ImportError> {
        match *task {
            Task::File { view, frame } => {
                let source = &recording.views[view];
                let Frames::Files(files) = &source.frames else { return Ok(0) };
                let most = write_file(source, &targets[view], &files[frame], frame, building.path(), options)?;
                largest.fetch_max(most.unwrap_or(0).into(), Relaxed);
                tick();
                Ok(1)
            }
            Task::Video { view } => {
                let (frames, most) =
                    write_video(&recording.views[view], &targets[view], building.path(), options, tick)?;
                largest.fetch_max(most.unwrap_or(0).into(), Relaxed);
                Ok(frames)
            }
        }
    };
    let total = total(&recording.views);
    let counts = in_parallel(options.jobs, &tasks.collect::<Vec<_>>(), ("frames", total), write, progress)?;

    check_depth(&recording, options, largest.into_inner())?;
    let mut cameras = Vec::new();
    let mut counts = counts.into_iter();
    for (view, target) in recording.views.iter().zip(&targets) {
        let frames = match &view.frames {
            Frames::Files(files) => {
                counts.by_ref().take(files.len()).for_each(drop);
                files
                    .iter()
                    .enumerate()
                    .map(|(index, file)| frame(view, index, file.t_ns, file.mask.is_some()))
                    .collect()
            }
            Frames::Video { path, first, times, .. } => {
                let count = counts.next().unwrap_or(0);
                let timed = |index| {
                    let t_ns = times.since(*first, *first + index as u64).ok_or_else(|| ImportError::Camera {
                        camera: view.name.clone(),
                        path: path.clone(),
                        what: format!("it has {count} frames and says times of fewer; give their rate with --fps"),
                    })?;
                    Ok(frame(view, index, t_ns, false))
                };
                (0..count).map(timed).collect::<Result<_, ImportError>>()?
            }
        };
        cameras.push(Camera {
            name: view.name.clone(),
            modality: Modality::Rgb,
            split: view.split,
            intrinsics: target.intrinsics,
            world_to_camera: view.pose,
            pose_sigma: None,
            clock_sigma_s: None,
            frames,
            events: None,
        });
    }
    check_counts(&recording, &cameras)?;
    let mut dataset = Dataset::new(building.path(), manifest(&recording, cameras, options));
    if let Some((points, method)) = &recording.points {
        dataset.set_points(points, method, BTreeMap::new())?;
    }
    Ok(Imported { dataset: dataset.complete(building, out)?, notes: recording.notes })
}

/// How large the images of a view are and shall be.
struct Target {
    /// Size of the source's images.
    source: [u32; 2],
    /// Intrinsics of the imported images.
    intrinsics: Intrinsics,
}

impl Target {
    fn of(view: &SourceView, any_size: bool, scale: f64) -> Result<Self, ImportError> {
        let (path, source) = match &view.frames {
            Frames::Files(files) => {
                let Some(first) = files.first() else {
                    let what = "the camera has no frames; choose frames that exist".to_owned();
                    return Err(ImportError::Options(format!("camera {}: {what}", view.name)));
                };
                let size = image::size(&first.image)
                    .map_err(|source| ImportError::Image { camera: view.name.clone(), source })?;
                (&first.image, size)
            }
            Frames::Video { path, .. } => {
                let video = |source| ImportError::Video { camera: view.name.clone(), source };
                let first = Video::open(path).map_err(video)?.next_frame().map_err(video)?;
                let Some(first) = first else {
                    let what = "the video holds no frame; copy it again".to_owned();
                    return Err(ImportError::Camera { camera: view.name.clone(), path: path.clone(), what });
                };
                (path, [first.width, first.height])
            }
        };
        let named = [view.intrinsics.width, view.intrinsics.height].map(f64::from);
        let ratio = f64::from(source[0]) / f64::from(source[1].max(1)) * named[1] / named[0];
        let fits = if any_size { (ratio - 1.0).abs() < 0.01 } else { source.map(f64::from) == named };
        if !fits {
            return Err(size_error(&view.name, path, source, named.map(|length| length as u32)));
        }
        let [width, height] = source.map(|length| ((f64::from(length) * scale).round() as u32).max(1));
        Ok(Self { source, intrinsics: view.intrinsics.resized(width, height) })
    }

    fn resize(&self, image: ImageRgb8, how: Resample) -> ImageRgb8 {
        image.resized(self.intrinsics.width, self.intrinsics.height, how)
    }
}

fn size_error(camera: &str, path: &Path, found: [u32; 2], named: [u32; 2]) -> ImportError {
    let what = format!(
        "the image has {} x {} pixels, but the camera {} x {}; correct the calibration or the images",
        found[0], found[1], named[0], named[1]
    );
    ImportError::Camera { camera: camera.to_owned(), path: path.to_owned(), what }
}

fn frame(view: &SourceView, index: usize, t_ns: i64, mask: bool) -> Frame {
    let mask = mask.then(|| layout::mask(&view.name, index));
    Frame { file: layout::image(&view.name, index), t_ns, exposure_ns: [t_ns, t_ns], mask }
}

fn write_file(
    view: &SourceView,
    target: &Target,
    file: &FileFrame,
    index: usize,
    root: &Path,
    options: &ImportOptions,
) -> Result<Option<u16>, ImportError> {
    let broken = |source| ImportError::Image { camera: view.name.clone(), source };
    let (image, most) = ImageRgb8::read_as(&file.image, options.reading).map_err(broken)?;
    let size = [image.width, image.height];
    if size != target.source {
        return Err(size_error(&view.name, &file.image, size, target.source));
    }
    target.resize(image, options.resample).write_png(&root.join(layout::image(&view.name, index))).map_err(broken)?;
    if let Some(path) = &file.mask {
        let mask = ImageGrey8::read(path).map_err(broken)?;
        let size = [mask.width, mask.height];
        if size != target.source {
            return Err(size_error(&view.name, path, size, target.source));
        }
        let mask = white(mask).resized(target.intrinsics.width, target.intrinsics.height, Resample::Area);
        mask.binarised().write_png(&root.join(layout::mask(&view.name, index))).map_err(broken)?;
    }
    Ok(most)
}

/// Refuses a recording whose samples of 16 bits all stay so small that the upper bits may not count. `largest` is the largest of
/// all its frames, 0 where none has 16 bits.
fn check_depth(recording: &SourceRecording, options: &ImportOptions, largest: u32) -> Result<(), ImportError> {
    if options.reading.bits.is_some() || largest == 0 || largest >= FEW_BITS.into() {
        return Ok(());
    }
    let what = format!(
        "its images have samples of 16 bits, and the largest is {largest}: either fewer bits count, or all of them are nearly black; say \
         how many with --bits (10 or 12 for most cameras, 16 if all count)"
    );
    Err(ImportError::Malformed { path: recording.source.to_owned(), what })
}

/// A mask of 0 and 255, whether it was written as 0 and 1 or as 0 and 255.
fn white(mut mask: ImageGrey8) -> ImageGrey8 {
    let largest = mask.data.iter().copied().max().unwrap_or(0);
    mask.data.iter_mut().for_each(|value| *value = if *value > largest / 2 { 255 } else { 0 });
    mask
}

/// Writes the frames of a video and returns how many there were, and the largest sample where these have 16 bits.
fn write_video(
    view: &SourceView,
    target: &Target,
    root: &Path,
    options: &ImportOptions,
    tick: &dyn Fn(),
) -> Result<(usize, Option<u16>), ImportError> {
    let Frames::Video { path, first, last, .. } = &view.frames else { return Ok((0, None)) };
    let broken = |source| ImportError::Video { camera: view.name.clone(), source };
    let mut video = Video::open_as(path, options.reading.bits).map_err(broken)?;
    let (mut number, mut written) = (0, 0);
    while last.is_none_or(|last| number <= last) {
        let Some(image) = video.next_frame().map_err(broken)? else { break };
        number += 1;
        if number <= *first {
            continue;
        }
        let path = root.join(layout::image(&view.name, written));
        let write = |source| ImportError::Image { camera: view.name.clone(), source };
        target.resize(image, options.resample).write_png(&path).map_err(write)?;
        written += 1;
        tick();
    }
    match last {
        Some(last) if number <= *last => Err(ImportError::Camera {
            camera: view.name.clone(),
            path: path.clone(),
            what: format!(
                "the frames {first}..{last} were asked for, but the video has {number} (0..{})",
                number.max(1) - 1
            ),
        }),
        _ => Ok((written, video.largest())),
    }
}

/// How many frames there will be. A video's length is known once it has been read; until then the total is 0.
fn total(views: &[SourceView]) -> u64 {
    let known = views.iter().map(|view| match &view.frames {
        Frames::Files(files) => Some(files.len() as u64),
        Frames::Video { first, last, .. } => last.map(|last| (last - first).saturating_add(1)),
    });
    known.sum::<Option<u64>>().unwrap_or(0)
}

/// Cameras of one recording film together, so that all have as many frames as the first, where times are shared.
fn check_counts(recording: &SourceRecording, cameras: &[Camera]) -> Result<(), ImportError> {
    let Some(first) = cameras.first() else {
        let what = "there are no cameras".to_owned();
        return Err(ImportError::Malformed { path: recording.source.to_owned(), what });
    };
    for (camera, view) in cameras.iter().zip(&recording.views) {
        let Frames::Video { path, .. } = &view.frames else { continue };
        if camera.frames.len() != first.frames.len() {
            let what = format!(
                "the video has {} frames, but that of camera {} has {}; import the frames that all have with --frames 0..{}",
                camera.frames.len(),
                first.name,
                first.frames.len(),
                camera.frames.len().min(first.frames.len()).max(1) - 1
            );
            return Err(ImportError::Camera { camera: camera.name.clone(), path: path.clone(), what });
        }
    }
    Ok(())
}

fn manifest(recording: &SourceRecording, cameras: Vec<Camera>, options: &ImportOptions) -> Manifest {
    let name = std::path::absolute(recording.source).ok();
    let name = name.as_deref().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    let resample = match options.resample {
        Resample::Area => "area",
        Resample::Lanczos => "lanczos",
    };
    let mut given: BTreeMap<String, serde_json::Value> = BTreeMap::new();
    given.insert("fps".to_owned(), json!(recording.fps));
    given.extend(options.frames.map(|(first, last)| ("frames".to_owned(), json!([first, last]))));
    if let Some(scale) = options.scale {
        given.insert("scale".to_owned(), json!(scale));
        given.insert("resample".to_owned(), json!(resample));
    }
    given.extend(options.test_cameras.as_ref().map(|names| ("test_cameras".to_owned(), json!(names))));
    let times = || cameras.iter().flat_map(|camera| camera.frames.iter().map(|frame| frame.t_ns));
    let (first, last) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
    // A single instant has no length; it is given that of one frame.
    let last = if last > first { last } else { first + frame_time(1, recording.fps).max(1) };
    Manifest {
        format: Manifest::FORMAT.to_owned(),
        version: Manifest::VERSION,
        name: name.clone(),
        provenance: Provenance {
            importer: recording.importer.to_owned(),
            name,
            options: given,
            zero_ns: None,
            erfgs: env!("CARGO_PKG_VERSION").to_owned(),
        },
        span_ns: [first, last],
        seed: 0,
        linear_exposure: false,
        variant: Vec::new(),
        points: None,
        bodies: None,
        cameras,
        sha256: BTreeMap::new(),
    }
}
