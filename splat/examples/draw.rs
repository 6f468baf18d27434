//! Draws what a run has learned as one of its cameras sees it: `draw RUN OUT.png [CAMERA [SECONDS]]`.

use std::{error::Error, path::Path};

use erfgs_scene::ImageRgb8;
use erfgs_splat::{
    gpu::{AdapterChoice, Gpu},
    trained::TrainedScene,
};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [run, out, rest @ ..] = &words[..] else {
        return Err("usage: draw RUN OUT.png [CAMERA [SECONDS]]".into());
    };
    let seconds = rest.get(1).map_or(Ok(0.0), |text| text.parse())?;
    draw(Path::new(run), Path::new(out), rest.first().map(String::as_str), seconds)
}

/// Writes the picture of a camera (the first, where none is named) so many seconds after the recording's start.
pub fn draw(run: &Path, out: &Path, camera: Option<&str>, seconds: f64) -> Result<(), Box<dyn Error>> {
    let gpu = Gpu::open(&AdapterChoice::default())?;
    let mut scene = TrainedScene::open(&gpu, run)?;
    let record = scene.record();
    let wanted = |name: &str| camera.is_none_or(|camera| camera == name);
    let Some(camera) = record.cameras.iter().find(|camera| wanted(&camera.name)) else {
        let names: Vec<&str> = record.cameras.iter().map(|camera| camera.name.as_str()).collect();
        return Err(format!("the run has no such camera; it has {}", names.join(", ")).into());
    };
    let (view, t01) = (camera.view, record.share(seconds));
    let picture = scene.render(&view, t01)?;
    let image = ImageRgb8 { width: view.width, height: view.height, data: picture.to_bytes() };
    Ok(image.write_png(out)?)
}
