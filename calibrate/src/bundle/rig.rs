//! The rig file that a solved bundle stands for.

use std::collections::BTreeMap;

use erfgs_scene::{
    Modality,
    rig_file::{Quality, RigCamera, RigFile, Sigma},
};

use super::{Bundle, BundleCamera, CameraUncertainty, Parameter, Uncertainty};

impl Bundle {
    /// The rig file of a solved bundle. `modalities` has an entry for each camera.
    #[must_use]
    pub fn rig(&self, method: &str, uncertainty: &Uncertainty, modalities: &[Modality]) -> RigFile {
        let cameras = self.cameras.iter().zip(modalities).enumerate().map(|(index, (camera, &modality))| {
            let (rms_px, observations) = self.rms_px(Some(index));
            let outliers = self.observations.iter().filter(|o| o.camera == index && !o.used).count();
            RigCamera {
                name: camera.name.clone(),
                modality,
                intrinsics: camera.intrinsics,
                pose: Some(camera.pose),
                time_offset_s: camera.time_offset_s,
                sigma: Some(sigma(camera, &uncertainty.cameras[index])),
                rms_px: (observations > 0).then_some(rms_px),
                observations,
                outliers,
                warnings: Vec::new(),
            }
        });
        let mut rig = RigFile::new(method, true, cameras.collect());
        rig.quality = Some(self.quality(uncertainty));
        rig
    }

    fn quality(&self, uncertainty: &Uncertainty) -> Quality {
        let open = uncertainty.open.iter().map(|direction| {
            let parts = direction.parameters.iter().map(|&(number, parameter, share)| {
                let (what, of) = self.name(number, parameter);
                format!("{what} of {of} ({:.0} %)", 100.0 * share)
            });
            parts.collect::<Vec<_>>().join(", ")
        });
        Quality {
            rms_px: self.rms_px(None).0,
            variance_factor: uncertainty.variance_factor,
            degrees_of_freedom: uncertainty.degrees_of_freedom,
            condition: finite(uncertainty.condition),
            open: open.collect(),
            measures: BTreeMap::new(),
        }
    }
}

impl Bundle {
    /// What a parameter is called, and whose it is: that of a camera, or, counted after all cameras, of a side of a target.
    fn name(&self, number: usize, parameter: Parameter) -> (String, &str) {
        match self.cameras.get(number) {
            Some(camera) => (parameter.name(camera), &camera.name),
            None => {
                let side = self.sides.get(number - self.cameras.len());
                (parameter.of_pose().unwrap_or_default(), side.map_or("?", |side| &side.name))
            }
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn sigma(camera: &BundleCamera, known: &CameraUncertainty) -> Sigma {
    let mut sigma = Sigma::default();
    let mut shift_open = false;
    for (parameter, value) in camera.free.iter().zip(&known.sigma) {
        match parameter {
            Parameter::Rotation(_) => {}
            Parameter::Translation(_) => shift_open |= !value.is_finite(),
            Parameter::TimeOffset => sigma.time_offset_s = finite(*value),
            Parameter::Focal => {
                let ratio = camera.intrinsics.fy / camera.intrinsics.fx;
                sigma.intrinsics.insert("fx".into(), finite(*value));
                sigma.intrinsics.insert("fy".into(), finite(*value * ratio));
            }
            other => {
                sigma.intrinsics.insert(other.name(camera), finite(*value));
            }
        }
    }
    for axis in 0..3 {
        let variance = known.centre.col(axis)[axis].max(0.0);
        sigma.centre_m[axis] = if shift_open { None } else { Some(variance.sqrt()) };
        sigma.rotation_deg[axis] = finite(known.rotation[axis].to_degrees());
    }
    sigma
}
