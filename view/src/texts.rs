//! The files of the page, and the kernels that it runs.

use erfgs_splat::shaders;

/// Name, kind and text of each file of the page.
const FILES: &[(&str, &str, &str)] = &[
    ("style.css", "text/css; charset=utf-8", include_str!("page/style.css")),
    ("js/arrows.js", SCRIPT, include_str!("page/js/arrows.js")),
    ("js/bodies.js", SCRIPT, include_str!("page/js/bodies.js")),
    ("js/camera.js", SCRIPT, include_str!("page/js/camera.js")),
    ("js/carried.js", SCRIPT, include_str!("page/js/carried.js")),
    ("js/check.js", SCRIPT, include_str!("page/js/check.js")),
    ("js/choices.js", SCRIPT, include_str!("page/js/choices.js")),
    ("js/codings.js", SCRIPT, include_str!("page/js/codings.js")),
    ("js/controls.js", SCRIPT, include_str!("page/js/controls.js")),
    ("js/field.js", SCRIPT, include_str!("page/js/field.js")),
    ("js/gpu.js", SCRIPT, include_str!("page/js/gpu.js")),
    ("js/header.js", SCRIPT, include_str!("page/js/header.js")),
    ("js/main.js", SCRIPT, include_str!("page/js/main.js")),
    ("js/models.js", SCRIPT, include_str!("page/js/models.js")),
    ("js/overlay.js", SCRIPT, include_str!("page/js/overlay.js")),
    ("js/path.js", SCRIPT, include_str!("page/js/path.js")),
    ("js/pictures.js", SCRIPT, include_str!("page/js/pictures.js")),
    ("js/raster.js", SCRIPT, include_str!("page/js/raster.js")),
    ("js/recorded.js", SCRIPT, include_str!("page/js/recorded.js")),
    ("js/rows.js", SCRIPT, include_str!("page/js/rows.js")),
    ("js/save.js", SCRIPT, include_str!("page/js/save.js")),
    ("js/scene.js", SCRIPT, include_str!("page/js/scene.js")),
    ("js/source.js", SCRIPT, include_str!("page/js/source.js")),
    ("js/sort.js", SCRIPT, include_str!("page/js/sort.js")),
    ("js/take.js", SCRIPT, include_str!("page/js/take.js")),
    ("js/timeline.js", SCRIPT, include_str!("page/js/timeline.js")),
    ("js/training.js", SCRIPT, include_str!("page/js/training.js")),
    ("js/trajectory.js", SCRIPT, include_str!("page/js/trajectory.js")),
    ("js/viewer.js", SCRIPT, include_str!("page/js/viewer.js")),
    ("wgsl/blit.wgsl", PLAIN, include_str!("page/wgsl/blit.wgsl")),
    ("wgsl/blit_texture.wgsl", PLAIN, include_str!("page/wgsl/blit_texture.wgsl")),
    ("wgsl/depth_keys.wgsl", PLAIN, include_str!("page/wgsl/depth_keys.wgsl")),
    ("wgsl/mlp.wgsl", PLAIN, include_str!("page/wgsl/mlp.wgsl")),
    ("wgsl/quads.wgsl", PLAIN, include_str!("page/wgsl/quads.wgsl")),
];

const SCRIPT: &str = "text/javascript; charset=utf-8";
const PLAIN: &str = "text/plain; charset=utf-8";

/// The page.
pub(crate) const INDEX: &str = include_str!("page/index.html");

/// Names and texts of the page's scripts.
pub(crate) fn scripts() -> impl Iterator<Item = (&'static str, &'static str)> {
    FILES.iter().filter_map(|(name, _, text)| Some((name.strip_prefix("js/")?, *text)))
}

/// Names and texts of all kernels, as the page asks for them.
pub(crate) fn kernels() -> impl Iterator<Item = (String, &'static str)> {
    let own =
        FILES.iter().filter(|(name, ..)| name.starts_with("wgsl/")).map(|(name, _, text)| ((*name).to_owned(), *text));
    own.chain(shaders::TEXTS.iter().map(|(name, text)| (format!("train/{name}"), *text)))
}

/// Kind and text of a file of the page; those of the trainer's kernels lie under `train/`.
pub(crate) fn file(path: &str) -> Option<(&'static str, &'static str)> {
    if let Some(name) = path.strip_prefix("train/") {
        return shaders::TEXTS.iter().find(|(own, _)| *own == name).map(|(_, text)| (PLAIN, *text));
    }
    FILES.iter().find(|(own, ..)| *own == path).map(|(_, kind, text)| (*kind, *text))
}
