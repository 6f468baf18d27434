//! PSNR of Gaussians that another trainer made, on the held-out frames of a dataset.
//!
//! `cargo run --release -p erfgs-lab --features studies --bin splat_quality -- DATASET SPLAT.ply...`
//!
//! For each file a line: its name, how many Gaussians it has, and mean PSNR in dB: over the training frames, and over the held-out
//! frames, as its own trainer renders (a near plane of 1 cm) and with what lies before the lens of a held-out camera left out, as
//! `erfgs eval` does. The Gaussians are in the dataset's own frame, metres, and stand still.

use std::{path::PathBuf, process::ExitCode};

use erfgs_dataset::Dataset;
use erfgs_scene::ply::GaussianCloud;
use erfgs_splat::{
    gaussians::sh_stride,
    gpu::{AdapterChoice, Gpu},
    model::to_bytes,
    near_plane,
    raster::{Frame, GaussianBuffers, RasterError, Rasteriser, RenderOptions},
};
use erfgs_train::{
    config::{Config, Method, Preset},
    metrics::{Picture, psnr, to_unit},
    scene::Scene,
};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The near plane of other trainers, metres.
const NEAR_M: f32 = 0.01;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("splat_quality: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<()> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let dataset = arguments.next().ok_or("usage: splat_quality DATASET SPLAT.ply...")?;
    let config = Config::preset(Method::FourDgs, Preset::Default);
    let scene = Scene::load(Dataset::load(&dataset)?, &config, false)?;
    let gpu = Gpu::open(&AdapterChoice::default())?;
    let rasteriser = Rasteriser::new(&gpu)?;
    let trained: Vec<[usize; 2]> = scene.frames.iter().map(|frame| [frame.view, frame.index]).collect();
    let held_out: Vec<[usize; 2]> = scene.held_out.iter().map(|frame| [frame.view, frame.index]).collect();
    for path in arguments {
        let cloud = GaussianCloud::read(&path)?;
        let gaussians = upload(&gpu, &cloud)?;
        let quality = |frames: &[[usize; 2]], share| quality(&gpu, &rasteriser, &gaussians, &scene, frames, share);
        let (trained, whole) = (quality(&trained, 0.0)?, quality(&held_out, 0.0)?);
        let cut = quality(&held_out, config.near_share)?;
        println!("{} {} {trained:.3} {whole:.3} {cut:.3}", path.display(), cloud.len());
    }
    Ok(())
}

/// The rows that the rasteriser reads.
fn upload(gpu: &Gpu, cloud: &GaussianCloud) -> Result<GaussianBuffers> {
    let (mut core, mut sh) = (Vec::new(), Vec::new());
    let padding = sh_stride(cloud.sh_degree) - cloud.sh_stride();
    for index in 0..cloud.len() {
        core.extend(cloud.positions[index]);
        core.extend(cloud.log_scales[index]);
        core.extend(cloud.rotations[index]);
        core.extend([cloud.opacity_logits[index], 0.0]);
        sh.extend(&cloud.sh[index * cloud.sh_stride()..][..cloud.sh_stride()]);
        sh.extend(std::iter::repeat_n(0.0, padding));
    }
    Ok(GaussianBuffers::from_slices(gpu, cloud.sh_degree, &core, &sh)?)
}

/// Mean PSNR over frames, each a camera and which of its frames; a near plane at `share` of the depth that points have.
fn quality(
    gpu: &Gpu,
    rasteriser: &Rasteriser,
    gaussians: &GaussianBuffers,
    scene: &Scene,
    frames: &[[usize; 2]],
    share: f32,
) -> Result<f64> {
    let (mut sum, mut drawn) = (0.0, Frame::new(gpu)?);
    for &[camera, index] in frames {
        let view = &scene.views[camera].view;
        let near = near_plane(scene.points.iter().map(|(place, _)| place), view, share, NEAR_M);
        let options = RenderOptions { sh_degree: gaussians.sh_degree, near, ..RenderOptions::default() };
        loop {
            rasteriser.forward(gpu, gaussians, None, view, &options, &mut drawn)?;
            match drawn.check(gpu) {
                // It has grown now.
                Err(RasterError::Overflow { .. }) => {}
                other => break other?,
            }
        }
        let image: Vec<[f32; 4]> = gpu.download(&drawn.image, (view.width * view.height) as usize)?;
        let shown: Vec<f32> = image.iter().flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        let shown = to_unit(&to_bytes(&shown));
        let camera = &scene.dataset.manifest.cameras[camera];
        let truth = scene.dataset.read_image(camera, &camera.frames[index])?;
        let unit = to_unit(&truth.data);
        let [a, b] = [&shown, &unit].map(|rgb| Picture::new(truth.width, truth.height, rgb));
        sum += psnr(a?, b?)?;
    }
    Ok(sum / frames.len().max(1) as f64)
}
