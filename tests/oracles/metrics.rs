//! SSIM and LPIPS against JAX (`metrics.py`).

use std::path::Path;

use erfgs_run::LpipsScaling;
use erfgs_train::metrics::{Lpips, LpipsWeights, Picture, ssim};

use super::run;

fn floats(path: &Path) -> Vec<f32> {
    std::fs::read(path).unwrap().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

#[test]
fn ssim_and_lpips_agree_with_jax() {
    let folder = tempfile::tempdir().unwrap();
    run("metrics.py", |oracle| oracle.arg(folder.path()));

    let text = std::fs::read_to_string(folder.path().join("expected.json")).unwrap();
    let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
    let size = |name: &str| expected[name].as_u64().unwrap() as u32;
    let (a, b) = (floats(&folder.path().join("a.f32")), floats(&folder.path().join("b.f32")));
    let a = Picture::new(size("width"), size("height"), &a).unwrap();
    let b = Picture::new(size("width"), size("height"), &b).unwrap();

    let got = ssim(a, b).unwrap();
    assert!((got - expected["ssim"].as_f64().unwrap()).abs() < 1e-6, "SSIM: {got} against {}", expected["ssim"]);

    for net in ["alex", "vgg16"] {
        let weights = LpipsWeights::read(&folder.path().join(format!("{net}.safetensors"))).unwrap();
        let lpips = Lpips::new(&weights).unwrap();
        assert_eq!(serde_json::to_value(lpips.net()).unwrap(), net);
        for scaling in [LpipsScaling::ZeroToOne, LpipsScaling::MinusOneToOne] {
            let name = serde_json::to_value(scaling).unwrap();
            let (got, expected) = (lpips.distance(a, b, scaling).unwrap(), &expected[net][name.as_str().unwrap()]);
            let relative = (got / expected.as_f64().unwrap() - 1.0).abs();
            assert!(relative < 1e-4, "{net} {name}: {got} against {expected}");
            assert!(lpips.distance(a, a, scaling).unwrap() == 0.0, "a picture is no distance from itself");
        }
    }
}
