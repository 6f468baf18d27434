//! Pictures side by side: ground truth, each run, error maps; event frames.

use std::{fmt::Write as _, fs, path::PathBuf};

use image::RgbImage;

use super::{
    html::{self, Escaped, number},
    load::{Run, Scene},
    picture_io::{self, FULL_ERROR},
    plot::swatch,
};
use erfgs_run::{PerView, RunError, RunFolder};

/// A detail shows this share of the width and height.
const DETAIL: u32 = 5;
/// Event frames are shown of so many cameras.
const EVENT_CAMERAS: usize = 4;

/// The worst, median and best shared view.
pub(super) fn views(scene: &mut Scene) -> String {
    let mut body = String::new();
    let mut notes = Vec::new();
    for (what, camera, index) in chosen(scene) {
        match view(scene, &what, &camera, index) {
            Ok(html) => body += &html,
            Err(note) => notes.push(note),
        }
    }
    scene.notes.extend(notes);
    if body.is_empty() {
        return String::new();
    }
    let legend = format!(
        "<p class=\"legend\"><span class=\"colourbar\" style=\"background:{}\"></span>error: 0 to {FULL_ERROR} of 255, largest \
         channel. Details show, for all runs, the place where they err most together; their pixels are enlarged.</p>\n",
        picture_io::gradient()
    );
    html::section(&scene.prefix, "pictures", "Side by side", &(legend + &body))
}

