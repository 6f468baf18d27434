//! Colour from a mosaic against OpenCV, which scripts/setup.sh --oracles installs: the paper's filters as OpenCV convolves
//! them, and OpenCV's own conversion.

use std::{fs, path::Path, process::Command};

use erfgs_scene::pixel::{BayerOrder, FrameFormat, PixelFormat, RawLook, Response, Samples, demosaic};

const WIDTH: usize = 96;
const HEIGHT: usize = 70;

/// A scene of discs and stripes in light whose colour changes slowly, so that detail is in all colours alike: 0 to 255.
fn scene(x: usize, y: usize) -> [f32; 3] {
    let [x, y] = [x as f32, y as f32];
    let disc = |cx: f32, cy: f32, r: f32| 1.0 / (1.0 + ((x - cx).hypot(y - cy) - r).exp());
    let stripes = 0.5 + 0.5 * (0.9 * x + 0.5 * y).sin();
    let luma = 50.0 + 70.0 * disc(30.0, 35.0, 20.0) + 50.0 * disc(66.0, 30.0, 16.0) + 50.0 * stripes;
    let colour = [0.8 + 0.3 * x / WIDTH as f32, 0.95, 0.6 + 0.4 * y / HEIGHT as f32];
    colour.map(|colour| (luma * colour).clamp(0.0, 255.0).round())
}

fn mosaic(order: BayerOrder) -> Vec<u16> {
    let places = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    places.map(|(x, y)| scene(x, y)[order.colour(x, y)] as u16).collect()
}

/// What `tests/oracles/demosaic.py` gives of a mosaic: the paper's filters, and OpenCV's interpolation.
fn opencv(folder: &Path, order: BayerOrder, mosaic: &[u16]) -> [Vec<f32>; 2] {
    let file = folder.join("mosaic");
    fs::write(&file, mosaic.iter().map(|&value| value as u8).collect::<Vec<_>>()).unwrap();
    let output = Command::new(erfgs_recordings::python())
        .arg(erfgs_recordings::root().join("tests/oracles/demosaic.py"))
        .arg(&file)
        .args([WIDTH.to_string(), format!("{order:?}").to_lowercase()])
        .output()
        .unwrap();
    assert!(output.status.success(), "OpenCV failed:\n{}", String::from_utf8_lossy(&output.stderr));
    ["filtered", "converted"].map(|name| {
        let bytes = fs::read(folder.join(name)).unwrap();
        bytes.chunks_exact(4).map(|float| f32::from_le_bytes(float.try_into().unwrap())).collect()
    })
}

#[test]
fn the_papers_filters_give_what_opencv_convolves_up_to_the_corners() {
    let folder = tempfile::tempdir().unwrap();
    for order in BayerOrder::ALL {
        let mosaic = mosaic(order);
        let values: Vec<f32> = mosaic.iter().map(|&value| value.into()).collect();
        let ours = demosaic(order, WIDTH, HEIGHT, &values);
        let [filtered, converted] = opencv(folder.path(), order, &mosaic);
        assert_eq!((filtered.len(), converted.len()), (ours.len(), ours.len()));
        let worst = std::iter::zip(&ours, &filtered).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-3, "{order:?}: {worst}");

        // OpenCV's bilinear conversion says which pixel is which colour, and how much the correction is worth.
        let inside = |at: usize| {
            let (x, y) = (at / 3 % WIDTH, at / 3 / WIDTH);
            (2..WIDTH - 2).contains(&x) && (2..HEIGHT - 2).contains(&y)
        };
        let rms = |found: &[f32]| {
            let off = (0..found.len()).filter(|&at| inside(at)).map(|at| {
                let truth = scene(at / 3 % WIDTH, at / 3 / WIDTH)[at % 3];
                f64::from(found[at] - truth).powi(2)
            });
            (off.sum::<f64>() / (3 * (WIDTH - 4) * (HEIGHT - 4)) as f64).sqrt()
        };
        let cut: Vec<f32> = ours.iter().map(|level| level.clamp(0.0, 255.0)).collect();
        let [ours_rms, theirs] = [rms(&cut), rms(&converted)];
        println!("{order:?}: rms {ours_rms:.3} levels of the scene, OpenCV's bilinear {theirs:.3}");
        assert!(ours_rms < 0.6 * theirs && theirs < 5.0, "{order:?}: {ours_rms} and {theirs}");

        // The same through a frame of 8 bits.
        let frames = FrameFormat {
            pixels: PixelFormat::Bayer(order, Samples::Bits8),
            width: WIDTH as u32,
            height: HEIGHT as u32,
            look: RawLook { response: Some(Response::Srgb), ..RawLook::default() },
        };
        let image = frames.picture(&Samples::Bits8.pack(&mosaic)).unwrap();
        let near = |(&level, &value): (&u8, &f32)| (f32::from(level) - value).abs() <= 0.51;
        assert!(image.data.iter().zip(&cut).all(near), "{order:?}");
    }
}
