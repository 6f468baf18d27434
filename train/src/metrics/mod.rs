//! Image quality: PSNR, DPSNR, SSIM and LPIPS, as the 4DGS evaluation defines them where it is well defined.

mod lpips;

pub use lpips::{LpipsKind, LpipsNet, LpipsScaling};
