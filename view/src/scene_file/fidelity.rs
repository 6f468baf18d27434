//! What the codes of a file cost a picture.

use erfgs_splat::{
    model::{ModelError, to_bytes},
    raster::View,
    trained::TrainedScene,
};
use erfgs_train::metrics::{MetricError, Picture, psnr, to_unit};

use super::SceneFile;

/// Cameras, and instants, of which pictures are compared.
const LOOKS: usize = 3;
/// What is said of pictures that are equal, dB.
const EQUAL_DB: f64 = 99.0;

/// PSNR (dB) of the pictures that `file` gives against those of the run that it was made from, over some cameras and instants.
///
/// # Errors
/// [`FidelityError::Model`] where the device fails, [`FidelityError::File`] where the file is not of that run.
pub fn fidelity(mut scene: TrainedScene<'_>, file: &SceneFile) -> Result<f64, FidelityError> {
    let views: Vec<View> = scene.record().cameras.iter().map(|own| own.view).collect();
    let every = views.len().div_ceil(LOOKS).max(1);
    let looks: Vec<(View, f64)> = (0..LOOKS)
        .flat_map(|k| views.iter().step_by(every).map(move |view| (*view, (k as f64 + 0.5) / LOOKS as f64)))
        .collect();
    let drawn = |scene: &mut TrainedScene<'_>| -> Result<Vec<Vec<f32>>, ModelError> {
        // As they are shown: in eight bits.
        looks.iter().map(|(view, t01)| Ok(to_unit(&to_bytes(&scene.render(view, *t01)?.rgb)))).collect()
    };
    let exact = drawn(&mut scene)?;
    let mut learned = scene.learned().clone();
    learned.gaussians = file.gaussians().map_err(FidelityError::File)?;
    for vector in learned.shared.iter_mut().flat_map(|shared| &mut shared.vectors) {
        if let Some(values) = file.section(&vector.name) {
            vector.values = values;
        }
    }
    let gpu = scene.gpu();
    // There may be no room for both.
    drop(scene);
    let packed = drawn(&mut TrainedScene::new(gpu, learned)?)?;
    let mut error = 0.0;
    for (((view, _), exact), packed) in looks.iter().zip(&exact).zip(&packed) {
        let picture = |rgb| Picture::new(view.width, view.height, rgb);
        let decibels = psnr(picture(exact)?, picture(packed)?)?;
        error += 10_f64.powf(-decibels / 10.0) / looks.len() as f64;
    }
    Ok((-10.0 * error.log10()).min(EQUAL_DB))
}

/// Why a file was not compared.
#[derive(Debug, thiserror::Error)]
pub enum FidelityError {
    /// The run.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Pictures of no size.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// The file.
    #[error("the scene file is of another run: {0}")]
    File(String),
}
