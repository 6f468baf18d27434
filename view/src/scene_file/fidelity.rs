//! What the codes of a file cost a picture.

use erfgs_splat::{gpu::Gpu, raster::View};
use erfgs_train::{
    density::Moments,
    metrics::{Picture, psnr, to_bytes, to_unit},
    trainer::{TrainError, TrainOptions, Trainer},
};

use super::SceneFile;

/// Cameras, and instants, of which pictures are compared.
const LOOKS: usize = 3;
/// What is said of pictures that are equal, dB.
const EQUAL_DB: f64 = 99.0;

/// PSNR (dB) of the pictures that `file` gives against those of the run that it was made from, over some cameras and instants.
///
/// # Errors
/// [`TrainError`] where the device fails, [`FidelityError::File`] where the file is not of that run.
pub fn fidelity<'a>(mut trainer: Trainer<'a>, gpu: &'a Gpu, file: &SceneFile) -> Result<f64, FidelityError> {
    let views: Vec<View> = trainer.scene.views.iter().map(|own| own.view).collect();
    let every = views.len().div_ceil(LOOKS).max(1);
    let looks: Vec<(View, f64)> = (0..LOOKS)
        .flat_map(|k| views.iter().step_by(every).map(move |view| (*view, (k as f64 + 0.5) / LOOKS as f64)))
        .collect();
    let drawn = |trainer: &mut Trainer<'_>| -> Result<Vec<Vec<f32>>, TrainError> {
        // As they are shown: in eight bits.
        looks.iter().map(|(view, t01)| Ok(to_unit(&to_bytes(&trainer.render(view, *t01)?.rgb)))).collect()
    };
    let exact = drawn(&mut trainer)?;
    let mut checkpoint = trainer.checkpoint()?;
    let gaussians = file.gaussians().map_err(FidelityError::File)?;
    checkpoint.population.moments = Moments::zero(&gaussians);
    checkpoint.population.gaussians = gaussians;
    for vector in checkpoint.field.iter_mut().flat_map(|field| &mut field.vectors) {
        if let Some(values) = file.section(&vector.name) {
            vector.values = values;
        }
    }
    let mut again = Trainer::resume(gpu, trainer.scene, checkpoint, &TrainOptions::default())?;
    let packed = drawn(&mut again)?;
    let mut error = 0.0;
    for (((view, _), exact), packed) in looks.iter().zip(&exact).zip(&packed) {
        let picture = |rgb| Picture::new(view.width, view.height, rgb);
        let decibels = picture(exact).and_then(|exact| psnr(exact, picture(packed)?)).map_err(TrainError::from)?;
        error += 10_f64.powf(-decibels / 10.0) / looks.len() as f64;
    }
    Ok((-10.0 * error.log10()).min(EQUAL_DB))
}

/// Why a file was not compared.
#[derive(Debug, thiserror::Error)]
pub enum FidelityError {
    /// The run.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The file.
    #[error("the scene file is of another run: {0}")]
    File(String),
}
