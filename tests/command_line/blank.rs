//! What a picture without content would be worth: the bound that a rendering has to beat.

use std::{fs, path::Path};

/// PSNR and DPSNR (dB) of the best picture of one colour, each the mean over the held-out frames of a run that was evaluated.
pub fn best_of_one_colour(run: &Path) -> [f64; 2] {
    let (mut whole, mut moving) = (Vec::new(), Vec::new());
    for camera in fs::read_dir(run.join("truth")).expect("held-out frames") {
        let camera = camera.expect("a camera");
        for frame in fs::read_dir(camera.path()).expect("frames") {
            let frame = frame.expect("a frame");
            let mask = run.join("masks").join(camera.file_name()).join(frame.file_name());
            let picture = image::open(frame.path()).expect("a picture").into_rgb8();
            let mask = image::open(mask).expect("a mask").into_luma8();
            let pixels: Vec<[f64; 3]> =
                picture.pixels().map(|pixel| pixel.0.map(|value| f64::from(value) / 255.0)).collect();
            let moves: Vec<bool> = mask.pixels().map(|pixel| pixel.0[0] > 127).collect();
            let colour = mean(pixels.iter().copied());
            whole.extend(psnr(&pixels, colour, |_| true));
            moving.extend(psnr(&pixels, colour, |index| moves[index]));
        }
    }
    [whole, moving].map(|values| {
        assert!(!values.is_empty(), "{} has no held-out frames", run.display());
        values.iter().sum::<f64>() / values.len() as f64
    })
}

fn mean(pixels: impl ExactSizeIterator<Item = [f64; 3]>) -> [f64; 3] {
    let count = pixels.len() as f64;
    pixels.fold([0.0; 3], |sum, pixel| [0, 1, 2].map(|channel| sum[channel] + pixel[channel] / count))
}

/// The PSNR of one colour over the chosen pixels; none where none is.
fn psnr(pixels: &[[f64; 3]], colour: [f64; 3], chosen: impl Fn(usize) -> bool) -> Option<f64> {
    let pixels = pixels.iter().enumerate().filter(|(index, _)| chosen(*index));
    let squares = pixels.flat_map(|(_, pixel)| [0, 1, 2].map(|channel| (pixel[channel] - colour[channel]).powi(2)));
    let squares: Vec<f64> = squares.collect();
    (!squares.is_empty()).then(|| -10.0 * (squares.iter().sum::<f64>() / squares.len() as f64).log10())
}