/// The pictures that all evaluated runs have, by their mean DPSNR over the runs (PSNR where nothing moves): what each
/// is, camera, index.
fn chosen(scene: &Scene) -> Vec<(String, String, u32)> {
    let mut ranked: Vec<(f64, &str, u32)> = Vec::new();
    let mut common = scene.common_views();
    common.retain(|(camera, index, _)| {
        let written = |run: &Run| {
            let files = [run.folder.render_file(camera, *index), run.folder.truth_file(camera, *index)];
            // A name that cannot be a path is reported when the picture is read.
            files.iter().all(|file| file.as_ref().map_or(true, |file| file.is_file()))
        };
        scene.runs.iter().filter(|run| !run.views.is_empty()).all(written)
    });
    let moves = |(camera, index, _): &(&str, u32, i64)| {
        scene.runs.iter().filter_map(|run| run.view(camera, *index)).all(|view| view.dpsnr.is_some())
    };
    let by_dpsnr = common.iter().any(moves);
    for (camera, index, t_ns) in common {
        if by_dpsnr && !moves(&(camera, index, t_ns)) {
            continue;
        }
        let value = |view: &PerView| if by_dpsnr { view.dpsnr.unwrap_or(view.psnr) } else { view.psnr };
        let values: Vec<f64> = scene.runs.iter().filter_map(|run| run.view(camera, index)).map(value).collect();
        ranked.push((values.iter().sum::<f64>() / values.len().max(1) as f64, camera, index));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let name = if by_dpsnr { "DPSNR" } else { "PSNR" };
    let picks = [("Worst", 0), ("Median", ranked.len() / 2), ("Best", ranked.len().saturating_sub(1))];
    let mut found: Vec<(String, String, u32)> = Vec::new();
    for (what, at) in picks {
        let Some((_, camera, index)) = ranked.get(at) else { continue };
        if !found.iter().any(|(_, other, at)| other == camera && at == index) {
            found.push((format!("{what} {name}"), (*camera).into(), *index));
        }
    }
    found
}

/// What a run shows of a view.
struct Shown<'a> {
    run: (usize, &'a Run),
    view: Option<&'a PerView>,
    render: RgbImage,
    errors: Vec<u8>,
}

fn view(scene: &Scene, what: &str, camera: &str, index: u32) -> Result<String, String> {
    let evaluated: Vec<(usize, &Run)> =
        scene.runs.iter().enumerate().filter(|(_, run)| !run.views.is_empty()).collect();
    let path = |file: fn(&RunFolder, &str, u32) -> Result<PathBuf, RunError>, run: &Run| {
        file(&run.folder, camera, index).map_err(|error| error.to_string())
    };
    let Some(&(_, first)) = evaluated.first() else { return Ok(String::new()) };
    let truth = picture_io::read(&path(RunFolder::truth_file, first)?)?;
    let (width, height) = truth.dimensions();
    let mut shown = Vec::new();
    for (at, run) in evaluated {
        let file = path(RunFolder::render_file, run)?;
        let render = picture_io::read(&file)?;
        if render.dimensions() != truth.dimensions() {
            return Err(format!("'{}' has another size than the ground truth and is not shown.", file.display()));
        }
        let errors = picture_io::errors(&render, &truth);
        shown.push(Shown { run: (at, run), view: run.view(camera, index), render, errors });
    }
    // Masks are optional: without one every pixel counts.
    let mask = path(RunFolder::mask_file, first).ok().and_then(|file| picture_io::read(&file).ok());
    let mask = mask.filter(|mask| mask.dimensions() == truth.dimensions());

    let counts =
        |at: usize| mask.as_ref().is_none_or(|mask| mask.as_raw().get(3 * at).is_some_and(|&value| value > 127));
    let weight = |at: usize| shown.iter().map(|shown| f64::from(shown.errors[at]).powi(2)).sum::<f64>();
    let pixels = (width * height) as usize;
    let weights: Vec<f64> = (0..pixels).map(|at| if counts(at) { weight(at) } else { 0.0 }).collect();
    let size = ((width / DETAIL).max(1), (height / DETAIL).max(1));
    let place = picture_io::densest_window(&weights, (width, height), size.0, size.1);
    let frame = Frame { size: (width, height), place, detail: size };

    let seconds = shown.iter().find_map(|shown| shown.view).map_or(0.0, |view| view.t_ns as f64 / 1e9);
    let mut html = format!(
        "<h3>{}: camera {}, frame {index} <small>at {} s</small></h3>\n<div class=\"pictures\" style=\"--columns:{}\">\n",
        Escaped(what),
        Escaped(camera),
        number(seconds, 4),
        shown.len() + 1
    );
    html += &frame.column("ground truth", None, "", &truth, mask.as_ref());
    for Shown { run: (at, run), view, render, errors } in &shown {
        let mut figures = String::new();
        if let Some(view) = view {
            let _ = write!(figures, "PSNR {} dB", number(view.psnr, 2));
            if let Some(dpsnr) = view.dpsnr {
                let _ = write!(figures, ", DPSNR {} dB", number(dpsnr, 2));
            }
        }
        let map = picture_io::error_map(width, height, errors);
        html += &frame.column(&run.label, Some(*at), &figures, render, Some(&map));
    }
    Ok(html + "</div>\n")
}

/// Where the detail lies in the pictures of a view.
struct Frame {
    size: (u32, u32),
    place: (u32, u32),
    detail: (u32, u32),
}

impl Frame {
    /// A picture, what is shown below it (mask or error map), and the detail.
    fn column(
        &self,
        name: &str,
        run: Option<usize>,
        figures: &str,
        picture: &RgbImage,
        below: Option<&RgbImage>,
    ) -> String {
        let ((width, height), (x, y), (w, h)) = (self.size, self.place, self.detail);
        let name = Escaped(name);
        let swatch = swatch(run);
        let mut html = format!(
            "<figure><figcaption>{swatch}<b>{name}</b> <small>{figures}</small></figcaption>\
             <div class=\"framed\"><img src=\"{}\" width=\"{width}\" height=\"{height}\" alt=\"{name}\">\
             <svg viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\"><rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/></svg></div>\n",
            picture_io::photograph(picture)
        );
        let kind = if run.is_some() { "error map" } else { "moving pixels" };
        if let Some(below) = below {
            let _ = writeln!(
                html,
                "<img src=\"{}\" width=\"{width}\" height=\"{height}\" alt=\"{kind} of {name}\">",
                picture_io::exact(below)
            );
        } else {
            let _ = writeln!(html, "<div class=\"gap\" style=\"aspect-ratio:{width}/{height}\"></div>");
        }
        let detail = picture_io::detail(picture, self.place, w, h);
        let _ = writeln!(
            html,
            "<img class=\"detail\" src=\"{}\" width=\"{w}\" height=\"{h}\" alt=\"detail of {name}\">",
            picture_io::exact(&detail)
        );
        html + "</figure>\n"
    }
}

/// Event frames, measured and rendered: for each event camera the one with most events.
pub(super) fn events(scene: &mut Scene) -> String {
    let runs: Vec<(usize, &Run)> =
        scene.runs.iter().enumerate().filter(|(_, run)| run.folder.root().join("events").is_dir()).collect();
    let mut body = String::new();
    let mut notes = Vec::new();
    if let Some((_, first)) = runs.first() {
        for (camera, index) in busiest(&first.folder) {
            match event_figures(&runs, &camera, index) {
                Ok(html) => body += &html,
                Err(note) => notes.push(note),
            }
        }
    }
    scene.notes.extend(notes);
    if body.is_empty() {
        return String::new();
    }
    // Whole groups of a camera stand in a row.
    let group = runs.len() + 1;
    let columns = (4 / group).max(1) * group;
    let body = format!(
        "<div class=\"pictures events\" style=\"--columns:{columns}\">\n{body}</div>\n<p class=\"caption\">Of each event camera \
         the frame with most events, as measured and as predicted from the rendered brightness.</p>\n"
    );
    html::section(&scene.prefix, "events", "Event frames", &body)
}

/// Of each camera (the first few by name) the frame whose picture has most pixels unlike its background.
fn busiest(folder: &RunFolder) -> Vec<(String, u32)> {
    let names = |path: PathBuf| {
        let entries = fs::read_dir(path).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort();
        names
    };
    let mut found = Vec::new();
    for camera in names(folder.root().join("events")) {
        let mut best: Option<(usize, u32)> = None;
        for name in names(folder.root().join("events").join(&camera)) {
            let Some(index) = name.strip_suffix("-measured.png").and_then(|index| index.parse().ok()) else { continue };
            let Ok(path) = folder.measured_events_file(&camera, index) else { continue };
            let Ok(picture) = picture_io::read(&path) else { continue };
            let active = activity(&picture);
            if best.is_none_or(|(most, _)| active > most) {
                best = Some((active, index));
            }
        }
        found.extend(best.map(|(_, index)| (camera, index)));
        if found.len() == EVENT_CAMERAS {
            break;
        }
    }
    found
}

/// Pixels that differ from the most frequent colour.
fn activity(picture: &RgbImage) -> usize {
    let mut pixels: Vec<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
    pixels.sort_unstable();
    let most_frequent = pixels.chunk_by(|a, b| a == b).map(<[_]>::len).max().unwrap_or(0);
    pixels.len() - most_frequent
}

fn event_figures(runs: &[(usize, &Run)], camera: &str, index: u32) -> Result<String, String> {
    let file = |path: Result<PathBuf, RunError>| path.map_err(|error| error.to_string());
    let mut html = String::new();
    for (at, (run_index, run)) in runs.iter().enumerate() {
        if at == 0 {
            let measured = picture_io::read(&file(run.folder.measured_events_file(camera, index))?)?;
            html += &event_figure("measured", &format!("{camera}, from bin {index}"), None, Some(&measured));
        }
        // A run of another configuration may have no such frame: a gap keeps the columns.
        let rendered = file(run.folder.rendered_events_file(camera, index))?;
        let rendered = if rendered.is_file() { Some(picture_io::read(&rendered)?) } else { None };
        html += &event_figure(&run.label, "rendered", Some(*run_index), rendered.as_ref());
    }
    Ok(html)
}

fn event_figure(name: &str, what: &str, run: Option<usize>, picture: Option<&RgbImage>) -> String {
    let caption =
        format!("<figcaption>{}<b>{}</b> <small>{}</small></figcaption>", swatch(run), Escaped(name), Escaped(what));
    let Some(picture) = picture else { return format!("<figure>{caption}</figure>\n") };
    format!(
        "<figure>{caption}<img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"events, {}\"></figure>\n",
        picture_io::exact(picture),
        picture.width(),
        picture.height(),
        Escaped(name)
    )
}
