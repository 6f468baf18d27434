//! What every format but ours loses.

use super::Format;
use crate::{Modality, rig_file::RigFile};

/// Sentences on what a rig holds and no format of another program does.
pub(super) fn common(rig: &RigFile, format: Format) -> Vec<String> {
    let mut lost = Vec::new();
    let mut say = |condition: bool, what: &str| {
        if condition {
            lost.push(format!("a {format} {what}"));
        }
    };
    let cameras = &rig.cameras;
    say(cameras.iter().any(|camera| camera.sigma.is_some()), "holds no uncertainties");
    say(cameras.iter().any(|camera| camera.time_offset_s != 0.0), "holds no time offsets of cameras");
    say(cameras.iter().any(|camera| camera.modality != Modality::Rgb), "does not tell event cameras from others");
    let says_how_good =
        |camera: &crate::rig_file::RigCamera| camera.rms_px.is_some() || camera.observations > 0 || camera.outliers > 0;
    say(rig.quality.is_some() || cameras.iter().any(says_how_good), "does not hold how good the calibration is");
    let doubts = !rig.warnings.is_empty() || cameras.iter().any(|camera| !camera.warnings.is_empty());
    say(doubts, "holds no warnings");
    let silent = matches!(format, Format::Colmap | Format::Nerfstudio | Format::Llff);
    say(rig.metric && silent, "does not say that its unit is the metre: read it back with --metres");
    say(!rig.metric, "does not say that the rig's unit is not the metre");
    lost
}
